"""What a diagnosis means in flight: an inversion crossed with the extended sensor as truth, corrected either way, and
drawn.

Dry adiabatic below, an inversion of 5 K over 40 m crossed at 5 m/s, vapour halved above it (analysis.flight.weather).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import as_listed
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.judging import rmse
from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import FLOWN_EFFECTS, fly_many
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.analysis.report.fitted import UNIT
from shockrig.analysis.report.panels import panels
from shockrig.files.errors import InputError
from shockrig.files.figures import BLUE, GREY, INK, ORANGE, RED, styled
from shockrig.files.numbers import plain as written
from shockrig.files.profile import HumidityProfile, Profile, TemperatureProfile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
COLUMN = {"temperature": "temperature_c", "humidity": "humidity_percent"}
BELOW_K, ABOVE_K = 3.5, 3.5  # the scene's temperatures about that of the surface
FLIGHTS_SHOWN = 3
MOST_T63_S = 60.0  # a slower sensor sees nothing of a layer that is crossed in seconds


@dataclass(frozen=True)
class Crossing:
    """One channel of the crossing: series of the first flight, and rms errors against the air over all flights."""

    channel: str
    time_s: Array
    air: Array
    reading: Array
    plain: Array
    extended: Array
    rms_reading: float
    rms_plain: float
    rms_extended: float


def cross_inversion(plain: Profile, extended: Profile, seed: int = 0) -> tuple[list[Crossing], list[str]]:
    """Fly and correct; returns the channels that could be, and what has to be said of the others.

    Raises nothing for a profile that cannot fly: the reason is among the notes.
    """
    notes: list[str] = []
    truth, surface_c = _flyable(extended, plain, notes)
    if truth is None:
        return [], notes
    seeds = [seed + i for i in range(FLIGHTS_SHOWN)]
    options = {"surface_temperature_c": surface_c, "turbulence_k": 0.05, "turbulence_percent": 0.3}
    weathers = [inversion(np.random.default_rng([s, 7]), **options) for s in seeds]
    try:
        flights = fly_many(weathers, truth, seeds)
        corrected = [
            [correct(to_flight(flown.log), profile) for flown in flights] for profile in (_alike(plain, truth), truth)
        ]
    except InputError as error:
        return [], [*notes, f"The inversion could not be flown: {error}."]
    crossings = []
    for channel, column in COLUMN.items():
        if getattr(truth, channel) is None:
            continue
        air = [f.truth[column].to_numpy() for f in flights]
        reading = [f.log[column].to_numpy(dtype=float) for f in flights]
        both = [[getattr(c, column) for c in side] for side in corrected]
        errors = [rmse(np.concatenate(series), np.concatenate(air)) for series in (reading, *both)]
        time = flights[0].truth["time_s"].to_numpy()
        crossings.append(Crossing(channel, time, air[0], reading[0], both[0][0], both[1][0], *errors))
    return crossings, notes


def _flyable(extended: Profile, plain: Profile, notes: list[str]) -> tuple[Profile | None, float]:
    """The extended profile with what belongs to the sensor and can be flown, and a surface temperature it covers."""
    parts = {}
    for channel in COLUMN:
        part = getattr(extended, channel)
        if part is None or getattr(plain, channel) is None:
            continue
        if _too_slow(part):
            notes.append(f"The {channel} sensor takes more than {MOST_T63_S:g} s to 63 % of a step: it is not flown.")
            continue
        flown = tuple(e for e in part.effects if _flies(e.effect, channel))
        grounded = [e.effect for e in part.effects if e not in flown]
        if grounded:
            notes.append(f"Left on the bench: {', '.join(grounded)} ({channel}).")
        listed = {named.effect: named for one in part.discovered if (named := as_listed(one)) is not None}
        listed = {e: named for e, named in listed.items() if e not in {known.effect for known in flown}}
        flown = (*flown, *listed.values())
        if len(part.discovered) > len(listed):
            what, left, rest = ("Not all that", "", "the rest") if listed else ("What", "not ", "it")
            described = f"{what} was described of the {channel} sensor"
            notes.append(f"{described} is {left}simulated here, so the crossing is without {rest}.")
        parts[channel] = replace(part, effects=flown, discovered=())
    surface_c = 20.0
    if "humidity" in parts:
        ranges = [p.humidity.temperature_range_c for p in (extended, plain) if p.humidity is not None]
        low, high = max(r[0] for r in ranges) + BELOW_K, min(r[1] for r in ranges) - ABOVE_K
        if low > high:
            notes.append("The campaign's ambients span too little for the humidity channel to be flown.")
            del parts["humidity"]
        else:
            surface_c = float(np.clip(surface_c, low, high))
    if not parts:
        return None, surface_c
    return Profile(parts.get("temperature"), parts.get("humidity"), extended.sensors), surface_c


def _too_slow(part: TemperatureProfile | HumidityProfile) -> bool:
    rows = part.diffusivity_table if isinstance(part, HumidityProfile) else (part,)
    times = [row.response_time_s for row in rows if row.response_time_s is not None]
    return any(time.t63_s > MOST_T63_S for time in times)


def _flies(effect: str, channel: str) -> bool:
    """Whether an effect leaves the bench with the sensor and the simulator has an equation for it."""
    entry = CATALOGUE.get(effect)
    return entry is not None and entry.in_flight is not None and effect in FLOWN_EFFECTS[channel]


def _alike(plain: Profile, truth: Profile) -> Profile:
    """The plain profile with the channels that are flown."""
    return replace(
        plain,
        temperature=plain.temperature if truth.temperature is not None else None,
        humidity=plain.humidity if truth.humidity is not None else None,
    )


AXIS = {"temperature": "temperature, °C", "humidity": "relative humidity, %"}
WINDOW_S = (-10.0, 40.0)  # about the instant at which the air changes fastest


@styled
def crossing_figure(crossings: Sequence[Crossing]) -> Figure:
    """The air, the reading and both corrections about the inversion, and the corrections' errors below."""
    size_in = 4.9 * len(crossings), 4.8
    figure, axes_of = panels((2, len(crossings)), size_in, top_in=0.06, across_in=0.78, heights=(1.5, 1), sharex=True)
    for (above, below), c in zip(axes_of.T, crossings, strict=True):
        smooth = np.convolve(c.air, np.ones(21) / 21, mode="same")
        inner = slice(30, -30)
        middle = c.time_s[inner][int(np.argmax(np.abs(np.gradient(smooth)[inner])))]
        shown = (c.time_s > middle + WINDOW_S[0]) & (c.time_s < middle + WINDOW_S[1])
        time = c.time_s[shown]
        above.plot(time, c.reading[shown], color=ORANGE, linewidth=1.0, label="reading")
        above.plot(time, c.plain[shown], color=RED, linewidth=1.1, label="corrected, plain profile")
        above.plot(time, c.extended[shown], color=BLUE, linewidth=1.3, label="corrected, extended profile")
        above.plot(time, c.air[shown], color=INK, linewidth=0.8, linestyle="--", label="air")
        below.axhline(0.0, color=GREY, linewidth=0.7)
        sides = (("plain", RED, c.rms_plain), ("extended", BLUE, c.rms_extended))
        for side, colour, rms in sides:
            error = getattr(c, side) - c.air
            label = f"{side}: {written(rms, 2)} {UNIT[c.channel]} rms"
            below.plot(time, error[shown], color=colour, linewidth=0.9, label=label)
        above.set_ylabel(AXIS[c.channel])
        below.set_ylabel(f"error, {UNIT[c.channel]}")
        below.set_xlabel("time of the flight, s")
        below.legend(loc="upper right")
    axes_of[0, 0].legend(loc="best")
    return figure
