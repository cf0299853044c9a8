"""Readings that the air cannot have made, told by the sensor's own lag and noise, stretch by stretch.

Behind a lag, readings neither jump nor scatter faster than the lag lets through, and they never scatter less than the
sensor's noise: a stretch between two jumps is another quantity's, one that scatters more is noise (a radio), one that
scatters less is a sensor that is stuck, whatever dithers about it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.response import LagResponse
from shockrig.analysis.flight.sweep import COARSE_IN_NOISE

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_SHARE = 0.6  # of a step of the air that a sensor shows from one row to the next: one that is faster hides no jump
ROW_PHASES = 4  # at which the rows may meet the response to a step
LONGEST_ROWS = 2000
WINDOW_ROWS = 15  # rows that a stretch's noise is judged by
BURST_FACTORS = {WINDOW_ROWS: 3.0, 5: 8.0}  # times the usual, in so many rows: a burst
LEFT_SHARE = 0.1  # of a burst's noise, that its other readings show without the loudest
FELT_SHARE = 0.25  # of what readings scatter by, that a sensor beside them felt at most: they are noise
LEAST_TURNED = 0.2  # of the noise, that readings turn back by in the mean, where white noise turns back by 0.64
LONE_JUMP_SHARE = 0.3  # of the noise that third differences show, single ones show less at a lone jump
WHITE_SHARE = (
    0.6  # of the noise that single differences show, third ones show as much: what passed a lag is far smoother
)
JUMP_IN_NOISE = 12.0  # times the noise between rows
BESIDE_SHARE = (
    0.25  # of a jump, that the rows beside it go at most; behind a lag they go on by 1 - MOST_SHARE of it and more
)
# steps of the log: of a jump that a lag lets through the row beside goes 1 - MOST_SHARE, rounded by one step or less
JUMP_IN_STEPS = 1.0 / (1.0 - MOST_SHARE - BESIDE_SHARE)
FARTHEST_SWINGS = 2.0  # times what air swings: from a heated room into winter, in rows that the sensor follows
PARTED_ROWS = 10**6  # that a gap counts as, across which nothing is concluded
RETURN_SHARE = 0.5  # of a jump, that one back is at least where the air moved in between
DEGF_SHARE = 0.1  # of a jump, that readings in degF are away from those on its other side
APART_SHARE = 0.3  # of a jump, that the readings after another are away from those before
ROUNDING_FACTOR = 1.001  # of a step, what single precision makes of two readings that differ by it
STUCK_LEVELS = 1.5  # steps of the log about a level that a stuck sensor stays within, dither and all
BY_CHANCE = 1e-6  # probability that noise alone keeps so many readings there
NORM_3 = np.sqrt(20.0)  # of the third difference of white noise, over its standard deviation
NORM_1 = np.sqrt(2.0)


@dataclass(frozen=True)
class Felt:
    """What another sensor made of the same air at once, in the unit of the readings: `reading` (n,), NaN where there is
    none, its `noise` and its `resolution`."""

    reading: Array
    noise: float
    resolution: float


def largest_beside(size: Array, count: int = 1) -> Array:
    """The larger of the two steps (n,) beside each `count` of them in a row (n - count + 1,); 0 where there is none."""
    padded = np.pad(size, 1)
    return np.maximum(padded[: padded.size - count - 1], padded[count + 1 :])


def felt_jumps(felt: Felt, time_s: Array) -> Array:
    """Times (j, 2) of the two rows between which another sensor felt the air jump."""
    rows = np.flatnonzero(np.isfinite(felt.reading))
    size = np.abs(np.diff(felt.reading[rows]))
    if size.size < WINDOW_ROWS:
        return np.zeros((0, 2))
    least = JUMP_IN_NOISE * np.hypot(np.maximum(felt.noise, scatter(felt.reading[rows])[1:]), felt.resolution)
    beside = largest_beside(size)
    first, last = rows[:-1], rows[1:]
    jumped = (size > least) & (beside < BESIDE_SHARE * size) & (last - first == 1)
    return np.stack([time_s[first[jumped]], time_s[last[jumped]]], axis=1)


@dataclass(frozen=True)
class Stretches:
    """Rows (n,) `from_elsewhere` (between two jumps), `stuck` for longer than noise explains, and that `stood` as no
    air lets them up to a jump that no lag lets through; `louder` (n,): noise over what is stated; `own_steps` (n,): the
    sizes of such jumps that nothing explains, at the first row behind each."""

    from_elsewhere: Mask
    stuck: Mask
    louder: Array
    stood: Mask
    own_steps: Array


def fastest(response: LagResponse) -> LagResponse:
    """The one instant at which the sensor is fastest."""
    row = int(np.argmax(response.rate.max(axis=-1)))
    return response.at(slice(row, row + 1))


def largest_share(response: LagResponse, period_s: float) -> float:
    """Most of a step of the air that the sensor shows between two rows, wherever it falls, at its fastest."""
    modes = fastest(response).modes(0)
    lasting = min(3.0 / float(modes.rate.min()), LONGEST_ROWS * period_s)
    since = np.arange(0.0, lasting + 2 * period_s, period_s / ROW_PHASES)
    shown = 1.0 + np.exp(-np.outer(since, modes.rate)) @ modes.amplitude
    return float(np.clip(np.max(shown[ROW_PHASES:] - shown[:-ROW_PHASES]), 0.0, 1.0))


def judge(
    reading: Array,
    place: NDArray[np.int64],
    believed: Mask,
    resolution: float,
    noise: float,
    share: float,
    swing: float = np.inf,
    lagging: Array | None = None,
    spikes: Mask | None = None,
    felt: Felt | None = None,
) -> Stretches:
    """Judge readings (n,), of which some are `believed` so far.

    Parameters
    ----------
    place : ndarray (n,)
        Of each in a log that has lost no row.
    noise : float
        Standard deviation of single readings, as stated.
    share : float
        Most of a step of the air that the sensor shows between two rows (`largest_share`).
    swing : float
        Most that the air goes, and comes back; less is judged by the lag alone.
    lagging : ndarray (n,), optional
        What lags, where it is not the reading itself: a film's vapour, whose reading follows the temperature at once;
        NaN where that was not read.
    spikes : ndarray (n,), optional
        Readings that are not believed and may be the loudest of a burst.
    felt : Felt, optional
        By what lies beside a sensor so fast that its own readings cannot tell noise from air.
    """
    nothing = np.zeros(reading.shape, dtype=bool)
    found = Stretches(nothing, nothing.copy(), np.ones(reading.shape), nothing.copy(), np.zeros(reading.shape))
    rows = np.flatnonzero(believed)
    if rows.size < 2 * WINDOW_ROWS:
        return found
    least = float(np.hypot(JUMP_IN_NOISE * noise, JUMP_IN_STEPS * resolution))
    if share > MOST_SHARE:
        least = FARTHEST_SWINGS * swing
    stuck = stuck_rows(reading[rows], resolution, noise, scatter(reading[rows]))
    rows, lone = _of_this_sensor(rows, reading, place, lagging, least, swing, share, stuck)
    found.from_elsewhere[:] = believed
    found.from_elsewhere[rows] = False
    if rows.size < 2 * WINDOW_ROWS:
        return found
    values = reading[rows]
    third = scatter(values)
    if lagging is not None:
        found.stood[rows] = _stood(values, lone, resolution, _as_vapour(values, lagging[rows], resolution))
    elif felt is not None:
        if share > MOST_SHARE:
            lone = _unfelt(values, felt, rows, float(np.hypot(JUMP_IN_NOISE * noise, JUMP_IN_STEPS * resolution)))
        found.stood[rows] = _stood(values, lone, resolution, _as_felt(felt, rows, resolution))
    found.stuck[rows] = held = stuck_rows(values, resolution, noise, third)
    if share > MOST_SHARE and felt is None:
        return found
    usual, step = max(noise, resolution / np.sqrt(12.0)), resolution if resolution > COARSE_IN_NOISE * noise else 0.0
    if felt is None or share <= MOST_SHARE:
        felt, usual = None, max(float(np.median(third[~held])) if (~held).any() else 0.0, usual)
    found.louder[rows] = np.where(held, 1.0, _burst(reading, rows, usual, step, felt) / noise)
    if spikes is not None and spikes.any():
        # without its loudest readings what is left of a burst is more quiet than it was; of a few absurd ones nothing
        every = np.flatnonzero(spikes | (believed & ~found.from_elsewhere & ~found.stuck))
        also = _burst(reading, every, usual, step, felt)
        rest = np.maximum(*(scatter(values, window) for window in BURST_FACTORS))
        also[np.interp(every, rows, rest) < LEFT_SHARE * also] = 0.0
        found.louder[every] = np.maximum(found.louder[every], also / noise)
    np.maximum(found.louder, 1.0, out=found.louder)
    if share <= MOST_SHARE:
        # of a sensor in a burst, or one that was stuck, a jump is no change
        odd = maximum_filter1d((found.louder[rows] > 1.0) | held | found.stood[rows], 3)
        changed = lone[~odd[lone] & (np.diff(place[rows], prepend=-1)[lone] == 1)]
        found.own_steps[rows[changed]] = values[changed] - values[changed - 1]
    return found


def _of_this_sensor(
    rows: NDArray[np.int64],
    reading: Array,
    place: NDArray[np.int64],
    lagging: Array | None,
    least: float,
    swing: float,
    share: float,
    stuck: Mask,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of some rows (m,), at some of which the sensor was `stuck` (m,), those that are not from elsewhere, in what is
    read and in what lags; and, among these, the first behind jumps that none goes back from."""
    while True:
        elsewhere, lone = _elsewhere(place[rows], reading[rows], least, swing, share, stuck, lagging is None)
        if lagging is not None and (elsewhere.any() or lone.size):
            known = np.flatnonzero(np.isfinite(lagging[rows]))
            also, alone = elsewhere[known], lone[:0]
            if known.size >= 2 * WINDOW_ROWS:
                which = rows[known]
                also, alone = _elsewhere(place[which], lagging[which], least, swing, share, stuck[known])
            # of two ends one that the readings jump at is enough: at the other they stood as what lags had to move
            ends = np.flatnonzero(np.diff(also, prepend=False, append=False))
            for first, behind in ends.reshape(-1, 2):
                whole = first > 0 and behind < also.size
                elsewhere[known[first:behind]] |= whole and (known[first] in lone or known[behind] in lone)
            elsewhere[known] &= also
            # over what is not known it may have gone anywhere
            lone = np.intersect1d(lone, known[alone[np.diff(known, prepend=-1)[alone] == 1]])
        rows, stuck = rows[~elsewhere], stuck[~elsewhere]
        # without them another stretch may be seen from end to end: the air jumped within it
        if not elsewhere.any() or rows.size < 2 * WINDOW_ROWS:
            return rows, lone


def _burst(reading: Array, rows: NDArray[np.int64], usual: float, step: float, felt: Felt | None) -> Array:
    """Noise (m,) of readings (n,) at some `rows` (m,) in bursts far above the `usual`, of which nothing was `felt`; 0
    elsewhere. They may go to and fro by one `step` of the log anyhow."""
    if felt is None:
        return _louder(reading[rows], usual, step)
    read = np.isfinite(felt.reading[rows])
    beside = np.flatnonzero(read)
    if beside.size < 2 * WINDOW_ROWS:
        return np.zeros(rows.size)
    nearest = np.round(np.interp(np.arange(rows.size), beside, np.arange(beside.size))).astype(np.int64)
    other = felt.reading[rows[beside]]
    # one that is stuck feels nothing
    alive = ~stuck_rows(other, felt.resolution, felt.noise, scatter(other))

    def least(window: int) -> Array:
        # a few rows tell it badly, and what is loud is so with the rows beside it
        most = np.maximum(maximum_filter1d(scatter(other, window), 3), max(felt.noise, felt.resolution))
        # it tells of a window that it was read in the most of
        told = alive[nearest] & (uniform_filter1d(1.0 * read, window) > 0.5)
        return np.where(told, most[nearest] / FELT_SHARE, np.inf)

    return _louder(reading[rows], usual, step, least)


def _louder(values: Array, usual: float, step: float, least: Callable[[int], Array] | None = None) -> Array:
    """Noise (n,) of readings in bursts, far above the `usual` and above the `least` of a window; 0
    elsewhere."""
    louder = np.zeros(values.size)
    for window, times in BURST_FACTORS.items():
        third = scatter(values, window)
        loud = third > times * usual
        if least is not None:
            loud &= third > least(window)
        if not loud.any():
            continue
        single = _scatter(values, 1, window) / NORM_1
        loud &= (third > WHITE_SHARE * single) & (single > LONE_JUMP_SHARE * third)
        # behind a jump of the air readings go one way, and noise goes to and fro
        out, back = np.diff(values)[:-1], np.diff(values)[1:]
        turned = np.pad(np.where(out * back < 0.0, np.minimum(np.abs(out), np.abs(back)), 0.0), 1, mode="edge")
        loud &= uniform_filter1d(turned, window) > LEAST_TURNED * third
        # so does air at the edge of a code, but by one step at a time
        loud &= maximum_filter1d(turned, window) > ROUNDING_FACTOR * step
        # a window's median sees a burst from its middle to its middle; its rows at either end are as loud
        loud, wider = maximum_filter1d(loud, 5), maximum_filter1d(third, 5)
        louder = np.maximum(louder, np.where(loud, wider, 0.0))
    # a window's median may be small by chance: what lies between loud rows is of their burst
    around = maximum_filter1d(louder, WINDOW_ROWS)
    louder = np.where(minimum_filter1d(around, WINDOW_ROWS) > 0.0, np.maximum(louder, around * (louder == 0.0)), louder)
    louder = _from_its_first_step(louder, values, usual)
    # a few rows tell a burst's size badly: what its other rows show counts as well
    loud = louder > 0.0
    number = np.cumsum(np.diff(loud, prepend=False) & loud) * loud
    square = np.bincount(number, louder**2) / np.maximum(np.bincount(number), 1)
    return np.maximum(louder, np.where(loud, np.sqrt(square[number]), 0.0))


def _from_its_first_step(louder: Array, values: Array, usual: float) -> Array:
    """The noise (n,) of bursts from the first step on, and to the last, that no `usual` noise makes: a window's median
    may miss half a window at either end. One step in it may be small by chance, and two in a row are none of it."""
    step = np.abs(np.diff(values)) > JUMP_IN_NOISE * usual
    edge = np.diff((louder > 0.0).astype(int), prepend=0, append=0)
    wider = louder.copy()
    for first, behind in zip(np.flatnonzero(edge == 1).tolist(), np.flatnonzero(edge == -1).tolist(), strict=True):
        # the step k leads from row k to the next: into the burst's first row, and out of its last
        before, after = step[max(first - WINDOW_ROWS // 2, 0) : first][::-1], step[behind - 1 :][: WINDOW_ROWS // 2]
        wider[first - max(_goes_on(before) - 1, 0) : first] = louder[first]
        wider[behind : behind + max(_goes_on(after) - 1, 0)] = louder[behind - 1]
    return wider


def _goes_on(steps: Mask) -> int:
    """How many of the steps from an edge on belong to what begins there: up to the last before two that are small."""
    small = np.flatnonzero(~(steps[:-1] | steps[1:]))
    taken = np.flatnonzero(steps[: small[0]] if small.size else steps)
    return int(taken[-1]) + 1 if taken.size else 0


def scatter(values: Array, window: int = WINDOW_ROWS) -> Array:
    """Noise (n,) of readings, from their third differences in the rows around each."""
    return _scatter(values, 3, window) / NORM_3


def _scatter(values: Array, order: int, window: int) -> Array:
    """Robust standard deviation (n,) of the differences of some order in the rows around each; none where there are too
    few rows for one."""
    size = np.abs(np.diff(values, n=order))
    if not size.size:
        return np.zeros(values.shape)
    around = MAD_TO_SIGMA * median_filter(size, window, mode="mirror")
    ahead = (values.size - around.size) // 2
    return np.pad(around, (ahead, values.size - around.size - ahead), mode="edge")


def _elsewhere(
    place: NDArray[np.int64],
    values: Array,
    least: float,
    swing: float,
    share: float,
    stuck: Mask,
    in_degc: bool = False,
) -> tuple[Mask, NDArray[np.int64]]:
    """Readings (n,) at some places, between a jump of more than `least` and one back that no lag lets through, or
    between two of more than `swing` that no air makes; and those before or behind one such jump that the lag does not
    let through either, whichever are fewer. A sensor that was `stuck` (n,) jumps as it goes on: no stretch begins
    there. Readings that are `in_degc` may be in degF for a while. And the first readings behind jumps that no lag lets
    through and none goes back from."""
    step, apart = np.diff(values), np.diff(place)
    size = np.abs(step)
    usual = MAD_TO_SIGMA * float(np.median(size))
    beside = largest_beside(size)
    sudden = np.flatnonzero((size > max(least, JUMP_IN_NOISE * usual)) & (beside < BESIDE_SHARE * size)) + 1
    # over a gap a sensor gets anywhere, and over a long one the air; one end of a stretch may lie in one
    certain = apart < PARTED_ROWS
    refuted = (certain & ((share > MOST_SHARE) | (_within(share, apart) <= MOST_SHARE)))[sudden - 1]
    goes_on = stuck[sudden - 1] & ~stuck[sudden]
    away, alone = _in_degf(sudden, values[sudden - 1], values[sudden], refuted & in_degc, values.size)
    left = sudden[alone]
    elsewhere, without = _between(left, values[left - 1], values[left], refuted[alone], values, swing, goes_on[alone])
    away |= elsewhere
    alone[alone] = without
    # where a sensor was stuck it had been, and air does not go so far
    goes_on = maximum_filter1d(stuck, 3)[sudden] & (size[sudden - 1] <= FARTHEST_SWINGS * swing)
    alone &= refuted & ~goes_on
    # medians on either side: beside noise, and where a jump is met halfway
    calm = median_filter(values, 3, mode="nearest")
    before, after = calm[:-3], calm[3:]  # of the rows from the second
    limit = swing if _within(share, 3) <= MOST_SHARE else FARTHEST_SWINGS * swing
    met = np.abs(after - before)
    far = np.flatnonzero((met > limit) & (met >= maximum_filter1d(met, 5)))
    far = far[np.diff(far, prepend=-9) > 2]
    # where the largest step of those across is
    first = far + 1 + np.argmax(sliding_window_view(size, 3)[far], axis=1) if far.size else far
    none = np.zeros(far.shape, dtype=bool)
    away |= _between(first, before[far], after[far], certain[first - 1], values, FARTHEST_SWINGS * swing, none)[0]
    # one from which none goes back may have one when those within its stretch are out
    if not away.any():
        for k in sudden[alone & (size[sudden - 1] > swing)].tolist():
            away[:k] |= k <= values.size // 2
            away[k:] |= k > values.size // 2
    return np.asarray(away), sudden[alone]


def _within(share: float, rows: NDArray[np.int64] | int) -> Array:
    """Share of a step of the air that is shown within some rows, of a sensor that shows `share` of it in one."""
    return np.asarray(1.0 - (1.0 - share) ** np.asarray(rows, dtype=float))


def _in_degf(first: NDArray[np.int64], before: Array, after: Array, refuted: Mask, count: int) -> tuple[Mask, Mask]:
    """Rows (`count`,) between a jump and one back that both are none in degF, whatever lies between them, and which of
    the jumps are neither; each as `_between` takes them."""
    away, alone = np.zeros(count, dtype=bool), np.ones(first.size, dtype=bool)
    size = np.abs(after - before)
    begins, ends = (
        refuted & (np.abs((inside - 32.0) / 1.8 - outside) < DEGF_SHARE * size)
        for inside, outside in ((after, before), (before, after))
    )
    for k in np.flatnonzero(begins).tolist():
        back = np.flatnonzero(alone & ends & (first > first[k]) & (first < first[k] + count // 2))
        if alone[k] and back.size:
            away[first[k] : first[back[0]]] = True
            alone[(first >= first[k]) & (first <= first[back[0]])] = False
    return away, alone


def _between(
    first: NDArray[np.int64],
    before: Array,
    after: Array,
    refuted: Mask,
    values: Array,
    swing: float,
    goes_on: Mask,
) -> tuple[Mask, Mask]:
    """Rows of the `values` (n,) between jumps and those back, by the `first` row after each and the levels on either
    side, and which of the jumps none goes back from; of two, one at least is `refuted` by the lag, and the first is not
    where a sensor that was stuck `goes_on`.

    Of two that are farther than `swing` the air may have moved in between. Readings that went farther than the jumps
    follow the air, if beside what it is: without them less would be known.
    """
    count = values.size
    away, alone = np.zeros(count, dtype=bool), np.ones(first.size, dtype=bool)
    for moved in (False, True):
        left = np.flatnonzero(alone)
        size, i = (after - before)[left], 0
        while i + 1 < left.size:
            # up to the next that is no small one, of another quantity's own
            comparable = np.abs(size[i + 1 :]) > (RETURN_SHARE if moved else BESIDE_SHARE) * abs(size[i])
            j = i + 1 + int(np.argmax(comparable))
            k, n = left[i], left[j]
            least = min(abs(size[i]), abs(size[j]))
            back = size[i] * size[j] < 0 and first[n] - first[k] < count // 2 and (refuted[k] or refuted[n])
            back = back and not goes_on[k]
            if back and (least > swing if moved else abs(after[n] - before[k]) < APART_SHARE * least):
                # what followed the air goes back by as much as it came, but for a burst of noise
                inside = values[first[k] : first[n]]
                steady = np.max(np.abs(np.diff(inside)), initial=0.0) < BESIDE_SHARE * least
                unequal = steady and not moved and abs(size[i] + size[j]) > least
                away[first[k] : first[n]] |= unequal or np.ptp(inside) < least
                alone[[k, n]] = False
                i = j
            i += 1
    return away, alone


def _stood(
    values: Array, lone: NDArray[np.int64], resolution: float, had_to_move: Callable[[slice, float], Mask]
) -> Mask:
    """Rows (n,) over which readings stood on a level up to one of the `lone` jumps, from where on they `had_to_move`,
    with such a jump behind them: the sensor, or the logger, was stuck, and went on."""
    stood = np.zeros(values.size, dtype=bool)
    for k in lone.tolist():
        back = values[:k][::-1]
        apart = np.maximum.accumulate(back) - np.minimum.accumulate(back)
        # of a stand that is longer the last readings may lie at one end of the dither
        lasting = int(np.count_nonzero(_on_level(apart, 2.0 * STUCK_LEVELS, resolution)))
        level = np.median(back[: max(lasting, WINDOW_ROWS)])
        moved = np.flatnonzero(np.abs(values[:k] - level) > STUCK_LEVELS * resolution)
        stand = slice(int(moved[-1]) + 1 if moved.size else 0, k)
        if stand.start < k - 1:
            stood[stand] |= had_to_move(stand, values[k] - level)
    return stood


def _unfelt(values: Array, felt: Felt, rows: NDArray[np.int64], least: float) -> NDArray[np.int64]:
    """The first of the readings (m,) at some `rows` behind each lone jump of more than `least` that another sensor,
    read beside them, did not feel: a sensor that hides no jump of the air did not see one."""
    step, seen = np.diff(values), np.diff(felt.reading[rows])
    size = np.abs(step)
    beside = largest_beside(size)
    unfelt = np.abs(seen) + JUMP_IN_NOISE * felt.noise < FELT_SHARE * size
    return np.flatnonzero(unfelt & (size > least) & (beside < BESIDE_SHARE * size)) + 1


def _as_vapour(values: Array, lagging: Array, resolution: float) -> Callable[[slice, float], Mask]:
    """All rows, where what is `lagging` (n,) has had to move for readings (n,) to stand, by more than these did and
    their steps hide."""

    def had_to_move(stand: slice, jump: float) -> Mask:
        some = lagging[stand][np.isfinite(lagging[stand])]
        moved = some.size > 0 and np.ptp(some) > np.ptp(values[stand]) + resolution
        return np.full(stand.stop - stand.start, moved)

    return had_to_move


def _as_felt(felt: Felt, rows: NDArray[np.int64], resolution: float) -> Callable[[slice, float], Mask]:
    """Where another sensor has felt the way, over some of the `rows` (m,), that the jump behind these makes up for."""

    def had_to_move(stand: slice, jump: float) -> Mask:
        seen = felt.reading[rows[stand]]
        known = np.flatnonzero(np.isfinite(seen))
        if not known.size:
            return np.zeros(seen.shape, dtype=bool)
        calm = np.interp(np.arange(seen.size), known, median_filter(seen[known], WINDOW_ROWS, mode="nearest"))
        gone = np.abs(calm - calm[0])
        still = np.flatnonzero(gone < resolution + np.hypot(felt.resolution, felt.noise))
        return (np.arange(seen.size) > still[-1]) & (FELT_SHARE < (calm[-1] - calm[0]) / jump < 1.0 / FELT_SHARE)

    return had_to_move


def stuck_rows(values: Array, resolution: float, noise: float, scatter: Array) -> Mask:
    """Rows in stretches that stay on a level, or within `STUCK_LEVELS` steps of one, for longer than the noise could by
    chance.

    The noise is the least of what is stated and what the flight's quieter stretches show where they do move: a calm
    layer is no stuck sensor. Of readings that do so nowhere nothing tells how noisy they are, nor of those on coarser
    steps how seldom they leave one.
    """
    stuck = np.zeros(values.size, dtype=bool)
    spread = maximum_filter1d(values, WINDOW_ROWS) - minimum_filter1d(values, WINDOW_ROWS)
    moving = scatter[spread > 2.001 * STUCK_LEVELS * resolution]
    if resolution == 0.0 or not moving.size:
        return stuck
    own = min(noise, float(np.quantile(moving, 0.1)))
    for levels in (1.0, 2.0 * STUCK_LEVELS)[resolution > COARSE_IN_NOISE * own :]:
        least = fewest_by_chance(0.5 * levels * resolution, own)
        if least > values.size // 2:
            continue
        half = int(least) // 2
        apart = maximum_filter1d(values, 2 * half + 1) - minimum_filter1d(values, 2 * half + 1)
        narrow = _on_level(apart, levels, resolution)
        narrow[:half] = narrow[values.size - half :] = False
        stuck |= maximum_filter1d(narrow, 2 * half + 1)
    return stuck


def _on_level(apart: Array, levels: float, resolution: float) -> Mask:
    """Whether readings that are so far `apart` at most are on no more `levels` of the log, one less apart than there
    are."""
    return apart < (levels - 0.999) * resolution


def fewest_by_chance(size: float, noise: float) -> float:
    """How many readings in a row noise alone does not keep so near to a level; infinite where it may."""
    share = within(size, noise)
    return max(float(np.ceil(np.log(BY_CHANCE) / np.log(share))), 5.0) if share < 0.999 else np.inf


def within(size: float, noise: float) -> float:
    """Share of readings that noise keeps within `size` of a level."""
    from scipy.special import erf

    return float(erf(size / (noise * np.sqrt(2.0)))) if noise > 0.0 else 1.0
