"""Find what is connected: HYT-271s on I2C buses, iMets and GRBL controllers on serial ports; a bench file from that.

I2C: a HYT-271 is what answers a measurement request with a plausible frame that is fresh once and stale when fetched
again. Serial: listen before writing. A port that speaks is written to only where it said "Grbl"; a port that is silent
at both baud rates gets the one byte `?`, which GRBL answers with `<...|MPos:...>`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from shockrig.files.campaign_names import sensor_name
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Clock, I2cBus, Outcome, SerialPort
from shockrig.rig.sensors.hyt271 import decode_frame
from shockrig.rig.sensors.hyt271_commands import FREE_ADDRESSES
from shockrig.rig.sensors.imet_lines import (
    SECOND,
    SECOND_BEAD,
    SECOND_FILM,
    TABLES,
    LineAssembler,
    LineTable,
    UnknownLine,
    implausible,
)

USUAL_ADDRESS = 0x28
CONVERSION_S = 0.12
BUS_WAIT_S = 2.0
PLAUSIBLE_C = (-45.0, 90.0)
IMET_BAUD, GRBL_BAUD = 57600, 115200
LISTEN_S = 2.6  # an XQ2 speaks once in a second; a GRBL board that opening resets boots within two
REPORT_WITHIN_S = 0.5
LOOK_EVERY_S = 0.02
ENOUGH_LINES = 2
ADAPTER = re.compile(r"/by-id/usb-.*_([A-Za-z0-9]{2,})-if\d+")
BANNER = re.compile(rb"Grbl (\S+)|GrblHAL (\S+)")
PRESSED = re.compile(rb"\|Pn:([A-Z]+)")
REPORT = re.compile(rb"<[A-Z][a-z]*(:\d)?\|[MW]Pos:[^<>\r\n]*>")


@dataclass(frozen=True)
class FoundHyt:
    """A HYT-271 and what it said."""

    bus: str
    address: int
    humidity_percent: float
    temperature_c: float

    def __str__(self) -> str:
        said = f"{self.humidity_percent:.1f} %RH, {self.temperature_c:.1f} degC"
        return f"{self.bus}: HYT-271 at {self.address:#04x} ({said})"


@dataclass(frozen=True)
class FoundImet:
    """An iMet unit; `has_humidity` where its lines bring a HYT-271's humidity along, `second` the ids of the lines of a
    second bead and film."""

    port: str
    kind: str
    baud: int
    temperature_c: float
    has_humidity: bool
    second: tuple[str, ...] = ()

    def __str__(self) -> str:
        film = ", with a HYT-271 of its own" if self.has_humidity else ""
        film += "".join(f", with a second {'bead' if line == SECOND_BEAD else 'film'}" for line in self.second)
        return f"{self.port}: {self.kind} at {self.baud} baud ({self.temperature_c:.1f} degC{film})"


@dataclass(frozen=True)
class FoundGrbl:
    """A GRBL controller; `version` is empty where it did not announce itself, `pins` are the switches that it reports
    as pressed."""

    port: str
    version: str
    pins: str = ""

    def __str__(self) -> str:
        return f"{self.port}: GRBL {self.version}".rstrip()


Found = FoundHyt | FoundImet | FoundGrbl


def scan_i2c(path: str, bus: I2cBus, clock: Clock) -> tuple[list[FoundHyt], str]:
    """HYT-271s on one bus, the usual address first.

    Returns
    -------
    found : list of FoundHyt
    trouble : str
        Why the bus could not be searched; empty where it was.
    """
    try:
        bus.open()
        deadline_s = clock.now() + BUS_WAIT_S
        while not bus.acquire(scan_i2c):
            if clock.now() >= deadline_s:
                return [], "a recording is using it"
            clock.sleep_until(clock.now() + LOOK_EVERY_S)
        found = []
        for address in (USUAL_ADDRESS, *(address for address in FREE_ADDRESSES if address != USUAL_ADDRESS)):
            if address == USUAL_ADDRESS or _reads_like_one(bus, address):
                sensor = _measured(path, bus, clock, address)
                found += [sensor] if sensor else []
        return found, ""
    except OSError as error:
        return [], error.strerror or str(error)
    finally:
        bus.release(scan_i2c)
        bus.close()


def _reads_like_one(bus: I2cBus, address: int) -> bool:
    """Whether a plain read, which asks nothing of the chip, returns what a HYT-271 could say."""
    frame = _read(bus, address)
    return frame is not None and decode_frame(frame)[0] in (Outcome.OK, Outcome.STALE)


def _read(bus: I2cBus, address: int) -> bytes | None:
    try:
        return bus.read(address, 4)
    except OSError:
        return None


def _measured(path: str, bus: I2cBus, clock: Clock, address: int) -> FoundHyt | None:
    """A measurement, if what is at `address` behaves as a HYT-271 does: fresh after a request, then stale and equal."""
    try:
        bus.write(address, b"")
    except OSError:
        try:
            bus.write(address, b"\x00")  # adapters that refuse empty writes
        except OSError:
            return None
    clock.sleep_until(clock.now() + CONVERSION_S)
    fresh, again = _read(bus, address), _read(bus, address)
    if fresh is None or again is None:
        return None
    (first, values), (second, same) = decode_frame(fresh), decode_frame(again)
    if (first, second) != (Outcome.OK, Outcome.STALE) or values != same:
        return None
    if not PLAUSIBLE_C[0] <= values["temperature_c"] <= PLAUSIBLE_C[1]:
        return None
    return FoundHyt(path, address, values["humidity_percent"], values["temperature_c"])


class SerialListener:
    """Listens to one port until it is known what speaks there. Tell `step` the time again and again until `done`."""

    def __init__(self, path: str, make_port: Callable[[str, int], SerialPort], clock: Clock, may_ask: bool) -> None:
        self.path = path
        self.found: FoundImet | FoundGrbl | None = None
        self.trouble = ""
        self.done = False
        self._make_port = make_port
        self._clock = clock
        self._may_ask = may_ask
        self._heard_any = False
        self._asked = False
        self._begin(IMET_BAUD)

    def _begin(self, baud: int) -> None:
        self._baud = baud
        self._heard = b""
        self._until_s = self._clock.now() + LISTEN_S
        self._port = self._make_port(self.path, baud)
        try:
            self._port.open()
        except OSError as error:
            self._end(error.strerror or str(error))

    def _end(self, trouble: str = "") -> None:
        self.trouble, self.done = trouble, True
        self._port.close()

    def step(self) -> None:
        """Look at what has arrived, and go on to the next thing to try when the time for this one is over."""
        try:
            chunk = self._port.read_waiting()
            self._heard_any |= bool(chunk)
            self._heard = (self._heard + chunk)[-10_000:]
            self.found = _recognized(self.path, self._heard, self._baud)
            if isinstance(self.found, FoundGrbl) and self._may_ask and not self._asked:
                # It has said hello: its report shows the switches.
                self._asked, self._until_s = True, self._clock.now() + REPORT_WITHIN_S
                self._port.write(b"?")
            elif isinstance(self.found, FoundGrbl) and self._asked and not REPORT.search(self._heard):
                if self._clock.now() >= self._until_s:
                    self._end()
            elif self.found is not None:
                self._end()
            elif self._clock.now() >= self._until_s:
                self._go_on()
        except OSError as error:
            self._end(error.strerror or str(error))

    def _go_on(self) -> None:
        if self._baud == IMET_BAUD:
            self._port.close()
            self._begin(GRBL_BAUD)
        elif self._heard_any:
            self._end("something speaks that is neither an iMet nor a GRBL controller; nothing was written to it")
        elif self._asked or not self._may_ask:
            self._end("silent")
        else:
            self._asked = True
            self._until_s = self._clock.now() + LISTEN_S
            self._port.write(b"?")


def scan_serial(
    paths: Iterable[str], make_port: Callable[[str, int], SerialPort], clock: Clock, *, may_ask: bool = True
) -> list[SerialListener]:
    """Listen to all ports at once.

    Parameters
    ----------
    make_port : callable
        (path, baud) -> port, not opened yet.
    may_ask : bool
        Whether a port that stays silent gets the byte `?`.

    Returns
    -------
    list of SerialListener
        Each done, with `found` or with `trouble`.
    """
    listeners = [SerialListener(path, make_port, clock, may_ask) for path in paths]
    while waiting := [listener for listener in listeners if not listener.done]:
        clock.sleep_until(clock.now() + LOOK_EVERY_S)
        for listener in waiting:
            listener.step()
    return listeners


def _recognized(path: str, heard: bytes, baud: int) -> FoundImet | FoundGrbl | None:
    banner = BANNER.search(heard)
    report = REPORT.search(heard)
    if banner is not None or report is not None:
        version = "" if banner is None else (banner[1] or banner[2]).decode("ascii", "replace")
        pressed = None if report is None else PRESSED.search(report[0])
        return FoundGrbl(path, version, "" if pressed is None else pressed[1].decode())
    best = max((_as_imet(heard, kind) for kind in TABLES), key=lambda lines: len(lines[1]))
    kind, lines = best
    own = [values for key, values in lines if key not in SECOND]
    temperatures_c = [values["temperature_c"] for values in own if "temperature_c" in values]
    if len(temperatures_c) < ENOUGH_LINES:
        return None
    second = tuple(line for line in SECOND if any(key == line for key, _ in lines))
    return FoundImet(path, kind, baud, temperatures_c[-1], any("humidity_percent" in line for line in own), second)


def _as_imet(heard: bytes, kind: str) -> tuple[str, list[tuple[str, dict[str, float]]]]:
    """The lines that a kind's table can read, with plausible values: their ids and what they say."""
    table = LineTable.of(TABLES[kind])
    good = []
    for line in LineAssembler(table.begins()).feed(heard, 0.0, 0.0):
        try:
            key, values = table.parse(line.raw.replace(b"\0", b""))
        except (UnknownLine, ValueError):
            continue
        if line.whole and not implausible(values):
            good.append((key, values))
    return kind, good


def _grbl_lines(stage: FoundGrbl) -> list[str]:
    pressed = (
        " # pressed now" if stage.pins else ' # SET: "X" where there is a switch at each end (none is pressed now)'
    )
    return [
        'kind = "grbl"',
        f"port = {_quoted(stage.port)}",
        "source_mm = 0.0 # SET: machine positions of the two ends; this is a short, slow move until you have",
        "destination_mm = -10.0 # SET",
        "feed_mm_min = 600.0 # SET",
        f'limit_pin = "{stage.pins[:1]}"{pressed}',
        "home = true # SET: false where the machine has no homing switches",
    ]


def bench_toml(found: Iterable[Found], name: str = "found by scan") -> str:
    """A bench file to start from; what cannot be known is marked SET.

    Raises
    ------
    BenchError
        No sensor was found: a bench without one records nothing.
    """
    found = list(found)
    imets = [item for item in found if isinstance(item, FoundImet)]
    films = [item for item in found if isinstance(item, FoundHyt)]
    stages = [item for item in found if isinstance(item, FoundGrbl)]
    if not imets and not films:
        raise BenchError("found no sensor, so there is nothing to write a bench file from; check supply and cables")
    lines = [
        "# Written by shockrig scan. Go through the lines marked SET, then: shockrig check standard --bench THIS_FILE",
        *("# found " + "".join(c if c.isprintable() else "?" for c in str(item)) for item in found),
        "",
        "[bench]",
        f"name = {_quoted(name)}",
        "pressure_hpa = 1013.25 # SET: of the laboratory, on the day",
    ]
    beads, through = 0, list[tuple[int, str, str]]()  # a unit's film is of the probe that its bead is of
    for imet in imets:
        beads += 1
        unit = sensor_name("imet", str(beads))
        through += [(beads, unit, "")] * imet.has_humidity
        lines += ["", f"[sensors.{unit}]"]
        lines += [f"kind = {_quoted(imet.kind)}", f"port = {_quoted(imet.port)}"]
        lines += [f"baud = {imet.baud}"] if imet.baud != IMET_BAUD else []
        lines += [_serial_line(imet.port)]
        beads += bool(imet.second)
        if SECOND_BEAD in imet.second:
            lines += ["", f"[sensors.{sensor_name('imet', str(beads))}]"]
            lines += ['kind = "imet-bead" # the second bead of the unit', f"through = {_quoted(unit)}"]
        through += [(beads, unit, SECOND_FILM)] * (SECOND_FILM in imet.second)
    reference = films[beads or 1 :][:1]  # one film to a bead; what is left over is better kept
    for number, film in enumerate((film for film in films if film not in reference), start=1):
        lines += ["", f"[sensors.{sensor_name('hyt', str(number))}]", *_hyt_lines(film)]
        lines += ['# serial = "H00000" # SET: the chip tells none over its bus; choose one and write it on the sensor']
    for number, unit, line in () if films else through:
        lines += ["", f"[sensors.{sensor_name('hyt', str(number))}]"]
        lines += ['kind = "imet-humidity" # the hygrometer that the iMet reads itself', f"through = {_quoted(unit)}"]
        lines += [f"line = {_quoted(line)} # the second one"] if line else []
    lines += ["", "[stage]", *(_grbl_lines(stages[0]) if stages else ['kind = "manual"']), "", "[reference]"]
    if reference:
        lines += [*_hyt_lines(reference[0]), 'air = "probes" # SET: or "source", "destination"']
    else:
        lines += ['kind = "operator" # both airs are typed in; "set-points" takes them from the protocol']
    return "\n".join(lines) + "\n"


def _serial_line(port: str) -> str:
    """The number of the unit's USB adapter, where the port's lasting name has it, or a line to fill in."""
    adapter = ADAPTER.search(port)
    if adapter is None:
        return '# serial = "X00000" # SET: printed on the unit'
    return f"serial = {_quoted(adapter[1])} # of its USB adapter; the one printed on the unit may stand here as well"


def _hyt_lines(film: FoundHyt) -> list[str]:
    number = re.fullmatch(r"/dev/i2c-(\d+)", film.bus)
    bus = number[1] if number else _quoted(film.bus)
    return ['kind = "hyt-271"', f"bus = {bus}", f"address = {film.address:#04x}"]


def _quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'
