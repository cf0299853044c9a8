"""The method causal of `correct`: a flight's rows through the causal corrector one by one, as on board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.causal import Corrector, Row, Value
from shockrig.analysis.flight.causal_design import ChannelDesign, Design, design_of
from shockrig.analysis.flight.profile_doubts import profile_doubts
from shockrig.analysis.flight.profile_effects import not_undone
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile

Array = NDArray[np.float64]
LONGEST_LAG_S = 60.0  # longer is what the smoother is for
MOST_WAITING = 600  # rows


def causal(
    flight: Flight,
    profile: Profile,
    lag_s: float = 0.0,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
) -> Corrected:
    """Correct a flight row by row, each with what came before and in the `lag_s` after it.

    Raises
    ------
    InputError
        Fewer than two rows with times that run forward, a wait that is too long, or a readout that cannot be tabulated.
    """
    time_s = flight.time_s
    known = time_s[np.isfinite(time_s)]
    if known.size < 2 or not np.any(np.diff(known) > 0):
        raise InputError("time_s: fewer than two rows with times that run forward; give a log with a clock in seconds")
    period = typical_period(known)
    if not 0.0 <= lag_s <= LONGEST_LAG_S or lag_s > MOST_WAITING * period:
        longest = min(LONGEST_LAG_S, MOST_WAITING * period)
        raise InputError(f"a lag of {lag_s:g} s: expected 0 to {longest:g} s; more is what the smoother is for")
    design = design_of(profile, period, temperature_noise_k, humidity_noise_percent)
    if not np.isfinite(flight.temperature_c).any():
        design = replace(design, humidity=None)  # what is not known to be vapour is given as it came
    corrector = Corrector(design, lag_s)
    given: list[tuple[Value, Value]] = []
    for row in rows_of(flight):
        given += corrector.step(row)
    given += corrector.flush()
    return gathered(given, design, lag_s, _notes(profile, design, given, flight))


def rows_of(flight: Flight) -> list[Row]:
    """A flight's rows as the corrector takes them."""
    columns = (
        flight.time_s,
        flight.temperature_c,
        flight.humidity_percent,
        flight.airspeed_m_s,
        flight.pressure_hpa,
        flight.die_temperature_c,
    )
    return [Row(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]


def gathered(given: list[tuple[Value, Value]], design: Design, lag_s: float, notes: list[str]) -> Corrected:
    """Values row by row as a corrected flight."""
    bead, film = ([pair[place] for pair in given] for place in (0, 1))

    def of(values: list[Value], one: Callable[[Value], float]) -> Array:
        return np.array([one(value) for value in values], dtype=float)

    def said(one: Callable[[Value], bool]) -> NDArray[np.bool_]:
        return np.array([any(one(value) for value in pair) for pair in given], dtype=bool)

    flags = {name: np.zeros(len(given), dtype=bool) for name in FLAGS}
    present = [i for i, values in enumerate((bead, film)) if any(not v.judged.missing for v in values)]
    given = [tuple(pair[i] for i in present) for pair in given]  # type: ignore[misc]
    flags["gap"] = said(lambda v: v.judged.missing)
    flags["repeated"] = said(lambda v: v.judged.repeated)
    flags["implausible"] = said(lambda v: v.judged.implausible)
    flags["outside_profile"] = said(lambda v: v.outside)
    as_read = [np.array([v.as_read and np.isfinite(v.value) for v in values], dtype=bool) for values in (bead, film)]
    corrected = [
        np.array([not v.as_read and np.isfinite(v.value) for v in values], dtype=bool) for values in (bead, film)
    ]
    all_read = np.logical_or(*as_read) & ~np.logical_or(*corrected)
    flags["not_corrected"] = all_read
    for name, read in zip(("temperature", "humidity"), as_read, strict=True):
        flags[f"{name}_not_corrected"] = read & ~all_read
    channels: tuple[tuple[str, ChannelDesign | None], ...] = (
        ("temperature", design.temperature),
        ("humidity", design.humidity),
    )
    return Corrected(
        of(bead, lambda v: v.value),
        of(bead, lambda v: v.uncertainty),
        of(film, lambda v: v.value),
        of(film, lambda v: v.uncertainty),
        flags,
        tuple(notes),
        {name: None for name, _ in channels},
        {"temperature": of(bead, lambda v: v.common), "humidity": of(film, lambda v: v.common)},
        {name: float(np.pi / one.resolved_rate[0]) for name, one in channels if one is not None},
    )


def _notes(profile: Profile, design: Design, given: list[tuple[Value, Value]], flight: Flight) -> list[str]:
    notes = profile_doubts(profile)
    for name, part in (("temperature", profile.temperature), ("humidity", profile.humidity)):
        if part is None:
            notes.append(f"{name}: given as it came: the profile has no {name} part")
        else:
            notes += not_undone(part.effects, name, part.discovered)
    if profile.humidity is not None and design.humidity is None and np.isfinite(flight.humidity_percent).any():
        notes.append("humidity: given as it came: no temperature of the air in the log")
    for one, name in ((design.temperature, "temperature"), (design.humidity, "humidity")):
        if one is not None and one.unsure_of_airspeed and not np.isfinite(flight.airspeed_m_s).any():
            notes.append(f"no airspeed in the log: {name} taken at 5 m/s")
    if design.die_share and not np.isfinite(flight.die_temperature_c).any():
        notes.append("humidity: the profile asks for the die's temperature and the log has none; the air's is taken")
    for place, name in ((0, "temperature"), (1, "humidity")):
        count = sum(pair[place].outside for pair in given)
        if count:
            notes.append(f"{name}: {counted(count, 'row')} outside the profile's table, given as they came")
    return notes
