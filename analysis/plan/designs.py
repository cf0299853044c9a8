"""What each run of a menu would bring: information on what goals want, evidence between what is tied, variety."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterize.result import ChannelResult, Characterization
from shockrig.analysis.diagnose.shock import (
    LONG_S,
    LONGEST_S,
    SHORTEST_S,
    USUAL_C,
    PlannedShock,
    Usual,
    deciding_menu,
    precision_menu,
)
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName
from shockrig.analysis.fleet.fleet_prior import WithFleet
from shockrig.analysis.fleet.statistics import LEAST_VARIANCE, film
from shockrig.analysis.plan.evidence import REJECTED_FROM, averaged, expected
from shockrig.analysis.plan.goals import Goals, Place
from shockrig.analysis.plan.information import Information, information, rates_at
from shockrig.analysis.plan.judged import ChannelLook
from shockrig.analysis.plan.precision import Target
from shockrig.analysis.plan.varied import shock_of, variety
from shockrig.files.campaign import Run
from shockrig.files.fleet_file import ALPHA, Coordinate, Population

Array = NDArray[np.float64]
ENOUGH_T63 = 9.0  # of record after the transfer in which a film's rate is told: 98 % of its step takes 4.7
ENOUGH_BEAD_T63 = 14.0
MOST_TOLD = REJECTED_FROM - 0.5  # ln E against a rival, of one that still stands
MOST_AMBIENTS = 3  # at which runs that decide are looked for


@dataclass(frozen=True)
class Precise:
    """One channel's information, and which targets it holds: (target, index of its rate).

    `runs` (T,) is on how many each rests, `factors` (T,) the square of its uncertainty over that of the fit alone:
    scatter shared by channels, misfit.
    """

    info: Information
    of: tuple[tuple[Target, int], ...]
    runs: NDArray[np.int64]
    factors: Array

    @property
    def places(self) -> list[int]:
        """Of the rates that targets want."""
        return sorted({g for _, g in self.of})

    def helped(self, m: int) -> NDArray[np.bool_]:
        """The targets (T,) that run `m` of the menu tells anything of."""
        return np.array([self.info.added[m, g, g] > 1.0 for _, g in self.of])

    def after(self, m: int) -> Precise:
        """With that run made."""
        info = replace(self.info, known=self.info.known + self.info.added[m])
        return replace(self, info=info, runs=self.runs + self.helped(m))


@dataclass(frozen=True)
class Designs:
    """A menu with what each of its runs would bring.

    Attributes
    ----------
    menu : tuple of Shock
        M runs; the last one is the anchor where there is one.
    anchor : int or None
        Where in the menu the first run once more is; it is chosen by its turn alone.
    precise : tuple of Precise
        For each channel with goals of precision.
    pairs : ndarray (P, M)
        Expected ln E of each run for each pair of tied explanations, without what the first of a dispute pays once.
    needed : ndarray (P,)
        ln E that each still needs.
    evidence : ndarray (M,)
        Expected ln E against the explanation that a run speaks against most, whichever of those tied is the true one.
    varied : function of planned runs
        Worth (M, 2) of each run, and of the second of two, for what has not been varied by then.
    """

    menu: tuple[PlannedShock, ...]
    anchor: int | None
    precise: tuple[Precise, ...]
    pairs: Array
    needed: Array
    evidence: Array
    varied: Callable[[Sequence[PlannedShock]], Array]

    @classmethod
    def of(
        cls,
        found: Mapping[str, Characterization | None],
        looks: Mapping[Place, ChannelLook],
        wanted: Sequence[Target],
        goals: Goals,
        usual: Usual,
        allowed: Callable[[PlannedShock], bool],
        first: Run | None = None,
        population: Population | None = None,
        fleets: Mapping[str, WithFleet] = MappingProxyType({}),
    ) -> Designs:
        """The menu for what is wanted, as far as anything is known to design by; `found` of each probe, `fleets` of
        those whose type's population is known."""
        shocks = menu_of(found, looks, goals, usual, allowed)
        again = None if first is None else shock_of(first)
        anchor = None
        if again is not None and allowed(again):
            anchor = len(shocks)
            shocks += (replace(again, why="the first run once more: does anything drift?"),)
        precise = []
        for probe, one in found.items() if shocks else ():
            for name, result in ({} if one is None else one.channels()).items():
                own = [t for t in wanted if (t.channel, t.probe) == (name, probe)]
                belongs = population is not None and probe in fleets and fleets[probe].belongs(name)
                if own:
                    precise.append(_precise(name, result, own, goals, shocks, population if belongs else None))
        told = _told_apart(looks.values() if goals.ties and shocks else (), shocks)
        return cls(shocks, anchor, tuple(precise), *told, partial(variety, looks if goals.ties else {}, shocks))

    def after(self, m: int) -> Designs:
        """With run `m` of the menu made."""
        left = np.maximum(self.needed - self.pairs[:, m], 0.0)
        return replace(self, precise=tuple(p.after(m) for p in self.precise), needed=left)

    @property
    def choosable(self) -> tuple[PlannedShock, ...]:
        """The menu without the anchor."""
        return self.menu[: self.anchor]


def _precise(
    name: ChannelName,
    result: ChannelResult,
    wanted: Sequence[Target],
    goals: Goals,
    shocks: Sequence[PlannedShock],
    population: Population | None,
) -> Precise:
    """What runs would say of the rates that are wanted of a channel; with its type's population, where it is of it."""
    part = result.parts[0]
    info = information(part.problem, part.fit, result.noise, shocks, goals.ambients_c)
    plain = not part.fit.structure.effects and not QUANTITIES[name].pooled
    used = np.array([s.isothermal or not plain for s in shocks])
    info = replace(info, added=info.added * used[:, None, None])
    if population is not None:
        info = replace(info, known=info.known + _beforehand(info, population, name))
    places = [0 if t.ambient_c is None else int(np.argmin(np.abs(info.ambients_c - t.ambient_c))) for t in wanted]
    now, runs = info.variances(info.known), np.array([t.runs for t in wanted])
    factors = np.array([t.relative**2 / now[g] if t.runs else 1.0 for t, g in zip(wanted, places, strict=True)])
    return Precise(info, tuple(zip(wanted, places, strict=True)), runs, factors)


def _told_apart(looks: Iterable[ChannelLook], shocks: Sequence[PlannedShock]) -> tuple[Array, Array, Array]:
    """Of all pairs of tied explanations `pairs`, `needed` and `evidence`, as `Designs` has them."""
    pairs, needed, evidence = [], [], np.zeros(len(shocks))
    for look in looks:
        if (open_ := look.open_dispute) is None:
            continue
        told, each_further = expected(*open_, shocks)
        evidence = np.maximum(evidence, averaged(told.max(axis=1), open_.dispute))
        for i, j in permutations(range(len(told)), 2):
            pairs.append(np.maximum(each_further[i, j], 0.0))
            needed.append(REJECTED_FROM - float(np.clip(open_.dispute.so_far[j], 0.0, MOST_TOLD)))
    return np.array(pairs).reshape(len(pairs), len(shocks)), np.array(needed), evidence


def _beforehand(info: Information, population: Population, name: ChannelName) -> Array:
    """What the population of a type says of the rates, as a normal matrix (P, P)."""
    rates = info.ambients_c.size
    asked = [Coordinate(name, ALPHA)] if QUANTITIES[name].pooled else [film(float(t)) for t in info.ambients_c]
    H = population.design(asked)
    scatter = population.table_scatter**2 * (not QUANTITIES[name].pooled) + population.beyond(asked)
    covariance = H @ population.predictive @ H.T + np.diag(scatter + LEAST_VARIANCE)
    known = np.zeros_like(info.known)
    known[:rates, :rates] = np.linalg.inv(covariance)
    return known


def menu_of(
    found: Mapping[str, Characterization | None],
    looks: Mapping[Place, ChannelLook],
    goals: Goals,
    usual: Usual,
    allowed: Callable[[PlannedShock], bool],
) -> tuple[PlannedShock, ...]:
    """Runs that could be made for some goals, from what is known so far."""
    dwells = partial(_dwell_s, found)
    menu = precision_menu(goals.ambients_c, usual, dwells)
    if goals.ties:
        menu += deciding_menu(_deciding_ambients(looks), usual, dwells)
    return tuple(dict.fromkeys(s for s in menu if allowed(s)))


def _dwell_s(found: Mapping[str, Characterization | None], ambient_c: float, isothermal: bool) -> float:
    """How long a record after the transfer has to be, from the response times of the slowest probe so far."""
    name: ChannelName = "humidity" if isothermal else "temperature"
    own = [one.channels()[name] for one in found.values() if one is not None and name in one.channels()]
    if not own:
        return LONG_S
    slowest = max(_t63_s(one, name, ambient_c) for one in own)
    return float(np.clip((ENOUGH_T63 if isothermal else ENOUGH_BEAD_T63) * slowest, SHORTEST_S, LONGEST_S))


def _t63_s(result: ChannelResult, name: ChannelName, ambient_c: float) -> float:
    t63 = np.array([row.response.t63_s for row in result.rows])
    if QUANTITIES[name].pooled:
        return float(t63[0])
    at = rates_at(np.array([row.ambient_c for row in result.rows]), -np.log(t63), np.array([ambient_c]))
    return float(np.exp(-at[0]))


def _deciding_ambients(looks: Mapping[Place, ChannelLook]) -> list[float]:
    """Ambients with runs already, about the usual one: elsewhere a new rate would take up what a run says."""
    seen: dict[float, float] = {}
    for look in looks.values():
        if look.problem is not None and look.rivals:
            channel = look.problem.channel
            for t in channel.conditions.destination_c if channel.quantity.pooled else channel.ambients_c:
                seen[float(round(t))] = abs(t - USUAL_C)
    nearest = sorted(seen, key=seen.__getitem__)
    return nearest[:MOST_AMBIENTS] or [USUAL_C]
