"""The physical world behind the emulated chips: probes carried between two chambers, looked at whenever somebody asks.

Times are on the bench clock. Each change of air begins an exposure, whose course (physics/course.py) says what the
probes are at any time of it; a short past is kept, so that units which report late can be answered, and moves that are
told late can still be made.
"""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air, Clock, known
from shockrig.rig.virtual.effects import RH, T
from shockrig.rig.virtual.logger_link import Logger, seen_at_s
from shockrig.rig.virtual.physics.converters import humidity_reading, temperature_reading
from shockrig.rig.virtual.physics.course import ModalCourse, follow
from shockrig.rig.virtual.physics.exposure import Exposure
from shockrig.rig.virtual.physics.moist import concentration_ppmv, humidity_percent
from shockrig.rig.virtual.truth import Truth

ROOM = Air(20.0, 50.0)  # where the probes lie until chambers are first asked for an air
PAST_KEPT_S = 20.0
RECORDED_BEFORE_S = 10.5  # how long before a transfer a recording begins; there a fast clock agrees with the bench's


@dataclasses.dataclass(frozen=True)
class _Stay:
    """One exposure and the probes' course through it."""

    began_s: float
    exposure: Exposure[float]
    course: ModalCourse


class _Chamber:
    """A chamber's air, closing in on its set point exponentially (at once where `settling_s` is 0)."""

    def __init__(self, air: tuple[float, float], settling_s: float):
        self._settling_s = settling_s
        self._from = self._to = air
        self._since_s = -np.inf

    def ask(self, air: tuple[float, float], at_s: float) -> None:
        self._from, self._to, self._since_s = self.air(at_s), air, at_s

    def set_point(self) -> tuple[float, float]:
        return self._to

    def air(self, at_s: float) -> tuple[float, float]:
        left = np.exp(-(at_s - self._since_s) / self._settling_s) if self._settling_s > 0.0 else 0.0
        (old_c, old_ppmv), (to_c, to_ppmv) = self._from, self._to
        return to_c + left * (old_c - to_c), to_ppmv + left * (old_ppmv - to_ppmv)


class World:
    """One pair of probes between a source and a destination chamber.

    Parameters
    ----------
    truth : Truth
    clock : Clock
        Read where a call does not say when (`set_airs`).
    seed : int
    settling_s : float
        Time constant of the chambers; 0: they are at their set point at once.
    carriage_seed : int, optional
        `seed` of the first probe in the carriage: what it moves, it moves at the same time.
    """

    def __init__(
        self, truth: Truth, clock: Clock, seed: int, settling_s: float = 0.0, carriage_seed: int | None = None
    ):
        self.truth = truth
        self._clock = clock
        self._settling_s = settling_s
        scatter, jitter, bead, film, die = np.random.default_rng(seed).spawn(5)
        if carriage_seed is not None:
            jitter = np.random.default_rng(carriage_seed).spawn(5)[1]
        self._scatter, self._jitter, self._die_rng = scatter, jitter, die
        self._loggers = {T: Logger(truth, T, bead), RH: Logger(truth, RH, film)}
        self._pressure_hpa, self._airflow_m_s, self._irradiance_w_m2 = 1013.25, 5.0, 0.0
        self._chambers = {name: _Chamber(self._mixed(ROOM), settling_s) for name in ("source", "destination")}
        self._place = "source"
        self._shocks = 0
        self._pending: list[tuple[float, int, Callable[[float], None]]] = []
        self._asked = 0
        self._seen_s = clock.now()  # the latest time that anybody has looked at
        self._clocks_agreed_s = np.inf
        still = self._exposure(self._mixed(ROOM), self._chambers["source"], self._seen_s, shock=False)
        self._stays = [_Stay(self._seen_s, still, follow(truth, still))]

    def _mixed(self, air: Air) -> tuple[float, float]:
        temperature_c, percent = known(air.temperature_c), known(air.humidity_percent)
        return temperature_c, float(concentration_ppmv(percent, temperature_c, self._pressure_hpa))

    # what the bench does ---------------------------------------------------------------------------------------------

    def set_airs(
        self, source: Air, destination: Air, airflow_m_s: float, pressure_hpa: float, irradiance_w_m2: float = 0.0
    ) -> None:
        """Ask the chambers for new airs, now; the probes feel that of the chamber that they are in."""
        if None in (
            source.temperature_c,
            source.humidity_percent,
            destination.temperature_c,
            destination.humidity_percent,
        ):
            raise BenchError("the virtual chambers need the temperature and the humidity of both airs")

        def change(at_s: float) -> None:
            here = self._air(at_s)
            self._airflow_m_s, self._pressure_hpa, self._irradiance_w_m2 = airflow_m_s, pressure_hpa, irradiance_w_m2
            self._chambers["source"].ask(self._mixed(source), at_s)
            self._chambers["destination"].ask(self._mixed(destination), at_s)
            self._expose(self._exposure(here, self._chambers[self._place], at_s, shock=False), at_s)
            self._clocks_agreed_s = np.inf

        self._plan(self._clock.now(), change)

    def begin_transfer(self, at_s: float, duration_s: float | None = None) -> None:
        """The probes leave the source at `at_s`; `duration_s` where the stage goes slower than the truth's own
        transfer.
        """
        jitter_s = self.truth.trigger_jitter_s * self._jitter.standard_normal()
        self._plan(at_s + jitter_s, lambda at: self._carry("destination", at, duration_s))

    def begin_return(self, at_s: float, duration_s: float | None = None) -> None:
        """The probes leave the destination at `at_s`."""
        self._plan(at_s, lambda at: self._carry("source", at, duration_s))

    def _plan(self, at_s: float, change: Callable[[float], None]) -> None:
        if at_s < self._stays[-1].began_s or at_s < self._seen_s - PAST_KEPT_S:
            raise BenchError(
                f"the probes cannot be moved at {at_s:.3f} s: the world has gone on to {self._seen_s:.3f} s"
            )
        self._asked += 1
        bisect.insort(self._pending, (at_s, self._asked, change))

    def _carry(self, place: str, at_s: float, duration_s: float | None) -> None:
        here, self._place = self._air(at_s), place
        shock = place == "destination"
        exposure = self._exposure(here, self._chambers[place], at_s, shock, duration_s)
        factors = np.exp(self.truth.rate_scatter * self._scatter.standard_normal((2, 1))) if shock else None
        if shock:
            self._shocks += 1
            self._clocks_agreed_s = at_s - RECORDED_BEFORE_S
        self._expose(exposure, at_s, factors)

    def _exposure(
        self, here: tuple[float, float], chamber: _Chamber, at_s: float, shock: bool, duration_s: float | None = 0.0
    ) -> Exposure[float]:
        if duration_s is None:
            duration_s = (self.truth.effect("finite_transfer") or {"duration_s": 0.0})["duration_s"]
        set_point, air = chamber.set_point(), chamber.air(at_s)
        values: dict[str, float] = {
            "source_c": here[0],
            "source_ppmv": here[1],
            "destination_c": set_point[0],
            "destination_ppmv": set_point[1],
            "airflow_m_s": self._airflow_m_s,
            "pressure_hpa": self._pressure_hpa,
            "duration_s": duration_s,
            "irradiance_w_m2": self._irradiance_w_m2,
            "order": float(max(self._shocks - (not shock), 0)),
            "unsettled_k": air[0] - set_point[0],
            "unsettled_ppmv": air[1] - set_point[1],
        }
        numbers: dict[str, Any] = {k: float(v) for k, v in values.items()}
        return Exposure(**numbers, settling_s=self._settling_s or 1.0, shock=shock)

    def _expose(self, exposure: Exposure[float], at_s: float, factors: np.ndarray | None = None) -> None:
        last = self._stays[-1]
        course = follow(self.truth, exposure, factors, last.course.state(at_s - last.began_s))
        self._stays.append(_Stay(at_s, exposure, course))

    # time ------------------------------------------------------------------------------------------------------------

    def _look(self, at_s: float) -> None:
        """Make every change that has come by `at_s`, and forget what is long past."""
        while self._pending and self._pending[0][0] <= at_s:
            change_s, _, change = self._pending.pop(0)
            change(max(change_s, self._stays[-1].began_s))
        if at_s > self._seen_s:
            self._seen_s = at_s
            oldest_s = at_s - 2.0 * PAST_KEPT_S
            while len(self._stays) > 1 and self._stays[1].began_s < oldest_s:
                del self._stays[0]
            self._stays[0].course.forget(oldest_s - self._stays[0].began_s)

    def _stay(self, at_s: float) -> tuple[_Stay, float]:
        """The exposure at a time that has been looked at, and the time since it began."""
        index = max(bisect.bisect_right(self._stays, at_s, key=lambda stay: stay.began_s) - 1, 0)
        return self._stays[index], max(at_s - self._stays[index].began_s, 0.0)

    def _seen(self, channel: str, at_s: float) -> tuple[_Stay, float]:
        """The exposure that a reading stamped `at_s` shows, and the time since it began."""
        self._look(at_s)
        return self._stay(seen_at_s(self.truth, channel, at_s, min(self._clocks_agreed_s, at_s)))

    def _air(self, at_s: float) -> tuple[float, float]:
        """Air at the probes, degC and ppmv, at a time that has been looked at."""
        stay, since_s = self._stay(at_s)
        return stay.course.air(since_s)

    # what the chips see ----------------------------------------------------------------------------------------------

    def air(self, at_s: float) -> Air:
        """The true air at the probes."""
        self._look(at_s)
        temperature, vapour = self._air(at_s)
        return Air(temperature, float(humidity_percent(vapour, temperature, self._pressure_hpa)))

    def bead_temperature_c(self, at_s: float) -> float:
        """The bead's reading, degC, with its noise; times must not go back from call to call."""
        stay, since_s = self._seen(T, at_s)
        exact = temperature_reading(self.truth, stay.exposure, stay.course.bodies(since_s), since_s)
        return self._log(T, at_s, float(exact))

    def film_humidity_percent(self, at_s: float) -> float:
        """The film's reading, %RH, with its noise; times must not go back from call to call."""
        stay, since_s = self._seen(RH, at_s)
        bodies, (air_c, _) = stay.course.bodies(since_s), stay.course.air(since_s)
        exact = humidity_reading(self.truth, stay.exposure, bodies, air_c, since_s)
        return self._log(RH, at_s, float(exact))

    def die_temperature_c(self, at_s: float) -> float:
        """The die's reading, degC, with its noise."""
        stay, since_s = self._seen(RH, at_s)
        return stay.course.bodies(since_s).die_c + self.truth.die_noise_k * self._die_rng.standard_normal()

    def _log(self, channel: str, at_s: float, exact: float) -> float:
        return float(self._loggers[channel].log(np.array([at_s]), np.array([exact]))[0])
