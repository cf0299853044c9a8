"""The sensing body: its shape, its diffusivity, and what follows slowly beside it."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    SLOWEST_S,
    Arrays,
    Candidacy,
    Effect,
    InFlight,
    Needs,
    Parameter,
    Start,
    Words,
)
from shockrig.analysis.estimate.without_model import as_fast_as_seen
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import Chain, Recorded
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]

# The sensing body has another shape than campaign.json says: one entry for each shape that it could have.


@cache
def _t63(name: str) -> float:
    """Dimensionless time to 63 % of a step."""
    return BODIES[name].landmarks[0]


def _other_body(name: str) -> Effect:
    body = BODIES[name]

    def with_body(chain: Chain, p: Arrays) -> Chain:
        return replace(chain, body=body)

    return Effect(
        id=f"body_{name}",
        link="body",
        channels=("temperature", "humidity"),
        equation=f"the closed form of {body.sentence}; its rate is {body.symbol}",
        source="Carslaw and Jaeger 1959, chapters 3, 7 and 9",
        parameters=(),
        apply=with_body,
        words=Words(
            f"The sensor responds like {body.sentence}, not like the body that is taken for it.",
            f'Set sensors.*.body to "{name}" in campaign.json if that is what the sensor is.',
        ),
        needs=Needs("is what campaign.json states already", lambda channel: channel.body != name),
        start=Start(rate_factor=lambda channel: _t63(name) / _t63(channel.body)),
        candidacy=Candidacy(
            rare=lambda channel: channel.known_sensor,
            # Around a lump a sheath cannot be told from a lag in series, which has one parameter less.
            excludes=frozenset(f"body_{other}" for other in BODIES if other != name)
            | ({"sheath"} if name == "lumped" else set()),
            shape=True,
            simple="body" if name == "lumped" else "",
        ),
        in_flight=InFlight(body=name),
    )


OTHER_BODIES = tuple(_other_body(name) for name in BODIES)


# Drying runs diffuse `ratio_drying_to_wetting` times as fast as wetting ones; the table is that of wetting.


def dries(channel: Recorded) -> NDArray[np.bool_]:
    """True for the runs (R,) in which the vapour concentration falls."""
    air = channel.conditions
    return air.destination_percent * saturation_pressure_hpa(
        air.destination_c
    ) < air.source_percent * saturation_pressure_hpa(air.source_c)


_dried_as_seen = as_fast_as_seen("ratio_drying_to_wetting", dries, 0.25, 4.0)
DIRECTION_DEPENDENT_DIFFUSIVITY = Effect(
    id="direction_dependent_diffusivity",
    link="body",
    channels=("humidity",),
    equation="D(drying) = ratio D(wetting)",
    source="sorption hysteresis of polymers; Crank 1975, chapter 9",
    parameters=(Parameter("ratio_drying_to_wetting", "1", 0.2, 5.0, (0.85, 1.2), log=True, none=1.0),),
    apply=lambda chain, p: replace(
        chain, rate=chain.rate * np.where(dries(chain.channel), p["ratio_drying_to_wetting"], 1.0)
    ),
    words=Words(
        "The film does not dry as fast as it wets: D is {ratio_drying_to_wetting} times as large in drying.",
        "Report rising and falling response times apart.",
    ),
    needs=Needs(
        "needs runs that wet the film and runs that dry it",
        lambda channel: bool(dries(channel).any() and (~dries(channel)).any()),
    ),
    start=Start(from_data=lambda channel: {} if channel.known_sensor else _dried_as_seen(channel), own_rates=True),
    in_flight=InFlight(left=True),
)


# D depends on water activity in the film: D = D0 (1 + slope (a - 0.5)), a = c / saturation at the destination.

LEAST_PERCENT = 10.0  # between the middles of two runs' steps


def _levels_differ(channel: Channel) -> bool:
    air = channel.conditions
    middle, up = 0.5 * (air.source_percent + air.destination_percent), air.destination_percent > air.source_percent
    return bool(np.ptp(middle) > LEAST_PERCENT or (up.any() and (~up).any()))


CONCENTRATION_DEPENDENT_DIFFUSIVITY = Effect(
    id="concentration_dependent_diffusivity",
    link="body",
    channels=("humidity",),
    equation="D = D0 (1 + slope (a - 1/2)), a = c / c_sat(destination)",
    source="Crank 1975, chapter 9",
    parameters=(Parameter("slope_per_unit_activity", "1", -1.6, 1.9, (-0.3, 0.3)),),
    apply=lambda chain, p: replace(chain, activity_slope=p["slope_per_unit_activity"]),
    words=Words(
        (
            "The film's diffusivity depends on how wet it is: it changes by {slope_per_unit_activity} (relative) from "
            "dry to saturated."
        ),
        "Take small steps at several levels, up and down, and quote D at half saturation.",
    ),
    needs=Needs("needs runs at different levels of humidity, or both up and down", _levels_differ),
    candidacy=Candidacy(excludes=frozenset({"uptake_by_activity"})),
    in_flight=InFlight(left=True),
)


# A share of the reading follows the air as a first-order lag beside the body: of a film that relaxes, of a stem, or of
# what runs without a recorded airflow do not say.


def _beside_the_body(chain: Chain, p: Arrays) -> Chain:
    return replace(chain, lags=(*chain.lags, (p["fraction"], p["time_constant_s"][..., None])))


LATE_IN_FLIGHT = InFlight(lag=lambda p: (p["fraction"], p["time_constant_s"]))
AIRFLOW_OF_SEVERAL = Needs(
    "needs two runs or more whose airflow was recorded",
    lambda channel: bool(channel.conditions.airflow_known.all()) and channel.runs > 1,
)

# Non-Fickian uptake: `fraction` of it follows the air as a first-order lag with `time_constant_s`.

SLOW_RELAXATION = Effect(
    id="slow_relaxation",
    link="body",
    channels=("humidity",),
    equation="mean c = (1 - fraction) Fick + fraction (1 - exp(-t / time_constant))",
    source="Berens and Hopfenberg 1978; RS41 humidity needs two time constants (doi 10.1002/met.70097)",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.6, (0.05,), percent=True),
        Parameter("time_constant_s", "s", 0.5, 300.0, (25.0, 8.0, 70.0), log=True, none=None),
    ),
    apply=_beside_the_body,
    words=Words(
        ("The film takes up {fraction} of the water late, with a time constant of {time_constant_s} s (non-Fickian)."),
        "Record for several of the slow time constants; do not take the plateau at one minute as the end value.",
    ),
    needs=AIRFLOW_OF_SEVERAL,
    start=Start(mirrors=True),
    in_flight=LATE_IN_FLIGHT,
)


# Heat along leads and stem: reading = (1 - fraction) core + fraction of a first-order lag behind the air.

STEM_CONDUCTION = Effect(
    id="stem_conduction",
    link="body",
    channels=("temperature",),
    equation="T = (1 - fraction) T_core + fraction T_stem, dT_stem/dt = (T_air - T_stem) / time_constant",
    source="immersion error of a thermometer with a slow support",
    parameters=(
        Parameter("fraction", "1", 0.0005, 0.6, (0.03,), percent=True),
        Parameter("time_constant_s", "s", 0.5, 300.0, (8.0, 25.0), log=True, none=None),
    ),
    apply=_beside_the_body,
    words=Words(
        (
            "The bead's leads hold it back: {fraction} of the reading follows the stem, with a time constant of "
            "{time_constant_s} s."
        ),
        "Expose more of the leads to the air, or use thinner ones; hold the plateau for five stem time constants.",
    ),
    needs=AIRFLOW_OF_SEVERAL,
    start=Start(mirrors=True),
    in_flight=LATE_IN_FLIGHT,
)


# A share of the response follows as a slow first-order lag: two time constants in parallel, whatever makes them.

PARALLEL_LAG = Effect(
    id="parallel_lag",
    link="body",
    channels=("temperature", "humidity"),
    equation="reading = (1 - fraction) body + fraction (1 - exp(-t / time_constant))",
    source="two exponentials; what makes the second one (support, housing, film, air) these runs do not say",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.9, (0.05, 0.3), percent=True),
        Parameter("time_constant_s", "s", 0.05, SLOWEST_S, (3.0, 10.0, 50.0, 300.0), log=True, none=None),
    ),
    apply=_beside_the_body,
    words=Words(
        "{fraction} of the response follows with a time constant of its own, {time_constant_s} s.",
        "Record the airflow and vary it: a support's share depends on it, a film's own does not.",
    ),
    needs=Needs(
        "is looked for in a single run and where the airflow was not recorded; its named causes are elsewhere",
        lambda channel: not channel.conditions.airflow_known.all() or channel.runs == 1,
    ),
    start=Start(mirrors=True),
    candidacy=Candidacy(shape=True, simple="lag"),
    in_flight=LATE_IN_FLIGHT,
)


EFFECTS = (
    *OTHER_BODIES,
    DIRECTION_DEPENDENT_DIFFUSIVITY,
    CONCENTRATION_DEPENDENT_DIFFUSIVITY,
    SLOW_RELAXATION,
    STEM_CONDUCTION,
    PARALLEL_LAG,
)
