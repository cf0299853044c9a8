"""`shockrig.learn`: what flights say of the sensor that flew them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.correcting import CorrectedFlight, correct
from shockrig.files import result_views as views
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile, read_profile
from shockrig.files.views import card
from shockrig.flights import with_words
from shockrig.given import PathLike, Progress, WithProfile
from shockrig.protocols.folder import software_version
from shockrig.remedies import as_python, in_python

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from shockrig.analysis.learn.learn import FlightsLearned
    from shockrig.analysis.learn.pair import PairLearned
    from shockrig.files.learned import LearnedFile

    FlightGiven = pd.DataFrame | Flight | PathLike


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
    beside : LearnedSensor, optional
        The second sensor, where two flew side by side.
    """

    profile: Profile | None
    document: LearnedFile
    result: FlightsLearned
    notes: tuple[str, ...] = ()
    beside: LearnedSensor | None = None

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


def learn(
    flights: FlightGiven | Sequence[FlightGiven],
    *,
    profile: Profile | WithProfile | PathLike | None = None,
    beside: Mapping[str, str] | FlightGiven | Sequence[FlightGiven] | None = None,
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
    progress: Progress | None = None,
) -> LearnedSensor:
    """Say from flights of one sensor, up and down through the same air, what it lacks: lags, clock, what is open.

    Parameters
    ----------
    flights : DataFrame, Flight or path, or several of them
        Whole flights, each with altitude or pressure, as `read_flight` reads them.
    profile : Profile, Characterized or path, optional
        A bench's: what is known before the flights.
    beside : mapping, or as flights, optional
        A second sensor in the same air: {"temperature": NAME, "humidity": NAME} of its columns in the same logs, or its
        own logs, one for each flight.
    columns, map
        As in `correct`, for all flights.
    progress : function of a sentence, optional

    Returns
    -------
    LearnedSensor

    Raises
    ------
    InputError
        A log cannot be read, or no flight passes the same air twice.

    Examples
    --------
    From one flight and no bench; whether a correction helps takes a second flight to see.

    >>> import shockrig
    >>> found = shockrig.learn(shockrig.example("flight.csv"))
    >>> "time_constant_s" in set(found.to_frame().loc[["temperature"], "parameter"])
    True
    >>> after = found.correct(shockrig.example("flight.csv"))
    """
    from shockrig.protocols.learning import FlightsBeside, learned_from, of_columns, of_logs, pair_from

    say = progress or (lambda text: None)
    with as_python():
        if profile is not None and not isinstance(profile, Profile | str | os.PathLike):
            profile = profile.profile
        bench = profile if profile is None or isinstance(profile, Profile) else read_profile(profile)
        read, said = _read(flights, columns, map)
        if beside is None:
            return _sensor(learned_from(read, bench, say), read, said, bench)
        second: FlightsBeside
        if isinstance(beside, Mapping):
            second = of_columns(_read(flights, {**(columns or {}), **beside}, map)[0], tuple(beside))
        else:
            theirs, more = _read(beside, columns, map)
            if len(theirs) != len(read):
                raise InputError(f"beside: {len(theirs)} logs beside {len(read)} flights; give one for each flight")
            second, said = of_logs(read, theirs), said + more
        pair = pair_from(read, second, bench, say)
        other = _sensor(pair.together[1], read, said, None, pair)
        return replace(_sensor(pair.together[0], read, said, bench, pair), beside=other)


def _read(
    flights: FlightGiven | Sequence[FlightGiven], columns: Mapping[str, str] | None, map: PathLike | None
) -> tuple[dict[str, Flight], list[str]]:
    """Flights by name, and what was read as what."""
    from shockrig.protocols.flight_logs import named_both
    from shockrig.protocols.learning import checked

    named = named_both(columns, None if map is None else Path(map))
    given = list(flights) if isinstance(flights, Sequence) and not isinstance(flights, str) else [flights]
    read: dict[str, Flight] = {}
    said: list[str] = []
    for i, one in enumerate(given):
        name = Path(one).name if isinstance(one, str | os.PathLike) else f"flight {i + 1}"
        name = name if name not in read else f"{name} ({i + 1})"
        rows, words = with_words(one, columns, map)
        read[name], more = checked(name, rows, named)
        said += [f"{name}: {in_python(note)}" for note in (*words, *more)]
    return read, said


def _sensor(
    result: FlightsLearned,
    read: Mapping[str, Flight],
    said: Sequence[str],
    bench: Profile | None,
    pair: PairLearned | None = None,
) -> LearnedSensor:
    from shockrig.analysis.learn.learned_profile import learned_profile
    from shockrig.protocols.learning import learned_file

    provenance = {"software": f"shockrig {software_version()}"}
    notes = (*said, *(f"{name} left out: {why}" for name, why in result.left_out.items()))
    document = learned_file(result, read, provenance, pair)
    return LearnedSensor(learned_profile(result, provenance, bench), document, result, notes)
