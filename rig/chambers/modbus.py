"""A chamber or fan that speaks Modbus, TCP or RTU (pymodbus): each quantity is a register, a signed number of 16 bits.

write register 0 <- 400, read it back, and input register 0 -> 399: 40.0 and 39.9 degC at a scale of 0.1
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlsplit

from shockrig.rig.bench_errors import BenchError, BusError
from shockrig.rig.chambers.limits import Limits
from shockrig.rig.seams import Parts

NO_REGISTER = -1


@dataclass(frozen=True, kw_only=True)
class ModbusSettings(Limits):
    """`port` is "tcp://192.168.0.21:502" or, for RTU, a serial port such as "/dev/ttyUSB2".

    Registers are counted from 0; -1 where the device has none. Set points are holding registers, readings input
    registers unless `read_from` is "holding". `run` gets 1 to start and 0 to stop.
    """

    port: str
    unit: int = 1
    set_temperature: int = NO_REGISTER
    set_humidity: int = NO_REGISTER
    set_airflow: int = NO_REGISTER
    read_temperature: int = NO_REGISTER
    read_humidity: int = NO_REGISTER
    read_airflow: int = NO_REGISTER
    run: int = NO_REGISTER
    read_from: str = "input"
    scale_temperature: float = 0.1
    scale_humidity: float = 0.1
    scale_airflow: float = 0.01
    baud: int = 19200
    parity: str = "E"
    reply_s: float = 2.0

    def __post_init__(self) -> None:
        self.demand_order()
        if self.read_from not in ("input", "holding"):
            raise BenchError(f'read_from = "{self.read_from}" must be "input" or "holding"')
        if self.parity not in ("N", "E", "O"):
            raise BenchError(f'parity = "{self.parity}" must be "N", "E" or "O"')
        if not 0 <= self.unit <= 247:
            raise BenchError(f"unit = {self.unit} must be from 0 to 247")
        for kind in ("set", "read"):
            for quantity in ("temperature", "humidity", "airflow"):
                if not NO_REGISTER <= getattr(self, f"{kind}_{quantity}") <= 0xFFFF:
                    raise BenchError(f"{kind}_{quantity} must be a register from 0 to 65535, or -1 for none")
        for quantity in ("temperature", "humidity", "airflow"):
            if not getattr(self, f"scale_{quantity}") > 0:
                raise BenchError(f"scale_{quantity} must be positive")


class ModbusDevice:
    """A chamber or fan of registers."""

    Settings = ModbusSettings

    def __init__(self, name: str, settings: ModbusSettings) -> None:
        self.name = name
        self.settings = settings
        self._client: Any = None

    @classmethod
    def build(cls, name: str, settings: ModbusSettings, parts: Parts) -> ModbusDevice:
        return cls(name, replace(settings, port=parts.climate(settings.port, "modbus")))

    def open(self) -> None:
        """Connect, and read one register: an open port alone says nothing of the device."""
        try:
            from pymodbus.client import ModbusSerialClient, ModbusTcpClient
        except ImportError:
            raise BusError(f"{self.name}: Modbus needs pymodbus: pip install 'shockrig[chambers]'") from None
        settings = self.settings
        if settings.port.startswith("tcp://"):
            try:
                where = urlsplit(settings.port)
                host, port = where.hostname or "", where.port or 502
            except ValueError as error:
                raise BusError(f"{self.name}: port {settings.port!r}: {error}; write tcp://HOST:PORT") from None
            self._client = ModbusTcpClient(host, port=port, timeout=settings.reply_s, retries=1)
        else:
            self._client = ModbusSerialClient(
                settings.port, baudrate=settings.baud, parity=settings.parity, timeout=settings.reply_s, retries=1
            )
        if not self._ask(self._client.connect):
            raise self._lost("no connection")
        for quantity in ("temperature", "humidity", "airflow"):
            if self._register("read", quantity) != NO_REGISTER:
                self.get(quantity)
                break

    def has(self, quantity: str) -> bool:
        """Whether it has a register for that."""
        return self._register("set", quantity) != NO_REGISTER

    def set(self, quantity: str, value: float) -> None:
        """Write a set point and read it back: a device may clip in silence."""
        register, number = self._register("set", quantity), round(value / self._scale(quantity))
        if not -0x8000 <= number <= 0x7FFF:
            raise BusError(f"{self.name}: {quantity} {value:g} does not fit its register; check scale_{quantity}")
        self._demand(self._ask(self._client.write_register, register, number & 0xFFFF), f"register {register}")
        taken = self._read("holding", register)
        if taken != number:
            raise BusError(
                f"{self.name} was asked for {quantity} {value:g} and took {taken * self._scale(quantity):g}; "
                "check its own limits and the bench file"
            )

    def start(self) -> None:
        """Switch it on."""
        self._switch(1)

    def get(self, quantity: str) -> float | None:
        """What its register says."""
        register = self._register("read", quantity)
        return (
            None if register == NO_REGISTER else self._read(self.settings.read_from, register) * self._scale(quantity)
        )

    def close(self) -> None:
        """Switch it off, where it is there to hear it."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._switch(0)
            with contextlib.suppress(Exception):
                self._client.close()
            self._client = None

    def _switch(self, on: int) -> None:
        if self.settings.run != NO_REGISTER:
            self._demand(self._ask(self._client.write_register, self.settings.run, on), f"register {self.settings.run}")

    def _register(self, kind: str, quantity: str) -> int:
        return int(getattr(self.settings, f"{kind}_{quantity}"))

    def _scale(self, quantity: str) -> float:
        return float(getattr(self.settings, f"scale_{quantity}"))

    def _read(self, place: str, register: int) -> int:
        read = self._client.read_input_registers if place == "input" else self._client.read_holding_registers
        answer = self._ask(read, register, count=1)
        self._demand(answer, f"{place} register {register}")
        number = int(answer.registers[0])
        return number - 0x10000 if number & 0x8000 else number

    def _ask(self, request: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        if arguments:
            named["device_id"] = self.settings.unit
        try:
            return request(*arguments, **named)
        except Exception as error:  # pymodbus has a tree of its own beside OSError
            raise self._lost(error) from error

    def _demand(self, answer: Any, what: str) -> None:
        if answer.isError():
            raise BusError(f"{self.name} refuses {what} ({answer}); check the registers in the bench file")

    def _lost(self, error: object) -> BusError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return BusError(
            f"{self.name} does not answer at {self.settings.port} ({reason}): check its cable, supply and port"
        )
