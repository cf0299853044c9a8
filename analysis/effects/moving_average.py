"""Each logged value is the mean of the last `samples` readings, noise included."""

from dataclasses import replace

from shockrig.analysis.effects.effect import Effect, Parameter


def _apply(chain, p):
    # A whole number of readings, the same for every candidate: it comes from the noise and is not searched.
    return replace(chain, averaged=max(int(round(float(p["samples"].flat[0]))), 1))


EFFECT = Effect(
    id="moving_average",
    link="logger",
    channels=("temperature", "humidity"),
    parameters=(Parameter("samples", "1", 1.0, 24.0, (5.0,), none=1.0),),
    apply=_apply,
    sentence="The logger averages the last {samples} readings: the response is late and the noise is correlated.",
    equation="reading_i = mean(reading_(i-n+1) .. reading_i)",
    source="running mean in firmware",
    advice="Switch the averaging off and average afterwards, centred.",
    from_readings=True,
)
