"""The smoother's filter run forward: a few of them side by side, one for each way that the air may be.

Interacting multiple models (Blom and Bar-Shalom 1988, doi 10.1109/9.1299) on the states of the smoother: level and
slope, three Ornstein-Uhlenbeck processes (`prior`), the sensor's lags (`stepping`), and what passes sensor and air
alike (`prior.Passing`). What the smoother judges from the whole flight, strengths of turbulence and trend, is here the
probability of each filter, and a middle strength. How likely other strengths are than that one is weighed with each
reading, whose variance two filters tell at two of them; a strength may always become another (Hamilton 1989,
doi 10.2307/1912559). Past air is kept beside the states, so that an estimate may wait for N more readings (fixed lag).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import log, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.air_prior import OU_VARIANCES, RATES_PER_S, UNSEEN_VARIANCE
from shockrig.analysis.flight.causal_design import Ladder
from shockrig.analysis.flight.response import hold

Array = NDArray[np.float64]
WALK_STATES = 2  # level and slope; where the air's course is not smooth the smoother's third state of the trend is zero
AIR_STATES = WALK_STATES + RATES_PER_S.size
AIR = np.array([1.0, 0.0] + [1.0] * RATES_PER_S.size)
# The filters: weak and strong turbulence on a trend that hardly bends, a trend that bends, and a door.
WEAK, STRONG, BENDING, DOOR = range(4)
FILTER_COUNT = 4
TURBULENCE = np.array([0.5, 2.0, 1.0])  # times the middle strength; a door has its own
# Bends of the filters' trends [unit / s^1.5]: over a filter's own turbulence [unit] where they hardly bend, and over a
# door's where they do, because layers have edges in air without turbulence too
BEND_IN_TURBULENCE, BEND_OVER_DOOR = 0.1, 0.3
STRENGTH_LASTS_S = 60.0  # the air keeps its strength for so long,
BETWEEN_BENDS_S, BEND_LASTS_S = 100.0, 20.0  # so long lies between two bends, and one lasts,
BETWEEN_DOORS_S, DOOR_LASTS_S = 1000.0, 5.0  # and so of doors
STRENGTHS_WEIGHED = 7  # from end to end of a ladder in equal ratios, or about what is usual,
USUAL_WITHIN, USUAL_ENDS = 0.5, 4.0  # which holds within so much of its ln, standard deviation; and ends in so many
LEAST_LIKELY = 1e-6
LEAST_VARIANCE = 1e-9
# A filter takes over from another what that is worth beyond so much: an unlikely door is kelvins away, and its square
# would make a calm filter as unsure as if it had been a little likely in every row
LEAST_SHARE = 1e-3
MOST_UNLIKELY = 60.0  # ln
CONFIDENCE = 0.95
ERF, ERF_BEND = 1.12838, 0.10277  # erf(x) = tanh(a x + b x^3) within 0.0004, which is 1 beyond the ends
ERF_ENDS = 3.0
NORMAL_WIDTH = 1.955346  # of a standard normal distribution, by that erf
WIDTH_STEPS, WIDTH_SETTLED = 20, 1e-4


@lru_cache(maxsize=64)
def moves(step_s: float) -> Array:
    """Probabilities (from, to) that the air goes over from one filter to another within a step."""
    change, bend, bent, door, shut = (
        1.0 - np.exp(-step_s / time_s)
        for time_s in (STRENGTH_LASTS_S, BETWEEN_BENDS_S, BEND_LASTS_S, BETWEEN_DOORS_S, DOOR_LASTS_S)
    )
    move = np.array(
        [
            [0.0, change, bend, door],
            [change, 0.0, bend, door],
            [0.5 * bent, 0.5 * bent, 0.0, door],
            [0.5 * shut, 0.5 * shut, 0.0, 0.0],
        ]
    )
    move[np.diag_indices(FILTER_COUNT)] = 1.0 - move.sum(axis=1)
    return move


def half_width(likely: list[float], off: list[float], variance: list[float]) -> float:
    """Half width of the interval about 0 in which CONFIDENCE of a mixture of normal distributions lies: Newton's steps,
    and halves where they leave what is known of it."""
    parts = [(p, d, sqrt(2.0 * max(v, LEAST_VARIANCE))) for p, d, v in zip(likely, off, variance, strict=True)]
    low, high = 0.0, max(abs(d) + 2.0 * s for _, d, s in parts)
    width = min(NORMAL_WIDTH / sqrt(sum(2.0 * p / s**2 for p, _, s in parts)), high)
    for _ in range(WIDTH_STEPS):
        within = slope = 0.0
        for p, d, s in parts:
            for end in (width - d, width + d):
                x = min(max(end / s, -ERF_ENDS), ERF_ENDS)
                erf = tanh(x * (ERF + ERF_BEND * x * x))
                within += 0.5 * p * erf
                slope += 0.5 * p * (1.0 - erf * erf) * (ERF + 3.0 * ERF_BEND * x * x) / s
        if within < CONFIDENCE:
            low = width
        else:
            high = width
        last, width = width, width + (CONFIDENCE - within) / max(slope, 1e-12)
        if not low <= width <= high:
            width = 0.5 * (low + high)
        if abs(width - last) <= WIDTH_SETTLED * width:
            break
    return width


def strengths_weighed(ladder: Ladder | None) -> tuple[Array, Array]:
    """Strengths that are weighed, ln over the usual one (STRENGTHS_WEIGHED,), and how likely each is before anything is
    read: of a ladder all alike, about a strength that is known to be usual (None) nearer ones more."""
    if ladder is not None:
        half = log(ladder.highest / ladder.middle)
        return np.linspace(-half, half, STRENGTHS_WEIGHED), np.full(STRENGTHS_WEIGHED, 1.0 / STRENGTHS_WEIGHED)
    off = np.linspace(-USUAL_ENDS, USUAL_ENDS, STRENGTHS_WEIGHED)
    likely = np.exp(-0.5 * off**2)
    return USUAL_WITHIN * off, likely / likely.sum()


@dataclass(frozen=True)
class MixtureEstimate:
    """The air and its variance over the filters; how likely each of them is, how far off, and its own variance."""

    value: float
    variance: float
    likely: Array
    off: Array
    own: Array

    @cached_property
    def stated(self) -> float:
        """Variance of the normal distribution whose interval is as wide as the filters' together: a door that nothing
        tells of yet makes their variance many times as large, and no interval wider."""
        return (half_width(self.likely.tolist(), self.off.tolist(), self.own.tolist()) / NORMAL_WIDTH) ** 2


def surely(value: float) -> MixtureEstimate:
    """What is known without a doubt."""
    return MixtureEstimate(value, 0.0, np.ones(1), np.zeros(1), np.zeros(1))


class Bank:
    """The filters of one channel: a life from one start to the next.

    Parameters
    ----------
    ladder : Ladder
    modes : int
        Lags of the sensor.
    passing : bool
        Whether something passes sensor and air alike.
    wait : int
        Rows that an estimate may wait for.

    Attributes
    ----------
    unit : float
        What the ladder's strengths, and the spread at a start, are in units of the states.
    middle : float
        Strength of the air between those of the first two filters: mean of its ln.
    unsure : float
        Mean of the strength over that: as many times is the air's variance, which goes about as its strength.
    usual : float
        What was last said to be usual; at a start, which is told of nothing, the middle one.
    likely : ndarray (FILTER_COUNT,)
        Probabilities of the filters.
    chances, before : ndarray (STRENGTHS_WEIGHED,)
        Probabilities of the strengths, as far from the usual one as `ln_strengths` (STRENGTHS_WEIGHED,), now and where
        nothing is known.
    count, first : int
        Numbers of the next air that is kept and of the first one since the start.
    """

    def __init__(self, ladder: Ladder, modes: int, passing: bool, wait: int = 0) -> None:
        self.ladder, self.modes, self.passing, self.wait = ladder, modes, passing, wait
        self.unit = 1.0
        self.size = AIR_STATES + modes + 2 * passing
        self.lags = slice(AIR_STATES, AIR_STATES + modes)
        self.h = np.concatenate([AIR, np.zeros(self.size - AIR_STATES)])
        self.c = np.zeros(self.size)
        if passing:
            self.h[-1] = self.c[-1] = 1.0
        self.index = np.arange(self.size)
        self.count = self.first = 0

    def start(
        self,
        level: float,
        spread: float,
        weight: Array,
        passing_sigma: float = 0.0,
        speed: float = 1.0,
        usual: float | None = None,
    ) -> None:
        """Air, slope and lags anywhere within `spread` of a reading; turbulence as it is on the long run, as strong as
        `usual` where that is known."""
        self.usual = self.ladder.middle * self.unit if usual is None else self._possible(usual)
        self.ln_strengths, self.before = strengths_weighed(None if usual is not None else self.ladder)
        self.chances = self.before
        self._settle()
        self.likely = np.full(FILTER_COUNT, 1.0 / FILTER_COUNT)
        self.mean = np.zeros((FILTER_COUNT, self.size))
        self.mean[:, 0] = level
        self.mean[:, self.lags] = level
        diagonal = np.full((FILTER_COUNT, self.size), (spread * self.unit) ** 2)
        diagonal[:, WALK_STATES:AIR_STATES] = self._strengths()[:, None] * OU_VARIANCES
        if self.passing:
            diagonal[:, -1] = passing_sigma**2
            diagonal[:, -2] = (passing_sigma / speed) ** 2
        self.p = diagonal[:, :, None] * np.eye(self.size)
        self.c[self.lags] = weight
        self.count += 1  # nothing that was kept before is told of any more
        self.first = self.count
        self.past, self.past_p = np.zeros((FILTER_COUNT, 0)), np.zeros((FILTER_COUNT, 0))
        self.past_with = np.zeros((FILTER_COUNT, 0, self.size))

    def predict(
        self,
        step_s: float,
        weight: Array,
        rate: Array,
        passing_sigma: float = 0.0,
        speed: float = 1.0,
        parts: int = 1,
        usual: float | None = None,
    ) -> None:
        """Some time ahead, in `parts` steps; lags of `rate` (K,) and `weight` (K,) behind the air, which is straight
        over each. The air's strength goes with the `usual` one, and to it where readings say little of it."""
        if usual is not None:
            self.usual = self._possible(usual)
        another = 1.0 - np.exp(-step_s / STRENGTH_LASTS_S)
        self.chances = (1.0 - another) * self.chances + another * self.before
        self._settle()
        self._mix(step_s)
        for _ in range(parts):
            self._step(step_s / parts, rate, passing_sigma, speed)
        self.c[self.lags] = weight

    def _step(self, step_s: float, rate: Array, passing_sigma: float, speed: float) -> None:
        strengths = self._strengths()
        bends = self._bends()
        old, new, decay = hold(rate, np.array(step_s))
        gone = np.exp(-RATES_PER_S * step_s)
        air = self.index[WALK_STATES:AIR_STATES]
        phi = np.zeros((self.size, self.size))
        phi[self.index, self.index] = 1.0
        phi[0, 1] = step_s
        phi[air, air] = gone
        after = AIR @ phi[:AIR_STATES, :AIR_STATES]
        phi[self.lags, :AIR_STATES] = old[:, None] * AIR + new[:, None] * after
        phi[self.index[self.lags], self.index[self.lags]] = decay
        added = np.zeros((FILTER_COUNT, self.size, self.size))
        added[:, 0, 0], added[:, 1, 1], added[:, 0, 1] = (bends * one for one in (step_s**3 / 3, step_s, step_s**2 / 2))
        added[:, 1, 0] = added[:, 0, 1]
        added[:, air, air] = strengths[:, None] * (OU_VARIANCES * (1.0 - gone**2))
        to_air = added[:, :AIR_STATES, :AIR_STATES] @ AIR
        added[:, self.lags, :AIR_STATES] = new[:, None] * to_air[:, None]
        added[:, :AIR_STATES, self.lags] = added[:, self.lags, :AIR_STATES].swapaxes(1, 2)
        added[:, self.lags, self.lags] = new[:, None] * new * (to_air @ AIR)[:, None, None]
        if self.passing:
            x = speed * step_s
            swing = np.exp(-x) * np.array([[1 + x, step_s], [-speed * x, 1 - x]])
            phi[-2:, -2:] = swing
            rest = np.array([[1.0 / speed**2, 0.0], [0.0, 1.0]])
            added[:, -2:, -2:] = passing_sigma**2 * (rest - swing @ rest @ swing.T)
        self.mean = self.mean @ phi.T
        self.p = phi @ self.p @ phi.T + added
        if self.wait:
            self.past_with = self.past_with @ phi.T

    def expected(self) -> tuple[float, float]:
        """The reading that is expected, and its variance without its noise."""
        each, spread = self.mean @ self.c, np.maximum((self.p @ self.c) @ self.c, 0.0)
        return self._together(each, spread)

    def update(self, reading: float, noise_variance: float) -> None:
        """Take a reading in."""
        pc = self.p @ self.c
        own = np.maximum(pc @ self.c, 0.0)
        s = own + noise_variance
        v = reading - self.mean @ self.c
        gain = pc / s[:, None]
        if self.past.shape[1]:
            with_reading = self.past_with @ self.c
            self.past = self.past + with_reading * (v / s)[:, None]
            self.past_p = self.past_p - with_reading**2 / s[:, None]
            self.past_with = self.past_with - with_reading[:, :, None] * gain[:, None, :]
        self.mean = self.mean + gain * v[:, None]
        self.p = self.p - gain[:, :, None] * pc[:, None, :]
        index = self.index
        self.p[:, index, index] = np.maximum(self.p[:, index, index], LEAST_VARIANCE)
        cost = 0.5 * (v**2 / s + np.log(s))
        likely = self.likely * np.exp(np.maximum(cost.min() - cost, -MOST_UNLIKELY))
        self.likely = np.maximum(likely / likely.sum(), LEAST_LIKELY)
        self.likely /= self.likely.sum()
        self._weigh(v, own, noise_variance)

    def _weigh(self, off: Array, own: Array, noise_variance: float) -> None:
        """How likely a reading is at each strength, of the filters' expectations that it is `off` from, and of their
        variances `own` without its noise: between the first two filters straight lines over ln of the strength."""
        apart = np.log(TURBULENCE[STRONG] / TURBULENCE[WEAK])
        weak, strong = np.maximum(own[:BENDING], LEAST_VARIANCE)
        power = min(max(np.log(strong / weak) / apart, 0.0), 2.0)
        over_middle = self.ln_strengths - np.log(self.middle / self.usual)
        variance = noise_variance + np.sqrt(weak * strong) * np.exp(power * over_middle)
        away = off[WEAK] + np.clip(0.5 + over_middle / apart, 0.0, 1.0) * (off[STRONG] - off[WEAK])
        cost = 0.5 * away**2 / variance
        chances = self.chances * np.exp(np.maximum(cost.min() - cost, -MOST_UNLIKELY)) / np.sqrt(variance)
        self.chances = chances / chances.sum()
        self._settle()

    def _settle(self) -> None:
        mean = float(self.chances @ self.ln_strengths)
        self.middle = self._possible(self.usual * float(np.exp(mean)))
        self.unsure = float(self.chances @ np.exp(self.ln_strengths - mean))

    def _possible(self, strength: float) -> float:
        return min(max(strength, self.ladder.lowest * self.unit), self.ladder.highest * self.unit)

    def keep(self) -> int:
        """Remember the air as it is now, to be told better by what follows; the oldest beyond `wait` is dropped.

        Returns its number.
        """
        self.count += 1
        if not self.wait:
            return self.count - 1
        with_air, air = self.p @ self.h, self._air_variance()
        keep = slice(max(self.past.shape[1] - self.wait, 0), None)
        self.past = np.append(self.past, (self.mean @ self.h)[:, None], axis=1)[:, keep]
        self.past_p = np.append(self.past_p, air[:, None], axis=1)[:, keep]
        self.past_with = np.append(self.past_with, with_air[:, None], axis=1)[:, keep]
        return self.count - 1

    def now(self) -> MixtureEstimate:
        """The air and its variance."""
        return self._estimate(self.mean @ self.h, self._air_variance())

    def ago(self, rows: int) -> MixtureEstimate:
        """The air so many `keep`s ago (0: the last)."""
        if not self.wait or not self.past.shape[1]:
            return self.now()
        place = -1 - min(rows, self.past.shape[1] - 1)
        return self._estimate(self.past[:, place], np.maximum(self.past_p[:, place], 0.0))

    def ahead(self, step_s: float) -> MixtureEstimate:
        """The air that much later than the last reading tells of."""
        gone = np.exp(-RATES_PER_S * step_s)
        h = self.h.copy()
        h[1], h[WALK_STATES:AIR_STATES] = step_s, gone
        added = self._strengths() * (UNSEEN_VARIANCE + OU_VARIANCES @ (1.0 - gone**2))
        added += self._bends() * step_s**3 / 3
        return self._estimate(self.mean @ h, np.maximum((self.p @ h) @ h, 0.0) + added)

    def wobble(self, step_s: float) -> float:
        """The air's turbulence from row to row, as the standard deviation of noise that would change as much."""
        return self.middle * float(np.sqrt(OU_VARIANCES @ (1.0 - np.exp(-RATES_PER_S * step_s))))

    def _air_variance(self) -> Array:
        """Of the air in each filter, with the turbulence that no sensor sees."""
        return np.maximum((self.p @ self.h) @ self.h, 0.0) + UNSEEN_VARIANCE * self._strengths()

    def lagging(self) -> tuple[float, Array]:
        """The reading without noise, and where each lag stands."""
        lags = self.likely @ self.mean[:, self.lags]
        return float(self.c[self.lags] @ lags), lags

    def _strengths(self) -> Array:
        """Squares of the filters' strengths."""
        own = np.empty(FILTER_COUNT)
        own[:DOOR], own[DOOR] = self.middle * TURBULENCE, self.ladder.door * self.unit
        return own * own

    def _bends(self) -> Array:
        """Squares of the bends of the filters' trends."""
        own = np.full(FILTER_COUNT, self.ladder.door * self.unit)
        own[:BENDING] = BEND_IN_TURBULENCE * self.middle * TURBULENCE[:BENDING]
        own[BENDING] *= BEND_OVER_DOOR
        return own * own

    def _together(self, each: Array, spread: Array) -> tuple[float, float]:
        air = float(self.likely @ each)
        return air, float(self.likely @ (self.unsure * spread + (each - air) ** 2))

    def _estimate(self, each: Array, spread: Array) -> MixtureEstimate:
        air, variance = self._together(each, spread)
        return MixtureEstimate(air, variance, self.likely, each - air, self.unsure * spread)

    def _mix(self, step_s: float) -> None:
        """Before each step every filter takes over from the others what they are worth."""
        move = moves(step_s)
        share = move * self.likely[:, None]  # from, to
        self.likely = share.sum(axis=0)
        share = (share / self.likely).T  # to, from
        share = np.maximum(share - LEAST_SHARE, 0.0)
        share /= share.sum(axis=1, keepdims=True)
        mean = share @ self.mean
        off = self.mean - mean[:, None]  # to, from, state
        weighted = share[:, :, None] * off
        size = self.size
        together = (share @ self.p.reshape(FILTER_COUNT, -1)).reshape(FILTER_COUNT, size, size)
        if self.wait and self.past.shape[1]:
            past = share @ self.past
            past_off = self.past - past[:, None]
            self.past_p = share @ self.past_p + (share[:, :, None] * past_off**2).sum(axis=1)
            with_past = (share @ self.past_with.reshape(FILTER_COUNT, -1)).reshape(self.past_with.shape)
            self.past_with = with_past + past_off.swapaxes(1, 2) @ weighted
            self.past = past
        self.mean, self.p = mean, together + off.swapaxes(1, 2) @ weighted
