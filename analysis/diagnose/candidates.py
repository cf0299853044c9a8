"""What may explain a channel: catalogued effects and forms of the grammar, one list of one kind, each with its prior.

A form that is the law of a catalogued effect that the channel can show is that effect, and is not listed twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.grammar import SCALING, by_chance, forms, kin, starts_of, varied
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import described, is_described
from shockrig.analysis.effects.forms import Form, form_of, forms_of, is_group, is_step, laws_of
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Effect
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.model import Model, Point, Structure

Array = NDArray[np.float64]

# What is held against an effect before any data [nats]: one false-alarm rate, and how often benches have it.


def log_prior(effect: Effect, channel: Channel, looks: int) -> float:
    """Log prior of an effect's being there, beside that of its absence [nats].

    `looks` are the places in its range at which it is looked for: each is a chance to find something in nothing.
    """
    against = level("effect") + log(max(looks, 1))
    if not is_described(effect.id):
        return -against - 0.5 * effect.rarity(channel)
    form = form_of(effect.id)
    on, more = form.depends_on, len(form.more)
    # A second condition is one of all that are tried beside the first.
    against += level("form") + level("factor") * more + log(len(SCALING)) * max(more - 1, 0)
    # One form for each run that a change may begin at, and two for each that may part a group from the others.
    against += log(2.0 * channel.runs) * sum(is_group(how) for _, how in on)
    return -against - log(channel.runs) * sum(is_step(how) for _, how in on)


# Behaviours that bend with their strength, and how much stronger than at a start one may be until the next is nearer.
BENDING, BETWEEN_STARTS = frozenset({"lag_in_series", "delay", "rate_change"}), 2.0
LAST_PART, STILL_MOVES = 0.1, 8.0  # of a record; standard uncertainties of its slope from which on it still moves


@dataclass(frozen=True)
class Candidate:
    """One effect that a model may be extended by, the values that its fits begin from, and its log prior [nats]."""

    effect: Effect
    starts: tuple[dict[str, float], ...]
    log_prior: float

    @cached_property
    def form(self) -> Form | None:
        """What it is in the grammar; None for an effect of the catalogue."""
        return form_of(self.effect.id) if is_described(self.effect.id) else None

    @property
    def family(self) -> tuple[str, ...]:
        """What competes for one place in a race: forms of one behaviour and driver, an effect of the catalogue with
        itself alone."""
        return (self.effect.id,) if self.form is None else (self.form.behaves_as, self.form.driver)

    @property
    def furthest(self) -> float:
        """How many times what it changes at a start it may change before it is another shape: a lag, a delay and a
        rate bend, what is added does not."""
        bends = self.form.behaves_as in BENDING if self.form else bool(self.weakest)
        return BETWEEN_STARTS if bends else np.inf

    @property
    def weakest(self) -> tuple[dict[str, float], ...]:
        """Its starts where it changes least: a small effect of a kind that bends shows there, a large one at its own
        size."""
        least = {p.name: p.weakest for p in self.effect.parameters if p.weakest is not None}
        return tuple(start | least for start in self.starts) if least else ()

    def fits(self, structure: Structure) -> bool:
        """Whether it may be added to a model."""
        taken, effect = set(structure.ids), self.effect
        return (
            effect.id not in taken
            and not effect.candidacy.excludes & taken
            and not (effect.scatters and structure.scattering)
            and not any(effect.id in other.candidacy.excludes for other in structure.effects)
            and (not effect.candidacy.beside or bool(effect.candidacy.beside & taken))
        )


def listed(channel: Channel) -> tuple[Effect, ...]:
    """Effects of the catalogue that the mean response of this campaign can show in this channel."""
    return tuple(e for e in CATALOGUE.values() if e.fitted and e.acts_in(channel))


def candidates(channel: Channel) -> tuple[Candidate, ...]:
    """All that this campaign can show in this channel."""
    effects = listed(channel)
    found = [_candidate(e, e.starts(channel), channel) for e in effects]
    ids = {e.id for e in effects}
    return (*found, *_of_forms(forms(channel), ids, channel))


def kin_of(effect: Effect, channel: Channel) -> tuple[Candidate, ...]:
    """Forms that differ from one by a single condition, or in the spread of time constants, and are no listed law; of a
    catalogued effect its law, where it differs from run to run by chance."""
    if is_described(effect.id):
        return _of_forms(kin(form_of(effect.id), channel), {e.id for e in listed(channel)}, channel)
    driver = "air_humidity" if channel.jumps_with_air else "air_temperature"
    laws = (form for form, _ in forms_of(effect.id, driver))
    return _of_forms((one for law in laws for one in by_chance(law, channel)), set(), channel)


def bare_forms(channel: Channel) -> tuple[Candidate, ...]:
    """Forms that depend on nothing, listed laws among them; none where the runs' order was not varied."""
    bare = (form for form in forms(channel) if not form.depends_on)
    return _of_forms(bare, set(), channel) if "run_order" in varied(channel) else ()


def in_group_of(one: Candidate, how: str, channel: Channel) -> Candidate:
    """A bare form in a group of runs alone."""
    assert one.form is not None
    effect = described(one.form.with_factor("run_order", how).key, channel.jumps_with_air)
    return _candidate(effect, one.starts, channel)


def _of_forms(these: Iterable[Form], ids: set[str], channel: Channel) -> tuple[Candidate, ...]:
    found = []
    for form in these:
        if not any(name in ids for name, _ in laws_of(form)):
            effect = described(form.key, channel.jumps_with_air)
            found.append(_candidate(effect, starts_of(effect, form, channel), channel))
    return tuple(found)


def _candidate(effect: Effect, starts: Sequence[dict[str, float]], channel: Channel) -> Candidate:
    return Candidate(effect, tuple(starts), log_prior(effect, channel, len(starts)))


def at_bound(effect: Effect, parameters: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """Parameters of a fitted effect that stand at a bound of their range, where that says nothing of it."""
    out = []
    for parameter in (one for one in effect.parameters if not one.ends_say):
        value, _ = parameters[parameter.name]
        width = 1e-3 * (parameter.high - parameter.low)
        above = 1e-6 if parameter.log else min(width, 0.1 * abs(parameter.low) or width)
        if value <= parameter.low + above or value >= parameter.high - width:
            out.append(parameter.name)
    return tuple(out)


def says_nothing(effect: Effect, parameters: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a parameter of a fitted effect stands at the end of its range, or may be anything in it."""
    return bool(at_bound(effect, parameters) or may_be_anything(effect, parameters))


def may_be_anything(effect: Effect, parameters: Mapping[str, tuple[float, float]]) -> list[str]:
    """Parameters of which a fit says nothing, by their values and standard uncertainties."""
    open_ = (p.name for p in effect.parameters if p.log and not p.ends_say and p.name in parameters)
    return [name for name in open_ if parameters[name][1] > level("anything") * abs(parameters[name][0])]


def says_nothing_at_all(effect: Effect, parameters: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a fit says nothing of any of an effect's numbers: none is surer than its whole range is wide."""
    open_ = may_be_anything(effect, parameters)
    wide = (p.name for p in effect.parameters if not p.log and parameters[p.name][1] > p.high - p.low)
    return bool(effect.parameters) and {*open_, *wide} == {p.name for p in effect.parameters}


def refused(found: Fit, effect: Effect) -> bool:
    """Whether an effect of a fit is no finding where it ended, by what its entry says."""
    if effect.candidacy.refused is None:
        return False
    channel = found.model.channel

    def bare() -> Array:
        model = Model(channel, found.structure.dropping(effect.id))
        theta = model.start(found.log_rates, found.choice)
        theta[model.behind] = found.theta[found.model.behind]
        return np.asarray(model.predict(Point(theta, channel.at_rest()))[0])

    values = {name: value for name, (value, _) in found.values()[effect.id].items()}
    return effect.candidacy.refused(channel, values, bare)


def _unended(channel: Channel, effect: Effect) -> bool:
    """Whether a shape is told from a single response that still moves where the record ends, towards an air that nobody
    recorded: where it would end, and how slowly, are then one."""
    if channel.runs > 1 or not effect.candidacy.shape or channel.conditions.airs_known.any() or channel.measured.any():
        return False
    time, value = channel.samples[0]
    end = time > time[-1] - LAST_PART * (time[-1] - time[0])
    t, y = time[end] - time[end].mean(), value[end] - value[end].mean()
    slope = float(t @ y / (t @ t))
    left = y - slope * t
    return abs(slope) > STILL_MOVES * float(np.sqrt(left.var() / (t @ t)))


def sound(found: Fit, ids: set[str] | frozenset[str]) -> bool:
    """Whether the effects `ids` of a fit say something where it ended."""
    values = found.values()
    return not any(
        says_nothing(effect, values[effect.id]) or refused(found, effect) or _unended(found.model.channel, effect)
        for effect in found.structure.effects
        if effect.id in ids
    )
