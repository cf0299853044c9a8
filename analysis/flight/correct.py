"""A flight corrected: screening, readout undone, one of four methods, uncertainty, and an honest word where it fails.

Temperature first; humidity then goes from %RH to vapour pressure with the temperature that the film has, through the
method, and back with the air's corrected temperature; D follows that temperature sample by sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.causal import causal
from shockrig.analysis.flight.comparisons import Told, compared, late_die, seen_by_film, slow_against_fast, told
from shockrig.analysis.flight.doubts import airspeed_doubt, airspeed_notes, doubts, in_air, profile_doubts, slips
from shockrig.analysis.flight.flight_channel import (
    FlightChannel,
    FlightReadings,
    coarse,
    held,
    judged,
    lacking,
    own_changes,
    possible_air,
    too_few,
    untouched,
    with_own_steps,
)
from shockrig.analysis.flight.humidity_channel import AIR_PERCENT, correct_humidity, felt_by_film
from shockrig.analysis.flight.inverse import exact_inverse, paper
from shockrig.analysis.flight.late_rows import taken_by_time
from shockrig.analysis.flight.response import bead_response, unsure_of_airspeed
from shockrig.analysis.flight.screen import DEGF, EXCHANGED, UNSURE, Screened, code_notes, screen, without_codes
from shockrig.analysis.flight.screen import clock as put_in_order
from shockrig.analysis.flight.smooth_channel import LONGEST_BRIDGE_S, Estimate, estimate, typical_period
from shockrig.analysis.flight.stretches import felt_jumps, largest_share
from shockrig.analysis.flight.undo_readout import (
    Acting,
    acting,
    carried,
    ceiling,
    climb_m_s,
    climb_unknown,
    noise_floor,
    not_known,
    not_undone,
    of_airspeed,
    of_pressure,
    stale,
    undone,
    unseen,
)
from shockrig.analysis.flight.unread import where_felt
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, REFERENCE_C, Stream
from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.numbers import counted, moment, short
from shockrig.files.profile import Profile
from shockrig.files.profile_data import NOISE_K, NOISE_PERCENT
from shockrig.files.ranges import LIKELY_RANGES, RANGES

Array = NDArray[np.float64]
PARTED_S = 2.0 * LONGEST_BRIDGE_S
MOST_STEPS = 3  # of a clock, that are said one by one
Dependence = Callable[[Sequence[Acting], float], list[str]]


def _smoother(readings: FlightReadings, cutoff_hz: float | None = None) -> Estimate:
    return estimate(
        readings.time_s,
        readings.reading,
        readings.usable,
        readings.response,
        readings.noise_variance,
        readings.delay_s,
        readings.passing,
        readings.rounding,
        readings.jumped_s,
        readings.loud,
        readings.stepped,
    )


METHODS: dict[str, Callable[[FlightReadings, float | None], Estimate]] = {
    "smoother": _smoother,
    "inverse": exact_inverse,
    "paper": paper,
}


def correct(
    flight: Flight,
    profile: Profile,
    method: str = "smoother",
    *,
    cutoff_hz: float | None = None,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
    lag_s: float | None = None,
    named: bool = False,
) -> Corrected:
    """Correct a flight.

    Parameters
    ----------
    flight : Flight
    profile : Profile
        A channel that it lacks is given as it came and flagged `not_corrected`. Its sensors may have any body and any
        effects: what they mean in a flight is the catalogue's.
    method : one of METHODS, or "causal"
    cutoff_hz : float, optional
        Of the two inverses' low-pass; suggested from the noise floor when left out. The smoother needs none.
    temperature_noise_k, humidity_noise_percent : float, optional
        Noise floors where they differ from the profile's.
    lag_s : float, optional
        Of "causal": how long each row may wait for those after it; not at all when left out.
    named : bool
        A person says which column is which, however it looks.

    Returns
    -------
    Corrected
        Air and standard uncertainties, flags, and notes on what was left alone.

    Raises
    ------
    InputError
        Unknown method, no usable row, an effect without one of its parameters; RefusedError where an inverse is not
        stable.
    """
    noise = temperature_noise_k, humidity_noise_percent
    if method == "causal":
        return correct_read(flight, (), profile, method, cutoff_hz, *noise, lag_s)
    by_time, order, said = taken_by_time(flight)
    read, codes = of_both_columns(by_time, profile, named)
    said = [*said, *code_notes(codes)]
    found = correct_read(read, said, profile, method, cutoff_hz, *noise, lag_s, codes.get(UNSURE), named)
    return found if order is None else found.at(np.argsort(order))


def of_both_columns(
    flight: Flight, profile: Profile, named: bool = False
) -> tuple[Flight, dict[str, NDArray[np.bool_]]]:
    """The flight `without_codes`, and the rows (n,) of these; with its columns as they came where they seem to stand in
    one another's place throughout, unless a person `named` them: what is told of a part of them there is told of the
    other quantity."""
    read, codes = without_codes(flight)
    told = codes.keys() & {EXCHANGED, DEGF}
    if told and slips(in_order(read)[0], profile, named):
        known = np.isfinite(np.stack([read.temperature_c, read.humidity_percent]))
        known = np.where(codes.get(EXCHANGED, False), known[::-1], known)
        came = np.where(known, np.stack([flight.temperature_c, flight.humidity_percent]), np.nan)
        as_it_came = replace(read, temperature_c=came[0], humidity_percent=came[1])
        return as_it_came, {name: rows for name, rows in codes.items() if name not in told}
    return read, codes


def correct_read(
    flight: Flight,
    said: Sequence[str],
    profile: Profile,
    method: str,
    cutoff_hz: float | None,
    temperature_noise_k: float | None,
    humidity_noise_percent: float | None,
    lag_s: float | None,
    unsure: NDArray[np.bool_] | None = None,
    named: bool = False,
) -> Corrected:
    """What `correct` does with a flight that is `without_codes` by now; what is `said` of these is among the notes, and
    no value is filled in over rows (n,) of which it is `unsure` what was read: what they hold may refute it."""
    if method == "causal":
        return causal(flight, profile, lag_s or 0.0, temperature_noise_k, humidity_noise_percent)
    if method not in METHODS:
        raise InputError(f"method {method!r}: expected one of {', '.join([*METHODS, 'causal'])}")
    count = flight.time_s.size
    part, rows, steps = in_order(flight)
    # what is said of times is said in the log's own, whatever they were put in order to
    as_logged = flight.at(rows)
    notes = [*profile_doubts(profile), *said, *doubts(as_logged), *airspeed_notes(part), *steps]
    if wrong := slips(part, profile, named):
        bead, film = _as_it_came(part, "; ".join(wrong), notes)
        return _gather(count, rows, bead, film, notes, {}, {})
    part = in_air(part)
    stream = _stream(part, profile, notes)

    def solve(readings: FlightReadings, cutoff_hz: float | None) -> Estimate:
        return METHODS[method](replace(readings, logged_s=as_logged.time_s), cutoff_hz)

    around = _temperature(part, profile, stream, solve, cutoff_hz, temperature_noise_k, notes)
    bead = around.in_free_air(part.time_s)
    film, known, said = _humidity(part, profile, stream, around, bead, solve, cutoff_hz, humidity_noise_percent)
    notes.extend(said)
    bead, film = seen_by_film(part, bead, film, notes, as_logged.time_s)
    if unsure is not None:
        bead, film = (one.given_nowhere(unsure[rows]) for one in (bead, film))
    bead, film = (one.as_it_changed(as_logged.time_s, notes) for one in (bead, film))
    bead, film, widened = compared(part, bead, film, notes, known)
    # what widened them knows of no bounds
    bead, film = bead.within(RANGES["temperature_c"]), film.within(AIR_PERCENT)
    slow_against_fast(part, bead, notes)
    slower = {} if known is None else {film.name: known.slower}
    return _gather(count, rows, bead, film, notes, widened, slower)


def in_order(flight: Flight) -> tuple[Flight, NDArray[np.int64], list[str]]:
    """The flight's rows whose time can be believed, their times running forward; which they are; and a sentence for
    each step of the clock."""
    # a slow sensor hardly shows time that was left out, where it was carried on shows it at once
    where = [flight.pressure_hpa, *([] if flight.altitude_m is None else [flight.altitude_m])]
    clock = put_in_order(flight.time_s, PARTED_S, (flight.temperature_c, flight.humidity_percent, *where))
    if np.count_nonzero(clock.good) < 2 or np.ptp(flight.time_s[clock.good]) == 0:
        ahead = np.diff(flight.time_s[np.isfinite(flight.time_s)])
        if ahead.size and np.median(ahead) < 0:
            raise InputError("time_s: the rows run backwards in time; turn the log round, oldest row first")
        raise InputError("time_s: fewer than two rows with times that run forward; give a log with a clock in seconds")
    rows = np.flatnonzero(clock.good)
    steps: list[str] = []
    for runs_on, what in (
        (True, "the readings run on, it was set"),
        (False, "a gap, across which nothing is concluded"),
    ):
        alike = [(step.by_s, moment(flight.time_s[step.row])) for step in clock.steps if step.runs_on == runs_on]
        signed = [("+" * (by_s > 0) + short(by_s, 4), at) for by_s, at in alike[:MOST_STEPS]]
        steps += [f"the clock steps by {by_s} s to {at}: {what}" for by_s, at in signed]
        if others := alike[MOST_STEPS:]:
            steps.append(f"the clock steps {counted(len(others), 'more time')} like that, the last to {others[-1][1]}")
    return replace(flight.at(rows), time_s=clock.time_s), rows, steps


def _as_it_came(flight: Flight, why: str, notes: list[str]) -> tuple[FlightChannel, FlightChannel]:
    """Both channels without a correction, and without an uncertainty: none would hold."""
    time_s, bead, film = flight.time_s, flight.temperature_c, flight.humidity_percent
    of_bead = screen(time_s, bead, RANGES["temperature_c"], NOISE_K)
    of_film = screen(time_s, film, RANGES["humidity_reading_percent"], NOISE_PERCENT)
    return untouched("temperature", bead, of_bead, why, notes), untouched("humidity", film, of_film, why, notes)


def _stream(flight: Flight, profile: Profile, notes: list[str]) -> Stream:
    """Airspeed, pressure and temperature of each row; where one is not known, as between the rows around it, and 5 m/s,
    1013 hPa and 20 degC where there is none at all.
    """

    def bridged(values: Array, known: NDArray[np.bool_], usual: float, said: str, of: Dependence) -> Array:
        if known.any():
            return np.interp(flight.time_s, flight.time_s[known], values[known])
        used: list[str] = []
        if (t := profile.temperature) is not None:
            used += of(acting(t.effects, "temperature", t.discovered), t.bead_radius_m)
        if (h := profile.humidity) is not None:
            used += of(acting(h.effects, "humidity", h.discovered), h.film_thickness_m)
        if used:
            notes.append(f"no {said.format(', '.join(sorted(used)), usual)}")
        return np.full(values.shape, usual)

    speed, pressure = flight.airspeed_m_s, flight.pressure_hpa
    flown = (speed >= RANGES["airflow_m_s"].low) & (speed <= RANGES["airflow_m_s"].high)
    speed = bridged(speed, flown, REFERENCE_AIRFLOW_M_S, "airspeed in the log: {} taken at {:g} m/s", of_airspeed)
    said = "pressure in the log: {} taken at {:.0f} hPa"
    pressure = bridged(pressure, np.isfinite(pressure), STANDARD_PRESSURE_HPA, said, of_pressure)
    air = possible_air(flight.temperature_c)
    return Stream(speed, pressure, bridged(air, np.isfinite(air), REFERENCE_C, "temperature", lambda _, length: []))


def _temperature(
    flight: Flight,
    profile: Profile,
    stream: Stream,
    solve: Callable[[FlightReadings, float | None], Estimate],
    cutoff_hz: float | None,
    given: float | None,
    notes: list[str],
) -> FlightChannel:
    part, body = profile.temperature, profile.bodies["imet"]
    raw, time_s = flight.temperature_c, flight.time_s
    effects = acting(part.effects, "temperature", part.discovered) if part else ()
    noise = given or NOISE_K
    if part is not None:
        own_noise = NOISE_K if part.noise_k is None else part.noise_k
        noise = noise_floor(effects, own_noise if given is None else given)
    period = typical_period(time_s)
    old = stale(effects, time_s, raw, period)
    response = None
    if part is not None:
        unsure = unsure_of_airspeed(partial(bead_response, part, body=body), stream, airspeed_doubt(flight))
        response = bead_response(part, stream, body).slower(0.0, unsure)
    share = 1.0 if response is None else largest_share(response, period)
    possible, swing = RANGES["temperature_c"], LIKELY_RANGES["swing_k"].high
    felt = felt_by_film(flight, profile.humidity)
    screened = screen(
        time_s, raw, possible, noise, limit=ceiling(effects), stale=old, share=share, swing=swing, felt=felt
    )
    if part is None or response is None or too_few(screened):
        why = lacking(part, "temperature", raw, possible)
        return untouched("temperature", raw, screened, why, notes)
    climb = climb_m_s(flight)
    notes.extend(not_undone(part.effects, "temperature", part.discovered, *[climb_unknown] * (climb is None)))
    plain = undone(effects, raw, stream, part.bead_radius_m, period)
    variance = (np.hypot(noise * screened.louder, screened.resolution / np.sqrt(12)) / plain.gain) ** 2
    steps = coarse(screened.resolution, noise, 1.0 / plain.gain)
    every = FlightReadings(
        "temperature",
        time_s,
        plain.reading,
        screened.usable,
        response,
        variance,
        plain.delay_s,
        rounding=steps,
        jumped_s=None if felt is None else felt_jumps(felt, time_s),
        loud=screened.loud,
    )
    more: Screened | None = screened
    while more is not None:
        screened, change = more, own_changes(raw, more, more)
        jumped = np.zeros(raw.shape) if change is None else change.offset / plain.gain
        stepped = np.broadcast_to(screened.own_steps != 0.0, raw.shape)
        readings = replace(every, reading=plain.reading - jumped, stepped=stepped)
        found = solve(readings, cutoff_hz)
        more = with_own_steps(screened, found, plain.gain)
    along = where_felt(readings, felt, found, lambda rest: solve(rest, cutoff_hz))
    if along is not found:
        found = along
        notes.append(
            "temperature: where it was not read, or in noise, for long, it goes along what the humidity shows of it at "
            "once, which explains its readings better than a line between them"
        )
    loud, read = screened.loud & screened.usable, np.count_nonzero(screened.usable)
    if np.count_nonzero(loud) > 0.5 * read:  # no burst any more
        times = short(float(np.median(np.broadcast_to(screened.louder, raw.shape)[loud])), 2)
        notes.append(
            f"temperature: {np.count_nonzero(loud)} of {read} readings go to and fro by some {times} times the noise "
            "that is stated, of which the humidity felt little: taken as noise; where the air went so, the "
            f"hygrometer's own temperature is late ({late_die()})"
        )
    everywhere = np.ones(raw.size)
    outside = unseen(part.discovered, stream.airflow_m_s, raw)
    channel = judged(readings, found, plain, screened, outside, raw - jumped, everywhere, notes)
    channel = held(channel, readings, raw - jumped, everywhere, notes, possible)
    channel = replace(channel, value=np.where(channel.raw, raw, channel.value + jumped), changed=change)
    channel = channel.within(possible)
    left = not_known(effects)
    channel = replace(channel, uncertainty=np.hypot(channel.uncertainty, left), common=np.hypot(channel.common, left))
    return replace(channel, carried=carried(effects, climb, flight.airspeed_m_s))


def _humidity(
    flight: Flight,
    profile: Profile,
    stream: Stream,
    around: FlightChannel,
    bead: FlightChannel,
    solve: Callable[[FlightReadings, float | None], Estimate],
    cutoff_hz: float | None,
    given: float | None,
) -> tuple[FlightChannel, Told | None, list[str]]:
    """The humidity in free air, what the flight tells of the film's time scale, and what was said on the way; `around`
    the sensors is the temperature, `bead`'s that of free air."""

    def with_scale(known: Told | None) -> tuple[FlightChannel, list[str]]:
        said: list[str] = []
        film = correct_humidity(
            flight, profile.humidity, profile.bodies["hyt"], stream, around, solve, cutoff_hz, given, said, known
        )
        return film.in_free_air(flight.time_s), said

    film, said = with_scale(None)
    if (known := told(flight, bead, film)) is not None:
        known = told(flight, bead, with_scale(known)[0], known)
        film, said = with_scale(known)
    return film, known, said


def _gather(
    count: int,
    rows: NDArray[np.int64],
    bead: FlightChannel,
    film: FlightChannel,
    notes: list[str],
    widened: dict[str, float],
    slower: dict[str, float],
) -> Corrected:
    def spread(values: Array) -> Array:
        out = np.full(count, np.nan)
        out[rows] = values
        return out

    flags = {name: np.zeros(count, dtype=bool) for name in FLAGS}
    stray = np.ones(count, dtype=bool)
    stray[rows] = False
    flags["implausible"] |= stray
    channels = [channel for channel in (bead, film) if not channel.screened.missing.all()]
    for channel in channels:
        s = channel.screened
        for name, mask in (
            ("gap", s.missing),
            ("repeated", s.repeated),
            ("implausible", s.implausible),
            ("outside_profile", channel.outside),
        ):
            flags[name][rows] |= mask
    # each by itself, or of all that is given: what is not the reading does not bear it
    given = [np.isfinite(channel.value) for channel in channels]
    as_read = [channel.raw & known for channel, known in zip(channels, given, strict=True)]
    all_read = (
        np.logical_or.reduce(as_read)
        & ~np.logical_or.reduce([known & ~read for known, read in zip(given, as_read, strict=True)])
        if channels
        else np.zeros(rows.size, dtype=bool)
    )
    flags["not_corrected"][rows] = all_read
    for channel, read in zip(channels, as_read, strict=True):
        flags[f"{channel.name}_not_corrected"][rows] = read & ~all_read
    return Corrected(
        spread(bead.value),
        spread(bead.total_uncertainty),
        spread(film.value),
        spread(film.total_uncertainty),
        flags,
        tuple(notes),
        {channel.name: channel.cutoff_hz for channel in (bead, film)},
        {channel.name: spread(channel.common_uncertainty) for channel in (bead, film)},
        {channel.name: float(np.pi / channel.resolved_rate) for channel in (bead, film)},
        widened,
        slower,
    )
