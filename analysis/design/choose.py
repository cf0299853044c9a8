"""The runs that bring most per minute, chosen one after the other; an anchor every so often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from shockrig.analysis.design.evidence import REJECTED_FROM
from shockrig.analysis.design.menu import Airs, PlannedShock
from shockrig.analysis.design.minutes import Minutes, airs_of_run
from shockrig.analysis.design.prospects import Prospects
from shockrig.analysis.design.recorded_so_far import farthest, is_again
from shockrig.files.campaign import Run

Array = NDArray[np.float64]
ANCHOR_EVERY = 6
UNTOLD = float("nan")  # where nothing is expected of a run: it was not chosen for what it brings
# Of the best worth per minute, that a run may lack: among these chance chooses, so that order and conditions do not go
# together.
NEARLY_BEST = 0.03
OPTIONS_SHOWN = 6
LEAST_GAIN = 0.01  # of a goal, by the best run of the menu: it would take a hundred, if nobody gives minutes for them


@dataclass(frozen=True)
class Choice:
    """A run, the bench minutes that it is expected to take, and what is expected of it.

    Attributes
    ----------
    worth : float
        Of all goals together, what one goal in full is worth being 1.
    goals : float
        Of that, the share for precision.
    information : float
        That it adds on the rates that goals want [nats].
    evidence : float
        Expected ln E against the explanation that it speaks against most, whichever of those tied is the true one.
    beside : float
        What a second probe, recorded beside a single one, is expected to add to `evidence`.
    """

    shock: PlannedShock
    minutes: float
    worth: float = 0.0
    goals: float = UNTOLD
    information: float = UNTOLD
    evidence: float = UNTOLD
    beside: float = 0.0

    @property
    def per_minute(self) -> float:
        return self.worth / self.minutes


def choose_runs(
    prospects: Prospects, minutes: Minutes, recorded: Sequence[Run], count: int
) -> tuple[list[Choice], tuple[Choice, ...]]:
    """The runs that bring most per minute, one after the other; and the best of the menu for the first of them.

    A run is weighed by what it brings once, or made twice where that is more a minute: what no run has varied needs
    two, and the chambers travel once. The runs that are `recorded` come before them; at every sixth place stands the
    first run once more, so that a drift of sensors or bench shows, but where one of the five before it is that already,
    such as the last one of a protocol that closes.
    """
    number = len(recorded)
    rng = np.random.default_rng([number, 1])
    airs = airs_of_run(recorded[-1]) if recorded else None
    again = [i for i in range(1, number) if is_again(recorded[i], recorded[0])]
    since = number - 1 - again[-1] if again else ANCHOR_EVERY
    chosen: list[Choice] = []
    considered: tuple[Choice, ...] = ()
    for _ in range(count):
        bonus = prospects.varied([one.shock for one in chosen])
        options = [_weighed(prospects, m, bonus[m, 0], minutes, airs) for m in range(len(prospects.menu))]
        twice = [
            _weighed(prospects.after(m), m, bonus[m, 1], minutes, shock.airs)
            for m, shock in enumerate(prospects.choosable)
        ]
        rates = [max(one.per_minute, (one.worth + two.worth) / (one.minutes + two.minutes))
                 for one, two in zip(options, twice, strict=False)]  # fmt: skip
        best = max(rates, default=0.0)
        if best < 1e-5:
            break
        m = int(rng.choice([m for m, rate in enumerate(rates) if rate >= (1.0 - NEARLY_BEST) * best]))
        due = (number + len(chosen) + 1) % ANCHOR_EVERY == 0 and since + len(chosen) >= ANCHOR_EVERY - 1
        if prospects.anchor is not None and due:
            m = prospects.anchor
        if not considered:
            others = sorted((i for i in range(len(rates)) if i != m), key=lambda i: -rates[i])
            considered = (options[m], *(options[i] for i in others[: OPTIONS_SHOWN - 1]))
        chosen.append(options[m])
        prospects, airs = prospects.after(m), prospects.menu[m].airs
    return chosen, considered


def _weighed(prospects: Prospects, m: int, bonus: float, minutes: Minutes, airs: Airs | None) -> Choice:
    """What run `m` of a menu brings after one in other airs; `bonus` for what it varies."""
    share, information = 0.0, 0.0
    for p in prospects.wanted_rates:
        shares, told = p.brought(m)
        information += told
        for each in shares:
            share += each
    deciding = float(as_far_as_needed(prospects.pairs[:, m], prospects.needed).sum() / REJECTED_FROM)
    shock, evidence = prospects.menu[m], float(prospects.evidence[m])
    return Choice(shock, minutes.of(airs, shock), share + deciding + bonus, share, information, evidence)


def as_far_as_needed(expected: Array, needed: Array) -> Array:
    """Mean of what comes of expected ln E, of each pair at most what it needs: a log-likelihood ratio of mean m has the
    variance 2 m, so that a run of which just enough is expected often brings less."""
    scatter = np.sqrt(2.0 * expected + 1e-12)
    over = (expected - needed) / scatter
    beyond = scatter * (over * ndtr(over) + np.exp(-0.5 * over**2) / np.sqrt(2.0 * np.pi))
    return np.maximum(expected - beyond, 0.0)


def chase(menu: Sequence[PlannedShock], recorded: Sequence[Run], minutes: Minutes) -> list[Choice]:
    """The run for what nothing explains: that of the menu which is least like any that was `recorded`."""
    if not menu:
        return []
    shock = replace(farthest(menu, recorded), why="nothing like it has been recorded")
    return [Choice(shock, minutes.of(airs_of_run(recorded[-1]), shock))]
