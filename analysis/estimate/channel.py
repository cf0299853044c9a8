"""One channel of a campaign as arrays over runs: samples gathered into bins that widen with time since the transfer.

Averaging loses nothing where the response is slow and makes every later step an array operation of some 110 columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.quantity import ChannelName, Quantity
from shockrig.analysis.physics.air_exchange import Conditions
from shockrig.analysis.physics.chain import MeasuredAir
from shockrig.files.campaign_names import KNOWN_KINDS
from shockrig.files.common_uncertainty import CommonUncertainty
from shockrig.files.headline import LUMPED

Array = NDArray[np.float64]
AMBIENT_WIDTH_K = 1.0


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
    quantity : Quantity
    body : str
        Shape of the sensing body, a key of `shockrig.analysis.physics.bodies.BODIES`.
    kind : str
        The sensor's kind as campaign.json has it; empty where it has none.
    run_ids : tuple of str
    time_s, value : ndarray (R, n)
        Mean time since the nominal transfer start [s] and mean reading [degC or %RH] of each bin.
    count : ndarray (R, n)
        Samples in each bin; 0 marks an empty one (its time and value are place-holders).
    die_c : ndarray (R, n)
        The hygrometer's own temperature, smoothed [degC]; NaN where there is none.
    conditions : Conditions
    ambient : ndarray (R,) of int
        Index into `ambients_c` (G,), the destination temperatures grouped within 1 K.
    interpolation : ndarray (R, G)
        ln rate of a run = interpolation @ ln rate of the ambients (linear in 1/T), so that destinations that differ a
        little within an ambient do not scatter its diffusivity. One column of ones where one rate holds at all.
    sampling_period_s, length_m : float
    readings_per_sample : int
        Readings that the logger takes in a sampling period: more than one where rows that repeat a reading are left
        out, and it takes all the same those that it does not show.
    tempo : float
        How much slower (or faster) the sensor is than those that the bins in time were laid out for: 1 for them.
    samples : tuple of (time_s, value) arrays
        The raw samples of each run, time since the nominal start.
    bin_of : tuple of int arrays
        The bin that each sample lies in; -1 for the few that stand so near the start that the trigger's own uncertainty
        leaves open on which side of it they are.
    die_samples : tuple of arrays
        The smoothed die temperature at the samples; empty where there is none.
    air : tuple of MeasuredAir or None, one for each run
    wet_until_s : ndarray (R,)
        When the die passes the destination's dew point [s]; NaN for runs that no dew falls in.
    left_out : tuple of LeftOut
    common : CommonUncertainty or None
        What may be off in all runs alike, where the campaign states it.
    reference_known_to : float
        Standard uncertainty of the reference that measured airs [the channel's unit]; 0 where none did.
    reference_noise : float
        Standard deviation of the means of its readings, before they were smoothed [the channel's unit]; 0 likewise.
    drifts : bool
        Whether airs that nobody recorded are taken to have moved on behind their steps.
    """

    quantity: Quantity
    body: str
    kind: str
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
    tempo: float
    samples: tuple[tuple[Array, Array], ...]
    bin_of: tuple[NDArray[np.int64], ...]
    air: tuple[MeasuredAir | None, ...]
    wet_until_s: Array
    die_samples: tuple[Array, ...] = ()
    left_out: tuple[LeftOut, ...] = field(default=())
    common: CommonUncertainty | None = None
    readings_per_sample: int = 1
    reference_known_to: float = 0.0
    reference_noise: float = 0.0
    drifts: bool = False

    @property
    def reading_period_s(self) -> float:
        """Time from one reading of the logger to the next [s]."""
        return self.sampling_period_s / self.readings_per_sample

    @property
    def name(self) -> ChannelName:
        """Of the channel."""
        return self.quantity.name

    @property
    def lumped(self) -> bool:
        """Whether no more is known of the sensor's body than that it is one lag: no length and no diffusivity."""
        return self.body == LUMPED

    @property
    def sensor(self) -> str:
        """What is looked at: a bead or a film, or an instrument of whose body nothing is known."""
        return self.quantity.instrument if self.lumped else self.quantity.noun

    @property
    def rate_name(self) -> str:
        """What its rate is called: alpha or D, which a lumped sensor has not."""
        return "rate" if self.lumped else self.quantity.symbol

    @property
    def runs(self) -> int:
        """Number of runs, R."""
        return len(self.run_ids)

    @property
    def rates(self) -> int:
        """Number of rates that are fitted, G: one for each ambient, or one in all."""
        return self.interpolation.shape[1]

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Runs (R,) whose air was measured all along."""
        return np.array([air is not None for air in self.air], dtype=bool)

    @cached_property
    def may_drift(self) -> NDArray[np.bool_]:
        """Runs (R,) whose air is taken to have moved on behind its step."""
        return self.drifts & ~self.conditions.airs_known & ~self.measured

    @cached_property
    def lasts_s(self) -> Array:
        """From each run's nominal start to its last sample (R,) [s]."""
        return np.array([max(float(time[-1]), self.sampling_period_s) for time, _ in self.samples])

    @property
    def rests_until_s(self) -> Array:
        """Until when each run's sensor shows the air before (R,) [s]: a start that nobody recorded may have been before
        its estimate."""
        return -np.maximum(2.0 * self.sampling_period_s, self.conditions.start_scatter_s)

    @property
    def isothermal(self) -> NDArray[np.bool_]:
        """Runs (R,) whose two airs have one temperature, within the width of an ambient."""
        return np.abs(self.conditions.thermal_step_k) <= AMBIENT_WIDTH_K

    @property
    def known_sensor(self) -> bool:
        """Whether it is one of the sensors whose body and resolution are known, or nothing speaks against it."""
        unnamed = not self.kind and self.tempo == 1.0 and bool(self.conditions.airflow_known.all())
        return self.kind in KNOWN_KINDS or unnamed

    @property
    def jumps_with_air(self) -> bool:
        """Whether a reading jumps with the air's temperature, as RH does that is read at it."""
        return not self.quantity.pooled

    def trace_of(self, air: MeasuredAir) -> Array:
        """What a measured air was in the channel's own quantity (m,)."""
        return air.temperature_c if self.quantity.pooled else air.humidity_percent

    @cached_property
    def _earlier_dies(self) -> dict[float, Array]:
        return {}

    def die_earlier_c(self, shift_s: float) -> Array:
        """The die's temperature (R, n) so long before each reading; computed once for each shift [s]."""
        if shift_s not in self._earlier_dies:
            traces = zip(self.time_s, self.samples, self.die_samples, strict=True)
            self._earlier_dies[shift_s] = (
                np.stack([np.interp(time - shift_s, t, die) for time, (t, _), die in traces])
                if shift_s > 0 and self.die_samples
                else self.die_c
            )
        return self._earlier_dies[shift_s]

    @property
    def begun_s(self) -> Array:
        """How long before its first reading each run's response began (R,) [s]; 0 where its record shows the begin, or
        the air was measured."""
        times = zip(self.samples, self.air, strict=True)
        return np.array([max(float(time[0]), 0.0) if air is None else 0.0 for (time, _), air in times])

    def at_rest(self) -> Array:
        """Random effects (R, U) of runs that are all as recorded."""
        return np.zeros((self.runs, self.quantity.run_effects))

    def select(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Channel:
        """The same channel with only the runs `keep` (mask or indices); ambients keep their places."""
        index = run_indices(keep)
        arrays = ("time_s", "value", "count", "die_c", "ambient", "interpolation", "wet_until_s")
        lists = ("run_ids", "samples", "bin_of", "air", "die_samples")
        picked: dict[str, Any] = {name: getattr(self, name)[index] for name in arrays}
        picked |= {name: tuple(getattr(self, name)[i] for i in index) for name in lists if getattr(self, name)}
        return replace(self, conditions=self.conditions.select(index), **picked)

    def without_lost_ambients(self) -> Channel:
        """The channel without the ambients that have no run."""
        groups = np.unique(self.ambient)
        if groups.size == self.rates:
            return self
        # A run's small distance from its ambient is bridged towards a neighbour; where that is gone, it counts as none.
        weights = self.interpolation[:, groups]
        weights = weights / weights.sum(axis=1, keepdims=True)
        return replace(
            self,
            ambient=np.searchsorted(groups, self.ambient),
            ambients_c=self.ambients_c[groups],
            interpolation=weights,
        )


def run_indices(keep: NDArray[np.bool_] | NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of runs from a mask or indices."""
    given = np.asarray(keep)
    return np.flatnonzero(given) if given.dtype == bool else given.astype(np.int64)


def group_ambients(destination_c: Array, width_k: float = AMBIENT_WIDTH_K) -> tuple[NDArray[np.int64], Array]:
    """Destinations within `width_k` are one ambient: index of each run (R,) and the ambients' means (G,)."""
    order = np.argsort(destination_c, kind="stable")
    index = np.zeros(destination_c.size, dtype=int)
    group, first = -1, -np.inf
    for i in order:
        if destination_c[i] - first > width_k:
            group, first = group + 1, destination_c[i]
        index[i] = group
    means = np.array([destination_c[index == g].mean() for g in range(group + 1)])
    return index, means


def between_ambients(destination_c: Array, ambient: NDArray[np.int64], ambients: Array) -> Array:
    """Weights (R, G) of the ambients' ln rates in each run's, linear in 1/T."""
    weights = np.zeros((ambient.size, ambients.size))
    weights[np.arange(ambient.size), ambient] = 1.0
    if ambients.size < 2:
        return weights
    inverse, at = 1.0 / (ambients + 273.15), 1.0 / (destination_c + 273.15)
    for i, g in enumerate(ambient):
        side = g + 1 if (at[i] < inverse[g] and g + 1 < ambients.size) or g == 0 else g - 1
        share = (at[i] - inverse[g]) / (inverse[side] - inverse[g])
        weights[i, g] -= share
        weights[i, side] += share
    return weights


Index = NDArray[np.int64]
Samples = Sequence[tuple[Array, Array]]

# (until s after the transfer, width s) for sensors of the tempo that this was laid out for.
BIN_PLAN = ((2.5, 0.1), (6.0, 0.2), (12.0, 0.4), (24.0, 0.8), (48.0, 1.6), (100.0, 3.2))
FAR_SHARE = 0.1  # of its distance from the transfer: a bin beyond the plan is as wide
BEFORE_S = 1.2  # width of a bin of the plateau before the transfer
STARTS_WITHIN = 3.0  # standard deviations of a start that nobody recorded, within which it is looked for
WIDENING = 0.25  # of a bin's distance from a start that nobody recorded: it is no wider
BENT = 4.0  # standard deviations that a bin is off the line between its neighbours by beyond theirs: readings turn
NEAR_S = 0.3  # before the transfer within which samples stand singly
FINE_BIN_WIDTHS = (
    0.015,
    0.08,
)  # widest bin, in times to half of the step and since the transfer, as noise and step allow


def fine_width(samples: Samples, resolution: float) -> float:
    """Widest bin, as a share of the response's own time, in which readings (times, values) of runs may be averaged.

    A response of time tau bends by step w^2 / (24 tau^2) within a bin of width w, in all R runs alike: that is to stay
    at a fifth of what the noise of the runs together leaves.
    """
    noise = _noise(samples, resolution)
    step = max(float(np.median([np.ptp(y) for _, y in samples])), noise)
    return float(np.clip(1.44 * np.sqrt(4.8 * noise / (step * np.sqrt(len(samples)))), *FINE_BIN_WIDTHS))


def _noise(samples: Samples, resolution: float) -> float:
    """Standard deviation of single readings, from the ends of runs, that no sensor rounds away."""
    # A mean square, not a median: rounded readings mostly repeat the one before.
    spread = [np.sqrt(0.5 * np.mean(np.square(np.diff(y[t > 0.6 * t[-1]])))) for t, y in samples]
    return max(float(np.median(spread)), resolution / np.sqrt(12.0))


def parted_where_bent(edges: Array, samples: Samples, period_s: float, resolution: float, open_s: float) -> Array:
    """The edges with bins within `open_s` of the estimated start cut to single readings in which those of a run turn.

    A response that begins amid a bin turns there by its slope: the mean of its readings is off the model's at their
    mean time. It is off the line between the bins beside it by twice as much, and more, than these are off theirs at
    the same curvature; where a response bends as smoothly as bins are laid out for, all are off alike.
    """
    noise, bent = _noise(samples, resolution), np.zeros(edges.size - 1, dtype=bool)
    for time, value in samples:
        at = np.searchsorted(edges, time, side="right") - 1
        inside = (at >= 0) & (at < bent.size)
        filled, place = np.unique(at[inside], return_inverse=True)
        count = np.bincount(place)
        t, y = (np.bincount(place, x[inside]) / count for x in (time, value))
        before_s, after_s = np.diff(t)[:-1], np.diff(t)[1:]
        share = before_s / (before_s + after_s)
        off = np.abs(y[1:-1] - ((1.0 - share) * y[:-2] + share * y[2:]))
        curved = np.pad(off / (before_s * after_s), 1)
        beyond = off - np.maximum(curved[:-2], curved[2:]) * before_s * after_s
        variance = 1.0 / count[1:-1] + (1.0 - share) ** 2 / count[:-2] + share**2 / count[2:]
        bent[filled[1:-1]] |= (beyond > BENT * noise * np.sqrt(variance)) & (count[1:-1] > 1)
    about = (edges[1:] > -open_s) & (edges[:-1] < open_s)
    singly = [np.arange(edges[k], edges[k + 1] - 0.5 * period_s, period_s)[1:] for k in np.flatnonzero(bent & about)]
    return np.sort(np.concatenate([edges, *singly]))


def edges_after_transfer(
    first_s: float,
    last_s: float,
    period_s: float,
    tempo: float,
    half_s: float = np.inf,
    fine: float = FINE_BIN_WIDTHS[1],
    open_s: float = 0.0,
) -> Array:
    """Edges of the bins of runs whose air changes once, from `first_s` to `last_s`.

    `half_s` is the time to half of the step, infinite or NaN where no run tells it; `fine` as from `fine_width`. A
    start that nobody recorded may lie `open_s` before its estimate, where no wide bin may hide what a model says, and
    is about there: no bin about that holds two readings, nor is one wide where a film begins like sqrt(t).
    """
    half = half_s if np.isfinite(half_s) else np.inf
    # Half a period before zero, so that with one sample a period each narrow bin holds one sample.
    wide, near = BEFORE_S * tempo, NEAR_S * tempo
    narrow = min(max(fine * half, 0.1 * tempo, period_s), wide)
    uncertain = np.arange(near, min(open_s, -first_s), narrow)
    begin = near + narrow * uncertain.size
    before = [begin]
    while before[-1] < max(-first_s, begin + 0.1 * tempo):
        before.append(before[-1] + max(wide, FAR_SHARE * before[-1]))
    close, apart = np.arange(-near + period_s, 0.0, max(0.1 * tempo, period_s)), np.inf
    after = [0.0]
    if open_s > 0.0:
        # A record that begins with the change has its readings whole periods after the estimate: amid their bins,
        # however a clock jitters.
        apart, half_period = WIDENING, 0.5 * period_s
        after.append(half_period)
        close = half_period - _widening(near + half_period - period_s, 0.1 * tempo, period_s)[:0:-1]
        close = close[close > -near]
    for until, width in (*BIN_PLAN, (np.inf, np.nan)):
        while after[-1] < min(until * tempo, last_s) - 1e-9:
            planned = width * tempo if np.isfinite(until) else FAR_SHARE * after[-1]
            widest = min(planned, fine * (half + after[-1]), apart * after[-1])
            after.append(after[-1] + max(widest, period_s))
    return np.concatenate([-np.array(before[::-1]), -uncertain[::-1], close, after])


def _widening(until_s: float, widest_s: float, period_s: float) -> Array:
    """Edges from 0 on, each as far from the one before as `WIDENING` of its distance, but for what bounds a bin."""
    edges = [0.0]
    while edges[-1] < until_s:
        edges.append(edges[-1] + max(min(WIDENING * edges[-1], widest_s), period_s))
    return np.array(edges)


def place(samples: Samples, edges: Array, start_scatter_s: Array) -> tuple[Index, ...]:
    """Bin of each sample, empty bins left out of the numbering; -1 within four sigma of a known start."""
    places = []
    for (time, _), scatter in zip(samples, start_scatter_s, strict=True):
        at = np.searchsorted(edges, time + 1e-6, side="right") - 1
        open_side = (np.abs(time) < 4 * scatter) & (scatter < 0.1)
        places.append(np.where((at >= 0) & (at < edges.size - 1) & ~open_side, at, -1))
    return _renumbered(places)


def _renumbered(places: Sequence[Index]) -> tuple[Index, ...]:
    filled = np.unique(np.concatenate(places))
    filled = filled[filled >= 0]
    number = np.full(int(filled.max(initial=-1)) + 2, -1)
    number[filled] = np.arange(filled.size)
    return tuple(np.where(at >= 0, number[at], -1) for at in places)


def bin_means(times: Sequence[Array], values: Sequence[Array], bin_of: Sequence[Index]) -> tuple[Array, Array, Index]:
    """Mean time, mean value and count of each bin (R, n); an empty bin borrows the mean time of the other runs."""
    bins = max(int(at.max()) for at in bin_of) + 1
    time, value = np.zeros((len(times), bins)), np.zeros((len(times), bins))
    count = np.zeros((len(times), bins), dtype=np.int64)
    for i, (t, y, at) in enumerate(zip(times, values, bin_of, strict=True)):
        ok = at >= 0
        n = np.bincount(at[ok], minlength=bins)
        time[i] = np.bincount(at[ok], t[ok], bins) / np.maximum(n, 1)
        value[i] = np.bincount(at[ok], y[ok], bins) / np.maximum(n, 1)
        count[i] = n
    typical = (time * count).sum(axis=0) / np.maximum(count.sum(axis=0), 1)
    return np.where(count > 0, time, typical), value, count


def rebin(channel: Channel, samples: Samples, bins: Sequence[Index], die: tuple[Array, ...], each: int) -> Channel:
    """The channel on one sample in `each`; bins that no run fills any longer are left out."""
    bin_of = _renumbered(bins)
    time, value, count = bin_means([t for t, _ in samples], [y for _, y in samples], bin_of)
    die_c = np.full(time.shape, np.nan)
    if die:
        die_c = np.where(count > 0, bin_means([t for t, _ in samples], list(die), bin_of)[1], np.nan)
    return replace(
        channel,
        time_s=time,
        value=value,
        count=count,
        die_c=die_c,
        samples=tuple(samples),
        bin_of=bin_of,
        die_samples=die,
        sampling_period_s=each * channel.sampling_period_s,
        readings_per_sample=each * channel.readings_per_sample,
    )


def as_single_samples(channel: Channel, times: Sequence[Array] | None = None) -> Channel:
    """The channel with every sample a bin of its own, dated `times` where that is not when it was logged."""
    dated = [t for t, _ in channel.samples] if times is None else times
    width = max(t.size for t in dated)
    shape = (channel.runs, width)
    time, value, count = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.int64)
    die = np.full(shape, np.nan)
    for i, (t, (_, y), at) in enumerate(zip(dated, channel.samples, channel.bin_of, strict=True)):
        time[i, : t.size], value[i, : t.size], count[i, : t.size] = t, y, at >= 0
        time[i, t.size :] = t[-1]
        if channel.die_samples:
            die[i, : t.size] = channel.die_samples[i]
    return replace(channel, time_s=time, value=value, count=count, die_c=die)


FIRST_LOG_BIN_S = 0.05  # before it, the air's own jump and when it came are all that is seen


def log_bins(time_s: Array, values: Array, bins: int = 24) -> tuple[Array, Array]:
    """Means of `values` (n,) in bins of equal width in log time from FIRST_LOG_BIN_S on; empty ones are left out."""
    time_s, values = np.asarray(time_s, dtype=float), np.asarray(values, dtype=float)
    keep = (time_s >= FIRST_LOG_BIN_S) & np.isfinite(values)
    time_s, values = time_s[keep], values[keep]
    if time_s.size == 0:
        return np.empty(0), np.empty(0)
    edges = np.geomspace(FIRST_LOG_BIN_S, max(time_s.max(), 2.0 * FIRST_LOG_BIN_S) * 1.0001, bins + 1)
    where = np.digitize(time_s, edges) - 1
    count = np.bincount(where, minlength=bins)[:bins]
    filled = count > 0
    mean_time = np.bincount(where, time_s, minlength=bins)[:bins][filled] / count[filled]
    mean = np.bincount(where, values, minlength=bins)[:bins][filled] / count[filled]
    return mean_time, mean
