"""`shockrig.diagnose`: what the plain model gets wrong, and what explains it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from shockrig.analysis.diagnose.diagnose import diagnose as _diagnose
from shockrig.analysis.diagnose.diagnosed import Diagnosis, to_json
from shockrig.analysis.diagnose.remainder import Tolerance
from shockrig.channels import Channels, of_campaign, only
from shockrig.choosing_runs import Planned, plan
from shockrig.files import result_views as views
from shockrig.files.campaign import Campaign
from shockrig.files.fleet_file import Fleet
from shockrig.given import PathLike, Progress, campaign_given
from shockrig.remedies import as_python, in_python

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Diagnosed:
    """What `diagnose` found.

    Attributes
    ----------
    document : dict
        The content of diagnosis.json (`shock-diagnosis/1`).
    result : Diagnosis
        All of it: searches, fits, what is left.
    campaign : Campaign
        What was diagnosed.
    """

    document: dict[str, Any]
    result: Diagnosis
    campaign: Campaign

    @property
    def verdicts(self) -> dict[str, str]:
        """The verdict on each channel."""
        return {name: found["verdict"] for name, found in self.document["channels"].items()}

    @property
    def causes(self) -> dict[str, list[str]]:
        """The effects named in each channel."""
        return {name: [c["effect"] for c in found["causes"]] for name, found in self.document["channels"].items()}

    @property
    def notes(self) -> tuple[str, ...]:
        """What was seen in the input before any fit."""
        return tuple(in_python(note) for note in self.result.input_findings)

    @property
    def gain(self) -> pd.DataFrame:
        """The error on unseen runs before and after the extension, one row a channel."""
        return views.gain_frame(self.document)

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter of each named cause."""
        return views.causes_frame(self.document)

    def to_xarray(self) -> xr.Dataset:
        """Errors on unseen runs over the channel, and the causes' parameters, as labelled arrays."""
        return views.diagnosis_dataset(self.document)

    def plot(self) -> Figure:
        """The error on unseen runs before and after the extension, beside the noise."""
        return views.plot_diagnosis(self.document)

    def plan(
        self,
        *,
        until: str | None = None,
        runs: int = 6,
        channels: Channels = None,
        fleet: Fleet | PathLike | None = None,
        progress: Progress | None = None,
    ) -> Planned:
        """Which runs to record next: `shockrig.plan` of this diagnosis."""
        return plan(self, until=until, runs=runs, channels=channels, fleet=fleet, progress=progress)

    def __repr__(self) -> str:
        said = []
        for name, verdict in self.verdicts.items():
            causes = self.causes[name]
            said.append(f"{name} {verdict}" + (f" by {', '.join(causes)}" if causes else ""))
        return f"<Diagnosed {self.campaign.name!r}: {'; '.join(said)}>"

    def _repr_html_(self) -> str:
        return views.diagnosis_card(self.document)


def diagnose(
    campaign: Campaign | PathLike,
    *,
    channels: Channels = None,
    tolerance_k: float = 0.03,
    tolerance_percent: float = 0.2,
    progress: Progress | None = None,
) -> Diagnosed:
    """Say what the plain model of a campaign's sensors gets wrong, which effects cause it, and what is gained by them.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    channels : {"temperature", "humidity"} or several of them, optional
        Which sensors to look at; all that were recorded where it is left out.
    tolerance_k, tolerance_percent : float
        From which size on what is left spoils a verdict; by default a tenth of the sensors' stated accuracy.
    progress : function of a sentence, optional

    Returns
    -------
    Diagnosed

    Raises
    ------
    InputError
        The campaign cannot be read, or no sensor has enough runs that can be used.

    Examples
    --------
    Sensors in which nothing is hidden; of those of `example("ordinary-bench")` the bead is explained by three effects.

    >>> import shockrig
    >>> found = shockrig.diagnose(shockrig.example("plain-rough"), channels=["temperature"])
    >>> found.verdicts
    {'temperature': 'adequate'}
    >>> found.gain.loc["temperature", ["held_out_rmse_before", "noise_floor"]].astype(float).round(3).to_list()
    [0.023, 0.023]
    """
    tolerance = Tolerance(tolerance_k, tolerance_percent)
    with as_python():
        recorded = campaign_given(campaign)
        recorded = only(recorded, of_campaign(recorded, channels))
        result = _diagnose(recorded, progress=progress or (lambda text: None), tolerance=tolerance)
    return Diagnosed(to_json(result), result, recorded)
