"""The person at the bench: what is asked, the keys that answer, and the time after which nobody is there.

An answer is a line, ended by Enter:
    (nothing)  go on    s  skip this run    r  repeat it    n TEXT  a note    p  pause the campaign    a  abort it
Anything else that is not asked for is said to be no answer, and the question stays: `q` is not yes. While a question
waits, the bench is listened to (`idle`), so that no reading queues up behind it.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from shockrig.rig.bench_errors import CampaignAborted, CampaignPaused, RunRepeated, RunSkipped
from shockrig.rig.seams import Clock

LOOK_S = 0.02
ANSWER_WITHIN_S = 1800.0
LONGEST_LINE = 4096
KEYS = "Enter goes on, s skips this run, r repeats it, n TEXT notes something, p pauses the campaign, a aborts it"
GO_AHEAD = ("", "c", "y", "yes", "continue")
GO_ON = "the same command goes on from here"


@dataclass(frozen=True)
class Prompt:
    """What a person must do now; `deadline_s` is on the bench clock."""

    text: str
    deadline_s: float


Check = Callable[[str], str]  # of an answer: what is wrong with it, empty where nothing is


def go_ahead(answer: str) -> str:
    """The check of a question that only wants a go-ahead."""
    return "" if answer.lower() in GO_AHEAD else f"{answer[:40]!r} is no answer here: {KEYS}"


class ConsoleOperator:
    """A person at a terminal: prompts go to standard error, answers are looked up and never waited for blindly.

    Parameters
    ----------
    clock : Clock
    answers, prompts : text streams, optional
        Standard input and standard error where left out.
    within_s : float
        How long a question waits before the campaign pauses.
    """

    def __init__(
        self,
        clock: Clock,
        answers: TextIO | None = None,
        prompts: TextIO | None = None,
        within_s: float = ANSWER_WITHIN_S,
    ) -> None:
        self.hidden: Callable[[], bool] = lambda: False  # whether a live view shows the prompts in its place
        self._clock = clock
        self._answers = answers or sys.stdin
        self._prompts = prompts or sys.stderr
        self._within_s = within_s
        self._lines: deque[str] = deque()
        self._partial = b""
        self._prompt: Prompt | None = None
        self._confirmed_s: float | None = None
        self._idle: Callable[[], None] = lambda: None
        self._asked: Callable[[Prompt | None], None] = lambda prompt: None
        self._noted: Callable[[str], None] = lambda text: None
        self._said: Callable[[str], None] = lambda text: None

    def attend(
        self,
        idle: Callable[[], None],
        asked: Callable[[Prompt | None], None],
        noted: Callable[[str], None],
        said: Callable[[str], None],
    ) -> None:
        """Who is told, while a campaign is recorded: what to do meanwhile, prompts (None: answered), notes, words."""
        self._idle, self._asked, self._noted, self._said = idle, asked, noted, said

    def say(self, message: str) -> None:
        """One line to the person."""
        if self.hidden():
            self._said(message)
            return
        with contextlib.suppress(OSError):  # the terminal is closed: the next answer that is looked for says so
            self._prompts.write(message + "\n")
            self._prompts.flush()

    def ask(self, message: str, check: Check = go_ahead) -> str:
        """Wait for an answer that `check` has nothing against.

        Raises
        ------
        RunSkipped, RunRepeated, CampaignPaused, CampaignAborted
            What the person wants instead; paused also where nobody answers in time, or the terminal is closed.
        """
        self._open(message, self._within_s)
        try:
            while True:
                while not self._look():
                    self._demand_in_time()
                    self._idle()
                    self._clock.sleep_until(self._clock.now() + LOOK_S)
                answer = self._answer()
                if answer is not None:
                    if not (complaint := check(answer)):
                        return answer
                    self.say(complaint)
        finally:
            self._close()

    def request(self, message: str, within_s: float) -> None:
        """Ask for a go-ahead and return at once; `confirmed_s` looks it up."""
        self._look()
        self._lines.clear()  # an Enter from before the question is no answer to it
        self._confirmed_s = None
        self._open(message, within_s)

    def confirmed_s(self) -> float | None:
        """When the last request was confirmed, on the bench clock; None until then. Raises as `ask` does."""
        if self._prompt is not None:
            now = self._clock.now()
            while self._look():
                answer = self._answer()
                if answer is not None and not (complaint := go_ahead(answer)):
                    self._confirmed_s = now
                    self._close()
                    break
                if answer is not None:
                    self.say(complaint)
            else:
                self._demand_in_time()
        return self._confirmed_s

    def leave(self) -> None:
        """Take back a request that nobody needs to answer any more."""
        self._close()

    def _open(self, message: str, within_s: float) -> None:
        self._prompt = Prompt(message, self._clock.now() + within_s)
        if not self.hidden():
            self.say("\a" + message)
        self._asked(self._prompt)

    def _close(self) -> None:
        if self._prompt is not None:
            self._prompt = None
            self._asked(None)

    def _demand_in_time(self) -> None:
        prompt = self._prompt
        if prompt is not None and self._clock.now() >= prompt.deadline_s:
            self._close()
            raise CampaignPaused(f"nobody answered in time ({prompt.text!r}); {GO_ON}")

    def _answer(self) -> str | None:
        """The next line; None where it was a note. Raises what the person wants instead of an answer."""
        line = self._lines.popleft().strip()
        key, _, rest = line.partition(" ")
        match key.lower():
            case "n" | "note":
                self._noted(rest.strip() or "(an empty note)")
                return None
            case "s" | "skip":
                raise RunSkipped("skipped by the operator")
            case "r" | "repeat":
                raise RunRepeated("the operator asked to repeat it")
            case "p" | "pause":
                raise CampaignPaused(f"paused by the operator; {GO_ON}")
            case "a" | "abort":
                raise CampaignAborted("aborted by the operator")
        return line

    def _look(self) -> bool:
        """Whether a line has been typed. What the terminal gives is read past its own buffer, which hides lines."""
        while select.select([self._answers], [], [], 0)[0]:
            try:
                typed = os.read(self._answers.fileno(), LONGEST_LINE)
            except OSError:
                typed = b""
            if not typed:
                if self._lines:
                    break
                self._close()
                raise CampaignPaused(f"the operator's terminal was closed (hang-up); {GO_ON}, in a terminal")
            *lines, rest = (self._partial + typed).split(b"\n")
            self._partial = rest[-LONGEST_LINE:]
            self._lines += [line.decode("utf-8", "replace") for line in lines]
        return bool(self._lines)
