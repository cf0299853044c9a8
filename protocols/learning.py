"""Flights to what they say of their sensor: read, learned, and as the files that `shockrig learn` writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.flight_rows import unrecognised
from shockrig.files.learned import (
    GainOnNextFlight,
    LearnedChannel,
    LearnedFile,
    PassesApart,
    StatedBeside,
    StatedFlight,
    StatedLaw,
    StatedModel,
    StatedNumber,
    StatedPosition,
)

if TYPE_CHECKING:
    from shockrig.analysis.learn.learn import ChannelLearned, FlightCause, FlightsLearned
    from shockrig.analysis.learn.pair import ChannelApart, PairLearned
    from shockrig.files.profile import Profile

CHANNELS = ("temperature", "humidity")
TRACK_STEP_S = 1.0  # of tracks that are laid over one another
OWN_PRESSURE_M = 0.1  # an altitude that is so near to the pressure's was made of it: a satellite's wanders by more
RISES_OVER_S, SHIFT_STEPS = 30.0, 8  # differences of altitude whose shift is found, and steps to find it
UNLIKE_TRACKS = 0.05  # of the range of altitudes: two logs of one flight are nearer


def named_flights(
    paths: Sequence[Path], columns: Mapping[str, str] | None = None, map_path: Path | None = None
) -> tuple[dict[str, Flight], list[str]]:
    """Flights by their files' names, and what was read as what.

    Raises
    ------
    InputError
        A log cannot be read, or is named twice.
    """
    from shockrig.protocols.flight_logs import named_both, read_log

    flights: dict[str, Flight] = {}
    said: list[str] = []
    for path in paths:
        name = path.name if path.name not in flights else str(path)
        if name in flights:
            raise InputError(f"{path}: named twice; each flight counts once")
        flight, notes = read_log(path, columns, map_path)
        flights[name], more = checked(name, flight, named_both(columns, map_path))
        said += [f"{name}: {note}" for note in (*notes, *more)]
    return flights, said


def checked(name: str, flight: Flight, named: bool = False) -> tuple[Flight, list[str]]:
    """A flight to learn from, looked over as `correct` does: without codes for no value, with an altitude; and what is
    to be said of it. `named`: a person says which of its columns is which.

    Raises
    ------
    InputError
        Its clock is not in seconds, or its columns stand in one another's place: whatever it said would not hold.
    """
    from shockrig.analysis.flight.correct import in_order
    from shockrig.analysis.flight.doubts import doubts, in_air, slips
    from shockrig.analysis.flight.late_rows import taken_by_time
    from shockrig.analysis.flight.screen import code_notes, without_codes

    flight, _, late = taken_by_time(flight)
    flight, codes = without_codes(flight)
    said = [*late, *code_notes(codes)]
    try:
        part, rows, steps = in_order(flight)
    except InputError as error:
        return flight, [*said, str(error)]
    if wrong := slips(part, named=named):
        raise InputError(f"{name}: {'; '.join(wrong)}")
    for channel, values in (("temperature", flight.temperature_c), ("humidity", flight.humidity_percent)):
        if not np.isfinite(values).any():
            said.append(unrecognised(channel))
    heard = doubts(flight.at(rows))
    flight, more = with_altitude(in_air(flight))
    return flight, [*said, *heard, *steps, *more]


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

    return learn(flights, _stated(flights, bench), progress)


def _stated(flights: Mapping[str, Flight], bench: Profile | None) -> dict[str, tuple[float, float]] | None:
    """What a bench has found, at the temperatures of the flights."""
    from shockrig.analysis.learn.learned_profile import stated_by

    if bench is None:
        return None
    temperatures = np.concatenate([one.temperature_c for one in flights.values()])
    known = temperatures[np.isfinite(temperatures)]
    return stated_by(bench, float(np.median(known)) if known.size else 20.0)


@dataclass(frozen=True)
class FlightsBeside:
    """Flights of a second sensor in the same air, by the first's names and on its clock, and of which channels."""

    flights: Mapping[str, Flight]
    channels: tuple[str, ...]
    said: tuple[str, ...] = ()


def beside_flights(
    given: Sequence[str],
    paths: Sequence[Path],
    flights: Mapping[str, Flight],
    columns: Mapping[str, str] | None = None,
    map_path: Path | None = None,
) -> FlightsBeside:
    """A second sensor's flights: by its columns in the same logs (temperature=NAME, humidity=NAME), or by its own logs.

    Raises
    ------
    InputError
        A log cannot be read or is of another flight; there are more or fewer than of the first sensor.
    """
    named = {quantity: name for quantity, equals, name in (one.partition("=") for one in given) if equals}
    if named and set(named) <= set(CHANNELS) and len(named) == len(given):
        second, _ = named_flights(paths, {**(columns or {}), **named}, map_path)
        return of_columns(second, tuple(named))
    logs = [Path(one) for one in given]
    if len(logs) != len(flights):
        raise InputError(
            f"--beside: {len(logs)} logs beside {len(flights)} flights; give one for each flight in the same order, or "
            "temperature=NAME and humidity=NAME of columns in the same logs"
        )
    second, said = named_flights(logs, columns, map_path)
    return of_logs(flights, second, tuple(said))


def of_columns(second: Mapping[str, Flight], channels: tuple[str, ...]) -> FlightsBeside:
    """A second sensor in the same logs. What it has no column of is not its own: the bead beside a second film stays,
    whose temperature it tells, and a film beside a second bead goes."""
    if "humidity" not in channels:
        second = {n: replace(f, humidity_percent=np.full(f.time_s.size, np.nan)) for n, f in second.items()}
    return FlightsBeside(second, channels)


def of_logs(first: Mapping[str, Flight], second: Mapping[str, Flight], said: tuple[str, ...] = ()) -> FlightsBeside:
    """A second sensor's own logs, one for each of the first's in the same order."""
    pairs = zip(first.items(), second.items(), strict=True)
    flights = {name: on_clock_of(name, one, other, log) for (name, one), (other, log) in pairs}
    return FlightsBeside(flights, CHANNELS, said)


def on_clock_of(name: str, first: Flight, other: str, second: Flight) -> Flight:
    """A second log of one flight on the first's clock: moved in time until both have one track.

    A log whose track is less than the time between its rows, or the first's, away from the first's track is on its
    clock as it is: tracks are known no better, and what moves them apart by less is how each logger takes its altitude.

    Raises
    ------
    InputError
        The tracks are not alike: the logs are of two flights.
    """
    from shockrig.analysis.learn.bins import flown_span

    tracks, rows_s = [], 0.0
    for one in (first, second):
        assert one.altitude_m is not None
        known = np.isfinite(one.altitude_m) & np.isfinite(one.time_s)
        at, rows = np.unique(one.time_s[known], return_index=True)
        if at.size < 2:
            raise InputError(f"{name} beside {other}: a log has no altitude, so its clock cannot be set; give both one")
        rows_s = max(rows_s, float(np.median(np.diff(at))))
        even = np.arange(at[0], at[-1], TRACK_STEP_S)
        tracks.append((even, np.interp(even, at, one.altitude_m[known][rows])))
    (at, metres), (own, theirs) = tracks
    # Of the second's track what is flown: minutes on the ground are alike at any time.
    begins, ends = flown_span(own, theirs)
    kept = (own >= begins) & (own <= ends)
    own, theirs = own[kept], theirs[kept]
    room = own.size // 2
    padded = np.pad(metres, room, mode="edge")
    apart = [float(np.std(padded[i : i + own.size] - theirs)) for i in range(max(padded.size - own.size, 1))]
    best = min(apart), at[0] + (int(np.argmin(apart)) - room) * TRACK_STEP_S - own[0]
    here = np.interp(own + best[1], at, metres)
    climb, off = np.gradient(theirs, own), theirs - here - np.mean(theirs - here)
    if best[0] > UNLIKE_TRACKS * float(np.ptp(metres)):
        raise InputError(
            f"{name} beside {other}: their altitudes are {best[0]:.0f} m apart at best, as no two sensors of one "
            "carrier are; give logs of the same flight in the same order"
        )
    late = float(climb @ off / max(float(climb @ climb), 1e-12))  # s that the second's track is still ahead
    shift_s = best[1] + late
    return second if abs(shift_s) < rows_s else replace(second, time_s=second.time_s + shift_s)


def pair_from(
    flights: Mapping[str, Flight],
    beside: FlightsBeside,
    bench: Profile | None = None,
    progress: Callable[[str], None] = lambda said: None,
) -> PairLearned:
    """What flights say of two sensors side by side; `bench` is the first's profile."""
    from shockrig.analysis.learn.pair import learn_pair

    return learn_pair(flights, beside.flights, beside.channels, _stated(flights, bench), progress)


def differ(channel: str, apart: ChannelApart) -> str:
    """How two sensors differ, in a sentence."""
    unit = "K" if channel == "temperature" else "%RH"
    said = f"{channel}: the second reads {apart.offset.value:+.2g} ± {apart.offset.standard_uncertainty:.2g} {unit}"
    if apart.lag_ratio is None:
        return f"{said}; a lag of both does not show"
    ratio, sigma = apart.lag_ratio
    return f"{said}, and its time constant is {ratio:.2g} ± {sigma:.2g} times the first's"


def learned_file(
    learned: FlightsLearned,
    flights: Mapping[str, Flight],
    provenance: Mapping[str, Any],
    pair: PairLearned | None = None,
) -> LearnedFile:
    """What `learned.json` holds; of a sensor beside another, also how the two differ."""
    beside = {}
    if pair is not None:
        alone = pair.alone[0 if learned is pair.together[0] else 1]
        beside = {name: _beside(one, alone.channels[name]) for name, one in pair.apart.items()}
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
        beside=beside,
        provenance=provenance,
    )


def _beside(apart: ChannelApart, alone: ChannelLearned) -> StatedBeside:
    offset, ratio = apart.offset, apart.lag_ratio
    return StatedBeside(
        StatedNumber(offset.value, offset.standard_uncertainty, offset.unit),
        None if ratio is None else StatedNumber(*ratio, "1"),
        alone.verdict,
        tuple(_cause(cause) for cause in alone.causes),
    )


def shift_by_pressure(flight: Flight) -> float | None:
    """By how many seconds a log's altitude is behind its own pressure [s]; None where it has not both,
    or where the altitude is the pressure's own.

    The least-squares shift of the pressure's altitude, differences over half a minute, by Gauss and Newton.
    """
    if flight.altitude_m is None:
        return None
    by_pressure = pressure_altitude_m(flight.pressure_hpa)
    known = np.isfinite(flight.time_s) & np.isfinite(flight.altitude_m) & np.isfinite(by_pressure)
    at, rows = np.unique(flight.time_s[known], return_index=True)
    if at.size < 2 or np.ptp(at) < 4.0 * RISES_OVER_S:
        return None
    even = np.arange(at[0], at[-1], TRACK_STEP_S)
    step = round(RISES_OVER_S / TRACK_STEP_S)
    altitude = np.interp(even, at, flight.altitude_m[known][rows])
    rises, shift = altitude[step:] - altitude[:-step], 0.0
    for _ in range(SHIFT_STEPS):
        moved = np.interp(even - shift, at, by_pressure[known][rows])
        own = moved[step:] - moved[:-step]
        slope = -np.gradient(own, TRACK_STEP_S)
        columns = np.column_stack([slope, own])  # metres of a standard atmosphere may be a few percent too short
        shift += float(np.linalg.lstsq(columns, rises - own, rcond=None)[0][0])
    if float(np.std(rises - own)) < OWN_PRESSURE_M:
        return None
    return shift if abs(shift) < 0.25 * float(np.ptp(at)) else None


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
        f"{name} by {off.mean:+.2g} {unit} on average and {off.spread:.2g} {unit} about it"
        if np.isfinite(off.mean)
        else f"{name} in no layer that can be compared"
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
    """A channel's verdict in a sentence: what the likeliest model has at once, and what may be in place of it."""
    both, instead = one.together(one.causes)
    said = ", or ".join([part for part in (" and ".join(map(_said, both)), *map(_said, instead)) if part])
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
