"""What the functions of `import shockrig` are given: campaigns, fleets or paths of them, results of one another.

A result that goes into a function is told by what the function takes from it, so that neither knows the other's file.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.fleet_file import Fleet, read_fleet
from shockrig.files.profile import Profile

if TYPE_CHECKING:
    from shockrig.analysis.diagnose.diagnosed import Diagnosis

PathLike = str | os.PathLike[str]
Progress = Callable[[str], None]  # is given sentences


class WithProfile(Protocol):
    """What `correct` takes for a profile: a result that holds one, as `Characterized` does."""

    @property
    def profile(self) -> Profile: ...


class WithDiagnosis(Protocol):
    """What `plan` takes for a diagnosis: a result that holds one and its campaign, as `Diagnosed` does."""

    @property
    def campaign(self) -> Campaign: ...

    @property
    def result(self) -> Diagnosis: ...


def campaign_given(campaign: Campaign | PathLike) -> Campaign:
    """A campaign, or that of a folder."""
    return campaign if isinstance(campaign, Campaign) else read_campaign(Path(campaign))


def fleet_given(fleet: Fleet | PathLike) -> Fleet:
    """A fleet, or that of a file."""
    return fleet if isinstance(fleet, Fleet) else read_fleet(fleet)
