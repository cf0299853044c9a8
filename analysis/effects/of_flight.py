"""What no bench shows: flights alone find it, and a correction takes it off as it does the catalogue's."""

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Values, Words, unchanged
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S

Array = NDArray[np.float64]

# Wash, wake or sun in descent: while the carrier sinks, the air around the sensor is warmer or moister by an offset.
#
# No bench shows it: `shockrig learn` finds it where ascent and descent pass the same air, and a profile carries it.

OFFSET_IN_DESCENT = Effect(
    id="offset_in_descent",
    link="air",
    channels=("temperature", "humidity"),
    equation="tau dq/dt = a + offset - q while the flight sinks faster than from_m_s",
    source="Greene and others 2018, doi 10.5194/amt-11-5519-2018",
    parameters=(
        Parameter("offset", "K or %RH", -60.0, 60.0, (1.0,)),
        Parameter("from_m_s", "m/s", 0.1, 50.0, (1.0,), log=True, none=None),
    ),
    apply=unchanged,
    words=Words(
        "While the flight descends, the air around the sensor is off by {offset}.",
        "Fly another speed of descent, a night and a hover: they tell wash, wake and sun apart.",
    ),
    needs=Needs("needs flights: no bench descends", lambda channel: False),
    in_flight=InFlight(carried=lambda p, climb, airspeed: np.where(climb < -p["from_m_s"], p["offset"], 0.0)),
)


# Sun or own warmth in flight: the air at the sensor is warmer by what little airflow leaves there.
#
# Where a log has no airspeed, the airflow is how fast the carrier climbs or sinks; `shockrig learn` and a correction
# take the same. No bench has such an airflow, which is why it is no `self_heating` or `radiative_heating`.

LEAST_AIRFLOW_M_S = 0.5  # past a sensor that hovers in air that moves: what sinks no faster hovers


def airflow_m_s(airspeed_m_s: Array, climb_m_s: Array) -> Array:
    """Airflow past a sensor (n,): the airspeed that was logged, else how fast it climbs or sinks; never still."""
    return np.maximum(np.where(airspeed_m_s >= 0.0, airspeed_m_s, np.abs(climb_m_s)), LEAST_AIRFLOW_M_S)


def warmer_k(rise_k: float, airflow: Array) -> Array:
    """How much warmer (n,) than at no heat, of a rise at the reference airflow: heat is carried off as its root."""
    return np.asarray(rise_k * np.sqrt(REFERENCE_AIRFLOW_M_S / airflow))


VENTILATED_WARMTH = Effect(
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


# A film that is as warm as the bead beside it reads, some seconds later: how flights of one sensor see it.
#
# No bench states it: `shockrig learn` finds it with the film's lag, by the bead's readings alone.


def _film_c(p: Values, time_s: Array, bead_c: Array) -> Array:
    """Temperature (n,) of the film along a flight, `bead_c` (n,) what the bead reads."""
    from scipy.signal import lfilter

    ahead = np.diff(time_s)
    if p["time_constant_s"] > 0 and (ahead > 0).any():
        kept = np.exp(-float(np.median(ahead[ahead > 0])) / p["time_constant_s"])
        bead_c = lfilter([1.0 - kept], [1.0, -kept], bead_c, zi=[kept * bead_c[0]])[0]
    return np.asarray(np.interp(time_s - p["behind_s"], time_s, bead_c))


FILM_BESIDE_BEAD = Effect(
    id="film_beside_bead",
    link="readout",
    channels=("humidity",),
    equation=(
        "y = e / es(T), T(t) the bead's reading behind_s before, through a lag of time_constant_s; the film follows "
        "e es(T)^-activity"
    ),
    source="WMO-No. 8 (2021), I.4 (vapour pressure); air that is carried keeps its vapour pressure",
    parameters=(
        Parameter("behind_s", "s", -60.0, 60.0, (0.0,)),
        Parameter("activity", "1", 0.0, 1.0, (0.5,), none=None),
        Parameter("time_constant_s", "s", 0.0, 200.0, (0.0,)),
    ),
    apply=unchanged,
    words=Words(
        "The film is as warm as the bead was {behind_s} s before.",
        "Log the temperature of the film's own chip.",
    ),
    needs=Needs("needs flights: a bench has the airs themselves", lambda channel: False),
    in_flight=InFlight(film_c=_film_c, activity=lambda p: p["activity"]),
)


EFFECTS = (OFFSET_IN_DESCENT, VENTILATED_WARMTH, FILM_BESIDE_BEAD)
