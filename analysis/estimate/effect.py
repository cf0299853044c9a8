"""What an effect is: one change to one link of the chain, with everything that is peculiar to it.

Nothing outside of an effect's own file knows its name; whoever asks, asks for what stands here.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.chain import Chain
from shockrig.files.ranges import RANGES

Array = NDArray[np.float64]
Link = Literal["air", "exchange", "body", "readout", "logger"]
Values = Mapping[str, float]
Arrays = Mapping[str, NDArray[np.float64]]  # of candidates, each (B, 1)
RARE_PENALTY = 8.0  # added to the penalty of what real benches hardly ever have: odds of one in fifty

TINY_STRENGTH = 1e-9  # of an effect that is none
DIFFERS_BY = "run_order"  # the factor by which a strength that differs by chance is said to do so
SLOWEST_S = RANGES["step_s"].high  # of a lag: as long as a step of any protocol
WITHIN_ENDS = 2.0  # a start's ratio to the ends of its range, at least


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit : str
    low, high : float
        Ends of its range.
    starts : tuple of float
        Values that a fit begins from.
    log : bool
        Whether a positive scale is fitted in its logarithm.
    none : float or None
        The value at which the effect vanishes, where it has one.
    weakest : float or None
        The start at which the effect changes least, where that is not the first: first-order scores are taken there.
    prior : (mean, standard deviation) or None
        What is known of it before any data.
    percent : bool
        Whether reports write it in percent.
    ends_say : bool
        Whether an end of its range says something: that what it compares is there on one side alone.
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...]
    log: bool = False
    none: float | None = 0.0
    weakest: float | None = None
    prior: tuple[float, float] | None = None
    percent: bool = False
    ends_say: bool = False

    def encoded(self, value: float) -> float:
        """A value on the scale that is fitted."""
        return float(np.log(value)) if self.log else value

    def starts_for(self, tempo: float) -> tuple[float, ...]:
        """Values to begin from with a sensor so much slower than the ordinary ones: its time constants are as well."""
        if not self.log or self.unit != "s":
            return self.starts
        inside = WITHIN_ENDS * self.low, self.high / WITHIN_ENDS  # a fit that begins at an end stays there
        return tuple(dict.fromkeys(float(np.clip(start * tempo, *inside)) for start in self.starts))


@dataclass(frozen=True)
class Finding:
    """What the readings themselves show: an effect's id, its parameters as (value, standard uncertainty), evidence."""

    effect: str
    parameters: dict[str, tuple[float, float]]
    evidence: str


@dataclass(frozen=True)
class SingleReadings:
    """What is known of a channel's single readings: what they are rounded to, their noise, and the channel itself."""

    channel: Channel
    step: float = 0.0
    noise: Noise | None = None


@dataclass(frozen=True)
class InFlight:
    """What an effect means for a correction, by functions of its parameters' values; None where it means nothing.

    Attributes
    ----------
    body : str
        The shape of the sensing body, where it is another than the profile states.
    series_s : values -> time constant [s]
        A first-order lag in series with the body.
    series_along, rate : (values, airspeed (n,) [m/s], temperature (n,) [degC]) -> ndarray (n,)
        By what that lag's time constant, and the body's rate, are multiplied along the flight.
    loaded : values -> (time constant [s], capacity relative to the body's)
        A sheath: a well-mixed layer around the body that the body loads.
    biot : (values, stream (n,), body's length [m]) -> ndarray (n,)
        Biot number of the exchange along the flight.
    exchange : (values, stream (n,), body's length [m]) -> ndarray (n,)
        What the Biot number of another effect is multiplied by along the flight.
    lag : values -> (share, time constant [s], ...)
        A part of the reading that follows as a first-order lag, or as several in equal shares.
    undo : (values, reading, stream, body's length) -> reading
        Takes off what the readout added.
    carried : (values, vertical speed (n,) [m/s], airspeed (n,) [m/s], NaN where unknown) -> ndarray (n,)
        What the carrier adds to the air around the sensor.
    delay_s : (values, sampling period [s]) -> float
    noise : values -> float
        Standard deviation added to a reading.
    ceiling : values -> float
        Readings at or above it say only that the air is as humid.
    uncertainty : values -> float
        Standard uncertainty of what cannot be undone.
    at_die : bool
        Whether vapour is turned into humidity at the sensor's own temperature.
    die_share : values -> float
        How far from the air's temperature to its own, where not all the way.
    film_c : (values, time (n,) [s], bead's reading (n,) [degC]) -> ndarray (n,)
        Its own temperature, where the bead's tells it.
    activity : values -> float
        From 0, where the film takes up the vapour in the air, to 1, where by the humidity at its own temperature.
    left : bool
        Whether it is left in the reading, and said to be.
    """

    body: str = ""
    biot: Callable[[Values, Stream, float], Array] | None = None
    series_s: Callable[[Values], float] | None = None
    series_along: Callable[[Values, Array, Array], Array] | None = None
    rate: Callable[[Values, Array, Array], Array] | None = None
    loaded: Callable[[Values], tuple[float, float]] | None = None
    exchange: Callable[[Values, Stream, float], Array] | None = None
    lag: Callable[[Values], tuple[float, ...]] | None = None
    undo: Callable[[Values, Array, Stream, float], Array] | None = None
    carried: Callable[[Values, Array, Array], Array] | None = None
    delay_s: Callable[[Values, float], float] | None = None
    noise: Callable[[Values], float] | None = None
    ceiling: Callable[[Values], float] | None = None
    uncertainty: Callable[[Values], float] | None = None
    at_die: bool = False
    die_share: Callable[[Values], float] | None = None
    film_c: Callable[[Values, Array, Array], Array] | None = None
    activity: Callable[[Values], float] | None = None
    left: bool = False


@dataclass(frozen=True)
class Words:
    """What a report says: a sentence with {name} places for parameters, and what to do about it on the bench."""

    sentence: str
    advice: str


@dataclass(frozen=True)
class Needs:
    """What a campaign must have for an effect to act at all: in words for the report, and channel -> bool."""

    words: str
    met: Callable[[Channel], bool]


@dataclass(frozen=True)
class Start:
    """Where a fit with the effect begins, where its parameters' own starts are not enough.

    Attributes
    ----------
    from_data : channel -> {parameter: start}
        A start that only the data can give, in place of those of the parameters; empty where they give none.
    rate_factor : channel -> float
        By how much the rate is larger with the effect than without.
    own_rates : bool
        Whether the rate without it says nothing of that with it: a fit begins from rates and starts of its own.
    nudges : channel -> ({parameter: offset}, ...)
        Where the objective has steps or ridges, starts beside the one found from which the fit is finished.
    mirrors : bool
        Whether it is a share (`fraction`) that follows with a `time_constant_s` beside the body: of two alike, either
        can be called the body, and a share at the end of its range may be the other one.
    always : bool
        Whether a first-order score says nothing of it, so that a fit is always begun.
    """

    from_data: Callable[[Channel], Values] | None = None
    rate_factor: Callable[[Channel], float] | None = None
    own_rates: bool = False
    nudges: Callable[[Channel], Sequence[Mapping[str, float]]] | None = None
    mirrors: bool = False
    always: bool = False


@dataclass(frozen=True)
class Candidacy:
    """How an effect stands among the candidates.

    Attributes
    ----------
    rare : channel -> bool
        Where real benches hardly ever have it.
    excludes, beside : frozenset of str
        Effects that cannot stand beside it, and those of which one has to be in the model for it to do anything.
    shape : bool
        Whether it only says how the response behaves, and not what makes it behave so.
    refused : (channel, {parameter: value}, bare) -> bool
        True where a fit that ends there is no finding, whatever it gains; `bare()` is what the same fit would read
        (R, n) without the effect, in the airs as they were stated.
    simple : str
        What it is in the response models that one would fit without a catalogue: the "body" with one lag, a "lag" more,
        or the "line" that readings lie on; empty for what is in none of them.
    """

    rare: Callable[[Channel], bool] | None = None
    excludes: frozenset[str] = frozenset()
    beside: frozenset[str] = frozenset()
    shape: bool = False
    refused: Callable[[Channel, Values, Callable[[], Array]], bool] | None = None
    simple: Literal["body", "lag", "line", ""] = ""


@dataclass(frozen=True)
class Readout:
    """What an effect does to single readings, their noise and their times.

    Attributes
    ----------
    in_readings, in_noise : Readings -> (Readings, Finding or None), Finding or None
        For what single readings show (repeats, rounding, flat tops) before, and (averages) after the noise is known.
    dated : (times, readings, period [s], values) -> times
        When the readings of a log were fresh.
    rounded_to, averages : values -> float, int
        What it means for the noise: a rounding step, a number of readings in a mean.
    like_average : (values, period [s]) -> set of int
        Lengths of a running mean that would look alike.
    thermal : str
        How a thermal shock reads with it, where that is a choice for ambients with thermal shocks alone.
    """

    in_readings: Callable[[SingleReadings], tuple[SingleReadings, Finding | None]] | None = None
    in_noise: Callable[[SingleReadings], Finding | None] | None = None
    dated: Callable[[Array, Array, float, Values], Array] | None = None
    rounded_to: Callable[[Values], float] | None = None
    averages: Callable[[Values], int] | None = None
    like_average: Callable[[Values, float], set[int]] | None = None
    thermal: str = ""


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue: an equation and its source, a few words, and the parts in which it is peculiar.

    Attributes
    ----------
    id, link, channels : str, str, tuple of str
        Its name, the link of the chain that it changes, and the channels in which it can be seen.
    equation, source : str
        The equation added, and where it comes from.
    parameters : tuple of Parameter
    apply : (chain, {name: ndarray (B, 1)}) -> chain
        The chain with the effect added.
    needs : Needs or None
        None where it may act in any campaign.
    in_flight : InFlight or None
        How a correction treats it; None where it is the bench's or its logger's, and does not fly.
    surroundings : bool
        Whether what is around the probes does it, though another link than the air shows it.
    order : int
        Its place in the chain, set by the catalogue.
    scatters : bool
        Whether its strength differs from run to run by chance, with a standard deviation that is estimated.
    differs_in : str
        The parameter that does; empty where it is a factor of the body's rate.
    """

    id: str
    link: Link
    channels: tuple[ChannelName, ...]
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[Chain, Arrays], Chain]
    words: Words
    needs: Needs | None = None
    start: Start = Start()
    candidacy: Candidacy = Candidacy()
    readout: Readout = Readout()
    in_flight: InFlight | None = None
    surroundings: bool = False
    order: int = 0
    scatters: bool = False
    differs_in: str = ""

    @property
    def of_sensor(self) -> bool:
        """Whether it belongs to the sensor, and not to the bench or its logger: the sensor is what flies."""
        return self.in_flight is not None

    @property
    def of_surroundings(self) -> bool:
        """Whether all probes that are side by side feel it alike: the air does it, or what is around them."""
        return self.surroundings or self.link == "air"

    @property
    def fitted(self) -> bool:
        """Whether the mean response shows it, so that a fit finds its parameters."""
        return self.apply is not unchanged and self.readout.averages is None

    def acts_in(self, channel: Channel) -> bool:
        """Whether it belongs to the channel and the campaign's conditions let it act."""
        return channel.name in self.channels and (self.needs is None or self.needs.met(channel))

    def rarity(self, channel: Channel) -> float:
        """What is added to its penalty in a channel."""
        return RARE_PENALTY if self.candidacy.rare is not None and self.candidacy.rare(channel) else 0.0

    def starts(self, channel: Channel) -> list[dict[str, float]]:
        """Parameter values to begin a fit from: one set that the data tell, or all that are declared."""
        told = dict(self.start.from_data(channel)) if self.start.from_data else {}
        if told:
            return [told]
        names = [p.name for p in self.parameters]
        starts = (p.starts_for(channel.tempo) for p in self.parameters)
        return [dict(zip(names, v, strict=True)) for v in itertools.product(*starts)]

    def parameter(self, name: str) -> Parameter:
        """A parameter by name."""
        return next(p for p in self.parameters if p.name == name)


def by_name(effect: Effect, values: Values) -> dict[str, float]:
    """An effect's values under the names that a model of several effects has for them."""
    return {f"{effect.id}.{name}": value for name, value in values.items()}


def unchanged(chain: Chain, values: Arrays) -> Chain:
    """The chain as it is, for effects of the single readings that leave the mean response alone."""
    return chain
