"""How well a campaign knows what is wanted: its characterization without the search by optimisers, and the goals."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import Extension
from shockrig.analysis.characterize.result import ChannelResult, Characterization, TableRow
from shockrig.analysis.design.goals import QUANTITY_OF, Goals, Precision
from shockrig.analysis.design.information import NOT_KNOWN, gained
from shockrig.analysis.estimate.channel import AMBIENT_WIDTH_K
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName
from shockrig.analysis.fleet.fleet_prior import WithFleet, relative_of_type
from shockrig.files.campaign import Campaign
from shockrig.files.campaign_names import FIRST_PROBE
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import Population

FEWEST_RUNS = 2  # of a row: one says nothing of how much runs differ


@dataclass(frozen=True)
class Target:
    """One number that is wanted, and how well it is known: a channel's rate at an ambient (None: the one rate).

    `relative` is its relative standard uncertainty now, `wanted` the goal's; `probe` whose it is.
    """

    channel: ChannelName
    ambient_c: float | None
    quantity: str
    wanted: float
    relative: float
    runs: int
    probe: str = FIRST_PROBE

    @property
    def met(self) -> bool:
        """Whether it is known as well as wanted."""
        return self.relative <= self.wanted and self.runs >= FEWEST_RUNS

    @property
    def progress(self) -> float:
        """The share of the goal that is reached."""
        return self.reached(self.relative**2, self.runs)

    def reached(self, variance: float, runs: int) -> float:
        """The share that would be: of the information that it needs, and of the runs, at most 1."""
        return min(self.wanted**2 / max(variance, 1e-30), runs / FEWEST_RUNS, 1.0)

    @property
    def known(self) -> bool:
        """Whether anything is known of it, by its own runs or by others of its type."""
        return self.relative < NOT_KNOWN or self.runs > 0

    @property
    def label(self) -> str:
        """For people: `D at 20`."""
        return self.named + ("" if self.ambient_c is None else f" at {self.ambient_c:g} degC")

    @property
    def named(self) -> str:
        """The same without the ambient."""
        return ("" if self.probe == FIRST_PROBE else f"probe {self.probe}: ") + self.quantity


def measured(campaign: Campaign, extensions: Mapping[ChannelName, Extension] | None = None) -> Characterization | None:
    """The quick characterization of a campaign; None where nothing of it can be used yet."""
    try:
        return characterize(campaign, extensions=extensions, quickly=True)
    except InputError:
        return None


def targets(
    goals: Goals,
    found: Characterization | None,
    probe: str = FIRST_PROBE,
    fleet: WithFleet | None = None,
    population: Population | None = None,
) -> list[Target]:
    """Every number that the goals want of a probe, with what is known of it: by its runs, with those of others of its
    type (`fleet`), or where it has none by these alone (`population`)."""
    wanted: dict[tuple[ChannelName, float | None, str], float] = {}
    for precision in goals.precisions:
        for channel in QUANTITY_OF[precision.quantity]:
            for ambient in _ambients(channel, precision, goals):
                key = (channel, ambient, precision.quantity)
                wanted[key] = min(wanted.get(key, np.inf), precision.relative)
    out = []
    for (channel, ambient, quantity), relative in wanted.items():
        row = _row(None if found is None else found.channels().get(channel), ambient)
        now = NOT_KNOWN if row is None else min(float(_relative(row, quantity)), NOT_KNOWN)
        runs = 0 if row is None else len(row.runs)
        with_fleet = None if fleet is None or quantity == "t63" else fleet.relative(channel, ambient)
        if found is not None and with_fleet is not None:
            # What runs at other ambients say of it counts: they are of the same sensor.
            now, runs = min(now, with_fleet), max(runs, len(found.channels()[channel].runs))
        elif population is not None and quantity != "t63" and (fleet is None or not fleet.outside(channel)):
            now = min(now, relative_of_type(population, channel, ambient) or NOT_KNOWN)
        out.append(Target(channel, ambient, quantity, relative, now, runs, probe))
    return out


def gained_by(runs: Collection[str], found: Characterization | None, wanted: Sequence[Target]) -> float:
    """What some recorded runs brought to the rates that are wanted [nats].

    A run that no fit could use, set aside or lost, brought nothing.
    """
    came = 0.0
    for name, result in ({} if found is None else found.channels()).items():
        part = result.parts[0]
        own = [t for t in wanted if t.channel == name]
        at = [np.abs(part.channel.ambients_c - t.ambient_c) for t in own if t.ambient_c is not None]
        places = {int(np.argmin(far)) for far in at if far.min() <= AMBIENT_WIDTH_K}
        places |= {0} if any(t.ambient_c is None for t in own) else set()
        new = np.isin(part.channel.run_ids, list(runs))
        if places and new.any():
            came += gained(part.problem, part.fit, new, sorted(places))
    return came


def _ambients(channel: ChannelName, precision: Precision, goals: Goals) -> tuple[float | None, ...]:
    if QUANTITIES[channel].pooled:
        return (None,)
    return precision.ambients_c or goals.ambients_c


def _row(found: ChannelResult | None, ambient_c: float | None) -> TableRow | None:
    if found is None:
        return None
    near = [row for row in found.rows if ambient_c is None or abs(row.ambient_c - ambient_c) <= AMBIENT_WIDTH_K]
    return near[0] if near else None


def _relative(row: TableRow, quantity: str) -> float:
    """Relative standard uncertainty of a row's diffusivity, or of its response time."""
    if quantity == "t63" and row.response.standard_uncertainties_s is not None:
        return row.response.standard_uncertainties_s[0] / row.response.t63_s
    return row.standard_uncertainty / row.diffusivity_m2_s
