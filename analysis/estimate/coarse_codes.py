"""What rounding to a coarse step does to errors: which codes a run crosses, and when, is known once its signal is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from shockrig.analysis.estimate.fit import Fit, fit, model_at_samples, run_misfit
from shockrig.analysis.estimate.noise import COARSE_IN_NOISE, Noise, whiteners
from shockrig.analysis.estimate.problem import Problem, make_problem
from shockrig.analysis.estimate.refitting import refit

Array = NDArray[np.float64]

ROUNDING_PASSES = 3  # from a fit to when it crosses codes, and back
RUNS_OF_NOISE = 8  # that tell how large noise is before it is rounded
LEAST_NOISE = 0.01  # of a step: less makes no reading early or late
NOISE_KNOWN_TO = 0.1  # of itself
NOT_GAUSSIAN = 1.5  # by how much codes say less than their variance


def with_errors_of_codes(problem: Problem, noise: Noise, rough: Fit) -> tuple[Problem, Noise]:
    """A problem and its noise with errors of rounding as they come when the signal crosses codes, that of the fit
    `rough`.

    Nobody knows it where that fit is nothing like the signal: what it leaves of readings that cross codes is then less
    likely under such errors than under independent ones, which both have, and keep.
    """
    channel, independent, before = problem.channel, noise, rough
    for _ in range(ROUNDING_PASSES):
        signals = model_at_samples(channel, rough)
        part, runs = _crossing_codes(problem, rough, noise.step)
        noise = _likeliest_noise(independent, part, signals, rough, runs)
        known = make_problem(channel, whiteners(channel, noise, signals))
        rough = refit(known, rough.structure, rough)
    if noise.step <= COARSE_IN_NOISE * noise.white * (1.0 + NOISE_KNOWN_TO):  # such errors are independent as well
        return problem, independent
    apart = _likeliest_noise(independent, part, None, before, runs)
    if _deviance_of(part, noise, signals, rough, runs) > _deviance_of(part, apart, None, before, runs):
        return problem, independent
    # The covariance is that of runs at any place between two codes. One that rests at the edge of a code, where noise
    # throws it from one to the other, scatters more, and by how much only the run itself tells.
    excess = np.maximum(run_misfit(known, rough), 1.0)
    whitener = known.whitener / np.sqrt(NOT_GAUSSIAN * excess)[:, None, None]
    return replace(known, whitener=whitener), noise


def _crossing_codes(problem: Problem, found: Fit, step: float) -> tuple[Problem, NDArray[np.int64]]:
    """The readings of a few runs that are a step and more from where these begin and end, and the runs' indices; of
    runs that nowhere are, all readings."""
    channel = problem.channel
    shown, filled = channel.value - found.residual, channel.count > 0
    ends = np.array([one[there][[0, -1]] for one, there in zip(shown, filled, strict=True)])
    crossing = filled & (np.abs(shown[:, None] - ends[..., None]) > step).all(axis=1)
    crossing = crossing if crossing.any() else filled
    among = np.flatnonzero(crossing.any(axis=1))
    runs = among[np.unique(np.linspace(0, among.size - 1, RUNS_OF_NOISE).round().astype(int))]
    binned = tuple(np.where(row[at] & (at >= 0), at, -1) for row, at in zip(crossing, channel.bin_of, strict=True))
    part = replace(problem, channel=replace(channel, count=channel.count * crossing, bin_of=binned))
    return part.select(runs), runs


def _likeliest_noise(
    noise: Noise, part: Problem, signals: Sequence[Array] | None, found: Fit, runs: NDArray[np.int64]
) -> Noise:
    """The noise before rounding under which readings that cross codes are likeliest, no less than plateaus show; with
    independent errors of rounding where `signals` are not given.

    A plateau that stands at one code shows none, however much there is: what crosses codes is early or late by it.
    """

    def of(log_size: float) -> Noise:
        return replace(noise, white=float(np.exp(log_size)), correlated=0.0, memory=0.0)

    def deviance(log_size: float) -> float:
        return _deviance_of(part, of(log_size), signals, found, runs)

    least, most = LEAST_NOISE * noise.step, noise.step / COARSE_IN_NOISE
    at_least = min(max(float(np.hypot(noise.white, noise.correlated)), least), 0.5 * most)
    bounds = float(np.log(at_least)), float(np.log(most))
    return of(minimize_scalar(deviance, bounds=bounds, method="bounded", options={"xatol": NOISE_KNOWN_TO}).x)


def _deviance_of(
    part: Problem, noise: Noise, signals: Sequence[Array] | None, found: Fit, runs: NDArray[np.int64]
) -> float:
    """That of some runs' readings under a noise, at a fit's parameters."""
    own = None if signals is None else [signals[run] for run in runs]
    whitened = replace(part, whitener=whiteners(part.channel, noise, own))
    held = fit(whitened, found.structure, found.theta, found.deviations[runs], hold_theta=True)
    return _deviance(whitened, held)


def _deviance(problem: Problem, found: Fit) -> float:
    """-2 log likelihood of a fit, up to a constant that all descriptions of the noise share."""
    sizes = np.einsum("rii->ri", problem.whitener)[problem.channel.count > 0]
    return found.deviance - 2.0 * float(np.log(sizes).sum())
