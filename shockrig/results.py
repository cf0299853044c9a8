"""What the functions of `import shockrig` return: results that show themselves in a notebook (a card of HTML, `plot`,
`to_frame`, `to_xarray`) and carry what the analysis found in `result`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.analysis.characterize.result import Characterization
from shockrig.analysis.diagnose.diagnosed import Diagnosis
from shockrig.analysis.fleet.prior import WithFleet
from shockrig.analysis.report.characterize_page import hint
from shockrig.files import result_views as views
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError
from shockrig.files.flight import Corrected, Flight
from shockrig.files.flight_figure import Against, plot_flight
from shockrig.files.headline import headlines
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile, write_profile
from shockrig.files.views import card, profile_card
from shockrig.remedies import in_python

PathLike = str | os.PathLike[str]

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from shockrig.analysis.learn.learn import FlightsLearned
    from shockrig.campaigns import Progress
    from shockrig.channels import Channels
    from shockrig.files.fleet import Fleet
    from shockrig.files.learned import LearnedFile


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
        from shockrig.notebook import correct

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
        from shockrig.notebook import plan

        return plan(self, until=until, runs=runs, channels=channels, fleet=fleet, progress=progress)

    def __repr__(self) -> str:
        said = []
        for name, verdict in self.verdicts.items():
            causes = self.causes[name]
            said.append(f"{name} {verdict}" + (f" by {', '.join(causes)}" if causes else ""))
        return f"<Diagnosed {self.campaign.name!r}: {'; '.join(said)}>"

    def _repr_html_(self) -> str:
        return views.diagnosis_card(self.document)


@dataclass(frozen=True, repr=False)
class Planned:
    """What `plan` proposes.

    Attributes
    ----------
    runs : tuple of dict
        Runs that would tell tied explanations apart, in the terms of run.json, each with the evidence that is expected
        of it and the reason; empty where nothing is tied.
    advice : tuple of str
        What to record otherwise, so that the rest can be told.
    status, reason : str
        Where goals were given: "continue", "done" or "inconclusive", and why.
    goals : tuple of dict
        Each goal with where it stands (`goal`, `now`, `met`).
    """

    runs: tuple[dict[str, Any], ...]
    advice: tuple[str, ...]
    status: str = ""
    reason: str = ""
    goals: tuple[dict[str, Any], ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """One row for each run."""
        return views.plan_frame(self.runs)

    def to_xarray(self) -> xr.Dataset:
        """The same as labelled arrays over the run's number."""
        return views.plan_dataset(self.runs)

    def plot(self) -> Figure:
        """What each run is expected to bring: to the goals, or to telling tied explanations apart."""
        return views.plot_plan(self.runs, self.reason)

    def __repr__(self) -> str:
        return f"<Planned: {counted(len(self.runs), 'run')}; {self._why}>"

    @property
    def _why(self) -> str:
        """Why there are these runs, or none."""
        if self.status:
            return f"{self.status}: {self.reason}"
        return "they tell tied explanations apart" if self.runs else views.NOTHING_TIED

    def _repr_html_(self) -> str:
        stands = [(f"{self.status}", self.reason)] if self.status else []
        return views.plan_card(self.runs, self.advice, stands)


@dataclass(frozen=True, repr=False)
class LearnedSensor:
    """What `learn` found.

    Attributes
    ----------
    profile : Profile, optional
        What flights show of the lags, for `correct`; None where no lag that they show brings their passes together.
    document : LearnedFile
        The content of learned.json.
    result : FlightsLearned
        All of it: fits, flights as they were used, how far their passes disagree.
    notes : tuple of str
        What was read as what, and which flights were left out and why.
    """

    profile: Profile | None
    document: LearnedFile
    result: FlightsLearned
    notes: tuple[str, ...] = ()

    @property
    def verdicts(self) -> dict[str, str]:
        """A sentence on each channel."""
        from shockrig.protocols.learning import sentence

        return {name: sentence(one).removeprefix(f"{name}: ") for name, one in self.result.channels.items()}

    def to_frame(self) -> pd.DataFrame:
        """One row for each number of each law that may act."""
        return views.learned_frame(self.document)

    def to_xarray(self) -> xr.Dataset:
        """How far passes disagree as read, with one lag and with the likeliest model, as labelled arrays."""
        return views.learned_dataset(self.document)

    def plot(self) -> Figure:
        """The later pass less the earlier one over altitude, as read and corrected by fits without the flight."""
        from shockrig.analysis.report.learned_page import plot_learned

        return plot_learned(self.result)

    def correct(self, flight: pd.DataFrame | Flight | PathLike, **settings: Any) -> CorrectedFlight:
        """A flight of this sensor corrected: `shockrig.correct` with this profile and the same settings.

        Raises
        ------
        InputError
            The flights showed no lag to correct for.
        """
        from shockrig.notebook import correct

        if self.profile is None:
            raise InputError("these flights show no lag that brings their passes together: nothing to correct with")
        return correct(flight, self.profile, **settings)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write learned.json to a file, whole or not at all; `profile` is written by `shockrig.write_profile`."""
        from shockrig.files.learned import write_learned

        write_learned(self.document, Path(path))

    def __repr__(self) -> str:
        return f"<LearnedSensor: {'; '.join(f'{name} {said}' for name, said in self.verdicts.items())}>"

    def _repr_html_(self) -> str:
        facts = [*self.verdicts.items(), *(("note", note) for note in self.notes)]
        return card(f"Learned from {counted(len(self.result.bins), 'flight')}", facts, self.to_frame())


@dataclass(frozen=True, repr=False)
class CorrectedFlight:
    """A flight and its correction.

    Attributes
    ----------
    flight : Flight
        The readings.
    result : Corrected
        Corrected values, one standard uncertainty each, flags, and notes in plain words.
    profile : Profile
        Of the sensors that it was corrected with.
    """

    flight: Flight
    result: Corrected
    profile: Profile

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

    def plot(self, against: Against = "time") -> Figure:
        """Reading and corrected value against "time" or "altitude", with its 95 % band.

        Raises
        ------
        InputError
            The log has no altitude that changes.
        """
        return plot_flight(self.flight, self.result, against)

    def __repr__(self) -> str:
        said = [f"{name} {words}" for name, words in views.flight_facts(self.flight, self.result)]
        return f"<CorrectedFlight: {'; '.join(said)}>"

    def _repr_html_(self) -> str:
        return views.flight_card(self.flight, self.result)
