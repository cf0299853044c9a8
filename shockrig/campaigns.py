"""Campaigns whose methods go on where reading ends: characterize, diagnose, plan."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.campaign import Campaign
from shockrig.files.campaign import read_campaign as _read_campaign
from shockrig.files.campaign_views import campaign_card
from shockrig.files.numbers import counted
from shockrig.given import PathLike, Progress
from shockrig.remedies import as_python

if TYPE_CHECKING:
    from shockrig.channels import Channels
    from shockrig.characterizing import Characterized
    from shockrig.choosing_runs import Planned
    from shockrig.diagnosing import Diagnosed
    from shockrig.files.fleet_file import Fleet


@dataclass(frozen=True, repr=False)
class ChainedCampaign(Campaign):
    """A `Campaign` as `read_campaign` and `import_log` give it: the functions of `import shockrig` are its methods.

    Attributes
    ----------
    notes : tuple of str
        What `import_log` did not use of the log, and why: columns, rows, steps.
    """

    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        said = super().__repr__()
        return f"{said[:-1]}; {counted(len(self.notes), 'note')}>" if self.notes else said

    def _repr_html_(self) -> str:
        return campaign_card(self, self.notes)

    def characterize(
        self,
        *,
        channels: Channels = None,
        seed: int = 0,
        extend: Diagnosed | PathLike | None = None,
        fleet: Fleet | PathLike | None = None,
        progress: Progress | None = None,
    ) -> Characterized:
        """How fast its sensors are: `shockrig.characterize` of this campaign."""
        from shockrig.characterizing import characterize

        return characterize(self, channels=channels, seed=seed, extend=extend, fleet=fleet, progress=progress)

    def diagnose(
        self,
        *,
        channels: Channels = None,
        tolerance_k: float = 0.03,
        tolerance_percent: float = 0.2,
        progress: Progress | None = None,
    ) -> Diagnosed:
        """What the plain model of its sensors gets wrong: `shockrig.diagnose` of this campaign."""
        from shockrig.diagnosing import diagnose

        tolerances = {"tolerance_k": tolerance_k, "tolerance_percent": tolerance_percent}
        return diagnose(self, channels=channels, progress=progress, **tolerances)

    def plan(
        self,
        *,
        until: str,
        runs: int = 6,
        channels: Channels = None,
        fleet: Fleet | PathLike | None = None,
        progress: Progress | None = None,
    ) -> Planned:
        """Which runs to record next: `shockrig.plan` of this campaign."""
        from shockrig.choosing_runs import plan

        return plan(self, until=until, runs=runs, channels=channels, fleet=fleet, progress=progress)


def chained(campaign: Campaign, **changes: Any) -> ChainedCampaign:
    """A campaign with the methods of `ChainedCampaign`; `changes` are fields that shall be others."""
    return ChainedCampaign(**{one.name: getattr(campaign, one.name) for one in fields(Campaign)} | changes)


def read_campaign(path: PathLike, probe: str = "1") -> ChainedCampaign:
    """Read and validate a campaign folder.

    Parameters
    ----------
    path : path
        The folder that holds campaign.json.
    probe : str
        Which one, where several were recorded at once: "2" is the one with the sensors `imet-2` and `hyt-2`.

    Raises
    ------
    InputError
        A file is missing, is not of its format, or holds a value that cannot be: names file, line or key, remedy.

    Examples
    --------
    >>> import shockrig
    >>> campaign = shockrig.read_campaign(shockrig.example("plain-rough"))
    >>> campaign
    <Campaign 'plain-rough': 33 runs, imet in 33, hyt in 33>
    >>> round(campaign.runs[10].destination.temperature_c), campaign.runs[10].airflow_m_s
    (20, 6.0)
    """
    with as_python():
        return chained(_read_campaign(Path(path), probe))
