"""One run as it is recorded: events written to a journal, and the journal read back as a RunRecord.

Records: ["run", header] ["step", t, text] ["air", t, "source" or "destination", degC, %RH] ["zero", t, utc]
["move", start, end] ["note", t, text]
["reading", sensor, outcome, requested, came, sampled, values, raw hex] ["end", t, status, reason];
times in s on the bench clock.
"""

from __future__ import annotations

import errno
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import sensor_and_probe
from shockrig.rig.bench_errors import BenchError, RigError, as_bench_errors
from shockrig.rig.journal import Journal, JournalWriter, read_journal
from shockrig.rig.seams import Air, Move, Outcome, Reading

FORMAT = "shock-journal/1"
# what the file of a sensor has after time_s: the quantity that the sensor is there for, then what it may say besides
_COLUMNS: Mapping[str, tuple[str, ...]] = {"imet": ("temperature_c",), "hyt": ("humidity_percent", "temperature_c")}
JOURNAL = "journal.log"
COMPLETE, SPOILT, INTERRUPTED = "complete", "spoilt", "interrupted"


def columns_of(sensor: str) -> tuple[str, ...]:
    """What the file of a sensor ("imet", "hyt-2") has after time_s; nothing for what is not a probe's sensor."""
    place = sensor_and_probe(sensor)
    return () if place is None else _COLUMNS[place[0]]


class RecordingError(RigError, OSError):
    """The disk does not take the recording any more; what was written up to then can be read."""


class Recorder:
    """Writes one run's journal. `header` is what is known beforehand: id, planned airs, sensors, pressure."""

    def __init__(self, folder: Path, header: Mapping[str, Any], now_s: float, sync_every_s: float | None = 1.0):
        self.folder = folder
        self._last_s = now_s
        try:
            self._journal = JournalWriter(folder / JOURNAL, sync_every_s)
        except OSError as error:
            raise _disk_error(folder, error) from error
        self._append(["run", {"format": FORMAT, **header}], now_s)

    def step(self, now_s: float, text: str) -> None:
        self._append(["step", _rounded(now_s), text], now_s)

    def zero(self, now_s: float, utc: str) -> None:
        """From here on the run counts: the zero of the files' time_s, with the time of day."""
        self._append(["zero", _rounded(now_s), utc], now_s)

    def air(self, now_s: float, place: str, air: Air) -> None:
        self._append(["air", _rounded(now_s), place, air.temperature_c, air.humidity_percent], now_s)

    def move(self, move: Move) -> None:
        end_s = None if move.end_s is None else _rounded(move.end_s)
        self._append(["move", _rounded(move.start_s), end_s], self._last_s)

    def note(self, now_s: float, text: str) -> None:
        """What a person at the bench wrote down."""
        self._append(["note", _rounded(now_s), text], now_s)

    def reading(self, reading: Reading) -> None:
        record = [
            "reading",
            reading.sensor,
            reading.outcome.value,
            _rounded(reading.requested_s),
            _rounded(reading.time_s),
            None if reading.sampled_s is None else _rounded(reading.sampled_s),
            dict(reading.values),
            reading.raw.hex(),
        ]
        self._append(record, reading.time_s)

    def end(self, now_s: float, status: str, reason: str = "") -> None:
        self._append(["end", _rounded(now_s), status, reason], now_s)
        self.close()

    def close(self) -> None:
        try:
            self._journal.close()
        except OSError as error:
            raise _disk_error(self.folder, error) from error

    def _append(self, record: list[Any], now_s: float) -> None:
        self._last_s = now_s
        try:
            self._journal.append(record, now_s)
        except OSError as error:
            raise _disk_error(self.folder, error) from error


@dataclass(frozen=True)
class RunRecord:
    """Everything a journal holds about one run; times in s on the bench clock."""

    header: Mapping[str, Any]
    zero_s: float | None
    started_at: str | None
    last_s: float
    move: Move | None
    airs: Mapping[str, tuple[Air, ...]]
    readings: Mapping[str, tuple[Reading, ...]]
    status: str
    reason: str
    damage: str = ""
    notes: tuple[tuple[float, str], ...] = ()
    counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def id(self) -> str:
        return str(self.header["id"])

    def recorded(self, sensor: str) -> list[Reading]:
        """Readings of one sensor since the run's zero, in order of their sample times."""
        if self.zero_s is None:
            return []
        kept = [r for r in self.readings.get(sensor, ()) if sample_time_s(r) >= self.zero_s]
        return sorted(kept, key=sample_time_s)


def sample_time_s(reading: Reading) -> float:
    """The instant on the bench clock that a reading tells of, which is what time_s means in the files.

    It is when the quantity was measured, as the driver knows it, and never when the answer came: that would put the
    wait for conversion, fetch and serial line into the sensor's own lag (0.1 s is a tenth of a bead's response). Where
    the driver cannot know, the request stands for it.
    """
    return reading.requested_s if reading.sampled_s is None else reading.sampled_s


def read_run(folder: Path) -> RunRecord:
    """Read the journal of a run, whole or cut off at any byte.

    A journal without its end record was cut off: its status is "interrupted".

    Raises
    ------
    BenchError
        There is no journal, or not even its first record is whole.
    """
    path = folder / JOURNAL
    with as_bench_errors():
        journal = read_journal(path)
    header: Mapping[str, Any] | None = None
    zero_s, started_at, last_s, move = None, None, 0.0, None
    status, reason = INTERRUPTED, "the recording was cut off"
    airs: dict[str, list[Air]] = {"source": [], "destination": []}
    readings: dict[str, list[Reading]] = {}
    notes: list[tuple[float, str]] = []
    try:
        for record in journal.records:
            if header is not None and (record[0] == "run" or status != INTERRUPTED):
                break  # behind its end, or at a second beginning: a journal that was copied behind itself
            match record:
                case ["reading", str(sensor), outcome, requested_s, time_s, sampled_s, dict(values), raw]:
                    _demand_numbers(requested_s, time_s, *values.values())
                    _demand_numbers(sampled_s, or_none=True)
                    kept = bytes.fromhex(raw)
                    reading = Reading(sensor, Outcome(outcome), requested_s, time_s, values, kept, sampled_s)
                    readings.setdefault(sensor, []).append(reading)
                    last_s = time_s
                case ["air", last_s, place, temperature_c, humidity_percent]:
                    _demand_numbers(temperature_c, humidity_percent, or_none=True)
                    airs[place].append(Air(temperature_c, humidity_percent))
                case ["zero", last_s, started_at]:
                    zero_s = last_s
                case ["move", start_s, end_s]:
                    _demand_numbers(start_s)
                    _demand_numbers(end_s, or_none=True)
                    move = Move(start_s, end_s)
                case ["end", last_s, str(status), str(reason)]:
                    pass
                case ["step", last_s, _]:
                    pass
                case ["note", last_s, str(text)]:
                    notes.append((last_s, text))
                case ["run", {"format": format_, "id": str()} as content] if format_ == FORMAT:
                    header = content
            _demand_numbers(last_s)
    except (KeyError, TypeError, ValueError) as error:
        raise BenchError(f"{path}: not a {FORMAT} journal: {error}") from None
    if header is None:
        raise BenchError(f"{path}: not even the first record is whole; nothing can be recovered")
    by_sensor = {sensor: tuple(values) for sensor, values in readings.items()}
    return RunRecord(
        header=header,
        zero_s=zero_s,
        started_at=started_at,
        last_s=last_s,
        move=move,
        airs={place: tuple(values) for place, values in airs.items()},
        readings=by_sensor,
        status=status,
        reason=reason,
        damage=_damage(journal),
        notes=tuple(notes),
        counts={sensor: count_outcomes(values) for sensor, values in by_sensor.items()},
    )


def _damage(journal: Journal) -> str:
    """What is not whole in a journal, in words; empty where all is."""
    counted = (
        (journal.damaged_lines, f"{journal.damaged_lines} damaged lines"),
        (journal.torn_bytes, f"a torn last record of {journal.torn_bytes} bytes"),
    )
    return ", ".join(text for count, text in counted if count)


def _demand_numbers(*values: Any, or_none: bool = False) -> None:
    for value in values:
        if value is None and or_none:
            continue
        if type(value) not in (int, float) or not abs(value) <= sys.float_info.max:
            raise ValueError(f"{value!r} is no number")


def is_good(reading: Reading) -> bool:
    """Whether a reading is fresh and has what its sensor is there for; a unit also sends other lines (position)."""
    return reading.outcome is Outcome.OK and columns_of(reading.sensor)[0] in reading.values


def count_outcomes(readings: Any) -> dict[str, int]:
    counts: dict[str, int] = {}
    for reading in readings:
        counts[reading.outcome.value] = counts.get(reading.outcome.value, 0) + 1
    return counts


def _rounded(time_s: float) -> float:
    return round(time_s, 6)


def _disk_error(folder: Path, error: OSError) -> RecordingError:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    cause = "the disk is full" if full else (error.strerror or str(error))
    remedy = "free some space" if full else "fix the disk"
    return RecordingError(
        f"{folder}: {cause}; what was recorded up to then is in its {JOURNAL}: {remedy} and run the same command again"
    )
