"""Emulated BME280 (Bosch) at the byte level: registers, modes, trimming values; temperature, pressure, humidity.

A driver reads raw counts and reckons with the trimming values of the chip's memory; the counts here are those from
which the data sheet's formulas give back what is measured. Source: Bosch, data sheet BME280 (BST-BME280-DS002, version
1.6), sections 3.3 (modes), 4.2.3 (formulas in floating point), 5 (registers), 9.1 (times); the trimming values of
temperature and pressure are those of the worked example in the BMP280's data sheet (section 3.12).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

Sampler = Callable[[float], float]

CHIP_ID, ID_REGISTER, RESET_REGISTER, RESET_WORD = 0x60, 0xD0, 0xE0, 0xB6
CTRL_HUM, STATUS, CTRL_MEAS, CONFIG, DATA = 0xF2, 0xF3, 0xF4, 0xF5, 0xF7
MEASURING_BIT = 0x08
SLEEP, FORCED, NORMAL = 0, 1, 3  # 2 is forced as well
SKIPPED_20, SKIPPED_16 = 0x80000, 0x8000
STANDBY_S = (0.0005, 0.0625, 0.125, 0.25, 0.5, 1.0, 0.010, 0.020)
FILTERS = (1, 2, 4, 8, 16)
HPA = 100.0


@dataclass(frozen=True)
class Trimming:
    """Trimming values of one chip, dig_T1 to dig_H6."""

    t: tuple[int, int, int] = (27504, 26435, -1000)
    p: tuple[int, int, int, int, int, int, int, int, int] = (
        36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000,
    )  # fmt: skip
    h: tuple[int, int, int, int, int, int] = (75, 362, 0, 313, 50, 30)

    def registers(self) -> dict[int, bytes]:
        """Where they stand: first register -> bytes."""
        h1, h2, h3, h4, h5, h6 = self.h
        packed = bytes((h4 >> 4 & 0xFF, (h4 & 0xF) | (h5 & 0xF) << 4, h5 >> 4 & 0xFF))
        return {
            0x88: struct.pack("<Hhh", *self.t) + struct.pack("<H8h", *self.p),
            0xA1: bytes((h1,)),
            0xE1: struct.pack("<hB", h2, h3) + packed + struct.pack("<b", h6),
        }

    def fine(self, count: int) -> float:
        """Temperature as the other formulas want it."""
        t1, t2, t3 = self.t
        return (count / 16384.0 - t1 / 1024.0) * t2 + (count / 131072.0 - t1 / 8192.0) ** 2 * t3

    def temperature_c(self, count: int) -> float:
        return self.fine(count) / 5120.0

    def pressure_pa(self, count: int, fine: float) -> float:
        p1, p2, p3, p4, p5, p6, p7, p8, p9 = self.p
        a = fine / 2.0 - 64000.0
        b = a * a * p6 / 32768.0 + a * p5 * 2.0
        b = b / 4.0 + p4 * 65536.0
        a = (1.0 + (p3 * a * a / 524288.0 + p2 * a) / 524288.0 / 32768.0) * p1
        pressure = (1048576.0 - count - b / 4096.0) * 6250.0 / a
        return pressure + (p9 * pressure * pressure / 2147483648.0 + pressure * p8 / 32768.0 + p7) / 16.0

    def humidity_percent(self, count: int, fine: float) -> float:
        h1, h2, h3, h4, h5, h6 = self.h
        a = fine - 76800.0
        a = (count - (h4 * 64.0 + h5 / 16384.0 * a)) * (
            h2 / 65536.0 * (1.0 + h6 / 67108864.0 * a * (1.0 + h3 / 67108864.0 * a))
        )
        return min(max(a * (1.0 - h1 * a / 524288.0), 0.0), 100.0)


def count_of(wanted: float, read: Callable[[int], float], bits: int) -> int:
    """The count that reads nearest to what is wanted, of a formula that rises or falls all along."""
    low, high = 0, (1 << bits) - 1
    rises = read(high) > read(low)
    while high - low > 1:
        middle = (low + high) // 2
        if (read(middle) < wanted) == rises:
            low = middle
        else:
            high = middle
    return min((low, high), key=lambda count: abs(read(count) - wanted))


class Bme280Chip:
    """One emulated sensor.

    Parameters
    ----------
    humidity_percent, temperature_c, pressure_hpa : callable
        Film, die and pressure at a time in seconds on the bench clock.
    """

    def __init__(
        self,
        humidity_percent: Sampler,
        temperature_c: Sampler,
        pressure_hpa: Sampler,
        address: int = 0x76,
        trimming: Trimming | None = None,
    ) -> None:
        self._humidity_percent, self._temperature_c, self._pressure_hpa = humidity_percent, temperature_c, pressure_hpa
        self.address, self.powered = address, True
        self.trimming = trimming or Trimming()
        self._reset()

    def _reset(self) -> None:
        self._registers = bytearray(256)
        self._registers[ID_REGISTER] = CHIP_ID
        for first, content in self.trimming.registers().items():
            self._registers[first : first + len(content)] = content
        self._put(SKIPPED_20, SKIPPED_20, SKIPPED_16)
        self._pointer = 0
        self._humidity_setting = 0  # takes hold when CTRL_MEAS is written
        self._due_s: float | None = None  # when the measurement under way ends
        self._smooth: tuple[float, float] | None = None

    def write(self, data: bytes, at_s: float) -> None:
        self._advance(at_s)
        if not data:
            return
        self._pointer = data[0]
        for register, value in zip((data[0], *data[2::2]), data[1::2], strict=False):
            if register == RESET_REGISTER and value == RESET_WORD:
                self._reset()
            elif register in (CTRL_HUM, CONFIG):
                self._registers[register] = value
            elif register == CTRL_MEAS:
                self._registers[register] = value
                self._humidity_setting = self._registers[CTRL_HUM] & 7
                self._due_s = at_s + self._takes_s() if value & 3 else None

    def read(self, length: int, at_s: float) -> bytes:
        self._advance(at_s)
        measuring = self._due_s is not None and at_s >= self._due_s - self._takes_s()
        self._registers[STATUS] = MEASURING_BIT if measuring else 0
        found = bytes(self._registers[(self._pointer + k) & 0xFF] for k in range(length))
        self._pointer = (self._pointer + length) & 0xFF
        return found

    def _oversampling(self) -> tuple[int, int, int]:
        """Of temperature, pressure and humidity; 0 where it is skipped."""
        setting = self._registers[CTRL_MEAS]
        codes = setting >> 5, setting >> 2 & 7, self._humidity_setting
        return tuple(1 << min(code, 5) >> 1 for code in codes)  # type: ignore[return-value]

    def _takes_s(self) -> float:
        """Largest measuring time (section 9.1)."""
        t, p, h = self._oversampling()
        return 1e-3 * (1.25 + 2.3 * t + (2.3 * p + 0.575 if p else 0.0) + (2.3 * h + 0.575 if h else 0.0))

    def _advance(self, at_s: float) -> None:
        """Finish the measurements that have ended by now; of many in a row only the last few matter."""
        mode = self._registers[CTRL_MEAS] & 3
        while self._due_s is not None and at_s >= self._due_s:
            ended_s = self._due_s
            if mode == NORMAL:
                period_s = self._takes_s() + STANDBY_S[self._registers[CONFIG] >> 5]
                passed = int((at_s - ended_s) // period_s) - 4 * FILTERS[-1]
                ended_s += max(passed, 0) * period_s
                self._due_s = ended_s + period_s
            else:
                self._registers[CTRL_MEAS] &= 0xFC
                self._due_s = None
            self._measure(ended_s - self._takes_s() / 2)

    def _measure(self, at_s: float) -> None:
        t, p, h = self._oversampling()
        trimming = self.trimming
        temperature = count_of(self._temperature_c(at_s), trimming.temperature_c, 20)
        fine = trimming.fine(temperature)
        pressure = count_of(HPA * self._pressure_hpa(at_s), lambda count: trimming.pressure_pa(count, fine), 20)
        humidity = count_of(self._humidity_percent(at_s), lambda count: trimming.humidity_percent(count, fine), 16)
        strength = FILTERS[min(self._registers[CONFIG] >> 2 & 7, 4)]
        before = self._smooth or (temperature, pressure)
        self._smooth = (
            before[0] + (temperature - before[0]) / strength,
            before[1] + (pressure - before[1]) / strength,
        )
        self._put(
            round(self._smooth[0]) if t else SKIPPED_20,
            round(self._smooth[1]) if p else SKIPPED_20,
            humidity if h else SKIPPED_16,
        )

    def _put(self, temperature: int, pressure: int, humidity: int) -> None:
        content = b"".join((count << 4).to_bytes(3, "big") for count in (pressure, temperature))
        self._registers[DATA : DATA + 8] = content + humidity.to_bytes(2, "big")
