"""The readings' noise from the plateaus, before any model: white + AR(1), perhaps averaged over the last n readings.

Restricted maximum likelihood on short pieces of plateau with their mean and slope projected out, all pieces pooled into
one scatter matrix, so that one evaluation costs one small Cholesky factor however long the campaign is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.without_model import (
    FEWEST_READINGS,
    MAD_TO_SIGMA,
    curved_noise,
    half_way_s,
    missed_by_line,
)

Array = NDArray[np.float64]

# The error of readings rounded to a step that is coarse beside their noise: no white noise, but a sawtooth of the
# signal.
#
# A run's plateau stands at one code for all its length, and a slow creep crosses codes one after the other, so that
# the error of one reading says much about the next. With each run's place between two codes unknown (uniform), and
# Gaussian noise of autocovariance gamma before rounding, readings i and j of a signal y, l apart, have the covariance
# (after Widrow and Kollar 2008, Quantization Noise, 10.1017/CBO9780511754661)
#
#     gamma_l + sum_k q^2 / (2 pi^2 k^2) exp(-(2 pi k / q)^2 (gamma_0 - gamma_l)) cos(2 pi k (y_i - y_j) / q).

HARMONICS = 24
TOLD_BY_ROUNDING = 1e-4  # of a step squared: less of a covariance is none
COARSE_IN_NOISE = 2.0  # below this step in units of the noise the error is as good as white


def rounding_covariance(
    signal: Array, index: NDArray[np.int64], count: NDArray[np.int64], gamma: Array, step: float
) -> Array:
    """Covariance (m, m) [unit^2] of what rounding to `step` adds to the errors of the means of a run's bins.

    `signal` (n,) is the reading without noise and rounding [channel's unit], known to a fraction of a step, at places
    `index` (n,) on the sampling grid; `count` (m,) of the samples, one after the other, are in each bin. Their noise
    has the autocovariance `gamma` (lags,) before it is rounded.

    Beyond the noise's memory a harmonic's covariance is that of its waves alone, whatever the lag: of bins it is the
    product of their sums. Only nearer pairs of samples are taken one by one.
    """
    decays = _decays(gamma, step)
    told = np.flatnonzero(decays[:, 1:].max(axis=1) > TOLD_BY_ROUNDING * step**2)  # the others are as good as white
    decays, starts = decays[told], np.concatenate([[0], np.cumsum(count)[:-1]])
    turns = np.exp(1j * (2.0 * np.pi / step) * (told[:, None] + 1.0) * signal)  # (K, n)
    far = decays[:, min(int(index[-1] - index[0]), gamma.size - 1), None]
    sums = np.sqrt(far) * np.add.reduceat(turns, starts, axis=1)
    total = np.real(sums.T @ sums.conj())
    nearer = np.where(decays - far > TOLD_BY_ROUNDING * step**2, decays - far, 0.0)
    nearer[:, 0] = decays[:, 0] - far[:, 0]
    reach = int(np.flatnonzero(nearer.any(axis=0)).max(initial=0)) + 1
    bin_of, bins = np.repeat(np.arange(count.size), count), count.size
    for apart in range(min(reach, signal.size)):
        first, second = slice(signal.size - apart), slice(apart, None)
        lag = index[second] - index[first]
        if lag.min() >= reach:
            break
        waves = np.real(turns[:, first] * turns[:, second].conj())
        of_pair = np.where(lag < reach, (nearer[:, np.minimum(lag, gamma.size - 1)] * waves).sum(axis=0), 0.0)
        own = np.bincount(bin_of[first] * bins + bin_of[second], of_pair, bins**2).reshape(bins, bins)
        total += own if apart == 0 else own + own.T
    total[np.diag_indices_from(total)] += count * (step**2 / 12.0 - decays[:, 0].sum())
    return np.asarray(total / (count[:, None] * count[None, :]))


def rounded_autocovariance(gamma: Array, step: float) -> Array:
    """Autocovariance [unit^2] of rounded readings of a signal that rests, over all its places between two codes."""
    decays = _decays(gamma, step)
    out = gamma + decays.sum(axis=0)
    out[0] += step**2 / 12.0 - decays[:, 0].sum()
    return out


def _decays(gamma: Array, step: float) -> Array:
    """Covariance of each harmonic by lag (K, lags) [unit^2]."""
    k = np.arange(1, HARMONICS + 1)[:, np.newaxis]
    return step**2 / (2.0 * np.pi**2 * k**2) * np.exp(-((2.0 * np.pi * k / step) ** 2) * (gamma[0] - gamma))


def noise_before_rounding(variance: float, step: float) -> float:
    """White noise [unit] that, rounded to `step`, varies by `variance` [unit^2] about a plateau's mean, over all its
    places between two codes.

    Solves sigma^2 + sum_k q^2 / (2 pi^2 k^2) (1 - exp(-(2 pi k sigma / q)^2)) = variance, which for little noise is
    q sigma / sqrt(pi).
    """
    from scipy.optimize import brentq  # a fifth of a second, which no correction of a flight needs

    k = np.arange(1, 400)

    def excess(sigma: float) -> float:
        shown = -np.expm1(-((2.0 * np.pi * k * sigma / step) ** 2)) / (2.0 * np.pi**2 * k**2)
        return sigma**2 + step**2 * float(shown.sum()) - variance

    low, high = 1e-4 * step, np.sqrt(variance) + 1e-3 * step
    return low if excess(low) >= 0 else float(brentq(excess, low, high))


PIECE_SAMPLES = 84  # samples in a piece of plateau where it is that long: long against the noise's memory
SHORTEST_PIECE = 10
FEWEST_PIECES = 3  # of plateau, in all
MANY_PIECES = 8  # of one kind, from which on what most of them show tells which are louder than noise
AVERAGE_NATS = 8.0  # by which an average over readings has to be likelier than none
MAX_AVERAGED = 24
AVERAGED_KNOWN_TO = 0.1  # of a reading, which are a whole number
OWN_SHARE = 0.4  # of a sensor's time to half of a step
TINY_VARIANCE = 1e-12  # variance of what is nothing
NO_COVARIANCE = 1e12  # deviance of a covariance that is none
BURST_BY_CHANCE = 1e-6  # probability that noise passes for a burst in a piece of plateau
MAD_EFFICIENCY = 0.37  # of the median deviation of normal noise (Rousseeuw and Croux 1993, 10.2307/2291267)
BEND_ORDER = 4  # order of the polynomial that a piece of a response is taken for
KINKED_DEVIATIONS = (
    9.0  # median deviations above the median by which a piece of measured air departs from such a polynomial
)
LONGEST_MEMORY = 0.995  # from one sample to the next
LEAST_WHITE = 0.01  # share of the correlated part's variance that is white at the least
# (ln of total over observed variance, logit of the correlated share, logit of the memory) for a quick look
QUICK_LOOK = tuple((x, s, m) for x in (-0.3, 0.0, 0.4) for s, m in ((-5.0, 0.0), (0.0, 2.0)))
WHITE_NOISE = np.array([0.0, -30.0, 0.0])  # the same of noise that remembers nothing


@dataclass(frozen=True)
class Noise:
    """Noise of one channel's readings.

    Attributes
    ----------
    white, correlated : float
        Standard deviations [channel's unit] of the white and the AR(1) part before averaging.
    memory : float
        AR(1) coefficient from one reading to the next.
    averaged : int
        Each reading is the mean of this many (1: none); the mean response is treated elsewhere.
    readings_per_sample : int
        Readings that the logger takes from one sample to the next.
    extra : float
        Standard deviation added as white noise for rounding that the plateaus do not show.
    pieces : int
        Pieces of plateau the estimate rests on.
    log_likelihood_by_average : ndarray (MAX_AVERAGED,)
        Log likelihood, best over the other parameters, for averages over 1, 2, ... readings; -inf where not tried.
    passed, passed_memory : float
        Of the noise that a measured air's reference puts into the model's prediction: standard deviation, and AR(1)
        coefficient from one sample to the next.
    step : float
        To which readings are rounded, where that is coarse beside the noise [channel's unit]; else 0.
    """

    white: float
    correlated: float
    memory: float
    averaged: int
    extra: float
    pieces: int
    log_likelihood_by_average: Array
    step: float = 0.0
    passed: float = 0.0
    passed_memory: float = 0.0
    readings_per_sample: int = 1

    def autocovariance(self, lags: int) -> Array:
        """Autocovariance at lags 0 .. lags-1 samples [unit^2]; behind a coarse step, that of a signal that rests."""
        parts = self.white**2, self.correlated**2, self.memory
        gamma = _autocovariance(*parts, self.averaged, lags, self.readings_per_sample)
        gamma[0] += self.extra**2
        if self.passed:
            gamma = gamma + self.passed**2 * self.passed_memory ** np.arange(lags)
        return rounded_autocovariance(gamma, self.step) if self.step else gamma

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of one reading [channel's unit]."""
        return float(np.sqrt(self.autocovariance(1)[0]))

    @property
    def while_moving(self) -> float:
        """The same while the signal crosses codes: a coarse step then shows its own error, which at rest it hides."""
        return float(np.hypot(self.standard_deviation, self.step / np.sqrt(12.0)))

    @property
    def increment(self) -> float:
        """Standard deviation of the difference between two readings in a row [channel's unit]."""
        now, next_ = self.autocovariance(2)
        return float(np.sqrt(2 * (now - next_)))

    def with_rounding(self, step: float) -> Noise:
        """The same noise with the variance of rounding to `step`, step^2 / 12, added."""
        return replace(self, extra=float(np.hypot(self.extra, step / np.sqrt(12.0))))


def _autocovariance(
    white: float, correlated: float, memory: float, averaged: int, lags: int, readings_per_sample: int = 1
) -> Array:
    """At lags of 0, 1, ... samples; noise and mean are those of the logger's readings, of which some may be hidden."""
    if readings_per_sample > 1:
        return _autocovariance(white, correlated, memory, averaged, (lags - 1) * readings_per_sample + 1)[
            ::readings_per_sample
        ]
    reach = lags + averaged
    gamma = correlated * memory ** np.arange(reach, dtype=float)
    gamma[0] += white
    if averaged == 1:
        return gamma[:lags]
    triangle = (averaged - np.abs(np.arange(-averaged + 1, averaged))) / averaged**2
    both = np.concatenate([gamma[:0:-1], gamma])
    return np.convolve(both, triangle, mode="same")[reach - 1 : reach - 1 + lags]


def plateau_pieces(channel: Channel, late_share: float = 1 / 3) -> tuple[Array, Array]:
    """Pieces of plateau (m, n) before the transfer, and from the last `late_share` of the time after it.

    n is `PIECE_SAMPLES`, or less where a slow logger leaves fewer samples; where next to nothing was recorded before
    the transfer, a third of what there is after it.
    """
    before = np.median([(time < 0).sum() for time, _ in channel.samples])
    after = np.median([(time > (1 - late_share) * time[-1]).sum() for time, _ in channel.samples])
    longest = 0.85 * before if 0.85 * before >= SHORTEST_PIECE else after / 3
    piece = int(np.clip(longest, SHORTEST_PIECE, PIECE_SAMPLES))
    early: list[Array] = []
    late: list[Array] = []
    driving: list[Array] = []
    period = channel.sampling_period_s
    for (time, value), air in zip(channel.samples, channel.air, strict=True):
        # Air that was measured all along drives the sensor all along: what bends less than noise does is in pieces.
        parts = [(time < -2 * period, early), (time > (1 - late_share) * time[-1], late)] if air is None else []
        for part, pieces in parts or [(np.ones(time.size, dtype=bool), late)]:
            t, y = time[part], value[part]
            pieces.extend(whole_pieces(t, y, period, piece))
        if air is not None:
            driving.extend(whole_pieces(time, np.interp(time, air.time_s, channel.trace_of(air)), period, piece))
    if driving and len(driving) == len(late):
        late = [y for y, smooth in zip(late, _smooth(np.array(driving)), strict=True) if smooth]
    return np.array(early).reshape(-1, piece), np.array(late).reshape(-1, piece)


def _smooth(driving: Array) -> NDArray[np.bool_]:
    """Which pieces (m, n) of a measured air bend as little as most, and follow a piece that does.

    Behind a kink of the air a sensor bends too, by little enough to pass for noise with a long memory.
    """
    power = (_unbent(driving, BEND_ORDER)[0] ** 2).mean(axis=1)
    middle = float(np.median(power))
    kinked = power > middle + KINKED_DEVIATIONS * float(np.median(np.abs(power - middle))) + TINY_VARIANCE
    return ~(kinked | np.append(False, kinked[:-1]))


def _unbent(pieces: Array, order: int) -> tuple[Array, Array]:
    """Pieces (m, n) less the polynomial of that order that fits each best; and the polynomials, orthonormal."""
    polynomials = np.linalg.qr(np.vander(np.linspace(-1, 1, pieces.shape[1]), order + 1))[0]
    return pieces - (pieces @ polynomials) @ polynomials.T, polynomials


def whole_pieces(time_s: Array, value: Array, period_s: float, length: int) -> Iterator[Array]:
    """Pieces of so many readings one after the other, up to two missing in a row bridged by a straight line; a longer
    gap ends a piece.

    They are the readings themselves, however unevenly they were stamped: of those on a line between two of them a fifth
    of the noise would be missing. Only what a slow curve goes from a stamp to the even one is taken off.
    """
    for stretch in np.split(np.arange(time_s.size), np.flatnonzero(np.diff(time_s) > 3.3 * period_s) + 1):
        if stretch.size < 2:
            continue
        place = np.append(0.0, np.cumsum(np.maximum(np.rint(np.diff(time_s[stretch]) / period_s), 1.0)))
        every = np.arange(place[-1] + 1.0)
        whole = every.size // length * length
        when, filled = (np.interp(every, place, x[stretch])[:whole].reshape(-1, length) for x in (time_s, value))
        yield from _evenly(when, filled)


def _evenly(time_s: Array, pieces: Array) -> Array:
    """Pieces (m, n) as they would have been read had they been stamped evenly: by how far each stamp is from the even
    one, and how fast the polynomial goes there that fits each piece best."""
    x = np.linspace(-1.0, 1.0, pieces.shape[1])
    coefficients = pieces @ np.linalg.pinv(np.vander(x, BEND_ORDER + 1)).T
    slope = coefficients[:, :-1] @ (np.vander(x, BEND_ORDER) * np.arange(BEND_ORDER, 0, -1)).T
    since_s = time_s - time_s.mean(axis=1, keepdims=True)
    return np.asarray(pieces + slope * (x - since_s * (x @ x) / (since_s @ x)[:, None]))


@dataclass(frozen=True)
class _Pool:
    """Pieces with a polynomial projected out, pooled: their count, the polynomials (orthonormal), the scatter left."""

    count: int
    polynomials: Array
    scatter: Array

    def of_polynomials(self, seen: Array, log_determinant: float) -> float:
        """-2 log restricted likelihood for noise of a covariance C, less the misfit of C^-1 to the scatter; given C^-1
        Q of the polynomials Q, and log det C.

        With B a basis of what the polynomials leave: log det B'CB = log det C + log det Q'C^-1 Q, and
        B (B'CB)^-1 B' = C^-1 - C^-1 Q (Q'C^-1 Q)^-1 Q'C^-1.
        """
        factor, log_inner = _factored(self.polynomials.T @ seen)
        if factor is None:
            return NO_COVARIANCE
        taken = linalg.lapack.dpotrs(factor, seen.T @ self.scatter @ seen, lower=True)[0].trace()
        return float(self.count * (log_determinant + log_inner) - taken)


def _calm(early: Array, late: Array, rounding: float) -> tuple[Array, Array]:
    """Pieces of plateau without those that hold a burst, where there are too few to tell which are louder than most;
    all of them where most do: it is then the noise."""
    burst = holds_burst(np.concatenate([early, late]), rounding)
    if burst.sum() > 0.5 * burst.size:
        return early, late
    of_each = burst[: len(early)], burst[len(early) :]
    early, late = (x if len(x) >= MANY_PIECES else x[~its] for x, its in zip((early, late), of_each, strict=True))
    return early, late


def holds_burst(pieces: Array, rounding: float) -> NDArray[np.bool_]:
    """Which pieces (m, n) have a reading farther from the line between its neighbours than normal noise throws one: as
    most readings of the piece, those of all pieces, and those that are rounded to `rounding` show it."""
    from scipy.special import stdtrit  # which no correction of a flight needs

    missed = np.abs(missed_by_line(np.arange(pieces.shape[1], dtype=float), pieces))
    if not missed.size:
        return np.zeros(len(pieces), dtype=bool)
    own, common = MAD_TO_SIGMA * np.median(missed, axis=1), MAD_TO_SIGMA * np.median(missed)
    farthest = -float(stdtrit(MAD_EFFICIENCY * missed.size, 0.5 * BURST_BY_CHANCE / missed.size))
    usual = np.maximum(own, max(float(common), rounding / np.sqrt(1.5)))  # a step, scaled as what is missed is
    return np.asarray((missed > farthest * usual[:, None]).any(axis=1))


def _factored(covariance: Array) -> tuple[Array | None, float]:
    """Lower Cholesky factor and log determinant; None and infinity where there is none."""
    factor, failed = linalg.lapack.dpotrf(covariance, lower=True)
    return (None, np.inf) if failed else (factor, 2.0 * float(np.log(factor.diagonal()).sum()))


def _pool(pieces: Array, order: int, reject: bool = True) -> _Pool:
    reduced, polynomials = _unbent(pieces, order)
    if reject and reduced.shape[0] >= MANY_PIECES:
        # A burst or an unsettled plateau is not the noise.
        power = (reduced**2).mean(axis=1)
        reduced = reduced[power <= 4.0 * np.median(power) + TINY_VARIANCE]
    return _Pool(reduced.shape[0], polynomials, reduced.T @ reduced)


@dataclass(frozen=True)
class _PlateauNoise:
    """What a channel's plateaus say of noise by its numbers x: (ln of total over observed variance, logit of the
    correlated share, logit of the memory).

    Attributes
    ----------
    pools : list of _Pool
    scale : float
        Observed variance [unit^2].
    longest_memory : float
        From one sample to the next.
    extra : float
        Variance of rounding that an average does not thin out [unit^2].
    coarse_step : float
        To which readings are rounded, where that is coarse beside the noise [unit]; else 0.
    readings_per_sample : int
    """

    pools: list[_Pool]
    scale: float
    longest_memory: float
    extra: float
    coarse_step: float
    readings_per_sample: int

    @cached_property
    def places(self) -> tuple[NDArray[np.int64], Array, list[slice]]:
        """How far samples of a piece are apart (n, n); what C^-1 is applied to, the first unit vector and the pools'
        polynomials, as columns; and each pool's own columns of these."""
        size = len(self.pools[0].scatter)
        ends = 1 + np.cumsum([0, *(pool.polynomials.shape[1] for pool in self.pools)])
        columns = np.asfortranarray(np.hstack([np.eye(size, 1), *(pool.polynomials for pool in self.pools)]))
        apart = np.abs(np.subtract.outer(np.arange(size), np.arange(size)))
        return apart, columns, [slice(*between) for between in itertools.pairwise(ends.tolist())]

    @cached_property
    def ahead(self) -> Array:
        """Sums of all pools' scatter down its diagonals, from each place on (n, n)."""
        ahead = np.sum([pool.scatter for pool in self.pools], axis=0)
        for i in reversed(range(len(ahead) - 1)):
            ahead[i, :-1] += ahead[i + 1, 1:]
        return np.asarray(ahead)

    @property
    def readings(self) -> int:
        """Samples in all pieces, less what their polynomials took."""
        return sum(pool.count * (len(pool.scatter) - pool.polynomials.shape[1]) for pool in self.pools)

    def parts(self, x: Array, averaged: int) -> tuple[float, float, float]:
        """White and correlated variance of a reading before the average, and memory to the next."""
        total, share = self.scale * averaged * np.exp(x[0]), _logistic(x[1])
        memory = self.longest_memory * _logistic(x[2])
        return (1 - share) * total, share * total, memory ** (1.0 / self.readings_per_sample)

    def deviance(self, x: Array, averaged: int) -> float:
        """-2 log restricted likelihood.

        With x the first column of C^-1, C the Toeplitz covariance of the noise, and y = (0, x_n, ..., x_2), C^-1_ij is
        the sum over k of (x_i-k x_j-k - y_i-k y_j-k) / x_1 (Gohberg and Semencul 1972).
        """
        apart, columns, own = self.places
        gamma = _autocovariance(*self.parts(x, averaged), averaged, len(apart), self.readings_per_sample)
        if self.coarse_step:
            gamma = rounded_autocovariance(gamma, self.coarse_step)
        elif averaged > 1:
            gamma[0] += self.extra
        factor, log_determinant = _factored(gamma.take(apart))
        if factor is None:
            return NO_COVARIANCE
        solved = linalg.lapack.dpotrs(factor, columns, lower=True)[0]
        first, last = solved[:, 0], np.zeros(len(apart))
        last[1:] = first[:0:-1]
        misfit = float(first @ self.ahead @ first - last @ self.ahead @ last) / float(first[0])
        return misfit + sum(
            pool.of_polynomials(solved[:, one], log_determinant) for pool, one in zip(self.pools, own, strict=True)
        )

    def fitted(self, averaged: int) -> tuple[float, Array]:
        """The least deviance for an average over so many readings, and the numbers x that have it."""
        from scipy.optimize import minimize  # a fifth of a second, which no correction of a flight needs

        starts = [[0.0, -1.5, 2.0], [0.0, -5.0, 0.0]] if averaged == 1 else [[0.0, -2.0, 1.5]]
        fits = [
            minimize(
                self.deviance,
                start,
                args=(averaged,),
                method="Nelder-Mead",
                options={
                    "xatol": 0.01,
                    "fatol": 0.05,
                    "maxiter": 150,
                    "initial_simplex": np.array(start) + np.vstack([np.zeros(3), np.diag([0.3, 0.8, 0.8])]),
                },
            )
            for start in starts
        ]
        best = min(fits, key=lambda one: one.fun)
        return float(best.fun), best.x

    def promising(self, longest: int) -> set[int]:
        """Averages that a quick look finds worth a full fit, up to a length."""
        quick = [min(self.deviance(np.array(x), n) for x in QUICK_LOOK) for n in range(1, longest + 1)]
        return {int(n) + 1 for n in np.argsort(quick)[:3]}


def _of_plateaus(channel: Channel, rounding: float, coarse: bool) -> _PlateauNoise | None:
    """The channel's plateaus, pooled; None where they are too few."""
    early, late = plateau_pieces(channel)
    # Before a transfer that was recorded the reading rests, and after it, in an air that was, it settles. What else
    # bends, the end of a response or the beginning of one that was dated by itself, is no noise of a long memory, and a
    # memory as long as such bends could not be told from them.
    driven, dated = bool(channel.measured.any()), bool(channel.conditions.start_known.all())
    of_early = 0 if dated and not driven else BEND_ORDER
    of_late = BEND_ORDER if driven or airs_open(channel) else 2
    if coarse:
        pools = [_pool(early, 0, reject=False)] if early.size else []
    else:
        pools = [p for p in map(_pool, _calm(early, late, rounding), (of_early, of_late)) if p.count]
    rests = (of_early < BEND_ORDER and len(early) >= FEWEST_PIECES) or of_late < BEND_ORDER
    longest = LONGEST_MEMORY if rests else float(np.exp(-(BEND_ORDER + 1) / early.shape[1]))
    if sum(p.count for p in pools) < FEWEST_PIECES:
        return None
    found = _PlateauNoise(pools, 1.0, longest, 0.0, rounding if coarse else 0.0, channel.readings_per_sample)
    scale = float(sum(np.trace(p.scatter) for p in pools) / found.readings)
    if coarse:
        # The mean over pieces that mostly show nothing at all, and a few that flip.
        scale = noise_before_rounding(scale, rounding) ** 2
    return replace(found, scale=scale, extra=max(rounding**2 / 12.0, 1e-3 * scale))


def estimate_noise(
    channel: Channel,
    rounding: float = 0.0,
    lengths: tuple[int, ...] = (),
    averaged: int | None = None,
    coarse: bool = False,
) -> Noise:
    """Noise of a channel by restricted maximum likelihood on its plateaus.

    `rounding` is the step [channel's unit] to which readings are rounded after any averaging: white noise that an
    average does not thin out. `lengths` are averages to be fitted besides those that look promising; `averaged` takes
    one of them as given, whatever the noise says of it. `coarse`: the step is coarse beside the noise, which shows only
    where a plateau happens to lie near the edge of a code (see `rounding_covariance`); nothing is said of averages
    then.
    """
    shown, step = _of_plateaus(channel, rounding, coarse), rounding if coarse else 0.0
    if shown is None:
        return _crude(channel, step)
    count = sum(pool.count for pool in shown.pools)
    if shown.scale < TINY_VARIANCE:
        return Noise(1e-4, 0.0, 0.0, 1, 0.0, count, np.zeros(MAX_AVERAGED), step)
    # Plain noise is always worth a full fit.
    wanted = {averaged or 1} if coarse else {1, *lengths} | shown.promising(longest_average(channel))
    best = np.full(MAX_AVERAGED, -np.inf)
    found: dict[int, Array] = {}
    for length in sorted(n for n in wanted if 1 <= n <= MAX_AVERAGED):
        least, found[length] = shown.fitted(length)
        best[length - 1] = -0.5 * least
    if averaged not in found:
        averaged = int(np.argmax(best)) + 1
        # One more parameter has to pay for itself: plain noise unless an average is clearly better.
        wanders = airs_open(channel) and _of_wandering(*shown.parts(found[averaged], averaged))
        if best[averaged - 1] - best[0] < AVERAGE_NATS or wanders:
            averaged = 1
    at = found[averaged]
    if averaged == 1 and not coarse:
        # A memory has to pay for its two parameters (Schwarz 1978, doi 10.1214/aos/1176344136): a few plateaus always
        # show some by chance, and noise that remembers would pass for the slow end of a response.
        if shown.deviance(WHITE_NOISE, 1) - shown.deviance(at, 1) < 2.0 * np.log(shown.readings):
            at = WHITE_NOISE
    white, correlated, memory = shown.parts(at, averaged)
    # A plateau that creeps looks like noise without a white part, and such noise would trust every difference.
    white = max(white, LEAST_WHITE * correlated)
    return Noise(
        white=float(np.sqrt(white)),
        correlated=float(np.sqrt(correlated)),
        memory=memory,
        averaged=averaged,
        extra=float(np.sqrt(shown.extra)) if averaged > 1 and not coarse else 0.0,
        pieces=count,
        log_likelihood_by_average=best,
        readings_per_sample=shown.readings_per_sample,
        step=step,
    )


def airs_open(channel: Channel) -> bool:
    """Whether nobody recorded the airs of any run."""
    return not (channel.conditions.airs_known.all() or channel.measured.any())


def _of_wandering(white: float, correlated: float, memory: float) -> bool:
    """Whether readings differ more by what wanders than by what is new in each (variances).

    An air that moves by itself comes through a sensor's lag without corners, as it would through a mean of readings.
    """
    return white < (1.0 - memory) * correlated


def _logistic(x: float) -> float:
    return float(1.0 / (1.0 + np.exp(-min(max(x, -30.0), 30.0))))


def longest_average(channel: Channel) -> int:
    """How many readings a logger may be said to average.

    An air that nobody recorded moves by itself, and what a sensor shows of it hangs together over the sensor's own
    time: a mean that is nearly as long cannot be told from that.
    """
    if not airs_open(channel):
        return MAX_AVERAGED
    halves_s = np.array([half_way_s(time, value) for time, value in channel.samples])
    if not np.isfinite(halves_s).any():
        return MAX_AVERAGED
    return int(np.clip(OWN_SHARE * float(np.nanmedian(halves_s)) / channel.reading_period_s, 1, MAX_AVERAGED))


def _crude(channel: Channel, step: float) -> Noise:
    """White noise about a curve where no plateau is long enough for more."""
    lates = [t > 0.6 * t[-1] for t, _ in channel.samples]
    rests = [
        (t[late], y[late]) if late.sum() >= FEWEST_READINGS else (t, y)
        for (t, y), late in zip(channel.samples, lates, strict=True)
    ]
    spread = [curved_noise(*rest) for rest in rests]
    if not step:
        # Where most readings are the one before over again, as those of a coarse step are, their median miss is none.
        means = [float(np.sqrt(np.mean(missed_by_line(*rest) ** 2))) for rest in rests]
        spread = [s or mean for s, mean in zip(spread, means, strict=True)]
    return Noise(max(float(np.median(spread)), 1e-4), 0.0, 0.0, 1, 0.0, 0, np.zeros(MAX_AVERAGED), step)


def whiteners(channel: Channel, noise: Noise, signals: Sequence[Array] | None = None) -> Array:
    """Whitening matrices (R, n, n): W y has unit covariance for bins that hold samples, zero rows for empty ones.

    The errors of a coarse step go together as the signal crosses codes; without `signals`, each run's readings at its
    samples before noise and rounding, they are taken for white.
    """
    step, noise = noise.step, replace(noise, step=0.0)
    if step and signals is None:
        step, noise = 0.0, noise.with_rounding(step)
    period = channel.sampling_period_s
    places = [_on_grid(time, period) for time, _ in channel.samples]
    # To the end of the longest run: an autocovariance cut short is none.
    gamma = noise.autocovariance(max(int(index[-1]) for index in places) + 3)
    bins = channel.count.shape[1]
    whitener = np.zeros((channel.runs, bins, bins))
    white_only = noise.averaged == 1 and max(noise.correlated, noise.passed) < 0.03 * noise.standard_deviation
    twice_summed = _twice_summed(gamma)
    for run in range(channel.runs):
        count = channel.count[run]
        filled = np.flatnonzero(count)
        if white_only and not step:
            whitener[run, filled, filled] = np.sqrt(count[filled] / gamma[0])
            continue
        used = channel.bin_of[run] >= 0
        index = places[run][used]
        summed = _of_means(twice_summed, index, count[filled])
        if step and signals is not None:
            summed += rounding_covariance(signals[run][used], index, count[filled], gamma, step)
        factor = linalg.cholesky(summed + 1e-12 * gamma[0] * np.eye(filled.size), lower=True)
        whitener[run][np.ix_(filled, filled)] = linalg.solve_triangular(factor, np.eye(filled.size), lower=True)
    return whitener


def _on_grid(time_s: Array, period_s: float) -> NDArray[np.int64]:
    """Places of a run's samples on the sampling grid, each beyond the one before: no two readings have all of their
    noise in common, however irregularly a logger stamps them."""
    ahead = np.arange(time_s.size)
    nearest = np.rint((time_s - time_s[0]) / period_s).astype(int)
    return np.maximum.accumulate(nearest - ahead) + ahead


def _twice_summed(gamma: Array) -> Array:
    """H(k) with gamma(k) = H(k+1) - 2 H(k) + H(k-1), H even: sums over two stretches are differences of it."""
    rise = np.cumsum(np.concatenate([[0.5 * gamma[0]], gamma[1:]]))
    return np.concatenate([[0.0], np.cumsum(rise)])


def _of_means(twice_summed: Array, index: NDArray[np.int64], count: NDArray[np.int64]) -> Array:
    """Covariance of the means of bins (m, m), from the places `index` of their samples on the sampling grid.

    A bin is cut into stretches without a gap; the covariance between the sums over two stretches is four values of
    `twice_summed`, however long they are.
    """
    opens = np.append(True, np.diff(index) != 1)
    bin_starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    opens[bin_starts] = True
    at = np.flatnonzero(opens)
    first, length = index[at], np.diff(np.append(at, index.size))
    last = first + length

    def value(lag: NDArray[np.int64]) -> Array:
        return np.asarray(twice_summed[np.minimum(np.abs(lag), twice_summed.size - 1)])

    a, b, c, d = first[:, None], last[:, None], first[None, :], last[None, :]
    sums = value(b - c) + value(a - d) - value(b - d) - value(a - c)
    if at.size > count.size:
        own = np.searchsorted(at, bin_starts)
        sums = np.add.reduceat(np.add.reduceat(sums, own, axis=0), own, axis=1)
    return np.asarray(sums / (count[:, None] * count[None, :]))
