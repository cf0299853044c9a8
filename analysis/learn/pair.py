"""Two sensors side by side: one air, met by both at once, so that what one of them does alone shows in the other.

Alone, a sensor shows what changes from pass to pass. Beside another it also shows what the other does not do: readings
of both are one Gaussian vector whose shared air is the same function of altitude and time, and each sensor has laws
and numbers of its own. An offset between the two is always free: calibration is not what is asked. Of a clock, of wash
or of sun that both meet, a pair knows no more than one.

alone: each sensor by itself -> what it leaves possible -> each with each of the other's, fitted to both at once
     -> the same weights as alone -> a verdict for each sensor, and how they differ
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.predictive import weights
from shockrig.analysis.learn.bins import FlightBins, side_by_side
from shockrig.analysis.learn.density import FlightChannelData, prepared, sizes_of_one
from shockrig.analysis.learn.flights_fit import Learned, climbed, fitted, hopeful
from shockrig.analysis.learn.laws import LAWS, SECOND, SHIFT, Law, LawParameter, Values
from shockrig.analysis.learn.learn import (
    CLOCK,
    LAW_LOG_PRIOR,
    NAMED_FROM,
    POSSIBLE_FROM,
    ChannelLearned,
    FlightsLearned,
    LearnedNumber,
    clock_of,
    judged,
    learn,
)
from shockrig.analysis.learn.passes import disagreement, refutes
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight

Array = NDArray[np.float64]

OFFSET = "offset_between"
OFFSET_SPREAD = {"temperature": 1.0, "humidity": 4.0}  # K and %RH: between two sensors' calibrations, before any flight
FAR_BEHIND_NATS = 15.0  # of both sensors' models together: what is so far behind the best is not weighed
Model = tuple[Law, ...]


@dataclass(frozen=True)
class SensorsBeside(Law):
    """The laws of two sensors of one channel as one law of a flight that has both."""

    of_each: tuple[Model, Model] = ((), ())


@dataclass(frozen=True)
class SensorOfPair(Learned):
    """One sensor's part of a fit to both: its numbers, and how well the `whole` fit knows them at its `places`."""

    whole: Learned | None = None
    places: tuple[int, ...] = ()

    @property
    def covariance(self) -> Array:
        """Of theta, the other sensor's numbers being unknown as well."""
        assert self.whole is not None
        return np.asarray(self.whole.covariance[np.ix_(self.places, self.places)])

    def without(self, unit: int) -> Array:
        """Theta where both sensors' readings of one flight are left out."""
        assert self.whole is not None
        return np.asarray(self.whole.without(unit)[list(self.places)])


@dataclass(frozen=True)
class ChannelApart:
    """How two sensors of a channel differ under the likeliest model of both: second less first.

    `offset` is their calibrations' [K or %RH]; `lag_ratio` the second's time constant over the first's, None where one
    of them shows no lag.
    """

    offset: LearnedNumber
    lag_ratio: tuple[float, float] | None


@dataclass(frozen=True)
class PairLearned:
    """What flights say of two sensors side by side: of each by itself, of each beside the other, how they differ."""

    alone: tuple[FlightsLearned, FlightsLearned]
    together: tuple[FlightsLearned, FlightsLearned]
    apart: Mapping[str, ChannelApart] = field(default_factory=dict)


def learn_pair(
    first: Mapping[str, Flight],
    second: Mapping[str, Flight],
    channels: Sequence[str],
    stated: Mapping[str, tuple[float, float]] | None = None,
    progress: Callable[[str], None] = lambda said: None,
) -> PairLearned:
    """Learn from flights of two sensors in the same air, under the same names and on one clock.

    Parameters
    ----------
    first, second : mapping of name -> Flight
    channels : sequence of str
        What both have a sensor for; of another channel each sensor's log is as good as alone.
    stated : mapping, optional
        What a bench has found of the first sensor.
    progress : callable
        Is told what is being done.

    Raises
    ------
    InputError
        No flight of one of them passes the same air twice, or none has both.
    """
    alone = (
        learn(first, stated, lambda text: progress(f"first sensor, {text}")),
        learn(second, None, lambda text: progress(f"second sensor, {text}")),
    )
    bins = [{one.name: one for one in found.bins} for found in alone]
    names = [name for name in bins[0] if name in bins[1]]
    shared = [c for c in channels if any(bins[0][n].has(c) and bins[1][n].has(c) for n in names)]
    if not shared:
        raise InputError("no flight has both sensors with passes through the same air; give logs of flights with both")
    units = {c: [_both(bins[0][n], bins[1][n], c) for n in names if all(b[n].has(c) for b in bins)] for c in shared}
    single = [{c: [prepared(own[one.bins.name], c) for one in units[c]] for c in shared} for own in bins]
    clock = any(cause.probability >= POSSIBLE_FROM for found in alone for cause in found.position)
    raced, lags = {}, {}
    for c in shared:
        progress(f"{c}: both sensors at once")
        fits, lags[c] = _raced(c, units[c], (alone[0].channels[c], alone[1].channels[c]), stated)
        raced[c] = [one for one in fits if not _refuted(one, c, [own[c] for own in single])]
    joint: list[Learned] = []
    if clock:  # without it, what is fitted to both may be none of them
        progress("the position's clock")
        joint = [
            one
            for one in with_clock(raced, lags, units, alone, stated)
            if not any(_refuted(one, c, [own[c] for own in single]) for c in shared)
        ]
    if not joint:
        shared = [c for c in shared if any(_every_law([one]) for one in raced[c])]
    models: list[tuple[Learned, ...]] = [*product(*(raced[c] for c in shared)), *((one,) for one in joint)]
    if not shared or not models:
        return PairLearned(alone, alone)
    scores = [np.concatenate([part.predicted() for part in model]) for model in models]
    priors = [LAW_LOG_PRIOR * sum(law.key != "lag" for law in _every_law(model)) for model in models]
    weight = weights(scores, priors)
    together = [_sensor(which, alone[which], {c: single[which][c] for c in shared}, models, weight) for which in (0, 1)]
    best = models[int(np.argmax(weight))]
    apart = {c: _apart(c, best[0] if len(best) == 1 else best[shared.index(c)]) for c in shared}
    return PairLearned(alone, (together[0], together[1]), apart)


def _both(first: FlightBins, second: FlightBins, channel: str) -> FlightChannelData:
    return prepared(side_by_side(first, second), channel)


def beside(channel: str, first: Model, second: Model) -> SensorsBeside:
    """The laws of two sensors as one: each acts on the bins of its own sensor."""
    both = first, second
    names = [
        {p.name: p.name + SECOND * which for law in laws for p in law.parameters} for which, laws in enumerate(both)
    ]

    def along(of: Callable[[Law, Values, FlightBins], Array | float]) -> Callable[[Values, FlightBins], Array]:
        """What a sensor's laws add up to, over the bins of each."""

        def every(values: Values, bins: FlightBins) -> Array:
            parts = []
            for laws, own, mine in zip(both, names, bins.sensors, strict=True):
                known = {name: values[stands] for name, stands in own.items()}
                known |= {SHIFT: values.get(SHIFT, 0.0)}
                parts.append(np.zeros(mine.within_s.shape) + sum(of(law, known, mine) for law in laws))
            return np.concatenate(parts)

        return every

    def lags(values: Values, bins: FlightBins) -> tuple[tuple[Array, Array], ...]:
        paths = []
        for laws, own, mine in zip(both, names, bins.sensors, strict=True):
            known = {name: values[stands] for name, stands in own.items()}
            paths.append([path for law in laws if law.lags is not None for path in law.lags(known, mine)])
        found = []
        for i in range(max(len(one) for one in paths)):
            parts = [
                one[i] if i < len(one) else (np.zeros(mine.time_s.size), np.ones(mine.time_s.size))
                for one, mine in zip(paths, bins.sensors, strict=True)
            ]
            found.append((np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])))
        return tuple(found)

    def offset(values: Values, bins: FlightBins) -> Array:
        own = along(lambda law, p, b: 0.0 if law.offset is None else law.offset(p, b))(values, bins)
        own[bins.begins[1] :] += values[OFFSET]
        return own

    spread, unit = OFFSET_SPREAD[channel], "K" if channel == "temperature" else "%RH"
    between = LawParameter(OFFSET, unit, 0.0, spread, -20 * spread, 20 * spread, (0.0,), "offset between the sensors")
    return SensorsBeside(
        key="side_by_side",
        causes=(),
        channel=channel,
        parameters=(
            *(p for law in first for p in law.parameters),
            *(replace(p, name=p.name + SECOND) for law in second for p in law.parameters),
            between,
        ),
        equation="each sensor's laws, of one air",
        source="",
        needs="",
        lags=lags,
        offset=offset,
        warmer=along(lambda law, p, b: 0.0 if law.warmer is None else law.warmer(p, b)),
        activity=along(lambda law, p, b: 0.0 if law.activity is None else law.activity(p, b)),
        of_each=both,
    )


def _raced(
    channel: str,
    units: list[FlightChannelData],
    alone: tuple[ChannelLearned, ChannelLearned],
    stated: Mapping[str, tuple[float, float]] | None,
) -> tuple[list[Learned], Learned]:
    """What either sensor alone leaves possible, nothing, and one lag: each with each of the other's; and a lag of each.

    Each begins with air that stays: that of a pair which is wrong leaves no room to the one which is right.
    """
    lag = ((LAWS[f"{channel}.lag"],),) * 2
    pairs = product(*(_possible(channel, one).items() for one in alone))
    tried = {
        (first, second): [
            fitted((beside(channel, first, second),), units, np.r_[at, at_second, 0.0], None, stated, whole=False)
        ]
        for (first, at), (second, at_second) in pairs
    }
    plain = climbed(tried.pop(lag), units, stated)
    found = [plain, *(climbed(ends, units, stated) for ends in hopeful(list(tried.values()), units, plain))]
    best = max(float(one.predicted().sum()) for one in found)
    return [one for one in found if float(one.predicted().sum()) > best - FAR_BEHIND_NATS], plain


def _refuted(fit: Learned, channel: str, single: Sequence[list[FlightChannelData]]) -> bool:
    """Whether it makes the passes of either sensor less alike in structure than they are as read."""
    read = (disagreement(units, None, channel) for units in single)
    off = (disagreement(units, _of_sensor(fit, which), channel) for which, units in enumerate(single))
    return any(refutes(one, other) for one, other in zip(read, off, strict=True))


def _possible(channel: str, alone: ChannelLearned) -> dict[Model, Array]:
    """Models of a sensor by itself, each with its numbers on the scale that is fitted."""
    lag = LAWS[f"{channel}.lag"]
    at = {p.name: p.decoded(float(t)) for p, t in zip(lag.parameters, _own(alone.lag, lag), strict=True)}
    found: dict[Model, Array] = {(): np.array([]), (lag,): np.array([p.encoded(at[p.name]) for p in lag.parameters])}
    for rival in alone.rivals:
        laws = tuple(LAWS[f"{channel}.{key}"] for key in rival.laws)
        found[laws] = np.array([p.encoded(rival.values[p.name]) for law in laws for p in law.parameters])
    return found


def _own(fit: Learned, law: Law) -> list[float]:
    """A law's numbers in a fit."""
    whose = [one for one in fit.laws for _ in one.parameters]
    return [float(t) for t, one in zip(fit.theta, whose, strict=True) if one is law]


def with_clock(
    raced: Mapping[str, list[Learned]],
    lags: Mapping[str, Learned],
    units: Mapping[str, list[FlightChannelData]],
    alone: Sequence[FlightsLearned],
    stated: Mapping[str, tuple[float, float]] | None,
) -> list[Learned]:
    """The clock that either sensor may show, beside lags of all and beside the best model of each channel."""
    shift = max((c for found in alone for c in found.position), key=lambda one: one.probability).parameters[0].value
    every = [unit for c in raced for unit in units[c]]
    beside_it = [[lags[c], *sorted(raced[c], key=lambda one: -float(one.predicted().sum()))[:1]] for c in raced]
    tried: dict[Model, list[Learned]] = {}
    for parts in product(*beside_it):
        laws = (CLOCK, *(law for part in parts for law in part.laws))
        if laws not in tried:
            rest = np.concatenate([part.theta for part in parts])
            tried[laws] = [fitted(laws, every, np.r_[shift, rest], None, stated, whole=False)]
    return [climbed(ends, every, stated) for ends in hopeful(list(tried.values()), every)]


def _every_law(model: Sequence[Learned]) -> list[Law]:
    found: list[Law] = []
    for law in (law for part in model for law in part.laws):
        found += [one for laws in law.of_each for one in laws] if isinstance(law, SensorsBeside) else [law]
    return found


def _of_sensor(fit: Learned, which: int) -> SensorOfPair:
    """One sensor's part of a fit."""
    laws: list[Law] = []
    places: list[int] = []
    at = 0
    for law in fit.laws:
        if isinstance(law, SensorsBeside):
            mine, counts = law.of_each[which], [sum(len(one.parameters) for one in laws_) for laws_ in law.of_each]
            begins = at + counts[0] * which
            laws += mine
            places += range(begins, begins + counts[which])
        else:
            laws.append(law)
            places += range(at, at + len(law.parameters))
        at += len(law.parameters)
    index = np.array(places, dtype=int)
    plain = [p for law in laws for p in law.parameters]
    known = tuple(replace(fit.known[i], parameter=p) for i, p in zip(index, plain, strict=True))
    return SensorOfPair(
        tuple(laws), known, fit.theta[index], tuple(map(sizes_of_one, fit.sizes)), fit.value, fit.slope[:, index],
        fit.information[:, index][:, :, index], fit.channels, fit.part_s, fit, tuple(places),
    )  # fmt: skip


def _sensor(
    which: int,
    alone: FlightsLearned,
    units: Mapping[str, list[FlightChannelData]],
    models: Sequence[tuple[Learned, ...]],
    weight: Array,
) -> FlightsLearned:
    """The verdict on one sensor, from the models of both."""
    parts: dict[int, SensorOfPair] = {id(one): _of_sensor(one, which) for model in models for one in model}
    mine = [tuple(parts[id(one)] for one in model) for model in models]
    channels = dict(alone.channels)
    for c in units:
        fits = {id(one): one for i in np.argsort(-weight) for one in mine[i] if c in one.channels}
        off = {key: disagreement(units[c], one, c) for key, one in fits.items()}
        lag, plain = alone.channels[c].lag, [LAWS[f"{c}.lag"]]
        off[id(lag)] = alone.channels[c].single
        lag = next((one for one in fits.values() if [law for law in one.laws if law.channel == c] == plain), lag)
        channels[c] = judged(
            c, list(units), mine, weight, lag, alone.channels[c].refuted, [one.bins for one in units[c]], units[c],
            disagreement(units[c], None, c), off,
        )  # fmt: skip
    probability, position = clock_of(mine, weight)
    if all(CLOCK not in _every_law(model) for model in mine):  # the pair was not asked
        probability, position = NAMED_FROM * alone.position_named, alone.position
    table: dict[str, float] = {}
    for w, model in zip(weight, mine, strict=True):
        said = " + ".join(law.name for one in model for law in one.laws) or "nothing"
        table[said] = table.get(said, 0.0) + float(w)
    ranked = tuple(sorted(table.items(), key=lambda row: -row[1])[:12])
    return FlightsLearned(alone.bins, alone.left_out, channels, position, probability >= NAMED_FROM, ranked)


def _apart(channel: str, fit: Learned) -> ChannelApart:
    """How the two sensors differ under a fit."""
    covariance, at, where = fit.covariance, 0, {}
    for law in fit.laws:
        if law.channel == channel:
            where = {p.name: at + i for i, p in enumerate(law.parameters)}
        at += len(law.parameters)
    place = where[OFFSET]
    parameter = fit.known[place].parameter
    offset = LearnedNumber(parameter, float(fit.theta[place]), float(np.sqrt(covariance[place, place])))
    taus = [where[name] for name in ("time_constant_s", "time_constant_s" + SECOND) if name in where]
    if len(taus) < 2:
        return ChannelApart(offset, None)
    one, other = taus
    ratio = float(np.exp(fit.theta[other] - fit.theta[one]))
    sigma = np.sqrt(max(covariance[one, one] + covariance[other, other] - 2 * covariance[one, other], 0.0))
    return ChannelApart(offset, (ratio, ratio * float(sigma)))
