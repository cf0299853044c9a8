"""Emulated iMet-XF, XQ2 and XQ units: ASCII lines at their own pace, sampled from one world. 57600 8N1, CRLF.

The bead: Steinhart-Hart, 1/T = A + B ln R + C (ln R)^3, with the generic coefficients of oucass/Profiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from shockrig.rig.virtual.serial_line import OutputQueue

Sampler = Callable[[float], float]

A, B, C = 1.01118217e-3, 2.61666421e-4, 1.50184525e-7


def bead_resistance_ohm(temperature_c: float) -> float:
    """Resistance of the NTC bead: the real root of the cubic in ln R."""
    y = (A - 1 / (temperature_c + 273.15)) / (2 * C)
    x = math.sqrt((B / (3 * C)) ** 3 + y * y)
    return math.exp(math.cbrt(x - y) - math.cbrt(x + y))


def _bead(key: bytes, temperature_c: Sampler, at_s: float) -> bytes:
    value = temperature_c(at_s)
    return b"%s,%d,%d" % (key, round(100 * value), round(bead_resistance_ohm(value)))


def _film(key: bytes, humidity_percent: Sampler, die_temperature_c: Sampler, at_s: float) -> bytes:
    return b"%s,%d,%d" % (key, round(10 * humidity_percent(at_s)), round(100 * die_temperature_c(at_s)))


class ImetUnit:
    """One emulated unit; a serial Device.

    Parameters
    ----------
    temperature_c : callable
        The bead at a time in seconds on the bench clock.
    humidity_percent, die_temperature_c : callable or None
        The unit's own HYT-271; None where it has none (an XF may, an XQ always does).
    pressure_hpa : callable
    kind : "imet-xf", "imet-xq2" or "imet-xq"
    second_bead_c, second_film : callable or None, pair of callables or None
        Of an XF: its NTC B (lines with 13), and humidity and die of its HYT-271 B (17).
    period_s, phase_s : float
        When it measures, on the bench clock; a line leaves at once. The XF's board and GPS lines come once in ten.
    lost : callable
        Whether the lines of a measurement are lost, asked once for each.
    """

    def __init__(
        self,
        temperature_c: Callable[[float], float],
        pressure_hpa: Callable[[float], float],
        kind: str = "imet-xf",
        humidity_percent: Callable[[float], float] | None = None,
        die_temperature_c: Callable[[float], float] | None = None,
        period_s: float = 0.1,
        phase_s: float = 0.0,
        baud: int = 57600,
        lost: Callable[[], bool] = lambda: False,
        second_bead_c: Sampler | None = None,
        second_film: tuple[Sampler, Sampler] | None = None,
    ) -> None:
        self._temperature_c = temperature_c
        self._humidity_percent = humidity_percent
        self._die_temperature_c = die_temperature_c
        self._pressure_hpa = pressure_hpa
        self._second_bead_c = second_bead_c
        self._second_film = second_film
        self._make = self._xf if kind == "imet-xf" else self._xq
        self._with_die = kind == "imet-xq2"
        self.period_s = period_s
        self._phase_s = phase_s
        self._lost = lost
        self._sequence = 0
        self._queue = OutputQueue(10 / baud)
        self._shortest = 0  # first line up to now: somebody should look after that, the rest follows
        self.byte_s = 10 / baud

    def _next_sample_s(self) -> float:
        return self._phase_s + self._sequence * self.period_s

    def output(self, until_s: float) -> bytes:
        while self._next_sample_s() <= until_s:
            at_s = self._next_sample_s()
            lines = [line + b"\r\n" for line in self._make(at_s)]
            self._shortest = min(len(lines[0]), self._shortest or len(lines[0]))
            for line in () if self._lost() else lines:
                self._queue.send(line, at_s)
            self._sequence += 1
        return self._queue.output(until_s)

    def next_output_s(self) -> float:
        return min(self._queue.next_output_s(), self._next_sample_s() + self._shortest * self.byte_s)

    def receive(self, data: bytes, at_s: float) -> None:
        """The units take no commands that are known."""

    def _xf(self, at_s: float) -> list[bytes]:
        lines = [_bead(b"5", self._temperature_c, at_s)]
        if self._humidity_percent is not None and self._die_temperature_c is not None:
            lines.append(_film(b"8", self._humidity_percent, self._die_temperature_c, at_s))
        if self._second_bead_c is not None:
            lines.append(_bead(b"13", self._second_bead_c, at_s))
        if self._second_film is not None:
            lines.append(_film(b"17", *self._second_film, at_s))
        if self._sequence % 10 == 0:
            lines.append(b"0,%d,2500,4000,2500" % round(100 * self._pressure_hpa(at_s)))
            lines.append(b"3,2015/10/18,00:00:00,0,0,0,0")
        return lines

    def _xq(self, at_s: float) -> list[bytes]:
        fields = [
            b"XQ",
            b"%+07d" % round(100 * self._pressure_hpa(at_s)),
            b"%+05d" % round(100 * self._temperature_c(at_s)),
            b"%+05d" % round(10 * (self._humidity_percent(at_s) if self._humidity_percent else 0.0)),
        ]
        if self._with_die:
            fields.append(b"%+05d" % round(100 * (self._die_temperature_c(at_s) if self._die_temperature_c else 0.0)))
        fields += [b"2015/10/18", b"00:38:44", b"+0000000000", b"+0000000000", b"-00017000", b"00"]
        return [b",".join(fields)]
