"""The air film follows the air's own temperature: h as the conductivity k(T) and F(v, nu(T)), relative to 20 degC.

It acts on an air film that is there (`convective_film`), and on nothing else: some 2 % over 40 K, since the air's
conductivity rises by 12 % and its viscosity takes most of that back.
"""

from dataclasses import replace

import numpy as np

from shockrig.analysis.estimate.effect import Arrays, Candidacy, Effect, InFlight, Needs, Words
from shockrig.analysis.physics.chain import Chain
from shockrig.analysis.physics.exchange import Stream, temperature_ratio

LEAST_RANGE_K = 15.0  # of the ambients: below, it moves the lag by less than rates scatter


def _apply(chain: Chain, p: Arrays) -> Chain:
    if chain.biot is None:
        return chain
    channel = chain.channel
    return replace(chain, biot=chain.biot * temperature_ratio(Stream.of_runs(channel.conditions), channel.length_m))


EFFECT = Effect(
    id="exchange_temperature",
    link="exchange",
    channels=("temperature",),
    equation="h(T) / h(20 degC) = k(T) / k(20 degC) F(v, nu(T)) / F(v, nu(20 degC))",
    source="U.S. Standard Atmosphere 1976 (conductivity, viscosity); Ranz and Marshall 1952",
    parameters=(),
    apply=_apply,
    words=Words(
        "The air film around the bead lets heat pass as air does at its own temperature, not as at 20 °C.",
        "State the air's temperature with a response time behind an air film.",
    ),
    needs=Needs(
        "needs runs at ambients 15 K apart whose airflow was recorded",
        lambda channel: bool(
            channel.conditions.airflow_known.all() and np.ptp(channel.conditions.destination_c) > LEAST_RANGE_K
        ),
    ),
    candidacy=Candidacy(beside=frozenset({"convective_film"})),
    in_flight=InFlight(exchange=lambda p, stream, radius: temperature_ratio(stream, radius)),
)
