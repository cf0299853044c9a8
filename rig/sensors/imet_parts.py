"""The hygrometer that an iMet unit reads itself, as a sensor of its own: it takes what the iMet's lines bring along.

An XF reads a HYT-271; what an XQ or XQ2 has is its maker's own sensor, and is called after the unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from shockrig.rig.errors import BenchError
from shockrig.rig.seams import Parts, Reading
from shockrig.rig.sensors.imet import Imet


@dataclass(frozen=True)
class ImetHumiditySettings:
    """`through` names the iMet sensor of the same bench."""

    through: str = "imet"
    serial: str | None = None
    film_thickness_m: float = 1e-5


class ImetHumidity:
    """Humidity and die temperature out of another sensor's lines."""

    Settings = ImetHumiditySettings
    KIND = "imet-humidity"

    def __init__(self, name: str, settings: ImetHumiditySettings, imet: Imet) -> None:
        self.name = name
        self.settings = settings
        self._imet = imet

    @classmethod
    def build(cls, name: str, settings: ImetHumiditySettings, parts: Parts) -> ImetHumidity:
        imet = parts.sensors.get(settings.through)
        if not isinstance(imet, Imet):
            raise BenchError(f'through = "{settings.through}" names no iMet sensor that stands before it in the file')
        return cls(name, settings, imet)

    def describe(self) -> dict[str, Any]:
        unit = str(self._imet.describe()["kind"])
        kind = "hyt-271" if unit == "imet-xf" else f"{unit}-humidity"
        return {"kind": kind, "serial": self.settings.serial, "film_thickness_m": self.settings.film_thickness_m}

    def open(self) -> None:
        self._imet.keep_humidity(self.name)

    def due_s(self) -> float:
        return -math.inf if self._imet.humidity else math.inf

    def poll(self) -> list[Reading]:
        readings = list(self._imet.humidity)
        self._imet.humidity.clear()
        return readings

    def close(self) -> None:
        pass
