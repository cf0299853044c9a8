"""The bench that a bench file describes: clock, sensors, stage, reference.

This is the composition root: the one place that puts drivers on buses, and the only importer of `rig.virtual`. The
emulated instruments stand below the real drivers, smbus2 and pyserial, at the device files.
"""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import FIRST_PROBE, probes_of, sensor_name
from shockrig.files.disk import read_text
from shockrig.files.errors import InputError
from shockrig.rig.bench_errors import BenchError, ConnectionFault, ConnectionFaults, RigError
from shockrig.rig.bench_file import CHAMBERS, BenchConfig, InstrumentPart, check_bench, load_bench
from shockrig.rig.buses.i2c import SmbusBus
from shockrig.rig.buses.serial_port import OpenPort, PyserialPort, pyserial_opener
from shockrig.rig.chambers.devices import DeviceChambers
from shockrig.rig.clock import RealClock, VirtualClock
from shockrig.rig.operator import ConsoleOperator
from shockrig.rig.seams import Chambers, Clock, I2cBus, Operator, Reference, Sensor, SerialPort, Stage
from shockrig.rig.stages.manual import PromptedChambers

__all__ = ["Bench", "ConnectionFault", "ConnectionFaults", "default_bench", "load_bench", "open_bench", "virtual_bench"]

XF_FILM = "8"  # id of an iMet-XF's lines with its first HYT-271
REMEDIES = {
    errno.ENOENT: "there is no such port: check that it is plugged in, and its name in the bench file (shockrig scan)",
    errno.EACCES: "the system refuses access: add yourself to the groups dialout and i2c, then log in again",
    errno.EBUSY: "another program has it: end that one",
    errno.EAGAIN: "another program has it: end that one",
    errno.EREMOTEIO: "nobody answers at this address: check supply, wiring, pull-ups and address",
    errno.ENXIO: "nobody answers at this address: check supply, wiring, pull-ups and address",
    errno.EIO: "nobody answers: check supply, wiring and address",
    errno.ETIMEDOUT: "the bus is held: check wiring and pull-ups, then switch the supply off and on",
}


NO_BUS = "there is no such bus: switch I2C on (raspi-config, or the overlay of that bus), and check its number"


def _remedy(error: OSError, device: str) -> str:
    """What helps where a device cannot be opened."""
    if error.errno == errno.ENOENT and " at 0x" in device:  # what has an address is on a bus
        return NO_BUS
    return REMEDIES.get(error.errno or 0, "check cable and supply")


@dataclass
class Bench:
    """A bench whose parts are made but not opened yet; as a context manager it is made safe and closed on the way out.

    `name` and `pressure_hpa` are the bench file's; `describe()` is the "sensors" object of campaign.json. `truth` and
    `instruments` exist on a bench with emulated parts only.
    """

    name: str
    clock: Clock
    sensors: list[Sensor]
    stage: Stage
    reference: Reference
    pressure_hpa: float
    description: Mapping[str, Any] = field(default_factory=dict)
    truth: Any = None
    instruments: Any = None
    operator: Operator | None = None
    chambers: Chambers | None = None
    climate: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    calibration: Mapping[str, Any] = field(default_factory=dict)
    common: Mapping[str, float] = field(default_factory=dict)
    devices: Mapping[str, str] = field(default_factory=dict)
    pressures_hpa: tuple[float, ...] = ()
    irradiances_w_m2: tuple[float, ...] = ()

    def demand_surroundings(self, pressure_hpa: float | None, irradiance_w_m2: float | None) -> None:
        """Raise BenchError where runs cannot be recorded at this pressure, or in this light."""
        pressures = (self.pressure_hpa, *self.pressures_hpa)
        for key, value, offered, unit, listed in (
            ("pressure_hpa", pressure_hpa, pressures, "hPa", "pressures_hpa"),
            ("irradiance_w_m2", irradiance_w_m2, self.lights, "W/m2", "irradiances_w_m2"),
        ):
            if value is not None and value not in offered:
                made = ", ".join(f"{one:g}" for one in offered)
                raise BenchError(
                    f"{key} {value:g}: bench {self.name} has {made} {unit}; leave it out, or list it under {listed} in "
                    "[bench] where the bench can make it"
                )

    @property
    def lights(self) -> tuple[float, ...]:
        """Irradiances that runs can be recorded at, none first."""
        return (0.0, *self.irradiances_w_m2)

    def surround(self, pressure_hpa: float | None, irradiance_w_m2: float | None) -> dict[str, float]:
        """Make pressure and light of a run, and say what they are for run.json; the laboratory's where None."""
        pressure = self.pressure_hpa if pressure_hpa is None else pressure_hpa
        if self.chambers is None or not (self.pressures_hpa or self.irradiances_w_m2):
            return {"pressure_hpa": pressure}
        self.chambers.surround(pressure, irradiance_w_m2 or 0.0)
        light = {"irradiance_w_m2": irradiance_w_m2 or 0.0} if self.irradiances_w_m2 else {}
        return {"pressure_hpa": pressure, **light}

    @property
    def emulated(self) -> bool:
        """Whether any of its instruments is emulated: what it records is then invented, not measured."""
        return self.instruments is not None

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *exception: object) -> None:
        try:
            with contextlib.suppress(OSError):  # whoever moved it has said so; the error on its way out matters more
                self.make_safe()
        finally:
            self.close()

    def open(self) -> None:
        """Open every part. Raises ConnectionFaults that name all that cannot be opened."""
        faults = []
        for name, part in self.parts().items():
            try:
                part.open()
            except OSError as error:
                own = isinstance(error, RigError)  # says the remedy itself
                device = self.devices.get(name, name)
                remedy = "" if own else _remedy(error, device)
                cause = error.strerror or str(error)
                if error.errno and "[Errno" in cause:  # pyserial's own words name the port and the error twice
                    cause = os.strerror(error.errno)
                faults.append(ConnectionFault(device, cause, remedy))
        if faults:
            raise ConnectionFaults(faults)

    def parts(self) -> dict[str, Any]:
        """Sensors, chambers, reference and stage by name, in the order in which they are opened."""
        sensors = {sensor.name: sensor for sensor in self.sensors}
        return {**sensors, **self.climate, "reference": self.reference, "stage": self.stage}

    def describe(self) -> dict[str, Any]:
        """{"imet": {"kind", "serial", "bead_radius_m"}, "hyt": {"kind", "serial", "film_thickness_m"}}."""
        return {name: dict(entry) for name, entry in self.description.items()}

    def make_safe(self) -> None:
        """Stop all motion."""
        self.stage.make_safe()

    def close(self) -> None:
        for part in self.parts().values():
            part.close()
        if self.instruments is not None:
            self.instruments.close()


@dataclass
class _Parts:
    """What a backend's `build` may ask for: clock, operator, chambers, buses, and the sensors built before it."""

    clock: Clock
    operator: Operator
    chambers: Chambers
    instruments: Any
    name: str = ""
    kind: str = ""
    settings: Any = None
    sensors: dict[str, Sensor] = field(default_factory=dict)
    buses: dict[str, SmbusBus] = field(default_factory=dict)

    def i2c(self, bus: int | str) -> I2cBus:
        """The bus with this number or device file; parts on one bus share it, and with it its lock."""
        if bus == "virtual":
            return SmbusBus(self.instruments.i2c_path(self.name, self.kind, self.settings.address), self.clock)
        path = f"/dev/i2c-{bus}" if isinstance(bus, int) else bus
        if path not in self.buses:
            self.buses[path] = SmbusBus(path, self.clock, Path(tempfile.gettempdir()))
        return self.buses[path]

    def serial(self, port: str, baud: int) -> SerialPort:
        """The serial port with this name."""
        opener: Callable[[], OpenPort] | str = port
        if port == "virtual":
            opener = self.instruments.serial_opener(self.name, self.kind, self.settings)
        if isinstance(opener, str):
            opener = pyserial_opener(opener, baud)
        return PyserialPort(opener, self.clock, baud)

    def climate(self, port: str, protocol: str) -> str:
        """Where a chamber or fan is reached."""
        return str(self.instruments.climate_port(self.name, protocol)) if port == "virtual" else port


def open_bench(
    config: BenchConfig,
    *,
    operator: Operator | None = None,
    truth: Any = None,
    faults: Mapping[str, Iterable[Any]] | None = None,
    world: Any = None,
) -> Bench:
    """Put a bench together; nothing is opened yet.

    Parameters
    ----------
    operator : Operator, optional
        The person at the bench; the terminal where left out.
    truth : rig.virtual.truth.Truth, optional
        What is true of the emulated sensors; where left out, the bench file's, or one drawn by its seed.
    faults : mapping, optional
        Part's name -> rig.virtual.faults.Fault to inject; for emulated parts.
    world : rig.virtual.instruments.PhysicalWorld, optional
        What the first probe's emulated sensors feel; where left out, the airs of two chambers.

    Raises
    ------
    BenchError
        The parts do not fit together.
    """
    clock = VirtualClock() if config.general.clock == "virtual" else RealClock()
    settings = _snapshot(config)  # before the emulated stage is told how fast the truth has it
    person = operator or ConsoleOperator(clock, within_s=config.general.answer_within_s)
    instruments, truth = _emulate(config, clock, truth, faults or {}, world) if config.emulated else (None, None)
    if instruments is not None and config.is_virtual(config.stage):
        config = replace(config, stage=_fitted(config.stage, instruments))
        chambers = instruments.chambers(truth)
    else:
        chambers = PromptedChambers(person)
    parts = _Parts(clock, person, chambers, instruments)
    devices = {}
    for name, part in config.chambers.items():
        devices[name] = _build(CHAMBERS[name], part, parts, config)
    if devices:
        parts.chambers = chambers = DeviceChambers(devices, clock, person)
    for name, part in config.sensors.items():
        parts.sensors[name] = _build(name, part, parts, config)
    stage = _build("stage", config.stage, parts, config)
    reference = _build("reference", config.reference, parts, config)
    return Bench(
        name=config.general.name,
        clock=clock,
        sensors=list(parts.sensors.values()),
        stage=stage,
        reference=reference,
        pressure_hpa=config.general.pressure_hpa,
        description={name: _described(name, part, parts, config, truth) for name, part in config.sensors.items()},
        truth=truth,
        instruments=instruments,
        operator=person,
        chambers=chambers,
        settings=settings,
        calibration={name: dict(part.calibration) for name, part in config.parts().items() if part.calibration},
        common=config.common,
        climate={CHAMBERS[name]: device for name, device in devices.items()},
        devices={name: _device(name, part) for name, part in config.parts().items()},
        pressures_hpa=tuple(config.general.pressures_hpa),
        irradiances_w_m2=tuple(config.general.irradiances_w_m2),
    )


def _snapshot(config: BenchConfig) -> dict[str, Any]:
    """The whole bench file with its defaults, but for what is sealed: how emulated sensors are."""
    parts = {name: {"kind": part.kind, **asdict(part.settings)} for name, part in config.parts().items()}
    return {"bench": asdict(config.general), **parts}


def _build(name: str, part: InstrumentPart, parts: _Parts, config: BenchConfig) -> Any:
    parts.name, parts.kind, parts.settings = name, part.kind, part.settings
    try:
        return part.backend.build(name, part.settings, parts)
    except BenchError as error:
        raise BenchError(f"{config.path}: {name}: {error}") from None


def _described(name: str, part: InstrumentPart, parts: _Parts, config: BenchConfig, truth: Any) -> dict[str, Any]:
    """The campaign's entry of a sensor; an emulated one has the lengths that its truth is quoted for, and where none is
    stated a serial number that tells it from those of another truth."""
    entry = parts.sensors[name].describe()
    if truth is not None and config.is_virtual(config.sensors.get(getattr(part.settings, "through", ""), part)):
        from shockrig.rig.virtual.truth import serial_number

        entry["serial"] = entry.get("serial") or serial_number(truth, name)
        for length in ("bead_radius_m", "film_thickness_m"):
            if length in entry:
                entry[length] = getattr(truth, length)
    return {key: value for key, value in entry.items() if value is not None}


def _device(name: str, part: InstrumentPart) -> str:
    where = getattr(part.settings, "port", getattr(part.settings, "bus", None))
    if isinstance(where, int):
        where = f"/dev/i2c-{where}"
    address = getattr(part.settings, "address", None)

    place = "" if where is None else f" on {where}"
    channel = getattr(part.settings, "mux_channel", -1)
    place += "" if channel < 0 else f", channel {channel}"
    return f"{name} ({part.kind}{place}{'' if address is None else f' at {address:#04x}'})"


def _fitted(stage: InstrumentPart, instruments: Any) -> InstrumentPart:
    """The emulated carriage moves as fast as the truth says; the driver is told the same speed."""
    return replace(stage, settings=replace(stage.settings, feed_mm_min=instruments.feed_mm_min(stage.settings)))


def _emulate(
    config: BenchConfig, clock: Clock, truth: Any, faults: Mapping[str, Iterable[Any]], world: Any = None
) -> tuple[Any, Any]:
    from shockrig.rig.virtual.instruments import VirtualInstruments
    from shockrig.rig.virtual.truth import Truth, draw_truth, of_probe
    from shockrig.rig.virtual.world import World

    seed = config.virtual.seed
    if truth is None and config.virtual.truth is not None:
        try:
            truth = Truth.from_json(read_text(config.virtual.truth, "name a truth of the virtual bench"))
        except (InputError, BenchError) as error:
            raise BenchError(f"{config.path}: [virtual] truth = {config.virtual.truth!r}: {error}") from None
    if truth is None:
        import numpy as np

        truth = draw_truth(np.random.default_rng(seed))
    transfer = truth.effect("finite_transfer")
    instruments = VirtualInstruments(
        world or World(of_probe(truth, FIRST_PROBE), clock, seed),
        clock,
        config.general.pressure_hpa,
        others={
            probe: World(of_probe(truth, probe), clock, seed + k, carriage_seed=seed)
            for k, probe in enumerate(probes_of(config.sensors))
            if probe != FIRST_PROBE
        },
        seed=seed,
        in_real_time=config.general.clock == "real",
        transfer_s=transfer["duration_s"] if transfer else 0.0,
        missing_fraction=truth.missing_fraction,
        faults=faults,
        through=_through(config),
    )
    return instruments, truth


def _through(config: BenchConfig) -> dict[str, dict[str, str]]:
    """What else the lines of each iMet bring: {"imet": {"13": "imet-2", "8": "hyt"}}."""
    found: dict[str, dict[str, str]] = {}
    for name, part in config.sensors.items():
        if (unit := getattr(part.settings, "through", None)) is not None:
            found.setdefault(unit, {})[part.settings.line or XF_FILM] = name
    return found


def carrying(config: BenchConfig, probes: int) -> BenchConfig:
    """The bench with so many emulated probes, each like its first one.

    Raises
    ------
    BenchError
        It names further probes itself, or its sensors are no emulated ones.
    """
    if probes_of(config.sensors) != (FIRST_PROBE,):
        raise BenchError(f"{config.path}: names its probes; leave out --probes")
    if not all(config.is_virtual(part) for part in config.sensors.values()):
        raise BenchError(f"{config.path}: has sensors that are not emulated; leave out --probes, and name each there")
    names = [FIRST_PROBE, *(str(k) for k in range(2, probes + 1))]
    parts = [(name, probe, part) for probe in names for name, part in config.sensors.items()]
    sensors = {
        sensor_name(name, probe): replace(
            part, settings=replace(part.settings, serial=f"{part.settings.serial}-{probe}")
        )
        if part.settings.serial and probe != FIRST_PROBE
        else part
        for name, probe, part in parts
    }
    return replace(config, sensors=sensors)


def default_bench(seed: int = 0, clock: str = "virtual") -> BenchConfig:
    """The embedded virtual bench, for whoever has no instrument at hand."""
    import tomllib

    path = resources.files("shockrig.data") / "benches" / "virtual.toml"
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    content["bench"]["clock"] = clock
    content["virtual"] = {**content.get("virtual", {}), "seed": seed}
    return check_bench(content, str(path))


def virtual_bench(
    truth: Any = None, seed: int = 0, clock: str = "virtual", faults: Mapping[str, Iterable[Any]] | None = None
) -> Bench:
    """The embedded virtual bench, put together. Parameters as for `open_bench` and `default_bench`."""
    return open_bench(default_bench(seed, clock), truth=truth, faults=faults)
