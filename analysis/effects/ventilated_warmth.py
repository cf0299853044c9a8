"""Sun or own warmth in flight: the air at the sensor is warmer by what little airflow leaves there.

Where a log has no airspeed, the airflow is how fast the carrier climbs or sinks; `shockrig learn` and a correction take
the same. No bench has such an airflow, which is why it is no `self_heating` or `radiative_heating`.
"""

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Words, unchanged

REFERENCE_AIRFLOW_M_S = 5.0
LEAST_AIRFLOW_M_S = 0.5  # past a sensor that hovers in air that moves: what sinks no faster hovers


def airflow_m_s(airspeed_m_s: NDArray[np.float64], climb_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Airflow past a sensor (n,): the airspeed that was logged, else how fast it climbs or sinks; never still."""
    return np.maximum(np.where(airspeed_m_s >= 0.0, airspeed_m_s, np.abs(climb_m_s)), LEAST_AIRFLOW_M_S)


def warmer_k(rise_k: float, airflow: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much warmer (n,) than at no heat, of a rise at the reference airflow: heat is carried off as its root."""
    return np.asarray(rise_k * np.sqrt(REFERENCE_AIRFLOW_M_S / airflow))


EFFECT = Effect(
    id="ventilated_warmth",
    link="air",
    channels=("temperature",),
    equation="tau dq/dt = a + rise sqrt(5 m/s / v) - q, v the airspeed, or the climb where none is logged",
    source="WMO-No. 8 (2021), I.2; GRUAN-TD-8 (2022)",
    parameters=(Parameter("rise_k_at_5_m_s", "K", -10.0, 10.0, (0.5,)),),
    apply=unchanged,
    words=Words(
        "In flight the sensor is {rise_k_at_5_m_s} K too warm at 5 m/s, and more in slower air.",
        "Fly at night: what remains then is the sensor's own warmth. Lower the excitation, or shade the sensor.",
    ),
    needs=Needs("needs flights: a bench's airflow is another", lambda channel: False),
    in_flight=InFlight(carried=lambda p, climb, airspeed: warmer_k(p["rise_k_at_5_m_s"], airflow_m_s(airspeed, climb))),
)
