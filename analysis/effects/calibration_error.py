"""Gain and offset: reading = true (1 + gain) + offset, in the channel's unit (degC or %RH)."""

from dataclasses import replace

from shockrig.analysis.effects.effect import Effect, Parameter


def _apply(chain, p):
    gain, offset = p["gain"][..., None], p["offset"][..., None]
    return replace(chain, readouts=(*chain.readouts, lambda reading: reading * (1 + gain) + offset))


EFFECT = Effect(
    id="calibration_error",
    link="readout",
    channels=("temperature", "humidity"),
    parameters=(
        Parameter("gain", "1", -0.3, 0.3, (0.0,)),
        Parameter("offset", "channel's unit", -15.0, 15.0, (0.0,)),
    ),
    apply=_apply,
    sentence="The calibration is off: gain {gain}, offset {offset}, the same at every airflow and direction.",
    equation="reading = true (1 + gain) + offset",
    source="two-point calibration",
    advice="Calibrate at two points against the reference, and enter the result.",
)
