"""Means over layers of a flight, with what averages out in them and what does not.

Noise and turbulence are independent from one stretch of samples to the next and shrink with their number; an error of
the profile or of the calibration is common to the flight, and the mean of a layer has all of it.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.files.flight import Corrected, Flight

COLUMNS = (
    "low_m", "high_m", "samples", "temperature_c", "temperature_uncertainty_k", "temperature_uncertainty_independent_k",
    "temperature_uncertainty_common_k", "humidity_percent", "humidity_uncertainty_percent",
    "humidity_uncertainty_independent_percent", "humidity_uncertainty_common_percent",
)  # fmt: skip
CHANNELS = (
    ("temperature", "temperature_c", "temperature_uncertainty_k"),
    ("humidity", "humidity_percent", "humidity_uncertainty_percent"),
)


class Layers:
    """Sums over layers of `height_m`, block after block."""

    def __init__(self, height_m: float) -> None:
        self.height_m = height_m
        self._sums: dict[int, np.ndarray] = {}  # layer -> (channel, [samples, value, independent variance, common])

    def add(self, flight: Flight, found: Corrected) -> None:
        """Add a block; rows without an altitude or a corrected value do not count."""
        if flight.altitude_m is None:
            return
        period = typical_period(flight.time_s)
        layer = np.floor(flight.altitude_m / self.height_m)
        for i, (name, value_of, sigma_of) in enumerate(CHANNELS):
            value, sigma = getattr(found, value_of), getattr(found, sigma_of)
            common = found.common[name]
            known = np.isfinite(layer) & np.isfinite(value) & np.isfinite(sigma) & np.isfinite(common)
            alike = max(found.independent_after_s[name] / period, 1.0)  # samples that share one error
            independent = np.maximum(sigma**2 - common**2, 0.0) * alike
            for number in np.unique(layer[known]).astype(int).tolist():
                rows = known & (layer == number)
                sums = self._sums.setdefault(number, np.zeros((len(CHANNELS), 4)))
                sums[i] += rows.sum(), value[rows].sum(), independent[rows].sum(), common[rows].sum()

    def rows(self) -> Iterator[tuple[float, ...]]:
        """A row of COLUMNS for each layer, from below."""
        for number in sorted(self._sums):
            row = [number * self.height_m, (number + 1) * self.height_m, self._sums[number][:, 0].max()]
            for count, total, variance, common in self._sums[number]:
                if not count:
                    row += 4 * [np.nan]
                    continue
                independent, shared = np.sqrt(variance) / count, common / count
                row += [total / count, float(np.hypot(independent, shared)), independent, shared]
            yield tuple(row)

    def write(self, path: Path) -> int:
        """Write the layers as CSV; how many there are."""
        rows = list(self.rows())
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(COLUMNS)
            for row in rows:
                writer.writerow(["" if v != v else f"{v:.0f}" if i == 2 else f"{v:.5g}" for i, v in enumerate(row)])
        return len(rows)
