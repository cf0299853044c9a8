"""A session of emulated instruments in real time: which ones, over which world, and how other programs reach them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.rig.clock import RealClock
from shockrig.rig.errors import BenchError
from shockrig.rig.seams import Air
from shockrig.rig.virtual.chips.grbl import GrblController
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.chips.imet import ImetUnit
from shockrig.rig.virtual.climate import ModbusServer, Room, RoomPart, ScpiServer
from shockrig.rig.virtual.emulate.i2c_socket import I2cSocket, build_preload
from shockrig.rig.virtual.emulate.witness import Witness
from shockrig.rig.virtual.faults import I2C_KINDS, SERIAL_KINDS, Fault, FaultyI2c, FaultySerial
from shockrig.rig.virtual.i2c_dev import I2cWire, Wire
from shockrig.rig.virtual.serial_line import Device, PtyDevice

KINDS = ("imet-xf", "imet-xq2", "imet-xq", "hyt-271", "grbl")
LINES_HZ = {"imet-xf": 10.0, "imet-xq2": 1.0, "imet-xq": 1.0}
BAUD = {"imet-xf": 57600, "imet-xq2": 57600, "imet-xq": 57600, "grbl": 115200}
FASTEST_MM_MIN = 30_000.0
CLIMATE = (("source", "source", "scpi"), ("destination", "destination", "modbus"), ("airflow", "fan", "modbus"))
PRELOAD = "i2c_preload.so"


class FastClock:
    """The host's monotonic clock, run `speed` times as fast."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._clock = RealClock()

    def now(self) -> float:
        return self._speed * self._clock.now()

    def sleep_until(self, time_s: float) -> None:
        self._clock.sleep_until(time_s / self._speed)


@dataclass(frozen=True)
class Options:
    """How the instruments are; `rate_hz` None is each unit's own, `humidity` gives an iMet-XF its own HYT-271;
    `chambers` are the airs and the airflow that chambers and a fan begin with, where there are any."""

    address: int = 0x28
    bus: int = 1
    rate_hz: float | None = None
    humidity: bool = False
    travel_mm: float = 300.0
    seed: int = 0
    faults: tuple[Fault, ...] = ()
    chambers: tuple[Air, Air, float] | None = None


def check_kinds(kinds: Iterable[str], options: Options) -> None:
    """One bead, one film, one carriage in a world. Raises BenchError."""
    kinds = list(kinds)
    films = [k for k in kinds if k in ("hyt-271", "imet-xq2", "imet-xq") or (k == "imet-xf" and options.humidity)]
    for several, what in (([k for k in kinds if k.startswith("imet")], "beads"), (films, "films")):
        if len(several) > 1:
            raise BenchError(f"{' and '.join(several)} would be two {what}; emulate them one by one")
    if len(set(kinds)) < len(kinds):
        raise BenchError(f"{' '.join(kinds)}: one of a kind, please")
    serial, i2c = any(k in BAUD for k in kinds), "hyt-271" in kinds
    for fault in options.faults:
        known = {**(SERIAL_KINDS if serial else {}), **(I2C_KINDS if i2c else {})}
        if fault.kind not in known:
            raise BenchError(f"no fault {fault.kind!r} for {' '.join(kinds)}; there are {', '.join(known)}")


class Session:
    """Instruments that talk until they are closed.

    Parameters
    ----------
    world : object
        With the methods of rig.virtual.instruments.PhysicalWorld and pressure_hpa(at_s).
    folder : Path
        Where the socket and the preload library of I2C instruments are put.

    Attributes
    ----------
    serial : dict
        Kind -> path of its pseudo-terminal.
    climate : dict
        "source", "destination", "airflow" of a bench file's [chambers] -> (kind, port).
    environment : dict
        What another program needs in its environment to see the I2C bus.
    """

    def __init__(
        self,
        kinds: Iterable[str],
        world: Any,
        clock: FastClock,
        folder: Path,
        *,
        unix_s: Callable[[], float],
        truth: Path | None = None,
        options: Options | None = None,
    ) -> None:
        self._options = options or Options()
        kinds = list(kinds)
        check_kinds(kinds, self._options)
        self._clock = clock
        self._folder = folder
        self.serial: dict[str, str] = {}
        self.environment: dict[str, str] = {}
        self.climate: dict[str, tuple[str, str]] = {}
        self._parts: list[Any] = []
        self.witness = Witness(world, unix_s, truth)
        try:
            for kind in kinds:
                if kind == "hyt-271":
                    self._plug_i2c()
                else:
                    self._plug_serial(kind)
            if self._options.chambers is not None:
                self._plug_climate(*self._options.chambers)
        except BaseException:
            self.close()
            raise

    def _faults(self, known: dict[str, str]) -> list[Fault]:
        return [fault for fault in self._options.faults if fault.kind in known]

    def _plug_i2c(self) -> None:
        sample = self.witness.sampler
        chip = Hyt271Chip(
            sample("hyt-271", "humidity_percent"), sample("hyt-271", "die_temperature_c"), self._options.address
        )
        wire: Wire = I2cWire([chip], self._clock)
        if faults := self._faults(I2C_KINDS):
            wire = FaultyI2c(wire, faults, self._clock, chip, self._options.seed)
        library = self._folder / PRELOAD
        if not library.exists():
            build_preload(library)
        bus = I2cSocket(wire, self._folder / f"i2c-{self._options.bus}.socket")
        self._parts.append(bus)
        self.environment = {"LD_PRELOAD": str(library), f"SHOCKRIG_I2C_{self._options.bus}": str(bus.path)}

    def _plug_serial(self, kind: str) -> None:
        device: Device = self._carriage() if kind == "grbl" else self._unit(kind)
        if faults := self._faults(SERIAL_KINDS):
            device = FaultySerial(device, faults, self._clock, self._options.seed)
        pty = PtyDevice(device, self._clock)
        self._parts.append(pty)
        self.serial[kind] = pty.path

    def _plug_climate(self, source: Air, destination: Air, airflow_m_s: float) -> None:
        """The source's chamber speaks SCPI, the destination's and the fan speak Modbus."""
        room = Room(self._make_airs, source, destination, airflow_m_s)
        for name, place, protocol in CLIMATE:
            climate = RoomPart(room, place)
            server = ScpiServer(climate) if protocol == "scpi" else ModbusServer(climate)
            self._parts.append(server)
            self.climate[name] = (protocol, server.port)

    def _make_airs(self, source: Air, destination: Air, airflow_m_s: float) -> None:
        self.witness.set_airs(source, destination, airflow_m_s, self._clock.now())

    def _carriage(self) -> GrblController:
        begin, back = self.witness.begin_transfer, self.witness.begin_return
        return GrblController(0.0, self._options.travel_mm, begin, back, FASTEST_MM_MIN, BAUD["grbl"])

    def _unit(self, kind: str) -> ImetUnit:
        sample = self.witness.sampler
        humidity = kind != "imet-xf" or self._options.humidity
        die = kind == "imet-xq2" or (kind == "imet-xf" and humidity)
        period_s = 1.0 / (self._options.rate_hz or LINES_HZ[kind])
        return ImetUnit(
            sample(kind, "temperature_c"),
            self.witness.pressure_hpa,
            kind,
            sample(kind, "humidity_percent") if humidity else None,
            sample(kind, "die_temperature_c") if die else None,
            period_s=period_s,
            phase_s=self._clock.now() + period_s,
            baud=BAUD[kind],
        )

    def close(self) -> None:
        for part in self._parts:
            part.close()
        self._parts = []
        self.witness.close()
