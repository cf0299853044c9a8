"""Protocol files (TOML, shock-protocol/1): which runs a campaign has, and the steps of each run.

A step is an action plus an end condition:
    { do = "soak", over_s = 30, at_most_s = 1200 }    bring the probes into the source air, wait until it is stable
    { do = "record", for_s = 10 }
    { do = "transfer", at_most_s = 20 }               carry the probes into the destination air
A run may be slowed on purpose, `transfer = { duration_s = 2.0 }`. `continues = N` says that the runs follow N others of
the same campaign: they are numbered from N + 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

from shockrig.files.disk import TOML_AT_MOST, read_bytes, shown
from shockrig.files.ranges import RANGES, Range
from shockrig.files.spelling import did_you_mean, proposed
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.seams import Air
from shockrig.rig.toml_text import read_toml, refuse_unknown_keys

FORMAT = "shock-protocol/1"
# Of what the steps and faults say, by the unit in the name.
LIMITS = {"_percent": RANGES["tolerance_percent"], "_k": RANGES["tolerance_k"], "_s": RANGES["step_s"]}


@dataclass(frozen=True)
class Soak:
    """Bring the probes into the source air and wait until the air is stable and the probes have settled in it.

    The air is stable when the reference moved by at most `reference_within_*` over `over_s`. The probes are noisier and
    slower, so they have settled when the means of the two halves of `over_s` differ by at most `probes_within_*`.
    """

    over_s: float = 30.0
    at_most_s: float = 1200.0
    reference_within_k: float = 0.05
    reference_within_percent: float = 0.3
    probes_within_k: float = 0.02
    probes_within_percent: float = 0.1

    def __str__(self) -> str:
        return (
            f"soak at the source until the reference is stable to {self.reference_within_k:g} K and "
            f"{self.reference_within_percent:g} %RH over {self.over_s:g} s, at most {self.at_most_s / 60:g} min"
        )


@dataclass(frozen=True)
class Record:
    """Record for a given time."""

    for_s: float

    def __str__(self) -> str:
        return f"record {self.for_s:g} s"


@dataclass(frozen=True)
class Transfer:
    """Carry the probes into the destination air; the step ends when the stage reports the arrival."""

    at_most_s: float = 20.0

    def __str__(self) -> str:
        return f"transfer, at most {self.at_most_s:g} s"


Step = Soak | Record | Transfer
STEPS: dict[str, type[Soak] | type[Record] | type[Transfer]] = {"soak": Soak, "record": Record, "transfer": Transfer}


@dataclass(frozen=True)
class Faults:
    """When a run counts as spoilt, and how often it is repeated before the campaign pauses.

    `airs_within_*`: how far from the stated air a probe may stand, its calibration, what heats or wets it, and an air's
    own unevenness included.
    """

    repeat_at_most: int = 2
    largest_gap_s: float = 1.0
    missing_percent_at_most: float = 5.0
    airs_within_k: float = 4.0
    airs_within_percent: float = 12.0


RUN_KEYS = (
    *("source", "destination", "airflow_m_s", "pressure_hpa", "irradiance_w_m2", "transfer"),
    *("steps", "note"),
)


@dataclass(frozen=True)
class PlannedRun:
    """One run as the protocol wants it; what the airs really were comes from the reference."""

    id: str
    source: Air
    destination: Air
    airflow_m_s: float | None
    steps: tuple[Step, ...]
    note: str = ""
    transfer_s: float | None = None  # slowed on purpose; as fast as the stage goes where None
    pressure_hpa: float | None = None  # the laboratory's where None
    irradiance_w_m2: float | None = None  # no light where None

    def shortest_s(self) -> float:
        """Time that the run takes if the soak is stable at once, in s."""
        return sum(s.over_s if isinstance(s, Soak) else s.for_s if isinstance(s, Record) else 1.0 for s in self.steps)

    def longest_s(self) -> float:
        """Time after which the run has ended, one way or the other, in s."""
        return sum(s.for_s if isinstance(s, Record) else s.at_most_s for s in self.steps)


@dataclass(frozen=True)
class Protocol:
    """The plan of a campaign; `by_hand` says that it is for a person at a bench, not for emulated instruments.

    `continues` is how many runs of the campaign come before these.
    """

    name: str
    description: str
    runs: tuple[PlannedRun, ...]
    faults: Faults = Faults()
    by_hand: bool = False
    continues: int = 0


def run_id(number: int) -> str:
    """Id of a campaign's run by its number, from 1."""
    return f"{number:04d}"


def shipped_protocols() -> list[str]:
    """Names of the protocols that come with the package."""
    folder = resources.files("shockrig.data") / "protocols"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_protocol(name_or_path: str | Path) -> Protocol:
    """Read a protocol: the name of a shipped one ("standard") or the path of a TOML file.

    Raises
    ------
    BenchError
        Naming the file, the key and the remedy.
    """
    path = Path(name_or_path)
    if str(name_or_path) in shipped_protocols() and not path.is_file():
        source = resources.files("shockrig.data") / "protocols" / f"{name_or_path}.toml"
        return parse_protocol(source.read_bytes(), f"{name_or_path}.toml")
    ships = shipped_protocols()
    meant, known = proposed(str(name_or_path), ships), ", ".join(ships)
    with as_bench_errors():
        content = read_bytes(
            path, f"{meant}give the path of a TOML file or the name of a shipped protocol ({known})", TOML_AT_MOST
        )
    return parse_protocol(content, shown(path))


def parse_protocol(content: bytes, where: str) -> Protocol:
    """Check the text of a protocol file and turn it into a plan; `where` names it in messages."""
    try:
        table = read_toml(content.decode("utf-8"), where)
    except UnicodeDecodeError as error:
        raise BenchError(f"{where}: not UTF-8 at byte {error.start}; save the file as UTF-8") from None
    known = ("format", "name", "description", "by_hand", "continues", "airflow_m_s", "faults", "steps", "run")
    refuse_unknown_keys(table, known, where)
    if table.get("format") != FORMAT:
        raise BenchError(f'{where}: format is {table.get("format")!r}; write format = "{FORMAT}"')
    name = _text(table, "name", where)
    description = _text(table, "description", where)
    airflow_m_s = _number(table, "airflow_m_s", where, RANGES["airflow_m_s"])
    by_hand = table.get("by_hand", False)
    if not isinstance(by_hand, bool):
        raise BenchError(f"{where}: by_hand is {repr(by_hand)[:40]}; expected true or false")
    continues = table.get("continues", 0)
    if isinstance(continues, bool) or not isinstance(continues, int) or not 0 <= continues < 10000:
        raise BenchError(f"{where}: continues is {repr(continues)[:40]}; expected the number of runs before these")
    faults = _faults(_table(table, "faults", where), f"{where}: faults")
    recipes = {key: _steps(value, f"{where}: steps.{key}") for key, value in _table(table, "steps", where).items()}
    if not recipes:
        raise BenchError(f'{where}: steps is missing; write e.g. [steps] usual = [{{ do = "soak" }}, ...]')
    entries = table.get("run")
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) for e in entries):
        raise BenchError(f"{where}: no runs; write each as a [[run]] table")
    runs = []
    for number, entry in enumerate(entries, start=1):
        here = f"{where}: run {number}"
        refuse_unknown_keys(entry, RUN_KEYS, here)
        recipe = entry.get("steps", next(iter(recipes)))
        if not isinstance(recipe, str) or recipe not in recipes:
            raise BenchError(f"{here}: steps = {recipe!r} is not defined{did_you_mean(str(recipe), recipes)}")
        speed_m_s = _number(entry, "airflow_m_s", here, RANGES["airflow_m_s"])
        runs.append(
            PlannedRun(
                id=run_id(continues + number),
                source=_air(entry, "source", here),
                destination=_air(entry, "destination", here),
                airflow_m_s=airflow_m_s if speed_m_s is None else speed_m_s,
                steps=recipes[recipe],
                note=_text(entry, "note", here),
                transfer_s=_slowed(entry, recipes[recipe], here),
                pressure_hpa=_number(entry, "pressure_hpa", here, RANGES["pressure_hpa"]),
                irradiance_w_m2=_number(entry, "irradiance_w_m2", here, RANGES["irradiance_w_m2"]),
            )
        )
    return Protocol(
        name=name or Path(where).stem,
        description=description,
        runs=tuple(runs),
        faults=faults,
        by_hand=by_hand,
        continues=continues,
    )


def _table(table: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise BenchError(f"{where}: {key} is {value!r}; expected a table")
    return value


def _text(table: Mapping[str, Any], key: str, where: str) -> str:
    value = table.get(key, "")
    if not isinstance(value, str):
        raise BenchError(f"{where}: {key} is {value!r}; expected text in quotes")
    return value


def _number(table: Mapping[str, Any], key: str, where: str, limits: Range, *, positive: bool = False) -> float | None:
    """Number within `limits`, above 0 where it must be `positive`; None where the key is left out."""
    if key not in table:
        return None
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
        raise BenchError(f"{where}: {key} is {value!r}; expected a number")
    if not limits.holds(value) or (positive and value <= 0):
        expected = f"more than 0, up to {limits.high:g}" if positive else str(limits)
        raise BenchError(f"{where}: {key} is {repr(value)[:40]}; expected {expected}")
    return float(value)


def _air(entry: Mapping[str, Any], key: str, where: str) -> Air:
    if key not in entry:
        raise BenchError(f"{where}: {key} is missing; write {key} = {{ temperature_c = 20, humidity_percent = 50 }}")
    table, here = _table(entry, key, where), f"{where}: {key}"
    refuse_unknown_keys(table, ("temperature_c", "humidity_percent"), here)
    temperature_c = _number(table, "temperature_c", here, RANGES["temperature_c"])
    humidity_percent = _number(table, "humidity_percent", here, RANGES["humidity_set_percent"])
    return Air(temperature_c=temperature_c, humidity_percent=humidity_percent)


def _slowed(entry: Mapping[str, Any], steps: Sequence[Step], where: str) -> float | None:
    """How long a run's transfer shall take; None where it is as fast as the stage goes."""
    table, here = _table(entry, "transfer", where), f"{where}: transfer"
    refuse_unknown_keys(table, ("duration_s",), here)
    duration_s = _number(table, "duration_s", here, RANGES["transfer_s"], positive=True)
    longest_s = next(step.at_most_s for step in steps if isinstance(step, Transfer))
    if duration_s is not None and duration_s >= longest_s:
        raise BenchError(
            f"{here}: duration_s is {duration_s:g} and the step allows {longest_s:g} s; raise its at_most_s"
        )
    return duration_s


def _numbers(kind: type, table: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Arguments of the dataclass `kind` from a table of positive numbers, each with a unit in its name."""
    names = tuple(f.name for f in fields(kind))
    refuse_unknown_keys(table, names, where)
    values = {}
    for name in table:
        limits = next(limits for unit, limits in LIMITS.items() if unit in name)
        values[name] = _number(table, name, where, limits, positive=True)
    for field in fields(kind):
        if field.default is MISSING and field.name not in values:
            raise BenchError(f"{where}: {field.name} is missing; write {field.name} = NUMBER")
    return values


def _faults(table: Mapping[str, Any], where: str) -> Faults:
    repeat = table.get("repeat_at_most", Faults.repeat_at_most)
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 0 <= repeat <= 100:
        raise BenchError(f"{where}: repeat_at_most is {repeat!r}; expected a whole number from 0 to 100")
    rest = {key: value for key, value in table.items() if key != "repeat_at_most"}
    refuse_unknown_keys(table, tuple(f.name for f in fields(Faults)), where)
    return Faults(**(_numbers(Faults, rest, where) | {"repeat_at_most": repeat}))


def _steps(value: Any, where: str) -> tuple[Step, ...]:
    if not isinstance(value, list) or not all(isinstance(step, dict) for step in value):
        raise BenchError(f'{where}: expected a list of steps such as {{ do = "record", for_s = 10 }}')
    steps = []
    for number, table in enumerate(value, start=1):
        here = f"{where}, step {number}"
        action = table.get("do")
        if not isinstance(action, str) or action not in STEPS:
            raise BenchError(f"{here}: do = {action!r} is not an action{did_you_mean(str(action), STEPS)}")
        refuse_unknown_keys(table, ("do", *(f.name for f in fields(STEPS[action]))), here)
        steps.append(STEPS[action](**_numbers(STEPS[action], {k: v for k, v in table.items() if k != "do"}, here)))
    kinds = [type(step) for step in steps]
    if kinds.count(Soak) != 1 or kinds[0] is not Soak:
        raise BenchError(f"{where}: a run begins with its one soak")
    if kinds.count(Transfer) != 1:
        raise BenchError(f"{where}: a run has one transfer, this one has {kinds.count(Transfer)}")
    if kinds[-1] is not Record or kinds[kinds.index(Transfer) - 1] is not Record:
        raise BenchError(f"{where}: the plateau before the transfer and the transient after it need a record step each")
    return tuple(steps)
