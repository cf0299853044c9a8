"""What emulated instruments said, and what was true, line by line while they say it.

    time_s,unix_s,instrument,quantity,said,air      e.g. 12.300000,1767225612.3,hyt-271,humidity_percent,43.2156,47.0020
`time_s` is on the instruments' clock (the flight's own time), `unix_s` the host's; `said` is rounded as the instrument
rounds it, `air` is the true air at that instant.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from shockrig.files.disk import demand_place
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air
from shockrig.rig.virtual.chips.hyt271 import FULL_SCALE

COLUMNS = ("time_s", "unix_s", "instrument", "quantity", "said", "air")
# instrument -> quantity -> (smallest step, where its scale begins)
_HUNDREDTH = {"temperature_c": (0.01, 0.0), "die_temperature_c": (0.01, 0.0), "humidity_percent": (0.1, 0.0)}
STEPS = {
    "hyt-271": {"die_temperature_c": (165.0 / FULL_SCALE, -40.0), "humidity_percent": (100.0 / FULL_SCALE, 0.0)},
    "sht31": {"die_temperature_c": (175.0 / 65535, -45.0), "humidity_percent": (100.0 / 65535, 0.0)},
    "sht41": {"die_temperature_c": (175.0 / 65535, -45.0), "humidity_percent": (125.0 / 65535, -6.0)},
    "bme280": {"die_temperature_c": (0.01, 0.0), "humidity_percent": (1 / 1024, 0.0)},
    "node": {"temperature_c": (1e-4, 0.0), "humidity_percent": (1e-4, 0.0)},
    "imet-xf": _HUNDREDTH,
    "imet-xq2": _HUNDREDTH,
    "imet-xq": _HUNDREDTH,
}
READERS = {
    "temperature_c": "bead_temperature_c",
    "die_temperature_c": "die_temperature_c",
    "humidity_percent": "film_humidity_percent",
}


class Witness:
    """Stands between the instruments and their world: one lock for all threads, one line for each value said.

    `worlds` are those of the probes that lie together, the first one's first; what is done to one is done to all.
    `unix_s` is the host's time of day. Where the file can be written no more, `trouble` says why and the instruments
    talk on.
    """

    def __init__(self, worlds: Sequence[Any], unix_s: Callable[[], float], path: Path | None = None) -> None:
        self._worlds = tuple(worlds)
        self._unix_s = unix_s
        self.trouble = ""
        self._lock = threading.Lock()
        self._file = None
        if path is not None:
            try:
                demand_place(path)
                self._file = path.open("w", encoding="utf-8", buffering=1)
            except OSError as error:
                raise BenchError(f"{path}: {error.strerror}; give another --truth") from None
            self._file.write(",".join(COLUMNS) + "\n")

    def sampler(self, kind: str, quantity: str, probe: int = 1, name: str = "") -> Callable[[float], float]:
        """What an instrument of a kind asks a probe for; its values are already on the instrument's own steps.

        `name` is what the instrument is called in the file, where not by its kind.
        """
        step, origin = STEPS[kind][quantity]
        world, instrument = self._worlds[probe - 1], name or kind
        read = getattr(world, READERS[quantity])

        def sample(at_s: float) -> float:
            with self._lock:
                value = origin + round((read(at_s) - origin) / step) * step
                if self._file is not None and not self.trouble:
                    air = world.air(at_s)
                    true = air.humidity_percent if quantity == "humidity_percent" else air.temperature_c
                    row = f"{at_s:.6f},{self._unix_s():.6f},{instrument},{quantity},{value:.4f},{true:.4f}\n"
                    try:
                        self._file.write(row)
                    except OSError as error:
                        self.trouble = f"{self._file.name}: {error.strerror}; the truth is written no further"
                return value

        return sample

    def pressure_hpa(self, at_s: float) -> float:
        with self._lock:
            return float(self._worlds[0].pressure_hpa(at_s))

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float, at_s: float) -> None:
        """A chamber or the fan was given another set point."""
        with self._lock:
            for world in self._worlds:
                world.set_airs(source, destination, airflow_m_s, at_s)

    def begin_transfer(self, at_s: float) -> None:
        """The carriage leaves the source air."""
        with self._lock:
            for world in self._worlds:
                world.begin_transfer(at_s)

    def begin_return(self, at_s: float) -> None:
        """The carriage leaves the destination air."""
        with self._lock:
            for world in self._worlds:
                world.begin_return(at_s)

    def close(self) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # what a full disk did not take was said when it was written
                self._file.close()
