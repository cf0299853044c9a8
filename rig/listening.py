"""The ear at the bench: takes what sensors, reference and stage have to say, when it is due, and hands it on.

One loop over what is due next, in one thread, so that a virtual clock runs an hour in a second.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from shockrig.rig.bench import Bench
from shockrig.rig.bench_errors import ConnectionFault, ConnectionFaults
from shockrig.rig.observer import Observer
from shockrig.rig.recorder import Recorder, is_good
from shockrig.rig.seams import Move, Reading, Reference, Sensor

FIRST_READING_WITHIN_S = 10.0
SHORTEST_WAIT_S = 1e-4  # a part that is always due must not stop a virtual clock


@dataclass
class Listener:
    """What has been heard: good readings and outcomes of each sensor, and the stage's finished move.

    Every reading goes to the `recorder` while there is one, and to the watcher.
    """

    bench: Bench
    watcher: Observer
    recorder: Recorder | None = None
    move: Move | None = None
    good: dict[str, deque[tuple[float, float, float]]] = field(default_factory=dict)  # sensor -> (time, degC, %RH)
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)  # sensor -> what came since the last listening
    heed: Callable[[], None] = lambda: None  # requests from elsewhere; may raise what they want

    def listen(self) -> None:
        """Hear of each sensor once; raises ConnectionFaults that name those that have nothing good to say."""
        self.good = {name: deque() for name in self.bench.describe()}
        self.outcomes = {name: Counter() for name in self.good}
        heard_all = self.poll_until(self.bench.clock.now() + FIRST_READING_WITHIN_S, lambda: all(self.good.values()))
        if not heard_all:
            raise ConnectionFaults(
                [
                    ConnectionFault(
                        self.bench.devices.get(name, name),
                        f"no good reading in {FIRST_READING_WITHIN_S:g} s ({self._heard_of(name)})",
                        "shockrig check says more; run the same command again to go on",
                    )
                    for name, readings in self.good.items()
                    if not readings
                ]
            )

    def _heard_of(self, name: str) -> str:
        """What a sensor answered instead of a good reading, most often first."""
        counts = self.outcomes[name].most_common()
        return ", ".join(f"{count} times {outcome.replace('_', ' ')}" for outcome, count in counts) or "silence"

    def poll_until(self, until_s: float, done: Callable[[], bool] = lambda: False) -> bool:
        """Poll what is due until a time, or until `done` says so; returns whether it did."""
        clock, stage, reference = self.bench.clock, self.bench.stage, self.bench.reference
        sensors = self.bench.sensors
        asked: Sequence[Sensor | Reference] = (*sensors, reference)
        while True:
            if done():
                return True
            now = clock.now()
            if now >= until_s:
                return False
            due_s = min(stage.due_s(), *(part.due_s() for part in asked))
            clock.sleep_until(min(until_s, max(due_s, now + SHORTEST_WAIT_S)))
            self.meanwhile()
            if stage.due_s() <= clock.now() and (move := stage.poll()) is not None:
                self.move = move

    def meanwhile(self) -> None:
        """What goes on while something is waited for: the sensors are heard, and whoever asks for something is."""
        self.poll_sensors()
        self.heed()

    def poll_sensors(self) -> None:
        """Take what the sensors and the reference have by now."""
        now = self.bench.clock.now()
        asked: Sequence[Sensor | Reference] = (*self.bench.sensors, self.bench.reference)
        for part in asked:
            if part.due_s() <= now:
                for reading in part.poll():
                    self._take(reading)

    def note(self, text: str) -> None:
        """What a person at the bench wrote down."""
        if self.recorder is not None:
            self.recorder.note(self.bench.clock.now(), text)
        self.watcher.say(f"note: {text}")

    def _take(self, reading: Reading) -> None:
        if self.recorder is not None:
            self.recorder.reading(reading)
        self.watcher.reading(reading)
        if reading.sensor in self.outcomes:
            self.outcomes[reading.sensor][reading.outcome.value] += 1
        if reading.sensor in self.good and is_good(reading):
            values = reading.values
            temperature_c = values.get("temperature_c", math.nan)
            self.good[reading.sensor].append((reading.time_s, temperature_c, values.get("humidity_percent", math.nan)))
