"""What a watcher shows, as data, and how text and numbers from files are made safe to show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

LONGEST_TEXT = 500


@dataclass(frozen=True)
class ViewTrace:
    """One quantity of one sensor; `points` are (s since the recording began, value), `expected` what the plan has for
    the source and the destination air (None: nothing)."""

    sensor: str
    quantity: str
    unit: str
    points: tuple[tuple[float, float], ...]
    expected: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True)
class Health:
    """How one sensor did in the last seconds. `state` is "good", "failing", "silent" or "waiting"."""

    sensor: str
    state: str
    values: Mapping[str, float]
    per_s: float
    age_s: float | None
    outcomes: Mapping[str, int]


@dataclass(frozen=True)
class StepView:
    """A step of the run; `state` is "done", "now" or "next"."""

    text: str
    state: str


@dataclass(frozen=True)
class PromptView:
    """What a person must do now, the keys that answer, and the seconds until the campaign pauses (None: not known)."""

    text: str
    keys: str
    left_s: float | None


@dataclass(frozen=True)
class RunView:
    """A run of the plan; `state` is "recorded", "now" or "missing"; `set_aside` counts attempts that do not count."""

    id: str
    source: str
    destination: str
    note: str
    state: str
    set_aside: int


@dataclass(frozen=True)
class WatchView:
    """All that a watcher shows. Times in s; None where it is not known.

    `state` is "recording", "asking" (a person must do something), "stalled" (nothing new for a while), "cut off" (the
    recorder is gone), "ended" or "idle".
    `left_s` is the best guess of what the whole campaign still takes, `left_at_most_s` the protocol's own limit.
    `alarms` are what somebody should look at now, `notes` what was written down in this run: (s since the recording
    began, text).
    """

    campaign: str
    protocol: str
    bench: str
    state: str
    reason: str
    run: str
    attempt: int
    steps: tuple[StepView, ...]
    step_s: float | None
    step_left_s: float | None
    left_s: float | None
    left_at_most_s: float | None
    heard_s: float | None
    transfer_s: tuple[float, float | None] | None
    traces: tuple[ViewTrace, ...]
    health: tuple[Health, ...]
    runs: tuple[RunView, ...]
    messages: tuple[str, ...] = ()
    prompt: PromptView | None = None
    alarms: tuple[str, ...] = ()
    notes: tuple[tuple[float, str], ...] = ()

    def summary(self) -> str:
        """The state in one line."""
        recorded = sum(run.state == "recorded" for run in self.runs)
        return f"{recorded} of {len(self.runs)} runs recorded" + (f": {self.reason}" if self.reason else "")


def clean(text: Any) -> str:
    """Text from a file, made safe to show: no control characters, no endless length."""
    short = str(text)[:LONGEST_TEXT]
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in short)


def air_words(air: Any) -> str:
    """An air of the plan in words; a question mark for what is not known."""
    air = air if isinstance(air, dict) else {}
    parts = ((air.get("temperature_c"), "degC"), (air.get("humidity_percent"), "%RH"))
    return " ".join(f"{value:g} {unit}" if finite(value) else f"? {unit}" for value, unit in parts)


def finite(value: Any) -> bool:
    """Whether a value from a file is a number that can be shown."""
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e300 < value < 1e300


def as_list(value: Any) -> list[Any]:
    """A list from a file; empty where it is none."""
    return value if isinstance(value, list) else []
