"""The figure of a campaign and of a profile: only panels that something is drawn in, and axes that say what they are.

matplotlib is imported to draw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.errors import InputError
from shockrig.files.figures import BLUE, GREY, INK, literal, notebook_figure, styled
from shockrig.files.headline import LUMPED, headlines, time_text
from shockrig.files.profile_data import response_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from shockrig.files.campaign import Campaign, Run
    from shockrig.files.profile_data import HumidityProfile, Profile
    from shockrig.files.traces import Trace

SHOWN = (("imet", "temperature_c", "thermometer, °C"), ("hyt", "humidity_percent", "hygrometer, %RH"))
PANEL_IN = (4.6, 3.6)
MOST_LABELS = 8  # of ambients beside a figure; more are told apart by nobody
SINCE = {
    "transfer": "time since the transfer, s",
    "step": "time since the step was seen, s",
    "first": "time since the first reading, s",
}


@styled
def plot_campaign(campaign: Campaign, runs: Sequence[str] | None = None) -> Figure:
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
    seen = run.extra.get("step_seen_s")
    if isinstance(seen, int | float):
        return float(seen), "step"
    return (float(trace.time_s[0]) if trace.time_s.size else 0.0), "first"


def _colours(count: int) -> list[Any]:
    """As many colours from cold to warm."""
    from matplotlib import colormaps

    return [colormaps["turbo"](0.1 + 0.8 * i / max(count - 1, 1)) for i in range(count)]


@styled
def plot_profile(profile: Profile) -> Figure:
    """Response times with their uncertainty, and D over temperature as it is interpolated where a film has a table."""
    h, t = profile.humidity, profile.temperature
    table = h is not None and len(h.diffusivity_table) > 1
    lumped = profile.bodies["hyt"] == LUMPED
    figure = notebook_figure(9.2 if table else 6.0, 3.6)
    axes = figure.subplots(1, 2 if table else 1, squeeze=False)[0]
    if table and h is not None:
        draw_diffusivity(axes[0], h, lumped)
        axes[0].set_title(_bead_title(profile))
        _over_temperature(axes[1], h)
        return figure
    rows = {}
    if t is not None and t.response_time_s is not None:
        rows["thermometer"] = t.response_time_s
    if h is not None and (times := h.diffusivity_table[0].response_time_s) is not None:
        rows["hygrometer"] = times
    if rows:
        _times_as_bars(axes[0], rows)
    else:
        axes[0].axis("off")
        axes[0].text(0.0, 0.5, "\n".join(f"{name}: {value}" for name, value in headlines(profile)))
    axes[0].set_title(_bead_title(profile) or headlines(profile)[0][0] + ": " + headlines(profile)[0][1])
    return figure


def _bead_title(profile: Profile) -> str:
    """What is known of the thermometer, in a line."""
    if (t := profile.temperature) is None:
        return ""
    name, value = headlines(profile)[0]
    times = t.response_time_s
    rest = "" if times is None or profile.bodies["imet"] == LUMPED else f", t63 {time_text(times, 0)}"
    return f"{name}: {value}{rest}"


def draw_diffusivity(axes: Axes, h: HumidityProfile, lumped: bool) -> None:
    """D (of a lumped sensor tau) over temperature with its uncertainty, and as it is interpolated."""
    table = h.to_frame()
    at_c, value, sigma = (
        table[name].to_numpy() for name in ("ambient_temperature_c", "diffusivity_m2_s", "standard_uncertainty")
    )
    fine_c = np.linspace(at_c[0], at_c[-1], 200)
    between, spread = h.diffusivity_m2_s(fine_c)
    if lumped:
        square = h.film_thickness_m**2
        value, sigma = square / value, square * sigma / value**2
        between, spread = square / between, square * spread / between**2
    scale = 1.0 if lumped else 1e12
    axes.fill_between(fine_c, scale * (between - 2 * spread), scale * (between + 2 * spread), color=BLUE, alpha=0.2)
    axes.plot(fine_c, scale * between, color=BLUE, lw=1.0)
    axes.errorbar(
        at_c, scale * value, 2 * scale * sigma, fmt="o", color=BLUE, capsize=2, label="hygrometer, ± 2 standard unc."
    )
    axes.set_ylabel("tau, s" if lumped else "D, 10⁻¹² m²/s")
    axes.set_xlabel("ambient temperature, °C")
    axes.legend(loc="best")


def _over_temperature(axes: Axes, h: HumidityProfile) -> None:
    table = h.to_frame()
    at_c = table["ambient_temperature_c"].to_numpy()
    for name, colour in zip(("t63", "t90", "t98"), (BLUE, INK, GREY), strict=True):
        seconds, spread = (table[f"{name}{end}"].to_numpy() for end in ("_s", "_standard_uncertainty_s"))
        if np.isfinite(seconds).any():
            axes.errorbar(
                at_c, seconds, 2 * np.nan_to_num(spread), fmt="o-", color=colour, capsize=2, label=f"hygrometer, {name}"
            )
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.set_ylabel("response time, s")
    axes.set_xlabel("ambient temperature, °C")
    if axes.lines:
        axes.legend(loc="best")


def _times_as_bars(axes: Axes, rows: Mapping[str, Any]) -> None:
    """t63, t90 and t98 of each sensor with two standard uncertainties."""
    labels, seconds, spread = [], [], []
    for sensor, times in rows.items():
        columns = response_columns(times)
        for place, name in enumerate(("t63", "t90", "t98")):
            labels.append(f"{sensor}, {name}: {time_text(times, place)}")
            seconds.append(columns[f"{name}_s"])
            spread.append(2 * np.nan_to_num(columns[f"{name}_standard_uncertainty_s"]))
    axes.barh(labels, seconds, xerr=spread, color=BLUE, height=0.55, capsize=2)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("response time, s (± 2 standard uncertainties)")
