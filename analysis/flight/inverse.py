"""Corrections by inverting the sampled sensor between two low-passes: as the paper does it, and the exact one.

Paper (Segales et al. 2022, section 6, doi 10.5194/amt-15-2607-2022): zero-phase FIR low-pass, inverse of the explicitly
stepped layers, low-pass again, D from the flight's mean temperature. Exact: zero-order hold of the modes, D
followed, and where zeros lie outside the unit circle the inverse runs both ways in time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from shockrig.analysis.flight.flight_channel import LEAST_SAMPLES, FlightReadings
from shockrig.analysis.flight.response import LagResponse, held_matrix, stepped
from shockrig.analysis.flight.smooth_channel import Estimate, typical_period
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.modes import response_times
from shockrig.analysis.physics.schemes.slips import share_time
from shockrig.analysis.physics.schemes.state_space import (
    StateSpace,
    delay_samples,
    film_layers,
    is_minimum_phase,
    sample,
    sphere_layers,
    stable_period_s,
    zeros,
)
from shockrig.files.errors import InputError
from shockrig.files.numbers import moment

Array = NDArray[np.float64]

# The low-pass of the two inverses: it stops where a reading sinks into its noise, and has no phase.


def power_density(values: Array, period_s: float, size: int) -> tuple[Array, Array]:
    """One-sided power spectral density by Welch's method: segments of `size` that overlap by half, straight lines taken
    off, Hann's taper (doi 10.1109/TAU.1967.1161901): frequency [Hz], power [unit^2/Hz].

    As SciPy's `signal.welch`, which takes longer to import than the smoother takes for a flight.
    """
    size = min(size, values.size)
    segments = sliding_window_view(values, size)[:: size - size // 2]
    along = np.arange(size) - 0.5 * (size - 1)
    level = segments.mean(axis=1, keepdims=True)
    line = level + np.outer(segments @ along / max(float(along @ along), 1.0), along)
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
    spectra = np.abs(np.fft.rfft((segments - line) * taper, axis=1)) ** 2
    power = np.asarray(spectra.mean(axis=0) * period_s / np.sum(taper**2), dtype=np.float64)
    power[1 : (size + 1) // 2] *= 2.0  # all but 0 and the highest of an even number
    return np.asarray(np.fft.rfftfreq(size, period_s), dtype=np.float64), power


def suggest_cutoff_hz(reading: Array, period_s: float, noise: float) -> float:
    """Frequency above which the reading's power spectrum lies on its noise floor.

    The floor is the median of the highest 30 % of frequencies, if that is no more than four times the power of the
    noise expected; else the noise expected. The cut-off is where the smoothed spectrum first falls below twice the
    floor.
    """
    size = min(reading.size, max(256, reading.size // 4))
    frequency, power = power_density(reading, period_s, size)
    expected = 2 * period_s * noise**2
    seen = float(np.median(power[frequency > 0.7 * frequency[-1]])) / 0.97
    floor = seen if seen < 4 * expected else expected
    width = np.maximum(1, np.arange(power.size) // 8)
    total = np.concatenate([[0.0], np.cumsum(power)])
    low, high = np.maximum(np.arange(power.size) - width, 0), np.minimum(np.arange(power.size) + width + 1, power.size)
    smoothed = (total[high] - total[low]) / (high - low)
    below = np.flatnonzero((smoothed < 2 * floor) & (frequency > 0))
    cutoff = frequency[below[0]] if below.size else frequency[-1]
    return float(np.clip(cutoff, 4.0 / (reading.size * period_s), 0.8 * frequency[-1]))


def low_pass(values: Array, period_s: float, cutoff_hz: float) -> Array:
    """Zero-phase FIR low-pass (windowed sinc, symmetric), the ends continued by point reflection."""
    taps = fir_taps(values.size, period_s, cutoff_hz)
    half = taps.size // 2
    padded = np.pad(values, half, mode="reflect", reflect_type="odd")
    return np.convolve(padded, taps, mode="valid")


def fir_taps(count: int, period_s: float, cutoff_hz: float) -> Array:
    """Taps of the low-pass for a series of `count` values: four periods of the cut-off long, odd, of unit sum."""
    from scipy.signal import firwin

    length = min(int(4.0 / (cutoff_hz * period_s)), (count - 1) // 2) // 2 * 2 + 1
    return firwin(max(length, 3), cutoff_hz, fs=1 / period_s)


# A sensor's lags as a sampled system: exact for air that is held over each period, with its transfer function.

T63 = 0.63212055882855767
WELL_CONDITIONED = 1e8  # eigenvectors beyond that are not trusted: two lags in series may have equal rates


def response_time_s(response: LagResponse, share: float = T63, row: int = 0) -> float:
    """Time to `share` of a step at one instant of the flight."""
    return response_times(response.modes(row), (share,))[0]


def mean_response(response: LagResponse) -> LagResponse:
    """One response for a whole flight: weights and logs of the rates averaged."""
    return replace(
        response,
        weight=response.weight.mean(axis=0, keepdims=True),
        rate=np.exp(np.log(response.rate).mean(axis=0, keepdims=True)),
        relative_uncertainty=response.relative_uncertainty.mean(keepdims=True),
    )


def sampled(response: LagResponse, period_s: float, row: int) -> StateSpace:
    """Exact zero-order hold of the response at one row, in lags."""
    a = held_matrix(response.rate[row], period_s, response.cap, response.inside)
    # at rest in unit air every lag stands at one
    return StateSpace(a, 1.0 - a.sum(axis=1), response.weight[row], 0.0, period_s)


def transfer_function(system: StateSpace, frequency: Array) -> NDArray[np.complex128]:
    """Transfer function of a sampled system at frequencies in cycles per sample."""
    z = np.exp(2j * np.pi * np.asarray(frequency))
    poles, vectors = np.linalg.eig(system.a)
    if np.linalg.cond(vectors) > WELL_CONDITIONED:
        away = z[..., None, None] * np.eye(len(system.b)) - system.a
        return np.asarray(system.d + np.linalg.solve(away, system.b[:, None].astype(complex))[..., 0] @ system.c)
    weight = (system.c @ vectors) * np.linalg.solve(vectors, system.b.astype(complex))
    return np.asarray(system.d + np.sum(weight / (z[..., None] - poles), axis=-1))


LAYERS = tuple(range(10, 1, -1))  # tried from the finest down
SKEWS = (None, 0.5, 1.0)  # the core alone, or layers weighted towards it by (N - i + 1)^p
SMALLEST_GAIN = 1e-3
MOST_GAPS = 100.0  # times the samples, of steps that a straight line bridges
ON_THE_CIRCLE = 0.02  # a zero so close to the unit circle cannot be inverted either way in time


class RefusedError(InputError):
    """A method refuses this sensor at this sampling; the message says why and what to use instead."""


def paper_layers(channel: str, response: LagResponse, period_s: float) -> tuple[StateSpace, int]:
    """The paper's explicitly stepped sensor with the most layers whose step and inverse are both stable; how many.

    Its diffusivity is what a fit of that very grid would have found: the one that gives the response's own t63.

    Raises
    ------
    RefusedError
        No number of layers does, or the paper has no layers for such a body; says what fails.
    """
    if response.body not in ("sphere", "film"):
        body = BODIES[response.body].sentence if response.body in BODIES else "a body of unknown shape"
        raise RefusedError(
            f"{channel}: the paper's inverse is refused: it knows a sphere read at its core and a film, and the "
            f"profile has {body}; use the smoother"
        )
    t63 = response_time_s(response)
    reasons = set()
    of_sphere = response.body == "sphere"
    for layers, skew in ((layers, skew) for layers in LAYERS for skew in (SKEWS if of_sphere else (None,))):
        grid = sphere_layers("printed", layers, skew=skew) if of_sphere else film_layers("printed", layers)
        rate = share_time(grid) / t63
        system = StateSpace(rate * grid.a, rate * grid.b, grid.c)
        if stable_period_s(system) < period_s:
            reasons.add("the explicit step grows")
            continue
        explicit = sample(system, period_s, "explicit_euler")
        if is_minimum_phase(explicit):
            return explicit, layers
        reasons.add("the inverse has poles outside the unit circle")
    raise RefusedError(
        f"{channel}: the paper's inverse is refused: with {LAYERS[-1]} to {LAYERS[0]} layers at {period_s:g} s "
        f"{' or '.join(sorted(reasons))} (t63 = {t63:.3g} s); use the smoother"
    )


def paper(readings: FlightReadings, cutoff_hz: float | None = None) -> Estimate:
    """Correct one channel as the paper does; RefusedError where no layer count is stable."""
    period, time, reading = _evenly(readings)
    system, _ = paper_layers(readings.channel, mean_response(readings.response), period)
    cutoff = _cutoff_hz(readings, cutoff_hz, reading, period)
    smooth = low_pass(reading, period, cutoff)
    air = low_pass(invert(system, smooth), period, cutoff)
    return _estimate(readings, time, air, smooth, period, cutoff, _gain(system, air.size, period, cutoff))


def invert(system: StateSpace, reading: Array) -> Array:
    """Air that makes a sampled, minimum-phase system read `reading`, from rest at its first value; shape kept."""
    delay = delay_samples(system)
    row = system.c @ np.linalg.matrix_power(system.a, delay)
    reaction = float(system.c @ np.linalg.matrix_power(system.a, delay - 1) @ system.b)
    # at rest under unit air the states are all equal to the air's value
    state = np.linalg.solve(np.eye(len(system.b)) - system.a, system.b) * reading[0]
    air = np.empty(reading.size)
    later = np.concatenate([reading[delay:], np.full(delay, reading[-1])])
    for k, value in enumerate(later):
        air[k] = (value - row @ state) / reaction
        state = system.a @ state + system.b * air[k]
    return air


def exact_inverse(readings: FlightReadings, cutoff_hz: float | None = None) -> Estimate:
    """Correct one channel by the exact inverse; RefusedError where a zero lies on the unit circle."""
    period, time, reading = _evenly(readings)
    cutoff = _cutoff_hz(readings, cutoff_hz, reading, period)
    smooth = low_pass(reading, period, cutoff)
    nearest = np.clip(np.searchsorted(readings.time_s - readings.delay_s, time), 0, readings.time_s.size - 1)
    along = readings.response.at(nearest)
    rates = along.rate[:, along.within.start]  # of the body: those of a cap are the same all along
    looked_at = {int(np.argmin(rates)), int(np.argmax(rates)), time.size // 2}
    systems = [sampled(along, period, row) for row in sorted(looked_at)]
    if all(is_minimum_phase(system) for system in systems):
        air = _invert_along(along, smooth, period)
    else:
        found = np.concatenate([zeros(system) for system in systems])
        kept = np.abs(np.angle(found)) / (2 * np.pi * period) < 2 * cutoff
        near = found[kept & (np.abs(np.abs(found) - 1.0) < ON_THE_CIRCLE)]
        if near.size:
            raise RefusedError(
                f"{readings.channel}: the exact inverse is refused: sampling at {period:g} s puts a zero on the "
                f"unit circle (|z| = {abs(near[0]):.3f}) within the cut-off of {cutoff:.2g} Hz; use the smoother"
            )
        air = _invert_both_ways(_mean_system(along, period), smooth)
    air = low_pass(air, period, cutoff)
    # held air acts half a sample late, so the inverse's value stands for the middle of its step
    air = np.interp(time, time + 0.5 * period, air)
    return _estimate(
        readings, time, air, smooth, period, cutoff, _gain(_mean_system(along, period), air.size, period, cutoff)
    )


def _mean_system(along: LagResponse, period: float) -> StateSpace:
    return sampled(mean_response(along), period, 0)


def _invert_along(along: LagResponse, reading: Array, period: float) -> Array:
    """Inverse of the lags under zero-order hold, weights and rates taken anew at each step."""
    step = stepped(along.rate, np.array(period), along.cap, along.inside)
    decay, fed, within, count = step.decay, step.fed, along.within, len(along.cap)
    drive = 1.0 - decay
    drive[:, within] -= fed.sum(axis=-1)
    carry, reaction = along.weight * decay, np.sum(along.weight * drive, axis=1)
    carry[:, :count] += np.einsum("nm,nmj->nj", along.weight[:, within], fed)
    state = np.full(decay.shape[1], reading[0])
    air = np.empty(reading.size)
    for k in range(reading.size):
        following = reading[min(k + 1, reading.size - 1)]
        air[k] = (following - carry[k] @ state) / reaction[k]
        after = decay[k] * state + drive[k] * air[k]
        after[within] += fed[k] @ state[:count]
        state = after
    return air


def _invert_both_ways(system: StateSpace, reading: Array) -> Array:
    """Stable two-sided inverse by division of spectra: zeros inside the circle run forward in time, others backward."""
    pad = reading.size
    padded = np.pad(reading, pad, mode="reflect", reflect_type="odd")
    trend = np.linspace(padded[0], padded[-1], padded.size)
    frequency = np.asarray(np.fft.rfftfreq(padded.size), dtype=float)
    taper = 0.5 - 0.5 * np.cos(np.pi * np.arange(2 * (pad // 2)) / max(pad // 2, 1))
    window = np.ones(padded.size)
    window[: pad // 2], window[-(pad // 2) :] = taper[: pad // 2], taper[-(pad // 2) :]
    transfer = transfer_function(system, frequency)
    # a zero on the circle beyond the low-pass, often at half the sampling rate, is left to the low-pass
    transfer /= np.minimum(np.abs(transfer) / SMALLEST_GAIN, 1.0)
    air = np.fft.irfft(np.fft.rfft((padded - trend) * window) / transfer, padded.size)
    away = np.eye(len(system.b)) - system.a
    delay = float(system.c @ np.linalg.solve(away, np.linalg.solve(away, system.b)))  # a ramp's lag in steps
    slope = (trend[1] - trend[0]) if trend.size > 1 else 0.0
    return (air + trend + slope * delay)[pad:-pad]


def _gain(system: StateSpace, count: int, period: float, cutoff: float) -> float:
    """Standard deviation of the corrected noise per that of white noise in the reading, low-passes included."""
    frequency = np.linspace(0.0, 0.5, 2049)
    taps = fir_taps(count, period, cutoff)
    filtered = np.abs(np.exp(-2j * np.pi * frequency[:, None] * np.arange(taps.size)) @ taps) ** 2
    gain = filtered / np.maximum(np.abs(transfer_function(system, frequency)), 1e-12)
    return float(np.sqrt(np.mean(gain**2)))


def _evenly(readings: FlightReadings) -> tuple[float, Array, Array]:
    """Readings on an even grid of their typical period, gaps bridged by straight lines."""
    period = typical_period(readings.time_s)
    rows = np.flatnonzero(readings.usable)
    if rows.size < LEAST_SAMPLES:
        raise RefusedError(
            f"{readings.channel}: {rows.size} usable samples are too few to invert; {LEAST_SAMPLES} are needed"
        )
    own = readings.time_s - readings.delay_s
    if np.ptp(own) > MOST_GAPS * own.size * period:
        row = int(np.argmax(np.diff(own)))
        logged_s = own if readings.logged_s is None else readings.logged_s
        by_s, at = float(logged_s[row + 1] - logged_s[row]), moment(logged_s[row])
        raise RefusedError(
            f"{readings.channel}: time_s leaps by {by_s:.3g} s at {at}, and the inverse needs even steps; fix the "
            "log's clock or cut the log there, or use the smoother"
        )
    time = np.arange(own[0], own[-1] + readings.delay_s + 0.5 * period, period)
    return period, time, np.interp(time, own[rows], readings.reading[rows])


def _cutoff_hz(readings: FlightReadings, given_hz: float | None, reading: Array, period: float) -> float:
    """The cut-off asked for, or the one that the noise suggests; RefusedError where the samples do not reach it."""
    if given_hz is None:
        return suggest_cutoff_hz(reading, period, _noise(readings))
    lowest, highest = 1.0 / (reading.size * period), 0.5 / period
    if not lowest < given_hz < highest:
        raise RefusedError(
            f"{readings.channel}: a cut-off of {given_hz:g} Hz is not between {lowest:.3g} and {highest:.3g} Hz, what "
            f"{reading.size} samples every {period:.3g} s hold; give another --cutoff-hz or leave it out"
        )
    return given_hz


def _noise(readings: FlightReadings) -> float:
    variance = readings.noise_variance
    if readings.passing is not None:
        variance = variance + readings.passing.sigma**2
    return float(np.sqrt(np.mean(variance[readings.usable])))


def _estimate(
    readings: FlightReadings, time: Array, air: Array, clean: Array, period: float, cutoff: float, gain: float
) -> Estimate:
    """Put the inverse's result on the rows; variance: amplified noise and the turbulence above the cut-off."""
    frequency, power = power_density(air, period, min(air.size, max(256, air.size // 4)))
    band = (frequency > 0.4 * cutoff) & (frequency < 0.8 * cutoff)
    amplified = (gain * _noise(readings)) ** 2
    level = float(np.median(power[band] * (frequency[band] / cutoff) ** (5 / 3))) if band.any() else 0.0
    variance = amplified + 1.5 * cutoff * level  # integral of a -5/3 spectrum from the cut-off on
    rows = readings.time_s
    return Estimate(
        np.interp(rows, time, air),
        np.full(rows.shape, variance),
        np.interp(rows, time, clean),
        np.ones(rows.shape),
        cutoff,
        amplified=amplified,
    )
