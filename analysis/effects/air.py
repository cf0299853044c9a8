"""The air that reaches the probes: how a transfer, a chamber or another place brings it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import (
    SLOWEST_S,
    Candidacy,
    Effect,
    Needs,
    Parameter,
    Readout,
    Start,
    Words,
)
from shockrig.analysis.estimate.without_model import FEWEST_RUNS, as_fast_as_seen
from shockrig.analysis.physics.chain import Recorded, RoomAir

Array = NDArray[np.float64]

# The transfer takes time: the air at the probes changes linearly over `duration_s` from the transfer's start.
#
# Where all runs state a measured duration, each run's ramp is in proportion to its own and `duration_s` is the median
# run's; those that were slowed on purpose, or alone state one, have just that duration, in the plain model too.


def _triggered(channel: Channel) -> bool:
    return bool((channel.conditions.start_known & ~channel.measured).any())


FINITE_TRANSFER = Effect(
    id="finite_transfer",
    link="air",
    channels=("temperature", "humidity"),
    equation="air(t) = source + (destination - source) min(t / duration, 1)",
    source="ramp response: integral of the step response over the duration",
    parameters=(Parameter("duration_s", "s", 0.02, 8.0, (0.06, 0.3, 1.0)),),
    apply=lambda chain, p: replace(chain, ramp_s=chain.channel.conditions.ramps_s(p["duration_s"])),
    words=Words(
        "The air does not change in an instant: the transfer takes {duration_s} s.",
        "Move the probes faster, or log both ends of the transfer so that its duration is known.",
    ),
    needs=Needs("needs runs whose start was recorded: a slow transfer and a late start look alike", _triggered),
    readout=Readout(like_average=lambda p, period_s: {int(p["duration_s"] / period_s) + k for k in (0, 1, 2)}),
)


# Room air let in at the transfer decays: share `fraction` exp(-t / `time_constant_s`) of air at the room's state.


def _recorded(channel: Channel) -> NDArray[np.bool_]:
    air = channel.conditions
    return air.airs_known & air.start_known & ~channel.measured


AIR_RELAXATION = Effect(
    id="air_relaxation",
    link="air",
    channels=("temperature", "humidity"),
    equation="air(t) = destination + fraction exp(-t / time_constant) (room - destination)",
    source="well-mixed chamber; vapour pressure mixes linearly",
    parameters=(
        Parameter("fraction", "1", 0.001, 0.5, (0.03,), percent=True),
        Parameter("time_constant_s", "s", 0.3, 90.0, (3.0, 12.0), log=True, none=None),
        Parameter("room_temperature_c", "degC", -10.0, 45.0, (22.0,), none=None, prior=(21.0, 8.0)),
        Parameter("room_humidity_percent", "%RH", 0.0, 100.0, (45.0,), none=None, prior=(45.0, 20.0)),
    ),
    apply=lambda chain, p: replace(
        chain,
        rooms=(
            *chain.rooms,
            RoomAir(p["fraction"], p["time_constant_s"], p["room_temperature_c"], p["room_humidity_percent"]),
        ),
    ),
    words=Words(
        (
            "Room air comes in with the probes: {fraction} of the destination air at first, "
            "gone with {time_constant_s} s."
        ),
        "Seal the transfer port, raise the chamber's airflow, or bring the room to the destination's state.",
    ),
    needs=Needs(
        "needs runs whose airs and starts were recorded, and whose air was not measured all along",
        lambda channel: bool(_recorded(channel).any()),
    ),
)


# A sensor that goes back and forth between two places: in one of them it follows at another rate, or the air is late.
#
# One that is carried between a room and a cold box meets two airs that nobody measured; one that is plunged and taken
# out again meets water and air. Which runs are which is their direction, or shows in the response times themselves
# (`Conditions.elsewhere`).

Mask = NDArray[np.bool_]
AT_ONCE = 1e-4  # of the time constant: a lag that is none


def cools(channel: Recorded) -> Mask:
    """True for the runs (R,) in which the air gets colder."""
    return channel.conditions.destination_c < channel.conditions.source_c


def elsewhere(channel: Recorded) -> Mask:
    """True for the runs (R,) that end in another medium than the rest."""
    return channel.conditions.elsewhere


def warms(channel: Recorded) -> Mask:
    """True for the runs (R,) in which the air gets warmer."""
    return ~cools(channel)


def _both(those: Mask) -> bool:
    return bool(min(those.sum(), (~those).sum()) >= FEWEST_RUNS)


def _unmeasured_both_ways(channel: Channel) -> bool:
    """Whether two runs cool and two warm, in airs whose motion and course nobody recorded."""
    unknown = not channel.conditions.airflow_known.any() and not channel.measured.any()
    return unknown and _both(cools(channel))


# Between two unmeasured places one difference can be told. A second one is a lag of the sensor's own by another name:
# air that is late both ways lags as a sensor does that follows at two rates behind a housing.
OF_TWO_PLACES = ("direction_dependent_exchange", "slow_air_in_cooling", "slow_air_in_warming")


def _alone(id_: str) -> Candidacy:
    return Candidacy(shape=True, excludes=frozenset(OF_TWO_PLACES) - {id_})


def _late_air(id_: str, when: str, those: Callable[[Recorded], Mask]) -> Effect:
    return Effect(
        id=id_,
        link="air",
        channels=("temperature",),
        equation=f"air(t) = destination + (source - destination) exp(-t / time_constant) in the runs that {when}",
        source="well-mixed chamber",
        parameters=(Parameter("time_constant_s", "s", 0.02, SLOWEST_S, (0.3, 3.0, 30.0), log=True, none=None),),
        apply=lambda chain, p: replace(
            chain,
            series=(*chain.series, p["time_constant_s"] * np.where(those(chain.channel), 1.0, AT_ONCE)),
        ),
        words=Words(
            (
                f"In the runs that {when} the air takes its time: it comes to its new state with {{time_constant_s}} s "
                "(a box that recovers from its open door, a chamber that mixes slowly)."
            ),
            "Put a fast sensor beside this one, so that the air is measured, or let the box come to rest first.",
        ),
        needs=Needs(BOTH_WAYS, _unmeasured_both_ways),
        start=Start(own_rates=True),
        candidacy=_alone(id_),
    )


BOTH_WAYS = "needs two runs that cool and two that warm, in airs that nobody measured"
SLOWER_OR_FASTER = Parameter("ratio", "1", 0.005, 200.0, (0.7, 1.4), log=True, none=1.0)
TWO_PLACES = (
    Effect(
        id="direction_dependent_exchange",
        link="air",
        channels=("temperature",),
        equation="rate(cooling) = ratio rate(warming)",
        source="two places: the exchange of a sensor is that of its air; Ranz and Marshall 1952",
        parameters=(SLOWER_OR_FASTER,),
        apply=lambda chain, p: replace(chain, rate=chain.rate * np.where(cools(chain.channel), p["ratio"], 1.0)),
        words=Words(
            (
                "The sensor follows {ratio} times as fast in cooling as in warming: where it ends up the air moves "
                "otherwise, or is no air."
            ),
            "Measure the airflow in both places, and state the response time of each.",
        ),
        needs=Needs(BOTH_WAYS, _unmeasured_both_ways),
        start=Start(from_data=as_fast_as_seen("ratio", cools, 0.02, 50.0), own_rates=True),
        candidacy=_alone("direction_dependent_exchange"),
    ),
    Effect(
        id="other_medium",
        link="air",
        channels=("temperature",),
        equation="rate(these runs) = ratio rate(the rest)",
        source="two media: the exchange of a sensor is that of what it is in; Incropera et al. 2006, table 1.1",
        parameters=(SLOWER_OR_FASTER,),
        apply=lambda chain, p: replace(chain, rate=chain.rate * np.where(elsewhere(chain.channel), p["ratio"], 1.0)),
        words=Words(
            (
                "The runs are of two kinds: in some the sensor follows {ratio} times as fast as in the rest, in "
                "another medium (water and air), or on another sensor."
            ),
            "Make a campaign of either kind: each has a response time of its own.",
        ),
        needs=Needs(
            "needs runs in two groups whose response times no recorded condition explains",
            lambda channel: _both(elsewhere(channel)),
        ),
        start=Start(from_data=as_fast_as_seen("ratio", elsewhere, 0.02, 50.0), own_rates=True),
        candidacy=Candidacy(shape=True),
    ),
    _late_air("slow_air_in_cooling", "cool", cools),
    _late_air("slow_air_in_warming", "warm", warms),
)


EFFECTS = (FINITE_TRANSFER, AIR_RELAXATION, *TWO_PLACES)
