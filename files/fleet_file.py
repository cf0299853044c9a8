"""A fleet's file (`shock-fleet/1`) read and written: the one place for both. What it holds is in fleet_data."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.causes import Uncertain, read_uncertain, uncertain_document
from shockrig.files.file_table import FileTable, is_number
from shockrig.files.fleet_data import (
    ALPHA,
    BENCH,
    CHANNELS,
    KELVIN,
    SENSOR,
    SENSOR_OF,
    SEVERAL,
    TYPE,
    WHOSE,
    Array,
    Coordinate,
    D,
    FleetCause,
    FleetChannel,
    FleetData,
    FleetFigure,
    FleetSensor,
    FleetTrend,
    Population,
    RunScatter,
    SharedParameter,
    demand_of_type,
    design,
)
from shockrig.files.fleet_views import fleet_card, fleet_dataset, fleet_facts, fleet_frame, plot_fleet
from shockrig.files.json_files import known, measured, read_json, write_json

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = [
    "ALPHA",
    "BENCH",
    "CHANNELS",
    "Coordinate",
    "D",
    "FLEET_FORMAT",
    "Fleet",
    "FleetCause",
    "FleetChannel",
    "FleetFigure",
    "FleetSensor",
    "FleetTrend",
    "KELVIN",
    "Population",
    "RunScatter",
    "SENSOR",
    "SENSOR_OF",
    "SEVERAL",
    "SharedParameter",
    "TYPE",
    "demand_of_type",
    "design",
    "fleet_document",
    "read_fleet",
    "write_fleet",
]

FLEET_FORMAT = "shock-fleet/1"
REMEDY = "give the fleet.json that shockrig fleet wrote"


@dataclass(frozen=True, repr=False)
class Fleet(FleetData):
    """What `shockrig fleet` found: the population, its sensors, what differs along it, campaigns left out, whose the
    causes are that diagnoses name, and of campaigns with several probes the share, by channel, of what runs differ by
    that is the same in all of them."""

    def to_frame(self) -> pd.DataFrame:
        """One row for each number of each sensor: its own value, the value with what the others say, belonging."""
        return fleet_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """The population over its coordinates, and the sensors' numbers one below the other; needs xarray."""
        return fleet_dataset(self)

    def plot(self) -> Figure:
        """Each sensor beside the population, a panel for each coordinate."""
        return plot_fleet(self)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the fleet to a file, whole or not at all."""
        write_fleet(self, path)

    def __repr__(self) -> str:
        return f"<Fleet: {'; '.join(f'{name} {value}' for name, value in fleet_facts(self))}>"

    def _repr_html_(self) -> str:
        return fleet_card(self)


def write_fleet(fleet: Fleet, path: str | os.PathLike[str]) -> None:
    """Write fleet.json; the file appears whole or not at all.

    Raises
    ------
    ValueError
        A number is not finite.
    OSError
        The disk does not take it.
    """
    write_json(Path(path), fleet_document(fleet))


def fleet_document(fleet: Fleet) -> dict[str, Any]:
    """The fleet as the JSON document of `shock-fleet/1`."""
    one = fleet.population
    return {
        "format": FLEET_FORMAT,
        "population": {
            "coordinates": [_coordinate_document(c) for c in one.coordinates],
            "mean": one.mean.tolist(),
            "mean_covariance": one.mean_covariance.tolist(),
            "covariance": one.covariance.tolist(),
            "degrees_of_freedom": one.degrees.tolist(),
            "table_scatter": one.table_scatter,
            **_scatter_document(one.run_scatter),
            "channels": {
                name: known(
                    sensors=one.sensors[name],
                    body=one.bodies[name],
                    length_m=one.lengths_m[name],
                    noise=one.noise.get(name),
                    sampling_period_s=one.sampling_period_s.get(name),
                )
                for name in one.sensors
            },
        },
        "sensors": [_sensor_document(sensor) for sensor in fleet.sensors],
        "trends": [
            {
                "channel": t.channel,
                "per": t.per,
                "since": t.since,
                "relative_change": uncertain_document(t.change),
                "probability_by_accident": t.probability,
            }
            for t in fleet.trends
        ],
        "causes": [_cause_document(one) for one in fleet.causes],
        "runs_in_common": {path: dict(shares) for path, shares in fleet.runs_in_common.items()},
        "left_out": dict(fleet.left_out),
        "provenance": dict(fleet.provenance),
    }


def _scatter_document(one: RunScatter | None) -> dict[str, Any]:
    if one is None:
        return {}
    return {"run_scatter": {"standard_deviation": one.standard_deviation, "degrees_of_freedom": one.degrees}}


def _cause_document(one: FleetCause) -> dict[str, Any]:
    return {
        "channel": one.channel,
        "effect": one.effect,
        "whose": one.whose,
        "sensors": list(one.sensors),
        "diagnosed": one.diagnosed,
        "campaigns": list(one.campaigns),
        "parameters": {
            name: {**uncertain_document(p.mean), "spread": p.spread, "common": p.common}
            for name, p in one.parameters.items()
        },
        "look_alikes": list(one.look_alikes),
        "ruled_out": list(one.ruled_out),
    }


def _coordinate_document(one: Coordinate) -> dict[str, Any]:
    return known(channel=one.channel, figure=one.figure, temperature_c=one.temperature_c, logarithm=one.log)


def _rounded(value: Uncertain) -> dict[str, float]:
    return {name: measured(x) or 0.0 for name, x in uncertain_document(value).items()}


def _sensor_document(sensor: FleetSensor) -> dict[str, Any]:
    return {
        "name": sensor.name,
        "campaigns": list(sensor.campaigns),
        "began_at": sensor.began_at,
        "serials": dict(sensor.serials),
        "channels": {
            name: {
                "belongs": found.belongs,
                "probability": found.probability,
                "adjusted_probability": found.adjusted,
                "runs": found.runs,
                "explained": found.explained,
                "figures": [
                    {
                        **_coordinate_document(f.coordinate),
                        "own": _rounded(f.own),
                        "shrunk": _rounded(f.shrunk),
                        "share_of_own_data": measured(f.share),
                        **{
                            key: _rounded(time)
                            for key, time in (("own_t63_s", f.own_t63_s), ("t63_s", f.t63_s))
                            if time is not None
                        },
                    }
                    for f in found.figures
                ],
            }
            for name, found in sensor.channels.items()
        },
        "missing": dict(sensor.missing),
    }


def read_fleet(path: str | os.PathLike[str]) -> Fleet:
    """Read what `shockrig fleet` wrote; keys that the format does not know are ignored.

    Raises
    ------
    InputError
        Names the file, the key, what was expected and the remedy.

    See Also
    --------
    fleet : which makes one.
    """
    whole = read_json(path, FLEET_FORMAT, REMEDY)
    whole = FileTable(whole.content, whole.source, remedy=REMEDY)
    return Fleet(
        _population(whole.mapping("population")),
        tuple(_sensor(item) for item in whole.items("sensors")),
        tuple(_trend(item) for item in whole.items("trends")),
        {str(k): str(v) for k, v in whole.mapping("left_out").content.items()},
        MappingProxyType(dict(whole.mapping("provenance").content)),
        tuple(_cause(item) for item in whole.items("causes")),
        _in_common(whole),
    )


def _in_common(table: FileTable) -> dict[str, dict[str, float]]:
    shares: dict[str, dict[str, float]] = {}
    for path, one in table.children("runs_in_common"):
        there = {name: one.number(name, at_least=0.0) for name in CHANNELS}
        shares[path] = {name: share for name, share in there.items() if share is not None}
    return shares


def _coordinate(item: FileTable) -> Coordinate:
    log = item.get("logarithm")
    return Coordinate(
        item.word("channel", CHANNELS),
        item.text("figure") or "",
        item.number("temperature_c"),
        True if log is None else bool(log),
    )


def _population(stated: FileTable) -> Population:
    coordinates = tuple(_coordinate(item) for item in stated.items("coordinates"))
    size = len(coordinates)
    if not size:
        raise stated.error("coordinates", "a list of at least one", None)
    channels = dict(stated.children("channels"))
    for one in coordinates:
        if one.channel not in channels:
            raise stated.error("channels", f"an entry {one.channel}", sorted(channels))

    def per(key: str) -> dict[str, float]:
        numbers = {name: item.number(key, positive=True) for name, item in channels.items()}
        return {name: value for name, value in numbers.items() if value is not None}

    covariance = _covariance(stated, "covariance", size)
    lengths = per("length_m")
    for name, item in channels.items():
        if name not in lengths:
            raise item.error("length_m", "a positive number", None)
    return Population(
        coordinates=coordinates,
        mean=_numbers(stated, "mean", (size,)),
        mean_covariance=_covariance(stated, "mean_covariance", size),
        covariance=covariance,
        degrees=_numbers(stated, "degrees_of_freedom", (size,)),
        table_scatter=stated.number("table_scatter", at_least=0.0) or 0.0,
        sensors={name: int(item.number("sensors", at_least=0.0) or 0) for name, item in channels.items()},
        bodies={name: item.text("body") or "" for name, item in channels.items()},
        lengths_m=lengths,
        noise=per("noise"),
        sampling_period_s=per("sampling_period_s"),
        run_scatter=_run_scatter(stated),
    )


def _run_scatter(stated: FileTable) -> RunScatter | None:
    if stated.get("run_scatter") is None:
        return None
    one = stated.mapping("run_scatter")
    keys = ("standard_deviation", "degrees_of_freedom")
    return RunScatter(*(one.demand(key, one.number(key, positive=True)) for key in keys))


def _numbers(stated: FileTable, key: str, shape: tuple[int, ...]) -> Array:
    rows = stated.sequence(key)
    flat = [x for row in rows for x in (row if isinstance(row, list) else [row])]
    if not all(map(is_number, flat)) or len(flat) != math.prod(shape) or len(rows) != shape[0]:
        raise stated.error(key, f"{' by '.join(map(str, shape))} numbers", rows)
    return np.array(flat, dtype=float).reshape(shape)


def _covariance(stated: FileTable, key: str, size: int) -> Array:
    found = _numbers(stated, key, (size, size))
    if not np.allclose(found, found.T) or np.linalg.eigvalsh(found).min() < -1e-9 * max(np.trace(found), 1e-300):
        raise stated.refuse(key, "is no covariance (symmetric, no negative variance)")
    return found


def _sensor(item: FileTable) -> FleetSensor:
    channels = {}
    for name, stated in item.children("channels"):
        figures = []
        for one in stated.items("figures"):
            own, shrunk = read_uncertain(one, "own"), read_uncertain(one, "shrunk")
            if own is None or shrunk is None:
                raise one.error("own" if own is None else "shrunk", "a value with its standard uncertainty", None)
            share = one.number("share_of_own_data") or 0.0
            times = read_uncertain(one, "own_t63_s"), read_uncertain(one, "t63_s")
            figures.append(FleetFigure(_coordinate(one), own, shrunk, share, *times))
        channels[name] = FleetChannel(
            stated.yes_or_no("belongs"),
            stated.number("probability") or 0.0,
            stated.number("adjusted_probability") or 0.0,
            int(stated.number("runs") or 0),
            stated.yes_or_no("explained"),
            tuple(figures),
        )
    return FleetSensor(
        item.text("name") or "",
        item.texts("campaigns"),
        item.text("began_at") or "",
        {str(k): str(v) for k, v in item.mapping("serials").content.items()},
        channels,
        {str(k): str(v) for k, v in item.mapping("missing").content.items()},
    )


def _cause(item: FileTable) -> FleetCause:
    parameters = {}
    stated = item.mapping("parameters")
    for name, one in item.children("parameters"):
        mean = read_uncertain(stated, name)
        if mean is None:
            raise one.error("value", "a number", None)
        parameters[name] = SharedParameter(mean, one.number("spread", at_least=0.0) or 0.0, one.yes_or_no("common"))
    return FleetCause(
        item.word("channel", CHANNELS),
        item.text("effect") or "",
        item.word("whose", WHOSE),
        item.texts("sensors"),
        int(item.number("diagnosed", at_least=0.0) or 0),
        item.texts("campaigns"),
        parameters,
        item.texts("look_alikes"),
        item.texts("ruled_out"),
    )


def _trend(item: FileTable) -> FleetTrend:
    change = read_uncertain(item, "relative_change")
    if change is None:
        raise item.error("relative_change", "a value with its standard uncertainty", None)
    return FleetTrend(
        item.word("channel", CHANNELS),
        item.text("per") or "",
        item.text("since") or "",
        change,
        item.number("probability_by_accident") or 0.0,
    )
