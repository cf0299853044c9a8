"""What the live page of a flight shows: the air now and as a profile over altitude, as corrected and as read.

The flight's thread puts rows in, the page's threads look: what is looked at is made anew each time.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.protocols.watch.web import WatchServer
from shockrig.rig.links.said import SaidAir

POINT_EVERY_S = 1.0
MOST_POINTS = 1200  # then every other one goes: a flight of hours is shown by as many
MOST_MESSAGES = 20

Number = float | None


@dataclass(frozen=True)
class FlightPoint:
    """The air at one time and altitude; None where there is no value."""

    time_s: float
    altitude_m: Number
    temperature_c: Number
    temperature_uncertainty_k: Number
    humidity_percent: Number
    humidity_uncertainty_percent: Number
    temperature_read_c: Number
    humidity_read_percent: Number


@dataclass(frozen=True)
class FlightView:
    """What the page is drawn from; `over` says what the altitude is."""

    state: str
    over: str
    rows: int
    now: FlightPoint | None
    profile: list[FlightPoint]
    messages: list[str]

    def summary(self) -> str:
        return f"{self.rows} rows"


def _known(value: float) -> Number:
    return value if math.isfinite(value) else None


class FlightFollower:
    """Keeps what the page needs of a flight."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._points: list[FlightPoint] = []
        self._every_s, self._next_s = POINT_EVERY_S, -math.inf
        self._now: FlightPoint | None = None
        self._rows = 0
        self._over = "altitude"
        self._messages: deque[str] = deque(maxlen=MOST_MESSAGES)

    def take(self, said: SaidAir, around: Mapping[str, float]) -> None:
        """A row, and what was known of where it was."""
        altitude, over = around["altitude_m"], "altitude"
        if not math.isfinite(altitude) and around["pressure_hpa"] > 0.0:
            altitude, over = float(pressure_altitude_m(around["pressure_hpa"])), "pressure altitude"
        (t, h), (ut, uh), (rt, rh) = said.air, said.uncertainty or (math.nan,) * 2, said.read or (math.nan,) * 2
        point = FlightPoint(said.time_s, *map(_known, (altitude, t, ut, h, uh, rt, rh)))
        with self._lock:
            self._now, self._over = point, over
            self._rows += 1
            if said.time_s >= self._next_s:
                self._next_s = said.time_s + self._every_s
                self._points.append(point)
                if len(self._points) > MOST_POINTS:
                    self._points, self._every_s = self._points[::2], 2.0 * self._every_s

    def say(self, now_s: float, text: str) -> None:
        with self._lock:
            self._messages.appendleft(f"{now_s:.1f} s: {text}")

    def look(self) -> FlightView:
        with self._lock:
            state = "flying" if self._rows else "waiting"
            return FlightView(state, self._over, self._rows, self._now, list(self._points), list(self._messages))


def serve_beside(follower: FlightFollower, host: str, port: int) -> WatchServer:
    """Serve the page from a thread of its own; close it by `shutdown`. Raises OSError where the port cannot be had."""
    server = WatchServer(follower, host, port, page="flight")
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.5}, daemon=True).start()
    return server
