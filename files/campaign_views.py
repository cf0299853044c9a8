"""How a campaign shows itself: a card of HTML, labelled arrays, a figure of its readings.

pandas, xarray and matplotlib are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.campaign_data import CampaignData, Run
from shockrig.files.errors import InputError
from shockrig.files.figures import GREY, literal, notebook_figure, styled
from shockrig.files.views import UNITS, card, require_xarray

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from shockrig.files.traces import Trace

SHOWN = (("imet", "temperature_c", "thermometer, °C"), ("hyt", "humidity_percent", "hygrometer, %RH"))
PANEL_IN = (4.6, 3.6)
MOST_LABELS = 8  # of ambients beside a figure; more are told apart by nobody
SINCE = {
    "transfer": "time since the transfer, s",
    "step": "time since the step was seen, s",
    "first": "time since the first reading, s",
}


def campaign_card(campaign: CampaignData, notes: Sequence[str] = ()) -> str:
    """What a campaign holds: sensors, airs, runs; `notes` are sentences to add."""
    facts = [("folder", str(campaign.path)), ("runs", str(len(campaign.runs)))]
    for name, sensor in campaign.sensors.items():
        words = [str(sensor[key]) for key in ("kind", "serial") if sensor.get(key)]
        facts.append((name, ", ".join([*words, campaign.bodies.get(name, "")]).strip(", ")))
    facts += [("note", note) for note in notes]
    return card(f"Campaign {campaign.name}", facts, campaign.to_frame().dropna(axis="columns", how="all"))


def campaign_dataset(campaign: CampaignData) -> xr.Dataset:
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


@styled
def plot_campaign(campaign: CampaignData, runs: Sequence[str] | None = None) -> Figure:
    """Readings against time, a colour for each ambient, a panel for each sensor that recorded; `runs` are ids."""
    wanted = [run for run in campaign.runs if runs is None or run.id in runs]
    if not wanted:
        raise InputError(f"{campaign.name}: none of the runs {', '.join(runs or ())}; to_frame() lists them")
    panels = [one for one in SHOWN if any(getattr(run, one[0]) is not None for run in wanted)]
    if not panels:
        raise InputError(f"{campaign.name}: these runs have no readings; to_frame() says how many each has")
    ambients = [
        None if run.destination.temperature_c is None else round(run.destination.temperature_c) for run in wanted
    ]
    known = sorted({ambient for ambient in ambients if ambient is not None})
    colours = dict(zip(known, _colours(len(known)), strict=True))
    figure = notebook_figure(PANEL_IN[0] * max(len(panels), 1.3), PANEL_IN[1])
    drawn = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (sensor, column, label) in zip(drawn, panels, strict=True):
        zeros: dict[str, None] = {}
        for run, ambient in zip(wanted, ambients, strict=True):
            trace: Trace | None = getattr(run, sensor)
            if trace is None:
                continue
            zero_s, since = zero_of(run, trace)
            zeros[since] = None
            colour = GREY if ambient is None else colours[ambient]
            axes.plot(trace.time_s - zero_s, trace.values[column], color=colour, lw=0.8)
        axes.set_ylabel(label)
        # Runs of both kinds in one panel: each has its own zero, and the axis says so.
        axes.set_xlabel(SINCE[next(iter(zeros))] if len(zeros) == 1 else "time, s (zero: see title)")
        if len(zeros) > 1:
            words = " or ".join(SINCE[one].removeprefix("time since ").removesuffix(", s") for one in zeros)
            axes.set_title(f"zero: {words}")
    for ambient in known[:MOST_LABELS]:
        drawn[-1].plot([], [], color=colours[ambient], label=f"to {ambient:g} °C")
    if known:
        figure.legend(loc="outside right upper")
    if not drawn[0].get_title("left"):
        drawn[0].set_title(literal(campaign.name))
    return figure


def zero_of(run: Run, trace: Trace) -> tuple[float, str]:
    """Where the time of a run without a fit is counted from [s on its clock], and what that is (a key of SINCE)."""
    if run.start_s is not None:
        return run.start_s, "transfer"
    if run.step_seen is not None:
        return run.step_seen[0], "step"
    return (float(trace.time_s[0]) if trace.time_s.size else 0.0), "first"


def _colours(count: int) -> list[Any]:
    """As many colours from cold to warm."""
    from matplotlib import colormaps

    return [colormaps["turbo"](0.1 + 0.8 * i / max(count - 1, 1)) for i in range(count)]
