"""A model of the sensor fitted to all flights at once: its parameters shared, each flight's air its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.learn.density import Density, FlightChannelData, Sensor, density
from shockrig.analysis.learn.laws import Law, LawParameter

Array = NDArray[np.float64]

MOST_STEPS = 25
ENOUGH_NATS = 0.02  # that the next step would gain
DIFFERENCE = 1e-3  # of a parameter's spread, over which slopes are taken
LONGEST_STEP = 1.5  # of a parameter or a size, in its own spread: at most in one step


@dataclass(frozen=True)
class Known:
    """What is known of a model's parameters on the scale that is fitted: name, law's key, mean, spread, bounds."""

    parameter: LawParameter
    name: str
    mean: float
    spread: float

    @property
    def low(self) -> float:
        """Lower bound, on the scale that is fitted."""
        return self.parameter.encoded(self.parameter.low)

    @property
    def high(self) -> float:
        """Upper bound, on the scale that is fitted."""
        return self.parameter.encoded(self.parameter.high)


def known_of(laws: Sequence[Law], stated: Mapping[str, tuple[float, float]] | None = None) -> tuple[Known, ...]:
    """Parameters of laws in order; `stated` (channel.name -> mean, spread as fitted) is what a bench has found."""
    found = []
    for law in laws:
        for parameter in law.parameters:
            mean, spread = parameter.encoded(parameter.usual), parameter.spread
            if stated and (key := f"{law.channel}.{parameter.name}") in stated:
                mean, spread = stated[key]
            found.append(Known(parameter, parameter.name, mean, spread))
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
        Of each unit's air and noise.
    value : ndarray (U,)
        Log density of each unit at theta [nats].
    slope, information : ndarray (U, P), (U, P, P)
        Of each unit's log density, its sizes eliminated.
    """

    laws: tuple[Law, ...]
    known: tuple[Known, ...]
    theta: Array
    sizes: tuple[Array, ...]
    value: Array
    slope: Array
    information: Array

    @property
    def prior(self) -> Array:
        """Weights of what is known before any flight (P,)."""
        return np.array([one.spread**-2.0 for one in self.known])

    @property
    def covariance(self) -> Array:
        """Of theta (P, P); as wide as the flights disagree, where there are more than two."""
        whole = self.information.sum(axis=0) + np.diag(self.prior)
        inverse = np.asarray(np.linalg.inv(whole))
        units = self.slope.shape[0]
        if units < 3:
            return inverse
        moved = (self.slope - self.slope.mean(axis=0)) @ inverse
        seen = moved.T @ moved * units / (units - 1.0)
        root = np.linalg.cholesky(inverse)
        back = np.linalg.inv(root)
        values, axes = np.linalg.eigh(back @ seen @ back.T)
        wide = root @ axes
        return np.asarray((wide * np.maximum(values, 1.0)) @ wide.T)

    def sensor(self, theta: Array | None = None, channel: str | None = None) -> Sensor:
        """The model of the sensor, at theta or at another; of one channel alone."""
        theta = self.theta if theta is None else theta
        laws = tuple(law for law in self.laws if channel is None or law.channel in ("", channel))
        return Sensor(laws, values_of(self.laws, self.known, theta, channel))

    def without(self, unit: int) -> Array:
        """Theta where one unit is left out."""
        rest = self.information.sum(axis=0) - self.information[unit] + np.diag(self.prior)
        return np.asarray(self.theta - np.linalg.solve(rest, self.slope[unit]))

    def held_out(self) -> Array:
        """Log density of each unit given all others (U,) [nats]: exact for a density that is quadratic in theta."""
        if not self.theta.size:
            return self.value
        whole = self.information.sum(axis=0) + np.diag(self.prior)
        _, log_whole = np.linalg.slogdet(whole)
        found = []
        for value, slope, own in zip(self.value, self.slope, self.information, strict=True):
            rest = whole - own
            shift = -np.linalg.solve(rest, slope)
            pull = slope + rest @ shift
            _, log_rest = np.linalg.slogdet(rest)
            found.append(
                value - 0.5 * shift @ rest @ shift + 0.5 * pull @ np.linalg.solve(whole, pull)
                + 0.5 * (log_rest - log_whole)
            )  # fmt: skip
        return np.array(found)


def values_of(
    laws: Sequence[Law], known: Sequence[Known], theta: Array, channel: str | None = None
) -> dict[str, float]:
    """Parameters' values in their own units, by name; of one channel's laws and the position's."""
    found, at = {}, 0
    for law in laws:
        for parameter in law.parameters:
            if channel is None or law.channel in ("", channel):
                found[parameter.name] = parameter.decoded(float(theta[at]))
            at += 1
    return found


@dataclass(frozen=True)
class _State:
    """Where a fit stands: the densities of all units there, and their sum with what is known."""

    theta: Array
    sizes: tuple[Array, ...]
    found: tuple[Density, ...]
    total: float


def fitted(
    laws: tuple[Law, ...],
    units: Sequence[FlightChannelData],
    theta: Array,
    sizes: Sequence[Array] | None = None,
    stated: Mapping[str, tuple[float, float]] | None = None,
    most_steps: int = MOST_STEPS,
) -> Learned:
    """The most likely parameters for all units (each a channel of a flight), from `theta` and `sizes` on."""
    known = known_of(laws, stated)
    mean, weight = np.array([one.mean for one in known]), np.array([one.spread**-2.0 for one in known])
    low, high = np.array([one.low for one in known]), np.array([one.high for one in known])
    state = _at(laws, known, units, theta, tuple(one.usual for one in units) if sizes is None else tuple(sizes))
    damping = 1e-3
    for _ in range(most_steps):
        shared = np.diag(weight)
        pull = weight * (mean - state.theta)
        own = []
        for unit, size, found in zip(units, state.sizes, state.found, strict=True):
            p = len(known)
            h_slope = found.slope[p:] + (unit.usual - size) / unit.spread**2
            h_weight = found.information[p:, p:] + np.diag(unit.spread**-2.0)
            h_weight = h_weight + damping * np.diag(h_weight.diagonal())
            cross = found.information[:p, p:]
            solved = np.linalg.solve(h_weight, np.column_stack([cross.T, h_slope]))
            shared = shared + found.information[:p, :p] - cross @ solved[:, :p]
            pull = pull + found.slope[:p] - cross @ solved[:, p]
            own.append((solved, cross))
        free = ~(((state.theta <= low) & (pull < 0)) | ((state.theta >= high) & (pull > 0)))
        step = np.zeros(len(known))
        if free.any():
            damped = shared + damping * np.diag(shared.diagonal())
            step[free] = np.linalg.solve(damped[np.ix_(free, free)], pull[free])
        spread = np.array([one.spread for one in known])
        step *= min(1.0, LONGEST_STEP / max(float(np.max(np.abs(step) / spread, initial=0.0)), 1e-12))
        new_theta = np.clip(state.theta + step, low, high)
        new_sizes = tuple(
            size + np.clip(solved[:, -1] - solved[:, :-1] @ step, -LONGEST_STEP * 2, LONGEST_STEP * 2)
            for size, (solved, _) in zip(state.sizes, own, strict=True)
        )
        tried = _at(laws, known, units, new_theta, new_sizes)
        if tried.total >= state.total:
            gained = tried.total - state.total
            state, damping = tried, max(damping / 8.0, 1e-6)
            if gained < ENOUGH_NATS:
                break
        else:
            damping = max(8.0 * damping, 1e-2)
            if damping > 1e4:
                break
    return _learned(laws, known, units, state)


def _at(
    laws: tuple[Law, ...],
    known: tuple[Known, ...],
    units: Sequence[FlightChannelData],
    theta: Array,
    sizes: tuple[Array, ...],
) -> _State:
    found = []
    total = -0.5 * sum(((t - one.mean) / one.spread) ** 2 for t, one in zip(theta, known, strict=True))
    for unit, size in zip(units, sizes, strict=True):
        mine = tuple(law for law in laws if law.channel in ("", unit.channel))
        sensor = Sensor(mine, values_of(laws, known, theta, unit.channel))
        which = [i for i, law in enumerate(_law_of(laws)) if law.channel in ("", unit.channel)]
        steps = tuple((known[i].name, DIFFERENCE * known[i].spread, known[i].parameter.log) for i in which)
        part = density(unit, sensor, size, steps)
        place = [*which, *range(len(known), len(known) + size.size)]
        slope = np.zeros(len(known) + size.size)
        information = np.zeros((slope.size, slope.size))
        slope[place] = part.slope
        information[np.ix_(place, place)] = part.information
        found.append(Density(part.value, slope, information))
        total += part.value - 0.5 * float(np.sum(((size - unit.usual) / unit.spread) ** 2))
    return _State(theta, sizes, tuple(found), total if np.isfinite(total) else -np.inf)


def _law_of(laws: Sequence[Law]) -> list[Law]:
    """The law of each parameter, in order."""
    return [law for law in laws for _ in law.parameters]


def _learned(
    laws: tuple[Law, ...], known: tuple[Known, ...], units: Sequence[FlightChannelData], state: _State
) -> Learned:
    p = len(known)
    slopes, informations, values = [], [], []
    for unit, size, found in zip(units, state.sizes, state.found, strict=True):
        h_weight = found.information[p:, p:] + np.diag(unit.spread**-2.0)
        h_slope = found.slope[p:] + (unit.usual - size) / unit.spread**2
        cross = found.information[:p, p:]
        solved = np.linalg.solve(h_weight, np.column_stack([cross.T, h_slope]))
        slopes.append(found.slope[:p] - cross @ solved[:, p])
        informations.append(found.information[:p, :p] - cross @ solved[:, :p])
        values.append(found.value - 0.5 * float(np.sum(((size - unit.usual) / unit.spread) ** 2)))
    return Learned(
        laws, known, state.theta, state.sizes, np.array(values), np.array(slopes).reshape(len(units), p),
        np.array(informations).reshape(len(units), p, p),
    )  # fmt: skip


def together(fits: Sequence[Learned], flights: Sequence[str], of: Sequence[Sequence[str]]) -> Array:
    """Held-out density of each flight (F,), over fits of its channels: `of` names the flight of each fit's units."""
    total = np.zeros(len(flights))
    for one, names in zip(fits, of, strict=True):
        for name, value in zip(names, one.held_out(), strict=True):
            total[flights.index(name)] += value
    return total


def started(law: Law, fitted_so_far: Learned | None = None) -> list[Array]:
    """Starts of a law's parameters: each start of the first with each of the others', on the scale that is fitted."""
    grid = np.array(np.meshgrid(*[[p.encoded(s) for s in p.starts] for p in law.parameters], indexing="ij"))
    return list(grid.reshape(len(law.parameters), -1).T)


def narrowed(found: Learned, to: int) -> Learned:
    """The same with the first `to` units alone."""
    return replace(
        found, sizes=found.sizes[:to], value=found.value[:to], slope=found.slope[:to], information=found.information[:to]
    )
