"""Response times of runs, and what they say of the input: lengths in another unit, rates that no material has, runs of
another sensor.

A response time is told without a model of the sensor, as the time scale of whichever plain shape fits the campaign
best: S((t - t0) / t63) with start, time scale and both plateaus of its own for each run; the shape is one for all runs
of a channel, so that what it lacks is alike in all of them and response times can be compared to a few per cent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.checks.finding import InputFinding, limit
from shockrig.analysis.checks.signals import (
    CHANNEL_OF,
    DIE,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    Array,
    CampaignView,
    ColumnSeen,
    stated,
)
from shockrig.analysis.physics import modes as closed_forms
from shockrig.analysis.physics.modes import Modes, film_mean, film_mean_biot, first_order, sphere_core

SHAPES = {TEMPERATURE: ("sphere", "lag", "two lags"), HUMIDITY: ("film", "film behind air", "lag", "two lags")}
RUNS_TRIED = 8  # runs on which the shape is chosen
FEWEST_READINGS, MOST_READINGS = 6, 300  # of a run's transient; more are thinned out
TABLE_REACH = 30.0  # of the tables, in units of t63
STRETCHED, LATE = (0.9, 1.2, 1.5, 1.9), (-0.5, -0.25, -0.1, 0.0)  # in units of the rise
STARTS = np.array([(np.log(factor), late) for factor in STRETCHED for late in LATE])


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
    return x, modes.step(x * closed_forms.response_times(modes)[0])


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
        """What is left (..., n) at ln of the stretch and lateness (..., 2)."""
        stretch, late = rise * np.exp(parameters[..., :1]), parameters[..., 1:]
        model = np.interp((time - begin - rise * late) / stretch, x, table, left=0.0)
        model = model - model.mean(axis=-1, keepdims=True)
        power = (model * model).sum(axis=-1, keepdims=True)
        size = (model * centred).sum(axis=-1, keepdims=True) / np.where(power > 0.0, power, 1.0)
        return np.asarray(centred - size * model)

    start = STARTS[int(np.argmin(np.square(misfit(STARTS)).sum(axis=-1)))]
    # steps of a thousandth: the tables are straight between their points
    (log_share, late), *_ = leastsq(misfit, start, epsfcn=1e-6, maxfev=200, full_output=True)
    left = misfit(np.array([log_share, late]))
    return RunResponse(seen, float(rise * np.exp(log_share)), float(np.sqrt(np.square(left).mean())))


# Do numbers fall into two groups that no condition explains? Labels are free, so chance is counted.
#
# y = conditions @ b + z (d0 + d1 u) + scatter with a label z (0 or 1) for each run. Either the runs before some
# moment are one group and those after it the other, or the labels that leave the least are sought by flipping one at
# a time from many starts. The best of m labellings leaves, where there is nothing, about m^(-2 / dof) of the squares
# (the nearest of m random directions in dof dimensions): m is the number of moments, or 2^(n-1).

RANDOM_STARTS = 60
FEWEST_LEFT = 5  # degrees of freedom
SEPARATE_SHARE = 0.15  # share of the labels' squares that the conditions must leave unexplained
LEAST_SEPARATE = 0.05  # the same as a length, without one run


@dataclass(frozen=True)
class Grouping:
    """The best two groups of n runs.

    Attributes
    ----------
    second : ndarray (n,) of bool
        Who is in the second group.
    difference : float
        Root mean square of the difference between the groups, at the second one's conditions.
    scatter : float
        What is left within them (one sigma).
    chance : float
        Squares that are left, relative to what the best labels leave by chance.
    least_alone : float
        What the groups explain when any one run is taken out, at the least, in units of the scatter.
    """

    second: NDArray[np.bool_]
    difference: float
    scatter: float
    chance: float
    least_alone: float


def two_groups(
    y: Array, conditions: Sequence[Array], slope: Array | None = None, smallest_share: float = 0.2, seed: int = 0
) -> Grouping | None:
    """The two groups that explain most of `y` beyond `conditions`; None where too few runs remain.

    Parameters
    ----------
    y : ndarray (n,)
        In the order of the campaign.
    conditions : sequence of ndarray (n,)
        What `y` may depend on, a constant among them.
    slope : ndarray (n,), optional
        Along what the groups may also differ; without it they differ by a constant.
    smallest_share : float
        Of the runs in either group; at least three runs.
    seed : int
        Of the starts of the search.
    """
    n = y.size
    basis = _basis(conditions)
    left = n - basis.shape[1] - (1 if slope is None else 2)
    least = max(3, int(np.ceil(smallest_share * n)))
    if left < FEWEST_LEFT or 2 * least > n:
        return None
    away = np.eye(n) - basis @ basis.T  # takes the conditions out
    rest = away @ y
    total = float(rest @ y)
    if total <= 0.0:
        return None
    everyone = np.ones(n, dtype=bool)
    moments = [(np.arange(n) < i).astype(float) for i in range(least, n - least + 1)]
    gains = [_explained(y, conditions, slope, labels, everyone)[0] for labels in moments]
    candidates = [(moments[int(np.argmax(gains))], max(gains), np.log2(len(moments)))]
    best, gain = _search(rest, away, slope, least, np.random.default_rng(seed))
    if best is not None:
        candidates.append((best, gain, n - 1.0))
    found = []
    for labels, gain, bits in candidates:
        remaining = max(total - gain, 1e-12 * total)
        scatter = float(np.sqrt(remaining / left))
        alone = min(_explained(y, conditions, slope, labels, np.arange(n) != i)[0] for i in range(n))
        found.append(
            Grouping(
                second=labels > 0.0,
                difference=_explained(y, conditions, slope, labels, everyone)[1],
                scatter=scatter,
                chance=float(remaining / total * 2.0 ** (2.0 * bits / left)),
                least_alone=float(np.sqrt(alone)) / scatter,
            )
        )
    return min(found, key=lambda grouping: grouping.chance)


def _basis(columns: Sequence[Array]) -> Array:
    """Orthonormal columns that span the conditions; nearly dependent ones count once."""
    scaled = np.array([column / max(float(np.linalg.norm(column)), 1e-12) for column in columns]).T
    vectors, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return vectors[:, sizes > 0.05 * sizes[0]]


def _gains(first: Array, own: Array, share: Array, n: int, tilted: tuple[Array, Array, Array] | None) -> Array:
    """Squares that labellings explain, each entry one of them; 0 where the conditions already explain its labels.

    `first` is z' rest, `own` z' away z, `tilted` the same of z u: (zu)' rest, (zu)' away (zu), z' away (zu).
    """
    usable = own > SEPARATE_SHARE * n * share * (1.0 - share) + 1e-9
    own = np.maximum(own, 1e-9)
    gains = first**2 / own
    if tilted is not None:
        second, full, cross = tilted
        alone = full - cross**2 / own
        seen = alone > 0.05 * full + 1e-9
        gains = gains + np.where(seen, (second - cross / own * first) ** 2 / np.maximum(alone, 1e-9), 0.0)
    return np.asarray(np.where(usable, gains, 0.0))


def _search(
    rest: Array, away: Array, slope: Array | None, least: int, rng: np.random.Generator
) -> tuple[Array | None, float]:
    """Labels that explain most, from every start flipped one by one while that helps."""
    n = rest.size
    order = np.argsort(rest)
    cuts = np.unique(np.linspace(least, n - least, RANDOM_STARTS).astype(int))
    starts = [(np.arange(n) < i).astype(float) for i in cuts]  # exchanged in mid-campaign
    starts += [np.isin(np.arange(n), order[:i]).astype(float) for i in cuts]
    starts += list((rng.random((RANDOM_STARTS, n)) < 0.5).astype(float))
    u = np.zeros(n) if slope is None else slope
    diagonal = np.diag(away)
    best, most = None, 0.0
    for labels in starts:
        gain = 0.0
        while True:
            turn = 1.0 - 2.0 * labels  # what a flip of each label adds to it
            seen, leaning = away @ labels, away @ (labels * u)
            share = (labels.sum() + turn) / n
            tilted = None
            if slope is not None:
                tilted = (
                    labels * u @ rest + turn * u * rest,
                    labels * u @ leaning + 2.0 * turn * u * leaning + u**2 * diagonal,
                    labels @ leaning + turn * (leaning + u * seen) + u * diagonal,
                )
            gains = _gains(labels @ rest + turn * rest, labels @ seen + 2.0 * turn * seen + diagonal, share, n, tilted)
            gains[(share * n < least - 0.5) | (share * n > n - least + 0.5)] = 0.0
            i = int(gains.argmax())
            if gains[i] <= gain * (1.0 + 1e-9):
                break
            gain = float(gains[i])
            labels = labels.copy()
            labels[i] += turn[i]
        if gain > most * (1.0 + 1e-9):  # the same groups with their labels exchanged explain as much
            best, most = labels, gain
    return best, most


def _explained(
    y: Array, conditions: Sequence[Array], slope: Array | None, labels: Array, keep: NDArray[np.bool_]
) -> tuple[float, float]:
    """From the runs `keep`: the squares that the groups explain beyond the conditions, and their root mean square
    difference at the second group's conditions."""
    basis = _basis([column[keep] for column in conditions])
    away = np.eye(int(keep.sum())) - basis @ basis.T
    label = labels[keep]
    group = np.column_stack([label] if slope is None else [label, label * slope[keep]])
    beyond = away @ group
    scale = np.maximum(np.linalg.norm(group, axis=0), 1e-12)
    vectors, sizes, turned = np.linalg.svd(beyond / scale, full_matrices=False)
    informative = sizes > LEAST_SEPARATE
    along = np.where(informative, vectors.T @ y[keep], 0.0)
    found = (turned.T @ (along / np.where(informative, sizes, 1.0))) / scale
    return float(along @ along), float(np.sqrt(np.mean(np.square(group[label > 0.0] @ found))))


# D t63 / L^2 of a film's mean and alpha t63 / R^2 of a sphere's core after a step (analysis/physics/modes.py)
HALF_WAY_NUMBERS = {TEMPERATURE: 0.17091, HUMIDITY: 0.32025}
LENGTHS = {
    TEMPERATURE: ("imet", "bead_radius_m", "sphere", "alpha", "smallest_alpha_m2_s", "largest_alpha_m2_s"),
    HUMIDITY: ("hyt", "film_thickness_m", "film", "D", "smallest_d_m2_s", "largest_d_m2_s"),
}


def response_times(view: CampaignView) -> Iterator[InputFinding]:
    """What the response times of each channel say of stated lengths, and of the runs' belonging together."""
    for column in (TEMPERATURE, HUMIDITY):
        found = responses(view, column)
        if found:
            yield from _length_and_rate(view, column, found)
            yield from _another_sensor(view, column, found)


def _length_and_rate(view: CampaignView, column: str, found: list[RunResponse]) -> Iterator[InputFinding]:
    """A stated length in millimetres or micrometres, or a diffusivity that no material has.

    Only where the length is stated and the body is the one that it belongs to: else the rate alone is known.
    """
    sensor, key, body, symbol, smallest, largest = LENGTHS[column]
    length = view.campaign.sensors.get(sensor, {}).get(key)
    if length is None or view.campaign.bodies.get(sensor) != body:
        return
    t63 = float(np.median([r.t63_s for r in found]))
    rate = HALF_WAY_NUMBERS[column] * length**2 / t63
    low, high = limit(smallest), limit(largest)
    if low <= rate <= high:
        return
    runs = tuple(r.seen.run.id for r in found)
    shown = f"{key} of {length:g} m and a response time of {t63:.3g} s make {symbol} {rate:.2g} m²/s"
    plausible = f"plausible is {low:g} to {high:g}"
    for factor, unit in ((1e-3, "millimetres"), (1e-6, "micrometres")):
        if low <= rate * factor**2 <= high:
            yield InputFinding(
                f"length_in_{unit}",
                CHANNEL_OF[column],
                runs,
                "stop",
                f"sensors.{sensor}.{key} in campaign.json seems to be in {unit} ({shown}; {plausible}): write "
                f"{length * factor:g}.",
            )
            return
    yield InputFinding(
        "implausible_rate",
        CHANNEL_OF[column],
        runs,
        "warn",
        f"{shown}, and {plausible}: check sensors.{sensor}.{key} and the unit of time_s; leave the length out where it "
        f"is not known, and {symbol} is quoted for the usual one.",
    )


def _another_sensor(view: CampaignView, column: str, found: list[RunResponse]) -> Iterator[InputFinding]:
    """Runs of another sensor among the rest: response times in two groups that no recorded condition explains."""
    found = [r for r in found if temperature_of(view, r.seen) is not None]
    if len(found) < 6:
        return
    conditions, slope = _conditions(view, found)
    airflow_known = all(r.seen.run.airflow_m_s is not None for r in found)
    share = limit("group_share" if airflow_known else "group_share_airflow_unknown")
    grouping = two_groups(np.log([r.t63_s for r in found]), conditions, slope, share)
    if grouping is None or not _certain(grouping, column):
        return
    second = grouping.second if grouping.second.sum() <= 0.5 * len(found) else ~grouping.second
    runs = tuple(r.seen.run.id for r, there in zip(found, second, strict=True) if there)
    yield InputFinding(
        "another_sensor",
        CHANNEL_OF[column],
        runs,
        "warn",
        f"The response times in {FILES[column]} fall into two groups a factor {np.exp(grouping.difference):.2f} apart "
        f"that no recorded condition explains ({len(runs)} and {len(found) - len(runs)} runs, each alike to "
        f"{100 * grouping.scatter:.1f} %): {view.words(runs)} seem to be of another sensor, or of a condition that "
        "run.json does not state; make a campaign of each.",
    )


def _certain(grouping: Grouping, column: str) -> bool:
    least = limit("group_difference_film" if column == HUMIDITY else "group_difference")
    return (
        grouping.difference >= least
        and grouping.difference >= limit("group_over_scatter") * grouping.scatter
        and grouping.chance <= limit("group_chance")
        and grouping.least_alone >= limit("group_alone")
    )


def _conditions(view: CampaignView, found: list[RunResponse]) -> tuple[list[Array], Array | None]:
    """What a response time may depend on, as columns (n,), and along what two sensors may differ otherwise than by a
    factor: the temperature, where it varies (a film's D has its own dependence on it)."""
    seen = [r.seen for r in found]
    kelvin = np.array([temperature_of(view, s) for s in seen], dtype=float) + 273.15
    inverse = 1e4 * (1.0 / kelvin - 1.0 / 293.15)
    columns = [np.ones(len(seen)), inverse]
    airflows = [s.run.airflow_m_s for s in seen if s.run.airflow_m_s]
    if len(airflows) == len(seen):
        columns.append(np.log(airflows))
    if seen[0].column == TEMPERATURE:
        columns.append(np.sign([s.step for s in seen]))
        return columns, None
    columns.append(inverse**2)
    # direction, size and level of a humidity step matter in ways of their own: each kind of step is a condition
    kinds = list(zip(_levels([s.before for s in seen]), _levels([s.after for s in seen]), strict=True))
    columns += [np.array([kind == one for kind in kinds], dtype=float) for one in sorted(set(kinds))]
    return columns, inverse - inverse.mean() if np.ptp(inverse) > 1.0 else None


def _levels(values: list[float]) -> list[int]:
    """Values as numbered levels: a gap of more than 4 %RH begins a new one."""
    order = np.argsort(values)
    number = np.cumsum(np.diff(np.asarray(values)[order], prepend=values[order[0]]) > 4.0)
    return [int(n) for n in number[np.argsort(order)]]
