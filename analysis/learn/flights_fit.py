"""A model of the sensor fitted to all flights at once: its parameters shared, each flight's air its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.predictive import no_less_than_scatter
from shockrig.analysis.learn.density import (
    MOVES,
    Density,
    FlightChannelData,
    SensorModel,
    begun,
    density,
    slopes,
)
from shockrig.analysis.learn.laws import SECOND, Law, LawParameter

Array = NDArray[np.float64]

MOST_STEPS = 25
SCATTERS = (0.07, 0.15, 0.3)  # of a parameter from flight to flight, in its own spread; the first is usual
USUAL_SCATTER, SCATTER_SPREAD = 0.07, 0.7  # before any flight: in that unit, and of its logarithm
FIRST_FLIGHTS, BEST_STARTS = 2, 2  # on which starts are tried, and how many of them go on
FEW_STEPS = 5  # from each start, to see which leads furthest
SAME_SUMMIT = 0.1  # of a parameter's spread: starts that have come so near to one another lead to one summit
HOPELESS_NATS = 20.0  # behind the best after these steps
ENOUGH_NATS, ENOUGH_OF_EACH = 0.1, 0.01  # that the next step would gain, and of each unit where there are many
SLOPE_STEP = 1e-3  # of a parameter's spread, over which slopes are taken
LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e4  # of information, in a step
LONGEST_STEP = 1.5  # of a parameter or a size, in its own spread: at most in one step


@dataclass(frozen=True)
class Known:
    """What is known of a model's parameter on the scale that is fitted: mean, spread, bounds."""

    parameter: LawParameter
    mean: float
    spread: float

    @property
    def name(self) -> str:
        """The parameter's."""
        return self.parameter.name

    @property
    def low(self) -> float:
        """Lower bound, on the scale that is fitted."""
        return self.parameter.encoded(self.parameter.low)

    @property
    def high(self) -> float:
        """Upper bound, on the scale that is fitted."""
        return self.parameter.encoded(self.parameter.high)


def known_of(laws: Sequence[Law], stated: Mapping[str, tuple[float, float]] | None = None) -> tuple[Known, ...]:
    """Parameters of laws in order; `stated` (channel.name or channel.law.name -> mean, spread on the scale that is
    fitted) is what a bench has found."""
    found = []
    for law in laws:
        for parameter in law.parameters:
            mean, spread = parameter.encoded(parameter.usual), parameter.spread
            for key in (f"{law.channel}.{parameter.name}", f"{law.name}.{parameter.name}"):
                mean, spread = (stated or {}).get(key, (mean, spread))
            found.append(Known(parameter, mean, spread))
    return tuple(found)


@dataclass(frozen=True)
class Learned:
    """A model fitted to U flights' readings of one channel (or of all, where a shift is in it).

    Attributes
    ----------
    laws : tuple of Law
    known : tuple of Known
    theta : ndarray (P,)
        On the scale that is fitted.
    sizes : tuple of ndarray
        Of each unit's air and noise (`density`).
    value : ndarray (U,)
        Log density of each unit at theta [nats].
    slope, information : ndarray (U, P), (U, P, P)
        Of each unit's log density, its sizes eliminated.
    channels : tuple of str
        Of each unit.
    part_s : tuple of float
        Of each unit, how long a part of a bin is where its readings vary (`FlightChannelData`).
    """

    laws: tuple[Law, ...]
    known: tuple[Known, ...]
    theta: Array
    sizes: tuple[Array, ...]
    value: Array
    slope: Array
    information: Array
    channels: tuple[str, ...] = ()
    part_s: tuple[float, ...] = ()

    @property
    def prior(self) -> Array:
        """Weights of what is known before any flight (P,)."""
        return np.array([one.spread**-2.0 for one in self.known])

    @property
    def total(self) -> float:
        """Log density of all units, and of theta before them [nats]."""
        mean = np.array([one.mean for one in self.known])
        return float(self.value.sum() - 0.5 * np.sum(self.prior * (self.theta - mean) ** 2))

    @property
    def covariance(self) -> Array:
        """Of theta (P, P); as wide as the flights disagree, where there are more than two, and as time is unknown."""
        whole = self.information.sum(axis=0) + np.diag(self.prior)
        inverse = np.asarray(np.linalg.inv(whole))
        untimed = np.outer(self.untimed, self.untimed)  # as many seconds of all lags at once: they differ as before
        units = self.slope.shape[0]
        if units < 3:
            return inverse + untimed
        moved = (self.slope - self.slope.mean(axis=0)) @ inverse
        return no_less_than_scatter(inverse, moved.T @ moved * units / (units - 1.0)) + untimed

    @property
    def untimed(self) -> Array:
        """By how much each of theta (P,) is unknown since the air is held over parts of bins: of logarithms of time
        constants, the standard deviation of a time that is anywhere in a part, over the time constant."""
        found = np.zeros(self.theta.size)
        for i, (one, law) in enumerate(zip(self.known, _law_of(self.laws), strict=True)):
            parts = [s for s, channel in zip(self.part_s, self.channels, strict=False) if channel == law.channel]
            if parts and one.name.removesuffix(SECOND) == "time_constant_s":
                found[i] = np.mean(parts) / np.sqrt(12.0) / one.parameter.decoded(float(self.theta[i]))
        return found

    def sensor(self, theta: Array | None = None, channel: str | None = None) -> SensorModel:
        """The model of the sensor, at theta or at another; of one channel alone."""
        theta = self.theta if theta is None else theta
        laws = tuple(law for law in self.laws if channel is None or law.channel in ("", channel))
        return SensorModel(laws, values_of(self.laws, theta, channel))

    def without(self, unit: int) -> Array:
        """Theta where one unit is left out."""
        rest = self.information.sum(axis=0) - self.information[unit] + np.diag(self.prior)
        theta = self.theta - np.linalg.solve(rest, self.slope[unit])
        return np.clip(theta, [one.low for one in self.known], [one.high for one in self.known])

    def predicted(self) -> Array:
        """Log density of each unit given those before it (U,) [nats]; their sum is the evidence for the model.

        Exact for densities that are quadratic in theta (prequential: Dawid 1984, doi 10.2307/2981683). Given all the
        others instead, a law that does nothing would cost nothing. A parameter that is held at its bound gains nothing
        beyond it.
        """
        weight = np.diag(self.prior)
        pull = self.prior * (np.array([one.mean for one in self.known]) - self.theta)
        towards = pull + self.slope.sum(axis=0)
        low, high = np.array([one.low for one in self.known]), np.array([one.high for one in self.known])
        held = ((self.theta <= low) & (towards < 0)) | ((self.theta >= high) & (towards > 0))
        pull[held] = 0.0
        found = []
        for value, slope, own in zip(self.value, np.where(held, 0.0, self.slope), self.information, strict=True):
            shift = np.linalg.solve(weight, pull)
            after, both = weight + own, pull + slope
            gain = 0.5 * (both @ np.linalg.solve(after, both) - pull @ shift)
            found.append(value + gain + 0.5 * (np.linalg.slogdet(weight)[1] - np.linalg.slogdet(after)[1]))
            weight, pull = after, both
        return np.array(found)


def values_of(laws: Sequence[Law], theta: Array, channel: str | None = None) -> dict[str, float]:
    """Parameters' values in their own units, by name; of one channel's laws and the position's."""
    found, at = {}, 0
    for law in laws:
        for parameter in law.parameters:
            if channel is None or law.channel in ("", channel):
                found[parameter.name] = parameter.decoded(float(theta[at]))
            at += 1
    return found


def known_air(fit: Learned, fitted_to: Sequence[FlightChannelData], units: Sequence[FlightChannelData]) -> Learned:
    """An earlier fit with numbers for more units: its own for those that it was `fitted_to`, and for another what is
    usual among them, with nothing moved."""
    own: dict[int, Array] = {id(unit): size for unit, size in zip(fitted_to, fit.sizes, strict=True)}
    usual: dict[str, Array] = {}
    for channel in set(fit.channels):
        sizes = [size[:-MOVES] for size, whose in zip(fit.sizes, fit.channels, strict=True) if whose == channel]
        usual[channel] = np.r_[np.median(sizes, axis=0), np.zeros(MOVES)]
    return replace(fit, sizes=tuple(own.get(id(unit), usual[unit.channel]) for unit in units))


@dataclass(frozen=True)
class _State:
    """Where a fit stands: the density of each unit there, each with what is known of its own numbers, and their sum
    with what is known of theta."""

    theta: Array
    found: tuple[Density, ...]
    parts: Array
    total: float


def fitted(
    laws: tuple[Law, ...],
    units: Sequence[FlightChannelData],
    theta: Array,
    begin: Learned | None = None,
    stated: Mapping[str, tuple[float, float]] | None = None,
    whole: bool = True,
) -> Learned:
    """The most likely parameters for all units (a channel of a flight each), from `theta` and the air of `begin` on.

    The `whole` way, or a few steps: then without a scatter from flight to flight, which is read off the summit. Each
    unit's own numbers are damped by themselves: what goes too far in the air of one flight holds up no other.
    """
    known = known_of(laws, stated)
    mean, spread = np.array([one.mean for one in known]), np.array([one.spread for one in known])
    low, high = np.array([one.low for one in known]), np.array([one.high for one in known])
    state = _at(laws, known, units, theta, [begun(one) for one in units] if begin is None else begin.sizes)
    if begin is None:
        state = _at(laws, known, units, theta, [begun(one.data, one.misfit) for one in state.found])
    near = _slopes(laws, known, state)
    common, dampings, small = LEAST_DAMPING, np.full(len(units), LEAST_DAMPING), 0
    for _ in range(MOST_STEPS if whole else FEW_STEPS):
        parts = [_eliminated(*one) for one in zip(state.found, near, dampings, strict=True)]
        shared = np.diag(spread**-2.0) + sum(information for _, information, _ in parts)
        pull = (mean - state.theta) / spread**2 + sum(slope for slope, _, _ in parts)
        free = ~(((state.theta <= low) & (pull < 0)) | ((state.theta >= high) & (pull > 0)))
        step = np.zeros(len(known))
        if free.any():
            damped = shared + common * np.diag(shared.diagonal())
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], pull[free])
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step) / spread, initial=0.0)), 1e-12))
        ahead = np.clip(state.theta + step, low, high)
        own = [solved[:, -1] - solved[:, :-1] @ (ahead - state.theta) for _, _, solved in parts]
        sizes = [one.own + np.clip(by, -LONGEST_STEP, LONGEST_STEP) for one, by in zip(state.found, own, strict=True)]
        tried = _at(laws, known, units, ahead, sizes)
        worse = tried.parts < state.parts
        if tried.total >= state.total:
            gained = tried.total - state.total
            state, near = tried, _slopes(laws, known, tried)
            common, dampings = max(common / 8.0, LEAST_DAMPING), np.maximum(dampings / 8.0, LEAST_DAMPING)
            small = small + 1 if gained < max(ENOUGH_NATS, ENOUGH_OF_EACH * len(units)) else 0
            if small == 2:  # one may be of a damped step
                break
        else:
            common = max(8.0 * common, 1e-2)
            if common > MOST_DAMPING:
                break
        dampings[worse] = np.maximum(64.0 * dampings[worse], 1e-1)
    return _learned(laws, known, units, state, near, whole)


def _at(
    laws: tuple[Law, ...],
    known: tuple[Known, ...],
    units: Sequence[FlightChannelData],
    theta: Array,
    sizes: Sequence[Array],
) -> _State:
    found = []
    for unit, size in zip(units, sizes, strict=True):
        mine = tuple(law for law in laws if law.channel in ("", unit.channel))
        found.append(density(unit, SensorModel(mine, values_of(laws, theta, unit.channel)), size))
    parts = np.array([one.value - 0.5 * np.sum(((one.own - one.data.usual) / one.data.spread) ** 2) for one in found])
    before = sum(((t - one.mean) / one.spread) ** 2 for t, one in zip(theta, known, strict=True))
    total = float(parts.sum()) - 0.5 * before
    return _State(theta, tuple(found), parts, total if np.isfinite(total) else -np.inf)


def _slopes(laws: tuple[Law, ...], known: tuple[Known, ...], state: _State) -> list[tuple[Array, Array]]:
    """Slope and information of each unit over all parameters, and its own numbers behind them."""
    whole = []
    for one in state.found:
        which = [i for i, law in enumerate(_law_of(laws)) if law.channel in ("", one.data.channel)]
        steps = tuple((known[i].name, SLOPE_STEP * known[i].spread, known[i].parameter.log) for i in which)
        place = [*which, *range(len(known), len(known) + one.own.size)]
        slope, information = np.zeros(len(known) + one.own.size), np.eye(len(known) + one.own.size)
        information[: len(known)] = 0.0
        if np.isfinite(one.value):
            slope[place], information[np.ix_(place, place)] = slopes(one, steps)
        whole.append((slope, information))
    return whole


def _eliminated(found: Density, near: tuple[Array, Array], damping: float = 0.0) -> tuple[Array, Array, Array]:
    """Slope (p,) and information (p, p) of the parameters once the unit's own numbers are at their best; and what that
    is: the step of those numbers is the last column less the others times the parameters'.
    """
    unit, (slopes_of, information) = found.data, near
    p = slopes_of.size - found.own.size
    slope = slopes_of[p:] + (unit.usual - found.own) / unit.spread**2
    curved = information[p:, p:] + np.diag(unit.spread**-2.0)
    if damping:
        # A size's information is of its logarithm near the summit; above it, the slope itself curves.
        curved[range(slope.size - MOVES), range(slope.size - MOVES)] += np.maximum(-slopes_of[p:-MOVES], 0.0)
        curved += damping * np.diag(curved.diagonal())
    cross = information[:p, p:]
    solved = np.asarray(np.linalg.solve(curved, np.column_stack([cross.T, slope])))
    return slopes_of[:p] - cross @ solved[:, p], information[:p, :p] - cross @ solved[:, :p], solved


def _law_of(laws: Sequence[Law]) -> list[Law]:
    """The law of each parameter, in order."""
    return [law for law in laws for _ in law.parameters]


def _learned(
    laws: tuple[Law, ...],
    known: tuple[Known, ...],
    units: Sequence[FlightChannelData],
    state: _State,
    near: Sequence[tuple[Array, Array]],
    scatters: bool,
) -> Learned:
    p = len(known)
    parts = [_eliminated(*one) for one in zip(state.found, near, strict=True)]
    whole = Learned(
        laws,
        known,
        state.theta,
        tuple(one.own for one in state.found),
        state.parts,
        np.array([slope for slope, _, _ in parts]).reshape(len(units), p),
        np.array([information for _, information, _ in parts]).reshape(len(units), p, p),
        tuple(unit.channel for unit in units),
        tuple(unit.part_s for unit in units),
    )
    if not p or not scatters:
        return whole
    return max(
        (_scattered(whole, scatter) for scatter in SCATTERS),
        key=lambda one: float(one[0]),
    )[1]


def _scattered(found: Learned, scatter: float) -> tuple[float, Learned]:
    """A fit whose parameters may differ from flight to flight, and how likely so much of it is [nats].

    What a flight's air does beyond the model moves its parameters, as wet sensors and other airspeeds do: each flight's
    own are drawn around the common ones, and marginal. All densities are quadratic here.
    """
    spread = np.array([one.spread for one in found.known])
    between = np.diag((scatter * spread) ** 2)
    mean = np.array([one.mean for one in found.known])
    values, slopes, informations = [], [], []
    for value, slope, own in zip(found.value, found.slope, found.information, strict=True):
        # (I^-1 + S)^-1 without I^-1, which may not be
        keep = np.linalg.inv(np.eye(spread.size) + own @ between)
        information = keep @ own
        gentle = keep @ slope
        values.append(value + 0.5 * slope @ between @ gentle + 0.5 * np.linalg.slogdet(keep)[1])
        slopes.append(gentle)
        informations.append(0.5 * (information + information.T))
    slopes_of, informations_of = np.array(slopes), np.array(informations)
    whole = informations_of.sum(axis=0) + np.diag(spread**-2.0)
    low, high = np.array([one.low for one in found.known]), np.array([one.high for one in found.known])
    step = np.linalg.solve(whole, slopes_of.sum(axis=0) + (mean - found.theta) / spread**2)
    theta = np.clip(found.theta + step, low, high)
    step = theta - found.theta
    moved = replace(
        found,
        theta=theta,
        value=np.array(values) + slopes_of @ step - 0.5 * np.einsum("p,upq,q->u", step, informations_of, step),
        slope=slopes_of - informations_of @ step,
        information=informations_of,
    )
    before = -0.5 * (np.log(scatter / USUAL_SCATTER) / SCATTER_SPREAD) ** 2
    return moved.total - 0.5 * float(np.linalg.slogdet(whole)[1]) + before, moved


def started(law: Law) -> list[Array]:
    """Starts of a law's parameters: each start of the first with each of the others', on the scale that is fitted."""
    grid = np.array(np.meshgrid(*[[p.encoded(s) for s in p.starts] for p in law.parameters], indexing="ij"))
    return list(grid.reshape(len(law.parameters), -1).T)


def explored(
    laws: tuple[Law, ...],
    units: Sequence[FlightChannelData],
    starts: Sequence[Array],
    stated: Mapping[str, tuple[float, float]] | None = None,
    begin: Learned | None = None,
) -> list[Learned]:
    """A few steps from each start on the first flights: where they came to, the likeliest first.

    The air of each is as fits begin it, or from a fit `begin`. What layers did meanwhile and how the sensor lags have
    ridges and more than one summit, so the best two go on; but one of those that came to the same place, and none that
    is hopeless.
    """
    first = _first(units)
    part = None if begin is None else replace(begin, sizes=tuple(begin.sizes[i] for i in first))
    few = [units[i] for i in first]
    reached = [fitted(laws, few, theta, part, stated, whole=False) for theta in starts]
    tried = sorted(reached, key=lambda one: -one.total)
    spread = np.array([one.spread for one in known_of(laws, stated)])
    ends = tried[:1]
    for one in tried[1:]:
        away = all(np.max(np.abs(one.theta - other.theta) / spread, initial=0.0) > SAME_SUMMIT for other in ends)
        if len(ends) < BEST_STARTS and away and one.total > tried[0].total - HOPELESS_NATS:
            ends.append(one)
    return ends


def climbed(
    ends: Sequence[Learned],
    units: Sequence[FlightChannelData],
    stated: Mapping[str, tuple[float, float]] | None = None,
    begin: Learned | None = None,
) -> Learned:
    """The likeliest fit to all flights, the whole way from where starts were `explored`."""
    fits = (fitted(one.laws, units, one.theta, one if len(one.sizes) == len(units) else begin, stated) for one in ends)
    return max(fits, key=lambda one: one.total)


def hopeful(
    tried: Sequence[Sequence[Learned]], units: Sequence[FlightChannelData], first: Learned | None = None
) -> list[Sequence[Learned]]:
    """Models that are worth the whole way: not hopelessly behind the best on the first flights, or one that has gone
    there."""
    gone = [] if first is None else [float(first.value[_first(units)].sum())]
    best = max(gone + [ends[0].total for ends in tried])
    return [ends for ends in tried if ends[0].total > best - HOPELESS_NATS]


def _first(units: Sequence[FlightChannelData]) -> list[int]:
    """Places of the units of the first flights."""
    names = list(dict.fromkeys(unit.bins.name for unit in units))[:FIRST_FLIGHTS]
    return [i for i, unit in enumerate(units) if unit.bins.name in names]
