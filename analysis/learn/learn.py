"""What flights say of their sensor: all models in one race, judged by flights that were not fitted.

binned -> each channel's models fitted to all flights -> with the clock, both channels at once
       -> density of each flight given those before it -> weights of models -> verdicts
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.predictive import weights
from shockrig.analysis.learn.bins import CHANNELS, FlightBins, binned, why_nothing
from shockrig.analysis.learn.density import FlightChannelData, prepared
from shockrig.analysis.learn.flights_fit import (
    Learned,
    climbed,
    explored,
    fitted,
    hopeful,
    known_air,
    known_of,
    started,
)
from shockrig.analysis.learn.laws import LAWS, Law, LawParameter
from shockrig.analysis.learn.passes import Disagreement, NearerPasses, disagreement, gain_of, refutes
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.files.learned import RivalModel
from shockrig.files.legs import too_far_apart

Array = NDArray[np.float64]

FLIGHT_BINS = 128  # of a flight
FULL_RACE = 6  # flights on which all models race; more are weighed by the finalists alone
FINALIST_LAWS = 2  # of each channel, beside nothing and one lag, and of both at once
FAR_BEHIND_NATS = 5.0  # on the flights of the race: what is so far behind there will not be ahead on all
NAMED_FROM = 0.95  # probability from which a law is named
POSSIBLE_FROM = 0.1  # probability from which it stands among what may be
LAW_LOG_PRIOR = -2.5  # nats that a law beyond a lag has to gain
USUAL_LAG_S = {"temperature": 4.0, "humidity": 8.0}  # that flights which say nothing leave possible
UNLIKE_SPEEDS = 1.5  # ratio of the speeds of passes from which they are more than one

# What is fitted to each channel beside nothing and one lag: names of its laws, with the first of which others begin.
MODELS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "temperature": (
        ("lag_in_the_cold",),
        ("second_path",),
        ("offset_in_descent",),
        ("ventilated_warmth",),
        ("lag", "offset_in_descent"),
        ("lag", "ventilated_warmth"),
    ),
    "humidity": (
        ("lag_in_the_cold",),
        ("second_path",),
        ("warm_die",),
        ("late_die",),
        ("lag", "offset_in_descent"),
        ("lag", "film_unlike_in_descent"),
        ("lag", "warm_die"),
        ("lag", "late_die"),
    ),
}
CLOCK = LAWS["position.clock_offset"]


@dataclass(frozen=True)
class LearnedNumber:
    """A number of a law, in its own unit: value and standard uncertainty."""

    parameter: LawParameter
    value: float
    standard_uncertainty: float

    @property
    def name(self) -> str:
        """The parameter's."""
        return self.parameter.name

    @property
    def unit(self) -> str:
        """The parameter's."""
        return self.parameter.unit


@dataclass(frozen=True)
class FlightCause:
    """A law that may act: its probability, what would give it, its numbers under the likeliest model that has it."""

    law: Law
    probability: float
    parameters: tuple[LearnedNumber, ...]


@dataclass(frozen=True)
class ChannelLearned:
    """What flights say of one channel.

    Attributes
    ----------
    channel : str
    verdict : str
        "named", "tied", "not identifiable" or "adequate".
    causes : tuple of FlightCause
        Most probable first; those that are named, or tied.
    rivals : tuple of RivalModel
        Models that may be right, most probable first; at least two where the channel is tied or not identifiable.
    refuted : tuple of str
        Models that make passes less alike in structure than they are as read.
    limit_s : float
        Up to where a single lag may be (95 %).
    why : str
        Why a lag is not identifiable, or what cannot be told apart.
    fit : Learned
        The model with the largest weight.
    lag : Learned
        One lag alone: what a user would fit.
    read, single, model : Disagreement
        How far passes of the same flight disagree as read, and corrected on flights that were not fitted.
    """

    channel: str
    verdict: str
    causes: tuple[FlightCause, ...]
    rivals: tuple[RivalModel, ...]
    refuted: tuple[str, ...]
    limit_s: float
    why: str
    fit: Learned
    lag: Learned
    read: Disagreement
    single: Disagreement
    model: Disagreement

    def together(self, causes: Sequence[FlightCause]) -> tuple[list[FlightCause], list[FlightCause]]:
        """Those of the causes that the likeliest model has at once, and those that it does not have."""
        both = [cause for cause in causes if cause.law in self.fit.laws]
        return both, [cause for cause in causes if cause not in both]

    @property
    def gain(self) -> NearerPasses | None:
        """What the likeliest model will bring on a flight to come."""
        return gain_of(self.read, self.model)

    @property
    def gains(self) -> bool:
        """Whether passes of flights that were not fitted are more alike with the model than as read.

        In structure, since a lag takes any mean for its own. Where the model has an offset, in all: an offset is a
        mean, and one that is not another flight's moves its passes apart.
        """
        offset = any(law.offset is not None and law.channel == self.channel for law in self.fit.laws)
        unseen, read = len(set(self.read.flight)) > 1, self.read.where(self.model)
        return self.model.rms < read.rms if offset and unseen else self.model.spread < read.spread


@dataclass(frozen=True)
class FlightsLearned:
    """What flights say of their sensor.

    `position` holds the shift of the track where it is named or may be; `left_out` names flights that say nothing, and
    why; `bins` the flights as they were used.
    """

    bins: tuple[FlightBins, ...]
    left_out: Mapping[str, str]
    channels: Mapping[str, ChannelLearned]
    position: tuple[FlightCause, ...] = ()
    position_named: bool = False
    weights: tuple[tuple[str, float], ...] = field(default=())


def learn(
    flights: Mapping[str, Flight],
    stated: Mapping[str, tuple[float, float]] | None = None,
    progress: Callable[[str], None] = lambda said: None,
) -> FlightsLearned:
    """Learn from flights of one sensor, by name.

    Parameters
    ----------
    flights : mapping of name -> Flight
    stated : mapping, optional
        What a bench has found: channel.parameter -> mean and standard deviation on the scale that is fitted.
    progress : callable
        Is told what is being done.

    Raises
    ------
    InputError
        No flight passes the same air twice.
    """
    used, left_out = _passing_twice(flights)
    units = {c: [prepared(one, c) for one in used if one.has(c)] for c in CHANNELS}
    channels = [c for c in CHANNELS if units[c]]
    names = [one.name for one in used]
    racing = names[:: -(-len(names) // FULL_RACE)]
    few = {c: [unit for unit in units[c] if unit.bins.name in racing] or units[c] for c in channels}
    raced = {c: _raced(c, few[c], stated, progress) for c in channels}
    progress("the position's clock")
    joint = _with_clock(channels, raced, few, stated)
    if len(racing) < len(names):
        progress("finalists on all flights")
        raced, joint = _finalists(raced, joint, few, units, stated)
    lags = {c: next(one for one in raced[c] if [law.key for law in one.laws] == ["lag"]) for c in channels}
    progress("what the structure of the passes refutes")
    refuted: dict[str, tuple[str, ...]] = {}
    read = {c: disagreement(units[c], None, c) for c in channels}
    off: dict[str, dict[int, Disagreement]] = {}  # under each fit
    for c in channels:
        off[c] = {id(one): disagreement(units[c], one, c) for one in (*raced[c], *joint)}
        out = [one for one in raced[c] if one.laws and refutes(read[c], off[c][id(one)])]
        refuted[c] = tuple(" and ".join(law.key for law in one.laws) for one in out)
        raced[c] = [one for one in raced[c] if all(one is not other for other in out)]
        joint = [one for one in joint if not refutes(read[c], off[c][id(one)])]
    models: list[tuple[Learned, ...]] = [*product(*(raced[c] for c in channels)), *[(one,) for one in joint]]
    # Each sensor of each flight counts by itself: what makes one of them say too much, the other need not.
    scores = [np.concatenate([part.predicted() for part in model]) for model in models]
    priors = [LAW_LOG_PRIOR * sum(law.key != "lag" for law in _laws_of(model)) for model in models]
    weight = weights(scores, priors)
    found = {
        c: judged(c, channels, models, weight, lags[c], refuted[c], used, units[c], read[c], off[c]) for c in channels
    }
    clock, position = clock_of(models, weight)
    table = sorted(
        (
            (" + ".join(law.name for law in _laws_of(m)) or "nothing", float(w))
            for w, m in zip(weight, models, strict=True)
        ),
        key=lambda row: -row[1],
    )
    return FlightsLearned(used, left_out, found, position, clock >= NAMED_FROM, tuple(table[:12]))


def _passing_twice(flights: Mapping[str, Flight]) -> tuple[tuple[FlightBins, ...], dict[str, str]]:
    """Flights that pass the same air twice, and why the others do not."""
    left_out = {name: why for name, flight in flights.items() if (why := why_nothing(flight))}
    used = tuple(binned(flight, name, FLIGHT_BINS) for name, flight in flights.items() if name not in left_out)
    alone = [one.name for one in used if len(one.passes) < 2]
    left_out |= {name: "it passes no air twice: an ascent needs its descent" for name in alone}
    used = tuple(one for one in used if one.name not in alone)
    if not used:
        whys = "; ".join(f"{name}: {why}" for name, why in left_out.items())
        raise InputError(f"{whys}; give flights that go up and come down again through the same air")
    return used, left_out


def clock_of(models: Sequence[tuple[Learned, ...]], weight: Array) -> tuple[float, tuple[FlightCause, ...]]:
    """How probable a shift of the track is, and what it is where it may be; `models` hold their laws in their parts."""
    having = [
        (float(w), i) for i, (w, model) in enumerate(zip(weight, models, strict=True)) if CLOCK in _laws_of(model)
    ]
    probability = sum(w for w, _ in having)
    if probability < POSSIBLE_FROM:
        return probability, ()
    return probability, (FlightCause(CLOCK, probability, parameters_of(models[max(having)[1]][0], CLOCK)),)


def _laws_of(model: tuple[Learned, ...]) -> tuple[Law, ...]:
    return tuple(law for part in model for law in part.laws)


def _raced(
    channel: str,
    units: list[FlightChannelData],
    stated: Mapping[str, tuple[float, float]] | None,
    progress: Callable[[str], None],
) -> list[Learned]:
    """Models of a channel, fitted to flights: nothing, one lag, and the others that are not hopeless."""
    lag = LAWS[f"{channel}.lag"]
    progress(f"{channel}: one lag")
    nothing = fitted((), units, np.array([]), None, stated)
    alone = explored((lag,), units, started(lag), stated)
    first = climbed(alone, units, stated)
    tried = []
    begins: dict[tuple[Law, ...], Learned] = {}
    for keys in MODELS[channel]:
        laws = tuple(LAWS[f"{channel}.{key}"] for key in keys)
        progress(f"{channel}: {' and '.join(keys).replace('_', ' ')}")
        lagging = laws[0].lags is not None
        begins[laws] = first if lagging else nothing
        starts = _beside(laws, first, stated) if lagging else started(laws[0])
        tried.append(explored(laws, units, starts, stated, begins[laws]))
    others = [climbed(ends, units, stated, begins[ends[0].laws]) for ends in hopeful(tried, units, first)]
    return [nothing, first, *others]


def _finalists(
    raced: Mapping[str, list[Learned]],
    joint: list[Learned],
    few: Mapping[str, list[FlightChannelData]],
    units: Mapping[str, list[FlightChannelData]],
    stated: Mapping[str, tuple[float, float]] | None,
) -> tuple[dict[str, list[Learned]], list[Learned]]:
    """Models of each channel, and of all at once, that go on from the flights of the race to all: fitted to those."""
    joint = _likeliest(joint, sum(max(float(one.predicted().sum()) for one in raced[c]) for c in raced))
    finals = {c: [*raced[c][:2], *_likeliest(raced[c][2:])] for c in raced}  # nothing and one lag are always told
    found = {c: _on_all(finals[c], few[c], units[c], stated) for c in raced}
    every, raced_on = ([unit for c in raced for unit in some[c]] for some in (units, few))
    return found, [fitted(one.laws, every, one.theta, known_air(one, raced_on, every), stated) for one in joint]


def _on_all(
    finals: Sequence[Learned],
    few: list[FlightChannelData],
    units: list[FlightChannelData],
    stated: Mapping[str, tuple[float, float]] | None,
) -> list[Learned]:
    """Models fitted to all flights: nothing and one lag from the air of the race, others from that of the lag."""
    nothing, lag = (fitted(one.laws, units, one.theta, known_air(one, few, units), stated) for one in finals[:2])
    return [nothing, lag, *(fitted(one.laws, units, one.theta, lag, stated) for one in finals[2:])]


def _likeliest(fits: Sequence[Learned], best: float = -np.inf) -> list[Learned]:
    """The models that go on to all flights: those least behind, and not far behind the best on the flights raced on."""
    likely = {i: float(one.predicted().sum()) for i, one in enumerate(fits)}
    best = max([best, *likely.values()])
    ranked = sorted(likely, key=lambda i: -likely[i])
    return [fits[i] for i in ranked[:FINALIST_LAWS] if likely[i] > best - FAR_BEHIND_NATS]


def _beside(laws: tuple[Law, ...], lag: Learned, stated: Mapping[str, tuple[float, float]] | None) -> list[Array]:
    """Starts of laws that have the lag's time constant: where the lag alone ended, and a usual one, since alone it may
    have taken for its own what the others do."""
    others = [known.parameter for known in known_of(laws) if known.name != "time_constant_s"]
    grid = np.array(np.meshgrid(*[[p.encoded(s) for s in p.starts] for p in others], indexing="ij"))
    usual = known_of(lag.laws, stated)[0].mean
    return [np.r_[tau, row] for tau in (lag.theta[0], usual) for row in grid.reshape(len(others), -1).T]


def _plain(channels: Sequence[str], raced: Mapping[str, list[Learned]]) -> tuple[list[Learned], list[Learned]]:
    """Nothing, and one lag, of each channel."""
    nothing = [next(one for one in raced[c] if not one.laws) for c in channels]
    return nothing, [next(one for one in raced[c] if [law.key for law in one.laws] == ["lag"]) for c in channels]


def _together(parts: Sequence[Learned]) -> Learned:
    """The air of channels that were fitted apart, from which a fit of both begins."""
    return replace(parts[0], sizes=tuple(size for part in parts for size in part.sizes))


def _with_clock(
    channels: Sequence[str],
    raced: Mapping[str, list[Learned]],
    units: Mapping[str, list[FlightChannelData]],
    stated: Mapping[str, tuple[float, float]] | None,
) -> list[Learned]:
    """The clock beside lags of all channels at once, then with one channel's lag left out or another's best model."""
    every = [unit for c in channels for unit in units[c]]
    nothing, lag = _plain(channels, raced)
    best = [
        max(raced[c], key=lambda one: float(one.predicted().sum()) + LAW_LOG_PRIOR * len(one.laws)) for c in channels
    ]
    others = [(i, other[i]) for other in (nothing, best) for i in range(len(channels))]
    combined = [lag, *([*lag[:i], other, *lag[i + 1 :]] for i, other in others)]
    tried: dict[tuple[Law, ...], list[Learned]] = {}
    found: list[Learned] = []
    for parts in combined:
        laws = (CLOCK, *[law for part in parts for law in part.laws])
        if laws in tried:
            continue
        rest = np.concatenate([part.theta for part in parts])
        # Lags that were fitted without the clock have taken a part of it for theirs: usual ones are tried as well.
        usual = np.array([known.mean for known in known_of(laws, stated)])[1:]
        starts = [found[0].theta[:1]] if found else started(CLOCK)
        begin = found[0] if found else None
        tried[laws] = explored(laws, every, [np.r_[s, lags] for s in starts for lags in (rest, usual)], stated, begin)
        if not found:
            found.append(climbed(tried[laws], every, stated))
    beside = list(tried.values())[1:]
    return found + [climbed(ends, every, stated, found[0]) for ends in hopeful(beside, every, found[0])]


def parameters_of(fit: Learned, law: Law) -> tuple[LearnedNumber, ...]:
    covariance = fit.covariance
    at, found = 0, []
    for one in fit.laws:
        for parameter in one.parameters:
            if one is law:
                value, sigma = parameter.decoded(float(fit.theta[at])), float(np.sqrt(covariance[at, at]))
                found.append(LearnedNumber(parameter, value, sigma * (value if parameter.log else 1.0)))
            at += 1
    return tuple(found)


def judged(
    channel: str,
    channels: Sequence[str],
    models: Sequence[tuple[Learned, ...]],
    weight: Array,
    lag: Learned,
    refuted: tuple[str, ...],
    used: Sequence[FlightBins],
    units: list[FlightChannelData],
    read: Disagreement,
    off: Mapping[int, Disagreement],
) -> ChannelLearned:
    """Verdict on a channel: probabilities of laws are sums of the weights of the models that have them."""

    def part_of(model: tuple[Learned, ...]) -> Learned:
        return model[0] if len(model) == 1 else model[channels.index(channel)]

    mine = [tuple(law for law in part_of(model).laws if law.channel == channel) for model in models]
    probability = {
        law: float(sum(w for w, laws in zip(weight, mine, strict=True) if law in laws))
        for law in LAWS.values()
        if law.channel == channel
    }
    nothing = float(sum(w for w, laws in zip(weight, mine, strict=True) if not laws))
    best = int(np.argmax(weight))
    possible = sorted((law for law, p in probability.items() if p >= POSSIBLE_FROM), key=lambda law: -probability[law])
    causes = []
    for law in possible:
        holder = max((w, i) for i, (w, laws) in enumerate(zip(weight, mine, strict=True)) if law in laws)[1]
        causes.append(FlightCause(law, probability[law], parameters_of(part_of(models[holder]), law)))
    tau, untimed = float(np.exp(lag.theta[0])), float(lag.untimed[0])
    above = tau * np.expm1(1.645 * np.sqrt(lag.covariance[0, 0] - untimed**2))
    limit_s, least_s = tau + float(np.hypot(above, 1.645 * untimed * tau)), 1.96 * untimed * tau
    any_lag = sum(p for law, p in probability.items() if law.lags is not None)
    sure = [cause for cause in causes if cause.probability >= NAMED_FROM and len(cause.law.causes) == 1]
    why = ""
    if nothing >= POSSIBLE_FROM and any_lag < NAMED_FROM and limit_s > USUAL_LAG_S[channel]:
        verdict, why = "not identifiable", _why_open(used, units)
    elif nothing >= 0.5:
        verdict, causes = "adequate", []
    else:
        verdict = "named" if causes and len(sure) == len(causes) else "tied"
    fit = part_of(models[best])
    if verdict in ("named", "tied") and causes and all(cause.law.lags is not None for cause in causes):
        # What a lag does is seen by passes; that readings are smooth, or how two sensors differ, tells none of both.
        if all(_slowest_s(cause) < least_s for cause in causes):
            verdict, why = "not identifiable", f"where these flights show one, they tell times to {least_s:.2g} s alone"
        elif verdict == "named" and len(used) > 1 and off[id(fit)].spread >= read.where(off[id(fit)]).spread:
            verdict, why = "not identifiable", "what fits best brings passes of flights that were not fitted no nearer"
    rivals: dict[tuple[str, ...], RivalModel] = {}
    for i in np.argsort(-weight).tolist():
        laws = tuple(law.key for law in mine[i])
        values, before = part_of(models[i]).sensor(channel=channel).values, 0.0
        if laws in rivals:  # of the most probable model that has them
            values, before = rivals[laws].values, rivals[laws].probability
        rivals[laws] = RivalModel(laws, values, before + float(weight[i]))
    ranked = sorted(rivals.values(), key=lambda one: -one.probability)
    kept = [one for k, one in enumerate(ranked) if k < 2 or one.probability >= POSSIBLE_FROM]
    return ChannelLearned(
        channel, verdict, tuple(causes), tuple(kept), refuted, limit_s, why, fit, lag,
        read, off[id(lag)], off[id(fit)],
    )  # fmt: skip


def _slowest_s(lag: FlightCause) -> float:
    """The largest of a lag's time constants."""
    return max(one.value for one in lag.parameters if one.name.endswith("time_constant_s"))


def _why_open(used: Sequence[FlightBins], units: Sequence[FlightChannelData]) -> str:
    """Why the flights leave a lag open: what they do not vary."""
    reasons = []
    for unit in units:
        value, altitude = unit.reading, unit.bins.altitude_m[unit.rows]
        straight = np.polynomial.polynomial.Polynomial.fit(altitude, value, 1)(altitude)
        if float(np.std(value - straight)) < 0.15:
            reasons.append("the profile is a straight line, which a lag only shifts as an offset would")
            break
    speeds = [abs(p.climb_m_s) for one in used for p in one.passes]
    if max(speeds) < UNLIKE_SPEEDS * min(speeds):
        reasons.append("all passes have one speed")
    apart = [float(np.diff([one.time_s[(p.first + p.last) // 2] for p in one.passes]).mean()) for one in used]
    if why := too_far_apart(min(apart)):
        reasons.append(f"passes are {why}")
    return "; ".join(reasons) or "the air changed between the passes by more than a lag of this sensor would show"
