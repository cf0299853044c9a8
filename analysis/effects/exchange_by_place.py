"""Some runs follow at another rate than the rest: where they end the air moves otherwise, or is no air.

A sensor that is carried between a room and a cold box meets two airs that nobody measured; one that is plunged and
taken out again meets water and air. What is told is the ratio alone: which runs are which is their direction, or shows
in the response times themselves (`Conditions.elsewhere`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.effect import Effect, Parameter
from shockrig.analysis.inference.media import as_fast_as_seen
from shockrig.analysis.physics.chain import Recorded

Mask = NDArray[np.bool_]
FEWEST = 2  # runs of either kind


def cools(channel: Recorded) -> Mask:
    """True for the runs (R,) in which the air gets colder."""
    return channel.conditions.destination_c < channel.conditions.source_c


def elsewhere(channel: Recorded) -> Mask:
    """True for the runs (R,) that end in another medium than the rest."""
    return channel.conditions.elsewhere


def _both(those: Mask) -> bool:
    return bool(min(those.sum(), (~those).sum()) >= FEWEST)


SLOWER_OR_FASTER = Parameter("ratio", "1", 0.005, 200.0, (0.7, 1.4), log=True, none=1.0)
EFFECTS = (
    Effect(
        id="direction_dependent_exchange",
        link="air",
        channels=("temperature",),
        parameters=(SLOWER_OR_FASTER,),
        apply=lambda chain, p: replace(chain, rate=chain.rate * np.where(cools(chain.channel), p["ratio"], 1.0)),
        sentence=(
            "The sensor follows {ratio} times as fast in cooling as in warming: where it ends up the air moves "
            "otherwise, or is no air."
        ),
        equation="rate(cooling) = ratio rate(warming)",
        source="two places: the exchange of a sensor is that of its air; Ranz and Marshall 1952",
        advice="Measure the airflow in both places, and state the response time of each.",
        of_sensor=False,
        start_from=as_fast_as_seen("ratio", cools, 0.02, 50.0),
        testable=lambda channel: not channel.conditions.airflow_known.any() and _both(cools(channel)),
        needs="needs two runs that cool and two that warm, in airs whose motion nobody recorded",
        own_rates=True,
        shape=True,
    ),
    Effect(
        id="other_medium",
        link="air",
        channels=("temperature",),
        parameters=(SLOWER_OR_FASTER,),
        apply=lambda chain, p: replace(chain, rate=chain.rate * np.where(elsewhere(chain.channel), p["ratio"], 1.0)),
        sentence=(
            "The runs are of two kinds: in some the sensor follows {ratio} times as fast as in the rest, in another "
            "medium (water and air), or on another sensor."
        ),
        equation="rate(these runs) = ratio rate(the rest)",
        source="two media: the exchange of a sensor is that of what it is in; Incropera et al. 2006, table 1.1",
        advice="Make a campaign of either kind: each has a response time of its own.",
        of_sensor=False,
        start_from=as_fast_as_seen("ratio", elsewhere, 0.02, 50.0),
        testable=lambda channel: _both(elsewhere(channel)),
        needs="needs runs in two groups whose response times no recorded condition explains",
        own_rates=True,
        shape=True,
    ),
)
