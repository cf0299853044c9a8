"""One run filed several times: noise that two runs have in common.

What a straight line through the readings just before does not foretell is compared, so that hum and slow drifts, which
runs may share, count for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shockrig.analysis.checks.finding import Channel, InputFinding
from shockrig.analysis.checks.signals import (
    CHANNEL_OF_FILE,
    COLUMNS,
    FILES,
    HUMIDITY,
    TEMPERATURE,
    Array,
    CampaignView,
    ColumnSeen,
)
from shockrig.analysis.checks.thresholds import limit

NO_NOISE = 1e-7  # of a calculated campaign, in shares of the readings' range
MOST_READINGS = 5000  # of a run that are compared
AR_ORDER = 8  # readings that foretell the next one: two tones and a slow noise


def copied_runs(view: CampaignView) -> Iterator[InputFinding]:
    """Runs that are copies of another: equal noise in a sensor's readings."""
    originals: dict[str, str] = {}
    places: dict[str, list[str]] = {}
    for column in (TEMPERATURE, HUMIDITY):
        kept: list[tuple[ColumnSeen, Array]] = []
        for seen in view.column(column):
            noise = _innovations(seen.value[:MOST_READINGS])
            if noise is None:
                continue
            twin = next((s for s, n in kept if _correlation(n, noise) > limit("copy_correlation")), None)
            if twin is None:
                kept.append((seen, noise))
            else:
                originals.setdefault(seen.run.id, originals.get(twin.run.id, twin.run.id))
                places.setdefault(seen.run.id, []).append(FILES[column])
    for original in dict.fromkeys(originals.values()):
        runs = tuple(run for run, first in originals.items() if first == original)
        files = sorted({place for run in runs for place in places[run]}, reverse=True)
        channel: Channel = None if len(files) > 1 else CHANNEL_OF_FILE[files[0]]
        same = all(_equal(view, original, run, column) for run in runs for column in COLUMNS)
        yield InputFinding(
            "run_copied",
            channel,
            runs,
            "stop",
            f"{' and '.join(files)} of {view.words(runs)} {'repeats' if len(runs) == 1 else 'repeat'} the "
            f"{'readings' if same else 'noise'} of run {original}, which no second measurement does: keep run "
            f"{original} and leave the copies out.",
        )


def _equal(view: CampaignView, first: str, second: str, column: str) -> bool:
    a, b = view.seen.get((first, column)), view.seen.get((second, column))
    return a is None or b is None or np.array_equal(a.value, b.value)


def _innovations(value: Array) -> Array | None:
    """What `AR_ORDER` readings do not foretell of the next; None where too few readings change to tell runs apart."""
    changes = np.diff(value)
    if np.count_nonzero(changes) < limit("copy_readings") or value.size < 4 * AR_ORDER:
        return None
    past = np.lib.stride_tricks.sliding_window_view(changes, AR_ORDER)[:-1]
    ahead = changes[AR_ORDER:]
    # the transient would decide the prediction: rows far beyond the usual change are left out
    usual = 6.0 * max(float(np.percentile(np.abs(changes), 75)), 1e-12)
    calm = (np.abs(ahead) < usual) & (np.abs(past) < usual).all(axis=1)
    if calm.sum() < limit("copy_readings"):
        return None
    weights = np.linalg.lstsq(past[calm], ahead[calm], rcond=1e-6)[0]
    rest = ahead - past @ weights
    most = 3.0 * float(np.median(np.abs(rest[calm])))  # alike are also two transients, but those are few readings
    if most < NO_NOISE * np.ptp(value):
        return None
    return np.where(calm, np.clip(rest, -most, most), 0.0)


def _correlation(first: Array, second: Array) -> float:
    if first.size != second.size:
        return 0.0
    both = (first != 0.0) & (second != 0.0)
    if both.sum() < limit("copy_readings"):
        return 0.0
    a, b = first[both], second[both]
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))
