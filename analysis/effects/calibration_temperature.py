"""The calibration of RH moves with temperature: reading = H + percent_per_k (T_sensor - 20 degC)."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.exchange import REFERENCE_C

LEAST_RANGE_K = 10.0

EFFECT = Effect(
    id="calibration_temperature",
    link="readout",
    channels=("humidity",),
    equation="H = H_film + percent_per_k (T_die - 20 degC), at the air's temperature where the die's was not logged",
    source="data sheets of capacitive hygrometers: 0.05 %RH/K",
    parameters=(Parameter("percent_per_k", "%RH/K", -1.0, 1.0, (0.05,)),),
    apply=lambda chain, p: replace(chain, percent_per_k=p["percent_per_k"]),
    words=Words(
        "The calibration moves with temperature: {percent_per_k} %RH per kelvin away from 20 °C.",
        "Calibrate at two temperatures, and enter the result.",
    ),
    needs=Needs(
        "needs runs whose airs were recorded, at ambients 10 K apart",
        lambda channel: bool(
            channel.conditions.airs_known.all() and np.ptp(channel.conditions.destination_c) > LEAST_RANGE_K
        ),
    ),
    in_flight=InFlight(
        undo=lambda p, reading, stream, length: reading - p["percent_per_k"] * (stream.temperature_c - REFERENCE_C)
    ),
)
