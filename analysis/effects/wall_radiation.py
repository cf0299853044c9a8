"""Heat radiated between bead and walls: reading off by rise_k_at_10_k for walls 10 K warmer, at 5 m/s.

Walls have a temperature of their own: at one airflow, or where the air is as warm as they are, that is a calibration
error. Three airflows in air that is warmer or colder than the walls tell the two apart.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain, relative_ventilation
from shockrig.analysis.physics.humidity import ZERO_CELSIUS_K

PER_10_K = 4.0 * 293.15**3 * 10.0  # K^4 that walls 10 K warmer than 20 degC radiate more, to first order
LEAST_RATIO = 1.5  # of the fastest airflow to the slowest
LEAST_RANGE_K = 10.0  # of the airs in which it varies


def _apply(chain: Chain, p: Arrays) -> Chain:
    weaker = (p["rise_k_at_10_k"] / relative_ventilation(chain.channel))[..., None]
    wall = (p["wall_temperature_c"] + ZERO_CELSIUS_K)[..., None] ** 4

    def radiated(
        reading: NDArray[np.float64], time: NDArray[np.float64], die_c: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return reading + weaker * (wall - (reading + ZERO_CELSIUS_K) ** 4) / PER_10_K

    return replace(chain, readouts=(*chain.readouts, radiated))


def _varied(channel: Channel) -> bool:
    """Whether the airflow varies in airs that differ, of runs whose airs and airflow were recorded."""
    air = channel.conditions
    slow = air.airflow_m_s < float(np.median(air.airflow_m_s)) / LEAST_RATIO**0.5
    fast = air.airflow_m_s > float(np.median(air.airflow_m_s)) * LEAST_RATIO**0.5
    unusual = slow | fast
    if not (air.airflow_known & air.airs_known).all() or not unusual.any():
        return False
    return bool(np.ptp(np.concatenate([air.source_c[unusual], air.destination_c[unusual]])) > LEAST_RANGE_K)


EFFECT = Effect(
    id="wall_radiation",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + rise (T_wall^4 - T_bead^4) / (4 (293.15 K)^3 10 K) F(5 m/s) / F(v)",
    source="Stefan and Boltzmann over h A, Ranz and Marshall 1952; 4 emissivity sigma T^3 is 1.6 % of h at 5 m/s",
    parameters=(
        Parameter("rise_k_at_10_k", "K", 0.0, 3.0, (0.1,)),
        Parameter("wall_temperature_c", "degC", -60.0, 90.0, (21.0,), none=None, prior=(21.0, 10.0)),
    ),
    apply=_apply,
    words=Words(
        (
            "The walls around the bead radiate to it: walls 10 K warmer than the air (they are at "
            "{wall_temperature_c} °C) add {rise_k_at_10_k} K at 5 m/s, and more in slower air."
        ),
        "Shield the bead, keep walls at the air's temperature, or aspirate harder.",
    ),
    needs=Needs(
        "needs recorded airs and airflow, and airflows that differ in air warmer or colder than the walls", _varied
    ),
    in_flight=InFlight(left=True),
)
