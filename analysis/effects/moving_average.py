"""Each logged value is the mean of the last `samples` readings, noise included."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import (
    Arrays,
    Effect,
    Finding,
    InFlight,
    Parameter,
    Readout,
    SingleReadings,
    Words,
)
from shockrig.analysis.estimate.readings import mostly_repeats
from shockrig.analysis.physics.chain import Chain


def _apply(chain: Chain, p: Arrays) -> Chain:
    # A whole number of readings, the same for every candidate: it comes from the noise and is not searched.
    return replace(chain, averaged=max(int(round(float(p["samples"].flat[0]))), 1))


def seen_in_noise(known: SingleReadings) -> Finding | None:
    """A running mean in the logger, from the correlation of the noise."""
    noise = known.noise
    if noise is None or noise.averaged == 1 or mostly_repeats(known.channel, known.step):
        return None  # old readings over again hang together as a mean's do
    likelihood = noise.log_likelihood_by_average
    gain = float(likelihood[noise.averaged - 1] - likelihood[0])
    return Finding(
        "moving_average",
        {"samples": (float(noise.averaged), 0.1)},
        f"the plateaus' noise is that of a mean over {noise.averaged} readings "
        f"(log likelihood {gain:+.0f} against plain noise)",
    )


EFFECT = Effect(
    id="moving_average",
    link="logger",
    channels=("temperature", "humidity"),
    equation="reading_i = mean(reading_(i-n+1) .. reading_i)",
    source="running mean in firmware",
    parameters=(Parameter("samples", "1", 1.0, 24.0, (5.0,), none=1.0),),
    apply=_apply,
    words=Words(
        "The logger averages the last {samples} readings: the response is late and the noise is correlated.",
        "Switch the averaging off and average afterwards, centred.",
    ),
    readout=Readout(in_noise=seen_in_noise, averages=lambda p: int(round(p["samples"]))),
    in_flight=InFlight(delay_s=lambda p, period_s: 0.5 * max(p["samples"] - 1.0, 0.0) * period_s),
)
