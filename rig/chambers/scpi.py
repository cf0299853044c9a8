"""A chamber or fan that speaks SCPI, or any protocol of text lines, over VISA (pyvisa with pyvisa-py: TCP/IP, serial).

    SOUR:TEMP 40.00 / SYST:ERR? -> 0,"No error" / MEAS:TEMP? -> 39.87

No standard names a chamber's commands: each is a setting, with {} where the number goes, as the device's manual has it.
"""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from typing import Any

from shockrig.rig.bench_errors import BenchError, BusError
from shockrig.rig.chambers.limits import Limits
from shockrig.rig.seams import Parts

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

NOT_A_NUMBER = 9.9e37  # SCPI-99, 7.2.1: infinities and NaN are numbers from there on


@dataclass(frozen=True, kw_only=True)
class ScpiSettings(Limits):
    """`port` is a VISA resource: "TCPIP::192.168.0.20::5025::SOCKET" or "ASRL/dev/ttyUSB2::INSTR".

    A command that the device does not have is "".
    `error` asks for the last error after every command; an answer that does not begin with `no_error` is one.
    """

    port: str
    set_temperature: str = "SOUR:TEMP {:.2f}"
    set_humidity: str = "SOUR:HUM {:.1f}"
    set_airflow: str = "SOUR:FLOW {:.2f}"
    read_temperature: str = "MEAS:TEMP?"
    read_humidity: str = "MEAS:HUM?"
    read_airflow: str = "MEAS:FLOW?"
    start: str = "OUTP ON"
    stop: str = "OUTP OFF"
    error: str = "SYST:ERR?"
    no_error: str = "0"
    line_end: str = "\n"
    baud: int = 9600
    reply_s: float = 2.0

    def __post_init__(self) -> None:
        self.demand_order()
        for name in ("set_temperature", "set_humidity", "set_airflow"):
            command = getattr(self, name)
            try:
                numbered = not command or command.format(1.0) != command.format(2.0)
            except (ValueError, IndexError, KeyError):
                numbered = False
            if not numbered:
                raise BenchError(
                    f'{name} = {command!r}: write {{}} once where the number goes, such as "TEMP {{:.1f}}"'
                )


class ScpiDevice:
    """A chamber or fan of text lines."""

    Settings = ScpiSettings

    def __init__(self, name: str, settings: ScpiSettings) -> None:
        self.name = name
        self.settings = settings
        self._resource: Any = None

    @classmethod
    def build(cls, name: str, settings: ScpiSettings, parts: Parts) -> ScpiDevice:
        port = parts.climate(settings.port, "scpi")
        return cls(name, settings if port == settings.port else _with_port(settings, port))

    def open(self) -> None:
        """Connect, and forget errors from before."""
        try:
            import pyvisa
        except ImportError:
            raise BusError(f"{self.name}: SCPI needs pyvisa and pyvisa-py: pip install 'shockrig[chambers]'") from None
        settings = self.settings
        try:
            resource: Any = pyvisa.ResourceManager("@py").open_resource(settings.port)
            resource.read_termination = resource.write_termination = settings.line_end
            resource.timeout = 1000 * settings.reply_s
            if settings.port.upper().startswith("ASRL"):
                resource.baud_rate = settings.baud
        except Exception as error:  # pyvisa's own classes, its back end's, ValueError: of whatever is not there
            raise self._lost(error) from error
        self._resource = resource
        self._demand_no_error("connecting", forget=True)

    def has(self, quantity: str) -> bool:
        """Whether it has a command for that."""
        return bool(getattr(self.settings, f"set_{quantity}"))

    def set(self, quantity: str, value: float) -> None:
        """Ask for a value, and for what the device makes of it."""
        command = getattr(self.settings, f"set_{quantity}").format(value)
        self._write(command)
        self._demand_no_error(command)

    def start(self) -> None:
        """Switch it on."""
        if self.settings.start:
            self._write(self.settings.start)
            self._demand_no_error(self.settings.start)

    def get(self, quantity: str) -> float | None:
        """The number in its answer."""
        command = getattr(self.settings, f"read_{quantity}")
        if not command:
            return None
        answer = self._query(command)
        found = NUMBER.search(answer)
        if found is None:
            raise BusError(
                f"{self.name} answers {answer[:60]!r} to {command!r}, which is no number; check read_{quantity}"
            )
        value = float(found[0])
        return value if abs(value) < NOT_A_NUMBER else None

    def close(self) -> None:
        """Switch it off, where it is there to hear it."""
        if self._resource is not None:
            with contextlib.suppress(OSError):
                if self.settings.stop:
                    self._write(self.settings.stop)
            with contextlib.suppress(Exception):
                self._resource.close()
            self._resource = None

    def _demand_no_error(self, command: str, forget: bool = False) -> None:
        if not self.settings.error:
            return
        for _ in range(20):  # a queue of old errors has an end
            answer = self._query(self.settings.error).strip()
            if answer.startswith(self.settings.no_error):
                return
            if not forget:
                raise BusError(f"{self.name} refuses {command!r}: {answer[:80]}; check the bench file and its limits")
        raise BusError(
            f"{self.name} answers {answer[:80]!r} to {self.settings.error!r} without end; check error, no_error"
        )

    def _write(self, line: str) -> None:
        try:
            self._resource.write(line)
        except Exception as error:
            raise self._lost(error) from error

    def _query(self, line: str) -> str:
        try:
            return str(self._resource.query(line))
        except Exception as error:
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> BusError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return BusError(
            f"{self.name} does not answer at {self.settings.port} ({reason}): check its cable, supply and port"
        )


def _with_port(settings: ScpiSettings, port: str) -> ScpiSettings:
    from dataclasses import replace

    return replace(settings, port=port)
