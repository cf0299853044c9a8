"""`run --watch`: the terminal's live view as a process of its own beside the recording, which never waits for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from shockrig.protocols.run_progress import LineObserver
from shockrig.rig.observer import SilentObserver
from shockrig.rig.protocol import PlannedRun

LAST_LOOK_WITHIN_S = 3.0
LEAVE_ALTERNATE_SCREEN = "\x1b[?1049l\x1b[?25h"


class LiveObserver(SilentObserver):
    """Starts `shockrig watch` when the first run begins, and ends it with the recording.

    Where nobody sits at a terminal, and before and after the live view, it says what there is to say in plain lines.
    """

    def __init__(self, campaign: Path) -> None:
        self._campaign = campaign
        self._lines = LineObserver()
        self._view: subprocess.Popen[bytes] | None = None
        self._begun = False

    def __enter__(self) -> LiveObserver:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._view is None:
            return
        try:
            self._view.wait(LAST_LOOK_WITHIN_S)  # it sees from the status that the recording has ended
        except subprocess.TimeoutExpired:
            self._view.kill()
            self._view.wait()
        if self._view.returncode != 0:  # it could not put the terminal back in order
            print(LEAVE_ALTERNATE_SCREEN, end="", flush=True)

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None:
        if not sys.stdout.isatty():
            self._lines.run_began(run, number, total, now_s)
        elif not self._begun:
            self._begun = True
            command = [sys.executable, "-P", "-m", "shockrig", "watch", str(self._campaign.resolve())]
            try:
                self._view = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            except OSError as error:
                self._lines.say(f"the live view cannot be shown ({error}); the recording goes on")

    @property
    def shows(self) -> bool:
        """Whether the live view is on the terminal, and with it what the operator is asked."""
        return self._view is not None and self._view.poll() is None

    def say(self, text: str) -> None:
        if not self.shows:
            self._lines.say(text)
