"""What the functions of `import shockrig` are given: campaigns and fleets or paths of them, who is told of progress."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.fleet import Fleet, read_fleet

PathLike = str | os.PathLike[str]
Progress = Callable[[str], None]  # is given sentences


def campaign_given(campaign: Campaign | PathLike) -> Campaign:
    """A campaign, or that of a folder."""
    return campaign if isinstance(campaign, Campaign) else read_campaign(Path(campaign))


def fleet_given(fleet: Fleet | PathLike) -> Fleet:
    """A fleet, or that of a file."""
    return fleet if isinstance(fleet, Fleet) else read_fleet(fleet)
