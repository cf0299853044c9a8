"""Plain checks of a campaign before any fit: wrong units, swaps, dead sensors, starts, copies, other sensors' runs."""

from shockrig.analysis.checks.campaign_checks import CHECKS, check_campaign
from shockrig.analysis.checks.finding import InputFinding

__all__ = ["CHECKS", "InputFinding", "check_campaign"]
