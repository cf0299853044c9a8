"""A sheath or a housing with heat (or vapour) of its own, which the body inside loads: it lags by what the body takes.

`series_lag` is its limit for a capacity far above the body's; a film of air or vapour outside adds to the resistance.
Both may stand beside it, and a search that took one of them for the sheath finds the way from there.
"""

from dataclasses import replace

from shockrig.analysis.estimate.effect import Candidacy, Effect, InFlight, Needs, Parameter, Start, Words

RIDGE_WIDTH = 2.5  # in ln of both
LOADED_RATIO = 2.0  # the body is about so much faster than sheath and body together were taken to be

EFFECT = Effect(
    id="sheath",
    link="exchange",
    channels=("temperature", "humidity"),
    equation=(
        "C_sheath dT_sheath/dt = C_sheath (T_air - T_sheath) / time_constant - heat into the body, C_sheath = capacity "
        "C_body, and the body's surface is at T_sheath"
    ),
    source="Carslaw and Jaeger 1959, section 1.9 (contact with a well-stirred fluid); sheathed thermometers",
    parameters=(
        Parameter("time_constant_s", "s", 0.02, 1000.0, (0.03, 0.1, 0.3, 1.0, 3.0), log=True, none=None, weakest=0.03),
        Parameter("capacity", "1", 0.02, 50.0, (1.0,), log=True, none=None),
    ),
    apply=lambda chain, p: replace(chain, loaded=(p["time_constant_s"], p["capacity"])),
    words=Words(
        (
            "Something with a capacity of its own stands between the air and the body (a sheath, a housing): alone it "
            "would follow the air with {time_constant_s} s, and it holds {capacity} times what the body holds."
        ),
        "Take off the sheath for a comparison, or fly with it on: the profile has it in.",
    ),
    needs=Needs(
        "is looked for in sensors whose bodies are not known; before a lump it is a lag in series",
        lambda channel: not channel.known_sensor and channel.body != "lumped",
    ),
    start=Start(
        rate_factor=lambda channel: LOADED_RATIO,
        # A sheath that holds next to nothing is a film, of time constant over capacity: along that ridge.
        nudges=lambda channel: [{"time_constant_s": s, "capacity": s} for s in (RIDGE_WIDTH, -RIDGE_WIDTH)],
    ),
    candidacy=Candidacy(excludes=frozenset({"body_lumped"}), shape=True),
    in_flight=InFlight(loaded=lambda p: (p["time_constant_s"], p["capacity"])),
)
