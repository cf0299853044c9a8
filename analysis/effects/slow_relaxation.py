"""Non-Fickian uptake: `fraction` of it follows the air as a first-order lag with `time_constant_s`."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Start, Words

EFFECT = Effect(
    id="slow_relaxation",
    link="body",
    channels=("humidity",),
    equation="mean c = (1 - fraction) Fick + fraction (1 - exp(-t / time_constant))",
    source="Berens and Hopfenberg 1978; RS41 humidity needs two time constants (doi 10.1002/met.70097)",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.6, (0.05,), percent=True),
        Parameter("time_constant_s", "s", 0.5, 300.0, (25.0, 8.0, 70.0), log=True, none=None),
    ),
    apply=lambda chain, p: replace(chain, lags=(*chain.lags, (p["fraction"], p["time_constant_s"][..., None]))),
    words=Words(
        ("The film takes up {fraction} of the water late, with a time constant of {time_constant_s} s (non-Fickian)."),
        "Record for several of the slow time constants; do not take the plateau at one minute as the end value.",
    ),
    needs=Needs(
        "needs two runs or more whose airflow was recorded",
        lambda channel: bool(channel.conditions.airflow_known.all()) and channel.runs > 1,
    ),
    start=Start(mirrors=True),
    in_flight=InFlight(lag=lambda p: (p["fraction"], p["time_constant_s"])),
)
