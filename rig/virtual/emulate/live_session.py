"""A session of emulated instruments in real time: which ones, over which world, and how other programs reach them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.clock import RealClock
from shockrig.rig.seams import Air
from shockrig.rig.virtual.chips.grbl import GrblController
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.chips.i2c import I2C_ADDRESSES, i2c_chip
from shockrig.rig.virtual.chips.imet import ImetUnit
from shockrig.rig.virtual.climate import ModbusServer, Room, RoomPart, ScpiServer
from shockrig.rig.virtual.emulate.i2c_socket import I2cSocket, build_preload
from shockrig.rig.virtual.emulate.witness import Witness
from shockrig.rig.virtual.faults import I2C_KINDS, LINK_KINDS, SERIAL_KINDS, Fault, FaultyI2c, FaultySerial
from shockrig.rig.virtual.i2c_dev import Chip, I2cWire, Wire
from shockrig.rig.virtual.serial_line import Device, PtyDevice

KINDS = ("imet-xf", "imet-xq2", "imet-xq", *I2C_ADDRESSES, "grbl")
LINES_HZ = {"imet-xf": 10.0, "imet-xq2": 1.0, "imet-xq": 1.0}
# These feel the first probe's air, whatever else does; a second one the second's.
BESIDE = tuple(kind for kind in I2C_ADDRESSES if kind != "hyt-271")
BAUD = {"imet-xf": 57600, "imet-xq2": 57600, "imet-xq": 57600, "grbl": 115200}
FASTEST_MM_MIN = 30_000.0
CLIMATE = (("source", "source", "scpi"), ("destination", "destination", "modbus"), ("airflow", "fan", "modbus"))
PRELOAD = "i2c_preload.so"
OF_A_FILM = ("humidity_percent", "die_temperature_c")
MOST_PROBES = 8
LAST_ADDRESS = 0x77


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
    """How the instruments are; `rate_hz` None is each unit's own, `humidity` gives an iMet-XF its own HYT-271, `second`
    a second bead, and with `humidity` a second film; `address` is the first HYT-271's, further ones have the next;
    `chambers` are the airs and the airflow that chambers and a fan begin with, where there are any; `linked`: there is
    a node on a link besides."""

    address: int = 0x28
    bus: int = 1
    rate_hz: float | None = None
    humidity: bool = False
    second: bool = False
    travel_mm: float = 300.0
    seed: int = 0
    faults: tuple[Fault, ...] = ()
    chambers: tuple[Air, Air, float] | None = None
    linked: bool = False


@dataclass(frozen=True)
class Instrument:
    """One instrument to emulate: its name ("imet-xf", the second of a kind "imet-xf-2"), its kind, and the probes whose
    beads and films it reads; 0 where it reads none."""

    name: str
    kind: str
    beads: tuple[int, ...] = ()
    films: tuple[int, ...] = ()


def instruments_of(kinds: Iterable[str], options: Options) -> list[Instrument]:
    """What is emulated: every further bead is that of a further probe beside the first, and so is every further film.

    Raises
    ------
    BenchError
        These cannot stand together, or a fault is none of theirs.
    """
    kinds = list(kinds)
    found: list[Instrument] = []
    beads = films = 0
    for place, kind in enumerate(kinds):
        number = kinds[: place + 1].count(kind)
        of_xf = kind == "imet-xf"
        has_beads = (2 if of_xf and options.second else 1) if kind.startswith("imet") else 0
        has_films = int(kind in ("hyt-271", "imet-xq2", "imet-xq") or (of_xf and options.humidity))
        has_films += of_xf and options.humidity and options.second
        beside = (number,) if kind in BESIDE else ()
        found.append(
            Instrument(
                kind if number == 1 else f"{kind}-{number}",
                kind,
                tuple(range(beads + 1, beads + has_beads + 1)),
                beside or tuple(range(films + 1, films + has_films + 1)),
            )
        )
        beads, films = beads + has_beads, films + has_films
    if kinds.count("grbl") > 1:
        raise BenchError("grbl grbl: all probes lie on one carriage; name grbl once")
    if probes_of(found) > MOST_PROBES:
        raise BenchError(f"{beads} beads and {films} films: at most {MOST_PROBES} probes are emulated together")
    if options.second and "imet-xf" not in kinds:
        raise BenchError("--second: a second bead is an iMet-XF's; name imet-xf")
    addresses = addresses_of(found, options)
    if any(address > LAST_ADDRESS for address in addresses.values()):
        raise BenchError(f"--address {options.address:#04x}: each further HYT-271 has the next one; give a lower one")
    taken: dict[int, str] = {}
    for name, address in addresses.items():
        if address in taken:
            raise BenchError(f"{taken[address]} and {name} both answer at {address:#04x}; emulate one of them")
        taken[address] = name
    serial, i2c = any(k in BAUD for k in kinds), any(k in I2C_ADDRESSES for k in kinds)
    for fault in options.faults:
        linked = LINK_KINDS if options.linked else {}
        known = {**(SERIAL_KINDS if serial else {}), **(I2C_KINDS if i2c else {}), **linked}
        if fault.kind not in known:
            what = " ".join([*kinds, *(["a link"] if options.linked else [])])
            raise BenchError(f"no fault {fault.kind!r} for {what}; there are {', '.join(known)}")
    return found


def addresses_of(instruments: Iterable[Instrument], options: Options) -> dict[str, int]:
    """Where I2C instruments answer, by their names: each further one of a kind has the next address."""
    found: dict[str, int] = {}
    counts: dict[str, int] = {}
    for one in instruments:
        if one.kind in I2C_ADDRESSES:
            first = options.address if one.kind == "hyt-271" else I2C_ADDRESSES[one.kind]
            found[one.name] = first + counts.get(one.kind, 0)
            counts[one.kind] = counts.get(one.kind, 0) + 1
    return found


def probes_of(instruments: Iterable[Instrument]) -> int:
    """How many probes they read, and at least one."""
    return max((n for one in instruments for n in (*one.beads, *one.films)), default=1)


class Session:
    """Instruments that talk until they are closed.

    Parameters
    ----------
    kinds : iterable of str
        Of `KINDS`; one that is named twice is there twice.
    worlds : sequence
        Of each probe that they read, with the methods of rig.virtual.instruments.PhysicalWorld and pressure_hpa(at_s).
    folder : Path
        Where the socket and the preload library of I2C instruments are put.

    Attributes
    ----------
    serial : dict
        Instrument's name -> path of its pseudo-terminal.
    addresses : dict
        Kind of I2C instrument -> addresses.
    climate : dict
        "source", "destination", "airflow" of a bench file's [chambers] -> (kind, port).
    environment : dict
        What another program needs in its environment to see the I2C bus.
    """

    def __init__(
        self,
        kinds: Iterable[str],
        worlds: Sequence[Any],
        clock: FastClock,
        folder: Path,
        *,
        unix_s: Callable[[], float],
        truth: Path | None = None,
        options: Options | None = None,
    ) -> None:
        self._options = options or Options()
        instruments = instruments_of(kinds, self._options)
        self._clock = clock
        self._folder = folder
        self.serial: dict[str, str] = {}
        self.addresses: dict[str, list[int]] = {}
        self.environment: dict[str, str] = {}
        self.climate: dict[str, tuple[str, str]] = {}
        self._parts: list[Any] = []
        self.witness = Witness(worlds, unix_s, truth)
        try:
            films = [one for one in instruments if one.kind in I2C_ADDRESSES]
            if films:
                self._plug_i2c(films)
            for one in instruments:
                if one.kind in BAUD:
                    self._plug_serial(one)
            if self._options.chambers is not None:
                self._plug_climate(*self._options.chambers)
        except BaseException:
            self.close()
            raise

    def _faults(self, known: dict[str, str]) -> list[Fault]:
        return [fault for fault in self._options.faults if fault.kind in known]

    def _plug_i2c(self, films: Sequence[Instrument]) -> None:
        places = addresses_of(films, self._options)
        chips = [self._chip(one, places[one.name]) for one in films]
        for one in films:
            self.addresses.setdefault(one.kind, []).append(places[one.name])
        wire: Wire = I2cWire(chips, self._clock)
        if faults := self._faults(I2C_KINDS):
            browns_out = next((chip for chip in chips if isinstance(chip, Hyt271Chip)), None)
            wire = FaultyI2c(wire, faults, self._clock, browns_out, self._options.seed)
        library = self._folder / PRELOAD
        if not library.exists():
            build_preload(library)
        bus = I2cSocket(wire, self._folder / f"i2c-{self._options.bus}.socket")
        self._parts.append(bus)
        self.environment = {"LD_PRELOAD": str(library), f"SHOCKRIG_I2C_{self._options.bus}": str(bus.path)}

    def _chip(self, one: Instrument, address: int) -> Chip:
        humidity, die = (self.witness.sampler(one.kind, quantity, one.films[0], one.name) for quantity in OF_A_FILM)
        return i2c_chip(one.kind, humidity, die, self.witness.pressure_hpa, address)

    def _plug_serial(self, one: Instrument) -> None:
        device: Device = self._carriage() if one.kind == "grbl" else self._unit(one)
        if faults := self._faults(SERIAL_KINDS):
            device = FaultySerial(device, faults, self._clock, self._options.seed)
        pty = PtyDevice(device, self._clock)
        self._parts.append(pty)
        self.serial[one.name] = pty.path

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

    def _unit(self, one: Instrument) -> ImetUnit:
        kind, humid = one.kind, bool(one.films)

        def sample(quantity: str, probes: tuple[int, ...], which: int = 0, line: str = "") -> Callable[[float], float]:
            return self.witness.sampler(kind, quantity, probes[which], one.name + line)

        second_film = None
        if len(one.films) > 1:
            humidity, die = (sample(quantity, one.films, 1, ".17") for quantity in OF_A_FILM)
            second_film = humidity, die
        period_s = 1.0 / (self._options.rate_hz or LINES_HZ[kind])
        return ImetUnit(
            sample("temperature_c", one.beads),
            self.witness.pressure_hpa,
            kind,
            sample("humidity_percent", one.films) if humid else None,
            sample("die_temperature_c", one.films) if humid and kind != "imet-xq" else None,
            period_s=period_s,
            phase_s=self._clock.now() + period_s,
            baud=BAUD[kind],
            second_bead_c=sample("temperature_c", one.beads, 1, ".13") if len(one.beads) > 1 else None,
            second_film=second_film,
        )

    def close(self) -> None:
        for part in self._parts:
            part.close()
        self._parts = []
        self.witness.close()
