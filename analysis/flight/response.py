"""The sensor as a correction sees it: a sum of first-order lags behind the air, weights and rates changing along a
flight.

reading = sum_k w_k q_k, dq_k/dt = rate_k (air - q_k), sum_k w_k = 1: the closed forms of analysis.modes with w_k =
-a_k. Effects of the readout (offset, gain, warming, delay) are undone before; what cannot be undone is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.sensor import BENCH_EFFECTS, REFERENCE_AIRSPEED_M_S
from shockrig.analysis.physics.chain import ventilation
from shockrig.analysis.physics.modes import (
    Modes,
    film_mean,
    film_mean_biot,
    first_order,
    mix,
    sphere_core,
    sphere_core_biot,
)
from shockrig.files.profile import Effect, HumidityProfile, TemperatureProfile

Array = NDArray[np.float64]
BEAD_MODES = 4
FILM_MODES = 6
BIOT_STEP = 0.01  # airspeed is followed in steps of 1 % of the Biot number

UNDONE = {
    "temperature": frozenset(
        "convective_film stem_conduction self_heating calibration_error dead_time moving_average quantization".split()
    ),
    "humidity": frozenset(
        "vapour_boundary_layer slow_relaxation die_thermal_lag calibration_error dead_time moving_average "
        "saturation_clipping stale_samples quantization".split()
    ),
}


@dataclass(frozen=True)
class Response:
    """Lags at n instants: `weight`, `rate` (n, K) [1, 1/s]; `relative_uncertainty` (n,) of the time scale, one
    sigma."""

    weight: Array
    rate: Array
    relative_uncertainty: Array
    slow_uncertainty: float = 0.0  # of the share of the reading that a last, slow lag carries, one sigma

    def at(self, rows: NDArray[np.int64] | slice) -> Response:
        return Response(self.weight[rows], self.rate[rows], self.relative_uncertainty[rows], self.slow_uncertainty)

    @property
    def slowest_s(self) -> float:
        """Time constant of the slowest lag that carries at least 20 % of the reading, at its slowest."""
        return float(np.max(np.where(self.weight > 0.2, 1.0 / self.rate, 0.0)))

    def clean(self, frequency_hz: Array, row: int = 0) -> NDArray[np.complex128]:
        """Transfer function from the air to the reading at one instant, continuous in time."""
        s = 2j * np.pi * np.asarray(frequency_hz)[..., None]
        return np.sum(self.weight[row] * self.rate[row] / (self.rate[row] + s), axis=-1)


def by_id(effects: tuple[Effect, ...]) -> dict[str, Effect]:
    """Effects by their ids."""
    return {e.effect: e for e in effects}


def not_undone(part: TemperatureProfile | HumidityProfile, channel: str) -> list[str]:
    """One sentence for each effect of the profile that a flight's correction leaves alone."""
    said = []
    for effect in part.effects:
        if effect.effect in BENCH_EFFECTS:
            said.append(
                f"{channel}: {effect.effect} belongs to the bench and not to the sensor, and has no part in a flight"
            )
        elif effect.effect not in UNDONE[channel]:
            said.append(f"{channel}: {effect.effect} is in the profile and is not undone in a flight")
    return said


def bead_response(part: TemperatureProfile, airspeed_m_s: Array) -> Response:
    """Response of the bead at each airspeed (n,); the air film and the stem where the profile has them."""
    effects = by_id(part.effects)
    count = airspeed_m_s.size
    rate = part.thermal_diffusivity_m2_s.value / part.bead_radius_m**2
    relative = part.thermal_diffusivity_m2_s.standard_uncertainty / part.thermal_diffusivity_m2_s.value
    modes = sphere_core(BEAD_MODES)
    rows = np.zeros(count, dtype=int)
    if (e := effects.get("convective_film")) is not None:
        reference = ventilation(np.array(REFERENCE_AIRSPEED_M_S), part.bead_radius_m)
        biot = e.value("biot_at_5_m_s") * ventilation(airspeed_m_s, part.bead_radius_m) / reference
        biot, rows = _steps(biot)
        modes = sphere_core_biot(biot, BEAD_MODES)
        # mean lag of the core: R^2 / alpha (1/6 + 1 / (3 Bi)); only the latter part is the air film's
        relative = _combined(relative, e, 2.0 / (2.0 + biot[rows]))
    modes = modes.scaled(rate)
    slow = 0.0
    if (e := effects.get("stem_conduction")) is not None:
        modes = mix(modes, first_order(e.value("time_constant_s")), e.value("fraction"))
        slow = _share_uncertainty(e)
    return replace(_along(modes, rows, np.ones(count), relative * np.ones(count)), slow_uncertainty=slow)


def film_response(part: HumidityProfile, temperature_c: Array, airspeed_m_s: Array) -> Response:
    """Response of the film at each air temperature and airspeed (n,); beyond the table the outer row's D is held."""
    effects = by_id(part.effects)
    diffusivity, uncertainty = part.diffusivity_m2_s(temperature_c, outside="hold")
    scale = diffusivity / part.film_thickness_m**2
    relative = uncertainty / diffusivity
    modes = film_mean(FILM_MODES)
    rows = np.zeros(temperature_c.size, dtype=int)
    if (e := effects.get("vapour_boundary_layer")) is not None:
        biot, rows = _steps(e.value("biot_at_5_m_s") * np.sqrt(np.maximum(airspeed_m_s, 0.05) / REFERENCE_AIRSPEED_M_S))
        modes = film_mean_biot(biot, FILM_MODES)
        # mean lag of the film: L^2 / D (1/3 + 1 / Bi); only the latter part is the boundary layer's
        relative = _combined(relative, e, 3.0 / (3.0 + biot[rows]))
    response = _along(modes, rows, scale, relative)
    if (e := effects.get("slow_relaxation")) is not None:
        share = e.value("fraction")
        slow = np.full((scale.size, 1), 1.0 / e.value("time_constant_s"))
        weight = np.concatenate([(1 - share) * response.weight, np.full(slow.shape, share)], axis=1)
        rate = np.concatenate([response.rate, slow], axis=1)
        response = Response(weight, rate, response.relative_uncertainty, _share_uncertainty(e))
    return response


def _combined(relative, effect: Effect, share: Array):
    """Relative uncertainty of the time scale, `share` of which is inversely as the Biot number."""
    given = effect.parameters["biot_at_5_m_s"]
    return np.hypot(relative, share * given.standard_uncertainty / abs(given.value) if given.value else 0.0)


def _share_uncertainty(effect: Effect) -> float:
    """Of a slow lag's fraction; a time constant wrong by some percent counts like a fraction wrong by as many."""
    fraction, lag = effect.parameters["fraction"], effect.parameters["time_constant_s"]
    return float(np.hypot(fraction.standard_uncertainty, fraction.value * lag.standard_uncertainty / lag.value))


def _steps(biot: Array) -> tuple[Array, NDArray[np.int64]]:
    """Biot numbers on a ladder of 1 % steps, and the rung of each."""
    rung = np.round(np.log(np.maximum(biot, 1e-6)) / BIOT_STEP).astype(int)
    unique, rows = np.unique(rung, return_inverse=True)
    return np.exp(unique * BIOT_STEP), rows


def _along(modes: Modes, rows: NDArray[np.int64], scale: Array, relative: Array) -> Response:
    amplitude = np.broadcast_to(modes.amplitude, modes.rate.shape).reshape(-1, modes.rate.shape[-1])
    rate = modes.rate.reshape(amplitude.shape)
    return Response(-amplitude[rows], rate[rows] * scale[:, None], np.asarray(relative) * np.ones(scale.size))
