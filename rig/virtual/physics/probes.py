"""The two probes as bodies in the air: bead (sphere), film, die and the slow companions, built for the grid.

Bead: T_t = alpha (T_rr + 2 T_r / r), surface at the air's temperature or behind an air film, -k T_r = h (T - T_air).
Film: c_t = (D c_x)_x, sealed at x = 0, at x = L at the air's vapour or behind a boundary layer. Die, stem, slow share:
first-order lags.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic

import numpy as np

from shockrig.rig.virtual.physics import chains
from shockrig.rig.virtual.physics.exposure import Exposure, N, air_after, shortest_change_s
from shockrig.rig.virtual.physics.moist import concentration_ppmv, dew_point_c, heat_carried_off, warm_air
from shockrig.rig.virtual.truth import Truth

SPHERE_EDGES = chains.sphere_edges()
CORE_WEIGHTS = chains.core_weights(SPHERE_EDGES)
FILM_EDGES = chains.film_edges()
FILM_WIDTHS = np.diff(FILM_EDGES)
SORPTION_HEAT_S = 0.5  # the heat of sorption spreads into the die this fast


@dataclass(frozen=True)
class Bodies(Generic[N]):
    """What the probes have come to, each (r,) or (n, r), or a number.

    Core, stem and die in degC; in ppmv the film's mean, its slow share, and its mean behind the lag with which sorption
    heat spreads.
    """

    core_c: N
    film_ppmv: N
    die_c: N
    stem_c: N
    slow_ppmv: N
    warming_ppmv: N


class Probes:
    """Both probes of r runs through one exposure, stepped in time since it began.

    Parameters
    ----------
    truth, exposure
        What is true and what happens.
    rate_factors : (2, r) array, optional
        Run-to-run scatter of alpha and D.
    state : list of arrays, optional
        State of an earlier Probes to go on from; left out, everything has settled in the source air.
    """

    def __init__(
        self,
        truth: Truth,
        exposure: Exposure[np.ndarray],
        rate_factors: np.ndarray | None = None,
        state: list[np.ndarray] | None = None,
    ):
        runs = exposure.source_c.size
        factors = np.ones((2, runs)) if rate_factors is None else rate_factors
        self._truth, self.exposure = truth, exposure
        stem = truth.effect("stem_conduction") or {"time_constant_s": 1.0}
        slow = truth.effect("slow_relaxation") or {"time_constant_s": 1.0}
        film_rate, self._film_biot = self._film_rate(factors[1]), self._vapour_biot()
        film = chains.film(film_rate, self._film_biot, FILM_EDGES)
        self.film_widths = FILM_WIDTHS
        if cap := truth.effect("series_lag"):
            film = chains.capped(film, cap["time_constant_s"])
            self.film_widths = np.append(FILM_WIDTHS, 0.0)  # what is in the cap is not in the film
        self.blocks = [
            chains.sphere(self._bead_rate(factors[0]), self._bead_biot(), SPHERE_EDGES),
            film,
            chains.lag(truth.die_time_constant_s, runs),
            chains.lag(stem["time_constant_s"], runs),
            chains.lag(slow["time_constant_s"], runs),
            chains.lag(SORPTION_HEAT_S, runs),
        ]
        if state is None:
            c, ppmv = exposure.source_c, exposure.source_ppmv
            levels = (c, ppmv, c, c, ppmv, ppmv)
            state = [
                np.repeat(level[:, None], block.capacity.shape[1], axis=1)
                for level, block in zip(levels, self.blocks, strict=True)
            ]
        self._base_rate = film_rate
        self._saturated_ppmv = concentration_ppmv(100.0, exposure.destination_c, exposure.pressure_hpa)
        self.start = state
        self.wet_until_s = self._wetness(state[2][:, 0])
        steady = np.isinf(shortest_change_s(truth, exposure, 0.0))
        self._still_from_s = float(np.max(exposure.duration_s)) if steady else np.inf
        self._still_air: tuple[np.ndarray, np.ndarray] | None = None

    @cached_property
    def stepper(self) -> chains.Stepper:
        """What steps the probes on from their start."""
        moves = self._truth.effect("concentration_dependent_diffusivity")
        refresh = (lambda ahead: [None, self.film_links(ahead[1]), None, None, None, None]) if moves else None
        return chains.Stepper(self.blocks, self._drive, self.start, 0.0, refresh)

    def _bead_rate(self, factor: np.ndarray) -> np.ndarray:
        rate = self._truth.thermal_diffusivity_m2_s / self._truth.bead_radius_m**2 * factor
        if p := self._truth.effect("unknown_rate_with_temperature"):
            rate = rate * np.exp(p["per_kelvin"] * (self.exposure.destination_c - 20.0))
        return rate

    def _bead_biot(self) -> np.ndarray:
        p = self._truth.effect("convective_film")
        if p is None or p["biot_at_5_m_s"] == 0.0:  # a film of no strength is no film
            return np.full(self.exposure.source_c.shape, np.inf)
        e, radius = self.exposure, self._truth.bead_radius_m
        biot = p["biot_at_5_m_s"] * heat_carried_off(e.airflow_m_s, radius, e.pressure_hpa)
        if self._truth.effect("exchange_temperature") is not None:
            biot = biot * warm_air(e.destination_c, e.airflow_m_s, radius, e.pressure_hpa)
        return biot

    def _film_rate(self, factor: np.ndarray) -> np.ndarray:
        e = self.exposure
        rate = self._truth.diffusivity_m2_s(e.destination_c) / self._truth.film_thickness_m**2 * factor
        if p := self._truth.effect("direction_dependent_diffusivity"):
            rate = np.where(e.destination_ppmv < e.source_ppmv, p["ratio_drying_to_wetting"] * rate, rate)
        return rate

    def _vapour_biot(self) -> np.ndarray:
        p = self._truth.effect("vapour_boundary_layer")
        if p is None or p["biot_at_5_m_s"] == 0.0:
            return np.full(self.exposure.source_c.shape, np.inf)
        # a laminar layer is thicker in thin air, as the square root, and vapour crosses it faster, in proportion
        return p["biot_at_5_m_s"] * np.sqrt(self.exposure.airflow_m_s / 5.0 * 1013.25 / self.exposure.pressure_hpa)

    def film_links(self, film: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Links and open end of a film whose D follows the water in its cells, `film` (r, n)."""
        moves = self._truth.effect("concentration_dependent_diffusivity") or {"slope_per_unit_activity": 0.0}
        slope = moves["slope_per_unit_activity"]
        cap = self._truth.effect("series_lag")
        if cap is not None:
            film = film[:, :-1]
        faces = np.empty_like(film)
        faces[:, :-1] = 0.5 * (film[:, 1:] + film[:, :-1])
        faces[:, -1] = film[:, -1]
        activity = faces / self._saturated_ppmv[:, None]
        rate = self._base_rate[:, None] * np.maximum(1.0 + slope * (activity - 0.5), 0.05)
        link, open_end = chains.film_links(rate, self._film_biot, FILM_EDGES)
        if cap is not None:
            return np.concatenate([link, open_end[:, None]], axis=1), self.blocks[1].open_end
        return link, open_end

    def _wetness(self, die_c: np.ndarray) -> np.ndarray | None:
        """Time since the start until which the film is held wet, (r,), or None: dew forms where the die is colder than
        the destination's dew point.
        """
        p = self._truth.effect("condensation")
        e = self.exposure
        if p is None or not e.shock:
            return None
        dew_point = dew_point_c(e.destination_ppmv, e.pressure_hpa)
        cold = np.maximum(e.destination_c - die_c, 1e-9)
        # the die closes in on the destination air exponentially: time at which it passes the dew point
        warm_s = self._truth.die_time_constant_s * np.log(cold / np.maximum(e.destination_c - dew_point, 1e-6))
        return np.where(die_c < dew_point, np.maximum(warm_s, 0.0) + p["drying_time_s"], -1.0)

    def _air(self, time_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Temperature and vapour of the air; after the transfer, where nothing else moves it, as it was."""
        if self._still_air is not None:
            return self._still_air
        air = air_after(self._truth, self.exposure, time_s)
        if time_s >= self._still_from_s:
            self._still_air = air
        return air

    def _at_face(self, air_c: Any, vapour: Any, began_s: Any, time_s: Any) -> Any:
        """What the film's face sees: the air's vapour, or water where dew lies on it."""
        if self.wet_until_s is None:
            return vapour
        # a step in which the film dries sees the mean: dry spells begin between steps
        wet = np.clip((self.wet_until_s - began_s) / np.maximum(time_s - began_s, 1e-12), 0.0, 1.0)
        return vapour + wet * (concentration_ppmv(100.0, air_c, self.exposure.pressure_hpa) - vapour)

    def _drive(self, time_s: float) -> list[np.ndarray]:
        air_c, vapour = self._air(time_s)
        film = self._at_face(air_c, vapour, self.stepper.time_s, time_s)
        # the film's own mean is that of the last step: sorption heat acts back on nothing
        taken_up = self.stepper.state[1] @ self.film_widths
        return [air_c, film, air_c, air_c, vapour, taken_up]

    def bodies(self) -> Bodies[np.ndarray]:
        """What the probes have come to now, arrays (r,)."""
        bead, film, *lags = self.stepper.state
        return Bodies(bead[:, :3] @ CORE_WEIGHTS, film @ self.film_widths, *(lag[:, 0].copy() for lag in lags))

    def advance(self, times_s: np.ndarray) -> Bodies[np.ndarray]:
        """Go through the stepper's `even_times_s`: what the probes have come to after each of them, arrays (n, r)."""
        stepper, one = self.stepper, np.ones(1)
        ends = times_s[:, None]
        began = np.concatenate([[[stepper.time_s]], ends[:-1]])
        air_c, vapour = air_after(self._truth, self.exposure, ends)
        before = stepper.state[1] @ self.film_widths
        film = stepper.advance(1, self._at_face(air_c, vapour, began, ends), self.film_widths)
        taken_up = np.concatenate([[before], film[:-1]])
        bead = stepper.advance(0, air_c, CORE_WEIGHTS)
        lags = zip((2, 3, 4, 5), (air_c, air_c, vapour, taken_up), strict=True)
        found = Bodies(bead, film, *(stepper.advance(i, of, one) for i, of in lags))
        stepper.arrived(float(times_s[-1]))
        return found
