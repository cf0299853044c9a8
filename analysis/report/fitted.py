"""What a fit says run by run, as the figures want it: panels, residuals, and the diffusivity of each run alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shockrig.analysis.characterization.result import ChannelResult
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.quantity import QUANTITIES
from shockrig.analysis.inference.samples import model_at_samples
from shockrig.analysis.report.numbers import plain
from shockrig.analysis.report.parameters import RunParameter
from shockrig.analysis.report.residuals import ResidualRun
from shockrig.analysis.report.runs import RunPanel
from shockrig.files.campaign import Campaign, Trace

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
        for i, model in enumerate(model_at_samples(channel, part.fit)):
            direction, ambient_c, airflow, size = conditions(channel, i)
            flow = "" if airflow is None else f", {airflow:g} m/s"
            condition = f"{round(ambient_c)} °C, {direction} {plain(size, 2)} {quantity.unit}{flow}"
            time, value = channel.samples[i]
            drawn[channel.run_ids[i]] = RunPanel(channel.run_ids[i], condition, time, value, model)
    reasons = {entry.run: entry.reason for entry in found.set_aside}
    for run in campaign.runs:
        trace: Trace | None = getattr(run, quantity.sensor)
        if run.id in drawn or trace is None or not trace.time_s.size:
            continue
        time = trace.time_s - (run.start_s if run.start_s is not None else float(trace.time_s[0]))
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
