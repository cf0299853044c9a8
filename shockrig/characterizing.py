"""`shockrig.characterize`: how fast a campaign's sensors are."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.analysis.characterize.characterize import characterize as _characterize
from shockrig.analysis.characterize.part_fit import Extension, extension_of, read_extension
from shockrig.analysis.characterize.result import Characterization, to_profile
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.analysis.fleet.fleet_prior import WithFleet, with_population
from shockrig.analysis.report.characterize_page import hint
from shockrig.channels import Channels, of_campaign
from shockrig.correcting import CorrectedFlight, correct
from shockrig.diagnosing import Diagnosed
from shockrig.files.campaign import Campaign
from shockrig.files.fleet_file import Fleet
from shockrig.files.flight import Flight
from shockrig.files.headline import headlines
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile, write_profile
from shockrig.files.profile_views import profile_card
from shockrig.given import PathLike, Progress, campaign_given, fleet_given
from shockrig.protocols.folder import software_version
from shockrig.remedies import as_python, in_python

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Characterized:
    """What `characterize` found.

    Attributes
    ----------
    profile : Profile
        alpha, D(T), response times, noise, effects: what `correct` takes and `write` stores.
    result : Characterization
        All of it: fits, runs used and set aside, the optimisers' findings.
    fleet : WithFleet, optional
        What a fleet made of it: whether the sensors belong, each number alone and with the others.
    """

    profile: Profile
    result: Characterization
    fleet: WithFleet | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was seen in the input before any fit, where the model is not enough, and what could not be had."""
        seen = [in_python(finding.sentence) for finding in self.result.findings]
        bad = [hint(name, found) for name, found in self.result.channels().items() if not found.explained]
        fleet = () if self.fleet is None else self.fleet.sentences
        return (
            *seen,
            *fleet,
            *map(in_python, bad),
            *(f"{name}: {reason}" for name, reason in self.result.missing.items()),
        )

    def to_frame(self) -> pd.DataFrame:
        """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty, response times."""
        return self.profile.to_frame()

    def to_xarray(self) -> xr.Dataset:
        """D(T), response times and alpha as labelled arrays with units."""
        return self.profile.to_xarray()

    def plot(self) -> Figure:
        """The steps of each sensor with their fits, what is left of them, and D over temperature where it is known."""
        from shockrig.analysis.report.fitted import plot_characterized

        return plot_characterized(self.result, self.profile)

    def correct(self, flight: pd.DataFrame | Flight | PathLike, **settings: Any) -> CorrectedFlight:
        """A flight of these sensors corrected: `shockrig.correct` with this profile and the same settings."""
        return correct(flight, self.profile, **settings)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the profile to a file, whole or not at all."""
        write_profile(self.profile, path)

    def __repr__(self) -> str:
        said = [f"{name} {value}" for name, value in headlines(self.profile)]
        doubted = [one.channel.sensor for one in self.result.channels().values() if not one.explained]
        said += [f"effective: the model does not explain the {sensor}'s readings" for sensor in doubted]
        said += [counted(len(self.notes), "note")] if self.notes else []
        return f"<Characterized {self.result.campaign.name!r}: {'; '.join(said)}>"

    def _repr_html_(self) -> str:
        return profile_card(self.profile, self.notes)


def characterize(
    campaign: Campaign | PathLike,
    *,
    channels: Channels = None,
    seed: int = 0,
    extend: Diagnosed | PathLike | None = None,
    fleet: Fleet | PathLike | None = None,
    progress: Progress | None = None,
) -> Characterized:
    """Find how fast a campaign's sensors are: alpha of a bead, D(T) of a film, tau of what is one lag, response times.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    channels : {"temperature", "humidity"} or several of them, optional
        Which sensors to look at; all that were recorded where it is left out.
    seed : int
        Of the differential evolution that finds the start of the fit.
    extend : Diagnosed or path, optional
        A diagnosis (or its diagnosis.json) whose causes the model shall carry; alpha and D are then the material's, no
        longer effective numbers.
    fleet : Fleet or path, optional
        What other sensors of the type say, as the prior: a few runs are enough then. Sensors that do not belong to it
        are told in `notes`, and have a profile of their own data alone.
    progress : function of a sentence, optional

    Returns
    -------
    Characterized

    Raises
    ------
    InputError
        The campaign cannot be read, or neither sensor has a run that can be used; the reasons are named.

    See Also
    --------
    diagnose : what the model that is fitted here gets wrong.

    Examples
    --------
    >>> import shockrig
    >>> found = shockrig.characterize(shockrig.example("plain-rough"))
    >>> alpha = found.profile.temperature.thermal_diffusivity_m2_s
    >>> print(f"{alpha.value:.1e} m2/s, known to {100 * alpha.standard_uncertainty / alpha.value:.1f} %")
    8.3e-08 m2/s, known to 0.1 %
    >>> film = found.to_frame().loc["humidity", ["ambient_temperature_c", "t63_s"]]
    >>> film.round(0).head(3).to_numpy().tolist()
    [[0.0, 5.0], [10.0, 4.0], [20.0, 3.0]]
    """
    with as_python():
        recorded = campaign_given(campaign)
        wanted = of_campaign(recorded, channels)
        result = _characterize(
            recorded, seed=seed, extensions=extensions_of(extend), progress=progress, channels=wanted
        )
    profile = to_profile(result, {"software": f"shockrig {software_version()}"})
    if fleet is None:
        return Characterized(profile, result)
    with as_python():
        known = with_population(result, fleet_given(fleet).population)
    return Characterized(replace(known.profile, provenance=profile.provenance), result, known)


def extensions_of(extend: Diagnosed | PathLike | None) -> dict[ChannelName, Extension] | None:
    """Models that carry a diagnosis's causes."""
    if extend is None:
        return None
    if not isinstance(extend, Diagnosed):
        return read_extension(Path(extend))
    return {found.name: extension_of([cause.as_effect() for cause in found.causes]) for found in extend.result.channels}
