"""Probes that have rested in the source air for as long as it takes before anybody asks them."""

from __future__ import annotations

import numpy as np

from shockrig.rig.clock import VirtualClock
from shockrig.rig.seams import Air
from shockrig.rig.virtual.truth import draw_truth, of_probe
from shockrig.rig.virtual.world import World

RESTED_S = 3600.0


class RestingBench:
    """A virtual world between two chambers, asked on a clock that begins when the probes have settled in the source.

    `probe` is the number of one of several that lie there together.
    """

    def __init__(
        self, source: Air, destination: Air, airflow_m_s: float, pressure_hpa: float, seed: int, probe: int = 1
    ) -> None:
        self._clock = VirtualClock()
        truth = draw_truth(np.random.default_rng(seed))
        self._world = World(of_probe(truth, str(probe)), self._clock, seed + probe - 1)
        self._world.set_airs(source, destination, airflow_m_s, pressure_hpa)
        self._pressure_hpa = pressure_hpa
        self._world.air(RESTED_S)

    def bead_temperature_c(self, at_s: float) -> float:
        return self._world.bead_temperature_c(RESTED_S + at_s)

    def film_humidity_percent(self, at_s: float) -> float:
        return self._world.film_humidity_percent(RESTED_S + at_s)

    def die_temperature_c(self, at_s: float) -> float:
        return self._world.die_temperature_c(RESTED_S + at_s)

    def air(self, at_s: float) -> Air:
        return self._world.air(RESTED_S + at_s)

    def pressure_hpa(self, at_s: float) -> float:
        return self._pressure_hpa

    def set_airs(self, source: Air, destination: Air, airflow_m_s: float, at_s: float) -> None:
        """The chambers' airs from `at_s` on."""
        self._clock.sleep_until(RESTED_S + at_s)
        self._world.set_airs(source, destination, airflow_m_s, self._pressure_hpa)

    def begin_transfer(self, at_s: float, duration_s: float | None = None) -> None:
        self._world.begin_transfer(RESTED_S + at_s, duration_s)

    def begin_return(self, at_s: float) -> None:
        self._world.begin_return(RESTED_S + at_s)
