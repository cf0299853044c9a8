"""A diagnosis made by another process while the bench soaks and records the next run.

What it is asked is in the campaign's log (`due`), so a loop that was killed asks again and gets the same answer.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from shockrig.protocols.branch import end, end_with, ready, start

if TYPE_CHECKING:
    from shockrig.analysis.design.goals import Place
    from shockrig.analysis.plan.look import Conclusion
    from shockrig.files.campaign import Campaign

NICER = 5  # than the recording, which must not wait


class Background:
    """One process at a time that diagnoses the places of which the last decision left the diagnosis for later."""

    def __init__(self) -> None:
        self._process: multiprocessing.process.BaseProcess | None = None
        self._answers: Connection | None = None
        self._found: dict[Place, Conclusion] = {}

    def begin(self, campaigns: Sequence[Campaign], due: Mapping[Place, Conclusion]) -> None:
        """Diagnose the places that are due in a checked campaign, as its probes saw it."""
        self.close()
        context = multiprocessing.get_context("spawn")
        self._answers, there = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_diagnose, args=(there, tuple(campaigns), dict(due), os.getpid()), daemon=True
        )
        start(self._process)
        there.close()

    def __call__(self, place: Place) -> Conclusion | None:
        """The verdict on a place, waited for where it is not there yet; None where the process came to nothing."""
        while place not in self._found and self._answers is not None:
            try:
                whose, verdict = self._answers.recv()
            except (EOFError, OSError):
                self.close()
                return None
            self._found[whose] = verdict
        return self._found.get(place)

    def close(self) -> None:
        """End the process, whatever it is at."""
        if self._process is not None:
            end(self._process)
        if self._answers is not None:
            self._answers.close()
        self._process, self._answers, self._found = None, None, {}


def _diagnose(answers: Connection, campaigns: Sequence[Campaign], due: Mapping[Place, Conclusion], parent: int) -> None:
    """The process: verdicts of one place after the other; Ctrl-C is for the bench, which ends this too."""
    from shockrig.analysis.design.goals import places
    from shockrig.analysis.plan.look import look_at

    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ready()
    os.nice(NICER)
    try:
        for place, verdict in due.items():
            answers.send((place, look_at(*places(campaigns)[place], verdict).conclusion))
    except BrokenPipeError:
        pass  # nobody is there any more who wants to know
