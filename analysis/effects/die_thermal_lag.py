"""The film is read at its own temperature: ppmv is turned into RH at the die's temperature (hyt.csv), not the air's."""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Readout, Start, Words

EFFECT = Effect(
    id="die_thermal_lag",
    link="readout",
    channels=("humidity",),
    equation="H = c P_a / (1e4 P_s(T_die))",
    source="sorption follows activity at the film's own temperature",
    parameters=(),
    apply=lambda chain, p: replace(chain, at_die_temperature=True),
    words=Words(
        "The humidity sensor reads the air at its own die's temperature, and the die lags the air.",
        "Use isothermal shocks for D(T); in flight convert with the die's temperature, which the sensor reports.",
    ),
    needs=Needs(
        "needs runs whose temperature changes, and the die's own temperature in hyt.csv",
        lambda channel: bool(
            np.isfinite(channel.die_c).any()
            and (np.abs(channel.conditions.destination_c - channel.conditions.source_c) > 1.0).any()
        ),
    ),
    start=Start(own_rates=True),
    candidacy=Candidacy(excludes=frozenset({"uptake_by_activity"})),
    readout=Readout(thermal="thermal shocks, read at the die's temperature"),
    in_flight=InFlight(at_die=True),
)
