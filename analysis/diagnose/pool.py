"""Models that were weighed: each with its score on unseen runs, their weights, and what these state."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.effects.forms import ONLY_BEFORE, STEP, form_of, laws_of
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.predictive import Score, weights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rated:
    """A fitted model with its score on unseen runs, and the log prior of its effects [nats]."""

    fit: Fit
    score: Score
    log_prior: float

    @property
    def ids(self) -> frozenset[str]:
        """Of its effects."""
        return frozenset(self.fit.structure.ids)

    @property
    def laws(self) -> frozenset[str]:
        """Of its effects: at which run a change begins does not make another law."""
        return frozenset(law_of(id_) for id_ in self.fit.structure.ids)

    @property
    def dependences(self) -> int:
        """How many conditions the strengths of its forms depend on, more time constants than one among them."""
        return sum(len(form_of(id_).more) for id_ in self.ids if is_described(id_))

    def holds(self, effect: str) -> bool:
        """Whether it has an effect, or a form that is its law with a strength that depends on something more."""
        return any(law_of(effect) in _laws_within(id_) for id_ in self.ids)

    @property
    def value(self) -> float:
        """Log predictive density and log prior [nats]."""
        return self.score.total + self.log_prior


def law_of(effect: str) -> str:
    """An effect's id without the run at which a change begins."""
    return re.sub(rf"({STEP}|{ONLY_BEFORE})\d+", r"\1n", effect)


@cache
def _laws_within(effect: str) -> frozenset[str]:
    """An effect's law, and those that a form is with a strength that depends on something more, or with more time
    constants."""
    if not is_described(effect):
        return frozenset({effect})
    form = form_of(effect)
    found: set[str] = set()
    for size in range(len(form.more) + 1):
        for without in itertools.combinations(form.more, size):
            less = replace(form, depends_on=tuple(on for on in form.depends_on if on not in without))
            found |= {law_of(less.key), *(name for name, _ in laws_of(less))}
    return frozenset(found)


@dataclass(frozen=True)
class Search:
    """Outcome of a search.

    Attributes
    ----------
    plain, best : Rated
        The model that it began from, and the heaviest of as many effects as are there with some certainty.
    pool : tuple of Rated
        All models that were weighed, the heaviest first.
    weights : ndarray (M,)
    fits : int
        How many it took.
    predictors : tuple of Rated
        The same with those whose effects say nothing where they ended: no name follows from such a model, a prediction
        may. The heaviest first.
    likeliest : Rated
        The heaviest of them but for those that do no more than what is known of the bench allows by itself.
    ended_early : bool
        Whether it made as many fits as it may, so that more may be there.
    """

    plain: Rated
    best: Rated
    pool: tuple[Rated, ...]
    weights: Array
    fits: int
    predictors: tuple[Rated, ...]
    likeliest: Rated
    ended_early: bool = False

    @property
    def leaves_open(self) -> bool:
        """Whether the plain model is stated since nothing is sure enough, though another is likelier than it."""
        return self.best is self.plain and self.likeliest is not self.plain

    def probability(self, effect: str) -> float:
        """Of an effect's being there: the weight of all models that hold its law, however that may depend on things."""
        held = (w for one, w in zip(self.pool, self.weights, strict=True) if one.holds(effect))
        return float(min(sum(held), 1.0))

    def may_state(self, one: Rated) -> bool:
        """Whether a model is one of the pool; others may predict."""
        return any(other is one for other in self.pool)

    def weight(self, one: Rated) -> float:
        """Of one model."""
        return float(sum(w for other, w in zip(self.pool, self.weights, strict=True) if other is one))

    def instead(self, effect: str) -> list[tuple[Rated, float]]:
        """The models without an effect of the best one that are as large, by what stands in its place, with how many
        nats they are behind (the closest first)."""
        found = []
        for one in self.pool:
            new = one.laws - self.best.laws
            if not one.holds(effect) and new and len(self.best.laws - one.laws) <= len(new):
                found.append((one, self.best.value - one.value))
        return sorted(found, key=lambda item: item[1])

    def rivals(self) -> list[Rated]:
        """Models tied with the best one that hold something else in the place of something that it has."""
        own = self.best.laws
        return [one for one in self.tied() if one.laws - own and own - one.laws]

    def without_best(self) -> Search:
        """The search where the best model is out: the others, weighed anew."""
        return self._among(one for one in self.pool if one is not self.best)

    def without(self, effects: frozenset[str]) -> Search:
        """The search where no model has any of some effects: the others, weighed anew."""
        return self._among(one for one in self.pool if not one.ids & effects)

    def _among(self, models: Iterable[Rated]) -> Search:
        """The search among some of its models, weighed anew."""
        pool, weight = heaviest_first(models)
        return stated(replace(self, pool=pool, weights=weight))

    def tied(self) -> list[Rated]:
        """Models whose weight is not small beside the best one's, the best first."""
        least = level("tie") * self.weight(self.best)
        return [one for one, w in zip(self.pool, self.weights, strict=True) if w >= least]


def value_of(one: Rated) -> float:
    """What models are compared by [nats]."""
    return one.value


def keep_best(models: dict[frozenset[str], Rated], one: Rated) -> Rated:
    """The best fit so far of a model among some."""
    known = models.get(one.ids)
    if known is None or one.fit.deviance < known.fit.deviance:
        models[one.ids] = one
    return models[one.ids]


def heaviest_first(among: Iterable[Rated]) -> tuple[tuple[Rated, ...], Array]:
    """The best of some models with their weights by their predictive densities."""
    best = sorted(among, key=lambda r: -r.value)
    weight = weights([one.score.runs for one in best], [one.log_prior for one in best])
    order = sorted(range(len(best)), key=lambda i: (-weight[i], -best[i].value))
    return tuple(best[i] for i in order), weight[order]


def stuck(one: Rated, among: Iterable[Rated]) -> bool:
    """Whether a fit leaves more of the runs than a model that it extends, which is a part of it: it ended elsewhere."""
    # A value that leaves the model as it was is in the range of an effect that says so, and of a lag at its weakest.
    nested = {
        e.id
        for e in one.fit.structure.effects
        if any(p.none is not None or p.weakest is not None for p in e.parameters)
    }
    parts = (other for other in among if other.ids < one.ids and one.ids - other.ids <= nested)
    return any(part.fit.deviance < one.fit.deviance for part in parts)


def stated(found: Search) -> Search:
    """A search with the model that its weights state."""
    # As many effects are stated as are there with that probability, whichever they are: look-alikes that share the
    # weight of one are one effect, tied; weight that is shared for a second one is no evidence for any. Among models
    # with so many, the same holds for what they depend on.
    pool = found.pool
    left = list(range(len(pool)))
    for sizes_of in ([len(one.ids) for one in pool], [one.dependences for one in pool]):
        sizes, own = np.array(sizes_of)[left], found.weights[left]
        enough = level("named") * own.sum()
        most = max(k for k in np.unique(sizes) if own[sizes >= k].sum() >= enough or k == sizes.min())
        left = [i for i, size in zip(left, sizes, strict=True) if size == most]
    return replace(found, best=pool[left[0]])
