"""Readings are rounded to `step`, coarser than the sensor's own 0.01 degC or 100/16383 %RH."""

import numpy as np

from shockrig.analysis.estimate.effect import (
    Effect,
    Finding,
    InFlight,
    Parameter,
    Readout,
    SingleReadings,
    Words,
    unchanged,
)
from shockrig.analysis.estimate.readings import coarser_than_the_sensor, known_to


def coarse_step(known: SingleReadings) -> tuple[SingleReadings, Finding | None]:
    """The step to which all readings are rounded, where it is coarser than the sensor's own, where that is known."""
    step, normal = known.step, known.channel.quantity.resolution
    if not coarser_than_the_sensor(known.channel, step):
        return known, None
    unit = known.channel.quantity.unit
    return known, Finding(
        "quantization",
        {"step": (step, known_to(step))},
        f"all readings are multiples of {step:.4g} {unit}, the sensor resolves {normal:.3g} {unit}",
    )


EFFECT = Effect(
    id="quantization",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading = step round(reading / step)",
    source="too few digits in the log or bits in the converter",
    parameters=(Parameter("step", "channel's unit", 1e-4, 10.0, (0.1,)),),
    apply=unchanged,
    words=Words(
        "Readings are rounded to steps of {step}.",
        "Log all the digits that the sensor gives.",
    ),
    readout=Readout(in_readings=coarse_step, rounded_to=lambda p: p["step"]),
    in_flight=InFlight(noise=lambda p: p["step"] / np.sqrt(12.0)),
)
