"""CSV logs of soundings whose columns are known by name: which is what, in which unit, and what stands for no value."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NAMED_BY_TIME = re.compile(r"(\d{4}-\d\d-\d\d_\d{4})\b")  # 2023-06-01_0825.raw_history.csv, by the computer's clock


@dataclass(frozen=True)
class KnownLog:
    """One program's log.

    Attributes
    ----------
    called : str
        Whose it is, as the start of a sentence.
    columns : mapping
        Quantity -> its column's name.
    telling : frozenset
        Names by which it is recognised.
    factor : mapping
        Quantity -> what its numbers are multiplied by, to be in the project's unit.
    missing : mapping
        Quantity -> the number that stands for no value.
    said : str
        What else a reader should know of what was read.
    """

    called: str
    columns: Mapping[str, str]
    telling: frozenset[str]
    factor: Mapping[str, float] = field(default_factory=dict)
    missing: Mapping[str, float] = field(default_factory=dict)
    said: str = ""

    def values(self, quantity: str, numbers: Array) -> Array:
        """Numbers of a column (n,) in the project's unit, NaN where there is no value."""
        known = np.where(numbers == self.missing.get(quantity, np.nan), np.nan, numbers)
        return known * self.factor.get(quantity, 1.0)

    def sentence(self, places: Mapping[str, int], header: Sequence[str]) -> str:
        """What was read as what."""
        read = ", ".join(f"{quantity.replace('_', ' ')} from {header[place]!r}" for quantity, place in places.items())
        return f"read as {self.called}: {read}{self.said}"


# Windsond S1: times of day in UTC, the sonde's own inner temperature now and then, positions every third row.
WINDSOND = KnownLog(
    "a raw history of Windsond",
    {
        "time": "UTC time",
        "temperature": "Temperature (C)",
        "humidity": "Relative humidity (%)",
        "pressure": "Pressure (Pascal)",
        "altitude": "Altitude (m MSL)",
        "latitude": "Latitude",
        "longitude": "Longitude",
        "vertical_speed": "Rise speed (m/s)",
    },
    frozenset(("UTC time", "Altitude (m MSL)", "Pressure (Pascal)", "Relative humidity (%)", "Temperature (C)")),
    factor={"pressure": 0.01},
    said="; 'Internal temperature (C)' is the sonde's and no reading of air or of the hygrometer",
)
# radiosonde_auto_rx writes one log a sonde (auto_rx/autorx/logger.py); what a sonde does not send is -273 degC, -1 %RH,
# -1 hPa. Logs before 2020 have no pressure.
AUTO_RX = KnownLog(
    "a log of radiosonde_auto_rx",
    {
        "time": "timestamp",
        "temperature": "temp",
        "humidity": "humidity",
        "pressure": "pressure",
        "altitude": "alt",
        "latitude": "lat",
        "longitude": "lon",
        "vertical_speed": "vel_v",
    },
    frozenset(("timestamp", "serial", "frame", "vel_v", "vel_h", "temp", "humidity", "freq_mhz")),
    missing={"temperature": -273.0, "humidity": -1.0, "pressure": -1.0},
    said="; -273 °C, -1 %RH and -1 hPa stand for no value",
)
KNOWN_LOGS = (WINDSOND, AUTO_RX)


def known_log(header: Sequence[str]) -> KnownLog | None:
    """Whose log it is, by the names of its columns; None where that is not known."""
    return next((one for one in KNOWN_LOGS if one.telling <= set(header)), None)


def day_of(file_name: str, time_of_day_s: float) -> float | None:
    """Start of the UTC day [s since 1970] in which a log's first row was read, by a name that holds the computer's date
    and time at its launch; None where it holds none.

    The computer's clock is in its own zone: the day is the one that makes the two clocks differ by less than half a
    day.
    """
    found = NAMED_BY_TIME.search(file_name)
    if found is None:
        return None
    try:
        launched = datetime.strptime(found[1], "%Y-%m-%d_%H%M").replace(tzinfo=UTC)
    except ValueError:  # 2023-13-01
        return None
    midnight = launched.replace(hour=0, minute=0)
    days = [midnight + timedelta(days=n) for n in (-1, 0, 1)]
    return min((day.timestamp() for day in days), key=lambda day: abs(day + time_of_day_s - launched.timestamp()))
