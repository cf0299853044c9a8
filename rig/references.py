"""References: what the two airs are. Set points of the chambers, numbers a person reads off, or a second HYT-271."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from shockrig.files.ranges import RANGES, Range
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air, Chambers, Operator, Parts, Reading
from shockrig.rig.sensors.hyt271 import Hyt271, Hyt271Settings, bus_of

NEVER_S = math.inf


class _NothingToAsk:
    """A reference that has no instrument of its own."""

    def open(self) -> None:
        pass

    def due_s(self) -> float:
        return NEVER_S

    def poll(self) -> list[Reading]:
        return []

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class SetPointsSettings:
    """No settings: the airs are what the chambers say they are."""


class SetPoints(_NothingToAsk):
    """The two airs as the chambers report them, or as they were asked for where they cannot report."""

    Settings = SetPointsSettings

    def __init__(self, chambers: Chambers) -> None:
        self._chambers = chambers

    @classmethod
    def build(cls, name: str, settings: SetPointsSettings, parts: Parts) -> SetPoints:
        return cls(parts.chambers)

    @property
    def origins(self) -> tuple[str, str]:
        """As the chambers know them."""
        return self._chambers.origins

    def source(self) -> Air:
        return self._chambers.airs()[0]

    def destination(self) -> Air:
        return self._chambers.airs()[1]


@dataclass(frozen=True)
class OperatorEntrySettings:
    """No settings: the operator is asked."""


class OperatorEntry(_NothingToAsk):
    """A person reads both airs off instruments of their own, once for each run, before its recording begins."""

    Settings = OperatorEntrySettings
    origins = ("typed", "typed")

    def __init__(self, chambers: Chambers, operator: Operator) -> None:
        self._chambers = chambers
        self._operator = operator
        self._asked_for: tuple[Air, Air] | None = None
        self._entered = (Air(None, None), Air(None, None))

    @classmethod
    def build(cls, name: str, settings: OperatorEntrySettings, parts: Parts) -> OperatorEntry:
        return cls(parts.chambers, parts.operator)

    def source(self) -> Air:
        return self._airs()[0]

    def destination(self) -> Air:
        return self._airs()[1]

    def _airs(self) -> tuple[Air, Air]:
        asked_for = self._chambers.airs()
        if asked_for is not self._asked_for:
            self._entered = self._enter("source", asked_for[0]), self._enter("destination", asked_for[1])
            self._asked_for = asked_for
        return self._entered

    def _enter(self, place: str, expected: Air) -> Air:
        return Air(
            self._number(f"{place} air, temperature in degC", expected.temperature_c, RANGES["temperature_c"]),
            self._number(f"{place} air, relative humidity in %", expected.humidity_percent, RANGES["humidity_percent"]),
        )

    def _number(self, what: str, expected: float | None, possible: Range) -> float | None:
        proposal = "unknown" if expected is None else f"{expected:g}"

        def check(answer: str) -> str:
            return "" if not answer or possible.holds(_value(answer)) else f"{answer!r} is not a number from {possible}"

        answer = self._operator.ask(f"{what} [Enter for {proposal}]:", check)
        return _value(answer) if answer else expected


def _value(answer: str) -> float:
    try:
        return float(answer.replace(",", "."))
    except ValueError:
        return math.nan


@dataclass(frozen=True)
class Hyt271ReferenceSettings(Hyt271Settings):
    """A HYT-271 as reference: it stands in the "source" or the "destination" air, or travels with the "probes".

    The air is the mean over the last `mean_s`. An air where it never is comes from the chambers' set points.
    """

    air: str = "probes"
    mean_s: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.air not in ("source", "destination", "probes"):
            raise BenchError(f'air = "{self.air}" must be "source", "destination" or "probes"')


class Hyt271Reference:
    """A second HYT-271, better calibrated or better kept than the one on trial."""

    Settings = Hyt271ReferenceSettings

    def __init__(self, settings: Hyt271ReferenceSettings, sensor: Hyt271, chambers: Chambers) -> None:
        self._settings = settings
        self._sensor = sensor
        self._chambers = chambers
        self._recent: deque[Reading] = deque()

    @classmethod
    def build(cls, name: str, settings: Hyt271ReferenceSettings, parts: Parts) -> Hyt271Reference:
        return cls(settings, Hyt271("reference", settings, bus_of(settings, parts), parts.clock), parts.chambers)

    @property
    def origins(self) -> tuple[str, str]:
        """An air where it never is comes from the chambers."""
        source, destination = self._chambers.origins
        match self._settings.air:
            case "source":
                return "measured", destination
            case "destination":
                return source, "measured"
        return "measured", "measured"

    def open(self) -> None:
        self._sensor.open()

    def due_s(self) -> float:
        return self._sensor.due_s()

    def poll(self) -> list[Reading]:
        readings = self._sensor.poll()
        self._recent += [reading for reading in readings if reading.outcome == "ok"]
        while self._recent and self._recent[0].time_s < self._recent[-1].time_s - self._settings.mean_s:
            self._recent.popleft()
        return readings

    def source(self) -> Air:
        return self._chambers.airs()[0] if self._settings.air == "destination" else self._mean()

    def destination(self) -> Air:
        return self._chambers.airs()[1] if self._settings.air == "source" else self._mean()

    def _mean(self) -> Air:
        if not self._recent:
            return Air(None, None)
        count = len(self._recent)
        return Air(
            sum(reading.values["temperature_c"] for reading in self._recent) / count,
            sum(reading.values["humidity_percent"] for reading in self._recent) / count,
        )

    def close(self) -> None:
        self._sensor.close()
