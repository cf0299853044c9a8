"""What a look at a channel finds, and what is kept of it from look to look: its verdict, ties, what new runs ruled
out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from shockrig.analysis.characterize.part_fit import Extension, extension_of
from shockrig.analysis.design.evidence import FALSE_ALARMS, Dispute, OpenDispute, against
from shockrig.analysis.design.explanation import Explanation, fitted, label_of
from shockrig.analysis.design.goals import Place
from shockrig.analysis.diagnose.adequacy import judge
from shockrig.analysis.diagnose.diagnose import diagnose_channel, enough
from shockrig.analysis.diagnose.diagnosed import ChannelOutcome, outcome_of
from shockrig.analysis.diagnose.prepare import Prepared, prepare
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects.described import described, discovered_of, is_described
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.files.campaign import Campaign
from shockrig.files.causes import StatedEffect, Uncertain

MOST_TIED = 6  # beside the best one
FEWEST_JUDGED = 4  # that are diagnosed before the end
MOST_RUNS_TRIED = 24  # by which a channel is given up of which fewer can be used
MORE_RUNS = 1.2  # times as many as at the last diagnosis, from which on one that left something is made again


@dataclass(frozen=True)
class Conclusion:
    """What is concluded of a channel, and kept from look to look.

    Attributes
    ----------
    verdict : str
        As in a diagnosis; "adequate" before the first.
    runs : int
        With how many runs the last diagnosis was made; 0: none yet.
    causes : mapping
        What its model carries beside the plain one, named or described, with the values that a fit begins from.
    dispute : Dispute or None
        What was tied then.
    out : tuple of tuple of str
        Effects of each explanation that new runs have ruled out.
    looks : int
        How many diagnoses were made.
    settled : tuple of Dispute
        Disputes that are over.
    final : bool
        Whether the last diagnosis would be no other as one of all runs at the end.
    due : bool
        Whether a diagnosis of the runs of this look is to be made while the next run is recorded.
    """

    verdict: str = "adequate"
    runs: int = 0
    causes: Explanation = field(default_factory=dict)
    dispute: Dispute | None = None
    out: tuple[tuple[str, ...], ...] = ()
    looks: int = 0
    settled: tuple[Dispute, ...] = ()
    final: bool = False
    due: bool = False

    @property
    def tied(self) -> tuple[str, ...]:
        """Explanations that still stand beside one another; empty where there is one."""
        if self.dispute is None or self.decided:
            return ()
        return tuple(label_of(e, self.dispute.explanations) for e in self.standing)

    @property
    def standing(self) -> tuple[Explanation, ...]:
        """Explanations of the dispute that are not out."""
        return () if self.dispute is None else self.dispute.standing

    @property
    def left(self) -> bool:
        """Whether something is left that no catalogued effect explains, described or not."""
        return self.verdict in ("unexplained", "described")

    @property
    def decided(self) -> bool:
        """Whether there was a dispute and new runs have left at most one explanation."""
        return self.dispute is not None and len(self.standing) < 2

    @property
    def named(self) -> tuple[str, ...]:
        """Effects of the catalogue that it names."""
        return tuple(e for e in self.causes if not is_described(e))

    @property
    def describes(self) -> bool:
        """Whether an explanation that stands beside others is one that nobody listed."""
        return bool(self.tied) and any(is_described(e) for one in self.standing for e in one)

    def extension(self, channel: ChannelName) -> Extension:
        """The model that the characterization uses: with what is named or described, or may be."""
        causes = [
            StatedEffect(effect, {name: Uncertain(value, 0.0) for name, value in self.causes[effect].items()}, 1.0)
            for effect in self.named
        ]
        others = [
            discovered_of(described(id_, channel == "humidity"), {k: (v, 0.0) for k, v in values.items()})
            for id_, values in self.causes.items()
            if is_described(id_)
        ]
        return extension_of(causes, others, channel)


@dataclass(frozen=True)
class ChannelLook:
    """What is concluded of a channel at one look, the channel (None where it cannot be diagnosed), and the explanations
    that stand beside one another, as evidence is expected of them (None where there is one).

    `given_up` is True where many runs were made, and too few of them can be used to judge by.
    """

    conclusion: Conclusion
    channel: Channel | None = None
    tied: OpenDispute | None = None
    given_up: bool = False


class Looks(dict[Place, ChannelLook]):
    """What was seen at every place."""

    @property
    def verdicts(self) -> dict[Place, Conclusion]:
        """Of each place."""
        return {place: look.conclusion for place, look in self.items()}

    @property
    def disputes(self) -> list[OpenDispute]:
        """What is tied anywhere."""
        return [look.tied for look in self.values() if look.tied is not None]

    @property
    def channels(self) -> list[Channel]:
        """Those that can be judged."""
        return [look.channel for look in self.values() if look.channel is not None]


def spending(look: int) -> float:
    """The share of the permitted error that look number `look` (from 1) may spend: these add up to 1."""
    return 1.0 / (look * (look + 1.0))


def look_at(
    campaign: Campaign,
    name: ChannelName,
    before: Conclusion,
    final: bool = False,
    later: bool = False,
    made: ChannelOutcome | None = None,
) -> ChannelLook:
    """Look at one channel of a checked campaign.

    Parameters
    ----------
    campaign : Campaign
    name : channel
    before : Conclusion
        Of the last look, or of this one where a diagnosis of its runs is due.
    final : bool
        Whether a verdict on all runs is wanted, come what may.
    later : bool
        Whether a diagnosis is left for later, and only said to be due; not one that is wanted come what may.
    made : ChannelOutcome, optional
        Of a diagnosis that somebody made of this campaign: it is taken where one of the same runs is wanted.
    """
    channel = build_channel(campaign, name)
    if channel is None or not enough(channel):
        return ChannelLook(before)
    if channel.runs < FEWEST_JUDGED and len(campaign.runs) >= MOST_RUNS_TRIED:
        return ChannelLook(before, given_up=not before.runs)
    ready = prepare(channel)
    now, base = before, ready.structure
    if before.dispute is not None:
        so_far = tuple(against(ready.problem, base, before.dispute))
        now = replace(before, dispute=replace(before.dispute, against=so_far))
    anew = final or before.due or now.decided or before.runs == 0 and channel.runs >= 2 * FEWEST_JUDGED
    if not anew and now.dispute is None and channel.runs >= FEWEST_JUDGED:
        current = fitted(ready.problem, now.causes, base)
        passed = judge(ready.problem, current).passed
        anew = (not passed or before.left) and channel.runs >= max(MORE_RUNS * before.runs, before.runs + 1)
    if anew and (channel.runs > before.runs or final and not before.final):
        if made is not None and made.runs == channel.run_ids:
            now = _taken(made, now, True, ready)
        elif later and not final:
            now = replace(now, due=True)
        else:
            found = diagnose_channel(channel, earlier=now.causes, describing=final, ready=ready)
            ready = replace(ready, problem=found.problem, noise=found.noise, structure=found.plain.structure)
            now = _taken(outcome_of(found), now, final, ready)
    if now.dispute is None or now.decided:
        return ChannelLook(now, ready.problem.channel)
    fits = tuple(fitted(ready.problem, e, base) for e in now.standing)
    return ChannelLook(now, ready.problem.channel, OpenDispute(ready.problem, ready.noise, fits, now.dispute))


def _taken(found: ChannelOutcome, before: Conclusion, final: bool, ready: Prepared) -> Conclusion:
    """The verdict of a diagnosis, with what it leaves tied at this look; what new runs have ruled out stays out.

    Before the end an ambient may have a single run, without which it cannot be predicted: what is not seen in the fit
    is no remainder then.
    """
    verdict, as_at_the_end = found.verdict, final or found.verdict in ("explained", "adequate")
    if not final and found.passed and verdict == "unexplained":
        verdict = "adequate" if all(map(is_described, found.stated)) else "explained"
    over = () if before.dispute is None else (before.dispute,)
    newly = (_ids(e) for dispute in over for e in dispute.explanations if e not in dispute.standing)
    out = tuple(dict.fromkeys((*before.out, *newly)))
    look = before.looks + 1
    concluded = partial(Conclusion, runs=len(found.runs), out=out, looks=look, settled=(*before.settled, *over))
    kept: dict[tuple[str, ...], Explanation] = {}
    for one in _possible(found, look):
        if _ids(one) not in out:
            kept.setdefault(_ids(one), one)
    # What stood before and is not out stands where all that the diagnosis thinks of is out.
    survivors = [one for one in before.standing or (before.causes,) if _ids(one) not in out]
    explanations = tuple(kept.values() or survivors)
    if not explanations:
        return concluded("unexplained", causes=found.stated, final=as_at_the_end)
    if _ids(found.stated) in out:
        # What this look does not think best, new runs have borne out: what is left is judged of the model they leave.
        if judge(ready.problem, fitted(ready.problem, explanations[0], ready.structure)).passed:
            verdict, as_at_the_end = "explained" if explanations[0] else "adequate", True
        else:
            verdict = "unexplained"
    nothing_yet = (0.0,) * len(explanations)
    dispute = Dispute(explanations, found.runs, nothing_yet) if len(explanations) > 1 else None
    return concluded(verdict, causes=explanations[0], dispute=dispute, final=as_at_the_end)


def _ids(explanation: Explanation) -> tuple[str, ...]:
    """Of its effects: two explanations with the same ones are one."""
    return tuple(sorted(explanation))


def _possible(found: ChannelOutcome, look: int) -> list[Explanation]:
    """The explanation that a diagnosis ends with, and those that it is tied with at this look: models that lack a part
    of it, whether or not something else stands there, and predict unseen runs nearly as well, or all but a few of them,
    which may be the odd ones."""
    # The odds of a wrong choice, summed over all looks, stay below the rate of false alarms.
    least = float(np.log(FALSE_ALARMS * spending(look)))
    close = [one for one in found.near if one.tied or one.nats > least]
    # Of what holds more, the heaviest is tied with a model that is not likely enough by itself.
    unsure = found.weight < level("named")
    more = [one for one in close if one.tied and one.nats > 0.0][: int(unsure)]
    others = [one.explanation for one in close if one.lacks or one in more]
    if not any(map(is_described, found.best)):
        # What a name explains, some form of behaviour nearly does as well: it is no other cause to be ruled out.
        others = [one for one in others if not any(map(is_described, one))]
    return [found.best, *others[:MOST_TIED]]
