"""Boundary layer over the film: mass-transfer Biot number biot_at_5_m_s (v / 5 m/s)^1/2 between air and film.

At low pressure vapour diffuses faster through a thicker layer: the number goes as pressure^-1/2.
"""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.exchange import Stream, vapour_ratio

EFFECT = Effect(
    id="vapour_boundary_layer",
    link="exchange",
    channels=("humidity",),
    equation="D dc/dx = h (c_air - c) at x = L, h L / D = Bi(5 m/s) (v / 5 m/s)^1/2 (1013.25 hPa / pressure)^1/2",
    source="laminar boundary layer; Carslaw and Jaeger 1959, section 3.11",
    parameters=(Parameter("biot_at_5_m_s", "1", 0.2, 400.0, (8.0, 40.0), log=True, none=None, weakest=40.0),),
    apply=lambda chain, p: replace(
        chain, biot=p["biot_at_5_m_s"] * vapour_ratio(Stream.of_runs(chain.channel.conditions))
    ),
    words=Words(
        (
            "Vapour has to cross a boundary layer before it reaches the film (Biot {biot_at_5_m_s} at 5 m/s): the rise "
            "starts late, later at low airflow."
        ),
        "Take off the filter cap or aspirate harder; state the airflow with every response time.",
    ),
    needs=Needs("needs runs whose airflow was recorded", lambda channel: bool(channel.conditions.airflow_known.all())),
    candidacy=Candidacy(limit_of="sheath"),
    in_flight=InFlight(
        biot=lambda p, stream, thickness: p["biot_at_5_m_s"] * vapour_ratio(stream),
    ),
)
