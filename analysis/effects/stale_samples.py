"""Each reading is repeated for `hold_samples` rows without the stale flag."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import rebin
from shockrig.analysis.estimate.effect import (
    Effect,
    Finding,
    InFlight,
    Parameter,
    Readout,
    SingleReadings,
    Values,
    Words,
    unchanged,
)

Array = NDArray[np.float64]
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


EFFECT = Effect(
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
