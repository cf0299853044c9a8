"""The runs that bring most per minute, chosen one after the other; an anchor every so often."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterization.result import Characterization
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.analysis.planning.evidence import REJECTED, student
from shockrig.analysis.planning.goals import Goals
from shockrig.analysis.planning.hypothetical import rates_at
from shockrig.analysis.planning.information import Information, information, nats, separations
from shockrig.analysis.planning.judged import Look
from shockrig.analysis.planning.minutes import Airs, Minutes, airs_of, airs_of_run
from shockrig.analysis.planning.precision import FEWEST_RUNS, UNKNOWN, Target
from shockrig.analysis.planning.shock import (
    LONG_S,
    LONGEST_S,
    SHORTEST_S,
    USUAL_C,
    Shock,
    Usual,
    deciding_menu,
    precision_menu,
)
from shockrig.analysis.planning.varied import farthest, shock_of, variety
from shockrig.files.campaign import Campaign, Run

Array = NDArray[np.float64]
ANCHOR_EVERY = 6
UNTOLD = float("nan")  # where nothing is expected of a run: it was not chosen for what it brings
ENOUGH_T63 = 9.0  # of record after the transfer in which a film's rate is told: 98 % of its step takes 4.7
ENOUGH_BEAD_T63 = 14.0
NEARLY = (
    0.97  # of the best worth per minute: among these chance chooses, so that order and conditions do not go together
)
SHOWN = 6
MOST_AMBIENTS = 3  # at which runs that decide are looked for


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
    expected : mapping
        Label of each goal -> its relative standard uncertainty after the run.
    """

    shock: Shock
    minutes: float
    worth: float
    goals: float
    information: float
    evidence: float
    expected: Mapping[str, float] = field(default_factory=dict)

    @property
    def per_minute(self) -> float:
        return self.worth / self.minutes


@dataclass(frozen=True)
class _Precise:
    """One channel's information, and which targets it holds: (target, index of its rate)."""

    info: Information
    of: tuple[tuple[Target, int], ...]

    def factors(self) -> Array:
        """Square of each target's uncertainty over that of the fit alone: scatter shared by channels, misfit."""
        now = self.info.variances(self.info.known)
        return np.array([(t.relative**2 / now[g]) if t.runs else 1.0 for t, g in self.of])

    @property
    def places(self) -> list[int]:
        """Of the rates that targets want."""
        return sorted({g for _, g in self.of})


@dataclass(frozen=True)
class Designs:
    """A menu with what each of its runs would bring.

    Attributes
    ----------
    menu : tuple of Shock
        M runs; the last one is the anchor where there is one.
    anchor : int or None
        Where in the menu the first run once more is; it is chosen by its turn alone.
    precise : tuple of _Precise
        For each channel with goals of precision.
    pairs : tuple of ndarray (M,)
        Expected ln E of each run for each pair of tied explanations.
    needed : ndarray (pairs,)
        ln E that each still needs.
    bonus : ndarray (M,)
        For what has not been varied yet.
    """

    menu: tuple[Shock, ...]
    anchor: int | None
    precise: tuple[_Precise, ...]
    pairs: tuple[Array, ...]
    needed: Array
    bonus: Array

    @classmethod
    def of(
        cls,
        found: Characterization | None,
        looks: Mapping[ChannelName, Look],
        wanted: Sequence[Target],
        goals: Goals,
        usual: Usual,
        allowed: Callable[[Shock], bool],
        first: Run | None = None,
    ) -> Designs:
        """The menu for what is wanted, as far as anything is known to design by."""
        known = {} if found is None else found.channels()
        shocks = menu_of(found, looks, goals, usual, allowed)
        again = None if first is None else shock_of(first)
        anchor = None
        if again is not None and allowed(again):
            anchor = len(shocks)
            shocks += (replace(again, why="the first run once more: does anything drift?"),)
        precise, pairs, needed = [], [], []
        for name, result in known.items() if shocks else ():
            own = [t for t in wanted if t.channel == name]
            if not own:
                continue
            part = result.parts[0]
            info = information(part.problem, part.fit, result.noise, shocks, goals.ambients_c)
            plain = not part.fit.structure.effects and not QUANTITIES[name].pooled
            used = np.array([s.isothermal or not plain for s in shocks])
            info = replace(info, added=info.added * used[:, None, None])
            places = [0 if t.ambient_c is None else int(np.argmin(np.abs(info.ambients_c - t.ambient_c))) for t in own]
            precise.append(_Precise(info, tuple(zip(own, places, strict=True))))
        for look in looks.values() if goals.ties and shocks else ():
            for i, one in enumerate(look.rivals):
                for j, other in enumerate(look.rivals):
                    if i != j and look.problem is not None and look.noise is not None and look.verdict.dispute:
                        degrees = look.verdict.dispute.degrees(look.problem.channel.rates)
                        apart = 0.5 * separations(look.problem, look.noise, one, other, shocks)
                        pairs.append(np.array([student(float(x), degrees) for x in apart]))
                        needed.append(_still_needed(look, j))
        bonus = variety(looks, shocks) if goals.ties else np.zeros(len(shocks))
        return cls(shocks, anchor, tuple(precise), tuple(pairs), np.array(needed), bonus)

    @property
    def choosable(self) -> tuple[Shock, ...]:
        """The menu without the anchor."""
        return self.menu[: self.anchor]

    def chase(
        self, campaign: Campaign | None, worst: Mapping[ChannelName, str], minutes: Minutes, chased: int, count: int
    ) -> list[Choice]:
        """Runs for what nothing explains: once more where it is largest, and where nobody has looked yet, by turns."""
        assert campaign is not None
        by_id = {run.id: run for run in campaign.runs}
        before = airs_of_run(campaign.runs[-1])
        again = [shock for id_ in worst.values() if (shock := shock_of(by_id[id_])) is not None]
        if again and chased % 2 == 0:
            chosen = replace(again[0], dwell_s=LONGEST_S, why="what is left is largest there")
        elif self.choosable:
            chosen = replace(farthest(self.choosable, campaign.runs), why="nothing like it has been recorded")
        else:
            return []
        return [Choice(chosen, minutes.of(before, chosen), 0.0, UNTOLD, UNTOLD, UNTOLD)][:count]


def menu_of(
    found: Characterization | None,
    looks: Mapping[ChannelName, Look],
    goals: Goals,
    usual: Usual,
    allowed: Callable[[Shock], bool],
) -> tuple[Shock, ...]:
    """Runs that could be made for some goals, from what is known so far."""
    dwells = _Dwells(found)
    menu = precision_menu(goals.ambients_c, usual, dwells)
    if goals.ties:
        menu += deciding_menu(_deciding_ambients(looks), usual, dwells)
    return tuple(dict.fromkeys(s for s in menu if allowed(s)))


class _Dwells:
    """How long a record after the transfer has to be, from the response times found so far."""

    def __init__(self, found: Characterization | None):
        self._found = found

    def __call__(self, ambient_c: float, isothermal: bool) -> float:
        channels = {} if self._found is None else self._found.channels()
        result = channels.get("humidity" if isothermal else "temperature")
        if result is None:
            return LONG_S
        rows = [row for row in result.rows]
        t63 = np.array([row.response.t63_s for row in rows])
        at = rates_at(np.array([row.ambient_c for row in rows]), -np.log(t63), np.array([ambient_c]))
        own = float(np.exp(-at[0])) if isothermal else float(t63[0])
        return float(np.clip((ENOUGH_T63 if isothermal else ENOUGH_BEAD_T63) * own, SHORTEST_S, LONGEST_S))


def _deciding_ambients(looks: Mapping[ChannelName, Look]) -> list[float]:
    """Ambients with runs already, about the usual one: elsewhere a new rate would take up what a run says."""
    seen: dict[float, float] = {}
    for look in looks.values():
        if look.problem is not None and look.rivals:
            channel = look.problem.channel
            for t in channel.conditions.destination_c if channel.quantity.pooled else channel.ambients_c:
                seen[float(round(t))] = abs(t - USUAL_C)
    nearest = sorted(seen, key=seen.__getitem__)
    return nearest[:MOST_AMBIENTS] or [USUAL_C]


def _still_needed(look: Look, rival: int) -> float:
    """ln E that is missing against a rival that still stands."""
    verdict = look.verdict
    standing = [x for x in verdict.against if x < REJECTED]
    return REJECTED - min(max(standing[rival], 0.0), REJECTED - 0.5)


def choose_runs(
    designs: Designs, minutes: Minutes, last: Run | None, count: int, number: int
) -> tuple[list[Choice], tuple[Choice, ...]]:
    """The runs that bring most per minute, one after the other; and the best of the menu for the first of them.

    `number` of runs come before them; at every sixth place stands the first run once more, so that a drift of sensors
    or bench shows.
    """
    rng = np.random.default_rng([number, 1])
    normals = [p.info.known for p in designs.precise]
    runs = [np.array([t.runs for t, _ in p.of]) for p in designs.precise]
    have = np.zeros(designs.needed.size)
    bonus = designs.bonus.copy()
    airs: Airs | None = None if last is None else airs_of_run(last)
    chosen: list[Choice] = []
    considered: tuple[Choice, ...] = ()
    for _ in range(count):
        options = [
            _weighed(designs, m, normals, runs, have, bonus, minutes.of(airs, shock))
            for m, shock in enumerate(designs.choosable)
        ]
        best = max((c.per_minute for c in options), default=0.0)
        if best < 1e-5:
            break
        near = [m for m, c in enumerate(options) if c.per_minute >= NEARLY * best]
        m = int(rng.choice(near))
        if designs.anchor is not None and (number + len(chosen) + 1) % ANCHOR_EVERY == 0:
            m, again = designs.anchor, designs.menu[designs.anchor]
            options.append(_weighed(designs, m, normals, runs, have, bonus, minutes.of(airs, again)))
        if not considered:
            others = sorted((c for i, c in enumerate(options) if i != m), key=lambda c: -c.per_minute)
            considered = (options[m], *others[: SHOWN - 1])
        chosen.append(options[m])
        for k, p in enumerate(designs.precise):
            normals[k] = normals[k] + p.info.added[m]
            runs[k] = runs[k] + np.array([p.info.added[m][g, g] > 1.0 for _, g in p.of])
        have = have + np.array([pair[m] for pair in designs.pairs])
        bonus[bonus >= bonus[m]] = 0.0 if bonus[m] > 0 else bonus[bonus >= bonus[m]]
        airs = airs_of(designs.menu[m])
    return chosen, considered


def _weighed(
    designs: Designs,
    m: int,
    normals: Sequence[Array],
    runs: Sequence[Array],
    have: Array,
    bonus: Array,
    minutes: float,
) -> Choice:
    share, told_of_goals, expected = 0.0, 0.0, {}
    for p, normal, count in zip(designs.precise, normals, runs, strict=True):
        added, factors = p.info.added[m], p.factors()
        now, then = p.info.variances(np.stack([normal, normal + added])) * 1.0
        told_of_goals += nats(normal, normal + added, p.places)
        for k, (target, g) in enumerate(p.of):
            helps = added[g, g] > 1.0
            before = progress(target, factors[k] * now[g], int(count[k]))
            after = progress(target, factors[k] * then[g], int(count[k]) + helps)
            share += max(after - before, 0.0)
            expected[target.label] = float(np.sqrt(min(factors[k] * then[g], UNKNOWN**2)))
    told = np.array([pair[m] for pair in designs.pairs])
    deciding = float((np.minimum(have + told, designs.needed) - np.minimum(have, designs.needed)).sum() / REJECTED)
    best = float(told.max(initial=0.0))
    return Choice(designs.menu[m], minutes, share + deciding + float(bonus[m]), share, told_of_goals, best, expected)


def progress(target: Target, variance: float, runs: int) -> float:
    """The share of a goal that is reached: of the information that it needs, and of the runs, at most 1."""
    return min(target.wanted**2 / max(variance, 1e-30), runs / FEWEST_RUNS, 1.0)
