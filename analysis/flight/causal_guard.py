"""What is no reading of the air, told when it comes: codes, jumps, bursts of noise, repeats, stuck sensors.

The smoother's rules (`screen`, `stretches`) with what lies before alone: a code counts where the log jumps to it, a
jump beyond what the sensor's lag lets through is refused until it has lasted, noise is judged by third differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from shockrig.analysis.flight.causal_design import ChannelDesign
from shockrig.analysis.flight.screen import FEWEST_CHANGES, LONE_SIGMAS, SPIKE_STEPS
from shockrig.analysis.flight.stretches import (
    BURST_FACTORS,
    BY_CHANCE,
    MOST_SHARE,
    NORM_1,
    NORM_3,
    ROUNDING_FACTOR,
    STUCK_LEVELS,
    WHITE_SHARE,
)
from shockrig.analysis.flight.sweep import COARSE_IN_NOISE
from shockrig.files.sentinels import CODES, LEAST_JUMP

BURST_ROWS, NOISE_ROWS = 5.0, 100.0  # memories of the noise: of a burst, and of the flight
MEAN_SIZE = float(np.sqrt(2.0 / np.pi))  # of a normal deviation, over its standard deviation
LEAST_NOISE, MOST_NOISE = 0.5, 10.0  # times what is stated
MOST_DIFFERENCE = 30.0  # times the noise: one difference says no more than that
SOFT_EDGE = 0.2  # of the shares about WHITE over which readings turn from a signal into noise
CHANGES_KEPT = 32  # over which the smallest change of a log's readings is its step
DECIMAL_STEPS = (1.0, 0.1, 0.01)  # in which logs are written, the coarsest first,
WRITTEN_WITHIN = 1e-4  # and how near a multiple of one a reading in such steps is, in its unit
REPEATS_ROWS = 50.0
TIMES_BY_CHANCE = 2.0  # as many repeats as rounding alone makes
LASTING_ROWS = 10  # refused readings in a row, after which they are the sensor's
NEAR_CODE = 1e-4
CODES_WITHIN: dict[str, tuple[float, ...]] = {
    name: tuple(sorted(code for code in CODES[name] if low <= code <= high))
    for name, low, high in (("temperature", -100.0, 150.0), ("humidity", -10.0, 130.0))
}


@dataclass(frozen=True)
class Judged:
    """One row of a channel: whether it is used, why not, and the variance of its noise [unit^2]."""

    usable: bool
    missing: bool = False
    repeated: bool = False
    implausible: bool = False
    variance: float = 0.0
    restart: bool = False


class Guard:
    """Judges readings one by one, in the log's own unit."""

    def __init__(self, design: ChannelDesign, codes: tuple[float, ...]) -> None:
        self.design, self.codes = design, codes
        self.reset()

    def reset(self) -> None:
        """A start of which nothing is known."""
        self.last = self.before = self.third = np.nan  # believed readings, the latest first
        self.step, self.smallest, self.smallest_before, self.changes = 0.0, np.inf, np.inf, 0
        self.decimals = 0  # place in DECIMAL_STEPS of the coarsest that readings are written in
        self.often, self.width = 0.0, 0.0  # share of repeats, mean size of a change
        self.anchor, self.stays, self.equal = np.nan, 0, 0
        self.refused, self.unused = 0, 0
        self.burst = [1.0, 1.0]  # third and first differences over the noise
        self.usual = [1.0, 1.0]

    @property
    def resolution(self) -> float:
        """Step of the log, 0 where it is not known. Before readings have changed, which in calm air they do not, it is
        the one that they are written in."""
        if self.changes >= FEWEST_CHANGES:
            return self.step
        return DECIMAL_STEPS[self.decimals] if self.decimals < len(DECIMAL_STEPS) else 0.0

    @property
    def coarse(self) -> bool:
        """Whether the log's steps are coarser than the noise."""
        return self.resolution > COARSE_IN_NOISE * self.design.noise

    def judge(self, reading: float, expected: float, open_to: float, alike: float = 0.0) -> Judged:
        """Judge a reading of which `expected` was, within a standard deviation `open_to`, before its noise; `alike`
        goes from row to row as noise would, and is none."""
        d = self.design
        if not np.isfinite(reading):
            return self._left(Judged(False, missing=True))
        if not d.possible[0] <= reading <= d.possible[1]:
            return self._left(Judged(False, implausible=True))
        # as programs hold it: a step of 0.01 K is off by 2e-4 there, on which a repeat by chance may hang
        reading = float(np.float32(reading))
        away = abs(reading - expected)
        usual = float(hypot(d.noise, self.resolution / sqrt(12.0))) * self._usual(self.usual)
        rows = self.unused + 1
        share = 1.0 - (1.0 - min(d.share, 0.999)) ** rows
        most = d.swing * share + float(hypot(LONE_SIGMAS * usual, SPIKE_STEPS * self.resolution)) + 4.0 * open_to
        coded = away > max(LEAST_JUMP, LONE_SIGMAS * usual + 4.0 * open_to) and any(
            abs(reading - code) <= NEAR_CODE for code in self.codes
        )
        if coded:
            return self._left(Judged(False, implausible=True))
        if away > most:
            self.refused += 1
            if self.refused < LASTING_ROWS:
                return self._left(Judged(False, implausible=True))
            # it has lasted: the sensor is there, whatever it was before
            self.reset()
            self._believed(reading)
            return Judged(True, variance=d.noise**2, restart=True)
        self.refused = 0
        capped = reading >= d.ceiling - 0.5 * self.resolution
        repeated = self._believed(reading, alike)
        step = self.resolution
        noise = d.noise * self._usual(self.usual) * self._bursting()
        variance = noise**2 + step**2 / 12.0
        if self.coarse:
            # readings on one step are off by the same, and together say little more than one
            variance = noise**2 + step**2 / 12.0 * (1.0 + self.equal)
        stuck = self.stays >= self._by_chance()
        if capped or stuck or repeated:
            return self._left(Judged(False, repeated=stuck or repeated))
        self.unused = 0
        return Judged(True, variance=variance)

    def _left(self, judged: Judged) -> Judged:
        self.unused += 1
        return judged

    def _believed(self, reading: float, alike: float = 0.0) -> bool:
        """Take in a reading that can be; whether it repeats the one before for no reason that rounding gives."""
        for step in DECIMAL_STEPS[self.decimals :]:
            if abs(reading - step * round(reading / step)) <= WRITTEN_WITHIN:
                break
            self.decimals += 1
        if not np.isfinite(self.last):
            self.last = self.anchor = reading
            return False
        change = abs(reading - self.last)
        same = change == 0.0
        self.equal = self.equal + 1 if same else 0
        self.often += (float(same) - self.often) / REPEATS_ROWS
        if not same:
            self._differences(reading, alike)
            self.changes += 1
            self.width += (change - self.width) / min(self.changes, REPEATS_ROWS)
            self.smallest = min(self.smallest, change)
            if self.changes % CHANGES_KEPT == 0:
                self.smallest_before, self.smallest = self.smallest, np.inf
            self.step = min(self.smallest, self.smallest_before)
            if self.step == np.inf:
                self.step = change
        if abs(reading - self.anchor) <= STUCK_LEVELS * ROUNDING_FACTOR * self.resolution:
            self.stays += 1
        else:
            self.anchor, self.stays = reading, 0
        self.third, self.before, self.last = self.before, self.last, reading
        step = self.resolution
        if not same or step >= 1.5 * self.design.noise or self.changes < FEWEST_CHANGES:
            return False
        by_chance = min(step * MEAN_SIZE / (np.sqrt(2.0 * np.pi) * max(self.width, 1e-9)), 1.0)
        return self.equal > 1 or self.often > TIMES_BY_CHANCE * max(by_chance, 1.0 / REPEATS_ROWS)

    def _differences(self, reading: float, alike: float) -> None:
        """Third and first differences of the readings, as memories of a burst and of the flight."""
        if self.design.share > MOST_SHARE or not np.isfinite(self.third):
            return
        noise = float(hypot(hypot(self.design.noise, self.resolution / sqrt(12.0)), alike))
        third = abs(reading - 3.0 * self.last + 3.0 * self.before - self.third) / (NORM_3 * MEAN_SIZE * noise)
        first = abs(reading - self.last) / (NORM_1 * MEAN_SIZE * noise)
        for memory, rows in ((self.burst, BURST_ROWS), (self.usual, NOISE_ROWS)):
            for i, size in enumerate((third, first)):
                memory[i] += (min(size, MOST_DIFFERENCE) - memory[i]) / rows

    def _usual(self, memory: list[float]) -> float:
        """Noise of the flight over what is stated, as far as differences are of noise and not of the air."""
        white = self._white(memory)
        return min(max(1.0 + white * (memory[0] - 1.0), LEAST_NOISE), MOST_NOISE)

    def _bursting(self) -> float:
        """Noise of the last few rows over the flight's, 1 where it is not far more."""
        times = self.burst[0] / self._usual(self.usual)
        limit = BURST_FACTORS[15]
        loud = min(max(times / limit - 1.0, 0.0), 1.0) * self._white(self.burst)
        return 1.0 + loud * (times - 1.0)

    @staticmethod
    def _white(memory: list[float]) -> float:
        return min(max((memory[0] / max(memory[1], 1e-9) - WHITE_SHARE + SOFT_EDGE) / SOFT_EDGE, 0.0), 1.0)

    def _by_chance(self) -> float:
        """Readings in a row that noise alone does not keep within so many steps of a level."""
        step = self.resolution
        if step == 0.0:
            return np.inf
        x = STUCK_LEVELS * step / (self.design.noise * np.sqrt(2.0))
        share = float(np.tanh(x * (1.12838 + 0.10277 * x * x)))  # erf within 0.0004
        return max(float(np.ceil(np.log(BY_CHANCE) / np.log(share))), 5.0) if 0.0 < share < 0.999 else np.inf
