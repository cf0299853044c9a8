"""What each run of a menu would bring: information on what goals want, evidence between what is tied, variety."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterize.result import ChannelResult, Characterization
from shockrig.analysis.design.evidence import OpenDispute, told_apart
from shockrig.analysis.design.information import Information, information, nats, rates_at
from shockrig.analysis.design.menu import (
    LONG_S,
    LONGEST_S,
    SHORTEST_S,
    USUAL_C,
    PlannedShock,
    Usual,
    deciding_menu,
    precision_menu,
)
from shockrig.analysis.design.recorded_so_far import variety
from shockrig.analysis.design.targets import Target
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName
from shockrig.analysis.fleet.fleet_prior import WithFleet
from shockrig.analysis.fleet.statistics import LEAST_VARIANCE, film
from shockrig.files.fleet_file import ALPHA, Coordinate, Population

Array = NDArray[np.float64]
ENOUGH_T63 = 9.0  # of record after the transfer in which a film's rate is told: 98 % of its step takes 4.7
ENOUGH_BEAD_T63 = 14.0
MOST_AMBIENTS = 3  # at which runs that decide are looked for


@dataclass(frozen=True)
class WantedRates:
    """One channel's information, and which targets it holds: (target, index of its rate).

    `runs` (T,) is on how many each rests, `factors` (T,) the square of its uncertainty over that of the fit alone:
    scatter shared by channels, misfit.
    """

    info: Information
    of: tuple[tuple[Target, int], ...]
    runs: NDArray[np.int64]
    factors: Array

    def helped(self, m: int) -> NDArray[np.bool_]:
        """The targets (T,) that run `m` of the menu tells anything of."""
        return np.array([self.info.added[m, g, g] > 1.0 for _, g in self.of])

    def brought(self, m: int) -> tuple[list[float], float]:
        """What run `m` of the menu brings: the share of each target's goal, and information on the rates that they want
        [nats]."""
        before, after = self.info.known, self.info.known + self.info.added[m]
        now, then = self.info.variances(np.stack([before, after]))
        targets = zip(self.of, self.factors, self.runs, self.helped(m), strict=True)
        shares = [
            max(one.reached(factor * then[g], runs + more) - one.reached(factor * now[g], runs), 0.0)
            for (one, g), factor, runs, more in targets
        ]
        return shares, nats(before, after, sorted({g for _, g in self.of}))

    def after(self, m: int) -> WantedRates:
        """With that run made."""
        info = replace(self.info, known=self.info.known + self.info.added[m])
        return replace(self, info=info, runs=self.runs + self.helped(m))


@dataclass(frozen=True)
class KnownSoFar:
    """What each probe's runs tell of what goals want: `found` of each probe, `fleets` of those whose type's
    `population` is known; and the ambients at which a film's rate is wanted."""

    ambients_c: Sequence[float]
    wanted: Sequence[Target]
    found: Mapping[str, Characterization | None] = field(default_factory=dict)
    fleets: Mapping[str, WithFleet] = field(default_factory=dict)
    population: Population | None = None

    def wanted_rates(self, menu: Sequence[PlannedShock]) -> Iterator[WantedRates]:
        """What runs would say of the rates that are wanted, as far as anything is known to design by."""
        for probe, one in self.found.items():
            for name, result in ({} if one is None else one.channels()).items():
                own = [t for t in self.wanted if (t.channel, t.probe) == (name, probe)]
                belongs = probe in self.fleets and self.fleets[probe].belongs(name)
                if own:
                    yield self._rates_of(result, own, menu, self.population if belongs else None)

    def menu(
        self, disputes: Sequence[OpenDispute] | None, usual: Usual, allowed: Callable[[PlannedShock], bool]
    ) -> tuple[PlannedShock, ...]:
        """Runs that could be made; no deciding ones where `disputes` is None."""
        menu = precision_menu(self.ambients_c, usual, self.dwell_s)
        if disputes is not None:
            menu += deciding_menu(deciding_ambients(disputes), usual, self.dwell_s)
        return tuple(dict.fromkeys(s for s in menu if allowed(s)))

    def _rates_of(
        self, result: ChannelResult, wanted: Sequence[Target], menu: Sequence[PlannedShock], of_type: Population | None
    ) -> WantedRates:
        """Of one channel; with what is known of its type, where it is of it."""
        part = result.parts[0]
        info = information(part.problem, part.fit, result.noise, menu, self.ambients_c)
        plain = not part.fit.structure.effects and not part.channel.quantity.pooled
        used = np.array([s.isothermal or not plain for s in menu])
        info = replace(info, added=info.added * used[:, None, None])
        if of_type is not None:
            info = replace(info, known=info.known + _beforehand(info, of_type, part.channel.name))
        places = [0 if t.ambient_c is None else int(np.argmin(np.abs(info.ambients_c - t.ambient_c))) for t in wanted]
        now, runs = info.variances(info.known), np.array([t.runs for t in wanted])
        factors = np.array([t.relative**2 / now[g] if t.runs else 1.0 for t, g in zip(wanted, places, strict=True)])
        return WantedRates(info, tuple(zip(wanted, places, strict=True)), runs, factors)

    def dwell_s(self, ambient_c: float, isothermal: bool) -> float:
        """How long a record after the transfer has to be, from the response times of the slowest probe so far."""
        name: ChannelName = "humidity" if isothermal else "temperature"
        own = [one.channels()[name] for one in self.found.values() if one is not None and name in one.channels()]
        if not own:
            return LONG_S
        slowest = max(_t63_s(one, name, ambient_c) for one in own)
        return float(np.clip((ENOUGH_T63 if isothermal else ENOUGH_BEAD_T63) * slowest, SHORTEST_S, LONGEST_S))


@dataclass(frozen=True)
class Prospects:
    """A menu with what each of its runs would bring.

    Attributes
    ----------
    menu : tuple of PlannedShock
        M runs; the last one is the anchor where there is one.
    anchor : int or None
        Where in the menu the first run once more is; it is chosen by its turn alone.
    wanted_rates : tuple of WantedRates
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
    wanted_rates: tuple[WantedRates, ...]
    pairs: Array
    needed: Array
    evidence: Array
    varied: Callable[[Sequence[PlannedShock]], Array]

    @classmethod
    def of(
        cls,
        menu: Sequence[PlannedShock],
        disputes: Sequence[OpenDispute],
        known: KnownSoFar | None = None,
        again: PlannedShock | None = None,
        channels: Sequence[Channel] = (),
    ) -> Prospects:
        """A menu for what is tied and what is to be known better, with the variety that `channels` lack; `again` is the
        run that tells whether anything drifts."""
        anchor = [] if again is None else [replace(again, why="the first run once more: does anything drift?")]
        shocks = (*menu, *anchor)
        wanted_rates = () if known is None or not shocks else tuple(known.wanted_rates(shocks))
        told = told_apart(disputes if shocks else (), shocks)
        return cls(shocks, len(menu) if anchor else None, wanted_rates, *told, partial(variety, channels, shocks))

    def after(self, m: int) -> Prospects:
        """With run `m` of the menu made."""
        left = np.maximum(self.needed - self.pairs[:, m], 0.0)
        return replace(self, wanted_rates=tuple(p.after(m) for p in self.wanted_rates), needed=left)

    @property
    def choosable(self) -> tuple[PlannedShock, ...]:
        """The menu without the anchor."""
        return self.menu[: self.anchor]


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


def _t63_s(result: ChannelResult, name: ChannelName, ambient_c: float) -> float:
    t63 = np.array([row.response.t63_s for row in result.rows])
    if QUANTITIES[name].pooled:
        return float(t63[0])
    at = rates_at(np.array([row.ambient_c for row in result.rows]), -np.log(t63), np.array([ambient_c]))
    return float(np.exp(-at[0]))


def deciding_ambients(disputes: Iterable[OpenDispute]) -> list[float]:
    """Ambients with runs already, about the usual one: elsewhere a new rate would take up what a run says."""
    seen: dict[float, float] = {}
    for channel in (one.problem.channel for one in disputes):
        for t in channel.conditions.destination_c if channel.quantity.pooled else channel.ambients_c:
            seen[float(round(t))] = abs(t - USUAL_C)
    nearest = sorted(seen, key=seen.__getitem__)
    return nearest[:MOST_AMBIENTS] or [USUAL_C]
