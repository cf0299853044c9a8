"""What the functions of `import shockrig` return: results that show themselves in a notebook (a card of HTML, `plot`,
`to_frame`, `to_xarray`) and carry what the analysis found in `result`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from shockrig.analysis.characterization.result import Characterization
from shockrig.analysis.diagnosis.diagnosed import Diagnosis
from shockrig.files import result_views as views
from shockrig.files.flight import Corrected, Flight
from shockrig.files.profile import Profile, write_profile
from shockrig.files.views import profile_card

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Characterized:
    """What `characterize` found.

    Attributes
    ----------
    profile : Profile
        alpha, D(T), response times, noise, effects: what `correct` takes and `write` stores.
    result : Characterization
        All of it: fits, runs used and set aside, the optimisers' findings.
    """

    profile: Profile
    result: Characterization

    @property
    def notes(self) -> tuple[str, ...]:
        """What was seen in the input before any fit, and why a sensor could not be characterized."""
        seen = [finding.sentence for finding in self.result.findings]
        return (*seen, *(f"{name}: {reason}" for name, reason in self.result.missing.items()))

    def to_frame(self) -> pd.DataFrame:
        """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty, response times."""
        return self.profile.to_frame()

    def to_xarray(self) -> xr.Dataset:
        """D(T), response times and alpha as labelled arrays with units."""
        return self.profile.to_xarray()

    def plot(self) -> Figure:
        """D over temperature with its uncertainty and as it is interpolated; response times."""
        return self.profile.plot()

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the profile to a file, whole or not at all."""
        write_profile(self.profile, path)

    def _repr_html_(self) -> str:
        return profile_card(self.profile, self.notes)


@dataclass(frozen=True)
class Diagnosed:
    """What `diagnose` found.

    Attributes
    ----------
    document : dict
        The content of diagnosis.json (`shock-diagnosis/1`).
    result : Diagnosis
        All of it: searches, fits, what is left.
    """

    document: dict[str, Any]
    result: Diagnosis

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
        return self.result.input_findings

    @property
    def gain(self) -> pd.DataFrame:
        """The error on unseen runs before and after the extension, one row a channel."""
        return views.gain_frame(self.document)

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter of each named cause."""
        return views.causes_frame(self.document)

    def plot(self) -> Figure:
        """The error on unseen runs before and after the extension, beside the noise."""
        return views.plot_diagnosis(self.document)

    def _repr_html_(self) -> str:
        return views.diagnosis_card(self.document)


@dataclass(frozen=True)
class Planned:
    """What `plan` proposes.

    Attributes
    ----------
    runs : tuple of dict
        Runs that would tell tied explanations apart, in the terms of run.json, each with the evidence that is expected
        of it and the reason; empty where nothing is tied.
    advice : tuple of str
        What to record otherwise, so that the rest can be told.
    """

    runs: tuple[dict[str, Any], ...]
    advice: tuple[str, ...]

    def to_frame(self) -> pd.DataFrame:
        """One row for each run."""
        return views.plan_frame(self.runs)

    def plot(self) -> Figure:
        """The evidence that each run is expected to bring."""
        return views.plot_plan(self.runs)

    def _repr_html_(self) -> str:
        return views.plan_card(self.runs, self.advice)


@dataclass(frozen=True)
class CorrectedFlight:
    """A flight and its correction.

    Attributes
    ----------
    flight : Flight
        The readings.
    result : Corrected
        Corrected values, one standard uncertainty each, flags, and notes in plain words.
    """

    flight: Flight
    result: Corrected

    @property
    def notes(self) -> tuple[str, ...]:
        """What the correction had to say."""
        return self.result.notes

    def to_frame(self) -> pd.DataFrame:
        """Readings and corrected values row by row, columns as in the file that `shockrig correct` writes."""
        return views.flight_frame(self.flight, self.result)

    def to_xarray(self) -> xr.Dataset:
        """The same as labelled arrays over time, with units and CF standard names."""
        return views.flight_dataset(self.flight, self.result)

    def plot(self) -> Figure:
        """Reading and corrected value with its 95 % band against time."""
        return views.plot_flight(self.flight, self.result)

    def _repr_html_(self) -> str:
        return views.flight_card(self.flight, self.result)
