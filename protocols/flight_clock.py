"""A clock between a flight's position and its readings taken off: what the autopilot logged, at the readings' times."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import open_text, write_whole
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY, Flight, read_layout, without_nul
from shockrig.files.flight_cells import number_of
from shockrig.files.flight_rows import whole_flight

Array = NDArray[np.float64]
OF_POSITION = ("altitude", "latitude", "longitude", "vertical_speed", "airspeed")
FIELDS = ("altitude_m", "latitude_deg", "longitude_deg", "vertical_speed_m_s", "airspeed_m_s")
MOST_S = 600.0  # more is no clock but another flight


def on_clock(flight: Flight, clock_s: float) -> Flight:
    """A flight whose position is taken `clock_s` later than its rows say: so far its times are behind the readings'.

    Where the log has no altitude, the pressure is its position.
    """
    if not abs(clock_s) <= MOST_S:
        raise InputError(f"--clock-s {clock_s:g}: expected seconds from -{MOST_S:g} to {MOST_S:g}")
    flown = flight.altitude_m is not None and bool(np.isfinite(flight.altitude_m).any())
    moved = {}
    for name in FIELDS if flown else (*FIELDS, "pressure_hpa"):
        values = getattr(flight, name)
        if values is not None:
            moved[name] = _later(flight.time_s, values, clock_s)
    return replace(flight, **moved)


def clocked_csv(source: Path, target: Path, columns: Mapping[str, str] | None, clock_s: float) -> None:
    """A CSV log with its position's columns on the readings' clock; all else as it came.

    Raises
    ------
    InputError
        The log cannot be read, has rows that are none, or no position.
    """
    layout, time_s = read_layout(source, columns), on_clock(whole_flight(source, columns), clock_s).time_s
    with open_text(source, REMEDY, errors="replace") as stream:
        rows = [row for row in csv.reader(without_nul(stream)) if row]
    body = rows if layout.raw_xq2 else rows[1:]
    if len(body) != time_s.size:
        raise InputError(f"{source}: {len(body)} rows, of which {time_s.size} can be read; take out the others first")
    moved = OF_POSITION if "altitude" in layout.place else (*OF_POSITION, "pressure")
    places = [layout.place[name] for name in moved if name in layout.place]
    if not places:
        raise InputError(
            f"{source}: --clock-s is of the position, and the log has none; name it with --column altitude=NAME"
        )
    for place in places:
        later = _later(time_s, np.array([_number(row, place) for row in body]), clock_s)
        for row, value in zip(body, later.tolist(), strict=True):
            if place < len(row):
                row[place] = "" if value != value else f"{value:.10g}"
    lines = rows[: len(rows) - len(body)] + body
    write_whole(target, "".join(f"{_line(row)}\n" for row in lines).encode())


def _later(time_s: Array, values: Array, clock_s: float) -> Array:
    """Values at each row's time and `clock_s`; NaN beyond what was logged."""
    known = np.flatnonzero(np.isfinite(time_s) & np.isfinite(values))
    if not known.size:
        return values
    order = known[np.argsort(time_s[known], kind="stable")]
    return np.interp(time_s + clock_s, time_s[order], values[order], left=np.nan, right=np.nan)


def _number(row: list[str], place: int) -> float:
    number = number_of(row[place]) if place < len(row) else None
    return np.nan if number is None else number


def _line(row: list[str]) -> str:
    return ",".join('"' + cell.replace('"', '""') + '"' if any(c in cell for c in ',"\n\r') else cell for cell in row)
