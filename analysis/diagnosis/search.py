"""Stepwise search for the effects that explain a channel: add, take away, and swap, until nothing in the catalogue
helps.

Models are compared by their marginal deviance (each run's deviations integrated out), so that run-to-run scatter
competes with every named cause on equal terms. A gain must pay for its parameters; see `price`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.gls import (
    Fit,
    Layout,
    Problem,
    fit,
    predict,
    project,
    rate_start,
    run_misfit,
    start_theta,
)
from shockrig.analysis.physics.chain import JUMP_K

Array = NDArray[np.float64]

PLAIN = Layout(())
MOST_EFFECTS = 6
ENTRY_PRICE = 11.0  # drop in deviance that an effect without parameters must bring
PARAMETER_PRICE = 3.0  # and as much again for each of its parameters
RARE = ("clock_drift",)  # a crystal is good to 100 ppm; what acts on a transient needs a hundred times that
RARE_PRICE = 8.0
QUICK_STEPS = 7  # of Gauss and Newton, to rank candidates
NUDGES_S = (-0.02, -0.01, 0.01, 0.02)
STUCK = 1.7  # mean square of a run's whitened residuals from which its start is looked for anew
START_GRID = np.linspace(-3.0, 3.0, 25)  # in standard deviations of a start
TIE = 6.0  # models whose deviances differ by less explain the data equally well


@dataclass(frozen=True)
class Move:
    """One step of the search: what was done, and by how much each candidate would have lowered the deviance."""

    kind: str
    effect: str
    gain: float
    candidates: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Search:
    """Outcome of a search.

    Attributes
    ----------
    plain, final : Fit
        The model that the search began from and the one that it ended with.
    moves : tuple of Move
    necessity : dict
        For each effect found: how much the deviance rises without it, all else refitted.
    rivals : dict
        For each effect found: {other effect: rise in deviance when it stands in its place} for the close ones.
    ties : dict
        For each effect found: {other effect: the fit with it in its place} where that explains the data equally well.
    """

    plain: Fit
    final: Fit
    moves: tuple[Move, ...]
    necessity: dict[str, float]
    rivals: dict[str, dict[str, float]]
    ties: dict[str, dict[str, Fit]]


def price(effect: str) -> float:
    """Drop in deviance that an effect must bring to be named; more for the one that real loggers hardly ever have."""
    rare = RARE_PRICE if effect in RARE else 0.0
    return ENTRY_PRICE + PARAMETER_PRICE * len(CATALOGUE[effect].parameters) + rare


def evidence(problem: Problem, gain: float) -> float:
    """A drop in deviance as Student evidence, (nu + 1) ln(1 + gain / nu).

    What limits a weak effect is the scatter of a few dozen runs, known from these runs alone: a drop that would be
    plain against a known scatter counts for less.
    """
    freedom = max(problem.channel.runs - problem.channel.interpolation.shape[1], 4)
    return float((freedom + 1) * np.log1p(gain / freedom)) if gain > 0 else float(gain)


def testable(channel: Channel) -> tuple[str, ...]:
    """Effects of the mean response that this campaign can show in this channel."""
    return tuple(
        name
        for name, effect in CATALOGUE.items()
        if channel.name in effect.channels and not effect.from_readings and effect.testable(channel)
    )


def _starts(channel: Channel, effect: str) -> list[dict[str, float]]:
    parameters, from_data = CATALOGUE[effect].parameters, CATALOGUE[effect].start_from
    names = [f"{effect}.{p.name}" for p in parameters]
    starts = [dict(zip(names, values, strict=True)) for values in itertools.product(*(p.starts for p in parameters))]
    told = {f"{effect}.{name}": value for name, value in from_data(channel).items()} if from_data else {}
    return [told] if told else starts


def _choice(found: Fit, groups: int) -> dict[str, float]:
    return {
        f"{effect}.{p.name}": float(np.exp(found.theta[i]) if p.log else found.theta[i])
        for i, (effect, p) in enumerate(found.layout.parameters, start=groups)
    }


def refit(
    problem: Problem, layout: Layout, near: Fit, choice: dict[str, float] | None = None, iterations: int = 30
) -> Fit:
    """Fit `layout` from the parameters of `near`, with `choice` for what is new; from two starts of the deviations.

    An effect can hide in the runs' own deviations, and the deviations in an effect: hence both starts.
    """
    groups = problem.channel.interpolation.shape[1]
    theta = start_theta(problem.channel, layout, near.theta[:groups], _choice(near, groups) | (choice or {}))
    fits = [fit(problem, layout, theta, _fresh(problem, near), iterations)]
    if near.objective < 3.0 * problem.channel.count.size:
        fits.append(fit(problem, layout, theta, near.deviations, iterations))
    best = min(fits, key=lambda f: f.deviance)
    if best.objective < 3.0 * problem.channel.count.size and best.converged:
        moved = _rescanned_starts(problem, best)
        if moved is not None:
            best = min((best, fit(problem, layout, best.theta, moved, iterations)), key=lambda f: f.deviance)
    return best


def _rescanned_starts(problem: Problem, found: Fit) -> Array | None:
    """Deviations with the start of each misfitting run where it fits best, looked for on a grid; None where all fit.

    A film's response begins like sqrt(t): no gradient leads a start across a sample that lies at the very transfer.
    """
    channel = problem.channel
    misfits = run_misfit(problem, found) > STUCK
    isothermal = np.abs(channel.conditions.destination_c - channel.conditions.source_c) <= JUMP_K
    misfits &= (channel.name == "temperature") | isothermal  # where RH jumps with the air, samples are muted
    if not misfits.any():
        return None
    index = np.flatnonzero(misfits)
    part, late = problem.select(index), found.deviations[index]
    tried = np.tile(late, (START_GRID.size, 1, 1))
    tried[:, :, 0] = START_GRID[:, None] * part.scatter[:, 0]
    prediction = predict(part.channel, found.layout, found.theta, tried)
    left = np.matmul(part.whitener, (part.channel.value - prediction)[..., None])[..., 0]
    cost = (left**2).sum(axis=-1) + START_GRID[:, None] ** 2
    moved = found.deviations.copy()
    moved[index, 0] = tried[np.argmin(cost, axis=0), np.arange(index.size), 0]
    return moved


def add(problem: Problem, current: Fit, effect: str) -> Fit:
    """Best fit of the current model with one more effect: a few steps from each of its starts, the best one
    finished."""
    layout = replace(current.layout, effects=(*current.layout.effects, effect))
    tries = (refit(problem, layout, current, start, QUICK_STEPS) for start in _starts(problem.channel, effect))
    return min(tries, key=lambda f: f.deviance)


def finish(problem: Problem, found: Fit) -> Fit:
    """The fit carried to its end, where it was left early; from several delays where a jump hides the way to the
    best."""
    jumps = "dead_time" in found.layout.effects and problem.channel.name == "humidity"
    if found.converged and not jumps:
        return found
    starts = (found.deviations, _fresh(problem, found))
    fits = [found, *(fit(problem, found.layout, found.theta, d) for d in starts)]
    if jumps:
        groups = problem.channel.interpolation.shape[1]
        place = groups + [f"{e}.{p.name}" for e, p in found.layout.parameters].index("dead_time.delay_s")
        for nudge in NUDGES_S:
            theta = found.theta.copy()
            theta[place] += nudge
            fits.append(fit(problem, found.layout, theta, starts[1]))
    return min(fits, key=lambda f: f.deviance)


def at_bound(effect: str, values: dict[str, float]) -> tuple[str, ...]:
    """Parameters of an effect that stand at a bound of their range."""
    out = []
    for parameter in CATALOGUE[effect].parameters:
        value = values[parameter.name]
        width = 1e-3 * (parameter.high - parameter.low)
        above = 1e-6 if parameter.log else min(width, 0.1 * abs(parameter.low) or width)
        if value <= parameter.low + above or value >= parameter.high - width:
            out.append(parameter.name)
    return tuple(out)


def drop(problem: Problem, current: Fit, effect: str) -> Fit:
    """Best fit of the current model without one of its effects."""
    layout = replace(current.layout, effects=tuple(e for e in current.layout.effects if e != effect))
    return refit(problem, layout, current)


def plain_fit(problem: Problem, layout: Layout = PLAIN) -> Fit:
    """Fit of the plain model (with the effects of the readings that `layout` holds fixed)."""
    theta = rate_start(problem.channel, layout)
    return fit(problem, layout, theta, _unrecorded_starts(problem, layout, theta), iterations=40)


def _fresh(problem: Problem, near: Fit) -> Array:
    """Deviations to begin from: none, but for the starts that nobody recorded, which stay where they were found."""
    return np.where(_open_starts(problem), near.deviations, 0.0)


def _open_starts(problem: Problem) -> NDArray[np.bool_]:
    """True for the deviations (R, U) that are start times which nobody recorded."""
    mask = np.zeros(problem.scatter.shape, dtype=bool)
    mask[:, 0] = ~problem.channel.conditions.start_known
    return mask


def _unrecorded_starts(problem: Problem, layout: Layout, theta: Array) -> Array:
    """Deviations with each unrecorded start where the plain model, at its rough rate, leaves least."""
    deviations = np.zeros(problem.scatter.shape)
    channel = problem.channel
    if channel.conditions.start_known.all():
        return deviations
    late_s = np.arange(-0.8, 0.81, 0.04) * max(1.0, channel.sampling_period_s / 0.1)
    groups = channel.interpolation.shape[1]
    for _ in range(2):
        tried = np.tile(deviations, (late_s.size, 1, 1))
        tried[:, ~channel.conditions.start_known, 0] = late_s[:, None]
        prediction = predict(channel, layout, np.tile(theta, (late_s.size, 1)), tried)
        squares = (channel.count * (channel.value - prediction) ** 2).sum(axis=-1)
        best = late_s[np.argmin(squares, axis=0)]
        deviations[:, 0] = np.where(channel.conditions.start_known, 0.0, best)
        theta[:groups] = fit(problem, layout, theta, deviations, iterations=10).theta[:groups]
    return deviations


def search(
    problem: Problem,
    base: Layout = PLAIN,
    names: tuple[str, ...] | None = None,
    thorough: bool = True,
    most: int = MOST_EFFECTS,
) -> Search:
    """Search the catalogue for the effects that explain a channel.

    Parameters
    ----------
    problem : Problem
    base : Layout
        Effects that the readings themselves have shown; they are never taken away.
    names : tuple of str, optional
        Candidates; all that can be tested if not given.
    thorough : bool
        Whether each effect found is tried against others in its place, and more candidates are fitted at each step
        than the few that score best to first order: needed for a verdict.
    most : int
        How many effects may be added.
    """
    names = testable(problem.channel) if names is None else names
    plain = current = plain_fit(problem, base)
    moves: list[Move] = []
    necessity: dict[str, float] = {}
    rivals: dict[str, dict[str, float]] = {}
    ties: dict[str, dict[str, Fit]] = {}
    seen: set[frozenset[str]] = set()
    while len(current.layout.effects) - len(base.effects) < most:
        current, added = _forward(problem, current, _promising(problem, current, names, 7 if thorough else 4), moves)
        if added:
            current = _backward(problem, current, base, moves)
            continue
        if not thorough:
            break
        current, necessity, rivals, ties, swapped = _exchange(problem, current, base, names, moves)
        if not swapped or frozenset(current.layout.effects) in seen:
            break
        seen.add(frozenset(current.layout.effects))
    if thorough and current.layout.effects and set(necessity) != set(current.layout.effects) - set(base.effects):
        current, necessity, rivals, ties, _ = _exchange(problem, current, base, names, moves, swap=False)
    return Search(plain, current, tuple(moves), necessity, rivals, ties)


def _promising(problem: Problem, current: Fit, names: tuple[str, ...], keep: int) -> tuple[str, ...]:
    """The candidates that, to first order, lower the objective most: one prediction each, no fit.

    Each is added at its weakest start; what the model's own parameters and the runs' deviations could do is taken out.
    """
    channel = problem.channel
    groups = channel.interpolation.shape[1]
    base = predict(channel, current.layout, current.theta, current.deviations)[0]
    columns, owners = [], []
    for effect in names:
        if effect in current.layout.effects:
            continue
        layout = replace(current.layout, effects=(*current.layout.effects, effect))
        for start in _starts(channel, effect):
            weak = {k: _weaker(effect, k.split(".")[1], v) for k, v in start.items()}
            theta = start_theta(channel, layout, current.theta[:groups], _choice(current, groups) | weak)
            columns.append(predict(channel, layout, theta, current.deviations)[0] - base)
            owners.append(effect)
    if not columns:
        return ()
    right, normal = project(problem, current, np.matmul(problem.whitener, np.stack(columns, axis=-1)))
    size = np.diag(normal)
    gain = np.where(size > 1e-12, right**2 / np.maximum(size, 1e-12), 0.0)
    best: dict[str, float] = {}
    for effect, value in zip(owners, gain, strict=True):
        best[effect] = max(best.get(effect, 0.0), float(value))
    ranked = sorted(best, key=lambda e: -best[e])
    # Calibration moves two ways and its start is no change at all; a start taken from the data may already be the whole
    # answer, whatever its first order says. Both are always worth a quick fit.
    told = (e for e in ranked if (start := CATALOGUE[e].start_from) is not None and start(channel))
    always = (*told, *(e for e in ranked if e == "calibration_error"))
    return tuple(dict.fromkeys([*ranked[:keep], *always]))


def _weaker(effect: str, name: str, start: float) -> float:
    parameter = next(p for p in CATALOGUE[effect].parameters if p.name == name)
    if name == "biot_at_5_m_s":
        return max(parameter.starts)
    return start


def _forward(problem: Problem, current: Fit, names: tuple[str, ...], moves: list[Move]) -> tuple[Fit, bool]:
    trials = _additions(problem, current, names)
    if not trials:
        return current, False
    for effect in sorted(trials, key=lambda e: trials[e].deviance)[:3]:
        trials[effect] = finish(problem, trials[effect])
    # What a better start alone gains is not the candidate's: the current model is fitted again from where it led.
    ahead = min(trials.values(), key=lambda f: f.deviance)
    again = refit(problem, current.layout, ahead)
    if again.deviance < current.deviance - 1.0:
        # A better start is worth as much to the candidates.
        current = again
        for effect in sorted(trials, key=lambda e: trials[e].deviance)[:3]:
            trials[effect] = min((trials[effect], add(problem, current, effect)), key=lambda f: f.deviance)
    gains = {e: current.deviance - f.deviance for e, f in trials.items()}
    best = max(gains, key=lambda e: evidence(problem, gains[e]) - price(e))
    ranked = tuple(sorted(gains.items(), key=lambda item: -item[1]))
    taken = evidence(problem, gains[best]) > price(best)
    moves.append(Move("add" if taken else "stop", best if taken else "", gains[best] if taken else 0.0, ranked))
    return (trials[best], True) if taken else (current, False)


def _additions(problem: Problem, current: Fit, names: tuple[str, ...]) -> dict[str, Fit]:
    """The current model with each other effect added; fits at a bound, or refused by the effect, are left out."""
    groups = problem.channel.interpolation.shape[1]
    trials = {}
    for effect in names:
        if effect in current.layout.effects:
            continue
        found = add(problem, current, effect)
        refused = CATALOGUE[effect].refused
        values = {name: value for name, (value, _) in found.values(groups)[effect].items()}
        # A parameter at its bound is no finding, unless the effect vanishes there and its gain with it.
        if at_bound(effect, values) or (refused is not None and refused(problem.channel, values)):
            continue
        trials[effect] = found
    return trials


def _backward(problem: Problem, current: Fit, base: Layout, moves: list[Move]) -> Fit:
    """Without the effects that, now that others are there, no longer earn their place."""
    while True:
        removable = [e for e in current.layout.effects if e not in base.effects]
        if len(removable) < 2:
            return current
        trials = {e: drop(problem, current, e) for e in removable}
        excess = {e: evidence(problem, f.deviance - current.deviance) - price(e) for e, f in trials.items()}
        worst = min(excess, key=excess.__getitem__)
        if excess[worst] > 0:
            return current
        moves.append(Move("remove", worst, current.deviance - trials[worst].deviance, ()))
        current = trials[worst]


def _exchange(problem, current, base, names, moves, swap=True):
    """Each effect found against every other in its place: how much it is needed, who could stand for it, and swaps."""
    necessity: dict[str, float] = {}
    rivals: dict[str, dict[str, float]] = {}
    ties: dict[str, dict[str, Fit]] = {}
    for effect in [e for e in current.layout.effects if e not in base.effects]:
        without = drop(problem, current, effect)
        necessity[effect] = without.deviance - current.deviance
        free = tuple(e for e in names if e not in current.layout.effects)
        others = _additions(problem, without, _promising(problem, without, free, 5))
        for e, f in others.items():
            if f.deviance - current.deviance < max(0.1 * necessity[effect], 30.0):
                others[e] = finish(problem, f)
        rises = {e: f.deviance - current.deviance for e, f in others.items()}
        rivals[effect] = {e: r for e, r in rises.items() if r < max(0.5 * necessity[effect], 2 * TIE)}
        ties[effect] = {e: others[e] for e, r in rises.items() if r < TIE}
        if swap and rises:
            best = min(rises, key=lambda e: rises[e] + price(e))
            if rises[best] + price(best) - price(effect) < -0.5:
                moves.append(Move("swap", f"{effect} -> {best}", -rises[best], ()))
                return _backward(problem, finish(problem, others[best]), base, moves), {}, {}, {}, True
    return current, necessity, rivals, ties, False
