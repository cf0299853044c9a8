"""What each form of the grammar would explain, to first order, and how much the best of so many explains by chance.

Scores are those of the fit (its own parameters and the runs' random effects have had their say): one prediction each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.discovery.grammar import periods_s
from shockrig.analysis.effects.behaviours import Form
from shockrig.analysis.effects.described import described
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect, by_name
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.model import Model, Point
from shockrig.analysis.inference.problem import Problem

Array = NDArray[np.float64]

DRAWS = 4000  # of the null: its quantile is then good to some 5 %
FALSE_ALARMS = 0.005  # of channels with nothing in them, in which the best of all forms may pass
STARTS = 3  # of each form that are kept
SEED = 10  # of the draws of the null: the same in every run of the program


@dataclass(frozen=True)
class Scored:
    """A form's entry, the values that it scores best at, best first, and the drop in deviance to first order."""

    effect: Effect
    starts: tuple[Mapping[str, float], ...]
    gain: float


def starts(effect: Effect, form: Form, channel: Channel) -> list[dict[str, float]]:
    """Values that a form's score is taken at."""
    found = effect.starts(channel)
    if form.behaves_as == "periodic":
        found = [start | {"period_s": float(period)} for start in found for period in periods_s(channel)]
    return found


def first_order(problem: Problem, near: Fit, forms: Iterable[Form]) -> tuple[list[Scored], float]:
    """Every form's best score beside a fit, best first, and the drop that the best of them reaches by chance."""
    channel = problem.channel
    base = near.model.predict(near.point)[0]
    whitener = problem.whitener.astype(np.float32)  # a score needs no more digits, and half of them take half the time
    columns, owners = [], []
    for form in forms:
        effect = described(form.key, channel.jumps_with_air)
        if effect.id in near.structure.ids:
            continue
        model = Model(channel, near.structure.adding(effect))
        tried = starts(effect, form, channel)
        thetas = np.stack([model.start(near.log_rates, near.choice | by_name(effect, s)) for s in tried])
        predicted = model.predict(Point(thetas, near.deviations)) - base
        columns.append(np.matmul(whitener, np.moveaxis(predicted, 0, -1).astype(np.float32)))
        owners += [(effect, start) for start in tried]
    if not columns:
        return [], np.inf
    right, normal = near.scores(problem, np.concatenate(columns, axis=-1).astype(float))
    size = np.diag(normal)
    seen = size > 1e-9 * max(size.max(), 1e-300)
    gain = np.where(seen & (size > 1e-8), right**2 / np.maximum(size, 1e-12), 0.0)
    by_form: dict[str, list[tuple[float, Mapping[str, float]]]] = {}
    for (effect, start), value in zip(owners, gain, strict=True):
        by_form.setdefault(effect.id, []).append((float(value), start))
    entries = {effect.id: effect for effect, _ in owners}
    scored = []
    for key, pairs in by_form.items():
        ordered = sorted(pairs, key=lambda one: -one[0])
        best = tuple(start for _, start in ordered[:STARTS])
        scored.append(Scored(entries[key], best, ordered[0][0]))
    return sorted(scored, key=lambda s: -s.gain), null_of_the_maximum(normal[np.ix_(seen, seen)])


def null_of_the_maximum(normal: Array, false_alarms: float = FALSE_ALARMS) -> float:
    """Quantile of the largest score's square over all columns where there is nothing, from their covariance (C, C)."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    # The symmetric root: it alone does not depend on the eigenvectors' signs, which are the processor's choice.
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    drawn = root @ np.random.default_rng(SEED).standard_normal((scale.size, DRAWS))
    return float(np.quantile((drawn**2).max(axis=0), 1.0 - false_alarms))
