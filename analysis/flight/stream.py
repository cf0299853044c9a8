"""A flight's file corrected to another file, block by block: memory does not grow with the flight, cost is linear in
it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.correct import correct_read, of_both_columns
from shockrig.analysis.flight.flight_channel import REMEMBERED_LAGS
from shockrig.analysis.flight.late_rows import taken_by_time
from shockrig.analysis.flight.response import bead_response, film_response
from shockrig.analysis.flight.screen import UNSURE, code_notes
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Stream
from shockrig.files.disk import real_path
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, Corrected, Flight, FlightColumns, also_called, read_layout
from shockrig.files.flight_cells import Rows, joined, read_blocks
from shockrig.files.flight_csv import CsvWriter
from shockrig.files.flight_netcdf import NetcdfWriter
from shockrig.files.flight_rows import damage_notes, to_flight, unrecognised
from shockrig.files.profile import Profile
from shockrig.files.serials import of_log, serial_doubts

LONGEST_MARGIN_S = 150.0  # of the neighbours that a block sees: what a sensor remembers, at most that
MARGIN_ROWS, MOST_MARGIN_ROWS = 1500, 15_000
CORRECTED_ROWS = 30_000  # at once: what is seen as a margin is corrected twice and thrice
MARGINS_A_BLOCK = 2  # at least
OF_A_COLUMN = re.compile(r"\w+_(s|c|percent|hpa|m): ")  # how a doubt about the log begins
NUMBER = re.compile(r"[-+]?\d[\d.e+-]*")


@dataclass(frozen=True)
class Summary:
    """What was done: rows, how many carry each flag, notes."""

    rows: int
    flags: Mapping[str, int]
    notes: tuple[str, ...]


def correct_file(
    source: Path,
    profile: Profile,
    target: Path,
    method: str = "smoother",
    *,
    columns: Mapping[str, str] | None = None,
    cutoff_hz: float | None = None,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
    lag_s: float | None = None,
    named: bool = False,
    history: str = "",
    block_rows: int | None = None,
    progress: Callable[[int], None] = lambda rows: None,
    gather: Sequence[Callable[[Flight, Corrected], None]] = (),
) -> Summary:
    """Correct the CSV `source` into `target` (netCDF where its name ends in .nc); `columns`: quantity -> column's name;
    `named`: a person says which of the log's is which.

    What is to be `gather`ed of the flight is given each block in turn.

    Raises
    ------
    InputError
        Names the file, the line or column, and the remedy; nothing is left behind.
    """
    layout = read_layout(source, columns)
    _demand_apart(source, target)
    totals = _Totals(_said_of(source, layout, profile))
    writer = _writer(target, layout, history)
    try:
        for rows, before, after, logged in _with_margins(source, layout, block_rows, _remembered_s(profile)):
            by_time, order, late = (logged, None, []) if method == "causal" else taken_by_time(logged)
            flight, codes = of_both_columns(by_time, profile, named)
            noise, unsure = (temperature_noise_k, humidity_noise_percent), codes.get(UNSURE)
            found = correct_read(flight, late, profile, method, cutoff_hz, *noise, lag_s, unsure, named)
            own: slice | NDArray[np.int64] = slice(before, flight.time_s.size - after)
            if order is not None:
                own = np.flatnonzero((order >= before) & (order < flight.time_s.size - after))
            totals.count(codes, own)
            found, flight = found.at(own), flight.at(own)
            in_file = slice(None) if order is None else np.argsort(order[own])
            writer.write(rows, flight.at(in_file), found.at(in_file))
            totals.add(flight, found)
            for take in gather:
                take(flight, found)
            progress(totals.rows)
        if not totals.rows:
            raise InputError(f"{source}: no rows under the header; give a log with samples")
        writer.close()
    except BaseException as error:
        writer.discard()
        if (said := _told(error, source, target)) is not error:
            raise said from error
        raise
    return totals.summary()


def _demand_apart(source: Path, target: Path) -> None:
    """Raise InputError where the corrected flight has no file of its own."""
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file for the corrected flight")
    if real_path(target) == real_path(source):
        raise InputError(f"{target}: the log itself; name another file for the corrected flight")


def _writer(target: Path, layout: FlightColumns, history: str) -> NetcdfWriter | CsvWriter:
    """Of the kind that the file's name asks for."""
    try:
        return NetcdfWriter(target, layout, history) if target.suffix == ".nc" else CsvWriter(target, layout)
    except OSError as error:
        raise InputError(f"{target}: {error.strerror or error}; name a file in a folder that can be written") from error


def _said_of(source: Path, layout: FlightColumns, profile: Profile) -> list[str]:
    """What is to be said of a log before its rows are corrected; InputError where most of them are no numbers."""
    damage = damage_notes(source, layout)
    said = [layout.said] if layout.said else []
    said += [*serial_doubts(of_log(source, layout, source.name), profile.sensors), *damage]
    for quantity in ("temperature", "humidity"):
        if quantity not in layout.place and getattr(profile, quantity) is not None:
            said.append(unrecognised(quantity, also_called(quantity, layout.header, layout.place)))
    return said


def _told(error: BaseException, source: Path, target: Path) -> BaseException:
    """The error as its reader needs it: which file cannot be written, or which log is at fault."""
    # netCDF's own library says RuntimeError where the disk is full.
    if isinstance(error, OSError) or (isinstance(error, RuntimeError) and "NetCDF" in str(error)):
        reason = getattr(error, "strerror", None) or error
        return InputError(f"{target}: cannot be written ({reason}); make room or name another place")
    if isinstance(error, InputError) and not str(error).startswith(str(source)):
        return type(error)(f"{source}: {error}")
    return error


def _remembered_s(profile: Profile) -> float:
    """For how long [s] the slower of a profile's sensors remembers, where its table ends in the cold."""
    slowest_s = []
    for_one = Stream(np.array([REFERENCE_AIRFLOW_M_S]))
    if (bead := profile.temperature) is not None:
        slowest_s.append(bead_response(bead, for_one, profile.bodies["imet"]).slowest_s)
    if (film := profile.humidity) is not None:
        coldest = np.array([min(row.ambient_temperature_c for row in film.diffusivity_table)])
        slowest_s.append(film_response(film, coldest, for_one, profile.bodies["hyt"]).slowest_s)
    return REMEMBERED_LAGS * max(slowest_s, default=LONGEST_MARGIN_S)


def _with_margins(
    source: Path, layout: FlightColumns, block_rows: int | None, remembered_s: float
) -> Iterator[tuple[Rows, int, int, Flight]]:
    """Each block's rows, how many rows of margin lie before and after it, and the numbers of all of them."""
    tail: Rows | None = None
    current: Rows | None = None
    margin = MARGIN_ROWS
    for first in islice(read_blocks(source, layout, MARGIN_ROWS), 1):
        rows = min(remembered_s, LONGEST_MARGIN_S) / typical_period(to_flight(first, layout).time_s)
        margin = int(np.clip(rows, MARGIN_ROWS, MOST_MARGIN_ROWS))
    for block in read_blocks(source, layout, block_rows or max(CORRECTED_ROWS, MARGINS_A_BLOCK * margin)):
        if current is not None and len(block) < margin:
            block = joined([current, block])  # the last: its neighbours cost more than it does
        elif current is not None:
            yield _between(tail, current, block[:margin], layout)
            tail = joined([current] if tail is None else [tail, current])[-margin:]
        current = block
    if current is not None:
        yield _between(tail, current, None, layout)


def _between(tail: Rows | None, rows: Rows, head: Rows | None, layout: FlightColumns) -> tuple[Rows, int, int, Flight]:
    parts = [part for part in (tail, rows, head) if part is not None]
    before, after = (0 if part is None else len(part) for part in (tail, head))
    return rows, before, after, to_flight(joined(parts), layout)


class _Totals:
    """Running sums over blocks, and what was `said` of the log before."""

    def __init__(self, said: Sequence[str]) -> None:
        self.rows = 0
        self.flags = dict.fromkeys(FLAGS, 0)
        self.notes = {note: note for note in said}
        self.codes: dict[str, int] = {}

    def count(self, codes: Mapping[str, NDArray[np.bool_]], own: slice | NDArray[np.int64]) -> None:
        for name, rows in codes.items():
            self.codes[name] = self.codes.get(name, 0) + int(np.count_nonzero(rows[own]))

    def add(self, flight: Flight, found: Corrected) -> None:
        self.rows += flight.time_s.size
        for name, mask in found.flags.items():
            self.flags[name] += int(np.count_nonzero(mask))
        for note in found.notes:
            # what is doubted in a log is said once, whatever its numbers are in another block
            self.notes.setdefault(NUMBER.sub("", note) if OF_A_COLUMN.match(note) else note, note)

    def summary(self) -> Summary:
        notes = (*code_notes(self.codes), *self.notes.values())
        return Summary(self.rows, self.flags, tuple(sorted(notes, key=lambda note: not note.startswith("profile:"))))
