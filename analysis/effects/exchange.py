"""What stands between the air and the body: films of air or vapour, sheaths, dew."""

from collections.abc import Callable
from dataclasses import replace

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
from shockrig.analysis.physics.air_exchange import Stream, temperature_ratio, vapour_ratio, ventilation_ratio
from shockrig.analysis.physics.chain import Chain, relative_ventilation

Array = NDArray[np.float64]

# The air film around the bead: surface flux h (T_air - T_s), Biot number h R / k = biot_at_5_m_s F(v) / F(5 m/s).
#
# F is taken at the air's own density: in thin air the bead is slower, and F is 14 % less at 700 hPa.

CONVECTIVE_FILM = Effect(
    id="convective_film",
    link="exchange",
    channels=("temperature",),
    equation=(
        "k dT/dr = h (T_air - T) at r = R, Bi = h R / k = Bi(5 m/s) F(v) / F(5 m/s), F = 2 + 0.6 Re^1/2 Pr^1/3, "
        "Re ~ airflow x pressure"
    ),
    source="Ranz and Marshall 1952; Carslaw and Jaeger 1959, section 9.4",
    parameters=(Parameter("biot_at_5_m_s", "1", 0.005, 60.0, (0.1, 1.0, 6.0), log=True, none=None, weakest=6.0),),
    apply=lambda chain, p: replace(chain, biot=p["biot_at_5_m_s"] * relative_ventilation(chain.channel)),
    words=Words(
        (
            "The bead does not follow the air at once: the air film around it (Biot {biot_at_5_m_s} at 5 m/s) makes it "
            "slower at low airflow."
        ),
        "State the airflow with every response time; correct flights at their own airspeed and pressure.",
    ),
    needs=Needs("needs runs whose airflow was recorded", lambda channel: bool(channel.conditions.airflow_known.all())),
    start=Start(own_rates=True),
    in_flight=InFlight(
        biot=lambda p, stream, radius: p["biot_at_5_m_s"] * ventilation_ratio(stream, radius),
    ),
)


# The air film follows the air's own temperature: h as the conductivity k(T) and F(v, nu(T)), relative to 20 degC.
#
# It acts on an air film that is there (`convective_film`), and on nothing else: some 2 % over 40 K, since the air's
# conductivity rises by 12 % and its viscosity takes most of that back.

LEAST_RANGE_K = 15.0  # of the ambients: below, it moves the lag by less than rates scatter


def _at_the_airs_temperature(chain: Chain, p: Arrays) -> Chain:
    if chain.biot is None:
        return chain
    channel = chain.channel
    return replace(chain, biot=chain.biot * temperature_ratio(Stream.of_runs(channel.conditions), channel.length_m))


EXCHANGE_TEMPERATURE = Effect(
    id="exchange_temperature",
    link="exchange",
    channels=("temperature",),
    equation="h(T) / h(20 degC) = k(T) / k(20 degC) F(v, nu(T)) / F(v, nu(20 degC))",
    source="U.S. Standard Atmosphere 1976 (conductivity, viscosity); Ranz and Marshall 1952",
    parameters=(),
    apply=_at_the_airs_temperature,
    words=Words(
        "The air film around the bead lets heat pass as air does at its own temperature, not as at 20 °C.",
        "State the air's temperature with a response time behind an air film.",
    ),
    needs=Needs(
        "needs runs at ambients 15 K apart whose airflow was recorded",
        lambda channel: bool(
            channel.conditions.airflow_known.all() and np.ptp(channel.conditions.destination_c) > LEAST_RANGE_K
        ),
    ),
    candidacy=Candidacy(beside=frozenset({"convective_film"})),
    in_flight=InFlight(exchange=lambda p, stream, radius: temperature_ratio(stream, radius)),
)


# Boundary layer over the film: mass-transfer Biot number biot_at_5_m_s (v / 5 m/s)^1/2 between air and film.
#
# At low pressure vapour diffuses faster through a thicker layer: the number goes as pressure^-1/2.

VAPOUR_BOUNDARY_LAYER = Effect(
    id="vapour_boundary_layer",
    link="exchange",
    channels=("humidity",),
    equation="D dc/dx = h (c_air - c) at x = L, h L / D = Bi(5 m/s) (v / 5 m/s)^1/2 (1013.25 hPa / pressure)^1/2",
    source="laminar boundary layer; Carslaw and Jaeger 1959, section 3.11",
    parameters=(Parameter("biot_at_5_m_s", "1", 0.2, 400.0, (8.0, 40.0), log=True, none=None, weakest=40.0),),
    apply=lambda chain, p: replace(
        chain, biot=p["biot_at_5_m_s"] * vapour_ratio(Stream.of_runs(chain.channel.conditions))
    ),
    words=Words(
        (
            "Vapour has to cross a boundary layer before it reaches the film (Biot {biot_at_5_m_s} at 5 m/s): the rise "
            "starts late, later at low airflow."
        ),
        "Take off the filter cap or aspirate harder; state the airflow with every response time.",
    ),
    needs=Needs("needs runs whose airflow was recorded", lambda channel: bool(channel.conditions.airflow_known.all())),
    in_flight=InFlight(
        biot=lambda p, stream, thickness: p["biot_at_5_m_s"] * vapour_ratio(stream),
    ),
)


# A first-order lag in series with the body: a sheath, a housing, a vent or a filter cap that the air has to cross.

NO_LAG = 1.0 / 30.0  # of a lag: a body that is slower by less on average (an exponential: 95 % in a tenth) is none


def _before_nothing(channel: Channel, lag_s: float, bare: Callable[[], Array]) -> bool:
    """Whether the body behind a lag follows at once: such a sensor is a lump, and has one time constant.

    How late a response is on average is all that shows of what is much faster than the rest.
    """
    if channel.measured.any():
        return False
    reading = bare()
    first, last = reading[:, :1], reading[:, -1:]
    moved = (np.abs(last - first) > channel.quantity.least_step)[:, 0]
    left = 1.0 - (reading - first) / np.where(moved[:, None], last - first, 1.0)
    since = np.maximum.accumulate(np.where(channel.count > 0, channel.time_s, 0.0).clip(0.0), axis=1)
    late_s = (np.diff(since, axis=1, prepend=0.0) * left).sum(axis=1)
    return bool(moved.any() and (late_s[moved] < NO_LAG * lag_s).all())


SERIES_LAG = Effect(
    id="series_lag",
    link="exchange",
    channels=("temperature", "humidity"),
    equation="time_constant dT_inside/dt = T_air - T_inside, and the body follows T_inside",
    source="two lags in series; housings and caps of thermometers and hygrometers",
    parameters=(
        Parameter("time_constant_s", "s", 0.02, SLOWEST_S, (0.3, 3.0, 30.0), log=True, none=None, weakest=0.3),
    ),
    apply=lambda chain, p: replace(chain, series=(*chain.series, p["time_constant_s"])),
    words=Words(
        (
            "Something stands between the air and the body and follows it with a lag of {time_constant_s} s (a sheath, "
            "a housing, a vent, a cap), the same in every run."
        ),
        "Take off cap or sheath for a comparison, or fly with it on: the profile has it in.",
    ),
    candidacy=Candidacy(
        rare=lambda channel: channel.known_sensor,
        shape=True,
        refused=lambda channel, p, bare: _before_nothing(channel, p["time_constant_s"], bare),
        simple="lag",
    ),
    in_flight=InFlight(series_s=lambda p: p["time_constant_s"]),
)


# A sheath or a housing with heat (or vapour) of its own, which the body inside loads: it lags by what the body takes.
#
# `series_lag` is its limit for a capacity far above the body's; a film of air or vapour outside adds to the resistance.
# Both may stand beside it, and a search that took one of them for the sheath finds the way from there.

RIDGE_WIDTH = 2.5  # in ln of both
LOADED_RATIO = 2.0  # the body is about so much faster than sheath and body together were taken to be

SHEATH = Effect(
    id="sheath",
    link="exchange",
    channels=("temperature", "humidity"),
    equation=(
        "C_sheath dT_sheath/dt = C_sheath (T_air - T_sheath) / time_constant - heat into the body, C_sheath = capacity "
        "C_body, and the body's surface is at T_sheath"
    ),
    source="Carslaw and Jaeger 1959, section 1.9 (contact with a well-stirred fluid); sheathed thermometers",
    parameters=(
        Parameter(
            "time_constant_s", "s", 0.02, SLOWEST_S, (0.03, 0.1, 0.3, 1.0, 3.0), log=True, none=None, weakest=0.03
        ),
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
    candidacy=Candidacy(
        excludes=frozenset({"body_lumped"}),
        shape=True,
        # With a body that follows at once it is a lump that holds both.
        refused=lambda channel, p, bare: _before_nothing(
            channel, p["time_constant_s"] * (1.0 + 1.0 / p["capacity"]), bare
        ),
    ),
    in_flight=InFlight(loaded=lambda p: (p["time_constant_s"], p["capacity"])),
)


# Dew on the film: while the die is below the destination's dew point, and `drying_time_s` after, it sees saturated air.


def _wet(chain: Chain, p: Arrays) -> Chain:
    warm = chain.channel.wet_until_s
    return replace(chain, wet_until_s=np.where(np.isfinite(warm), np.nan_to_num(warm) + p["drying_time_s"], 0.0))


CONDENSATION = Effect(
    id="condensation",
    link="exchange",
    channels=("humidity",),
    equation="c(L, t) = saturation until the die passes the dew point, and drying_time longer",
    source="psychrometry; the die is the coldest part in the destination air",
    parameters=(Parameter("drying_time_s", "s", 0.2, 120.0, (5.0,), log=True, none=None),),
    apply=_wet,
    words=Words(
        (
            "Dew forms on the cold film: it sees saturated air until {drying_time_s} s after the die has passed the "
            "dew point."
        ),
        "Keep the sensor above the destination's dew point before the transfer.",
    ),
    needs=Needs(
        "needs runs from cold air into air whose dew point lies above the film's own temperature",
        lambda channel: bool((np.isfinite(channel.wet_until_s)).any()),
    ),
    in_flight=InFlight(left=True),
)


EFFECTS = (CONVECTIVE_FILM, EXCHANGE_TEMPERATURE, VAPOUR_BOUNDARY_LAYER, SERIES_LAG, SHEATH, CONDENSATION)
