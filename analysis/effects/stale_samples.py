"""Each reading is repeated for `hold_samples` rows without the stale flag."""

from shockrig.analysis.effects.effect import Effect, Parameter, unchanged

EFFECT = Effect(
    id="stale_samples",
    link="logger",
    channels=("temperature", "humidity"),
    parameters=(Parameter("hold_samples", "1", 1.0, 100.0, (4.0,), none=1.0),),
    apply=unchanged,
    sentence="The logger repeats old readings: each stands {hold_samples} times, without the flag.",
    equation="reading_i = reading at the last i divisible by hold",
    source="read-out faster than the conversion, with the stale bit masked",
    advice="Honour the stale bit, and ask for a conversion before every fetch.",
    from_readings=True,
)
