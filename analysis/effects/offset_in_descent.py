"""Wash, wake or sun in descent: while the carrier sinks, the air around the sensor is warmer or moister by an offset.

No bench shows it: `shockrig learn` finds it where ascent and descent pass the same air, and a profile carries it.
"""

import numpy as np

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Words, unchanged

EFFECT = Effect(
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
