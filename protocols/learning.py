"""Flights to what they say of their sensor: read, learned, and as the files that `shockrig learn` writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.learned import (
    GainOnNextFlight,
    LearnedChannel,
    LearnedFile,
    PassesApart,
    StatedFlight,
    StatedLaw,
    StatedModel,
    StatedNumber,
    StatedPosition,
)

if TYPE_CHECKING:
    from shockrig.analysis.learn.learn import ChannelLearned, FlightCause, FlightsLearned
    from shockrig.files.profile import Profile


def named_flights(
    paths: Sequence[Path], columns: Mapping[str, str] | None = None, map_path: Path | None = None
) -> tuple[dict[str, Flight], list[str]]:
    """Flights by their files' names, and what was read as what.

    Raises
    ------
    InputError
        A log cannot be read, or is named twice.
    """
    from shockrig.protocols.flight_logs import read_log

    flights: dict[str, Flight] = {}
    said: list[str] = []
    for path in paths:
        name = path.name if path.name not in flights else str(path)
        if name in flights:
            raise InputError(f"{path}: named twice; each flight counts once")
        flight, notes = read_log(path, columns, map_path)
        flights[name], more = with_altitude(flight)
        said += [f"{name}: {note}" for note in (*notes, *more)]
    return flights, said


def with_altitude(flight: Flight) -> tuple[Flight, list[str]]:
    """A flight with an altitude, by its pressure where the log has none, and a sentence that says so."""
    if flight.altitude_m is not None and np.isfinite(flight.altitude_m).any():
        return flight, []
    said = ["it has no altitude; that of its pressure in the standard atmosphere is used"]
    flight = replace(flight, altitude_m=pressure_altitude_m(flight.pressure_hpa))
    return flight, said if np.isfinite(flight.pressure_hpa).any() else []


def learned_from(
    flights: Mapping[str, Flight], bench: Profile | None = None, progress: Callable[[str], None] = lambda said: None
) -> FlightsLearned:
    """What flights say of their sensor; InputError where none passes the same air twice."""
    from shockrig.analysis.learn.learn import learn
    from shockrig.analysis.learn.profile import stated_by

    stated = None
    if bench is not None:
        temperatures = np.concatenate([one.temperature_c for one in flights.values()])
        known = temperatures[np.isfinite(temperatures)]
        stated = stated_by(bench, float(np.median(known)) if known.size else 20.0)
    return learn(flights, stated, progress)


def learned_file(learned: FlightsLearned, flights: Mapping[str, Flight], provenance: Mapping[str, Any]) -> LearnedFile:
    """What `learned.json` holds."""
    altitudes = np.concatenate([one.altitude_m for one in learned.bins])
    return LearnedFile(
        channels={name: _channel(one, learned) for name, one in learned.channels.items()},
        altitude_m=(float(altitudes.min()), float(altitudes.max())),
        home=_home(flights),
        minutes=float(np.median([one.minutes for one in learned.bins])),
        position=StatedPosition(learned.position_named, tuple(_cause(one) for one in learned.position)),
        flights=tuple(
            StatedFlight(one.name, one.minutes, tuple(p.climb_m_s for p in one.passes)) for one in learned.bins
        ),
        left_out=learned.left_out,
        models=tuple(StatedModel(said, weight) for said, weight in learned.weights),
        provenance=provenance,
    )


def _channel(one: ChannelLearned, learned: FlightsLearned) -> LearnedChannel:
    from shockrig.analysis.learn.density import MOVES

    seen = [b.values[one.channel][b.seen(one.channel)] for b in learned.bins if b.has(one.channel)]
    off = {"as_read": one.read, "one_lag": one.single, "model": one.model}
    return LearnedChannel(
        verdict=one.verdict,
        unit=float(np.median([values.std() for values in seen])),
        sizes=tuple(np.median([sizes[:-MOVES] for sizes in one.lag.sizes], axis=0).tolist()),
        rivals=one.rivals,
        mean=float(np.concatenate(seen).mean()),
        why=one.why,
        causes=tuple(_cause(cause) for cause in one.causes),
        refuted=one.refuted,
        passes_disagree={key: PassesApart(apart.mean, apart.spread) for key, apart in off.items()},
        gain=None if one.gain is None else GainOnNextFlight(one.gain.ratio, one.gain.low, one.gain.high),
    )


def _cause(cause: FlightCause) -> StatedLaw:
    numbers = {p.name: StatedNumber(p.value, p.standard_uncertainty, p.unit) for p in cause.parameters}
    law = cause.law
    return StatedLaw(law.key, law.causes, cause.probability, law.equation, law.source, law.needs, numbers)


def _home(flights: Mapping[str, Flight]) -> tuple[float, float, float] | None:
    """Where the first flight with a position began: latitude, longitude [deg], altitude [m]."""
    for one in flights.values():
        if one.latitude_deg is None or one.longitude_deg is None or one.altitude_m is None:
            continue
        known = np.flatnonzero(np.isfinite(one.latitude_deg + one.longitude_deg + one.altitude_m))
        if known.size:
            first = known[0]
            return float(one.latitude_deg[first]), float(one.longitude_deg[first]), float(one.altitude_m[first])
    return None


def disagree(one: ChannelLearned) -> str:
    """How far passes of a flight disagree, in a sentence."""
    unit = "K" if one.channel == "temperature" else "%RH"
    parts = [
        f"{name} by {off.mean:+.2g} on average and {off.spread:.2g} {unit} about it"
        for name, off in (("as read", one.read), ("with one lag", one.single), ("with the model", one.model))
    ]
    whose = "passes of flights that were not fitted" if len(set(one.read.flight)) > 1 else "passes of the flight fitted"
    said = f"{whose} differ {', '.join(parts)}"
    if one.verdict != "adequate" and (gain := one.gain) is not None:
        said += (
            f"; those of a next flight will differ by {gain.ratio:.2g} of what they differ by as read "
            f"(90 %: {gain.low:.2g} to {gain.high:.2g})"
        )
    if one.verdict != "adequate" and not one.gains:
        said += ": no gain, so the profile leaves this channel as it is read"
    elif one.verdict != "adequate" and one.model.rms > one.read.rms:
        said += ": nearer in their structure, and on average farther apart than as read"
    return said


def sentence(one: ChannelLearned) -> str:
    """A channel's verdict in a sentence."""
    said = ", or ".join(_said(cause) for cause in one.causes)
    if one.verdict == "adequate":
        return f"{one.channel}: adequate: no lag above {one.limit_s:.2g} s, and nothing else shows"
    if one.verdict == "not identifiable":
        others = f"; it may be: {said}" if said else ""
        return f"{one.channel}: a lag is not identifiable from these flights: {one.why}{others}"
    return f"{one.channel}: {one.verdict}: {said}"


def _said(cause: FlightCause) -> str:
    first, *others = (
        f"{p.value:.3g} ± {p.standard_uncertainty:.2g} {p.unit}".removesuffix(" 1") for p in cause.parameters
    )
    words = [p.parameter.words for p in cause.parameters[1:]]
    numbers = ", ".join([first, *(f"{name} {number}" for name, number in zip(words, others, strict=True))])
    names = " or ".join(name.replace("_", " ") for name in cause.law.causes)
    if cause.law.key == "lag_in_the_cold":
        names = "a lag that grows in the cold"
    elif cause.law.key == "second_path":
        names = f"a second path ({names})"
    elif cause.law.key == "film_unlike_in_descent":
        names = f"a film that is not as warm as the bead in descent ({names})"
    return f"{names} ({numbers}; probability {cause.probability:.2f})"
