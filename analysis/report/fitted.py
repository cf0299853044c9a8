"""What a fit says run by run: panels, residuals, the diffusivity of each run alone, and one figure of it all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.characterize.result import ChannelResult, Characterization, TableRow
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import model_at_samples, model_between_samples
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.report.fit_figures import ResidualRun, RunParameter
from shockrig.analysis.report.panels import RunPanel, root_of, times_named
from shockrig.files.campaign import Campaign, Trace
from shockrig.files.campaign_views import zero_of
from shockrig.files.figures import CYCLE, INK, LIGHT, literal, notebook_figure, styled
from shockrig.files.headline import first_order, headlines
from shockrig.files.numbers import measured, plain
from shockrig.files.profile import Profile
from shockrig.files.profile_views import draw_diffusivity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What a fit says run by run, as the figures want it: panels, residuals, and the diffusivity of each run alone.

UNIT: dict[str, str] = {name: quantity.unit for name, quantity in QUANTITIES.items()}


def conditions(channel: Channel, i: int) -> tuple[str, float, float | None, float]:
    """Direction, ambient, airflow and size of a run's step."""
    c = channel.conditions
    step = float(channel.quantity.air_step(c)[i])
    airflow = float(c.airflow_m_s[i]) if c.airflow_known[i] else None
    return "up" if step > 0 else "down", float(c.destination_c[i]), airflow, abs(step)


def panels(campaign: Campaign, found: ChannelResult) -> list[RunPanel]:
    """Every run of a channel with its fit; those left out with the reason."""
    quantity = found.channel.quantity
    drawn: dict[str, RunPanel] = {}
    for part in found.parts:
        channel = part.channel
        curves = model_between_samples(channel, part.fit)
        for i, model in enumerate(model_at_samples(channel, part.fit)):
            direction, ambient_c, airflow, size = conditions(channel, i)
            flow = "" if airflow is None else f", {airflow:g} m/s"
            condition = f"{round(ambient_c)} °C, {direction} {plain(size, 2)} {quantity.unit}{flow}"
            time, value = channel.samples[i]
            drawn[channel.run_ids[i]] = RunPanel(channel.run_ids[i], condition, time, value, model, curve=curves[i])
    reasons = {entry.run: entry.reason for entry in found.set_aside}
    for run in campaign.runs:
        trace: Trace | None = getattr(run, quantity.sensor)
        if run.id in drawn or trace is None or not trace.time_s.size:
            continue
        time = trace.time_s - zero_of(run, trace)[0]
        value = trace.values[quantity.column]
        note = reasons.get(run.id, "left out")
        drawn[run.id] = RunPanel(run.id, "left out", time, value, note=note)
    return list(drawn.values())


def residuals(found: ChannelResult) -> list[ResidualRun]:
    """Residuals of every run at its samples, each run's own random effects included [channel's unit]."""
    runs = []
    for part in found.parts:
        for i, model in enumerate(model_at_samples(part.channel, part.fit)):
            time, value = part.channel.samples[i]
            runs.append(ResidualRun(part.channel.run_ids[i], time, value - model, *conditions(part.channel, i)))
    return runs


def single_runs(found: ChannelResult) -> list[RunParameter]:
    """The diffusivity of each run alone [m^2/s], with the start and airs that the joint fit gives it."""
    runs = []
    for part in found.parts:
        channel = part.channel
        alone = part.fit.own_rates()
        joint = channel.interpolation @ part.fit.log_rates
        for i, run in enumerate(channel.run_ids):
            # A run that says nothing of its rate may put it anywhere; its uncertainty drops it below.
            value = float(np.exp(np.clip(joint[i] + alone.own[i], -60.0, 60.0)) * channel.length_m**2)
            direction, ambient_c, airflow, size = conditions(channel, i)
            runs.append(RunParameter(run, value, value * float(alone.spread[i]), direction, ambient_c, airflow, size))
    return [run for run in runs if run.standard_uncertainty < 0.3 * run.value]


def relative_runs(found: ChannelResult) -> list[RunParameter]:
    """The diffusivity of each run alone as a ratio to the joint fit of its ambient."""
    joint = {run: row.diffusivity_m2_s for row in found.rows for run in row.runs}
    return [
        replace(r, value=r.value / joint[r.run], standard_uncertainty=r.standard_uncertainty / joint[r.run])
        for r in single_runs(found)
        if r.run in joint
    ]


@dataclass(frozen=True)
class Drift:
    """How a single run's diffusivity moves with a condition that it should not depend on.

    `change` is relative, from the lowest to the highest value in the campaign, the other conditions held; `sigmas` is
    that over its standard uncertainty, the scatter of the runs counted.
    """

    condition: str
    change: float
    sigmas: float

    @property
    def moves(self) -> bool:
        return abs(self.sigmas) > 4.0


def drifts(runs: Sequence[RunParameter], result: ChannelResult) -> list[Drift]:
    """Regression of the single runs' ln D on airflow, direction, amplitude and ambient, all at once.

    Conditions that did not vary, or that the campaign varied only together with others, are left out.
    """
    if not runs:
        return []
    columns = {
        "airflow": np.array([np.log(r.airflow_m_s) if r.airflow_m_s else np.nan for r in runs]),
        "direction": np.array([1.0 if r.direction == "up" else 0.0 for r in runs]),
        "amplitude": np.array([r.amplitude for r in runs], dtype=float),
    }
    if result.channel.quantity.pooled:
        columns["ambient"] = np.array([r.ambient_c for r in runs], dtype=float)
    columns = {k: (x - x.min()) / np.ptp(x) for k, x in columns.items() if np.isfinite(x).all() and np.ptp(x) > 1e-6}
    values = np.log([r.value for r in runs])
    if len(runs) < len(columns) + 4 or not columns:
        return []
    spread = np.array([r.standard_uncertainty / r.value for r in runs])
    design = np.column_stack([np.ones(len(runs)), *columns.values()])
    extra = 0.0
    for _ in range(20):  # the runs' own scatter, so that the weights are those of the runs as they are
        weight = 1.0 / (spread**2 + extra)
        normal = design.T @ (weight[:, None] * design)
        covariance = np.linalg.pinv(normal, hermitian=True)
        coefficient = covariance @ (design.T @ (weight * values))
        left = values - design @ coefficient
        freedom = len(runs) - design.shape[1]
        excess = float((weight * left**2).sum()) / freedom
        if excess <= 1.0:
            break
        extra = max(extra, 1e-9) + (excess - 1.0) / float(np.mean(weight))
    found = []
    for i, name in enumerate(columns, start=1):
        others = np.delete(design, i, axis=1)
        own = design[:, i] - others @ np.linalg.lstsq(others, design[:, i], rcond=None)[0]
        if own.std() < 0.3 * design[:, i].std():
            continue
        change, sigma = float(np.expm1(coefficient[i])), float(np.sqrt(covariance[i, i]))
        found.append(Drift(name, change, float(coefficient[i]) / sigma))
    return found


MOST_RUNS = 6  # of a channel; more curves lie on one another
AXIS = {"temperature": "temperature, °C", "humidity": "relative humidity, %"}


@styled
def plot_characterized(result: Characterization, profile: Profile) -> Figure:
    """Steps with their fits and residuals, a row for each sensor."""
    channels = result.channels()
    film = profile.humidity
    table = film is not None and len(film.diffusivity_table) > 1
    columns = 3 if table else 2
    figure = notebook_figure(3.6 * columns, 3.2 * len(channels))
    grid = figure.add_gridspec(len(channels), columns)
    words = dict(zip(("thermometer", "hygrometer"), ("temperature", "humidity"), strict=True))
    for row, (name, found) in enumerate(channels.items()):
        fitted = [panel for panel in panels(result.campaign, found) if panel.model is not None]
        shown = evenly(fitted, MOST_RUNS)
        last = columns - (1 if table and name == "humidity" else 0)
        steps = figure.add_subplot(grid[row, 0])
        left = figure.add_subplot(grid[row, 1:last], sharex=steps)
        _draw(steps, left, shown, found.noise.standard_deviation)
        head = next((f"{a}: {b}" for a, b in headlines(profile) if _of(a, name, words)), name)
        steps.set_title(literal(head), fontsize=8.5)
        count = f"{len(shown)} of {len(fitted)} runs" if len(shown) < len(fitted) else f"{len(fitted)} run"
        left.set_title(count + ("s" if len(fitted) != 1 and len(shown) == len(fitted) else "") + ", residuals")
        steps.set_ylabel(AXIS[name])
        left.set_ylabel(f"reading - fit, {QUANTITIES[name].unit}")
        if table and name == "humidity" and film is not None:
            draw_diffusivity(figure.add_subplot(grid[row, 2]), film, found.channel.lumped)
    return figure


def _of(headline: str, name: str, words: dict[str, str]) -> bool:
    """Whether a headline is of a channel: it names its sensor, or what that sensor's body is called."""
    sensor = next(sensor for sensor, channel in words.items() if channel == name)
    return sensor in headline or QUANTITIES["temperature" if name == "temperature" else "humidity"].noun in headline


def evenly(fitted: Sequence[RunPanel], most: int) -> list[RunPanel]:
    """Runs spread evenly over all, at most so many."""
    if len(fitted) <= most:
        return list(fitted)
    return [fitted[i] for i in np.unique(np.linspace(0, len(fitted) - 1, most).round().astype(int)).tolist()]


def _draw(steps: Axes, left: Axes, shown: Sequence[RunPanel], noise: float) -> None:
    from matplotlib.ticker import FixedLocator, StrMethodFormatter

    last_s = max(float(np.max(panel.time_s)) for panel in shown)
    first_s = max(min(float(np.min(panel.time_s)) for panel in shown), -0.05 * last_s)
    for number, panel in enumerate(shown):
        colour = CYCLE[number % len(CYCLE)]
        kept = (panel.time_s >= first_s) & (panel.time_s <= last_s)
        order = np.flatnonzero(kept)[np.argsort(panel.time_s[kept])]
        time, model = panel.time_s[order], panel.model
        assert model is not None
        curve = panel.curve or (time, model[order])
        steps.plot(time, panel.reading[order], ".", color=colour, markersize=2.4, alpha=0.5, label=panel.title)
        steps.plot(*curve, color=colour, lw=1.0)
        left.plot(time, (panel.reading - model)[order], ".", color=colour, markersize=1.8, alpha=0.6)
    left.axhspan(-2 * noise, 2 * noise, color=LIGHT, lw=0)
    left.axhline(0.0, color=INK, lw=0.6)
    ticks = times_named(first_s, last_s).tolist()
    for axes in (steps, left):
        # Time by its square root, so that the rise and the plateau can both be read.
        axes.set_xscale("function", functions=(root_of, _square))
        axes.set_xlim(first_s, last_s)
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:.6g}"))
        axes.set_xlabel("time since the transfer, as fitted, s (its square root)")


def _square(root: np.ndarray) -> np.ndarray:
    return np.sign(root) * np.square(root)


def rate_text(channel: Channel, row: TableRow, unit: str = "s") -> str:
    """Value and standard uncertainty, with the unit: m²/s, or `unit` of a lumped sensor's time constant."""
    if channel.lumped:
        return measured(*first_order(channel.length_m, row.diffusivity_m2_s, row.standard_uncertainty), unit)
    return measured(row.diffusivity_m2_s, row.standard_uncertainty, "m²/s")


def rate_label(channel: Channel, ambient_c: float) -> str:
    """What it is called, with its ambient [°C] where it depends on that."""
    label = channel.quantity.diffusivity_label(ambient_c)
    if channel.lumped:
        label = label.replace(channel.quantity.symbol, f"tau, {channel.name}", 1)
    return label
