"""Heat along leads and stem: reading = (1 - fraction) core + fraction of a first-order lag behind the air."""

from dataclasses import replace

from shockrig.analysis.inference.effect import Effect, InFlight, Parameter

EFFECT = Effect(
    id="stem_conduction",
    link="body",
    channels=("temperature",),
    parameters=(
        Parameter("fraction", "1", 0.0005, 0.6, (0.03,), percent=True),
        Parameter("time_constant_s", "s", 0.5, 300.0, (8.0, 25.0), log=True, none=None),
    ),
    apply=lambda chain, p: replace(chain, lags=(*chain.lags, (p["fraction"], p["time_constant_s"]))),
    sentence=(
        "The bead's leads hold it back: {fraction} of the reading follows the stem, with a time constant of "
        "{time_constant_s} s."
    ),
    equation="T = (1 - fraction) T_core + fraction T_stem, dT_stem/dt = (T_air - T_stem) / time_constant",
    source="immersion error of a thermometer with a slow support",
    testable=lambda channel: bool(channel.conditions.airflow_known.all()) and channel.runs > 1,
    needs="needs two runs or more whose airflow was recorded",
    in_flight=InFlight(lag=lambda p: (p["fraction"], p["time_constant_s"])),
    advice="Expose more of the leads to the air, or use thinner ones; hold the plateau for five stem time constants.",
    mirrors=True,
)
