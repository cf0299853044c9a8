"""From a campaign's runs to a channel: which can be used, when they began, what their airs and the die's temperature
were.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from shockrig.analysis.estimate.channel import (
    AMBIENT_WIDTH_K,
    STARTS_WITHIN,
    Channel,
    LeftOut,
    between_ambients,
    bin_means,
    edges_after_transfer,
    fine_width,
    group_ambients,
    parted_where_bent,
    place,
)
from shockrig.analysis.estimate.driven_air import (
    Followed,
    averaged_over,
    begun_unsettled,
    edges_of_driven,
    follow,
    follow_step,
    trace_noise,
    without_noise,
)
from shockrig.analysis.estimate.quantity import HUMIDITY, QUANTITIES, TEMPERATURE, ChannelName, Quantity
from shockrig.analysis.estimate.without_model import (
    FEWEST_READINGS,
    estimate_start,
    half_way_s,
    resolved_half_way_s,
    runs_elsewhere,
)
from shockrig.analysis.physics.air_exchange import Conditions
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.analysis.physics.humidity import dew_point_c
from shockrig.files.campaign import Campaign, Run, Trace
from shockrig.files.numbers import counted

Array = NDArray[np.float64]

# How good the airs of a campaign really are that somebody wrote down: what readings at rest say of them.

FEWEST_RUNS = 4
APART_K = 5.0  # of the sources: from here on a gain of the sensor's calibration can be told from a scatter
WORSE_FACTOR = (
    5.0  # times what is promised; effects that differ from run to run (warming by airflow or light) reach 3.3
)


def scatter_of_stated(at_rest: Array, stated: Array, promised: float) -> float:
    """Standard uncertainty of stated source airs (R,), from the readings (R,) of a sensor that rested in them.

    A sensor's own offset and gain are taken out; what then scatters from run to run by much more than was promised is
    the airs. Returns `promised` where the readings do not contradict it, or are too few to.
    """
    if stated.size < FEWEST_RUNS:
        return promised
    design = np.ones((stated.size, 1))
    if np.ptp(stated) > APART_K:
        design = np.column_stack([design, stated - stated.mean()])
    off = at_rest - stated
    left = off - design @ np.linalg.lstsq(design, off, rcond=None)[0]
    found = float(np.sqrt((left**2).sum() / (stated.size - design.shape[1])))
    return found if found > WORSE_FACTOR * promised else promised


# The hygrometer's own temperature without its noise, and when it leaves the dew behind.

RAMPS_S = np.array([0.0, 0.2, 0.4, 0.7, 1.1, 1.8, 3.0])
LATE_S = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0])
EARLY_S = 5.0  # after the transfer, in which every reading counts
MOST_SHARE = 0.05  # of the time that a run has lasted, by which a clock may be late
SHORTEST_S = 1e-3  # of a ramp: below, it is a step
LAGS_S = np.geomspace(0.5, 120.0, 12)


def smooth_dies(times: Sequence[Array], dies: Sequence[Array], tempo: float) -> tuple[Array, ...]:
    """Die temperatures without their noise: constant before the transfer, a smooth relaxation after it.

    The relaxation is a sum of first-order lags behind a ramp that begins late. How long the ramp is, and how late, is
    what for all runs together leaves least: a transfer that takes time shows in the die as a start without a kink, a
    sensor that is logged late as a kink behind the transfer, a clock that runs fast as one that is the later the longer
    the run has lasted.
    """
    filled = [_fill(t, d) for t, d in zip(times, dies, strict=True)]
    levels = [float(np.mean(d[t <= 0])) if (t <= 0).any() else float(d[0]) for t, d in zip(times, filled, strict=True)]
    moved = [i for i, d in enumerate(filled) if np.isfinite(d).all() and abs(d[-20:].mean() - levels[i]) > 1.0]
    begun = _begun([times[i] for i in moved], [filled[i] - levels[i] for i in moved], tempo)

    def smooth(i: int) -> Array:
        basis = _lags(times[i] - _late_s(begun, -times[i][0]), float(begun[0]), tempo)
        return levels[i] + (basis @ _amounts(basis, filled[i] - levels[i]))[:, 0]

    return tuple(smooth(i) if np.isfinite(d).all() else d for i, d in enumerate(filled))


def _begun(times: Sequence[Array], rises: Sequence[Array], tempo: float) -> Array:
    """How all relaxations begin: length of the ramp [s], how late it begins [s], and by what share of the time that the
    run has lasted it is later."""
    if not times:
        return np.zeros(3)
    # What is before the transfer says nothing of it, and what is long after it little: one reading in ten.
    near = [np.flatnonzero((t > -0.2 * tempo) & ((t < EARLY_S * tempo) | (np.arange(t.size) % 10 == 0))) for t in times]
    time = np.full((len(times), max(k.size for k in near)), -np.inf)
    rise, lead_s = np.zeros(time.shape), np.array([-t[0] for t in times])
    for i, k in enumerate(near):
        time[i, : k.size], rise[i, : k.size] = times[i][k], rises[i][k]

    def left(begun: Array) -> float:
        basis = _lags(time - _late_s(begun, lead_s)[:, None], float(begun[0]), tempo)
        return float(((basis @ _amounts(basis, rise) - rise[..., None]) ** 2).sum())

    begun = min((np.array([ramp_s, late_s, 0.0]) for ramp_s in RAMPS_S * tempo for late_s in LATE_S * tempo), key=left)
    bounds = [(0.0, RAMPS_S[-1] * tempo), (0.0, LATE_S[-1] * tempo), (-MOST_SHARE, MOST_SHARE)]
    for _ in range(2):  # a simplex may shrink before it is there
        simplex = begun + np.vstack([np.zeros(3), np.diag([0.1 * tempo, 0.05 * tempo, 0.1 * MOST_SHARE])])
        begun = optimize.minimize(
            left,
            begun,
            method="Nelder-Mead",
            bounds=bounds,
            options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-4 * left(begun)},
        ).x
    return np.asarray(begun)


def _late_s(begun: Array, lead_s: Array) -> Array:
    return np.asarray(begun[1] + begun[2] * np.maximum(lead_s, 0.0))


def _amounts(basis: Array, rise: Array) -> Array:
    """How much of each lag dies show (..., 12, 1), by least squares that keeps the sizes small."""
    turned = np.swapaxes(basis, -1, -2)
    size = 1e-6 * (basis[..., 0] > 0).sum(axis=-1) + 1e-12
    return np.asarray(
        np.linalg.solve(turned @ basis + size[..., None, None] * np.eye(LAGS_S.size), turned @ rise[..., None])
    )


def _fill(time: Array, die: Array) -> Array:
    good = np.isfinite(die)
    if good.all():
        return die
    return np.interp(time, time[good], die[good]) if good.sum() >= 20 else np.full(time.size, np.nan)


def _lags(time: Array, ramp_s: float, tempo: float) -> Array:
    """Responses of first-order lags of 0.5 to 120 s to a ramp from 0 to 1 over `ramp_s`, (..., 12)."""
    tau = LAGS_S * tempo
    begun, ended = np.maximum(time, 0.0), np.maximum(time - ramp_s, 0.0)

    def behind(since: Array) -> Array:
        return np.asarray(1.0 - np.exp(-since[..., None] / tau))

    if ramp_s < SHORTEST_S:
        return behind(begun)
    return np.asarray(((begun - ended)[..., None] - tau * (behind(begun) - behind(ended))) / ramp_s)


def past_dew_s(conditions: Conditions, times: Sequence[Array], dies: Sequence[Array]) -> Array:
    """When each run's die passes the dew point of the destination [s] (R,); NaN where it never was below it."""
    dew = dew_point_c(np.clip(conditions.destination_percent, 1.0, 100.0), conditions.destination_c)
    passed = np.full(len(times), np.nan)
    for run, (time, die) in enumerate(zip(times, dies, strict=True)):
        below = (time > 0) & (die < dew[run])
        if conditions.source_c[run] < dew[run] and below.any():
            last = int(np.flatnonzero(below)[-1])
            ahead = min(last + 1, time.size - 1)
            rise = die[ahead] - die[last]
            share = np.clip((dew[run] - die[last]) / rise, 0.0, 1.0) if rise > 0 else 0.0
            passed[run] = time[last] + share * (time[ahead] - time[last])
    return passed


# Stated uncertainty of a trigger (formats.md section 1 promises it), and how little is known of a start that is
# estimated from the run itself: one sigma.
TRIGGER_SCATTER_S = 0.010
UNKNOWN_START_SCATTER_S = 0.5
SLOWEST_RECORDS = 4.0  # record lengths: the time constant of a reading that seems to have no end
UNKNOWN_START_SHARE = 0.5  # of the time to half of the step: a response that sets in late is seen late
ORDINARY_HALF_WAY_S = (0.25, 8.0)  # of the sensors that the bins and the limits below were laid out for
SLOWED_TIMES, SLOWED_FROM_S = 3.0, 0.5  # usual durations, and seconds, from which a transfer was slowed on purpose
UNKNOWN_AIRFLOW_M_S = 5.0
UNKNOWN_AMBIENT_WIDTH_K = 5.0  # of rooms and boxes that nobody measured; how D moves within it is interpolated
SLIGHT_STEP = 0.1  # of the largest step
UNSETTLED = "not settled before the transfer"  # why a run is left out whose plateau drifts
FEWEST_AFTER = 6  # readings after a transfer
SHORTEST_BEFORE = 2.0  # a record before a transfer, in times to half of the step; else 1 s


@dataclass(frozen=True)
class UsableRun:
    """A run that a channel can use: its trace, its start on the clock of the files [s], and its measured air."""

    run: Run
    trace: Trace
    start_s: float
    air: MeasuredAir | None


def usable_runs(campaign: Campaign, name: ChannelName) -> tuple[list[UsableRun], list[LeftOut]]:
    """Runs of a campaign that can be used for a channel, and those left out with the reason."""
    return _usable(campaign, QUANTITIES[name])[:2]


def _none_of(runs: int) -> str:
    return f"none of {runs} runs can" if runs > 1 else "the only run cannot"


def why_none(left_out: Sequence[LeftOut]) -> str:
    """What keeps a channel's runs from being used, in one phrase: first what most of them lack."""
    reasons = Counter(entry.reason for entry in left_out).most_common()
    if len(reasons) == 1:
        return f"{_none_of(len(left_out))} be used: {reasons[0][0]}"
    shown = "; ".join(f"{reason} ({counted(runs, 'run')})" for reason, runs in reasons[:3])
    rest = len(reasons) - 3
    more = f"; and {counted(rest, 'other reason')}, of {counted(sum(n for _, n in reasons[3:]), 'run')}" * (rest > 0)
    return f"{_none_of(len(left_out))} be used: {shown}{more}"


def _usable(campaign: Campaign, quantity: Quantity) -> tuple[list[UsableRun], list[LeftOut], float, float]:
    timed: list[UsableRun] = []
    reasons: dict[str, str] = {}
    for run in campaign.runs:
        one = _timed(run, quantity)
        if isinstance(one, str):
            reasons[run.id] = one
        else:
            timed.append(one)
    half_s = _half_way_s(timed, quantity)
    tempo = _tempo(half_s)
    timed = [_as_begun(one, quantity, tempo, half_s) for one in timed]
    usable = []
    # Where no run has a temperature, one is taken for all; a run without one among others that have it says nothing.
    needs_temperature = not quantity.pooled and any(_has_temperatures(one.run) for one in timed)
    for one in timed:
        reason = _unfit(one, quantity, tempo, half_s)
        if needs_temperature and one.air is None and not _has_temperatures(one.run):
            reason = "an air's temperature is unknown, and no thermometer recorded it"
        if reason is None:
            usable.append(one)
        else:
            reasons[one.run.id] = reason
    slight = _slight(usable, quantity, tempo)
    reasons |= slight
    usable = [one for one in usable if one.run.id not in slight]
    left_out = [LeftOut(run.id, quantity.name, reasons[run.id]) for run in campaign.runs if run.id in reasons]
    return usable, left_out, tempo, half_s


def _timed(run: Run, quantity: Quantity) -> UsableRun | str:
    """A run with its start, or why it cannot be used."""
    if quantity.name in run.set_aside:
        return run.set_aside[quantity.name]
    trace = quantity.recorded(run)
    if trace is None:
        return f"no {quantity.file}"
    if trace.time_s.size < FEWEST_READINGS:
        return f"only {trace.time_s.size} usable samples in {quantity.file}"
    if run.air is not None and quantity.column in run.air.values:
        start = run.start_s if run.start_s is not None else float(trace.time_s[0])
        air = _measured_air(run, quantity, start)
        return air if isinstance(air, str) else UsableRun(run, trace, start, air)
    start_s = run.start_s if run.start_s is not None else _found_start(run)
    if start_s is None:
        return "no transfer.start_s, and no step stands out of the noise to estimate it from"
    return UsableRun(run, trace, start_s, None)


def _found_start(run: Run) -> float | None:
    """Start of a run that nobody triggered: where its import saw it, which had the whole log and all of its sensors;
    else the earliest that its own readings show."""
    traces = [(quantity.recorded(run), quantity.column) for quantity in _BOTH]
    recorded = [(trace, column) for trace, column in traces if trace is not None]
    if run.step_seen is not None and any(trace.time_s[0] < run.step_seen[0] for trace, _ in recorded):
        return run.step_seen[0]
    found = [_start_of(trace, column) for trace, column in recorded]
    told = [start for start in found if start is not None]
    return min(told) if told else None


def _start_of(trace: Trace, column: str) -> float | None:
    """As `estimate_start`, once for each trace: looks at a campaign, its fits and its diagnosis all ask for it."""
    if trace not in _STARTS:
        found = estimate_start(trace.time_s, trace.values[column])
        if found is not None and found <= trace.time_s[0]:  # in the middle of a response: it began before the record
            found = float(trace.time_s[0] - np.median(np.diff(trace.time_s)))
        _STARTS[trace] = found
    return _STARTS[trace]


_STARTS: WeakKeyDictionary[Trace, float | None] = WeakKeyDictionary()


def _measured_air(run: Run, quantity: Quantity, start_s: float) -> MeasuredAir | str:
    """A run's air as it was; or why it is of no use."""
    trace = run.air
    assert trace is not None
    columns = {q.column: np.asarray(trace.values.get(q.column, np.full(trace.time_s.size, np.nan))) for q in _BOTH}
    good = np.isfinite(columns[quantity.column])
    if good.sum() < 5:
        return f"air.csv has only {int(good.sum())} values of {quantity.column}"
    time = trace.time_s[good] - start_s
    values = {}
    for column, value in columns.items():
        known = np.isfinite(value[good])
        filled = np.interp(time, time[known], value[good][known]) if known.sum() >= 2 else np.full(time.size, np.nan)
        values[column] = filled
    if (np.diff(time) <= 0).any():
        return "the times of air.csv do not run forward"
    lag_s = getattr(run.reference, quantity.reference_lag)
    return MeasuredAir(time, values[TEMPERATURE.column], values[HUMIDITY.column], lag_s)


_BOTH = (TEMPERATURE, HUMIDITY)


def _half_way_s(timed: list[UsableRun], quantity: Quantity) -> float:
    """Typical time to half of the step [s], at least that between two readings; NaN where no run tells."""
    halves = [
        half_way_s(one.trace.time_s - one.start_s, one.trace.values[quantity.column])
        for one in timed
        if one.air is None and np.ptp(one.trace.values[quantity.column]) > quantity.least_step
    ]
    told = [half for half in halves if np.isfinite(half)]
    return max(float(np.median(told)), _period_s(timed)) if told else float("nan")


def _period_s(runs: list[UsableRun]) -> float:
    """Typical time between two readings [s]."""
    return float(np.median(np.concatenate([np.diff(one.trace.time_s) for one in runs])))


def _tempo(half: float) -> float:
    """How much slower or faster a sensor is than the ordinary ones; 1 for these."""
    fast, slow = ORDINARY_HALF_WAY_S
    if not np.isfinite(half):
        return 1.0
    return half / fast if half < fast else half / slow if half > slow else 1.0


def _unfit(one: UsableRun, quantity: Quantity, tempo: float, half_s: float) -> str | None:
    """Why a run cannot be used; None where it can. A sensor that is halfway in `half_s` needs no
    longer plateau before than a few of these."""
    time, start = one.trace.time_s, one.start_s
    if one.air is not None:
        return None
    period = float(np.median(np.diff(time)))
    before = time < _before_s(one)
    half = half_s if np.isfinite(half_s) else np.inf
    fewest, least_s = 8 if period < 0.5 else 2, min(SHORTEST_BEFORE * half, 1.0)
    # A start that is estimated is the end of what is level, or the begin of a record in the middle of a response.
    stated = one.run.start_s is not None
    if stated and (before.sum() < fewest or start - time[0] < least_s):
        return (
            f"the plateau before the transfer is missing ({int(before.sum())} samples); it alone shows that the sensor "
            f"had settled, a stated air does not: record {fewest} samples and {least_s:.2g} s before it, or more"
        )
    after_s, after = max(time[-1] - start, 0.0), int((time > start).sum())
    if after < FEWEST_AFTER:
        return f"too short: {after_s:.1f} s and {after} samples after the transfer: record {FEWEST_AFTER} or more"
    begun = max(start, time[0])
    near = time[(time > begun - 2 * period - 0.5 * tempo) & (time < begun + 3.0 * tempo + 6 * period)]
    gap = float(np.diff(near).max()) if near.size > 1 else np.inf
    if gap > max(0.8 * tempo, 5 * period):
        return f"a gap of {gap:.1f} s over the transfer"
    step = _step_read(one, quantity, tempo)
    if not _airs_known(one.run, quantity) and step < quantity.least_step:
        return f"no {quantity.name} step ({step:.2g} {quantity.unit})"
    drift = _drift_before(one, quantity, step)
    return f"{UNSETTLED}: the plateau drifts by {drift:+.2f} {quantity.unit}" if drift else None


def _drift_before(one: UsableRun, quantity: Quantity, step: float) -> float:
    """How far the plateau before a run's start drifts; 0 where it may be taken for level: its first and its last third
    are no further apart than half of the readings are within them."""
    value = one.trace.values[quantity.column][one.trace.time_s < _before_s(one)]
    if value.size < 2:
        return 0.0
    third = max(value.size // 3, 1)
    low, middle, high = np.quantile([value[:third], value[-third:]], (0.25, 0.5, 0.75), axis=1)
    drift = float(middle[1] - middle[0])
    share = 0.02 if _airs_known(one.run, quantity) else 0.05
    return drift if abs(drift) > max(quantity.settled_within, share * step, *(high - low)) else 0.0


def _before_s(one: UsableRun) -> float:
    """Until when readings are surely before a run's start [s]."""
    return one.start_s - min(0.05, 0.5 * float(np.median(np.diff(one.trace.time_s))))


def _as_begun(one: UsableRun, quantity: Quantity, tempo: float, half_s: float) -> UsableRun:
    """A run whose readings show no plateau before the start that they were to tell: its record begins in the response.

    That is so as well where nobody recorded the airs and it drifts until then; what it drifted from is no source. How
    long ago the response began, nothing says but its own scale `half_s`, the time to half of a step: such a time is
    distributed exponentially, and as uncertain as it is long.
    """
    if one.air is not None or one.run.start_s is not None:
        return one
    trace, keep = one.trace, one.trace.time_s >= one.start_s
    open_airs = not _airs_known(one.run, quantity) and keep.sum() >= FEWEST_READINGS
    if open_airs and _drift_before(one, quantity, _step_read(one, quantity, tempo)):
        values = {column: value[keep] for column, value in trace.values.items()}
        trace = replace(trace, time_s=trace.time_s[keep], values=values)
    elif not _begun_before(one):
        return one
    ago_s = np.fmax(half_s, np.median(np.diff(trace.time_s)))
    return replace(one, trace=trace, start_s=float(trace.time_s[0] - ago_s))


def _step_read(one: UsableRun, quantity: Quantity, tempo: float) -> float:
    """From the readings' mean before the transfer to that of the last ones."""
    time, value = one.trace.time_s, one.trace.values[quantity.column]
    period = float(np.median(np.diff(time)))
    before = time < _before_s(one)
    last = time > time[-1] - max(5.0 * min(tempo, 1.0), 5 * period)
    return float(abs(value[last].mean() - (value[before].mean() if before.any() else value[0])))


def _airs_known(run: Run, quantity: Quantity) -> bool:
    return all(getattr(air, quantity.column) is not None for air in (run.source, run.destination))


def _slight(usable: Sequence[UsableRun], quantity: Quantity, tempo: float) -> dict[str, str]:
    """Runs whose step is slight beside the others', by id, with the reason: in airs that nobody recorded, what they do
    by themselves may be as large, and a hundredth of a large step's information is no loss."""
    own = [one for one in usable if one.air is None and one.run.start_s is None and not _airs_known(one.run, quantity)]
    steps = [_step_read(one, quantity, tempo) for one in own]
    most = max(steps, default=0.0)
    return {
        one.run.id: f"a step of {step:.2g} {quantity.unit} is slight beside {most:.2g} {quantity.unit} of another run, "
        "and its airs were not recorded"
        for one, step in zip(own, steps, strict=True)
        if step < SLIGHT_STEP * most
    }


def _has_temperatures(run: Run) -> bool:
    """Whether the temperatures of both airs are recorded, or can be taken from plateaus."""
    if any(t is not None and np.isfinite(t.values["temperature_c"]).any() for t in (run.imet, run.hyt)):
        return True
    return _airs_known(run, TEMPERATURE)


def _has_humidities(one: UsableRun) -> bool:
    """Whether the humidity of both airs is recorded, or can be taken from plateaus."""
    shown = [] if one.run.hyt is None else [one.run.hyt.values["humidity_percent"]]
    shown += [] if one.air is None else [one.air.humidity_percent]
    return any(np.isfinite(values).any() for values in shown) or _airs_known(one.run, HUMIDITY)


def build_channel(campaign: Campaign, name: ChannelName) -> Channel | None:
    """Gather one channel of a campaign; None where no run can be used (the reasons are then lost: see
    `usable_runs`)."""
    quantity = QUANTITIES[name]
    usable, left_out, tempo, half_s = _usable(campaign, quantity)
    if not usable:
        return None
    starts = np.array([one.start_s for one in usable])
    conditions = _conditions(usable, quantity, tempo, half_s)
    period = _period_s(usable)
    # Times of the samples carry their own rounding; the nominal grid is used for lags only, never for the response.
    samples = tuple(
        (one.trace.time_s - start, one.trace.values[quantity.column]) for one, start in zip(usable, starts, strict=True)
    )
    first, last = min(float(t[0]) for t, _ in samples), max(float(t[-1]) for t, _ in samples)
    air = tuple(one.air for one in usable)
    driven, reference_noise = any(one is not None for one in air), 0.0
    if driven:
        followed = _followed(samples, air, quantity)
        if not np.isfinite(half_s):
            tempo = _tempo(max(float(np.log(2.0) * np.median([one.time_constant_s for one in followed])), period))
        edges = edges_of_driven(first, last, period, followed)
        conditions = _with_scatter_before(conditions, quantity, air, followed)
        begin = (float(t[0]) for t, _ in samples)
        air, reference_noise = _as_driven(air, edges, zip(begin, followed, strict=True), quantity)
    else:
        fine = fine_width(samples, quantity.resolution)
        open_s = STARTS_WITHIN * float(np.where(conditions.start_known, 0.0, conditions.start_scatter_s).max())
        edges = edges_after_transfer(first, last, period, tempo, half_s, fine, open_s)
        if open_s > 0.0:
            edges = parted_where_bent(edges, samples, period, quantity.resolution, open_s)
    off_s = 0.0 if campaign.common is None else campaign.common.trigger_offset_s
    bin_of = place(samples, edges, np.hypot(conditions.start_scatter_s, off_s))
    time, value, count = bin_means([t for t, _ in samples], [y for _, y in samples], bin_of)
    die_samples: tuple[Array, ...] = ()
    die, wet = np.full(time.shape, np.nan), np.full(len(usable), np.nan)
    if quantity is HUMIDITY:
        times = [t for t, _ in samples]
        dies = [one.trace.values["temperature_c"] for one in usable]
        die_samples = tuple(dies) if driven else smooth_dies(times, dies, tempo)
        die = np.where(count > 0, bin_means(times, list(die_samples), bin_of)[1], np.nan)
        wet = past_dew_s(conditions, times, die_samples)
    ambient, ambients, interpolation = _ambients(usable, conditions, quantity)
    references = [getattr(one.run.reference, quantity.reference_uncertainty) for one in usable if one.air is not None]
    sensor = campaign.sensors.get(quantity.sensor, {})
    return Channel(
        quantity=quantity,
        body=campaign.bodies[quantity.sensor],
        kind=str(sensor.get("kind") or ""),
        run_ids=tuple(one.run.id for one in usable),
        time_s=time,
        value=value,
        count=count,
        die_c=die,
        conditions=conditions,
        ambient=ambient,
        ambients_c=ambients,
        interpolation=interpolation,
        sampling_period_s=float(f"{period:.6g}"),
        length_m=getattr(campaign, quantity.length),
        tempo=tempo,
        samples=samples,
        bin_of=bin_of,
        air=air,
        wet_until_s=wet,
        die_samples=die_samples,
        left_out=tuple(left_out),
        common=campaign.common,
        reference_known_to=float(np.median(references)) if references else 0.0,
        reference_noise=reference_noise,
    )


def _ambients(
    usable: Sequence[UsableRun], conditions: Conditions, quantity: Quantity
) -> tuple[NDArray[np.int64], Array, Array]:
    """Which ambient each run is of (R,), the ambients [degC] (G,), and each run's place between them (R, G)."""
    if quantity.pooled:
        mean_c = np.array([float(np.mean(conditions.destination_c))])
        return np.zeros(len(usable), dtype=int), mean_c, np.ones((len(usable), 1))
    recorded = all(one.air is not None or one.run.destination.temperature_c is not None for one in usable)
    ambient, ambients = group_ambients(
        conditions.destination_c, AMBIENT_WIDTH_K if recorded else UNKNOWN_AMBIENT_WIDTH_K
    )
    return ambient, ambients, between_ambients(conditions.destination_c, ambient, ambients)


def _followed(
    samples: Sequence[tuple[Array, Array]], airs: Sequence[MeasuredAir | None], quantity: Quantity
) -> list[Followed]:
    runs = [
        (t, y, air.time_s, quantity.of_air(air)) for (t, y), air in zip(samples, airs, strict=True) if air is not None
    ]
    behind = iter(follow(runs, quantity.resolution))
    return [
        follow_step(t, y, quantity.resolution) if air is None else next(behind)
        for (t, y), air in zip(samples, airs, strict=True)
    ]


def _as_driven(
    airs: Sequence[MeasuredAir | None], edges: Array, begun: Iterable[tuple[float, Followed]], quantity: Quantity
) -> tuple[tuple[MeasuredAir | None, ...], float]:
    """Measured airs as they drive the binned readings, without the reference's noise and the sensor's own state at the
    begin of its record in them; and how large that noise was."""
    driving: list[MeasuredAir | None] = []
    noises = []
    for air, (first_s, followed) in zip(airs, begun, strict=True):
        if air is None:
            driving.append(None)
            continue
        means, count = averaged_over(air, edges)
        noises.append(trace_noise(quantity.of_air(means)))
        off = (followed.excess, 0.0) if quantity is TEMPERATURE else (0.0, followed.excess)
        driving.append(begun_unsettled(without_noise(means, count), first_s, *off))
    return tuple(driving), float(np.median(noises))


def _with_scatter_before(
    conditions: Conditions, quantity: Quantity, air: Sequence[MeasuredAir | None], followed: Sequence[Followed]
) -> Conditions:
    """Conditions with how well it is known, in runs whose air was measured, what the sensor had settled to before."""
    name = f"{quantity.air_fields[1]}_scatter"
    measured = np.array([one is not None for one in air])
    before = np.array([one.excess_uncertainty for one in followed])
    return replace(conditions, **{name: np.where(measured, before, getattr(conditions, name))})


def _plateau(trace: Trace, column: str, start: float, after: bool, tempo: float) -> float:
    """Mean of the readings before the start, or of the last ones; the first reading where a record begins after the
    start, and NaN where there is none."""
    time, values = trace.time_s, trace.values[column]
    spacing = float(np.median(np.diff(time)))
    last = time > time[-1] - max(5.0 * min(tempo, 1.0), 5 * spacing)
    shown = values[last if after else time < start - min(0.2, 2 * spacing)]
    shown = shown[np.isfinite(shown)]
    if not shown.size and not after:
        shown = values[np.isfinite(values)][:1]
    return float(shown.mean()) if shown.size else np.nan


def _airs(
    usable: list[UsableRun], kind: str, of: Quantity, quantity: Quantity, tempo: float, unknown_start_s: float
) -> tuple[Array, Array]:
    """What the runs' source or destination airs (`kind`) were in one quantity (R,), and their scatters: measured, else
    stated, else as the sensor itself showed them, else as usual."""
    values, scatters = [], []
    for one in usable:
        run, value = one.run, getattr(getattr(one.run, kind), of.column)
        scatter = of.air_scatter if value is not None else of.unknown_air_scatter
        if one.air is not None:
            trace = of.of_air(one.air)
            known = trace[np.isfinite(trace)]
            if known.size:
                value = float(known[0] if kind == "source" else known[-max(known.size // 20, 1) :].mean())
                scatter = getattr(run.reference, of.reference_uncertainty)
        if value is None:
            after, other = kind == "destination", run.hyt if of is HUMIDITY else (run.imet or run.hyt)
            found = one.trace if of is quantity else other
            value = _plateau(found, of.column, one.start_s, after, tempo) if found is not None else np.nan
            if of is quantity and np.isfinite(value):
                if not after and _begun_before(one):  # by half of the step, in the time to half of it
                    value = 2.0 * value - _plateau(one.trace, of.column, one.start_s, True, tempo)
                unseen = _still_to_go(one, quantity, value) if after else _gone_before(one, quantity, unknown_start_s)
                scatter = float(np.hypot(scatter, unseen))
            if not np.isfinite(value):
                # Whoever logs no temperature at all goes from one air to another in one room, at about one temperature.
                value, scatter = of.usual_air, of.air_scatter
        values.append(value)
        scatters.append(max(scatter, 1e-6))
    return np.array(values), np.array(scatters)


def _conditions(usable: list[UsableRun], quantity: Quantity, tempo: float, half_s: float) -> Conditions:
    runs = [one.run for one in usable]
    spacing = float(np.median([np.median(np.diff(one.trace.time_s)) for one in usable]))
    own = np.nan_to_num(UNKNOWN_START_SHARE * half_s)
    unknown_start = max(UNKNOWN_START_SCATTER_S * min(tempo, 1.0), 2.0 * spacing, own)
    known_by = (quantity, tempo, unknown_start)
    source_c, source_c_scatter = _airs(usable, "source", TEMPERATURE, *known_by)
    destination_c, destination_c_scatter = _airs(usable, "destination", TEMPERATURE, *known_by)
    stated = np.array([one.air is None and one.run.source.temperature_c is not None for one in usable])
    if quantity is TEMPERATURE and stated.any() and not any(run.airflow_m_s is not None for run in runs):
        # On a bench that measures its airflow, effects that change with it are a likelier reason than its reference.
        rest = np.array([_plateau(one.trace, quantity.column, one.start_s, False, tempo) for one in usable])
        scatter = scatter_of_stated(rest[stated], source_c[stated], quantity.air_scatter)
        source_c_scatter = np.where(stated, scatter, source_c_scatter)
        destination_c_scatter = np.where(stated, np.maximum(scatter, destination_c_scatter), destination_c_scatter)
    source_percent, source_percent_scatter = _airs(usable, "source", HUMIDITY, *known_by)
    destination_percent, destination_percent_scatter = _airs(usable, "destination", HUMIDITY, *known_by)
    driven = np.array([one.air is not None for one in usable])
    start_known = np.array([run.start_s is not None for run in runs]) | driven
    airs_known = np.array([_airs_known(run, quantity) for run in runs])
    before_s = np.array([one.trace.time_s[0] - one.start_s if _begun_before(one) else 0.0 for one in usable])
    start_to_s = np.array([_start_known_to(one, unknown_start) for one in usable])
    duration = np.array([np.nan if run.duration_s is None else run.duration_s for run in runs])
    ramp_ratio, ramp_own_s = _ramps(duration, driven)
    halves = [
        resolved_half_way_s(one.trace.time_s - one.start_s, one.trace.values[quantity.column])
        if quantity.pooled and one.air is None
        else np.nan
        for one in usable
    ]
    airflow = np.array([np.nan if run.airflow_m_s is None else run.airflow_m_s for run in runs])
    elsewhere = runs_elsewhere(np.array(halves), [destination_c < source_c, airflow])
    return Conditions(
        source_c=source_c,
        destination_c=destination_c,
        source_percent=source_percent,
        destination_percent=destination_percent,
        airflow_m_s=np.array([UNKNOWN_AIRFLOW_M_S if run.airflow_m_s is None else run.airflow_m_s for run in runs]),
        pressure_hpa=np.array([run.pressure_hpa for run in runs]),
        start_s=np.array([one.start_s for one in usable]),
        start_scatter_s=np.where(start_known, TRIGGER_SCATTER_S, np.maximum(start_to_s, before_s)),
        source_c_scatter=source_c_scatter,
        destination_c_scatter=destination_c_scatter,
        source_percent_scatter=source_percent_scatter,
        destination_percent_scatter=destination_percent_scatter,
        airflow_known=np.array([run.airflow_m_s is not None for run in runs]),
        start_known=start_known,
        airs_known=airs_known | driven,
        humidity_known=np.array([_has_humidities(one) for one in usable]),
        irradiance_w_m2=np.array([_extra(run, "irradiance_w_m2") for run in runs]),
        duration_s=duration,
        ramp_ratio=ramp_ratio,
        ramp_own_s=ramp_own_s,
        elsewhere=elsewhere,
        order=np.arange(len(runs), dtype=float),
        hours=_hours(runs),
    )


def _start_known_to(one: UsableRun, unknown_s: float) -> float:
    """Standard uncertainty of a start that nobody stated [s]: the import's, where it is the import's."""
    seen = one.run.step_seen
    return seen[1] if seen is not None and seen[0] == one.start_s else unknown_s


def _ramps(duration_s: Array, driven: NDArray[np.bool_]) -> tuple[Array, Array]:
    """How long transfers (R,) took over the usual, where all were timed; and those that were slowed on purpose [s], NaN
    elsewhere: that such a run took as long as it did is part of what was done, and no fault of the bench."""
    timed = (np.nan_to_num(duration_s) > 0) & ~driven
    all_timed = bool((timed | driven).all())
    usual_s = float(np.median(duration_s[timed])) if timed.any() else np.nan
    own = timed & ((duration_s > max(SLOWED_TIMES * usual_s, SLOWED_FROM_S)) | (not all_timed))
    ratio = np.where(timed & ~own, duration_s / usual_s, 1.0) if all_timed else np.ones(duration_s.size)
    return ratio, np.where(own, duration_s, np.nan)


def _still_to_go(one: UsableRun, quantity: Quantity, end: float) -> float:
    """How far a reading that ends at `end` may still have to go.

    An exponential that moved by a in the third and by b in the last quarter of its record has b^2 / (a - b) to go
    (Aitken 1926). It is taken for no faster than to have a time constant of half of the record, and no slower than of
    `SLOWEST_RECORDS`.
    """
    time, value = one.trace.time_s, one.trace.values[quantity.column]
    few = max(time.size // 40, 1)
    first, last = max(one.start_s, time[0]), time[-1 - few]
    at = [int(np.searchsorted(time, last - share * (last - first))) for share in (0.5, 0.25, 0.0)]
    half, late, latest = (float(np.nanmedian(value[max(i - few, 0) : i + few + 1])) for i in at)
    third, fourth = late - half, latest - late
    slows = np.sign(third) * (third - fourth)
    fastest, slowest = (abs(latest - half) / np.expm1(0.5 / records) for records in (0.5, SLOWEST_RECORDS))
    to_go = fourth**2 / slows if slows > 0.0 and third * fourth > 0.0 else slowest
    return float(np.clip(to_go, fastest, slowest) + abs(latest - end))


def _begun_before(one: UsableRun) -> bool:
    """Whether a run's record begins in the middle of the response."""
    return one.air is None and one.start_s < one.trace.time_s[0]


def _gone_before(one: UsableRun, quantity: Quantity, unknown_start_s: float) -> float:
    """How far a reading may have gone before its record began: as far as it goes in it, where the record begins in the
    response; else as far as it goes at first in the time by which the response may have begun before the record."""
    time, value = one.trace.time_s, one.trace.values[quantity.column]
    if _begun_before(one):
        return float(np.ptp(value))
    if one.air is not None or one.run.start_s is not None:
        return 0.0
    unseen_s = max(unknown_start_s - (one.start_s - time[0]), 0.0)
    first, later = np.interp([one.start_s, one.start_s + unseen_s], time, value)
    return float(abs(later - first))


def _hours(runs: Sequence[Run]) -> Array:
    """When runs began, in hours since the first of them; NaN where a time is missing or none."""
    began = np.full(len(runs), np.nan)
    for i, run in enumerate(runs):
        try:
            began[i] = datetime.fromisoformat(run.started_at or "").timestamp() / 3600.0
        except (ValueError, OverflowError, OSError):
            continue
    return began - np.nanmin(began) if np.isfinite(began).any() else began


def _extra(run: Run, key: str) -> float:
    value = run.extra.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
