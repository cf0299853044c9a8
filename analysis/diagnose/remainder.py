"""What the model with all its causes still leaves on held-out runs: its size above the noise, and whether it matters.

Statistics finds 0.02 %RH in thirty runs; whether that matters is for the user to say, by a tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.adequacy import Adequacy, in_common, varies_with, when_largest
from shockrig.analysis.diagnose.gain import Gain
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.estimate.fit import Fit, left_at_common_rates
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem
from shockrig.files.diagnosis_data import StatedRemainder

Array = NDArray[np.float64]

PEAK_TOLERANCES = 5.0  # a peak matters from this many times the tolerance of the rms on


@dataclass(frozen=True)
class Tolerance:
    """From which size on a remainder matters: a tenth of the sensors' stated accuracy unless the user says else."""

    temperature_k: float = 0.03
    humidity_percent: float = 0.2

    def of(self, unit: str) -> float:
        """In a channel's unit, K or %RH."""
        return self.temperature_k if unit == "K" else self.humidity_percent


def describe(
    problem: Problem, found: Fit, noise: Noise, adequacy: Adequacy, left: StatedRemainder
) -> dict[str, object]:
    """What is left, without physics: its size, when in the run it is largest, and what it varies with."""
    weight, share = problem.channel.count, in_common(problem.channel, found, noise)
    size = left_rms(problem, found)
    return {
        "size_rms": size,
        "size_peak": float(np.abs(np.where(weight > 0, found.residual, 0.0)).max()),
        "unit": left.unit,
        "in_units_of_the_noise": size / noise.standard_deviation,
        "test": adequacy.worst.name,
        "p": adequacy.p,
        "largest_from_s": left.from_s,
        "largest_until_s": left.until_s,
        "varies_with": list(left.varies_with),
        **({} if share is None else {"in_common": share}),
    }


def left_rms(problem: Problem, found: Fit) -> float:
    """Root mean square of what a fit leaves, each bin counting as its samples do [channel's unit]."""
    weight = problem.channel.count
    return float(np.sqrt((weight * found.residual**2).sum() / weight.sum()))


def is_material(significant: bool, size: float, peak: float, tolerance: float) -> bool:
    """Whether what is left is as large as the tolerance: a significant one always is where none is allowed."""
    return size >= tolerance or peak >= PEAK_TOLERANCES * tolerance if tolerance else significant


def _spread(whitener: Array, filled: NDArray[np.bool_]) -> Array:
    """Standard deviation of the noise in the mean of each bin (runs, bins) [unit], 0 in an empty one: noise that hangs
    together, and a coarse step's, is thinned out less than white noise."""
    spread = np.zeros(filled.shape)
    for run, there in enumerate(filled):
        inverse = np.linalg.inv(whitener[run][np.ix_(there, there)])
        spread[run, there] = np.sqrt((inverse**2).sum(axis=1))
    return spread


def measure_remainder(
    problem: Problem,
    found: Fit,
    noise: Noise,
    adequacy: Adequacy,
    gain: Gain,
    tolerance: Tolerance,
    discrepancy: float = 0.0,
) -> StatedRemainder:
    """The remainder of a fitted model; its peak is the largest mean over a bin that noise does not explain.

    `discrepancy` is the model's on unseen runs, as a share of a run's step.
    """
    channel = problem.channel
    unit = channel.quantity.unit
    filled = channel.count > 0
    spread = _spread(problem.whitener, filled)
    # Four standard deviations of the bin's own noise are what the largest of a few thousand bins may show by chance.
    beyond = np.where(filled, np.abs(found.residual) - 4.0 * spread, 0.0)
    begins, ends = when_largest(channel, found, noise)
    if gain.measured:
        square = gain.after**2 - gain.noise_floor**2
    else:
        # Another run does not have a rate of its own that was fitted to it.
        residual = left_at_common_rates(channel, found)
        square = float((channel.count * (residual**2 - spread**2)).sum() / channel.count.sum())
    rms = float(np.sqrt(max(square, 0.0)))
    peak = float(max(beyond.max(initial=0.0), 0.0))
    # By what a change of the air as large as the runs' is read wrong.
    misled = discrepancy * float(np.sqrt(np.mean(channel.quantity.step(channel.conditions) ** 2)))
    badly = gain.measured and gain.after > level("held_out_excess") * gain.noise_floor
    significant, allowed = not adequacy.passed or badly, tolerance.of(unit)
    return StatedRemainder(
        rms=rms,
        peak=peak,
        unit=unit,
        significant=significant,
        material=is_material(significant, max(rms, misled), peak, allowed),
        tolerance=allowed,
        from_s=begins,
        until_s=ends,
        varies_with=tuple(varies_with(problem, found)),
    )
