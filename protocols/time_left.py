"""How much longer a command takes, said with its progress: time spent so far over the share of the work that is done.

A share is either counted (runs, rows) or, where nobody can know beforehand how long a search goes on, what the phases
of a command usually take of it; such an estimate is a guess, and "about" says so. Nothing is said of what is soon over.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import TextIO

LONG_S = 5.0  # from which a command's time is worth a word
ROUND_S = 5.0
# Shares of the whole that are done when a phase begins, as measured on the standard campaign with two processors.
CHARACTERIZING = {"noise from the plateaus": 0.1, "differential evolution": 0.2, "least squares": 0.35, "plots": 0.5}
DIAGNOSING = {"searching": 0.15, "measuring the gain": 0.5, "held-out": 0.75, "extended profile": 0.9}
PLANNING = {"looking at what is left": 0.3, "diagnosing all runs": 0.4}
LEARNING = {  # on one flight of both sensors; of many flights the finalists take longer
    "temperature: one lag": 0.2, "humidity: one lag": 0.35, "position's clock": 0.6, "finalists": 0.7,
    "what the structure": 0.8,
}  # fmt: skip
LEARNING_BESIDE = {  # on two flights of two sensors
    "first sensor, humidity: one lag": 0.07, "second sensor, temperature: one lag": 0.2,
    "second sensor, humidity: one lag": 0.27, "temperature: both": 0.4, "humidity: both": 0.55,
}  # fmt: skip
LOOKING_AT_LOG = {"looking for steps": 0.3, "picture": 0.65}
PLAYING = {"against the air": 0.75, "page": 0.87}
CERTIFYING = {"noise from the plateaus": 0.1, "differential evolution": 0.3, "least squares": 0.5, "certificate": 0.8}


def in_words(seconds: float) -> str:
    """A time that is left, as coarse as it is known: "about 25 s left", "about 4 min left"."""
    if seconds < 90.0:
        return f"about {max(ROUND_S * round(seconds / ROUND_S), ROUND_S):.0f} s left"
    if seconds < 5400.0:
        return f"about {seconds / 60.0:.0f} min left"
    return f"about {seconds / 3600.0:.1f} h left"


class TimeLeft:
    """A clock that is started with the work; `after(share)` is what to add to a line of progress.

    Parameters
    ----------
    now : function
        Seconds on a clock that never steps back.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now, self._began_s = now, now()

    def left_s(self, share: float) -> float | None:
        """Seconds that are left where a share of the work is done; None where too little is, or it is soon over."""
        if not 0.0 < share < 1.0:
            return None
        spent_s = self._now() - self._began_s
        return spent_s * (1.0 - share) / share if spent_s / share > LONG_S else None

    def after(self, share: float) -> str:
        """ " (about 25 s left)", or nothing."""
        left_s = self.left_s(share)
        return "" if left_s is None else f" ({in_words(left_s)})"


class Phases:
    """Prints sentences of progress, each with the time that is left by what the phases usually take.

    Parameters
    ----------
    shares : mapping
        Words that begin a phase -> share of the whole that is done by then.
    only_long : bool
        Leave out sentences without a time: of work that is nearly always soon over.
    whose : str
        Said before each sentence, of work that goes on beside other work.
    """

    def __init__(
        self,
        shares: Mapping[str, float],
        stream: TextIO | None = None,
        clock: TimeLeft | None = None,
        only_long: bool = False,
        whose: str = "",
    ) -> None:
        self._shares, self._stream, self._clock = shares, stream, clock or TimeLeft()
        self._only_long, self._whose = only_long, f"{whose}: " if whose else ""
        self._done = 0.0

    def __call__(self, text: str) -> None:
        """Print a sentence."""
        share = max((share for words, share in self._shares.items() if words in text), default=0.0)
        # Of two channels the one that is behind is what is waited for, and no estimate is of both: the last one stands.
        left = self._clock.after(share) if share > self._done else ""
        self._done = max(self._done, share)
        if left or not self._only_long:
            print(f"{self._whose}{text}{left}", file=self._stream or sys.stderr, flush=True)


class CountedRows:
    """Progress over rows of a file whose number is estimated from its size; a line every few seconds."""

    def __init__(self, total: int, clock: TimeLeft | None = None, now: Callable[[], float] = time.monotonic) -> None:
        self._total, self._now = max(total, 1), now
        self._clock = clock or TimeLeft(now)
        self._said_s = now()

    def __call__(self, rows: int) -> None:
        """Say how many rows are done, if some seconds have passed since the last line."""
        if self._now() - self._said_s < LONG_S:
            return
        self._said_s = self._now()
        left = self._clock.after(rows / self._total)
        print(f"{rows} of about {max(self._total, rows)} rows corrected{left}", file=sys.stderr, flush=True)
