"""The air film around the bead: surface flux h (T_air - T_s), Biot number h R / k = biot_at_5_m_s F(v) / F(5 m/s).

F is taken at the air's own density: in thin air the bead is slower, and F is 14 % less at 700 hPa.
"""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Parameter, Start, Words
from shockrig.analysis.physics.chain import relative_ventilation
from shockrig.analysis.physics.exchange import ventilation_ratio

EFFECT = Effect(
    id="convective_film",
    link="exchange",
    channels=("temperature",),
    equation=(
        "k dT/dr = h (T_air - T) at r = R, Bi = h R / k = Bi(5 m/s) F(v) / F(5 m/s), F = 2 + 0.6 Re^1/2 Pr^1/3, "
        "Re ~ airflow x pressure"
    ),
    source="Ranz and Marshall 1952; Carslaw and Jaeger 1959, section 9.4",
    parameters=(Parameter("biot_at_5_m_s", "1", 0.005, 60.0, (0.1, 1.0, 6.0), log=True, none=None, weakest=6.0),),
    apply=lambda chain, p: replace(chain, biot=p["biot_at_5_m_s"] * relative_ventilation(chain.channel)),
    words=Words(
        (
            "The bead does not follow the air at once: the air film around it (Biot {biot_at_5_m_s} at 5 m/s) makes it "
            "slower at low airflow."
        ),
        "State the airflow with every response time; correct flights at their own airspeed and pressure.",
    ),
    needs=Needs("needs runs whose airflow was recorded", lambda channel: bool(channel.conditions.airflow_known.all())),
    start=Start(own_rates=True),
    candidacy=Candidacy(limit_of="sheath"),
    in_flight=InFlight(
        biot=lambda p, stream, radius: p["biot_at_5_m_s"] * ventilation_ratio(stream, radius),
    ),
)
