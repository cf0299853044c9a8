"""One channel of a campaign as arrays over runs: samples gathered into bins that widen with time since the transfer.

Averaging loses nothing where the response is slow and makes every later step an array operation of some 110 columns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.files.campaign import Air, Campaign, Run, Trace

Array = NDArray[np.float64]
ChannelName = Literal["temperature", "humidity"]

# Stated uncertainties of a campaign (formats.md section 1 promises them): one sigma.
TRIGGER_SCATTER_S = 0.010
AIR_TEMPERATURE_SCATTER_K = 0.02
AIR_HUMIDITY_SCATTER_PERCENT = 0.1
AMBIENT_WIDTH_K = 1.0

# A start time or an air that nobody recorded is estimated from the run itself; this is how little is then known of it.
UNKNOWN_START_SCATTER_S = 0.5
UNKNOWN_TEMPERATURE_SCATTER_K = 3.0
UNKNOWN_HUMIDITY_SCATTER_PERCENT = 10.0

# (until s after the transfer, width s): single samples first, then wider and wider.
BIN_PLAN = ((2.5, 0.1), (6.0, 0.2), (12.0, 0.4), (24.0, 0.8), (48.0, 1.6), (100.0, 3.2), (1e9, 10.0))


@dataclass(frozen=True)
class Conditions:
    """What each run was: arrays of shape (R,), SI or degC as named; `*_scatter` are one sigma of what is known."""

    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array
    airflow_m_s: Array
    pressure_hpa: Array
    start_s: Array
    start_scatter_s: Array
    source_c_scatter: Array
    destination_c_scatter: Array
    source_percent_scatter: Array
    destination_percent_scatter: Array
    airflow_known: NDArray[np.bool_]
    start_known: NDArray[np.bool_]
    airs_known: NDArray[np.bool_]
    irradiance_w_m2: Array
    duration_s: Array  # NaN where not measured
    ramp_ratio: Array  # how long a run's transfer takes, in units of the typical one
    ramp_own_s: Array  # a transfer's own duration where only some runs state it (slowed on purpose); NaN elsewhere


@dataclass(frozen=True)
class LeftOut:
    """A run that cannot be used, and why."""

    run: str
    channel: ChannelName
    reason: str


@dataclass(frozen=True)
class Channel:
    """Binned data of one channel.

    Attributes
    ----------
    time_s, value : ndarray (R, n)
        Mean time since the nominal transfer start [s] and mean reading [degC or %RH] of each bin.
    count : ndarray (R, n)
        Samples in each bin; 0 marks an empty one (its time and value are place-holders).
    die_c : ndarray (R, n)
        The HYT-271's own temperature, smoothed [degC]; NaN where there is none. Only in the humidity channel.
    ambient : ndarray (R,) of int
        Index into `ambients_c` (G,), the destination temperatures grouped within 1 K.
    interpolation : ndarray (R, G)
        ln rate of a run = interpolation @ ln rate of the ambients (linear in 1/T), so that destinations that differ a
        little within an ambient do not scatter its diffusivity. One column of ones for the bead.
    samples : tuple of (time_s, value) arrays
        The raw samples of each run, time since the nominal start.
    bin_of : tuple of int arrays
        The bin that each sample lies in; -1 for the few that stand so near the start that the trigger's own uncertainty
        leaves open on which side of it they are.
    """

    name: ChannelName
    run_ids: tuple[str, ...]
    time_s: Array
    value: Array
    count: NDArray[np.int64]
    die_c: Array
    conditions: Conditions
    ambient: NDArray[np.int64]
    ambients_c: Array
    interpolation: Array
    sampling_period_s: float
    length_m: float
    samples: tuple[tuple[Array, Array], ...]
    bin_of: tuple[NDArray[np.int64], ...]
    die_samples: tuple[Array, ...] = ()
    left_out: tuple[LeftOut, ...] = field(default=())

    @property
    def runs(self) -> int:
        return len(self.run_ids)

    def select(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Channel:
        """The same channel with only the runs `keep` (mask or indices); ambients keep their places."""
        index = np.flatnonzero(keep) if np.asarray(keep).dtype == bool else np.asarray(keep)
        conditions = Conditions(**{k: getattr(self.conditions, k)[index] for k in Conditions.__dataclass_fields__})
        return Channel(
            name=self.name,
            run_ids=tuple(self.run_ids[i] for i in index),
            time_s=self.time_s[index],
            value=self.value[index],
            count=self.count[index],
            die_c=self.die_c[index],
            conditions=conditions,
            ambient=self.ambient[index],
            ambients_c=self.ambients_c,
            interpolation=self.interpolation[index],
            sampling_period_s=self.sampling_period_s,
            length_m=self.length_m,
            samples=tuple(self.samples[i] for i in index),
            bin_of=tuple(self.bin_of[i] for i in index),
            die_samples=tuple(self.die_samples[i] for i in index) if self.die_samples else (),
            left_out=self.left_out,
        )


def build_channel(campaign: Campaign, name: ChannelName) -> Channel | None:
    """Gather one channel of a campaign; None where no run can be used (the reasons are then lost: see
    `usable_runs`)."""
    usable, left_out = usable_runs(campaign, name)
    if not usable:
        return None
    traces = [_trace(run, name) for run, _ in usable]
    starts = np.array([start for _, start in usable])
    conditions = _conditions([run for run, _ in usable], traces, starts, name)
    period = float(np.median(np.concatenate([np.diff(trace.time_s) for trace in traces])))
    # Times of the samples carry their own rounding; the nominal grid is used for lags only, never for the response.
    samples = tuple(
        (trace.time_s - start, trace.values[_column(name)]) for trace, start in zip(traces, starts, strict=True)
    )
    edges = _edges(min(float(t[0]) for t, _ in samples), max(float(t[-1]) for t, _ in samples), period)
    bin_of = _place(samples, edges, conditions.start_scatter_s)
    time, value, count = bin_means([t for t, _ in samples], [y for _, y in samples], bin_of)
    die_samples: tuple[Array, ...] = ()
    die = np.full(time.shape, np.nan)
    if name == "humidity":
        die_samples = _smooth_dies([t for t, _ in samples], [trace.values["temperature_c"] for trace in traces])
        die = bin_means([t for t, _ in samples], list(die_samples), bin_of)[1]
        die = np.where(count > 0, die, np.nan)
    ambient, ambients = group_ambients(conditions.destination_c)
    interpolation = (
        np.ones((len(usable), 1)) if name == "temperature" else _interpolation(conditions, ambient, ambients)
    )
    if name == "temperature":
        ambient, ambients = np.zeros(len(usable), dtype=int), np.array([float(np.mean(conditions.destination_c))])
    return Channel(
        name=name,
        run_ids=tuple(run.id for run, _ in usable),
        time_s=time,
        value=value,
        count=count,
        die_c=die,
        conditions=conditions,
        ambient=ambient,
        ambients_c=ambients,
        interpolation=interpolation,
        sampling_period_s=round(period, 4),
        length_m=campaign.bead_radius_m if name == "temperature" else campaign.film_thickness_m,
        samples=samples,
        bin_of=bin_of,
        die_samples=die_samples,
        left_out=tuple(left_out),
    )


def _column(name: ChannelName) -> str:
    return "temperature_c" if name == "temperature" else "humidity_percent"


def _trace(run: Run, name: ChannelName) -> Trace:
    trace = run.imet if name == "temperature" else run.hyt
    assert trace is not None
    return trace


def usable_runs(campaign: Campaign, name: ChannelName) -> tuple[list[tuple[Run, float]], list[LeftOut]]:
    """Runs of a campaign that can be used for a channel, each with its start [s], and those left out with the
    reason."""
    usable: list[tuple[Run, float]] = []
    left_out: list[LeftOut] = []
    for run in campaign.runs:
        reason, start = _judge_run(run, name)
        if reason is None:
            usable.append((run, start))
        else:
            left_out.append(LeftOut(run.id, name, reason))
    return usable, left_out


def _judge_run(run: Run, name: ChannelName) -> tuple[str | None, float]:
    trace = run.imet if name == "temperature" else run.hyt
    file = "imet.csv" if name == "temperature" else "hyt.csv"
    if trace is None:
        return f"no {file}", np.nan
    if trace.time_s.size < 30:
        return f"only {trace.time_s.size} usable samples in {file}", np.nan
    start = run.start_s
    if start is None:
        start = estimate_start(run, name)
        if start is None:
            return "no transfer.start_s, and no step stands out of the noise to estimate it from", np.nan
    time, value = trace.time_s, trace.values[_column(name)]
    before = time < start - 0.05
    if before.sum() < 8 or start - time[0] < 1.0:
        return f"the plateau before the transfer is missing ({int(before.sum())} samples)", start
    if time[-1] - start < 5.0 or (time > start).sum() < 20:
        return f"too short: {max(time[-1] - start, 0):.1f} s after the transfer", start
    if name == "humidity" and not all(_has_temperature(run, air) for air in (run.source, run.destination)):
        return "an air's temperature is unknown, and no thermometer recorded it", start
    period = float(np.median(np.diff(time)))
    near = time[(time > start - 2 * period - 0.5) & (time < start + 3.0 + 6 * period)]
    gap = float(np.diff(near).max()) if near.size > 1 else np.inf
    if gap > max(0.8, 5 * period):
        return f"a gap of {gap:.1f} s over the transfer", start
    end = value[time > time[-1] - 5.0].mean()
    drift = _drift(time[before], value[before])
    step = abs(end - value[before].mean())
    limit = max(0.15 if name == "temperature" else 0.8, 0.02 * step)
    if abs(drift) > limit:
        unit = "K" if name == "temperature" else "%RH"
        return f"not settled before the transfer: the plateau drifts by {drift:+.2f} {unit}", start
    return None, float(start)


def _has_temperature(run: Run, air: Air) -> bool:
    """Whether the temperature of an air is recorded, or can be taken from a plateau."""
    return air.temperature_c is not None or any(
        trace is not None and np.isfinite(trace.values["temperature_c"]).any() for trace in (run.imet, run.hyt)
    )


def _drift(time: Array, value: Array) -> float:
    """Drift over the plateau before the transfer: last third minus first third, by medians."""
    third = max(value.size // 3, 1)
    return float(np.median(value[-third:]) - np.median(value[:third]))


def estimate_start(run: Run, name: ChannelName) -> float | None:
    """Transfer start [s] of a run that nobody triggered, from the first departure from the plateau; None without
    one."""
    found: list[float] = []
    for trace, column in ((run.imet, "temperature_c"), (run.hyt, "humidity_percent")):
        if trace is None or trace.time_s.size < 60:
            continue
        time, value = trace.time_s, trace.values[column]
        head = max(int(0.05 * value.size), 20)
        level, noise = np.median(value[:head]), max(1.4826 * np.median(np.abs(np.diff(value))) / 1.41, 1e-3)
        step = np.median(value[-head:]) - level
        if abs(step) < 25 * noise:
            continue
        beyond = np.abs(value - level) > max(6 * noise, 0.03 * abs(step))
        steady = beyond & np.roll(beyond, -1) & np.roll(beyond, -2)
        if steady[:-2].any():
            first = int(np.argmax(steady[:-2]))
            # Walk back along the first rise to where it leaves the plateau.
            ahead = min(first + 3, value.size - 1)
            slope = (value[ahead] - value[first]) / (time[ahead] - time[first])
            back = (value[first] - level) / slope if slope * step > 0 else 0.0
            found.append(float(time[first] - np.clip(back, 0.0, 1.0)))
    return min(found) if found else None


def _conditions(runs: list[Run], traces: list[Trace], starts: Array, name: ChannelName) -> Conditions:
    def plateau(trace: Trace, column: str, start: float, after: bool) -> float:
        time = trace.time_s
        values = trace.values[column][time > time[-1] - 5.0 if after else time < start - 0.2]
        values = values[np.isfinite(values)]
        return float(values.mean()) if values.size else np.nan

    def air(kind: str, quantity: str) -> tuple[Array, Array]:
        values, scatters = [], []
        stated = AIR_TEMPERATURE_SCATTER_K if quantity == "temperature_c" else AIR_HUMIDITY_SCATTER_PERCENT
        unknown = UNKNOWN_TEMPERATURE_SCATTER_K if quantity == "temperature_c" else UNKNOWN_HUMIDITY_SCATTER_PERCENT
        for run, start in zip(runs, starts, strict=True):
            value = getattr(getattr(run, kind), quantity)
            scatters.append(stated if value is not None else unknown)
            if value is None:
                trace = run.hyt if quantity == "humidity_percent" else (run.imet or run.hyt)
                value = plateau(trace, quantity, start, kind == "destination") if trace is not None else np.nan
                if not np.isfinite(value):
                    value = 20.0 if quantity == "temperature_c" else 50.0
            values.append(value)
        return np.array(values), np.array(scatters)

    source_c, source_c_scatter = air("source", "temperature_c")
    destination_c, destination_c_scatter = air("destination", "temperature_c")
    source_percent, source_percent_scatter = air("source", "humidity_percent")
    destination_percent, destination_percent_scatter = air("destination", "humidity_percent")
    airflow_known = np.array([run.airflow_m_s is not None for run in runs])
    start_known = np.array([run.start_s is not None for run in runs])
    quantity = "temperature_c" if name == "temperature" else "humidity_percent"
    airs_known = np.array(
        [getattr(run.source, quantity) is not None and getattr(run.destination, quantity) is not None for run in runs]
    )
    duration = np.array([np.nan if run.duration_s is None else run.duration_s for run in runs])
    all_timed = bool((np.nan_to_num(duration) > 0).all())
    return Conditions(
        source_c=source_c,
        destination_c=destination_c,
        source_percent=source_percent,
        destination_percent=destination_percent,
        airflow_m_s=np.array([5.0 if run.airflow_m_s is None else run.airflow_m_s for run in runs]),
        pressure_hpa=np.array([run.pressure_hpa for run in runs]),
        start_s=starts,
        start_scatter_s=np.where(start_known, TRIGGER_SCATTER_S, UNKNOWN_START_SCATTER_S),
        source_c_scatter=source_c_scatter,
        destination_c_scatter=destination_c_scatter,
        source_percent_scatter=source_percent_scatter,
        destination_percent_scatter=destination_percent_scatter,
        airflow_known=airflow_known,
        start_known=start_known,
        airs_known=airs_known,
        irradiance_w_m2=np.array([_extra(run, "irradiance_w_m2") for run in runs]),
        duration_s=duration,
        ramp_ratio=duration / np.median(duration) if all_timed else np.ones(len(runs)),
        ramp_own_s=np.full(len(runs), np.nan) if all_timed else np.where(duration > 0, duration, np.nan),
    )


def _extra(run: Run, key: str) -> float:
    value = run.extra.get(key)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0


def _edges(first: float, last: float, period: float) -> Array:
    # Half a period before zero, so that with one sample a period each narrow bin holds one sample.
    before = -np.arange(0.3, max(-first, 0.4) + 1.2, 1.2)[::-1]
    near = np.arange(-0.3 + period, 0.0, max(0.1, period))
    after = [0.0]
    for until, width in BIN_PLAN:
        step = max(width, period)
        while after[-1] < min(until, last) - 1e-9:
            after.append(after[-1] + step)
    return np.concatenate([before, near, after])


def _place(samples, edges: Array, start_scatter_s: Array) -> tuple[NDArray[np.int64], ...]:
    """Bin of each sample, empty bins left out of the numbering; -1 within four sigma of a known start."""
    places = []
    for (time, _), scatter in zip(samples, start_scatter_s, strict=True):
        place = np.searchsorted(edges, time + 1e-6, side="right") - 1
        open_side = (np.abs(time) < 4 * scatter) & (scatter < 0.1)
        places.append(np.where((place >= 0) & (place < edges.size - 1) & ~open_side, place, -1))
    filled = np.unique(np.concatenate(places))
    filled = filled[filled >= 0]
    renumber = np.full(edges.size, -1)
    renumber[filled] = np.arange(filled.size)
    return tuple(np.where(place >= 0, renumber[place], -1) for place in places)


def bin_means(
    times: list[Array], values: list[Array], bin_of: tuple[NDArray[np.int64], ...]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Mean time, mean value and count of each bin (R, n); an empty bin borrows the mean time of the other runs."""
    bins = max(int(place.max()) for place in bin_of) + 1
    time, value = np.zeros((len(times), bins)), np.zeros((len(times), bins))
    count = np.zeros((len(times), bins), dtype=int)
    for i, (t, y, place) in enumerate(zip(times, values, bin_of, strict=True)):
        ok = place >= 0
        n = np.bincount(place[ok], minlength=bins)
        time[i] = np.bincount(place[ok], t[ok], bins) / np.maximum(n, 1)
        value[i] = np.bincount(place[ok], y[ok], bins) / np.maximum(n, 1)
        count[i] = n
    typical = (time * count).sum(axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count > 0, time, typical), value, count


RAMPS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.4, 2.0, 3.0)


def _smooth_dies(times: list[Array], dies: list[Array]) -> tuple[Array, ...]:
    """Die temperatures without their noise: constant before the transfer, a smooth relaxation after it.

    The relaxation is a sum of first-order lags behind a ramp; the ramp's duration is the one, for all runs together,
    that leaves least (a transfer that takes time shows in the die as a start without a kink).
    """
    filled = [_fill(t, d) for t, d in zip(times, dies, strict=True)]
    levels = [float(np.mean(d[t <= 0])) if (t <= 0).any() else float(d[0]) for t, d in zip(times, filled, strict=True)]
    moved = [i for i, d in enumerate(filled) if np.isfinite(d).all() and abs(d[-20:].mean() - levels[i]) > 1.0]

    def relax(i: int, ramp_s: float) -> tuple[Array, float]:
        after = times[i] > 0
        basis = _lags(times[i][after], ramp_s)
        rows = np.vstack([basis, 1e-3 * np.sqrt(after.sum()) * np.eye(basis.shape[1])])
        right = np.concatenate([filled[i][after] - levels[i], np.zeros(basis.shape[1])])
        smooth = np.full(times[i].size, levels[i])
        smooth[after] += basis @ np.linalg.lstsq(rows, right, rcond=None)[0]
        return smooth, float(((smooth - filled[i]) ** 2).sum())

    ramp_s = min(RAMPS_S, key=lambda r: sum(relax(i, r)[1] for i in moved[:8])) if moved else 0.0
    return tuple(relax(i, ramp_s)[0] if np.isfinite(d).all() else d for i, d in enumerate(filled))


def _fill(time: Array, die: Array) -> Array:
    good = np.isfinite(die)
    if good.all():
        return die
    return np.interp(time, time[good], die[good]) if good.sum() >= 20 else np.full(time.size, np.nan)


def _lags(time: Array, ramp_s: float) -> Array:
    """Responses of first-order lags of 0.5 to 120 s to a ramp from 0 to 1 over `ramp_s`: (n, 12)."""
    tau = np.geomspace(0.5, 120.0, 12)
    if ramp_s == 0:
        return 1.0 - np.exp(-time[:, None] / tau)

    def integral(t: Array) -> Array:
        late = np.maximum(t, 0.0)[:, None]
        return late - tau * (1.0 - np.exp(-late / tau))

    return (integral(time) - integral(time - ramp_s)) / ramp_s


def group_ambients(destination_c: Array) -> tuple[NDArray[np.int64], Array]:
    """Destinations within 1 K of one another are one ambient: index of each run (R,) and the ambients' means (G,)."""
    order = np.argsort(destination_c, kind="stable")
    index = np.zeros(destination_c.size, dtype=int)
    group, first = -1, -np.inf
    for i in order:
        if destination_c[i] - first > AMBIENT_WIDTH_K:
            group, first = group + 1, destination_c[i]
        index[i] = group
    means = np.array([destination_c[index == g].mean() for g in range(group + 1)])
    return index, means


def _interpolation(conditions: Conditions, ambient: NDArray[np.int64], ambients: Array) -> Array:
    weights = np.zeros((ambient.size, ambients.size))
    weights[np.arange(ambient.size), ambient] = 1.0
    if ambients.size < 2:
        return weights
    inverse, at = 1.0 / (ambients + 273.15), 1.0 / (conditions.destination_c + 273.15)
    for i, g in enumerate(ambient):
        side = g + 1 if (at[i] < inverse[g] and g + 1 < ambients.size) or g == 0 else g - 1
        share = (at[i] - inverse[g]) / (inverse[side] - inverse[g])
        weights[i, g] -= share
        weights[i, side] += share
    return weights
