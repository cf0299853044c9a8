"""How the formats show themselves in a notebook: a card of HTML, a table, labelled arrays, a figure.

Functions of plain data; the classes' `_repr_html_`, `to_frame`, `to_xarray` and `plot` are one call of them each.
pandas, xarray and matplotlib are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.numbers import plain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from shockrig.files.campaign import Campaign
    from shockrig.files.profile_data import Profile
    from shockrig.files.traces import Trace

UNITS = {
    "temperature_c": "degC",
    "humidity_percent": "%",
    "airflow_m_s": "m s-1",
    "pressure_hpa": "hPa",
    "time_s": "s",
    "start_s": "s",
    "duration_s": "s",
    "diffusivity_m2_s": "m2 s-1",
}
CARD = "font-family: sans-serif; overflow-x: auto; border-left: 0.25em solid #0072B2; padding-left: 0.8em"


def require_xarray() -> ModuleType:
    """The package xarray. Raises ImportError with the remedy where it is not installed."""
    try:
        import xarray
    except ImportError:
        raise ImportError("xarray is not installed; pip install 'shockrig[notebook]'") from None
    return xarray


def card(title: str, facts: Sequence[tuple[str, str]], frame: pd.DataFrame | None = None, rows: int = 12) -> str:
    """A card of HTML: a title, facts as name and value, and the first `rows` rows of a table. All text is escaped."""
    lines = "".join(f"<li><b>{escape(name)}</b>: {escape(value)}</li>" for name, value in facts)
    table = ""
    if frame is not None:
        table = frame.head(rows).to_html(border=0, na_rep="", float_format=lambda value: f"{value:.4g}")
        if len(frame) > rows:
            table += f"<p>and {len(frame) - rows} more rows: to_frame()</p>"
    return f'<div style="{CARD}"><p><b>{escape(title)}</b></p><ul>{lines}</ul>{table}</div>'


# campaigns ------------------------------------------------------------------------------------------------------------


def campaign_card(campaign: Campaign, notes: Sequence[str] = ()) -> str:
    """What a campaign holds: sensors, airs, runs; `notes` are sentences to add."""
    facts = [("folder", str(campaign.path)), ("runs", str(len(campaign.runs)))]
    for name, sensor in campaign.sensors.items():
        words = [str(sensor[key]) for key in ("kind", "serial") if sensor.get(key)]
        facts.append((name, ", ".join([*words, campaign.bodies.get(name, "")]).strip(", ")))
    facts += [("note", note) for note in notes]
    return card(f"Campaign {campaign.name}", facts, campaign.to_frame().dropna(axis="columns", how="all"))


def campaign_dataset(campaign: Campaign) -> xr.Dataset:
    """All readings as labelled arrays: for each sensor (run, sample), filled up with NaN; the airs (run,)."""
    xarray = require_xarray()
    frame = campaign.to_frame()
    variables = {}
    for name in ("imet", "hyt", "air"):
        traces: list[Trace | None] = [getattr(run, name) for run in campaign.runs]
        longest = max((trace.time_s.size for trace in traces if trace is not None), default=0)
        columns = dict.fromkeys(column for trace in traces if trace is not None for column in trace.values)
        for column in ("time_s", *columns) if longest else ():
            filled = np.full((len(traces), longest), np.nan)
            for row, trace in zip(filled, traces, strict=True):
                values = None if trace is None else trace.time_s if column == "time_s" else trace.values.get(column)
                if values is not None:
                    row[: values.size] = values
            variables[f"{name}_{column}"] = (("run", f"{name}_sample"), filled, {"units": UNITS.get(column, "1")})
    of_runs = [column for column in frame if not str(column).endswith("samples")]
    coordinates: dict[str, Any] = {"run": frame.index.to_list()}
    for column in map(str, of_runs):
        kind = bool if column == "air_measured" else float  # what is not known is NaN
        coordinates[column] = ("run", frame[column].to_numpy(dtype=kind), _units(column))
    return xarray.Dataset(variables, coordinates, {"name": campaign.name})


def _units(column: str) -> dict[str, str]:
    return next(({"units": unit} for ending, unit in UNITS.items() if column.endswith(ending)), {})


# profiles -------------------------------------------------------------------------------------------------------------


def profile_frame(profile: Profile) -> pd.DataFrame:
    """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty and response times."""
    import pandas as pd

    from shockrig.files.profile_data import response_columns

    parts = []
    if (t := profile.temperature) is not None:
        row = {
            "ambient_temperature_c": np.nan,
            "diffusivity_m2_s": t.thermal_diffusivity_m2_s.value,
            "standard_uncertainty": t.thermal_diffusivity_m2_s.standard_uncertainty,
            **response_columns(t.response_time_s),
        }
        parts.append(pd.DataFrame([row], index=["temperature"]))
    if (h := profile.humidity) is not None:
        table = h.to_frame().drop(columns="runs")
        parts.append(table.set_index(pd.Index(["humidity"] * len(table))))
    return pd.concat(parts).rename_axis("channel")


def profile_dataset(profile: Profile) -> xr.Dataset:
    """D(T) and the film's response times over the ambient temperature, and alpha, with units."""
    xarray = require_xarray()
    from shockrig.files.profile_data import response_columns

    square_metre, second = {"units": "m2 s-1"}, {"units": "s"}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        variables["thermal_diffusivity_m2_s"] = ((), alpha.value, square_metre)
        variables["thermal_diffusivity_standard_uncertainty"] = ((), alpha.standard_uncertainty, square_metre)
        for column, value in response_columns(t.response_time_s).items():
            variables[f"thermometer_{column}"] = ((), value, second)
    if (h := profile.humidity) is not None:
        frame, over = h.to_frame(), "ambient_temperature_c"
        coordinates[over] = (over, frame[over].to_numpy(), {"units": "degC"})
        for column, name in (("diffusivity_m2_s",) * 2, ("standard_uncertainty", "diffusivity_standard_uncertainty")):
            variables[name] = (over, frame[column].to_numpy(), square_metre)
        for column in response_columns(None):
            variables[column] = (over, frame[column].to_numpy(), second)
    return xarray.Dataset(variables, coordinates)


def profile_card(profile: Profile, notes: Sequence[str] = ()) -> str:
    """What a profile knows: headlines, noise, the effects that it carries, the table; `notes` are sentences to add."""
    from shockrig.files.headline import headlines

    facts = headlines(profile)
    if (t := profile.temperature) is not None:
        facts += [("noise of the bead", f"{plain(t.noise_k, 2)} K")] if t.noise_k is not None else []
    if (h := profile.humidity) is not None and h.noise_percent is not None:
        facts.append(("noise of the film", f"{plain(h.noise_percent, 2)} %RH"))
    for part, words in ((profile.temperature, "bead"), (profile.humidity, "film")):
        if part is not None and part.effects:
            facts.append((f"effects of the {words}", ", ".join(effect.effect for effect in part.effects)))
    facts += [("note", note) for note in notes]
    return card("Sensor profile", facts, profile_frame(profile))
