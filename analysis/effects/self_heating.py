"""The measuring current warms the bead: reading warmer by rise_k_at_5_m_s F(5 m/s) / F(v)."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain, relative_ventilation
from shockrig.analysis.physics.exchange import ventilation_ratio


def _apply(chain: Chain, p: Arrays) -> Chain:
    rise = (p["rise_k_at_5_m_s"] / relative_ventilation(chain.channel))[..., None]
    return replace(chain, readouts=(*chain.readouts, lambda reading, time, die_c: reading + rise))


EFFECT = Effect(
    id="self_heating",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + rise(5 m/s) F(5 m/s) / F(v)",
    source="power over h A, Ranz and Marshall 1952",
    parameters=(Parameter("rise_k_at_5_m_s", "K", 0.0, 5.0, (0.1,)),),
    apply=_apply,
    words=Words(
        "The measuring current warms the bead by {rise_k_at_5_m_s} K at 5 m/s, and more in slower air.",
        "Lower the excitation, or pulse it; check at two excitation powers.",
    ),
    needs=Needs(
        "needs runs whose airs and airflow were recorded",
        lambda channel: bool((channel.conditions.airflow_known & channel.conditions.airs_known).all()),
    ),
    in_flight=InFlight(
        undo=lambda p, reading, stream, radius: reading - p["rise_k_at_5_m_s"] / ventilation_ratio(stream, radius)
    ),
)
