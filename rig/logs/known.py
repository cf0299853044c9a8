"""Logs that are known by name: what their columns mean beyond what the names show.

InterMet's application writes one CSV file for all its ports: `Time`, `COM Elapse`, then for every sensor that it knows
a block of columns `PORT-MODEL QUANTITY`, zeros where nothing is connected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class SensorGuess:
    """Columns of one sensor as guessed: key of the map -> (column, unit, how the unit is known)."""

    name: str
    columns: dict[str, tuple[str, str, str]] = field(default_factory=dict)
    extra: dict[str, str] = field(default_factory=dict)  # further keys as TOML values
    notes: list[str] = field(default_factory=list)


def adjust(names: Sequence[str], sensors: Sequence[SensorGuess]) -> str | None:
    """Complete what was guessed of a known log's sensors in place; its name, or None where the log is not known."""
    for is_it, complete, called in _KNOWN:
        if is_it(names):
            for sensor in sensors:
                complete(sensor)
            return called
    return None


def _is_intermet(names: Sequence[str]) -> bool:
    return "COM Elapse" in names or sum("-iMet-" in name or "-IST HYT" in name for name in names) >= 2


def _complete_intermet(sensor: SensorGuess) -> None:
    sensor.extra["zero_is_missing"] = "true"
    if "HYT" in sensor.name:
        # The one temperature that this sensor has is that of its own die, not of the air.
        if "temperature" in sensor.columns and "die_temperature" not in sensor.columns:
            sensor.columns["die_temperature"] = sensor.columns.pop("temperature")
        sensor.extra["hygrometer"] = '{ kind = "hyt-271" }'
        sensor.notes.append(
            "if a thermometer was moved together with it, give both one table: temperature = that column"
        )
    elif "XQ" in sensor.name or "XF" in sensor.name:
        kind = "imet-xf" if "XF" in sensor.name else "imet-xq"
        sensor.extra["thermometer"] = f'{{ kind = "{kind}" }}'
        if "humidity" in sensor.columns:
            sensor.extra["hygrometer"] = f'{{ kind = "{kind}" }}'


_KNOWN = ((_is_intermet, _complete_intermet, "a CSV file of InterMet's application"),)
