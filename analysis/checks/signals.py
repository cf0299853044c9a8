"""What each column of each run shows before any model: its two plateaus, its noise, and when it crosses shares of its
step.

Everything here is medians and crossings, so that a wrong unit, a swap or a dead sensor is seen as it is.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.checks.finding import Channel, InputFinding, limit, name_runs
from shockrig.files.campaign import Campaign, Run, Trace

Array = NDArray[np.float64]

TEMPERATURE, HUMIDITY, DIE = "temperature", "humidity", "die"
COLUMNS = {TEMPERATURE: ("imet", "temperature_c"), HUMIDITY: ("hyt", "humidity_percent"), DIE: ("hyt", "temperature_c")}
CHANNEL_OF: dict[str, Channel] = {TEMPERATURE: "temperature", HUMIDITY: "humidity", DIE: "humidity"}
FILES = {TEMPERATURE: "imet.csv", HUMIDITY: "hyt.csv", DIE: "hyt.csv"}
CHANNEL_OF_FILE = {FILES[column]: channel for column, channel in CHANNEL_OF.items()}
CHANNEL_OF_SENSOR = {COLUMNS[column][0]: channel for column, channel in CHANNEL_OF.items()}
OTHER_SENSOR = {"imet": "hyt", "hyt": "imet"}
UNITS = {TEMPERATURE: "°C", HUMIDITY: "%RH", DIE: "°C"}


def mostly_impossible(trace: Trace) -> bool:
    """Whether more readings were dropped as beyond what can be than were kept."""
    return trace.dropped.get("implausible", 0) > trace.time_s.size


@dataclass(frozen=True)
class ColumnSeen:
    """One column of one run.

    Attributes
    ----------
    time_s, value : ndarray (n,)
        Times [s] and readings [°C or %RH], finite ones only.
    before, after : float
        Medians of the readings before the step and at the end of the record.
    noise : float
        Spread (one sigma, by quartiles) of the readings before the step, at least a twelfth of their resolution.
    moves : bool
        Whether the two plateaus differ by clearly more than the noise.
    """

    run: Run
    column: str
    time_s: Array
    value: Array
    before: float
    after: float
    noise: float
    moves: bool

    @property
    def step(self) -> float:
        return self.after - self.before

    @property
    def period_s(self) -> float:
        """Median time between readings [s]."""
        return float(np.median(np.diff(self.time_s)))

    def crossing_s(self, share: float) -> float:
        """When the readings cross `share` of their step [s], straight between the two readings around it."""
        i, done = self._last_below(share)
        if i < 0 or i + 1 >= done.size:
            return float(self.time_s[max(i, 0)])
        part = (share - done[i]) / (done[i + 1] - done[i])
        return float(self.time_s[i] + part * (self.time_s[i + 1] - self.time_s[i]))

    def around_s(self, share: float) -> tuple[float, float]:
        """Times of the two readings around the crossing of `share` [s]: between them nothing is known."""
        i, done = self._last_below(share)
        return float(self.time_s[max(i, 0)]), float(self.time_s[min(i + 1, done.size - 1)])

    def _last_below(self, share: float) -> tuple[int, Array]:
        """Index of the last reading below `share` before they stay beyond half (-1: none), and shares of the step.

        A burst that comes back is no crossing.
        """
        done = (self.value - self.before) / self.step
        half = _first_of(done >= max(0.5, share), 3)
        below = np.flatnonzero(done[: half + 1] < share)
        return (int(below[-1]) if below.size else -1), done


@dataclass(frozen=True)
class CampaignView:
    """A campaign as the checks see it: `seen` maps (run id, column) to what that column shows."""

    campaign: Campaign
    seen: dict[tuple[str, str], ColumnSeen]

    def column(self, column: str) -> list[ColumnSeen]:
        """One column in all runs that still have it, in the order of the campaign."""
        return [self.seen[run.id, column] for run in self.campaign.runs if (run.id, column) in self.seen]

    def get(self, run: Run, column: str) -> ColumnSeen | None:
        return self.seen.get((run.id, column))

    def words(self, runs: Collection[str]) -> str:
        """Runs of this campaign in words."""
        return name_runs(runs, len(self.campaign.runs))

    def without(self, findings: list[InputFinding]) -> CampaignView:
        """The view without what a finding stops: later checks need not trip over the same fault."""
        gone = {
            (run, column)
            for finding in findings
            if finding.severity == "stop"
            for run in finding.runs
            for column in COLUMNS
            if finding.channel in (None, CHANNEL_OF[column])
        }
        return replace(self, seen={key: seen for key, seen in self.seen.items() if key not in gone}) if gone else self


def look(campaign: Campaign) -> CampaignView:
    """Measure every column of every run that has enough readings."""
    seen = {}
    for run in campaign.runs:
        for column, (sensor, name) in COLUMNS.items():
            trace: Trace | None = getattr(run, sensor)
            if trace is None or name not in trace.values:
                continue
            good = np.isfinite(trace.values[name])
            if good.sum() >= limit("fewest_readings"):
                seen[run.id, column] = _measure(run, column, trace.time_s[good], trace.values[name][good])
    return CampaignView(campaign, seen)


def stated(run: Run, column: str) -> tuple[float | None, float | None]:
    """What run.json states of the source and the destination air, in the column's quantity."""
    if column == HUMIDITY:
        return run.source.humidity_percent, run.destination.humidity_percent
    return run.source.temperature_c, run.destination.temperature_c


def _measure(run: Run, column: str, time: Array, value: Array) -> ColumnSeen:
    head = max(int(0.02 * value.size), 5)
    if run.start_s is not None:  # in a record that begins at its trigger a quick sensor has soon arrived
        head = min(head, max(int(np.searchsorted(time, run.start_s)), 1))
    tail = max(int(0.1 * value.size), 5)
    after = float(np.median(value[-tail:]))
    before = float(np.median(value[:head]))
    resolution = _resolution(value)
    for _ in range(2):
        step = after - before
        calm = value.size
        if step != 0.0:
            done = (value - before) / step
            calm = _first_of(done >= 0.5, 3)
            below = np.flatnonzero(done[:calm] < 0.1)
            calm = int(below[-1]) + 1 if below.size else head
        # the last of it may already be moving where the response begins slowly
        plateau = value[: max(int(0.9 * calm), min(head, value.size))]
        before = float(np.median(plateau))
    quartiles = np.percentile(plateau, [25, 75])
    quick = np.median(np.abs(np.diff(plateau))) * 1.05 if plateau.size > 1 else 0.0
    noise = max(float(quartiles[1] - quartiles[0]) / 1.349, float(quick), resolution / 12**0.5)
    floor = limit("smallest_step_percent" if column == HUMIDITY else "smallest_step_k")
    moves = abs(after - before) > max(floor, limit("step_over_noise") * noise)
    return ColumnSeen(run, column, time, value, before, after, noise, moves)


def _resolution(value: Array) -> float:
    steps = np.abs(np.diff(value))
    steps = steps[steps > 1e-9]
    return float(steps.min()) if steps.size else 0.0


def _first_of(beyond: NDArray[np.bool_], in_a_row: int) -> int:
    """Index of the first of `in_a_row` true values; the last index where there is none."""
    run = beyond.copy()
    for shift in range(1, in_a_row):
        run[:-shift] &= beyond[shift:]
        run[-shift:] = False
    return int(np.argmax(run)) if run.any() else beyond.size - 1
