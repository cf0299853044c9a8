"""The seams of the bench: small Protocols that real hardware and the virtual bench both stand behind.

bus (bytes in, bytes out) -> sensor (readings) ; stage (moves the probes) ; reference (what the airs are) ; clock
(time). Everything runs in one thread as a loop over what is due next, so that a virtual clock can run an hour in a
second.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol


class Outcome(enum.StrEnum):
    """What came of asking a sensor; never a repeated last value."""

    OK = "ok"
    STALE = "stale"
    COMMAND_MODE = "command_mode"
    NOT_ACKNOWLEDGED = "not_acknowledged"
    TIMED_OUT = "timed_out"
    IMPLAUSIBLE = "implausible"
    REJECTED = "rejected"  # a serial line that could not be read; the raw bytes are kept


@dataclass(frozen=True)
class Reading:
    """One answer of one sensor.

    `requested_s` and `time_s` are on the bench clock: when the measurement was asked for (for a sensor that talks by
    itself: when its line began to arrive) and when the answer came. `sampled_s` is the driver's best estimate of when
    the quantity itself was measured: it is what the time_s of a recording should be. `values` maps names with units
    ("temperature_c", "humidity_percent") to numbers and is empty unless the outcome is OK or STALE (a stale value is
    true, but was fetched before, or its time is not known).
    """

    sensor: str
    outcome: Outcome
    requested_s: float
    time_s: float
    values: Mapping[str, float] = field(default_factory=dict)
    raw: bytes = b""
    sampled_s: float | None = None


@dataclass(frozen=True)
class Air:
    """Air at one position of the stage. None where it is not known."""

    temperature_c: float | None
    humidity_percent: float | None


def known(value: float | None) -> float:
    """A quantity of an air where it has to be known; ValueError where it is not."""
    if value is None:
        raise ValueError("a temperature or a humidity of the air is not known here")
    return value


@dataclass(frozen=True)
class Move:
    """A finished transfer, on the bench clock; `end_s` is None where the arrival is not measured."""

    start_s: float
    end_s: float | None


class Clock(Protocol):
    """Monotonic seconds."""

    def now(self) -> float: ...

    def sleep_until(self, time_s: float) -> None: ...


class I2cBus(Protocol):
    """One I2C bus. Errors are OSError with the adapter's errno.

    Neither library nor kernel locks a bus between a measurement request and its fetch, so that an owner acquires the
    bus for the whole exchange; `acquire` returns False at once where somebody else, in this process or another, has
    it.
    """

    def open(self) -> None:
        """Open the bus, or open it anew after the adapter was unplugged."""
        ...

    def acquire(self, owner: object) -> bool: ...

    def release(self, owner: object) -> None: ...

    def write(self, address: int, data: bytes) -> None: ...

    def read(self, address: int, length: int) -> bytes: ...

    def close(self) -> None: ...


class SerialPort(Protocol):
    """One serial port. `read_waiting` returns at once with whatever has arrived (b"" if nothing)."""

    byte_s: float  # how long one byte takes on the wire

    def open(self) -> None:
        """Open the port, or open it anew after the device was unplugged."""
        ...

    def due_s(self) -> float:
        """When to look next: real ports are looked at again and again, an emulated one knows when its bytes come."""
        ...

    def read_waiting(self) -> bytes: ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class Sensor(Protocol):
    """A sensor is polled when it is due; a poll never blocks for longer than one bus transaction."""

    name: str

    def describe(self) -> dict[str, Any]:
        """Its entry in campaign.json: kind, serial number, the length that its diffusivity is quoted for."""
        ...

    def open(self) -> None: ...

    def due_s(self) -> float:
        """When the next poll has something to do, on the bench clock."""
        ...

    def poll(self) -> list[Reading]: ...

    def close(self) -> None: ...


class Operator(Protocol):
    """The person at the bench. Nothing that is recorded waits for an answer: requests are looked up, not waited for."""

    def say(self, message: str) -> None: ...

    def ask(self, message: str, check: Callable[[str], str] = ...) -> str:
        """Wait for an answer that `check` finds nothing wrong with (only between recordings); a go-ahead by default.

        Raises what the person decides instead (rig.errors: RunDecision, CampaignPaused, CampaignAborted).
        """
        ...

    def request(self, message: str, within_s: float) -> None:
        """Ask for a confirmation and return at once."""
        ...

    def leave(self) -> None:
        """Take back a request that nobody needs to answer any more."""
        ...

    def attend(
        self,
        idle: Callable[[], None],
        asked: Callable[[Any], None],
        noted: Callable[[str], None],
        said: Callable[[str], None],
    ) -> None:
        """Who is told while a campaign is recorded: what to do meanwhile, prompts (None: answered), notes, words."""
        ...

    def confirmed_s(self) -> float | None:
        """When the last request was confirmed, on the bench clock; None until then.

        Raises CampaignPaused where nobody answers in the time that the request allows.
        """
        ...


class Chambers(Protocol):
    """What makes the two airs: a person, or the virtual world."""

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float | None) -> None: ...

    def surround(self, pressure_hpa: float, irradiance_w_m2: float) -> None:
        """Make pressure and light of the runs from now on; called only where the bench file lists any."""
        ...

    def airs(self) -> tuple[Air, Air]:
        """Source and destination air: as the chambers read them, or as they were last asked for."""
        ...

    @property
    def origins(self) -> tuple[str, str]:
        """Of source and destination, whether `airs` are "measured" or a "set point"."""
        ...

    def demand(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Raise BenchError where these airs are beyond what the chambers can make."""
        ...

    def waiting(self) -> str:
        """What has not come near its set point yet; empty where all has, or nobody knows."""
        ...


class SetPointsOnly:
    """The part of `Chambers` where nobody knows more than the set points."""

    origins = ("set point", "set point")

    def demand(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Whatever a person, or an emulated chamber, makes."""

    def waiting(self) -> str:
        """Nobody knows."""
        return ""


class Stage(Protocol):
    """Carries the probes from the source air to the destination air."""

    def open(self) -> None: ...

    def prepare(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Bring the probes into the source air (prompt, home or drive); raises StageError."""
        ...

    def demand_transfer(self, duration_s: float) -> None:
        """Raise BenchError where the probes cannot be carried this slowly, or this fast."""
        ...

    def begin_transfer(self, duration_s: float | None = None) -> None:
        """Start the move and return; as fast as the stage goes where no duration is given [s]."""
        ...

    def due_s(self) -> float: ...

    def poll(self) -> Move | None:
        """The finished transfer, once it is known that it has ended; raises StageError on alarm, stall or time-out."""
        ...

    def make_safe(self) -> None: ...

    def close(self) -> None: ...


class Reference(Protocol):
    """What the airs are, from instruments better than the probes, or from a person.

    `origins` says of source and destination how each is known: "measured", "typed" or "set point".
    """

    @property
    def origins(self) -> tuple[str, str]: ...

    def open(self) -> None: ...

    def due_s(self) -> float: ...

    def poll(self) -> list[Reading]: ...

    def source(self) -> Air: ...

    def destination(self) -> Air: ...

    def close(self) -> None: ...


class Parts(Protocol):
    """What a back end's `build` may ask for: the bench's clock and people, buses by name, sensors built before it."""

    @property
    def kind(self) -> str:
        """The kind that the bench file names, where one back end serves several."""
        ...

    @property
    def clock(self) -> Clock: ...

    @property
    def operator(self) -> Operator: ...

    @property
    def chambers(self) -> Chambers: ...

    @property
    def sensors(self) -> Mapping[str, Sensor]: ...

    def i2c(self, bus: int | str) -> I2cBus:
        """The bus with this number or device file."""
        ...

    def serial(self, port: str, baud: int) -> SerialPort:
        """The serial port with this name."""
        ...

    def climate(self, port: str, protocol: str) -> str:
        """Where a chamber or fan is reached; "virtual" is an emulated one that speaks `protocol` ("scpi", "modbus")."""
        ...


class Backend(Protocol):
    """A sensor's, stage's or reference's class as the bench file finds it: settings, and how it is built from them.

    `Settings` is a frozen dataclass whose fields are the keys of the part's section in the bench file.
    """

    Settings: Any

    def build(self, name: str, settings: Any, parts: Parts) -> Any: ...
