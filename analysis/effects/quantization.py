"""Readings are rounded to `step`, coarser than the sensor's own 0.01 degC or 100/16383 %RH."""

from shockrig.analysis.effects.effect import Effect, Parameter, unchanged

EFFECT = Effect(
    id="quantization",
    link="logger",
    channels=("temperature", "humidity"),
    parameters=(Parameter("step", "channel's unit", 1e-4, 10.0, (0.1,)),),
    apply=unchanged,
    sentence="Readings are rounded to steps of {step}.",
    equation="reading = step round(reading / step)",
    source="too few digits in the log or bits in the converter",
    advice="Log all the digits that the sensor gives.",
    from_readings=True,
)
