"""What a chamber or a fan may be asked for, and how near it must have come; the part that all such devices share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from shockrig.files.ranges import Range
from shockrig.rig.bench_errors import BenchError

UNITS = {"temperature": "degC", "humidity": "%RH", "airflow": "m/s"}


@dataclass(frozen=True)
class Limits:
    """Limits of a device: set points beyond them are refused before anything moves. State those of your own.

    A soak does not end while what the device reads is further than `within_*` from what it was asked for.
    """

    lowest_c: float = -40.0
    highest_c: float = 80.0
    lowest_percent: float = 5.0
    highest_percent: float = 95.0
    highest_m_s: float = 20.0
    within_k: float = 1.0
    within_percent: float = 5.0
    within_m_s: float = 0.5

    def range_of(self, quantity: str) -> Range:
        """What a set point of "temperature", "humidity" or "airflow" can be."""
        ranges = {
            "temperature": Range(self.lowest_c, self.highest_c),
            "humidity": Range(self.lowest_percent, self.highest_percent),
            "airflow": Range(0.0, self.highest_m_s),
        }
        return ranges[quantity]

    def within(self, quantity: str) -> float:
        """How near a reading must come to the set point."""
        return {"temperature": self.within_k, "humidity": self.within_percent, "airflow": self.within_m_s}[quantity]

    def demand_order(self) -> None:
        """Raise BenchError where a lowest value is above the highest."""
        for quantity in ("temperature", "humidity", "airflow"):
            possible = self.range_of(quantity)
            if not possible.low < possible.high:
                raise BenchError(f"the limits of the {quantity} are {possible}: the lowest must be below the highest")


class ClimateDevice(Protocol):
    """A chamber or a fan: set points in, readings out, each by its quantity ("temperature", "humidity", "airflow").

    Every failure is an OSError whose message names the device and the remedy.
    """

    settings: Any  # Limits, with whatever else the device has

    def open(self) -> None: ...

    def has(self, quantity: str) -> bool:
        """Whether a set point of this quantity can be given."""
        ...

    def set(self, quantity: str, value: float) -> None:
        """Ask for a value; returns once the device has taken it, not once it is reached."""
        ...

    def start(self) -> None:
        """Have the device work towards its set points."""
        ...

    def get(self, quantity: str) -> float | None:
        """What the device reads; None where it does not read this quantity."""
        ...

    def close(self) -> None:
        """Stop it, as its settings say, and let go of it."""
        ...
