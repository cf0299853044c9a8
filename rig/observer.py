"""Who looks on while a campaign is recorded: the contract, and one that does nothing."""

from __future__ import annotations

from typing import Protocol

from shockrig.rig.operator import Prompt
from shockrig.rig.protocol import PlannedRun, Step
from shockrig.rig.recorder import RunRecord
from shockrig.rig.seams import Reading


class Observer(Protocol):
    """Is told what happens while it happens; must not raise. Nothing that is recorded depends on it."""

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None: ...

    def step_began(self, step: Step, now_s: float) -> None: ...

    def reading(self, reading: Reading) -> None: ...

    def say(self, text: str) -> None: ...

    def asked(self, prompt: Prompt | None) -> None:
        """A person is asked to do something; None once nobody is."""
        ...

    def run_ended(self, record: RunRecord, now_s: float) -> None: ...


class SilentObserver:
    """An observer that does nothing; the base of those that care for some events only."""

    def run_began(self, run: PlannedRun, number: int, total: int, now_s: float) -> None:
        pass

    def step_began(self, step: Step, now_s: float) -> None:
        pass

    def reading(self, reading: Reading) -> None:
        pass

    def say(self, text: str) -> None:
        pass

    def asked(self, prompt: Prompt | None) -> None:
        pass

    def run_ended(self, record: RunRecord, now_s: float) -> None:
        pass
