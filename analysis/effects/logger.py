"""What a logger does to readings: late, on another clock, averaged, repeated, rounded."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.jumps import NUDGES_S, when_it_jumps_s
from shockrig.analysis.estimate.channel import Channel, rebin
from shockrig.analysis.estimate.effect import (
    Arrays,
    Candidacy,
    Effect,
    Finding,
    InFlight,
    Needs,
    Parameter,
    Readout,
    SingleReadings,
    Start,
    Values,
    Words,
    unchanged,
)
from shockrig.analysis.estimate.model import LEAST_TRIGGER_OFFSET_S
from shockrig.analysis.estimate.noise import AVERAGED_KNOWN_TO
from shockrig.analysis.estimate.without_model import coarser_than_the_sensor, known_to, mostly_repeats
from shockrig.analysis.physics.chain import Chain

Array = NDArray[np.float64]

# The channel is late by `delay_s`: nothing else changes.

# Standard uncertainties of a trigger that is off alike in all runs: less is no delay of the channel.
TRIGGER_SIGMAS = 3.5


def _no_more_than_the_trigger(channel: Channel, values: Values) -> bool:
    stated_s = 0.0 if channel.common is None else channel.common.trigger_offset_s
    return abs(values["delay_s"]) < TRIGGER_SIGMAS * max(stated_s, LEAST_TRIGGER_OFFSET_S)


DEAD_TIME = Effect(
    id="dead_time",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading(t) = true(t - delay)",
    source="a polling loop or a buffer that hands out the previous reading",
    parameters=(Parameter("delay_s", "s", -0.02, 5.0, (0.01, 0.06, 0.15, 0.3, 0.6)),),
    apply=lambda chain, p: replace(chain, time_s=chain.time_s - p["delay_s"][..., None]),
    words=Words(
        "This channel is logged late by {delay_s} s.",
        "Time-stamp at the measurement and not at the read-out; request a conversion before every fetch.",
    ),
    needs=Needs(
        "needs runs whose start was recorded on the clock of the readings",
        lambda channel: bool(channel.conditions.start_known.any()),
    ),
    start=Start(
        from_data=lambda channel: {} if (late := when_it_jumps_s(channel)) is None else {"delay_s": late},
        nudges=lambda channel: [{"delay_s": s} for s in NUDGES_S] if channel.jumps_with_air else [],
    ),
    candidacy=Candidacy(refused=lambda channel, values, bare: _no_more_than_the_trigger(channel, values)),
    readout=Readout(like_average=lambda p, period_s: {int(2 * p["delay_s"] / period_s) + k for k in (0, 1, 2)}),
    in_flight=InFlight(delay_s=lambda p, period_s: max(p["delay_s"], 0.0)),
)


# The channel's time stamps run fast by `ppm` millionths, counted from the run's first sample.


def _on_its_own_clock(chain: Chain, p: Arrays) -> Chain:
    elapsed = chain.time_s + chain.channel.conditions.start_s[:, None]
    return replace(chain, time_s=chain.time_s - 1e-6 * p["ppm"][..., None] * np.maximum(elapsed, 0.0))


CLOCK_SIGMAS = 3.5  # standard uncertainties of a clock that is off alike in all runs


def _no_more_than_the_clock(channel: Channel, values: Values) -> bool:
    return channel.common is not None and abs(values["ppm"]) < CLOCK_SIGMAS * channel.common.clock_ppm


def _from_the_jumps(channel: Channel) -> dict[str, float]:
    """The share by which the jumps of a film's reading are late, where they are late by more than readings tell."""
    lead_s = channel.conditions.start_s
    share = when_it_jumps_s(channel, lead_s)
    if share is None or abs(share) * np.nanmean(lead_s) < 0.5 * channel.sampling_period_s:
        return {}
    return {"ppm": 1e6 * share}


def _nudges(channel: Channel) -> list[dict[str, float]]:
    """By how much later a transfer is in its stamps: where a film's response begins with a kink, the objective has a
    step wherever a sample passes it."""
    lead_s = float(np.nanmean(channel.conditions.start_s))
    return [{"ppm": 1e6 * late_s / max(lead_s, 1.0)} for late_s in NUDGES_S]


CLOCK_DRIFT = Effect(
    id="clock_drift",
    link="logger",
    channels=("temperature", "humidity"),
    equation="t_stamp = t (1 + ppm 1e-6)",
    source="a logger with its own oscillator; a crystal is good to 100 ppm, what acts on a transient needs far more",
    parameters=(Parameter("ppm", "1e-6", -200000.0, 200000.0, (20000.0, -20000.0), weakest=1000.0),),
    apply=_on_its_own_clock,
    words=Words(
        "This channel's clock runs fast by {ppm} parts per million.",
        "Stamp all channels with one clock, or log a time mark at both ends of every run.",
    ),
    needs=Needs(
        "needs runs whose start was recorded on the clock of the readings",
        lambda channel: bool((channel.conditions.start_known & ~channel.measured).any()),
    ),
    start=Start(from_data=_from_the_jumps, nudges=_nudges),
    candidacy=Candidacy(
        rare=lambda channel: True, refused=lambda channel, values, bare: _no_more_than_the_clock(channel, values)
    ),
)


# Each logged value is the mean of the last `samples` readings, noise included.


def _averaged(chain: Chain, p: Arrays) -> Chain:
    # A whole number of readings, the same for every candidate: it comes from the noise and is not searched.
    return replace(chain, averaged=max(int(round(float(p["samples"].flat[0]))), 1))


def seen_in_noise(known: SingleReadings) -> Finding | None:
    """A running mean in the logger, from the correlation of the noise."""
    noise = known.noise
    if noise is None or noise.averaged == 1 or mostly_repeats(known.channel, known.step):
        return None  # old readings over again hang together as a mean's do
    likelihood = noise.log_likelihood_by_average
    gain = float(likelihood[noise.averaged - 1] - likelihood[0])
    return Finding(
        "moving_average",
        {"samples": (float(noise.averaged), AVERAGED_KNOWN_TO)},
        f"the plateaus' noise is that of a mean over {noise.averaged} readings "
        f"(log likelihood {gain:+.0f} against plain noise)",
    )


MOVING_AVERAGE = Effect(
    id="moving_average",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading_i = mean(reading_(i-n+1) .. reading_i)",
    source="running mean in firmware",
    parameters=(Parameter("samples", "1", 1.0, 24.0, (5.0,), none=1.0),),
    apply=_averaged,
    words=Words(
        "The logger averages the last {samples} readings: the response is late and the noise is correlated.",
        "Switch the averaging off and average afterwards, centred.",
    ),
    readout=Readout(in_noise=seen_in_noise, averages=lambda p: int(round(p["samples"]))),
    in_flight=InFlight(delay_s=lambda p, period_s: 0.5 * max(p["samples"] - 1.0, 0.0) * period_s),
)


# Each reading is repeated for `hold_samples` rows without the stale flag.

Index = NDArray[np.int64]

LONGEST_HOLD = 40
IN_PHASE = 0.96  # of the changes that must come at one phase


def _places(time: Array, value: Array, period_s: float) -> tuple[Index, Index]:
    """Row numbers on the logger's grid, and the rows at which the reading changes."""
    index = np.rint((time - time[0]) / period_s).astype(int)
    return index, np.flatnonzero(np.abs(np.diff(value)) > 1e-9) + 1


def _phase(changed: Index, hold: int) -> int:
    return int(np.argmax(np.bincount(changed % hold, minlength=hold))) if changed.size else 0


def repeats(known: SingleReadings) -> tuple[SingleReadings, Finding | None]:
    """Readings that stand several times without the flag; the channel that is handed on keeps the first of each."""
    channel = known.channel
    period = channel.sampling_period_s
    grids = []
    for time, value in channel.samples:
        index, rows = _places(time, value, period)
        grids.append((index, index[rows]))
    changes = sum(changed.size for _, changed in grids)
    samples = sum(index.size for index, _ in grids)
    if changes < 50 or changes > 0.7 * samples:
        return known, None
    best = 1
    for hold in range(2, LONGEST_HOLD + 1):
        at_phase = [np.bincount(c % hold, minlength=hold).max() if c.size else 0 for _, c in grids]
        if sum(at_phase) >= IN_PHASE * changes:
            best = hold
    if best == 1:
        return known, None
    kept_samples, kept_die, kept_bins = [], [], []
    for run, (time, value) in enumerate(channel.samples):
        index, changed = grids[run]
        phase = _phase(changed, best)
        block = (index - phase) // best
        # Only a row that stands where its block begins is known to be fresh.
        fresh = (index - phase) % best == 0
        fresh &= np.diff(block, prepend=block[0] - 1) > 0
        kept_samples.append((time[fresh], value[fresh]))
        kept_bins.append(channel.bin_of[run][fresh])
        if channel.die_samples:
            kept_die.append(channel.die_samples[run][fresh])
    kept = rebin(channel, kept_samples, kept_bins, tuple(kept_die), best)
    return replace(known, channel=kept), Finding(
        "stale_samples",
        {"hold_samples": (float(best), 0.05)},
        f"readings change only every {best} rows, always at the same phase, and the stale flag is not set",
    )


def when_fresh(time: Array, value: Array, period_s: float, values: Values) -> Array:
    """Times at which each row's reading was fresh."""
    hold = int(round(values["hold_samples"]))
    if hold <= 1:
        return time
    index, rows = _places(time, value, period_s)
    return time - ((index - _phase(index[rows], hold)) % hold) * period_s


STALE_SAMPLES = Effect(
    id="stale_samples",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading_i = reading at the last i divisible by hold",
    source="read-out faster than the conversion, with the stale bit masked",
    parameters=(Parameter("hold_samples", "1", 1.0, 100.0, (4.0,), none=1.0),),
    apply=unchanged,
    words=Words(
        "The logger repeats old readings: each stands {hold_samples} times, without the flag.",
        "Honour the stale bit, and ask for a conversion before every fetch.",
    ),
    readout=Readout(in_readings=repeats, dated=when_fresh),
    in_flight=InFlight(left=False),
)


# Readings are rounded to `step`, coarser than the sensor's own 0.01 degC or 100/16383 %RH.


def coarse_step(known: SingleReadings) -> tuple[SingleReadings, Finding | None]:
    """The step to which all readings are rounded, where it is coarser than the sensor's own, where that is known."""
    step, normal = known.step, known.channel.quantity.resolution
    if not coarser_than_the_sensor(known.channel, step):
        return known, None
    unit = known.channel.quantity.unit
    return known, Finding(
        "quantization",
        {"step": (step, known_to(step))},
        f"all readings are multiples of {step:.4g} {unit}, the sensor resolves {normal:.3g} {unit}",
    )


QUANTIZATION = Effect(
    id="quantization",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading = step round(reading / step)",
    source="too few digits in the log or bits in the converter",
    parameters=(Parameter("step", "channel's unit", 1e-4, 10.0, (0.1,)),),
    apply=unchanged,
    words=Words(
        "Readings are rounded to steps of {step}.",
        "Log all the digits that the sensor gives.",
    ),
    readout=Readout(in_readings=coarse_step, rounded_to=lambda p: p["step"]),
    in_flight=InFlight(noise=lambda p: p["step"] / np.sqrt(12.0)),
)


EFFECTS = (DEAD_TIME, CLOCK_DRIFT, MOVING_AVERAGE, STALE_SAMPLES, QUANTIZATION)
