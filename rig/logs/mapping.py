"""What a person says of a log (MAP.toml, shock-map/1), checked and frozen.

[log]            how its text is laid out and which column tells the time; what is left out is found
[sensor.NAME]    one thermometer and/or one hygrometer that moved together: columns, units, what is known of them
[runs]           what holds for every run, and how long runs are
[steps]          how steps are found
[[step]]         one step each, found or stated; a log without any has its steps found
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.unit_names import UNITS
from shockrig.rig.logs.log import Column
from shockrig.rig.logs.text import Layout

FORMAT = "shock-map/1"
COLUMNS = {
    "temperature": "temperature", "humidity": "humidity", "die_temperature": "temperature", "pressure": "pressure",
    "airflow": "airflow", "altitude": "altitude", "latitude": "position", "longitude": "position",
}  # fmt: skip


@dataclass(frozen=True)
class SensorMap:
    """`[sensor.NAME]`: the columns of one sensor by their keys (`COLUMNS`), each (name or number, unit or None).

    `is_campaign` None: it makes one unless it is only another's reference. `held` None: found out.
    """

    name: str
    columns: Mapping[str, tuple[str, str | None]]
    reference: tuple[str, ...] = ()
    is_campaign: bool | None = None
    held: int | None = None
    zero_is_missing: bool = False
    thermometer: Mapping[str, Any] = field(default_factory=dict)
    hygrometer: Mapping[str, Any] = field(default_factory=dict)
    as_reference: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class StepMap:
    """`[[step]]`: times are as the map has them, on the log's clock; `number` counts from 1, for messages. `note` says
    why it is not used, where it is not."""

    number: int
    at: object
    log: str | None = None
    piece: int | None = None
    uncertainty_s: float | None = None
    is_used: bool = True
    sensors: tuple[str, ...] = ()
    begin: object = None
    end: object = None
    start: object = None
    note: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LogMap:
    """A whole map. `time` are columns, `time_format` and `time_unit` None where they are found out; `every_s` is from
    row to row, where no column tells the time."""

    path: Path
    name: str | None
    layout: Layout
    time: tuple[str, ...]
    time_format: str | None
    time_unit: str | None
    every_s: float | None
    stamps: str
    sensors: Mapping[str, SensorMap]
    steps: tuple[StepMap, ...]
    facts: Mapping[str, Any]
    before_s: float | None
    after_s: float | None
    merge_s: float | None
    least: Mapping[str, float]

    @property
    def wanted(self) -> tuple[str, ...]:
        """The sensors that make a campaign: those that say so, and those that are not merely another's reference."""
        serving = {name for sensor in self.sensors.values() for name in sensor.reference}
        return tuple(
            name
            for name, sensor in self.sensors.items()
            if (name not in serving if sensor.is_campaign is None else sensor.is_campaign)
        )


def columns_of(sensor: SensorMap) -> dict[str, Column]:
    """A sensor's columns by their keys; units that the map does not state are the campaign's own."""
    return {
        key: Column(name, COLUMNS[key], unit or next(iter(UNITS[COLUMNS[key]])), unit is not None)
        for key, (name, unit) in sensor.columns.items()
    }
