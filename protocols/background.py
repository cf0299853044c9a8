"""A diagnosis made by another process while the bench soaks and records the next run.

What it is asked is in the campaign's log (`due`), so a loop that was killed asks again and gets the same answer.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from shockrig.protocols.branch import end

if TYPE_CHECKING:
    from shockrig.analysis.inference.quantity import ChannelName
    from shockrig.analysis.planning.judged import Verdict
    from shockrig.files.campaign import Campaign

NICER = 5  # than the recording, which must not wait


class Background:
    """One process at a time that diagnoses the channels of which the last decision left the diagnosis for later."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._answers: Connection | None = None
        self._found: dict[ChannelName, Verdict] = {}

    def begin(self, campaign: Campaign, due: Mapping[ChannelName, Verdict]) -> None:
        """Diagnose a checked campaign's channels that are due."""
        self.close()
        context = multiprocessing.get_context("spawn")
        self._answers, there = context.Pipe(duplex=False)
        self._process = context.Process(target=_diagnose, args=(there, campaign, dict(due)), daemon=True)
        self._process.start()
        there.close()

    def __call__(self, name: ChannelName) -> Verdict | None:
        """The verdict on a channel, waited for where it is not there yet; None where the process came to nothing."""
        while name not in self._found and self._answers is not None:
            try:
                whose, verdict = self._answers.recv()
            except (EOFError, OSError):
                self.close()
                return None
            self._found[whose] = verdict
        return self._found.get(name)

    def close(self) -> None:
        """End the process, whatever it is at."""
        if self._process is not None:
            end(self._process)
        if self._answers is not None:
            self._answers.close()
        self._process, self._answers, self._found = None, None, {}


def _diagnose(answers: Connection, campaign: Campaign, due: Mapping[ChannelName, Verdict]) -> None:
    """The process: verdicts of one channel after the other; Ctrl-C is for the bench, which ends this too."""
    from shockrig.analysis.planning.judged import diagnosed

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICER)
    try:
        for name, verdict in due.items():
            answers.send((name, diagnosed(campaign, name, verdict)))
    except BrokenPipeError:
        pass  # nobody is there any more who wants to know
