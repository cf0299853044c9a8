"""Bench files (TOML): which instruments make up a bench, where they are connected, and their settings.

[bench] name, clock, pressure_hpa; [sensors.imet], [sensors.hyt] (of further probes: [sensors.imet-2], ...), [stage],
[reference] each with a kind and that kind's own settings,
and for any of them certificate = "..." and calibrated = 2026-04-01;
[chambers.source], [chambers.destination], [chambers.airflow] for devices that make them (a person does where left out);
[common_uncertainty] for what is off in all runs alike; [virtual] for emulated parts. Kinds are a table of strings:
nothing vendor-specific is imported before it is asked for.
"""

from __future__ import annotations

import importlib
import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from importlib import resources
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import DEFAULT_BODIES, sensor_and_probe
from shockrig.files.common_uncertainty import INPUTS, read_common
from shockrig.files.disk import TOML_AT_MOST, read_text
from shockrig.files.file_table import FileTable
from shockrig.files.ranges import RANGES
from shockrig.files.spelling import did_you_mean, proposed
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.seams import Backend
from shockrig.rig.toml_text import read_toml, refuse_unknown_keys

# section -> kind -> module:class. A backend is one file and one line here, or an entry point "SECTION.KIND".
KINDS: dict[str, dict[str, str]] = {
    "sensors": {
        "hyt-271": "shockrig.rig.sensors.hyt271:Hyt271",
        "imet-xf": "shockrig.rig.sensors.imet:Imet",
        "imet-xq2": "shockrig.rig.sensors.imet:Imet",
        "imet-xq": "shockrig.rig.sensors.imet:Imet",
        "imet-bead": "shockrig.rig.sensors.imet_parts:ImetBead",
        "imet-humidity": "shockrig.rig.sensors.imet_parts:ImetHumidity",
    },
    "chambers": {
        "scpi": "shockrig.rig.chambers.scpi:ScpiDevice",
        "modbus": "shockrig.rig.chambers.modbus:ModbusDevice",
    },
    "stage": {"manual": "shockrig.rig.stages.manual:ManualStage", "grbl": "shockrig.rig.stages.grbl:GrblStage"},
    "reference": {
        "set-points": "shockrig.rig.references:SetPoints",
        "operator": "shockrig.rig.references:OperatorEntry",
        "hyt-271": "shockrig.rig.references:Hyt271Reference",
    },
}
ENTRY_POINTS = "shockrig.instruments"
CHAMBERS = {"source": "source chamber", "destination": "destination chamber", "airflow": "fan"}  # as parts of a bench
MAY_BE_ZERO = ("latency_s", "late_s", "sampled_after_s", "retry_s")
CALIBRATION = ("certificate", "calibrated")  # of any instrument: the certificate's number, and its date
LARGEST_SEED = 2**64 - 1
POSITIVE_UNITS = ("_s", "_m", "_hpa", "_mm_min", "baud")


@dataclass(frozen=True)
class InstrumentPart:
    """One instrument of a bench: its kind, the class behind it, that class's settings, and what is known of its
    calibration ("certificate", "calibrated")."""

    kind: str
    backend: Backend
    settings: Any
    calibration: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class VirtualSettings:
    """Settings of the emulated parts; `truth` is the path of a sealed truth (JSON), else one is drawn by `seed`."""

    seed: int = 0
    truth: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= LARGEST_SEED:
            raise BenchError(f"seed = {self.seed} must be from 0 to {LARGEST_SEED}, which is what 64 bits hold")


@dataclass(frozen=True)
class GeneralSettings:
    """The [bench] section.

    `clock` is "real" or, where every part is emulated, "virtual"; a question to the operator that waits for longer than
    `answer_within_s` pauses the campaign. `pressures_hpa` and `irradiances_w_m2` are those that runs can be recorded
    at besides the laboratory's own pressure and no light.
    """

    name: str
    clock: str = "real"
    pressure_hpa: float = 1013.25
    answer_within_s: float = 1800.0
    pressures_hpa: Sequence[float] = ()
    irradiances_w_m2: Sequence[float] = ()

    def __post_init__(self) -> None:
        for key, quantity in (("pressures_hpa", "pressure_hpa"), ("irradiances_w_m2", "irradiance_w_m2")):
            for value in getattr(self, key):
                if not RANGES[quantity].holds(value):
                    raise BenchError(f"{key}: {RANGES[quantity].refusal(value)}")
        if self.clock not in ("real", "virtual"):
            raise BenchError(f'clock = "{self.clock}" must be "real" or "virtual"')
        possible = RANGES["pressure_hpa"]
        if not possible.holds(self.pressure_hpa):
            raise BenchError(f"pressure_hpa = {self.pressure_hpa:g} must be from {possible}; {possible.slip}?")


@dataclass(frozen=True)
class BenchConfig:
    """A bench file, checked. `sensors` is in the file's order; `common` is what it states of errors that all runs
    share."""

    path: str
    general: GeneralSettings
    sensors: Mapping[str, InstrumentPart]
    stage: InstrumentPart
    reference: InstrumentPart
    virtual: VirtualSettings = field(default_factory=VirtualSettings)
    chambers: Mapping[str, InstrumentPart] = field(default_factory=dict)
    common: Mapping[str, float] = field(default_factory=dict)

    def is_virtual(self, part: InstrumentPart) -> bool:
        """Whether a part is emulated: its port or bus is called "virtual"."""
        return "virtual" in (getattr(part.settings, "port", None), getattr(part.settings, "bus", None))

    @property
    def emulated(self) -> bool:
        """Whether any part is emulated."""
        return any(self.is_virtual(part) for part in self.parts().values())

    def parts(self) -> dict[str, InstrumentPart]:
        """All instruments by name."""
        chambers = {CHAMBERS[name]: part for name, part in self.chambers.items()}
        return {**self.sensors, **chambers, "stage": self.stage, "reference": self.reference}


def shipped_benches() -> list[str]:
    """Names of the bench files that come with the package."""
    folder = resources.files("shockrig.data") / "benches"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_bench(path: str | Path) -> BenchConfig:
    """Read and check a bench file, or one that comes with the package ("raspberry-pi").

    Raises BenchError naming the file, the key and the remedy.
    """
    if str(path) in shipped_benches() and not Path(path).is_file():
        text = (resources.files("shockrig.data") / "benches" / f"{path}.toml").read_text(encoding="utf-8")
        return check_bench(read_toml(text, str(path)), f"{path}.toml")
    with as_bench_errors():
        ships = shipped_benches()
        remedy = f"{proposed(str(path), ships)}name a bench file that exists, or one of {', '.join(ships)}"
        text = read_text(path, remedy, TOML_AT_MOST)
    return check_bench(read_toml(text, str(path)), str(path))


def marked_set(path: Path) -> tuple[str, ...]:
    """Keys of a bench file whose lines still carry the mark SET, which `shockrig scan` gives to what it cannot know."""
    if not path.is_file():  # one that comes with the package
        return ()
    lines = read_text(path, "name a bench file that exists", TOML_AT_MOST).splitlines()
    keys = (line.partition("=")[0].strip() for line in lines if "# SET" in line and not line.lstrip().startswith("#"))
    return tuple(dict.fromkeys(keys))


def check_bench(content: Mapping[str, Any], path: str) -> BenchConfig:
    """The bench that a table of tables describes. Raises BenchError."""
    known = ("bench", "sensors", "chambers", "stage", "reference", "common_uncertainty", "virtual")
    refuse_unknown_keys(content, known, path)
    for section in ("bench", "sensors", "stage", "reference"):
        if not isinstance(content.get(section), Mapping):
            raise BenchError(f"{path}: section [{section}] is missing; data/benches has examples")
    sensors = content["sensors"]
    _demand_names(sensors, f"{path}: [sensors]")
    chambers = content.get("chambers", {})
    if not isinstance(chambers, Mapping):
        raise BenchError(f"{path}: chambers must be tables such as [chambers.source]")
    refuse_unknown_keys(chambers, CHAMBERS, f"{path}: [chambers]")
    config = BenchConfig(
        path,
        settings_from(GeneralSettings, content["bench"], f"{path}: [bench]"),
        {name: _part("sensors", table, f"{path}: [sensors.{name}]") for name, table in sensors.items()},
        _part("stage", content["stage"], f"{path}: [stage]"),
        _part("reference", content["reference"], f"{path}: [reference]"),
        settings_from(VirtualSettings, content.get("virtual", {}), f"{path}: [virtual]"),
        {name: _part("chambers", table, f"{path}: [chambers.{name}]") for name, table in chambers.items()},
        _common(content, path),
    )
    if config.general.clock == "virtual":
        for name, part in config.parts().items():
            connected = hasattr(part.settings, "port") or hasattr(part.settings, "bus")
            if (connected and not config.is_virtual(part)) or part.kind in ("manual", "operator"):
                raise BenchError(f'{path}: {name} is real, and reality keeps real time: set [bench] clock = "real"')
    return config


def _common(content: Mapping[str, Any], path: str) -> dict[str, float]:
    """What is stated of errors that all runs share, as campaign.json will have it."""
    with as_bench_errors():
        stated = read_common(FileTable(content, path))
    if stated is None:
        return {}
    refuse_unknown_keys(content["common_uncertainty"], INPUTS, f"{path}: [common_uncertainty]")
    return {key: value for key, value in stated.document().items() if key not in stated.by_default}


def _demand_names(sensors: Mapping[str, Any], where: str) -> None:
    """Raise BenchError unless each is a probe's thermometer or hygrometer, and the first probe has one."""
    first = tuple(DEFAULT_BODIES)
    strange = [name for name in sensors if sensor_and_probe(name) is None]
    refuse_unknown_keys(strange, (*first, *(f"{name}-2" for name in first)), where)
    if not any(name in sensors for name in first):
        of_first = f"the first probe's sensors are called {' and '.join(first)}"
        raise BenchError(f"{where}: {of_first}; name one so" if sensors else f"{where} is empty; {of_first}, give one")


def _part(section: str, table: Any, where: str) -> InstrumentPart:
    if not isinstance(table, Mapping):
        raise BenchError(f"{where} must be a table")
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS[section]:
        # Looking for those of other distributions takes as long as all the rest.
        others = (point.name for point in entry_points(group=ENTRY_POINTS))
        known = {*KINDS[section], *(name.partition(".")[2] for name in others if name.startswith(section + "."))}
        if not isinstance(kind, str) or kind not in known:
            raise BenchError(f'{where}: kind = "{kind}" is not known{did_you_mean(str(kind), sorted(known))}')
    backend = _backend(section, kind, where)
    calibration = {key: str(table[key]) for key in CALIBRATION if key in table}
    own = {key: value for key, value in table.items() if key != "kind" and key not in calibration}
    return InstrumentPart(kind, backend, settings_from(backend.Settings, own, where), calibration)


def _backend(section: str, kind: str, where: str) -> Any:
    if kind not in KINDS[section]:
        (point,) = entry_points(group=ENTRY_POINTS, name=f"{section}.{kind}")
        return point.load()
    module, _, name = KINDS[section][kind].partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise BenchError(f'{where}: kind = "{kind}" needs a package that is not installed: {error}') from None


def settings_from(cls: type, table: Mapping[str, Any], where: str) -> Any:
    """An instance of a frozen settings dataclass from a TOML table. Raises BenchError naming the key and the remedy."""
    known = {f.name: f for f in fields(cls)}
    refuse_unknown_keys(table, known, where)
    hints = typing.get_type_hints(cls)
    values = {}
    for key, value in table.items():
        if not _fits(value, hints[key]):
            raise BenchError(f"{where}: {key} = {value!r} must be {_words(hints[key])}")
        numeric = isinstance(value, int | float)
        if numeric and not _is_finite(value):
            raise BenchError(f"{where}: {key} = {value!r} must be finite")
        if numeric and key.endswith(POSITIVE_UNITS) and (value < 0 or (value == 0 and key not in MAY_BE_ZERO)):
            raise BenchError(f"{where}: {key} = {value!r} must be positive")
        if key == "address" and not 0 <= value <= 0x7F:
            raise BenchError(f"{where}: address = {value!r} must be from 0x00 to 0x7F (0x28 as delivered)")
        values[key] = tuple(value) if isinstance(value, list) else value
    for name, known_field in known.items():
        if name not in values and known_field.default is MISSING and known_field.default_factory is MISSING:
            raise BenchError(f"{where}: {name} is missing; it must be {_words(hints[name])}")
    try:
        return cls(**values)
    except BenchError as error:
        raise BenchError(f"{where}: {error}") from None


def _fits(value: Any, hint: Any) -> bool:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return any(_fits(value, argument) for argument in arguments)
    if origin is tuple:
        return isinstance(value, list) and len(value) == len(arguments) and all(map(_fits, value, arguments))
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(_fits(item, arguments[1]) for item in value.values())
    if origin is not None:
        return isinstance(value, list) and all(_fits(item, arguments[0]) for item in value)
    if isinstance(value, bool):
        return hint is bool
    return isinstance(value, (int, float) if hint is float else hint)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond every float
        return False


def _words(hint: Any) -> str:
    names = {int: "a whole number", float: "a number", str: "text", bool: "true or false"}
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return " or ".join(_words(argument) for argument in arguments if argument is not type(None))
    if origin is tuple:
        return f"a list of {len(arguments)} numbers"
    if origin is not None:
        if issubclass(origin, Mapping):
            return "a table of lists of text"
        return "a list of numbers" if arguments[0] is float else "a list of text"
    return names.get(hint, str(hint))
