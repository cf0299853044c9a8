"""What a person sees on standard error while a campaign is recorded: a bar at a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import sys
from typing import Any, TextIO

from shockrig.protocols.time_left import TimeLeft
from shockrig.rig.observer import SilentObserver
from shockrig.rig.operator import Prompt
from shockrig.rig.protocol import PlannedRun, Step
from shockrig.rig.recorder import RunRecord
from shockrig.rig.seams import Air, Reading

READINGS_BETWEEN_UPDATES = 50


def words(air: Air) -> str:
    """An air in words, e.g. "20 degC 55 %RH"."""
    temperature = "?" if air.temperature_c is None else f"{air.temperature_c:g}"
    humidity = "?" if air.humidity_percent is None else f"{air.humidity_percent:g}"
    return f"{temperature} degC {humidity} %RH"


def duration(seconds: float) -> str:
    """A duration for people: 45 s, 12 min, 2 h 05 min."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


class LineObserver(SilentObserver):
    """One line for each run."""

    def __init__(self, stream: TextIO | None = None):
        self._stream = stream or sys.stderr
        self._clock: TimeLeft | None = None
        self._first = 1

    def __enter__(self) -> LineObserver:
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None:
        flow = "" if run.airflow_m_s is None else f", {run.airflow_m_s:g} m/s"
        if self._clock is None:  # a campaign that goes on began with another run
            self._clock, self._first = TimeLeft(), number
        left = self._clock.after((number - self._first) / max(total - self._first + 1, 1))
        self.say(f"run {run.id} ({number}/{total}): {words(run.source)} -> {words(run.destination)}{flow}{left}")

    def say(self, text: str) -> None:
        with contextlib.suppress(OSError):  # the terminal is closed, which the recording need not end for
            print(text, file=self._stream, flush=True)


class BarObserver(SilentObserver):
    """A live bar: the step, the latest readings, how far the campaign is."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[text]}"),
            console=Console(stderr=True, highlight=False, markup=False),
            transient=True,
        )
        self._task: Any = None
        self._step = ""
        self._latest: dict[str, str] = {}
        self._count = 0

    def __enter__(self) -> BarObserver:
        self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        with contextlib.suppress(OSError):
            self._progress.stop()

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None:
        if self._task is None:
            self._task = self._progress.add_task("", total=total, text="")
        text = f"run {run.id}  {words(run.source)} -> {words(run.destination)}"
        self._progress.update(self._task, completed=number - 1, total=total, description=text)

    def step_began(self, step: Step, now_s: float) -> None:
        self._step = str(step).partition(" until ")[0]
        self._update()

    def reading(self, reading: Reading) -> None:
        values = reading.values
        if "humidity_percent" in values:
            self._latest[reading.sensor] = f"{values['humidity_percent']:.1f} %RH"
        elif "temperature_c" in values:
            self._latest[reading.sensor] = f"{values['temperature_c']:.2f} degC"
        self._count += 1
        if self._count % READINGS_BETWEEN_UPDATES == 0:
            self._update()

    def run_ended(self, record: RunRecord, now_s: float) -> None:
        if record.status == "complete" and self._task is not None:
            self._progress.advance(self._task)

    def say(self, text: str) -> None:
        self._progress.console.print(text)

    def asked(self, prompt: Prompt | None) -> None:
        """A bar that moves would write into what the operator types."""
        if prompt is None:
            self._progress.start()
        else:
            self._progress.stop()

    def _update(self) -> None:
        if self._task is not None:
            self._progress.update(self._task, text="  ".join([self._step, *self._latest.values()]))


def observer(stream: TextIO | None = None) -> LineObserver | BarObserver:
    """The observer that suits standard error."""
    return BarObserver() if stream is None and sys.stderr.isatty() else LineObserver(stream)
