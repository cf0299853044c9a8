"""Light on the bead: reading warmer by kelvin_per_w_m2_at_5_m_s E F(5 m/s) / F(v), E from run.json's
irradiance_w_m2."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.chain import Chain, relative_ventilation


def _apply(chain: Chain, p: Arrays) -> Chain:
    irradiance = chain.channel.conditions.irradiance_w_m2
    rise = (p["kelvin_per_w_m2_at_5_m_s"] * irradiance / relative_ventilation(chain.channel))[..., None]
    return replace(chain, readouts=(*chain.readouts, lambda reading, time, die_c: reading + rise))


EFFECT = Effect(
    id="radiative_heating",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + kappa E F(5 m/s) / F(v)",
    source="absorbed irradiance over h A, Ranz and Marshall 1952",
    parameters=(Parameter("kelvin_per_w_m2_at_5_m_s", "K m2/W", 0.0, 0.01, (3e-4,)),),
    apply=_apply,
    words=Words(
        "Light warms the bead by {kelvin_per_w_m2_at_5_m_s} K per W/m2 at 5 m/s.",
        "Shade the bead, or log the irradiance with every run and in flight.",
    ),
    needs=Needs(
        "needs runs under light, with irradiance_w_m2 in run.json",
        lambda channel: bool((channel.conditions.irradiance_w_m2 > 0).any()),
    ),
    in_flight=InFlight(left=True),
)
