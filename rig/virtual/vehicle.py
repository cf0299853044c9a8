"""An emulated drone on its links: a hygrometer's node on DroneCAN and MAVLink, and an autopilot's stream beside it.

What listens takes them for real: numbers, stamps and signs of life are those of a vehicle. Faults of the link are those
of LINK_KINDS; they act on what is said (units, stamps, one poll old) or on the messages (loss, delay).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from shockrig.rig.links.mavlink import MavlinkEnd, vehicle_messages
from shockrig.rig.links.said import Pair, SaidAir, Speaker
from shockrig.rig.seams import Clock
from shockrig.rig.virtual.faults import LINK_KINDS, Fault, Schedule

STREAM_EVERY_S, BEAT_EVERY_S = 0.2, 1.0
LATE_S = 0.5
LOST_SHARE = 0.5
PLACE_DEG = 47.0, 8.0  # a played flight has an altitude and stands still
KELVIN = 273.15
Units = Callable[[Pair], Pair]


def as_whole_units(pair: Pair) -> Pair:
    """What a reader of hundredths sees where whole units were sent: the slip of MAVLink."""
    return pair[0] / 100.0, pair[1] / 100.0


def as_kelvin(pair: Pair) -> Pair:
    """The slip of DroneCAN, one of whose messages is in degC and the other in kelvin."""
    return pair[0] + KELVIN, pair[1]


class FaultyPort:
    """A port of bytes or frames that loses messages and lets them wait."""

    def __init__(self, port: Any, faults: Iterable[Fault], clock: Clock, seed: int = 0) -> None:
        self._port, self._clock = port, clock
        self._schedule = Schedule(faults, LINK_KINDS, clock, seed)
        self._late: deque[tuple[float, tuple[Any, ...]]] = deque()

    @property
    def dropped(self) -> int:
        return int(self._port.dropped)

    def send(self, *message: Any) -> None:
        active = self._schedule.active()
        self.release()
        if "loss" in active and self._schedule.random.random() < LOST_SHARE:
            return
        if "delay" in active or self._late:  # a link keeps the order
            self._late.append((self._clock.now() + LATE_S * ("delay" in active), message))
        else:
            self._port.send(*message)

    def release(self) -> None:
        """Send what has waited long enough."""
        while self._late and self._late[0][0] <= self._clock.now():
            self._port.send(*self._late.popleft()[1])

    def receive(self) -> Any:
        self.release()
        return self._port.receive()

    def close(self) -> None:
        self._port.close()


class FaultySpeaker:
    """A speaker that says what is wrong."""

    def __init__(self, speaker: Speaker, faults: Iterable[Fault], clock: Clock, slip: Units, seed: int = 0) -> None:
        self._speaker, self._slip = speaker, slip
        self._schedule = Schedule(faults, LINK_KINDS, clock, seed)
        self._before: SaidAir | None = None
        self._stamp_s: float | None = None

    @property
    def dropped(self) -> int:
        return self._speaker.dropped

    def send(self, said: SaidAir) -> None:
        active, told = self._schedule.active(), said
        if "one_old" in active and self._before is not None:
            told = replace(self._before, time_s=said.time_s)
        if "stamps" in active and self._stamp_s is not None:
            told, self._stamp_s = replace(told, time_s=self._stamp_s), None
        else:
            self._stamp_s = said.time_s
        if "units" in active:
            told = replace(told, air=self._slip(told.air), read=None if told.read is None else self._slip(told.read))
        self._before = said
        self._speaker.send(told)

    def tell(self, text: str, now_s: float) -> None:
        self._speaker.tell(text, now_s)

    def beat(self, now_s: float) -> None:
        self._speaker.beat(now_s)

    def close(self) -> None:
        self._speaker.close()


class Vehicle:
    """Says what a world's sensors feel, and where the vehicle is.

    Parameters
    ----------
    temperature_c, humidity_percent : callable
        Of a time on the clock.
    speakers : iterable of Speaker
        On which the hygrometer is heard.
    stream : MavlinkEnd or None
        On which the autopilot is heard.
    world
        With airspeed_m_s(at_s), pressure_hpa(at_s) and altitude_m(at_s), where there is a stream.
    """

    def __init__(
        self,
        temperature_c: Callable[[float], float],
        humidity_percent: Callable[[float], float],
        speakers: Iterable[Speaker],
        period_s: float,
        began_s: float,
        stream: MavlinkEnd | None = None,
        world: Any = None,
    ) -> None:
        self._temperature_c, self._humidity_percent = temperature_c, humidity_percent
        self._speakers, self._stream, self._world = list(speakers), stream, world
        self._every = {"air": period_s, "beat": BEAT_EVERY_S} | ({"stream": STREAM_EVERY_S} if stream else {})
        self._next = dict.fromkeys(self._every, began_s)

    def due_s(self) -> float:
        """When it says something next."""
        return min(self._next.values())

    def play(self, now_s: float) -> None:
        """Say what is due by now."""
        for kind, due_s in self._next.items():
            while due_s <= now_s:
                self._do(kind, due_s)
                due_s += self._every[kind]
            self._next[kind] = due_s

    def _do(self, kind: str, at_s: float) -> None:
        if kind == "air":
            said = SaidAir(at_s, (self._temperature_c(at_s), self._humidity_percent(at_s)))
            for speaker in self._speakers:
                speaker.send(said)
        elif kind == "beat":
            for speaker in self._speakers:
                speaker.beat(at_s)
            if self._stream is not None:
                m = self._stream.messages
                self._stream.put(
                    "heartbeat", m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_GENERIC, 0, 0, m.MAV_STATE_ACTIVE, 3
                )
        elif self._stream is not None:
            world = self._world
            place = (*PLACE_DEG, world.altitude_m(at_s))
            vehicle_messages(self._stream, at_s, world.airspeed_m_s(at_s), world.pressure_hpa(at_s), place)

    def close(self) -> None:
        for speaker in self._speakers:
            speaker.close()
        if self._stream is not None:
            self._stream.close()
