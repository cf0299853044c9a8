"""What somebody elsewhere wants of a recording: CAMPAIGN/request.json, looked for by the recorder a few times a second.

{"format": "shock-request/1", "action": "pause" | "skip" | "repeat" | "note", "run": "0003", "text": "..."}
One at a time: the recorder takes it away. One for a run that has ended meanwhile, or from before the recording began,
changes nothing. Who may write it is for whoever listens to people to say (protocols/watch/web.py).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from shockrig.files.disk import is_there
from shockrig.files.errors import InputError
from shockrig.files.json_files import read_json, write_json
from shockrig.rig.bench_errors import BenchError, CampaignPaused, RunRepeated, RunSkipped

FORMAT = "shock-request/1"
FILE = "request.json"
ACTIONS = ("pause", "skip", "repeat", "note")
LOOK_EVERY_S = 0.2
LONGEST_NOTE = 500


@dataclass(frozen=True)
class Request:
    """One thing to do; `run` is the run that whoever asked saw, `text` is that of a note."""

    action: str
    run: str
    text: str = ""

    def __post_init__(self) -> None:
        if self.action not in ACTIONS:
            raise BenchError(f"action {self.action[:40]!r} is not known: give one of {', '.join(ACTIONS)}")
        if len(self.text) > LONGEST_NOTE or not self.text.isprintable():
            raise BenchError(f"a note is one line of at most {LONGEST_NOTE} characters")
        if self.action == "note" and not self.text.strip():
            raise BenchError("the note is empty: write something")


def leave_request(campaign: Path, request: Request) -> None:
    """Leave a request for the recorder of a campaign.

    Raises
    ------
    BenchError
        The last one was not taken yet.
    OSError
        The folder cannot be written.
    """
    if is_there(campaign / FILE):
        raise BenchError("the recorder has not taken the last request yet: try again")
    content = {"format": FORMAT, "action": request.action, "run": request.run, "text": request.text}
    write_json(campaign / FILE, content)


class Inbox:
    """The recorder's side; what lies there from before is thrown away."""

    def __init__(self, campaign: Path, now: Callable[[], float]) -> None:
        self._file = campaign / FILE
        self._now = now
        self._next_s = -math.inf
        self._clear()

    def take(self) -> Request | None:
        """The request that has come, if one has; the folder is looked at every `LOOK_EVERY_S` only."""
        if self._now() < self._next_s:
            return None
        self._next_s = self._now() + LOOK_EVERY_S
        if not is_there(self._file):
            return None
        try:
            content = read_json(self._file, FORMAT, "ask again")
            return Request(*(str(content.get(key) or "") for key in ("action", "run", "text")))
        except (InputError, BenchError):
            return None
        finally:
            self._clear()

    def _clear(self) -> None:
        with contextlib.suppress(OSError):
            self._file.unlink()


def decided(request: Request) -> None:
    """Raise what a request wants of the run in progress."""
    match request.action:
        case "pause":
            raise CampaignPaused("paused from the live page; the same command goes on from here")
        case "skip":
            raise RunSkipped("skipped from the live page")
        case "repeat":
            raise RunRepeated("to be repeated, as the live page asked")
