"""A first MAP.toml for a log, with what is recognised in it and the steps that are seen: for a person to check."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from shockrig.files.disk import shown
from shockrig.files.numbers import short
from shockrig.files.unit_names import quantity_of
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.apart import SeveralError
from shockrig.rig.logs.clock_columns import RISING, counters, guess_clock, not_read, two_ways
from shockrig.rig.logs.found import LogStep, steps_of
from shockrig.rig.logs.guess import MAY_BE_F, NOTHING, ZEROS, Guess, guess_log, likely_reference
from shockrig.rig.logs.log import ImpossibleError
from shockrig.rig.logs.map_file import parse_map
from shockrig.rig.logs.mapping import FORMAT, LogMap
from shockrig.rig.logs.onset import StepOnset
from shockrig.rig.logs.runs import unused
from shockrig.rig.logs.sensor_logs import SensorLog, read_sensors
from shockrig.rig.logs.stamps import ISO, NUMBERS, to_map
from shockrig.rig.logs.text import Layout, Scan, scan

WIDTH, LONGEST = 44, 120  # where comments stand, and how long a line may be
MUCH_FASTER = 1.5  # that a sensor must be to be suggested as another's reference
CLOCK_LINE = (
    'time = "..." (a column to be added where several make up the time; every_s = 1.0, from row to row, where none '
    "tells it)"
)
UNIT_SHOWN = {"temperature": "degC", "humidity": "%RH"}


class NoClockError(BenchError):
    """A log whose sensors are recognised, and none of its columns as a clock."""


@dataclass(frozen=True)
class LogLook:
    """What was seen of logs: the map's text, the same read, for each log its readings and steps, and as `notes` what of
    the time was taken for granted and what is not used. Where rows are of several sensors, `whose` they are, the one
    that was looked at first."""

    text: str
    map: LogMap
    logs: tuple[SensorLog, ...]
    steps: tuple[tuple[LogStep, ...], ...]
    notes: tuple[str, ...]
    whose: tuple[str, ...] = ()


def look_at(
    paths: Sequence[Path],
    map_path: Path,
    progress: Callable[[str], None] = lambda said: None,
    sensor: str | None = None,
) -> LogLook:
    """Recognise logs of one layout and find their steps; `map_path` is where the map will stand.

    Of rows that are of several sensors those of `sensor`, or of the first one, are looked at, and `notes` say so.

    Raises
    ------
    BenchError
        A log cannot be read, has no sensor or no time, or another layout than the first.
    """
    refused: list[ImpossibleError] = []
    several: list[SeveralError] = []
    while True:
        try:
            return _look(paths, map_path, progress, refused, several, sensor)
        except ImpossibleError as fault:
            refused.append(fault)  # a name promises nothing: the log is looked at without that column
        except SeveralError as fault:
            if any(fault.column == one.column for one in several):
                raise
            measured = ("temperature", "humidity")
            mine = sorted(fault.values, key=lambda value: (value != sensor, quantity_of(value, None) not in measured))
            several.append(SeveralError(str(fault), fault.column, tuple(mine)))


def _look(
    paths: Sequence[Path],
    map_path: Path,
    progress: Callable[[str], None],
    refused: Sequence[ImpossibleError],
    several: Sequence[SeveralError],
    sensor: str | None,
) -> LogLook:
    """As `look_at`, without the columns that were refused; a further one that cannot be what it is called is refused
    in its turn."""
    layout = Layout(only=tuple((one.column, one.values[0]) for one in several))
    scans = [scan(path, layout) for path in paths]
    for other in scans[1:]:
        if other.names != scans[0].names:
            raise BenchError(
                f"{shown(other.path)}: has other columns than {shown(scans[0].path)}; look at each by itself"
            )
    guess = _recognised(scans[0], refused, several)
    assert guess.clock is not None
    for other in scans[1:] if guess.clock.doubt else []:  # whether day or month comes first, another log may tell
        clock = guess_clock(other.names, other.sample(), other.units)
        if clock is not None and not clock.doubt and clock.columns == guess.clock.columns:
            guess = replace(guess, clock=clock)
            break
    head = _head(scans, guess, map_path, several)
    text = head + _sensors(guess, {}, None)
    map_ = parse_map(text, map_path)
    logs = []
    while scans:  # the text is of no more use once it is read, and is most of what is held
        logs.append(read_sensors(scans[0].path, map_, scans.pop(0), guessed=True))
    progress("looking for steps")
    steps = [steps_of(one, map_) for one in logs]
    left_out = [unused(one, those, map_) for one, those in zip(logs, steps, strict=True)]
    times = t63_of([one for those, out in zip(steps, left_out, strict=True) for one in those if one.number not in out])
    text = head + _sensors(guess, times, likely_reference(guess.sensors)) + _steps_text(logs, steps, left_out)
    notes = (*_units_in_doubt(guess), *_not_used(guess))
    if guess.clock is not None and guess.clock.doubt:
        notes = (f"time: {guess.clock.doubt}", *notes)
    for one in several:
        mine, *others = one.values
        notes = (
            f"the rows of {one.column} {mine} alone; others, for [log] only in the map: {_shorter(', '.join(others))}",
            *notes,
        )
    whose = min((one.values for one in several), key=lambda values: values[0] != sensor, default=())
    return LogLook(text, parse_map(text, map_path), tuple(logs), tuple(steps), notes, whose)


def columns_of(path: Path, refused: Sequence[ImpossibleError] = ()) -> LogMap:
    """The map of one log's columns as they are recognised, without those that were refused; no step is looked for, and
    no time for a person to check.

    Raises as `look_at` does, and where a column may be anything that rises: an altitude does.
    """
    seen = scan(path, Layout())
    guess = _recognised(seen, refused)
    if guess.clock is not None and guess.clock.known == RISING:
        raise BenchError(f"{shown(path)}: no column is called a time; {guess.clock.columns[0]} merely rises")
    return parse_map(_head([seen], guess, path, ()) + _sensors(guess, {}, None), path)


def _recognised(first: Scan, refused: Sequence[ImpossibleError] = (), several: Sequence[SeveralError] = ()) -> Guess:
    """What a log's columns are, where it has a time and, beside the columns that were refused, a sensor."""
    guess = guess_log(first, [fault.column for fault in refused])
    told_apart_by = {one.column for one in several}
    guess = replace(guess, unused=tuple(one for one in guess.unused if one[0] not in told_apart_by))
    if refused and not guess.sensors:
        raise BenchError(f"{refused[0]}, or name another column (it has: {', '.join(first.names)})")
    if guess.clock is None or not guess.sensors:
        fault = NoClockError if guess.clock is None and guess.sensors else BenchError
        what = "times" if guess.clock is None else "temperatures or humidities"
        has = ", ".join(first.names)
        if guess.clock is None and (counting := counters(first.names)):
            has += f"; a count of rows is no clock: {', '.join(counting)}"
        if first.unheld:
            has += f"; rows hold no cell for {', '.join(first.unheld)}, or for others"
        when = CLOCK_LINE if guess.clock is None else f"time = {_list(guess.clock.columns)}"
        if not first.header_line:
            row, width = first.numbers[0], len(first.names)
            raise fault(
                f"{shown(first.path)}: no line of names is found above its first row, line {row}; write a map by hand, "
                f'[log] header_line = 0, {when} and [sensor.NAME] temperature = "N", where columns are '
                f"numbers from 1 to {width}, as docs/importing.md shows"
            )
        sought = [one for one in guess.unused if quantity_of(one[0], None) in ("temperature", "humidity")]
        empty = {why: [name for name, reason in sought if reason == why] for why in (NOTHING, ZEROS)}
        said = "".join(f"{', '.join(names)}: {why}; " for why, names in empty.items() if names)
        said += "no column" if not said or guess.clock is None else "no other column"
        if guess.clock is None and (twice := two_ways(first.sample())):
            said = f"dates are written in two ways ({' and '.join(twice)}), write them in one: {said}"
        of_name = {name: [row[k] for row in first.sample()] for k, name in enumerate(first.names)}
        if guess.clock is None and (strange := not_read(of_name)):
            name, cell = strange
            when = f'time = {_text(name)}, time_format = "..." (strptime\'s, as "%d.%m.%Y %H:%M:%S")'
            said = f"{name} holds {cell!r}, and that way of writing a time is not known: {said}"
        raise fault(
            f"{shown(first.path)}: {said} of {what} is recognised (it has: {has}); write a map by hand, [log] "
            f'{when} and [sensor.NAME] temperature = "...", as docs/importing.md shows'
        )
    return guess


def t63_of(steps: Sequence[LogStep]) -> dict[str, dict[str, float]]:
    """Quantity -> sensor -> median time to 63 % over steps."""
    times: dict[str, dict[str, list[float]]] = {}
    for one in steps:
        for move in one.step.moves:
            name, key = move.channel.rsplit(".", 1)
            times.setdefault(key, {}).setdefault(name, []).append(move.reached_s - one.step.at_s)
    return {key: {name: float(np.median(those)) for name, those in of.items()} for key, of in times.items()}


def _line(content: str, comment: str = "") -> str:
    if not comment:
        return content + "\n"
    line = f"{content:<{WIDTH - 2}}  # {comment}".rstrip() + "\n"
    return line if len(line) <= LONGEST else f"# {comment}:\n{content}\n"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _list(columns: Sequence[str]) -> str:
    """A column, or several, as a map names them."""
    names = ", ".join(_text(name) for name in columns)
    return names if len(columns) == 1 else f"[{names}]"


def _head(scans: Sequence[Scan], guess: Guess, map_path: Path, several: Sequence[SeveralError]) -> str:
    assert guess.clock is not None
    clock, first = guess.clock, scans[0]
    names = " ".join(one.path.name for one in scans)
    lines = [
        f"# {names}: what shockrig import recognises. Check it, correct it, then\n",
        f"#   shockrig import {names} --map {map_path.name} --out CAMPAIGN\n",
        _line(f"format = {_text(FORMAT)}"),
        _line(f"name = {_text(first.path.stem)}"),
        "\n",
        _line("[log]", f"known as {guess.known_as}" if guess.known_as else "what is left out is found out"),
    ]
    lines.append(_line(f"time = {_list(clock.columns)}"))
    if clock.format == NUMBERS:
        lines.append(
            _line(f"time_unit = {_text(clock.unit)}", clock.doubt or ("since 1970" if clock.since_1970 else ""))
        )
    else:
        lines.append(
            _line(f"time_format = {_text(clock.format)}", clock.doubt or ("ISO 8601" if clock.format == ISO else ""))
        )
    if several:
        only = ", ".join(f"{_text(one.column)} = {_text(one.values[0])}" for one in several)
        others = "; ".join(_shorter(", ".join(one.values[1:])) for one in several)
        lines.append(_line(f"only = {{ {only} }}", f"whose rows; others: {others}"))
    lines += [f"# {_shorter(said)}\n" for said in first.metadata[:12]]
    return "".join(lines)


def _sensors(guess: Guess, times: dict[str, dict[str, float]], by_name: str | None) -> str:
    lines = []
    for sensor in guess.sensors:
        lines += ["\n", *(f"# {note}\n" for note in sensor.notes), _line(f"[sensor.{sensor.name}]")]
        for key, (column, unit, how) in sensor.columns.items():
            lines.append(_line(f"{key} = {_text(column)}"))
            lines.append(_line(f"{key}_unit = {_text(unit)}", how))
        lines += [_line(f"{key} = {value}") for key, value in sensor.extra.items()]
        if {"temperature", "humidity"} <= set(sensor.columns) and "die_temperature" not in sensor.columns:
            column, unit, _ = sensor.columns["temperature"]
            lines.append(
                _line(f"die_temperature = {_text(column)}", "one chip measures both: delete this where it does not")
            )
            lines.append(_line(f"die_temperature_unit = {_text(unit)}"))
        lines += [
            _line(f"# reference = {_text(name)}", f"if it measured the air beside this one: {why}")
            for name, why in _references(sensor.name, times, by_name).items()
        ]
        for kind, quantity, length in (
            ("thermometer", "temperature", "bead_radius_m"),
            ("hygrometer", "humidity", "film_thickness_m"),
        ):
            if quantity in sensor.columns and kind not in sensor.extra:
                lines.append(_line(f'# {kind} = {{ kind = "", serial = "" }}', f"also body, {length}"))
    lines += ["\n"] if guess.unused else []
    lines += [f"# {said}\n" for said in _not_used(guess)]
    return "".join(lines)


def _units_in_doubt(guess: Guess) -> tuple[str, ...]:
    """A sentence for each column of temperatures that may be in another unit than it is taken for."""
    columns = [column for sensor in guess.sensors for column in sensor.columns.items()]
    return tuple(
        f'{name}: no unit is named; taken as {unit}; if it is fahrenheit, say {key}_unit = "degF"'
        for key, (name, unit, how) in columns
        if how.endswith(MAY_BE_F)
    )


def _not_used(guess: Guess) -> tuple[str, ...]:
    """A sentence for each reason for which columns are not used."""
    reasons = dict.fromkeys(why for _, why in guess.unused)
    names = {why: ", ".join(name for name, reason in guess.unused if reason == why) for why in reasons}
    return tuple(f"not used, {why}: {_shorter(those)}" for why, those in names.items())


def _references(sensor: str, times: dict[str, dict[str, float]], by_name: str | None) -> dict[str, str]:
    """Sensors that may have measured the air beside one, and what speaks for each."""
    found = {}
    if by_name is not None and by_name != sensor:
        found[by_name] = "its name says so"
    for key, of in times.items():
        fastest = min(of, key=lambda name: of[name])
        if fastest != sensor and sensor in of and of[sensor] > MUCH_FASTER * of[fastest]:
            found[fastest] = f"63 % of {key} after {short(of[fastest], 3)} s, this one after {short(of[sensor], 3)} s"
    return found


def _steps_text(
    logs: Sequence[SensorLog], steps: Sequence[Sequence[LogStep]], left_out: Sequence[Mapping[int, str]]
) -> str:
    lines = ["\n"]
    for sensors, those, reasons in zip(logs, steps, left_out, strict=True):
        log = sensors.log
        span_s = float(sum(log.time_s[rows.stop - 1] - log.time_s[rows.start] for rows in log.pieces))
        lines.append(
            f"# {log.path.name}: {log.time_s.size} rows over {span_s:.6g} s, one every {log.period_s:.4g} s; "
            f"{len(those)} step{'s' if len(those) != 1 else ''} seen\n"
        )
        lines += [
            f"# {_shorter(said)}\n"
            for said in (*log.remarks, *(r for s in sensors.readings.values() for r in s.remarks))
        ]
        for one in those:
            lines.append(_step_text(sensors, one, len(log.pieces) > 1, reasons.get(one.number, "")))
    lines += [
        "\n",
        _line("[runs]", "what holds for every run, where it is known; a [[step]] may say otherwise"),
        _line("# airflow_m_s = 5.0"),
        _line("# pressure_hpa = 1013.0", "where no column has it"),
        _line("# before_s = 60.0", "how much of the log a run takes before and after its step"),
        _line("# after_s = 300.0"),
    ]
    return "".join(lines)


def _step_text(sensors: SensorLog, one: LogStep, in_pieces: bool, why_not: str) -> str:
    log, step = sensors.log, one.step
    digits = int(np.clip(np.ceil(-np.log10(max(step.uncertainty_s, 1e-3))) + 1, 0, 3))
    lines = [
        "\n",
        _line("[[step]]", f"{one.number}"),
        _line(f"log = {_text(log.path.name)}"),
        _line(f"at = {to_map(log.clock, log.origin_s, step.at_s, digits)}", "when it was first seen, not a trigger"),
        _line(f"uncertainty_s = {step.uncertainty_s:.2g}"),
    ]
    if in_pieces:
        lines.append(_line(f"piece = {step.piece + 1}"))
    moved = one.moved()
    if len(moved) < len(sensors.readings):
        lines.append(_line(f"sensors = [{', '.join(map(_text, moved))}]", "those that moved"))
    if why_not:
        beside = "true beside a reference that measured the air" if step.is_slow_air else ""
        lines += [_line("use = false", beside), _line(f"note = {_text(why_not)}")]
    lines += [f"# {said_of(move, step.at_s)}\n" for move in step.moves]
    return "".join(lines)


def said_of(move: StepOnset, at_s: float) -> str:
    """One line on what a channel did at a step that was seen at `at_s`, from which it counts."""
    unit, took_s = UNIT_SHOWN[move.quantity], max(move.reached_s - at_s, 0.0)
    when = f"within {short(move.row_s, 3)} s" if took_s <= move.row_s else f"after {short(took_s, 3)} s"
    return f"{move.channel}: {move.before:.4g} to {move.after:.4g} {unit}, 63 % {when}"


def _shorter(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= 110 else line[:107] + "..."
