"""What in a log is no reading at all: codes for no value, and rows whose two columns stand in one another's place.

They are missing from here on, and are counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.files.flight import Flight
from shockrig.files.numbers import counted
from shockrig.files.ranges import LIKELY, RANGES
from shockrig.files.sentinels import coded

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_SHARE_OFF = 0.25  # of how far both columns go, that they are from the other's last values where they change place
WARM_C = 35.0  # few airs are flown in that are warmer
LEAST_SHARE_WARMER = 0.02  # of the rows of one kind of stretch, more than of the other, that are
SIDE_ROWS = 3  # rows on either side
LEAST_COLUMNS_APART = 2.0  # K or %RH; columns that are closer cannot be told from one another
PASCAL = "pressure_hpa: pascal"
EXCHANGED = "temperature and humidity, each in the other's place"
# quantity -> field of a flight, and what a reading of it can be
FIELDS = {
    "time": ("time_s", ""),
    "temperature": ("temperature_c", "temperature_c"),
    "humidity": ("humidity_percent", "humidity_reading_percent"),
    "die": ("die_temperature_c", "temperature_c"),
    "airspeed": ("airspeed_m_s", "airflow_m_s"),
    "pressure": ("pressure_hpa", "pressure_hpa"),
    "altitude": ("altitude_m", "altitude_m"),
    "latitude": ("latitude_deg", "latitude_deg"),
    "longitude": ("longitude_deg", "longitude_deg"),
}


def without_codes(flight: Flight) -> tuple[Flight, dict[str, Mask]]:
    """The flight with codes for no value missing, and the rows (n,) of each, by quantity and code."""
    found: dict[str, Mask] = {}
    changed = {}
    for quantity, (name, possible) in FIELDS.items():
        values = getattr(flight, name)
        if values is None:
            continue
        known = {**RANGES, **LIKELY}
        ends = (known[possible].low, known[possible].high) if possible else (-np.inf, np.inf)
        codes = coded(quantity, values, *ends)
        if codes:
            found |= {f"{quantity} {code:.6g}": rows for code, rows in codes.items()}
            changed[name] = np.where(np.logical_or.reduce(list(codes.values())), np.nan, values)
    flight = replace(flight, **changed)
    if (pascal := _in_pascal(flight.pressure_hpa)).any():
        found[PASCAL], flight = pascal, replace(flight, pressure_hpa=flight.pressure_hpa / 100.0)
    exchanged = _exchanged(flight.temperature_c, flight.humidity_percent)
    if exchanged.any():
        found[EXCHANGED] = exchanged
        blank = {
            name: np.where(exchanged, np.nan, getattr(flight, name)) for name in ("temperature_c", "humidity_percent")
        }
        flight = replace(flight, **blank)
    return flight, found


def _in_pascal(pressure: Array) -> Mask:
    """Rows (n,) with a pressure, where most of them can be none in hPa and all could be in Pa."""
    possible, known = RANGES["pressure_hpa"], np.isfinite(pressure)
    usual = float(np.median(pressure[known])) if known.any() else 0.0
    return known & (usual > possible.high) & possible.holds(usual / 100.0)


def _exchanged(temperature: Array, humidity: Array) -> Mask:
    """Rows (n,) in stretches that begin and end where each column goes on from the other: of both kinds of stretch the
    one with warmer rows than air mostly has, or else the one with fewer rows."""
    exchanged = np.zeros(temperature.shape, dtype=bool)
    # of what may be a reading of either
    can_be = RANGES["humidity_reading_percent"]
    both = np.stack([temperature, humidity])
    rows = np.flatnonzero(((both >= can_be.low) & (both <= can_be.high)).all(axis=0))
    if rows.size < 2 * SIDE_ROWS + 1:
        return exchanged
    either = (
        (SIDE_ROWS, SIDE_ROWS),
        (1, SIDE_ROWS),
        (SIDE_ROWS, 1),
    )  # something else may have changed in the row beside
    turns = np.logical_or.reduce([_turns(temperature[rows], humidity[rows], *sides) for sides in either])
    ends = np.flatnonzero(np.diff(np.concatenate([[0], turns.astype(int), [0]])))
    middle = (ends[::2] + ends[1::2] - 1) // 2  # a median turns for some rows
    odd = np.searchsorted(middle, np.arange(rows.size), side="right") % 2 == 1
    if middle.size == 1:
        odd = _from_one_end(temperature[rows], humidity[rows], int(middle[0]))
    elif odd.any():
        hot = temperature[rows] > WARM_C
        hotter = np.mean(hot[odd]) - np.mean(hot[~odd])
        fewer = np.count_nonzero(odd) <= rows.size / 2
        odd = odd if hotter > LEAST_SHARE_WARMER or (fewer and hotter > -LEAST_SHARE_WARMER) else ~odd
    if odd.any():
        # rows beside them in which one column is missing are of the kind that the other is like
        every = np.arange(temperature.size)
        wider = np.interp(every, rows, odd.astype(float))
        t, h = (np.interp(every, rows[~odd], v[rows[~odd]]) for v in (temperature, humidity))
        crossed = (np.abs(temperature - h) < np.abs(temperature - t)) | (np.abs(humidity - t) < np.abs(humidity - h))
        exchanged = (wider == 1.0) | ((wider > 0.0) & crossed)
    return exchanged


def _from_one_end(temperature: Array, humidity: Array, turn: int) -> Mask:
    """Rows (n,) of a stretch of which one end is seen: the other is where the columns meet, since nothing tells behind
    that which is which; of the two sides the one with warmer rows than air mostly has, or else the shorter one."""
    met = np.flatnonzero(np.abs(temperature - humidity) < LEAST_COLUMNS_APART)
    rows = np.arange(temperature.size)
    first, last = np.max(met[met < turn], initial=-1), np.min(met[met >= turn], initial=rows.size)
    before, after = (rows > first) & (rows < turn), (rows >= turn) & (rows < last)
    hot = temperature > WARM_C
    hotter = np.mean(hot[after]) - np.mean(hot[before]) if before.any() and after.any() else 0.0
    shorter = np.count_nonzero(after) <= np.count_nonzero(before)
    return after if hotter > LEAST_SHARE_WARMER or (shorter and hotter > -LEAST_SHARE_WARMER) else before


def _turns(temperature: Array, humidity: Array, before: int, behind: int) -> Mask:
    """Rows (n,) from which each column goes on from the other, by medians over some rows `before` and from there on:
    single readings may be noise, and where either goes fast, the two may cross."""

    def level(values: Array, size: int, first: int) -> tuple[Array, Array]:
        padded = np.pad(values, SIDE_ROWS, mode="edge")
        least, most, *more = (padded[first + k : first + k + values.size] for k in (0, size - 1, *range(1, size - 1)))
        least, most = np.minimum(least, most), np.maximum(least, most)
        if not more:
            return 0.5 * (least + most), most - least
        (middle,) = more  # of up to SIDE_ROWS rows
        return np.clip(middle, least, most), np.maximum(most, middle) - np.minimum(least, middle)

    ends = [
        level(v, *side) for v in (temperature, humidity) for side in ((before, SIDE_ROWS - before), (behind, SIDE_ROWS))
    ]
    (t, after_t, h, after_h), moved = (one[0] for one in ends), np.max([one[1] for one in ends], axis=0)
    straight, crossed = np.abs(after_t - t) + np.abs(after_h - h), np.abs(after_t - h) + np.abs(after_h - t)
    return np.asarray((np.maximum(crossed, moved) < MOST_SHARE_OFF * straight) & (np.abs(t - h) > LEAST_COLUMNS_APART))


def code_notes(codes: Mapping[str, Mask | int]) -> list[str]:
    """A sentence for each quantity: how many rows of it hold which code."""
    of_quantity: dict[str, list[str]] = {}
    sentences = []
    for name, rows in codes.items():
        count = int(np.count_nonzero(rows)) if isinstance(rows, np.ndarray) else rows
        if count and name == EXCHANGED:
            sentences.append(f"{name} in {counted(count, 'row')}: taken as missing")
        elif count and name == PASCAL:
            sentences.append("pressure_hpa: no air has so much; taken as Pa, and divided by 100")
        elif count:
            quantity, code = name.split(" ", 1)
            of_quantity.setdefault(quantity, []).append(f"{code} in {counted(count, 'row')}")
    return sentences + [
        f"{quantity}: {', '.join(found)}: what loggers write for no value, taken as missing"
        for quantity, found in of_quantity.items()
    ]
