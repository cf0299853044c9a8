"""A first-order lag in series with the body: a sheath, a housing, a vent or a filter cap that the air has to cross."""

from dataclasses import replace

from shockrig.analysis.inference.effect import Effect, InFlight, Parameter

EFFECT = Effect(
    id="series_lag",
    link="exchange",
    channels=("temperature", "humidity"),
    parameters=(Parameter("time_constant_s", "s", 0.02, 1000.0, (0.3, 3.0, 30.0), log=True, none=None, weakest=0.3),),
    apply=lambda chain, p: replace(chain, series=(*chain.series, p["time_constant_s"])),
    sentence=(
        "Something stands between the air and the body and follows it with a lag of {time_constant_s} s (a sheath, a "
        "housing, a vent, a cap), the same at every airflow."
    ),
    equation="time_constant dT_inside/dt = T_air - T_inside, and the body follows T_inside",
    source="two lags in series; housings and caps of thermometers and hygrometers",
    advice="Take off cap or sheath for a comparison, or fly with it on: the profile has it in.",
    limit_of="sheath",
    in_flight=InFlight(series_s=lambda p: p["time_constant_s"]),
    rare_in_known=True,
    shape=True,
)
