"""The two airs and the airflow, each made by a device where the bench has one, and by a person where it has none."""

from __future__ import annotations

from collections.abc import Mapping

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.chambers.limits import UNITS, ClimateDevice
from shockrig.rig.seams import Air, Clock, Operator
from shockrig.rig.stages.manual import AskedSurroundings

PLACES = ("source", "destination")
READ_AGAIN_S = 0.5  # readings younger than that are not asked for again


class DeviceChambers:
    """Chambers of the bench file: set at the beginning of a run, read while it soaks and records.

    `devices` maps "source", "destination" and "airflow" to those that there are.
    """

    def __init__(self, devices: Mapping[str, ClimateDevice], clock: Clock, operator: Operator) -> None:
        self._devices = devices
        self._clock = clock
        self._operator = operator
        self._asked: dict[tuple[str, str], float] = {}
        self._airs = (Air(None, None), Air(None, None))
        self._read_s: dict[str, float] = {}
        self._readings: dict[tuple[str, str], float | None] = {}
        self._around = AskedSurroundings(operator)

    def surround(self, pressure_hpa: float, irradiance_w_m2: float) -> None:
        """Ask a person: no device of these makes pressure or light."""
        self._around.ask(pressure_hpa, irradiance_w_m2)

    @property
    def origins(self) -> tuple[str, str]:
        """Whether an air is "measured", by the device that makes it, or a "set point" of a person."""
        source, destination = ("measured" if place in self._devices else "set point" for place in PLACES)
        return source, destination

    def demand(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Raise BenchError where a set point is beyond the limits of its device."""
        for (place, quantity), value in _wanted(source, destination, airflow_m_s).items():
            device = self._devices.get(place)
            if device is not None and device.has(quantity) and not device.settings.range_of(quantity).holds(value):
                possible = device.settings.range_of(quantity)
                raise BenchError(
                    f"{quantity} {value:g} {UNITS[quantity]} is beyond the {place}'s limits ({possible}); "
                    "change the protocol, or the limits in the bench file where the device can do more"
                )

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float | None) -> None:
        """Set every device, and ask a person for what has none. Raises OSError where a device does not take it."""
        self.demand(source, destination, airflow_m_s)
        self._airs = (source, destination)
        self._asked, self._read_s, by_hand, begun = {}, {}, [], set()
        for (place, quantity), value in _wanted(source, destination, airflow_m_s).items():
            device = self._devices.get(place)
            if device is None or not device.has(quantity):
                what = "airflow" if place == "airflow" else f"{place} air's {quantity}"
                by_hand.append(f"the {what} to {value:g} {UNITS[quantity]}")
                continue
            device.set(quantity, value)
            self._asked[place, quantity] = value
            begun.add(place)
        for place in sorted(begun):
            self._devices[place].start()
        if by_hand:
            self._operator.ask(f"Set {', '.join(by_hand)}; press Enter when all is steady.")

    def airs(self) -> tuple[Air, Air]:
        """What the chambers read; what was asked for where a place has no device, or the device does not read it."""
        source, destination = (
            Air(
                self._read(place, "temperature", air.temperature_c), self._read(place, "humidity", air.humidity_percent)
            )
            for place, air in zip(PLACES, self._airs, strict=True)
        )
        return source, destination

    def waiting(self) -> str:
        """What has not come near its set point yet; empty where all has."""
        for (place, quantity), asked in self._asked.items():
            device = self._devices[place]
            found = self._read(place, quantity, None)
            if found is not None and abs(found - asked) > device.settings.within(quantity):
                unit = UNITS[quantity]
                return f"the {place}'s {quantity} is {found:.4g} {unit}, {asked:g} {unit} is asked of it"
        return ""

    def _read(self, place: str, quantity: str, otherwise: float | None) -> float | None:
        device = self._devices.get(place)
        if device is None:
            return otherwise
        now = self._clock.now()
        if now - self._read_s.get(place, float("-inf")) > READ_AGAIN_S:
            quantities = ("airflow",) if place == "airflow" else ("temperature", "humidity")
            self._readings |= {(place, one): device.get(one) for one in quantities}
            self._read_s[place] = now
        found = self._readings[place, quantity]
        return otherwise if found is None else found


def _wanted(source: Air, destination: Air, airflow_m_s: float | None) -> dict[tuple[str, str], float]:
    """Set points by place and quantity; what a protocol leaves open is nobody's."""
    wanted = {}
    for place, air in zip(PLACES, (source, destination), strict=True):
        wanted[place, "temperature"], wanted[place, "humidity"] = air.temperature_c, air.humidity_percent
    wanted["airflow", "airflow"] = airflow_m_s
    return {key: value for key, value in wanted.items() if value is not None}
