"""What else an iMet unit reads besides its bead, each as a sensor of its own: it takes what the unit's lines bring.

    [sensors.hyt]                     [sensors.imet-2]            [sensors.hyt-2]
    kind = "imet-humidity"            kind = "imet-bead"          kind = "imet-humidity"
                                      line = "13"                 line = "17"

An XF reads HYT-271s and a second bead; what an XQ or XQ2 has is its maker's own sensor, and is called after the unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Parts, Reading
from shockrig.rig.sensors.imet import Imet
from shockrig.rig.sensors.imet_lines import SECOND_BEAD


@dataclass(frozen=True)
class ImetHumiditySettings:
    """`through` names the iMet sensor of the same bench; `line` is the id of the lines that bring the humidity, where
    the unit has more than one film (17 is the second)."""

    through: str = "imet"
    line: str = ""
    serial: str | None = None
    film_thickness_m: float = 1e-5


@dataclass(frozen=True)
class ImetBeadSettings:
    """`through` names the iMet sensor of the same bench; `line` is the id of the second bead's lines."""

    through: str = "imet"
    line: str = SECOND_BEAD
    serial: str | None = None
    bead_radius_m: float = 4e-4


_Settings = TypeVar("_Settings", ImetHumiditySettings, ImetBeadSettings)


class _OfUnit(Generic[_Settings]):
    """One quantity out of another sensor's lines."""

    takes: Mapping[str, str]  # its own quantities, the one that counts first, by what the unit's lines call them

    def __init__(self, name: str, settings: _Settings, imet: Imet) -> None:
        self.name = name
        self.settings: _Settings = settings
        self._imet = imet
        self._readings = imet.keep(name, settings.line, self.takes)

    @classmethod
    def build(cls, name: str, settings: _Settings, parts: Parts) -> Self:
        return cls(name, settings, _unit(settings.through, settings.line, cls.takes, parts))

    def open(self) -> None:
        self._readings.clear()

    def due_s(self) -> float:
        return -math.inf if self._readings else math.inf

    def poll(self) -> list[Reading]:
        readings = list(self._readings)
        self._readings.clear()
        return readings

    def close(self) -> None:
        pass


class ImetHumidity(_OfUnit[ImetHumiditySettings]):
    """Humidity and die temperature out of an iMet's lines."""

    Settings = ImetHumiditySettings
    KIND = "imet-humidity"
    takes = {"humidity_percent": "humidity_percent", "die_temperature_c": "temperature_c"}

    def describe(self) -> dict[str, Any]:
        unit = str(self._imet.describe()["kind"])
        kind = "hyt-271" if unit == "imet-xf" else f"{unit}-humidity"
        return {"kind": kind, "serial": self.settings.serial, "film_thickness_m": self.settings.film_thickness_m}


class ImetBead(_OfUnit[ImetBeadSettings]):
    """Temperature of an iMet's second bead."""

    Settings = ImetBeadSettings
    KIND = "imet-bead"
    takes = {"temperature_c": "temperature_c"}

    def describe(self) -> dict[str, Any]:
        unit = str(self._imet.describe()["kind"])
        return {"kind": unit, "serial": self.settings.serial, "bead_radius_m": self.settings.bead_radius_m}


def _unit(through: str, line: str, takes: Mapping[str, str], parts: Parts) -> Imet:
    """The unit that a sensor takes its readings from. Raises BenchError where it has none of such lines."""
    imet = parts.sensors.get(through)
    if not isinstance(imet, Imet):
        raise BenchError(f'through = "{through}" names no iMet sensor that stands before it in the file')
    quantity = next(iter(takes))
    own = imet.lines_with(quantity)
    if line and line not in own:
        known = ", ".join(own) or "none"
        raise BenchError(
            f'line = "{line}": lines of "{through}" with this id bring no {quantity} (those that do: {known}); '
            "lay them out in its `lines`"
        )
    return imet
