"""How the formats show themselves in a notebook: a card of HTML, a table, labelled arrays, a figure.

Functions of plain data; the classes' `_repr_html_`, `to_frame`, `to_xarray` and `plot` are one call of them each.
pandas, xarray and matplotlib are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.errors import InputError
from shockrig.files.figures import BLUE, GREY, INK, literal, notebook_figure, styled
from shockrig.files.numbers import measured, plain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from shockrig.files.campaign import Campaign, Run
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


def campaign_card(campaign: Campaign) -> str:
    """What a campaign holds: sensors, airs, runs."""
    facts = [("folder", str(campaign.path)), ("runs", str(len(campaign.runs)))]
    for name, sensor in campaign.sensors.items():
        words = [str(sensor[key]) for key in ("kind", "serial") if sensor.get(key)]
        facts.append((name, ", ".join([*words, campaign.bodies.get(name, "")]).strip(", ")))
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


@styled
def plot_campaign(campaign: Campaign, runs: Sequence[str] | None = None) -> Figure:
    """Readings against the time since the transfer, a colour for each ambient; `runs` are the ids to show."""
    wanted = [run for run in campaign.runs if runs is None or run.id in runs]
    if not wanted:
        raise InputError(f"{campaign.name}: none of the runs {', '.join(runs or ())}; to_frame() lists them")
    ambients = [
        None if run.destination.temperature_c is None else round(run.destination.temperature_c) for run in wanted
    ]
    known = sorted({ambient for ambient in ambients if ambient is not None})
    colours = dict(zip(known, _colours(len(known)), strict=True))
    figure = notebook_figure(9.2, 3.6)
    bead, film = figure.subplots(1, 2)
    for run, ambient in zip(wanted, ambients, strict=True):
        colour = GREY if ambient is None else colours[ambient]
        for axes, trace, column in ((bead, run.imet, "temperature_c"), (film, run.hyt, "humidity_percent")):
            if trace is not None:
                axes.plot(trace.time_s - _began_s(run, trace), trace.values[column], color=colour, lw=0.8)
    for ambient in known:
        film.plot([], [], color=colours[ambient], label=f"to {ambient:g} °C")
    if known:
        figure.legend(loc="outside right upper")
    bead.set_ylabel("bead, °C")
    film.set_ylabel("film, %RH")
    for axes in (bead, film):
        axes.set_xlabel("time since the transfer, s")
    bead.set_title(literal(campaign.name))
    return figure


def _colours(count: int) -> list[Any]:
    """As many colours from cold to warm."""
    from matplotlib import colormaps

    return [colormaps["turbo"](0.1 + 0.8 * i / max(count - 1, 1)) for i in range(count)]


def _began_s(run: Run, trace: Trace) -> float:
    if run.start_s is not None:
        return run.start_s
    return float(trace.time_s[0]) if trace.time_s.size else 0.0


def _units(column: str) -> dict[str, str]:
    return next(({"units": unit} for ending, unit in UNITS.items() if column.endswith(ending)), {})


# profiles -------------------------------------------------------------------------------------------------------------


def profile_frame(profile: Profile) -> pd.DataFrame:
    """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty and response times."""
    import pandas as pd

    parts = []
    if (t := profile.temperature) is not None:
        times = t.response_time_s
        row = {
            "ambient_temperature_c": np.nan,
            "diffusivity_m2_s": t.thermal_diffusivity_m2_s.value,
            "standard_uncertainty": t.thermal_diffusivity_m2_s.standard_uncertainty,
            "t63_s": np.nan if times is None else times.t63_s,
            "t90_s": np.nan if times is None else times.t90_s,
            "t98_s": np.nan if times is None else times.t98_s,
        }
        parts.append(pd.DataFrame([row], index=["temperature"]))
    if (h := profile.humidity) is not None:
        table = h.to_frame().drop(columns="runs")
        parts.append(table.set_index(pd.Index(["humidity"] * len(table))))
    return pd.concat(parts).rename_axis("channel")


def profile_dataset(profile: Profile) -> xr.Dataset:
    """D(T) and the film's response times over the ambient temperature, and alpha, with units."""
    xarray = require_xarray()
    square_metre, second = {"units": "m2 s-1"}, {"units": "s"}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        variables["thermal_diffusivity_m2_s"] = ((), alpha.value, square_metre)
        variables["thermal_diffusivity_standard_uncertainty"] = ((), alpha.standard_uncertainty, square_metre)
    if (h := profile.humidity) is not None:
        frame, over = h.to_frame(), "ambient_temperature_c"
        coordinates[over] = (over, frame[over].to_numpy(), {"units": "degC"})
        for column, name in (("diffusivity_m2_s",) * 2, ("standard_uncertainty", "diffusivity_standard_uncertainty")):
            variables[name] = (over, frame[column].to_numpy(), square_metre)
        for column in ("t63_s", "t90_s", "t98_s"):
            variables[column] = (over, frame[column].to_numpy(), second)
    return xarray.Dataset(variables, coordinates)


def profile_card(profile: Profile, notes: Sequence[str] = ()) -> str:
    """What a profile knows: alpha, noise, the effects that it carries, the table; `notes` are sentences to add."""
    facts = []
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        facts.append(("alpha", measured(alpha.value, alpha.standard_uncertainty, "m²/s")))
        facts += [("noise of the bead", f"{plain(t.noise_k, 2)} K")] if t.noise_k is not None else []
    if (h := profile.humidity) is not None and h.noise_percent is not None:
        facts.append(("noise of the film", f"{plain(h.noise_percent, 2)} %RH"))
    for part, words in ((profile.temperature, "bead"), (profile.humidity, "film")):
        if part is not None and part.effects:
            facts.append((f"effects of the {words}", ", ".join(effect.effect for effect in part.effects)))
    facts += [("note", note) for note in notes]
    return card("Sensor profile", facts, profile_frame(profile))


@styled
def plot_profile(profile: Profile) -> Figure:
    """D over temperature with its uncertainty, as it is interpolated, and the response times."""
    figure = notebook_figure(9.2, 3.6)
    left, right = figure.subplots(1, 2)
    if (h := profile.humidity) is not None:
        table = h.to_frame()
        at_c, value, sigma = (
            table[name].to_numpy() for name in ("ambient_temperature_c", "diffusivity_m2_s", "standard_uncertainty")
        )
        fine_c = np.linspace(at_c[0], at_c[-1], 200)
        between, spread = h.diffusivity_m2_s(fine_c)
        left.fill_between(fine_c, 1e12 * (between - 2 * spread), 1e12 * (between + 2 * spread), color=BLUE, alpha=0.2)
        left.plot(fine_c, 1e12 * between, color=BLUE, lw=1.0)
        left.errorbar(at_c, 1e12 * value, 2e12 * sigma, fmt="o", color=BLUE, capsize=2, label="film, ± 2 sigma")
        _plot_times(right, at_c, {name: table[f"{name}_s"].to_numpy() for name in ("t63", "t90", "t98")})
        left.legend(loc="best")
    left.set_ylabel("D, 10⁻¹² m²/s")
    right.set_ylabel("response time, s")
    for axes in (left, right):
        axes.set_xlabel("ambient temperature, °C")
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        left.set_title(f"bead: alpha = {measured(alpha.value, alpha.standard_uncertainty, 'm²/s')}")
        if (times := t.response_time_s) is not None:
            named = {"t63": times.t63_s, "t90": times.t90_s, "t98": times.t98_s}
            seconds = (f"{name} {plain(value, 3)} s" for name, value in named.items())
            right.set_title(f"bead: {', '.join(seconds)}")
    return figure


def _plot_times(axes: Axes, at_c: np.ndarray, times: Mapping[str, np.ndarray]) -> None:
    for (name, values), colour in zip(times.items(), (BLUE, INK, GREY), strict=True):
        axes.semilogy(at_c, values, "o-", color=colour, label=f"film, {name}")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.legend(loc="best")
