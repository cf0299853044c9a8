"""CAMPAIGN/status.json: what the journals do not tell somebody who watches a recording from outside.

{"format": "shock-status/1", "state": "recording" | "ended", "reason", "pid", "host", "protocol", "bench",
 "run": {"id", "number", "total"}, "began_s", "recorded_here", "last_end_s", "messages": [...],
 "prompt": null or {"text", "deadline_s", "keys"},
 "steps": [{"text", "at_least_s", "at_most_s"}], "planned_s": {"0001": [at least, at most]}}
Written whole at every step, beside the name and then renamed; times in s on the bench clock.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections import deque
from dataclasses import asdict
from pathlib import Path
from typing import Any

from shockrig.files.json_files import write_json
from shockrig.rig.observer import Observer
from shockrig.rig.operator import KEYS, Prompt
from shockrig.rig.protocol import PlannedRun, Protocol, Record, Soak, Step, Transfer
from shockrig.rig.recorder import RunRecord
from shockrig.rig.recorder.run_journal import COMPLETE
from shockrig.rig.runner import cause
from shockrig.rig.seams import Reading

FORMAT = "shock-status/1"
FILE = "status.json"
TRANSFER_S = 1.0  # as in PlannedRun.shortest_s
MESSAGES = 20


def step_entry(step: Step) -> dict[str, Any]:
    """A step in words, and how long it takes at least and at most, in s."""
    match step:
        case Soak():
            shortest_s, longest_s = step.over_s, step.at_most_s
        case Record():
            shortest_s = longest_s = step.for_s
        case Transfer():
            shortest_s, longest_s = TRANSFER_S, step.at_most_s
    return {"text": str(step), "at_least_s": shortest_s, "at_most_s": longest_s}


class StatusFile:
    """An observer of the runner that keeps status.json and hands every event on.

    The recording never depends on it: a status that cannot be written is not written.
    """

    def __init__(self, path: Path, protocol: Protocol, bench: str, inner: Observer) -> None:
        self._path = path
        self._inner = inner
        self._recorded = 0
        self._messages: deque[str] = deque(maxlen=MESSAGES)
        self._content: dict[str, Any] = {
            "format": FORMAT,
            "state": "recording",
            "reason": "",
            "pid": os.getpid(),
            "host": socket.gethostname(),
            "protocol": protocol.name,
            "bench": bench,
            "planned_s": {run.id: [run.shortest_s(), run.longest_s()] for run in protocol.runs},
        }

    def __enter__(self) -> StatusFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        if "run" in self._content:  # a campaign that was refused is not ours to write into
            self._write(state="ended", prompt=None, reason="" if error is None else _words(error))

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None:
        self._content.setdefault("began_s", now_s)
        self._write(
            run={"id": run.id, "number": number, "total": total},
            steps=[step_entry(step) for step in run.steps],
        )
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.run_began(run, number, total, now_s)

    def step_began(self, step: Step, now_s: float) -> None:
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.step_began(step, now_s)
        self._write()

    def reading(self, reading: Reading) -> None:
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.reading(reading)

    def say(self, text: str) -> None:
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.say(text)
        self._messages.append(text)
        if "run" in self._content:
            self._write()

    def asked(self, prompt: Prompt | None) -> None:
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.asked(prompt)
        self._write(prompt=None if prompt is None else {**asdict(prompt), "keys": KEYS})

    def run_ended(self, record: RunRecord, now_s: float) -> None:
        with contextlib.suppress(OSError):  # of a terminal that was closed
            self._inner.run_ended(record, now_s)
        self._recorded += record.status == COMPLETE
        self._write(recorded_here=self._recorded, last_end_s=now_s)

    def _write(self, **changes: Any) -> None:
        self._content |= changes | {"messages": list(self._messages)}
        try:
            write_json(self._path / FILE, self._content)
        except (OSError, ValueError):
            pass  # a full disk is told by the journal, which matters


def _words(error: BaseException) -> str:
    return "stopped by Ctrl-C" if isinstance(error, KeyboardInterrupt) else cause(error)
