"""The film is read at its own temperature: ppmv is turned into RH at the die's temperature (hyt.csv), not the air's."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.inference.effect import Effect, InFlight

EFFECT = Effect(
    id="die_thermal_lag",
    link="readout",
    channels=("humidity",),
    parameters=(),
    apply=lambda chain, p: replace(chain, at_die_temperature=True),
    sentence="The humidity sensor reads the air at its own die's temperature, and the die lags the air.",
    equation="H = c P_a / (1e4 P_s(T_die))",
    source="sorption follows activity at the film's own temperature",
    advice="Use isothermal shocks for D(T); in flight convert with the die's temperature, which the sensor reports.",
    in_flight=InFlight(at_die=True),
    own_rates=True,
    thermal_reading="thermal shocks, read at the die's temperature",
    needs="needs runs whose temperature changes, and the die's own temperature in hyt.csv",
    testable=lambda channel: bool(
        np.isfinite(channel.die_c).any()
        and (np.abs(channel.conditions.destination_c - channel.conditions.source_c) > 1.0).any()
    ),
    excludes=frozenset({"uptake_by_activity"}),
)
