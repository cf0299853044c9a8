"""Clocks: seconds that never step back. The host's wall clock may jump; recordings must not."""

from __future__ import annotations

import time


class RealClock:
    """The host's monotonic clock, counted from the clock's making so that recordings start near zero."""

    def __init__(self) -> None:
        self._zero_s = time.monotonic()

    def now(self) -> float:
        return time.monotonic() - self._zero_s

    def sleep_until(self, time_s: float) -> None:
        wait_s = time_s - self.now()
        if wait_s > 0:
            time.sleep(wait_s)


class VirtualClock:
    """A clock that stands still until somebody sleeps, so that an hour of protocol runs in a second."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        return self._now_s

    def sleep_until(self, time_s: float) -> None:
        self._now_s = max(self._now_s, time_s)
