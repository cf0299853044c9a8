"""All plain checks of a campaign before any fit, and the campaign without what they stop. A new check is one function
and one line in `CHECKS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from shockrig.analysis.checks.clocks import clocks_without_starts, starts_and_clocks
from shockrig.analysis.checks.finding import InputFinding, name_runs
from shockrig.analysis.checks.misfiled import (
    airs_disagree,
    airs_off_both,
    airs_swapped,
    columns_and_sensors_swapped,
    copied_runs,
)
from shockrig.analysis.checks.rates import response_times
from shockrig.analysis.checks.sensors import dead_sensors, impossible_readings, saturated_sensors
from shockrig.analysis.checks.signals import CampaignView, look
from shockrig.analysis.checks.units import (
    everything_a_fraction,
    everything_in_fahrenheit,
    everything_in_kelvin,
    mixed_units,
    starts_in_milliseconds,
    times_in_milliseconds,
    times_in_minutes,
)
from shockrig.files.campaign import Campaign

# Keys of campaign.json and run.json that mean nothing and are nearly the name of one that does.


def misspelt_keys(view: CampaignView) -> Iterator[InputFinding]:
    """One finding for each slip, with the runs that have it."""
    campaign, runs = view.campaign, dict[str, list[str]]()
    for said in campaign.misspelt:
        yield InputFinding("misspelt_key", None, (), "warn", f"campaign.json, {said} It says nothing as it is.")
    for run in campaign.runs:
        for said in run.misspelt:
            runs.setdefault(said, []).append(run.id)
    for said, those in runs.items():
        sentence = f"run.json of {view.words(those)}, {said} It says nothing as it is."
        yield InputFinding("misspelt_key", None, tuple(those), "warn", sentence)


def planned_runs(view: CampaignView) -> Iterator[InputFinding]:
    """Runs of the plan that are not there."""
    planned = view.campaign.planned
    if missing := sorted(set(planned) - {run.id for run in view.campaign.runs}):
        sentence = (
            f"Of the plan {name_runs(missing, len(planned))} {'is' if len(missing) == 1 else 'are'} not there: the "
            "campaign is still being recorded, or was interrupted. The same shockrig run command records the rest."
        )
        yield InputFinding("partly_recorded", None, (), "warn", sentence)


# All plain checks of a campaign before any fit. A new check is one function and one line in `CHECKS`.

# In this order: what one of them stops, the later ones no longer look at, so that one fault is said once.
CHECKS: tuple[Callable[[CampaignView], Iterable[InputFinding]], ...] = (
    misspelt_keys,
    planned_runs,
    everything_in_kelvin,
    impossible_readings,
    everything_a_fraction,
    mixed_units,
    columns_and_sensors_swapped,
    everything_in_fahrenheit,
    times_in_milliseconds,
    times_in_minutes,
    starts_in_milliseconds,
    saturated_sensors,
    dead_sensors,
    airs_swapped,
    copied_runs,
    starts_and_clocks,
    clocks_without_starts,
    airs_disagree,
    airs_off_both,
    response_times,
)


def check_campaign(campaign: Campaign) -> tuple[InputFinding, ...]:
    """Look for wrong units, swaps, dead sensors, wrong starts, copies and other sensors' runs; no model is fitted.

    Checks that need what the campaign does not record (starts, airs, airflow, a second sensor) are silent.

    Parameters
    ----------
    campaign : Campaign
        As `shockrig.files.campaign.read_campaign` returns it.

    Returns
    -------
    tuple of InputFinding
        In the order of `CHECKS`; empty where nothing looks wrong.
    """
    view = look(campaign)
    findings: list[InputFinding] = []
    for check in CHECKS:
        found = list(check(view))
        findings += found
        view = view.without(found)
    return tuple(findings)


CHANNELS = ("temperature", "humidity")


@dataclass(frozen=True)
class Checked:
    """A campaign without what must not be fitted, and everything that the checks say of it."""

    campaign: Campaign
    findings: tuple[InputFinding, ...]


def checked(campaign: Campaign) -> Checked:
    """Check a campaign; runs that a finding stops are set aside in its channel, for the reason it gives."""
    findings = check_campaign(campaign)
    why: dict[str, dict[str, str]] = {}
    for finding in findings:
        if finding.severity == "stop":
            for run in finding.runs:
                for channel in CHANNELS if finding.channel is None else (finding.channel,):
                    why.setdefault(run, {}).setdefault(channel, finding.sentence)
    if not why:
        return Checked(campaign, findings)
    runs = tuple(replace(run, set_aside=why[run.id]) if run.id in why else run for run in campaign.runs)
    return Checked(replace(campaign, runs=runs), findings)
