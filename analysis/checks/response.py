"""A run's response time without a model of the sensor: the time scale of whichever plain shape fits the campaign best.

S((t - t0) / t63) with start, time scale and both plateaus of its own for each run; the shape is one for all runs of a
channel, so that what it lacks is alike in all of them and response times can be compared to a few per cent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.checks.signals import DIE, HUMIDITY, TEMPERATURE, Array, CampaignView, ColumnSeen, stated
from shockrig.analysis.checks.thresholds import limit
from shockrig.analysis.physics.modes import Modes, film_mean, film_mean_biot, first_order, response_times, sphere_core

SHAPES = {TEMPERATURE: ("sphere", "lag", "two lags"), HUMIDITY: ("film", "film behind air", "lag", "two lags")}
RUNS_TRIED = 8  # runs on which the shape is chosen
FEWEST_READINGS, MOST_READINGS = 6, 300  # of a run's transient; more are thinned out
TABLE_REACH = 30.0  # of the tables, in units of t63


@dataclass(frozen=True)
class RunResponse:
    """The response of one run: its time to 63 % [s], and how far the shape is off (rms, as a share of the step)."""

    seen: ColumnSeen
    t63_s: float
    misfit: float


def responses(view: CampaignView, column: str) -> list[RunResponse]:
    """Response times of the runs of a channel that show one: a clear step; of the humidity only isothermal ones."""
    usable = [seen for seen in view.column(column) if _shows_a_response(view, seen)]
    if not usable:
        return []
    some = usable[:: max(len(usable) // RUNS_TRIED, 1)][:RUNS_TRIED]
    tried = {shape: [_fit(seen, shape) for seen in some] for shape in SHAPES[column]}
    best = min(tried, key=lambda shape: float(np.median([r.misfit for r in tried[shape]])))
    done = {r.seen.run.id: r for r in tried[best]}
    found = [done.get(seen.run.id) or _fit(seen, best) for seen in usable]
    return [r for r in found if r.t63_s >= limit("rate_resolved") * _fresh_every_s(r.seen)]


def begins_after(shape: str, share: float) -> float:
    """When a shape's response reaches `share` of its step, in units of its rise from 10 to 63 %."""
    x, table = _shape(shape)
    at, tenth = np.interp([share, 0.1], table, x)
    return float(at / (1.0 - tenth))


def temperature_of(view: CampaignView, seen: ColumnSeen) -> float | None:
    """The temperature at which a run ends, as its sensors read it, else as run.json states it [°C]."""
    for column in (DIE, TEMPERATURE):
        other = view.get(seen.run, column)
        if other is not None:
            return other.after
    return seen.run.destination.temperature_c


def isothermal(view: CampaignView, seen: ColumnSeen) -> bool | None:
    """Whether the temperature stays in a run, as its sensors read it, else as run.json states it; None: not known."""
    steps = [other.step for column in (TEMPERATURE, DIE) if (other := view.get(seen.run, column)) is not None]
    source, destination = stated(seen.run, TEMPERATURE)
    if not steps and source is not None and destination is not None:
        steps = [destination - source]
    return max(abs(step) for step in steps) <= limit("isothermal_k") if steps else None


def _shows_a_response(view: CampaignView, seen: ColumnSeen) -> bool:
    least = limit("rate_step_percent" if seen.column == HUMIDITY else "rate_step_k")
    if seen.run.air is not None or not seen.moves or abs(seen.step) < least:
        return False
    return (seen.column != HUMIDITY or bool(isothermal(view, seen))) and _near(seen).size >= FEWEST_READINGS


def _fresh_every_s(seen: ColumnSeen) -> float:
    """How often a reading is a fresh one [s]: a sensor that holds its readings changes them only so often."""
    changed = np.flatnonzero(np.diff(seen.value))
    apart = np.diff(seen.time_s[changed])
    return float(np.percentile(apart, 20)) if apart.size else float(np.ptp(seen.time_s))


def _begin_and_rise(seen: ColumnSeen) -> tuple[float, float]:
    begin = seen.crossing_s(0.1)
    return begin, max(seen.crossing_s(0.632) - begin, 0.3 * seen.period_s)


def _near(seen: ColumnSeen) -> NDArray[np.int64]:
    """Indices of the readings of the transient, with some of both plateaus."""
    begin, rise = _begin_and_rise(seen)
    before, after = begin - 4.0 * rise - 8.0 * seen.period_s, begin + 5.0 * rise + 4.0 * seen.period_s
    return np.flatnonzero((seen.time_s > before) & (seen.time_s < after))


@lru_cache
def _shape(name: str) -> tuple[Array, Array]:
    """A unit step's response over time in units of its t63, as a table."""
    x = np.concatenate([np.linspace(0.0, 3.0, 1501), np.linspace(3.0, TABLE_REACH, 2001)[1:]])
    if name == "two lags":  # equal ones: 1 - (1 + u) exp(-u), 63 % at u = 2.1462
        return x, 1.0 - (1.0 + 2.1462 * x) * np.exp(-2.1462 * x)
    shapes: dict[str, Callable[[], Modes]] = {
        "sphere": sphere_core,
        "film": film_mean,
        "film behind air": lambda: film_mean_biot(2.0),
        "lag": lambda: first_order(1.0),
    }
    modes = shapes[name]()
    return x, modes.step(x * response_times(modes)[0])


def _fit(seen: ColumnSeen, shape: str) -> RunResponse:
    """Least squares in ln t63 and the start; the plateaus follow in closed form."""
    from scipy.optimize import leastsq

    begin, rise = _begin_and_rise(seen)
    near = _near(seen)
    near = near[:: max(near.size // MOST_READINGS, 1)]
    time, value = seen.time_s[near], seen.value[near] / seen.step
    centred = value - value.mean()
    x, table = _shape(shape)

    def misfit(parameters: Array, /) -> Array:
        model = np.interp((time - begin - rise * parameters[1]) / (rise * np.exp(parameters[0])), x, table, left=0.0)
        model = model - model.mean()
        power = float(model @ model)
        return centred - (float(model @ centred) / power if power > 0.0 else 0.0) * model

    starts = [np.array([np.log(f), late]) for f in (0.9, 1.2, 1.5, 1.9) for late in (-0.5, -0.25, -0.1, 0.0)]
    start = min(starts, key=lambda p: float(np.square(misfit(p)).sum()))
    # steps of a thousandth: the tables are straight between their points
    (log_share, late), *_ = leastsq(misfit, start, epsfcn=1e-6, maxfev=200, full_output=True)
    left = misfit(np.array([log_share, late]))
    return RunResponse(seen, float(rise * np.exp(log_share)), float(np.sqrt(np.square(left).mean())))
