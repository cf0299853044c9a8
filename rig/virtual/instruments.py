"""The emulated instruments of one virtual bench, made as they are asked for and all sampling one world."""

from __future__ import annotations

import errno
import itertools
import os
import random
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

from shockrig.files.campaign_names import FIRST_PROBE, sensor_and_probe
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air, Clock, SetPointsOnly, known
from shockrig.rig.virtual.chips.grbl import GrblController
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.chips.i2c import i2c_chip
from shockrig.rig.virtual.chips.imet import ImetUnit
from shockrig.rig.virtual.climate import ModbusServer, Room, RoomPart, ScpiServer
from shockrig.rig.virtual.faults import Fault, FaultyI2c, FaultySerial
from shockrig.rig.virtual.i2c_dev import I2cWire, Wire, plug_in, pull_out
from shockrig.rig.virtual.serial_line import Device, MemorySerial, PtyDevice

IMET_UNITS = ("imet-xf", "imet-xq2", "imet-xq")
SECOND_BEAD, SECOND_FILM = "13", "17"  # ids of an XF's lines
SNAP_S = 0.002  # how long a transfer takes where the truth says that it takes no time
_numbers = itertools.count(1)


class PhysicalWorld(Protocol):
    """What the instruments sample; times are on the bench clock."""

    def set_airs(
        self, source: Air, destination: Air, airflow_m_s: float, pressure_hpa: float, irradiance_w_m2: float = 0.0
    ) -> None: ...

    def begin_transfer(self, at_s: float, duration_s: float | None = None) -> None: ...

    def begin_return(self, at_s: float) -> None: ...

    def bead_temperature_c(self, at_s: float) -> float: ...

    def film_humidity_percent(self, at_s: float) -> float: ...

    def die_temperature_c(self, at_s: float) -> float: ...

    def air(self, at_s: float) -> Air: ...


class _Locked:
    """A world that several threads may sample: in real time each pseudo-terminal has a thread of its own."""

    def __init__(self, world: PhysicalWorld) -> None:
        self._world = world
        self._lock = threading.Lock()

    def __getattr__(self, name: str) -> Callable[..., Any]:
        method = getattr(self._world, name)

        def locked(*arguments: Any) -> Any:
            with self._lock:
                return method(*arguments)

        return locked


class SideBySide:
    """Worlds of several probes on one carriage in the same airs: what the bench does, it does to all of them."""

    def __init__(self, worlds: Mapping[str, PhysicalWorld]) -> None:
        self.worlds = worlds

    def set_airs(self, *airs: Any) -> None:
        for world in self.worlds.values():
            world.set_airs(*airs)

    def begin_transfer(self, at_s: float) -> None:
        for world in self.worlds.values():
            world.begin_transfer(at_s)

    def begin_return(self, at_s: float) -> None:
        for world in self.worlds.values():
            world.begin_return(at_s)


class WorldChambers(SetPointsOnly):
    """Chambers that make about what they are asked for, and references that report about what they make.

    `made` and `reported` are one sigma of what the air differs from the set point, and its report from the air, in K
    and %RH.
    """

    def __init__(
        self,
        world: PhysicalWorld | SideBySide,
        pressure_hpa: float,
        made: tuple[float, float],
        reported: tuple[float, float],
        seed: int,
        told: Callable[[float], None] = lambda pressure_hpa: None,
    ) -> None:
        self._world = world
        self._pressure_hpa, self._irradiance_w_m2, self._told = pressure_hpa, 0.0, told
        self._made, self._reported = made, reported
        self._random = random.Random(f"chambers {seed}")
        self._airs = (Air(None, None), Air(None, None))

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        true = self._off(source, self._made), self._off(destination, self._made)
        flow = 5.0 if airflow_m_s is None else airflow_m_s
        self._world.set_airs(*true, flow, self._pressure_hpa, self._irradiance_w_m2)
        self._airs = self._off(true[0], self._reported), self._off(true[1], self._reported)

    def surround(self, pressure_hpa: float, irradiance_w_m2: float) -> None:
        """Felt from the next airs on; what measures the pressure is told."""
        self._pressure_hpa, self._irradiance_w_m2 = pressure_hpa, irradiance_w_m2
        self._told(pressure_hpa)

    def _off(self, air: Air, sigma: tuple[float, float]) -> Air:
        if air.temperature_c is None or air.humidity_percent is None:
            return air  # which the world refuses
        return Air(
            air.temperature_c + self._random.gauss(0.0, sigma[0]),
            min(max(air.humidity_percent + self._random.gauss(0.0, sigma[1]), 0.0), 100.0),
        )

    def airs(self) -> tuple[Air, Air]:
        return self._airs


class _LooseWire:
    """A wire on which nobody answers for `AWAY_S` at random, so that a `fraction` of the readings is missing."""

    AWAY_S = 0.05  # longer than the retries of a driver, shorter than the time between readings

    def __init__(self, wire: Wire, clock: Clock, fraction: float, seed: int) -> None:
        self._wire = wire
        self._clock = clock
        self._fraction = fraction
        self._random = random.Random(f"loose wire {seed}")
        self._away_until_s: float | None = None  # the first request, which proves that somebody is there, is answered

    def open(self) -> None:
        self._wire.open()

    def write(self, address: int, data: bytes) -> None:
        now = self._clock.now()
        if self._away_until_s is None:
            self._away_until_s = now
        elif now >= self._away_until_s and self._random.random() < self._fraction:
            self._away_until_s = now + self.AWAY_S
        if now < self._away_until_s:
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
        self._wire.write(address, data)

    def read(self, address: int, length: int) -> bytes:
        return self._wire.read(address, length)


class VirtualInstruments:
    """Emulated instruments over a world.

    Parameters
    ----------
    others : mapping
        Worlds of further probes by their names ("2").
    in_real_time : bool
        Serial devices are pseudo-terminals then, and objects in memory else.
    transfer_s : float
        How long the carriage takes from switch to switch at the bench file's feed or faster.
    missing_fraction : float
        Share of the sensors' readings that are lost.
    faults : mapping
        What to inject, by the name of the part ("imet", "hyt", "stage", "reference").
    through : mapping
        What else an iMet's lines bring: {"imet": {"13": "imet-2", "8": "hyt"}}, ids of lines and whose they are.
    """

    def __init__(
        self,
        world: PhysicalWorld,
        clock: Clock,
        pressure_hpa: float,
        *,
        others: Mapping[str, PhysicalWorld] | None = None,
        seed: int = 0,
        in_real_time: bool = False,
        transfer_s: float = 0.0,
        missing_fraction: float = 0.0,
        faults: Mapping[str, Iterable[Fault]] | None = None,
        through: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        worlds = {FIRST_PROBE: world, **(others or {})}
        self._worlds: dict[str, Any] = {probe: _Locked(one) if in_real_time else one for probe, one in worlds.items()}
        self.world = self._worlds[FIRST_PROBE]
        self._bench = SideBySide(self._worlds)
        self._clock = clock
        self._pressure_hpa = pressure_hpa
        self._seed = seed
        self._in_real_time = in_real_time
        self.transfer_s = max(transfer_s, SNAP_S)
        self._missing_fraction = missing_fraction
        self._faults = faults or {}
        self._through = through or {}
        self._random = random.Random(f"phases {seed}")
        self._paths: list[str] = []
        self._ptys: list[PtyDevice] = []
        self._servers: list[ScpiServer | ModbusServer] = []
        self._room: Room | None = None
        self.parts: dict[str, object] = {}  # the emulated chip, unit or controller of each part, for tests

    def i2c_path(self, part: str, kind: str, address: int) -> str:
        """A device file with a chip at `address`: it feels the film on trial, or for a reference the air itself."""
        if part == "reference":
            air = self.world.air
            felt = lambda at_s: known(air(at_s).humidity_percent), lambda at_s: known(air(at_s).temperature_c)
        else:
            world = self._of(part)
            felt = world.film_humidity_percent, world.die_temperature_c
        chip = i2c_chip(kind, *felt, lambda at_s: self._pressure_hpa, address)
        wire: Wire = I2cWire([chip], self._clock)
        if part != "reference" and self._missing_fraction > 0.0:
            wire = _LooseWire(wire, self._clock, self._missing_fraction, self._seed)
        path = f"/dev/i2c-virtual-{next(_numbers)}"
        if part in self._faults:
            browns_out = chip if isinstance(chip, Hyt271Chip) else None
            wire = FaultyI2c(wire, self._faults[part], self._clock, browns_out, self._seed)
        plug_in(path, wire)
        self._paths.append(path)
        self.parts[part] = chip
        return path

    def _of(self, part: str) -> Any:
        """The world of a probe's sensor."""
        place = sensor_and_probe(part)
        return self.world if place is None else self._worlds[place[1]]

    def _device(self, part: str, kind: str, settings: Any) -> Device:
        if kind == "grbl":
            return GrblController(
                settings.source_mm,
                settings.destination_mm,
                self._bench.begin_transfer,
                self._bench.begin_return,
                self.feed_mm_min(settings),
                settings.baud,
                slowed=self.world.begin_transfer,
            )
        if kind not in IMET_UNITS:
            emulated = ", ".join(("grbl", *IMET_UNITS))
            raise BenchError(f'{part}: port = "virtual": no {kind} is emulated ({emulated} are); name the port of one')
        world, also = self._of(part), self._through.get(part, {})
        films = {line: self._of(name) for line, name in also.items() if name.startswith("hyt")}
        film = films.get("8") if kind == "imet-xf" else world
        second = films.get(SECOND_FILM)
        period_s = 0.1
        losses = random.Random(f"lost lines {self._seed}")
        return ImetUnit(
            world.bead_temperature_c,
            lambda at_s: self._pressure_hpa,
            kind,
            None if film is None else film.film_humidity_percent,
            None if film is None else film.die_temperature_c,
            period_s=period_s,
            phase_s=self._clock.now() + self._random.random() * period_s,
            baud=settings.baud,
            lost=lambda: losses.random() < self._missing_fraction,
            second_bead_c=self._of(also[SECOND_BEAD]).bead_temperature_c if SECOND_BEAD in also else None,
            second_film=None if second is None else (second.film_humidity_percent, second.die_temperature_c),
        )

    def serial_opener(self, part: str, kind: str, settings: Any) -> Callable[[], MemorySerial] | str:
        """What opens an emulated device: a pseudo-terminal's path in real time, else a function."""
        device: Device = self._device(part, kind, settings)
        self.parts[part] = device
        if part in self._faults:
            device = FaultySerial(device, self._faults[part], self._clock, self._seed)
        if not self._in_real_time:
            return lambda: MemorySerial(device, self._clock)
        self._ptys.append(PtyDevice(device, self._clock))
        return self._ptys[-1].path

    def feed_mm_min(self, settings: Any) -> float:
        """Feed at which the carriage takes `transfer_s` from switch to switch."""
        return 60 * abs(settings.destination_mm - settings.source_mm) / self.transfer_s

    def chambers(self, truth: Any) -> WorldChambers:
        """The two airs, with the scatter of the truth's chambers and of its reference instruments."""
        made = truth.chamber_scatter_k, truth.chamber_scatter_percent
        reported = truth.reference_scatter_k, truth.reference_scatter_percent
        return WorldChambers(self._bench, self._pressure_hpa, made, reported, self._seed, self._at_pressure)

    def _at_pressure(self, pressure_hpa: float) -> None:
        self._pressure_hpa = pressure_hpa

    def climate_port(self, part: str, protocol: str) -> str:
        """Where an emulated chamber ("source chamber", "destination chamber") or "fan" of this world is reached."""
        if self._room is None:
            self._room = Room(
                lambda source, destination, airflow_m_s: self._bench.set_airs(
                    source, destination, airflow_m_s, self._pressure_hpa
                )
            )
        climate = RoomPart(self._room, part.removesuffix(" chamber"))
        server = ScpiServer(climate) if protocol == "scpi" else ModbusServer(climate)
        self._servers.append(server)
        self.parts[part] = server
        return server.port

    def close(self) -> None:
        for server in self._servers:
            server.close()
        self._servers = []
        for path in self._paths:
            pull_out(path)
        for pty in self._ptys:
            pty.close()
        self._paths, self._ptys = [], []
