"""A population of sensors from what each alone says: REML, shrinkage, and which sensors do not belong.

x_i = H_i (mu + b_i) + C_i eps_i + e_i,    b_i ~ N(0, Sigma),   eps ~ N(0, I),   e_i ~ N(0, R_i)
H_i are a sensor's numbers from its coordinates, C_i what errors do that others have as well: those of its bench in all
runs, and those of its carriage, what its runs have in all probes. With
A = H'R^-1 H, a = H'R^-1 x, F = H'R^-1 C and M = (I + A Sigma)^-1 the marginal normal equations are sums over sensors
of M A, M a and M F: everything here is linear in their number. Sigma by EM on the restricted likelihood (Laird and Ware
1982, doi 10.2307/2529876). Its correlations are those that K + 1 more sensors without any would leave, its variances
the means of their posterior, so that a few sensors do not promise a narrow type. The prior of a spread s is Jeffreys's,
of sensors known to u alone s / (u^2 + s^2) ds, with the tail of a half-Cauchy one (Gelman 2006, doi
10.1214/06-BA117A): one that is flat to zero has fleets with a spread near u find next to none too often.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtrc, fdtrc, gammainc, polygamma

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.fleet.statistics import CampaignStatistics, Responses
from shockrig.files.fleet_file import KELVIN, Coordinate, design

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FALSE_DISCOVERIES = 0.05  # of the sensors that are said not to belong, how many may belong after all
SPREAD_SCALE = 0.3  # half-Cauchy scale of a type's spread in a logarithm: makers sort out what differs by more
COARSE, FINE = np.geomspace(1e-4, 3.0, 30), 30  # trial standard deviations, and how many between the likely ones
NEGLIGIBLE_WEIGHT = 1e-5
LEAST_SENSORS = 3  # from which a spread can be told from nothing
CORE_SIGMAS = 3.0  # robust standard deviations within which the first core lies
EXACT_UP_TO = 60  # sensors: each is left out and Sigma estimated again; beyond it one EM step is taken back
WARM_STEPS = 20
MOST_STEPS, STEP_ENDS = 400, 1e-5
USUAL_SPREAD = 0.03  # where Sigma starts, of what no sensor alone has seen
MOST_ROUNDS = 15
NODES_APART_K = 2.0  # ambients nearer than this are no nodes of their own
WELL_KNOWN_K = 5.0  # by which an ambient that all sensors have may be further from the middle than one of a few
MIDDLE_FROM_K = 12.0  # span of ambients from which ln D over 1/T may bend


@dataclass(frozen=True)
class FleetMember:
    """One sensor with all of its campaigns, its numbers one below the other.

    `channel` (m,) names each number's channel; `film` (m,) says which are ln D; `common` (m, c) is what its bench's
    errors do, columns as in `Members.keys`, then those of its carriage, which is named where it has some.
    """

    name: str
    campaigns: tuple[CampaignStatistics, ...]
    coordinates: tuple[Coordinate, ...]
    channel: NDArray[np.str_]
    film: Mask
    value: Array
    covariance: Array
    common: Array
    bench: str
    responses: Responses
    carriage: str = ""

    def errors(self, table_scatter: float) -> Array:
        """Covariance of its own errors (m, m), what a table of ln D scatters by included."""
        return self.covariance + np.diag(table_scatter**2 * self.film)


@dataclass(frozen=True)
class Members:
    """All sensors of a fleet, the coordinates that they share, the inputs that benches share, and how far ln D of one
    sensor scatters about the polynomial."""

    sensors: tuple[FleetMember, ...]
    coordinates: tuple[Coordinate, ...]
    keys: tuple[str, ...]
    table_scatter: float


@dataclass(frozen=True)
class Reduced:
    """Sensors in the space of the coordinates: A (n, K, K), a (n, K), F (n, K, c), G = C'R^-1 C (n, c, c),
    g = C'R^-1 x (n, c), the numbers of each one's carriage and bench (n,), and how many of the c are the bench's.

    Sensors of a bench that were alone in their campaigns are one carriage, which has no errors of its own.
    """

    A: Array
    a: Array
    F: Array
    G: Array
    g: Array
    carriage: NDArray[np.int64]
    bench: NDArray[np.int64]
    of_bench: int

    @property
    def size(self) -> int:
        return self.A.shape[0]

    def only(self, keep: Mask) -> Reduced:
        """Without the others: they say nothing, and their benches stay."""
        return replace(self, **{x: getattr(self, x)[keep] for x in ("A", "a", "F", "G", "g", "carriage", "bench")})


@dataclass(frozen=True)
class Level:
    """The mean under a Sigma: each sensor's (mu, eps) (n, K + c) with its information J (n, K + c, K + c)
    and covariance, and the restricted log-likelihood up to a constant."""

    beta: Array
    information: Array
    right: Array
    covariance: Array
    log_likelihood: float
    mean: Array
    mean_covariance: Array


def reduce_members(members: Members, belongs: Mapping[str, Mask] | None = None) -> Reduced:
    """Each sensor's sums; `belongs` (channel -> (n,)) leaves out channels of sensors."""
    size, width = len(members.coordinates), members.sensors[0].common.shape[1]
    W = np.zeros((len(members.sensors),) + (size + width + 1,) * 2)
    for i, one in enumerate(members.sensors):
        keep = np.ones(one.value.size, dtype=bool)
        for channel, mask in (belongs or {}).items():
            if not mask[i]:
                keep &= one.channel != channel
        if keep.any():
            both = np.column_stack([design(members.coordinates, one.coordinates), one.common, one.value])[keep]
            W[i] = both.T @ np.linalg.solve(one.errors(members.table_scatter)[np.ix_(keep, keep)], both)
    k, c = slice(0, size), slice(size, size + width)
    carriage = _numbered([(one.bench, one.carriage) for one in members.sensors])
    bench = _numbered([one.bench for one in members.sensors])
    return Reduced(W[:, k, k], W[:, k, -1], W[:, k, c], W[:, c, c], W[:, c, -1], carriage, bench, len(members.keys))


def _numbered(names: Sequence[Any]) -> NDArray[np.int64]:
    places = {name: k for k, name in enumerate(sorted(set(names)))}
    return np.array([places[name] for name in names])


def _marginal(r: Reduced, sigma: Array) -> tuple[Array, Array, Array, Array]:
    """M, and each sensor's information (n, K+c, K+c) and right side (n, K+c) of (mu, eps), b integrated out; ln det of
    I + A Sigma (n,)."""
    size = sigma.shape[0]
    inside = np.eye(size) + r.A @ sigma
    M = np.asarray(np.linalg.inv(inside))
    MA, MF, Ma = M @ r.A, M @ r.F, (M @ r.a[..., None])[..., 0]
    turned = r.F.transpose(0, 2, 1) @ sigma
    G = r.G - turned @ MF
    g = r.g - (turned @ Ma[..., None])[..., 0]
    information = np.concatenate(
        [np.concatenate([MA, MF], axis=2), np.concatenate([MF.transpose(0, 2, 1), G], axis=2)], axis=1
    )
    return M, information, np.concatenate([Ma, g], axis=1), np.asarray(np.linalg.slogdet(inside)[1])


def level(r: Reduced, sigma: Array) -> Level:
    """Generalised least squares of the mean, the benches' errors with it."""
    M, information, right, logs = _marginal(r, sigma)
    found, determinant, quadratic = _solved(information, right, r, sigma.shape[0])
    quadratic -= float((r.a * (sigma @ (M @ r.a[..., None]))[..., 0]).sum())
    return replace(found, log_likelihood=-0.5 * (determinant + float(logs.sum()) + quadratic))


def _solved(information: Array, right: Array, r: Reduced, size: int) -> tuple[Level, float, float]:
    """Normal equations of a mean (its first `size` coordinates) and the errors of benches and carriages, these under
    N(0, I); ln det of what was eliminated, and minus what the estimate takes from the sum of squares."""
    wide = size + r.of_bench
    carriages = _gathered(information, right, r.carriage, wide)
    bench = np.zeros(carriages.right.shape[0], dtype=np.int64)
    bench[r.carriage] = r.bench
    benches = _gathered(carriages.own, carriages.own_right, bench, size)
    N, b = benches.own.sum(axis=0), benches.own_right.sum(axis=0)
    P = _inverse(N)
    mean = P @ b
    # What is known of a bench's own errors and, from all benches, of the mean; then likewise of a carriage's.
    J, full = benches.completed(N, b)
    J, full = carriages.completed(J[bench], full[bench])
    covariance = _inverse(J)
    beta = (covariance @ full[..., None])[..., 0]
    determinant = float(np.log(np.maximum(np.linalg.eigvalsh(N), 1e-300)).sum())
    determinant += carriages.determinant + benches.determinant
    quadratic = -carriages.quadratic - benches.quadratic - float(b @ mean)
    at = r.carriage
    return Level(beta[at], J[at], full[at], covariance[at], 0.0, mean, P), determinant, quadratic


@dataclass(frozen=True)
class _Gathered:
    """Normal equations of groups (g, w, w), each with errors of its own behind the first coordinates, under N(0, I);
    `own` is what is left for the first ones where the errors are eliminated."""

    information: Array
    right: Array
    own: Array
    own_right: Array
    determinant: float
    quadratic: float

    def completed(self, all_: Array, all_right: Array) -> tuple[Array, Array]:
        """With what all groups together say of the first coordinates in place of what each one says."""
        J, full, size = self.information.copy(), self.right.copy(), self.own.shape[1]
        J[:, :size, :size] += all_ - self.own
        full[:, :size] += all_right - self.own_right
        return J, full


def _gathered(information: Array, right: Array, group: NDArray[np.int64], size: int) -> _Gathered:
    whole, groups = information.shape[1], int(group.max()) + 1
    blocks, rights = np.zeros((groups, whole, whole)), np.zeros((groups, whole))
    np.add.at(blocks, group, information)
    np.add.at(rights, group, right)
    blocks[:, size:, size:] += np.eye(whole - size)
    cc, mc = blocks[:, size:, size:], blocks[:, :size, size:]
    solved = np.linalg.solve(cc, mc.transpose(0, 2, 1))
    rc = np.linalg.solve(cc, rights[:, size:, None])
    own, own_right = blocks[:, :size, :size] - mc @ solved, rights[:, :size] - (mc @ rc)[..., 0]
    determinant, quadratic = float(np.linalg.slogdet(cc)[1].sum()), float((rights[:, size:] * rc[..., 0]).sum())
    return _Gathered(blocks, rights, own, own_right, determinant, quadratic)


def _inverse(matrix: Array) -> Array:
    """Inverse of information (..., K, K); a direction without any gets a huge variance and leaves the others alone."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-12))
    outer = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(matrix / outer + 1e-13 * np.eye(scale.shape[-1])) / outer)


def change_along(r: Reduced, found: PopulationFit, along: Array) -> tuple[Array, Array]:
    """By how much the mean changes with a quantity `along` (n,) of the sensors (K,), and its covariance."""
    size = found.sigma.shape[0]
    _, information, right, _ = _marginal(r, found.sigma)
    T = np.zeros((r.size, size + information.shape[1], information.shape[1]))
    T[:, :size, :size] = np.eye(size)
    T[:, size : 2 * size, :size] = along[:, None, None] * np.eye(size)
    T[:, 2 * size :, size:] = np.eye(information.shape[1] - size)
    more, more_right = T @ information @ T.transpose(0, 2, 1), (T @ right[..., None])[..., 0]
    at, _, _ = _solved(more, more_right, r, 2 * size)
    return at.mean[size:], at.mean_covariance[size:, size:]


def _moments(r: Reduced, sigma: Array, at: Level) -> Array:
    """E[b b'] of each sensor (n, K, K), the mean's uncertainty in it."""
    size = sigma.shape[0]
    M = np.linalg.inv(np.eye(size) + r.A @ sigma)
    T = np.concatenate([r.A, r.F], axis=2)
    left = r.a - (T @ at.beta[..., None])[..., 0]
    gain = sigma @ M
    J = gain @ T
    b = (gain @ left[..., None])[..., 0]
    return np.asarray(b[:, :, None] * b[:, None, :] + gain + J @ at.covariance @ J.transpose(0, 2, 1))


def _combined(total: Array, n: int) -> Array:
    """Sigma from the sum of n sensors' moments, its correlations shrunk."""
    size, mean = total.shape[0], total / n
    shrunk = mean * (n / (n + size + 1.0))
    np.fill_diagonal(shrunk, np.diag(mean))
    return 0.5 * (shrunk + shrunk.T)


def _em(r: Reduced, sigma: Array, steps: int) -> Array:
    for _ in range(steps):
        new = _combined(_moments(r, sigma, level(r, sigma)).sum(axis=0), r.size)
        change = np.max(np.abs(np.diag(new) / np.diag(sigma) - 1.0))
        sigma = new
        if change < STEP_ENDS:
            break
    return sigma


@dataclass(frozen=True)
class PopulationFit:
    """Sigma with the degrees of freedom of its variances, the factor by which each standard deviation is larger than
    the restricted likelihood's own, and the mean under it."""

    sigma: Array
    degrees: Array
    factor: Array
    at: Level


def estimate(r: Reduced, start: Array, steps: int = MOST_STEPS) -> PopulationFit:
    """Population of the sensors in `r`, from a start of Sigma."""
    sigma = _em(r, start, steps)
    size = sigma.shape[0]
    spread = np.sqrt(np.diag(sigma))
    factor, degrees = np.ones(size), np.zeros(size)
    for k in range(size):
        trials = COARSE
        weight = _posterior(r, sigma, k, trials)
        likely = np.flatnonzero(weight > NEGLIGIBLE_WEIGHT * weight.max())
        ends = max(likely[0] - 1, 0), min(likely[-1] + 1, trials.size - 1)
        trials = np.geomspace(trials[ends[0]], trials[ends[1]], FINE)
        weight = _posterior(r, sigma, k, trials)
        mean = float(weight @ np.log(trials))
        factor[k] = math.sqrt(float(weight @ trials**2)) / spread[k]
        degrees[k] = degrees_of(float(weight @ (np.log(trials) - mean) ** 2))
    sigma = sigma * np.outer(factor, factor)
    return PopulationFit(sigma, degrees, factor, level(r, sigma))


def degrees_of(variance: float) -> float:
    """Degrees of freedom of a standard deviation whose logarithm is known to a variance; at least 1.

    That of ln chi^2 with nu degrees is trigamma(nu / 2); a large nu's, 1 / (2 nu), would make few sensors tell less
    than they do: 0.4 degrees in place of 1, 1.2 of 2, 4.1 of 5.
    """
    if 4.0 * variance >= float(polygamma(1, 0.5)):
        return 1.0
    most = math.log(1.0 + 1.0 / variance)  # trigamma(x) lies below 1 / x + 1 / x^2
    return math.exp(brentq(lambda log: float(polygamma(1, 0.5 * math.exp(log))) - 4.0 * variance, 0.0, most))


def _posterior(r: Reduced, sigma: Array, k: int, trials: Array) -> Array:
    """Weights of trial standard deviations of coordinate k, evenly spaced in their logarithm.

    b_j = B_jk b_k + what is left of it: both stay, so that the likelihood along the trials is that of b_k alone.
    """
    logs, column = np.empty(trials.size), sigma[k] / sigma[k, k]
    for j, trial in enumerate(trials):
        tried = sigma + (trial**2 - sigma[k, k]) * np.outer(column, column)
        told = np.linalg.solve(np.eye(column.size) + r.A @ tried, (r.A @ column)[..., None])[..., 0] @ column
        information = max(2.0 * trial**4 * float(told @ told), 1e-300)  # Fisher's, of ln of the standard deviation
        logs[j] = level(r, tried).log_likelihood + 0.5 * math.log(information)
    logs -= np.log1p((trials / SPREAD_SCALE) ** 2)
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum())


def nodes(members: Sequence[FleetMember]) -> tuple[Coordinate, ...]:
    """The coordinates of a fleet: what three sensors have at least; ln D at one to three temperatures, as far apart as
    most sensors' ambients allow."""
    had_by = Counter(c for one in members for c in set(one.coordinates) if c.temperature_c is None)
    found = [c for c, count in had_by.items() if count >= min(LEAST_SENSORS, len(members))]
    spans = [sorted({c.temperature_c for c in one.coordinates if c.temperature_c is not None}) for one in members]
    spans = [span for span in spans if span]
    if spans:
        low, high = (float(np.round(np.median([pick(span) for span in spans]))) for pick in (min, max))
        apart = int(np.median([1 + int(np.sum(np.diff(span) > NODES_APART_K)) for span in spans]))
        if apart == 1 or high - low <= NODES_APART_K:
            # Sensors with one ambient each: where these differ from sensor to sensor, D is still known to change. What
            # one or two have besides, where others share an ambient, is no coordinate, as with the other numbers.
            every = [t for span in spans for t in span]
            having = [sum(any(abs(t - other) <= NODES_APART_K for other in span) for span in spans) for t in every]
            shared = [t for t, count in zip(every, having, strict=True) if count >= min(LEAST_SENSORS, len(spans))]
            every = shared or every
            at = [float(np.round(np.median(every)))]
            if max(every) - min(every) > NODES_APART_K:
                at = [float(np.round(min(every))), float(np.round(max(every)))]
        elif apart == 2 or high - low < MIDDLE_FROM_K:
            at = [low, high]
        else:
            # Near the middle in 1/T, where most sensors have an ambient.
            middle = 2.0 / (1.0 / (low + KELVIN) + 1.0 / (high + KELVIN)) - KELVIN
            had = Counter(float(np.round(t)) for span in spans for t in span if low < np.round(t) < high)
            at = [low, min(had, key=lambda t: abs(t - middle) - WELL_KNOWN_K * had[t] / len(spans)), high]
        found += [Coordinate("humidity", "D", t) for t in at]
    return tuple(
        sorted(found, key=lambda c: (c.channel != "temperature", not c.unit, c.temperature_c or 0.0, c.figure))
    )


def table_scatter(members: Sequence[FleetMember], coordinates: Sequence[Coordinate]) -> float:
    """How far ln D of a sensor lies from the polynomial through the nodes, beyond its uncertainty: the size at which
    half of the sensors are nearer than chance would have them and half further."""
    rows = []
    for one in members:
        H = design(coordinates, one.coordinates)[one.film]
        H = H[:, (H != 0).any(axis=0)]
        if H.shape[0] > H.shape[1]:
            R = (one.covariance + one.common @ one.common.T)[np.ix_(one.film, one.film)]
            rows.append((one.value[one.film], H, R))
    if not rows:
        return 0.0

    def away(size: float) -> float:
        found = []
        for x, H, R in rows:
            V = R + size**2 * np.eye(x.size)
            solved = np.linalg.solve(V, np.column_stack([H, x]))
            best = np.linalg.lstsq(H.T @ solved[:, :-1], H.T @ solved[:, -1], rcond=None)[0]
            quadratic = float((x - H @ best) @ (solved[:, -1] - solved[:, :-1] @ best))
            found.append(gammainc(0.5 * (x.size - H.shape[1]), 0.5 * max(quadratic, 0.0)))
        return float(np.median(found)) - 0.5

    if away(0.0) <= 0.0:
        return 0.0
    return float(brentq(away, 0.0, 1.0)) if away(1.0) < 0.0 else 1.0


def start_of(members: Members) -> tuple[Array, dict[str, Mask]]:
    """A robust start: Sigma's diagonal from the medians of the sensors' own numbers, and who lies near enough to them
    to be counted first, by channel."""
    size, n = len(members.coordinates), len(members.sensors)
    own, spread = np.full((n, size), np.nan), np.full((n, size), np.nan)
    r = reduce_members(members)
    for i in range(n):
        covariance = np.linalg.inv(r.A[i] + 1e-4 * np.eye(size))  # what a sensor did not see stays unknown
        seen = np.diag(covariance) < 1.0
        spread[i, seen] = np.sqrt(np.diag(covariance)[seen])
        own[i, seen] = (covariance @ r.a[i])[seen]
    sigma = np.full(size, USUAL_SPREAD**2)
    near = {channel: np.ones(n, dtype=bool) for channel in sorted({c.channel for c in members.coordinates})}
    for k, one in enumerate(members.coordinates):
        there = np.isfinite(own[:, k])
        if not there.any():
            continue
        middle = np.median(own[there, k])
        away = np.abs(own[:, k] - middle)
        robust = MAD_TO_SIGMA * float(np.median(away[there]))
        noise = float(np.median(spread[there, k]))
        sigma[k] = max(robust**2 - noise**2, 0.1 * robust**2, 1e-8)
        near[one.channel] &= ~(there & (away > CORE_SIGMAS * np.sqrt(sigma[k] + spread[:, k] ** 2)))
    for channel, mask in near.items():
        if mask.sum() < max(LEAST_SENSORS, 0.5 * n):
            near[channel] = np.ones(n, dtype=bool)
    return np.diag(sigma), near


@dataclass(frozen=True)
class JudgedFleet:
    """Who belongs: probabilities (n,) by channel, NaN where a sensor has none; adjusted ones; the population."""

    probability: dict[str, Array]
    adjusted: dict[str, Array]
    belongs: dict[str, Mask]
    estimate: PopulationFit
    reduced: Reduced


def judge(members: Members) -> JudgedFleet:
    """The population of those that belong, and who does not.

    Each sensor is held against the population of the others that belong; those whose probability is too small at a
    false discovery rate of 5 % (Benjamini and Hochberg 1995) are left out, and all are looked at again, until nothing
    changes. The first core is robust, so that several that do not belong cannot hide one another.
    """
    sigma, belongs = start_of(members)
    seen: list[bytes] = []
    n = len(members.sensors)
    has = {c: np.array([c in one.channel for one in members.sensors]) for c in belongs}
    for _ in range(MOST_ROUNDS):
        r = reduce_members(members, belongs)
        found = estimate(r, sigma)
        sigma = found.sigma / np.outer(found.factor, found.factor)
        probability = _left_out(members, r, found, has)
        flat = np.concatenate([probability[c] for c in belongs])
        adjusted_flat = benjamini_hochberg(flat)
        adjusted = {c: adjusted_flat[k * n : (k + 1) * n] for k, c in enumerate(belongs)}
        new = {c: ~(adjusted[c] < FALSE_DISCOVERIES) for c in belongs}
        for channel in new:
            if (new[channel] & has[channel]).sum() < LEAST_SENSORS:
                new[channel] = np.ones(n, dtype=bool)
        stamp = b"".join(new[c].tobytes() for c in new)
        if all((new[c] == belongs[c]).all() for c in new) or stamp in seen:
            break
        seen.append(stamp)
        belongs = new
    return JudgedFleet(probability, adjusted, belongs, found, r)


def benjamini_hochberg(probability: Array) -> Array:
    """Adjusted probabilities: those below q are rejected at a false discovery rate of q; NaN stay."""
    there = np.flatnonzero(np.isfinite(probability))
    order = there[np.argsort(probability[there], kind="stable")]
    adjusted = np.full(probability.shape, np.nan)
    if order.size:
        steps = probability[order] * order.size / np.arange(1, order.size + 1)
        adjusted[order] = np.minimum(np.minimum.accumulate(steps[::-1])[::-1], 1.0)
    return adjusted


def _left_out(members: Members, r: Reduced, found: PopulationFit, has: Mapping[str, Mask]) -> dict[str, Array]:
    """Probability of each sensor's channel under the population of the others (channel -> (n,))."""
    n, sigma, at = r.size, found.sigma, found.at
    information, right = _marginal(r, sigma)[1:3]
    moments = _moments(r, sigma, at)
    total, scale = moments.sum(axis=0), np.outer(found.factor, found.factor)
    probability = {channel: np.full(n, np.nan) for channel in has}
    for i in range(n):
        channels = [channel for channel, mask in has.items() if mask[i]]
        if n <= EXACT_UP_TO and r.A[i].any():
            others = r.only(np.arange(n) != i)
            own = _em(others, sigma / scale, WARM_STEPS)
            far = _far(members, i, channels, own * scale, found.degrees, *_seen_by(others, r, i, own * scale))
            if min(far.values(), default=1.0) < FALSE_DISCOVERIES:
                # It makes the spread wide and well known: how sure the others alone are of theirs decides.
                alone = estimate(others, own, WARM_STEPS)
                far = _far(members, i, channels, alone.sigma, alone.degrees, *_seen_by(others, r, i, alone.sigma))
        else:
            own = _combined(total - moments[i], n - 1) if r.A[i].any() else sigma
            covariance = _inverse(at.information[i] - information[i])
            beta = covariance @ (at.right[i] - right[i])
            far = _far(members, i, channels, own, found.degrees, beta, covariance)
        for channel, value in far.items():
            probability[channel][i] = value
    return probability


def _far(
    members: Members, i: int, channels: Sequence[str], sigma: Array, degrees: Array, beta: Array, covariance: Array
) -> dict[str, float]:
    """Probability of numbers as far off as those of each of a sensor's channels."""
    one, said = members.sensors[i], {}
    for channel in channels:
        keep = one.channel == channel
        H = design(members.coordinates, [c for c in one.coordinates if c.channel == channel])
        R = one.errors(members.table_scatter)[np.ix_(keep, keep)]
        said[channel] = distance(one.value[keep], R, H, one.common[keep], sigma, degrees, beta, covariance)
    return said


def _seen_by(others: Reduced, r: Reduced, i: int, sigma: Array) -> tuple[Array, Array]:
    """What the others say of the mean and of the errors of a sensor's bench and carriage, with its covariance."""
    return _as_of(level(others, sigma), others, int(r.carriage[i]), int(r.bench[i]))


def _as_of(theirs: Level, others: Reduced, carriage: int, bench: int) -> tuple[Array, Array]:
    """What other sensors say of the mean and of the errors of a carriage on a bench; nothing of those of which they
    have no part."""
    size, width = theirs.mean.size, theirs.beta.shape[1]
    for there, known in ((others.carriage == carriage, width), (others.bench == bench, size + others.of_bench)):
        if there.any():
            one = int(np.flatnonzero(there)[0])
            value, spread = theirs.beta[one][:known], theirs.covariance[one][:known, :known]
            break
    else:
        known, value, spread = size, theirs.mean, theirs.mean_covariance
    covariance = np.eye(width)
    covariance[:known, :known] = spread
    return np.concatenate([value, np.zeros(width - known)]), covariance


def distance(
    value: Array, R: Array, H: Array, C: Array, sigma: Array, degrees: Array, beta: Array, covariance: Array
) -> float:
    """Probability of numbers as far from the population's predictive distribution, in the space of its coordinates.

    y = L^(1/2) U'(mu + b) + noise I, from A = H'R^-1 H = U L U'. Hotelling's T^2, whose degrees of freedom are those
    of Sigma as far as the distance rests on it.
    """
    solved = np.linalg.solve(R, np.column_stack([H, C, value]))
    size, width = H.shape[1], C.shape[1]
    A, F, a = H.T @ solved[:, :size], H.T @ solved[:, size : size + width], H.T @ solved[:, -1]
    values, vectors = np.linalg.eigh(A)
    seen = values > 1e-9 * values.max()
    root, U = np.sqrt(values[seen]), vectors[:, seen]
    T = np.concatenate([A, F], axis=1)
    left = (U.T @ (a - T @ beta)) / root
    J = (U.T @ T) / root[:, None]
    from_sigma = (U.T @ sigma @ U) * np.outer(root, root)
    S = np.eye(root.size) + from_sigma + J @ covariance @ J.T
    direction = np.linalg.solve(S, left)
    squared = max(float(left @ direction), 0.0)
    m = root.size
    share = float(np.trace(np.linalg.solve(S, from_sigma))) / m
    weight = np.abs(np.diag(sigma)) * np.diag(A)
    nu = float(weight @ degrees / max(weight.sum(), 1e-300)) / max(share, 1e-3) ** 2
    if nu > 1e5:
        return float(chdtrc(m, squared))
    nu = max(nu, m + 0.5)
    return float(fdtrc(m, nu - m + 1.0, squared * (nu - m + 1.0) / (nu * m)))
