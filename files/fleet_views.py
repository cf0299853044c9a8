"""How a fleet shows itself: a table, labelled arrays, a card, one figure; and as CSV, Parquet and netCDF."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.causes import Uncertain
from shockrig.files.exports import replace_whole
from shockrig.files.figures import BLUE, GREY, LIGHT, RED, literal, notebook_figure, styled
from shockrig.files.fleet_data import Coordinate, FleetChannel, FleetData, FleetFigure, FleetSensor, Population
from shockrig.files.numbers import counted, plain
from shockrig.files.views import card, require_xarray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

NAMED_UP_TO = 40  # sensors whose names fit below a figure


def typical_text(population: Population, k: int) -> str:
    """A coordinate's mean with the uncertainty of that, and how much sensors differ, in words."""
    one = population.coordinates[k]
    mean = one.natural(float(population.mean[k]), math.sqrt(population.mean_covariance[k, k]))
    spread = math.sqrt(population.covariance[k, k])
    differ = f"{plain(100.0 * spread, 2)} %" if one.log else plain(spread, 2)
    return f"{population.text(one, mean)}, sensors differ by {differ}"


def fleet_facts(fleet: FleetData) -> list[tuple[str, str]]:
    """What there is to say first: how many sensors, the type's numbers, who does not belong."""
    facts = [("sensors", str(len(fleet.sensors)))]
    facts += [
        (fleet.population.label(c), typical_text(fleet.population, k))
        for k, c in enumerate(fleet.population.coordinates)
    ]
    for channel in fleet.population.sensors:
        names = fleet.outsiders(channel)
        if names:
            facts.append((f"do not belong by {channel}", ", ".join(names[:5]) + (" ..." if len(names) > 5 else "")))
    if fleet.left_out:
        facts.append(("left out", counted(len(fleet.left_out), "campaign")))
    return facts


def fleet_card(fleet: FleetData) -> str:
    """The facts and the table, as HTML."""
    return card("Fleet", fleet_facts(fleet), fleet_frame(fleet))


def fleet_frame(fleet: FleetData) -> pd.DataFrame:
    """One row for each number of each sensor; a sensor or campaign that failed has one row that says why."""
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for sensor in fleet.sensors:
        head = {"sensor": sensor.name, "campaigns": "; ".join(sensor.campaigns), "began_at": sensor.began_at}
        for channel, found in sensor.channels.items():
            rows += [head | _row(sensor, channel, found, one) for one in found.figures]
        rows += [head | {"channel": channel, "failed": why} for channel, why in sensor.missing.items()]
    rows += [{"sensor": "", "campaigns": name, "failed": why} for name, why in fleet.left_out.items()]
    columns = list(_row(None, "", None, None)) if not rows else None
    frame = pd.DataFrame(rows, columns=columns)
    for name in ("serial", "channel", "figure", "failed", "began_at"):
        frame[name] = frame[name].fillna("") if name in frame else ""
    frame["belongs"] = frame["belongs"].astype("boolean")
    frame["runs"] = frame["runs"].astype("Int64")
    return frame.set_index("sensor")


def _row(
    sensor: FleetSensor | None, channel: str, found: FleetChannel | None, one: FleetFigure | None
) -> dict[str, Any]:
    if sensor is None or found is None or one is None:
        return dict.fromkeys(("sensor", "campaigns", "began_at", "channel", "belongs", "runs"))
    return {
        "serial": sensor.serials.get(channel, ""),
        "channel": channel,
        "runs": found.runs,
        "belongs": found.belongs,
        "probability": found.probability,
        "adjusted_probability": found.adjusted,
        "figure": one.coordinate.figure,
        "temperature_c": math.nan if one.coordinate.temperature_c is None else one.coordinate.temperature_c,
        "own": one.own.value,
        "own_standard_uncertainty": one.own.standard_uncertainty,
        "shrunk": one.shrunk.value,
        "shrunk_standard_uncertainty": one.shrunk.standard_uncertainty,
        "share_of_own_data": one.share,
        **_time("own_t63", one.own_t63_s),
        **_time("t63", one.t63_s),
    }


def _time(name: str, time: Uncertain | None) -> dict[str, float]:
    value, spread = (math.nan, math.nan) if time is None else (time.value, time.standard_uncertainty)
    return {f"{name}_s": value, f"{name}_standard_uncertainty_s": spread}


def fleet_dataset(fleet: FleetData) -> xr.Dataset:
    """The population over its coordinates, and the table's columns over its rows."""
    one = fleet.population
    names = [c.label for c in one.coordinates]
    variables: dict[str, Any] = {
        "population_mean": ("coordinate", one.mean),
        "population_mean_covariance": (("coordinate", "other"), one.mean_covariance),
        "population_covariance": (("coordinate", "other"), one.covariance),
        "degrees_of_freedom": ("coordinate", one.degrees),
    }
    frame = fleet_frame(fleet).reset_index()
    for name in frame:
        variables[str(name)] = ("row", _column(frame[name]))
    attributes = {"table_scatter": one.table_scatter}
    return require_xarray().Dataset(variables, {"coordinate": names, "other": names}, attributes)


def _column(values: pd.Series) -> np.ndarray:
    if values.dtype.kind == "f" or str(values.dtype) in ("boolean", "Int64"):
        return values.to_numpy(dtype=float, na_value=np.nan)
    return values.fillna("").to_numpy(dtype=str)


@styled
def plot_fleet(fleet: FleetData) -> Figure:
    """Each sensor against the population's mean, in its order, a panel for each coordinate: as its own data have it,
    shrunk, and who does not belong."""
    population = fleet.population
    size = len(population.coordinates)
    figure = notebook_figure(7.4, 0.6 + 2.0 * size)
    panels = figure.subplots(size, 1, squeeze=False, sharex=True)[:, 0]
    names = [literal(sensor.name) for sensor in fleet.sensors]
    small = {"fmt": "o", "markersize": 3.0 if len(names) <= NAMED_UP_TO else 1.6, "linewidth": 0.8}
    for k, (axes, one) in enumerate(zip(panels, population.coordinates, strict=True)):
        spread = math.sqrt(population.covariance[k, k])
        scale, unit = (100.0, "%") if one.log else (1.0, "")
        axes.axhspan(-2.0 * scale * spread, 2.0 * scale * spread, color=LIGHT, label="±2 spreads of the type", zorder=0)
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        points: dict[str, list[tuple[int, float, float]]] = {"own": [], "shrunk": [], "out": []}
        for place, sensor in enumerate(fleet.sensors):
            found = sensor.channels.get(one.channel)
            nearest = None if found is None else nearest_figure(found.figures, one)
            if found is None or nearest is None:
                continue
            middle = float(population.design([nearest.coordinate])[0] @ population.mean)
            for key, value in (("own", nearest.own), ("shrunk", nearest.shrunk)):
                relative = value.standard_uncertainty / (value.value if one.log else 1.0)
                away = (math.log(value.value) if one.log else value.value) - middle
                kind = key if found.belongs else "out"
                points[kind].append((place, scale * away, scale * relative))
        for kind, colour, words, shift in (
            ("own", GREY, "own data, ±2 u", -0.12),
            ("shrunk", BLUE, "with what the others say", 0.12),
            ("out", RED, "does not belong", 0.0),
        ):
            if points[kind]:
                x, y, u = np.array(points[kind]).T
                axes.errorbar(x + shift, y, yerr=2.0 * u, color=colour, label=words, **small)
        axes.set_title(f"{population.label(one)}: {typical_text(population, k)}")
        symbol = one.label.partition("(")[0]
        axes.set_ylabel(f"{symbol} from the mean, {unit}" if one.log else "from the mean")
    if len(names) <= NAMED_UP_TO:
        turned = len(names) > 8 or max(map(len, names)) > 8
        panels[-1].set_xticks(
            range(len(names)), names, rotation=60 if turned else 0, ha="right" if turned else "center"
        )
    else:
        panels[-1].set_xlabel("sensor")
    handles = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)
    return figure


def nearest_figure(figures: tuple[FleetFigure, ...], one: Coordinate) -> FleetFigure | None:
    """The number of a sensor that a coordinate is about: of D the nearest ambient's."""
    alike = [f for f in figures if f.coordinate.figure == one.figure]
    at = one.temperature_c or 0.0
    return min(alike, key=lambda f: abs((f.coordinate.temperature_c or 0.0) - at), default=None)


def write_fleet_tables(fleet: FleetData, folder: Path, history: str) -> list[str]:
    """FOLDER/sensors.csv, fleet.nc, and sensors.parquet where pyarrow is installed; returns the files' names."""
    frame = fleet_frame(fleet)
    replace_whole(folder / "sensors.csv", lambda part: frame.to_csv(part, float_format="%.7g"))
    names = ["sensors.csv", "fleet.nc"]
    if importlib.util.find_spec("pyarrow") is not None:
        replace_whole(folder / "sensors.parquet", lambda part: frame.to_parquet(part))
        names.append("sensors.parquet")
    replace_whole(folder / "fleet.nc", lambda part: _netcdf(fleet, frame, part, history))
    return names


def _netcdf(fleet: FleetData, frame: pd.DataFrame, path: Path, history: str) -> None:
    import netCDF4

    one = fleet.population
    with netCDF4.Dataset(path, "w", format="NETCDF4") as data:
        data.Conventions, data.title, data.history = "CF-1.11", "Fleet of sensors of one type", history
        data.table_scatter = one.table_scatter
        for dimension, length in (
            ("coordinate", len(one.coordinates)),
            ("other", len(one.coordinates)),
            ("row", len(frame)),
        ):
            data.createDimension(dimension, length)
        data.createVariable("coordinate", str, ("coordinate",))[:] = np.array(
            [c.label for c in one.coordinates], dtype=object
        )
        for of, dimensions, values, words in (
            ("population_mean", ("coordinate",), one.mean, "mean over the sensors, of the logarithm"),
            ("degrees_of_freedom", ("coordinate",), one.degrees, "of the variances from sensor to sensor"),
            ("population_covariance", ("coordinate", "other"), one.covariance, "from sensor to sensor"),
            ("population_mean_covariance", ("coordinate", "other"), one.mean_covariance, "of the mean"),
        ):
            variable = data.createVariable(of, "f8", dimensions)
            variable.long_name, variable.units = words, "1"
            variable[:] = values
        for name, cells in frame.reset_index().items():
            column = _column(cells)
            if column.dtype.kind == "f":
                data.createVariable(str(name), "f8", ("row",), fill_value=np.nan, zlib=True)[:] = column
            else:
                data.createVariable(str(name), str, ("row",))[:] = column.astype(object)
