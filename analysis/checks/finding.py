"""What a check of the input says: a kind, the channel and runs concerned, how serious it is, and one plain sentence."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

Severity = Literal["stop", "warn"]
Channel = Literal["temperature", "humidity"] | None


@dataclass(frozen=True)
class InputFinding:
    """One likely fault of the input.

    Attributes
    ----------
    kind : str
        An id, such as "fahrenheit" or "start_disagrees".
    channel : "temperature", "humidity" or None
        The channel concerned; None where it is both.
    runs : tuple of str
        Ids of the runs to leave out until the fault is put right ("stop"), or to look at ("warn").
    severity : "stop" or "warn"
        "stop": what a fit of these runs would give is nonsense. "warn": worth knowing, and may be meant.
    sentence : str
        The likely cause, the numbers that show it, and the remedy.
    """

    kind: str
    channel: Channel
    runs: tuple[str, ...]
    severity: Severity
    sentence: str


def name_runs(runs: Collection[str], total: int) -> str:
    """Runs in words: "all 35 runs", "run 0003", "runs 0003 and 0007", "17 of 35 runs (0001, 0002, 0003, ...)"."""
    names = list(runs)
    if len(names) == 1:
        return f"run {names[0]}"
    if len(names) == total:
        return f"all {total} runs"
    if len(names) <= 4:
        return f"runs {', '.join(names[:-1])} and {names[-1]}"
    return f"{len(names)} of {total} runs ({', '.join(names[:3])}, ...)"
