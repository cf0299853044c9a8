"""One channel of a campaign as recorded, read by the format's page alone: what benchmarks judge by.

Shares no code with the project's own reader, so that a benchmark does not inherit its opinions.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]

COLUMN = {"temperature": ("imet.csv", "temperature_c"), "humidity": ("hyt.csv", "humidity_percent")}
REFERENCE = {
    "temperature": ("temperature_standard_uncertainty_k", 0.02),
    "humidity": ("humidity_standard_uncertainty_percent", 0.1),
}
MOST_SAMPLES = 400  # of a run in a fit; errors are over all of them


@dataclass(frozen=True)
class Record:
    """One channel of one run as recorded; what the run does not state is None. `air` is (time_s, value), good to
    `air_uncertainty`. Errors count from `judged_from_s` on.
    """

    id: str
    time_s: Array
    value: Array
    start_s: float | None
    source: float | None
    destination: float | None
    air: tuple[Array, Array] | None
    onset_s: float
    air_uncertainty: float = 0.02
    judged_from_s: float = -np.inf

    def thinned(self) -> Record:
        """At most `MOST_SAMPLES` readings, densest where the reading changes most."""
        if self.time_s.size <= MOST_SAMPLES:
            return self
        change = np.abs(np.diff(smooth(self.value), prepend=self.value[0]))
        density = np.cumsum(0.5 / self.time_s.size + 0.5 * change / max(change.sum(), 1e-300))
        pick = np.unique(np.searchsorted(density, np.linspace(density[0], density[-1], MOST_SAMPLES)))
        pick = pick[pick < self.time_s.size]
        return replace(self, time_s=self.time_s[pick], value=self.value[pick])


def read_records(campaign: str | Path, channel: str) -> list[Record]:
    """The runs of one channel, in order of their folders; runs without that sensor are left out."""
    name, column = COLUMN[channel]
    found = []
    for folder in sorted(p.parent for p in Path(campaign).glob("runs/*/run.json")):
        if not (folder / name).exists():
            continue
        head = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        frame = pd.read_csv(folder / name)
        keep = np.isfinite(frame["time_s"]) & np.isfinite(frame[column])
        if "stale" in frame.columns:
            keep &= frame["stale"] == 0
        time, value = frame["time_s"].to_numpy(float)[keep], frame[column].to_numpy(float)[keep]
        air = None
        if (folder / "air.csv").exists():
            trace = pd.read_csv(folder / "air.csv")
            if column in trace.columns:
                known = np.isfinite(trace[column])
                air = trace["time_s"].to_numpy(float)[known], trace[column].to_numpy(float)[known]
        start = (head.get("transfer") or {}).get("start_s")
        ends = [(head.get(end) or {}).get(column) for end in ("source", "destination")]
        onset = _onset(time, value) if start is None else float(start)
        key, usual = REFERENCE[channel]
        good = float((head.get("reference") or {}).get(key, usual))
        found.append(Record(head.get("id") or folder.name, time, value, start, *ends, air, onset, good))
    return found


def smooth(value: Array) -> Array:
    width = max(1, value.size // 100)
    padded = np.pad(value, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.ones(width) / width, mode="valid")


def _onset(time: Array, value: Array) -> float:
    """When a reading begins to leave its first plateau: the last time before its greatest change that it was there."""
    steady = smooth(value)
    ahead = max(1, value.size // 50)
    steepest = int(np.argmax(np.abs(steady[ahead:] - steady[:-ahead])))
    level, end = np.median(value[: max(steepest, 1)]), np.median(value[-max(value.size // 20, 1) :])
    left = np.abs(value - level) < 0.05 * abs(end - level) if steepest else np.zeros(value.size, dtype=bool)
    before = np.flatnonzero(left[: steepest + ahead])
    return float(time[before[-1]] if before.size else time[0])
