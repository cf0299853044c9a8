"""Heat along leads and stem: reading = (1 - fraction) core + fraction of a first-order lag behind the air."""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Effect, InFlight, Needs, Parameter, Start, Words

EFFECT = Effect(
    id="stem_conduction",
    link="body",
    channels=("temperature",),
    equation="T = (1 - fraction) T_core + fraction T_stem, dT_stem/dt = (T_air - T_stem) / time_constant",
    source="immersion error of a thermometer with a slow support",
    parameters=(
        Parameter("fraction", "1", 0.0005, 0.6, (0.03,), percent=True),
        Parameter("time_constant_s", "s", 0.5, 300.0, (8.0, 25.0), log=True, none=None),
    ),
    apply=lambda chain, p: replace(chain, lags=(*chain.lags, (p["fraction"], p["time_constant_s"][..., None]))),
    words=Words(
        (
            "The bead's leads hold it back: {fraction} of the reading follows the stem, with a time constant of "
            "{time_constant_s} s."
        ),
        "Expose more of the leads to the air, or use thinner ones; hold the plateau for five stem time constants.",
    ),
    needs=Needs(
        "needs two runs or more whose airflow was recorded",
        lambda channel: bool(channel.conditions.airflow_known.all()) and channel.runs > 1,
    ),
    start=Start(mirrors=True),
    in_flight=InFlight(lag=lambda p: (p["fraction"], p["time_constant_s"])),
)
