"""The decision after each run: what is known and tied, what each possible run is worth per minute, when to stop.

worth of a run = sum over goals of the share of what is wanted that it adds (variance wanted / variance then, at most 1)
               + sum over pairs of tied explanations of expected ln E / ln 100, as far as it is needed
               + half a goal for each direction or airflow that it varies and too few runs have
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from shockrig.analysis.characterize.result import Characterization
from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.design.choose import LEAST_GAIN, Choice, chase, choose_runs
from shockrig.analysis.design.evidence import OpenDispute, of_second_probe
from shockrig.analysis.design.goals import QUANTITY_OF, Goals, Place, places
from shockrig.analysis.design.menu import ORDINARY, USUAL_C, PlannedShock, Surroundings, Usual, deciding_menu, opening
from shockrig.analysis.design.minutes import learn, spent_minutes
from shockrig.analysis.design.prospects import KnownSoFar, Prospects
from shockrig.analysis.design.recorded_so_far import shock_of, usual_of, variety
from shockrig.analysis.design.targets import Target, gained_by, measured, targets
from shockrig.analysis.diagnose.diagnosed import ChannelOutcome
from shockrig.analysis.diagnose.grammar import MOST_RUNS
from shockrig.analysis.estimate.quantity import QUANTITIES, looked_for
from shockrig.analysis.fleet.fleet_prior import WithFleet, with_population
from shockrig.analysis.plan.decision import CONTINUE, INCONCLUSIVE, MOST_UNEXPLAINED, Decision, ended_by, missing
from shockrig.analysis.plan.look import FEWEST_JUDGED, Conclusion, Looks, look_at
from shockrig.files.campaign import Campaign, Run
from shockrig.files.campaign_names import sensor_name
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import Population

Progress = Callable[[str], None]
Due = Callable[[Place], Conclusion | None]
NONE_MADE: Mapping[Place, ChannelOutcome] = MappingProxyType({})


def anything(shock: PlannedShock) -> bool:
    """A bench that can make every run of the menu."""
    return True


def decide(
    campaigns: Sequence[Campaign],
    goals: Goals,
    before: Decision | None = None,
    *,
    count: int = 1,
    feasible: Callable[[PlannedShock], bool] = anything,
    surroundings: Surroundings = ORDINARY,
    later: bool = False,
    due: Due | None = None,
    made: Mapping[Place, ChannelOutcome] = NONE_MADE,
    population: Population | None = None,
    progress: Progress = lambda _: None,
) -> Decision:
    """Decide what to record next; a function of its arguments alone.

    Parameters
    ----------
    campaigns : sequence of Campaign
        What has been recorded, as each probe saw it; none where nothing has. Goals and ties are those of all probes, so
        that a run which serves several is worth more.
    goals : Goals
    before : Decision, optional
        The last one on this campaign: which explanations were tied, since which runs.
    count : int
        How many runs to choose.
    feasible : function of a PlannedShock
        Whether the bench can do it, and the operator wants it.
    surroundings : Surroundings
        Pressures and lights that the bench can make, besides those that the campaign has had.
    later : bool
        Whether diagnoses are left for the time in which the next run is recorded: the decision says which are due, and
        the one after it rests on them. One that may end the campaign is not.
    due : function of a place, optional
        Gives the verdict of a diagnosis that the last decision left, where somebody has made it; otherwise it is made
        here, with the same result.
    made : mapping of a place to ChannelOutcome
        Of diagnoses that somebody made of these campaigns as they are: where one of all runs is wanted it is taken.
    population : Population, optional
        Of the sensors' type: what is known of them before any run, where they belong to it.
    progress : function of a sentence, optional
    """
    before = with_due(campaigns, before or Decision(), due)
    _demand_sensors(goals, campaigns)
    usual = usual_of(next(iter(campaigns), None), goals, surroundings)
    campaigns = tuple(checked(one).campaign for one in campaigns)
    case = _Case(campaigns, goals, usual, feasible, count, later, made, population, progress)
    found = case.decided(before)
    if found.status == INCONCLUSIVE and found.recorded:
        # What is tied was found at an earlier look: all runs may say something else.
        found = case.decided(replace(before, verdicts=found.verdicts), final=True)
    return found


@dataclass(frozen=True)
class _Case:
    """What a decision is taken on, as `decide` is given it; the campaigns are checked."""

    campaigns: Sequence[Campaign]
    goals: Goals
    usual: Usual
    feasible: Callable[[PlannedShock], bool]
    count: int
    later: bool
    made: Mapping[Place, ChannelOutcome]
    population: Population | None
    progress: Progress

    @property
    def runs(self) -> tuple[Run, ...]:
        """All that were recorded."""
        return self.campaigns[0].runs if self.campaigns else ()

    def decided(self, before: Decision, final: bool = False) -> Decision:
        """What to record next after a decision; with `final` it rests on a diagnosis of all runs, come what may."""
        campaign, runs = next(iter(self.campaigns), None), self.runs
        spent = 0.0 if campaign is None else sum(spent_minutes(campaign).values())
        recorded = tuple(run.id for run in runs)

        looks = self.looks(before.verdicts, final)
        known = self.known(looks.verdicts)
        met = all(t.met for t in known.wanted) and not any(v.tied for v in looks.verdicts.values())
        menu = known.menu(looks.disputes if self.goals.ties else None, self.usual, self.feasible)
        # What depends on a direction or an airflow that no run has had can be no finding.
        unvaried = self.goals.ties and bool(variety(looks.channels, menu).any())
        first = self.first_runs(known.found)
        if met and recorded and not unvaried and not first:
            judged = looks.verdicts
            looks = self.looks(judged, final=True)
            if any(looks.verdicts[place].causes != then.causes for place, then in judged.items()):
                known = self.known(looks.verdicts)
            menu = known.menu(looks.disputes if self.goals.ties else None, self.usual, self.feasible)
        new = set(recorded) - set(before.recorded)
        came = [gained_by(new, own, [t for t in known.wanted if t.probe == p]) for p, own in known.found.items() if new]
        state = Decision(
            recorded=recorded,
            minutes_spent=spent,
            targets=tuple(known.wanted),
            verdicts=looks.verdicts,
            chased=before.chased,
            unvaried=unvaried,
            gained=sum(came) if new else None,
        )
        if not unvaried and not (self.goals.ties and first) and (ended := ended_by(state, self.goals, looks)):
            return replace(state, status=ended[0], reason=ended[1])
        tied, channels = (looks.disputes, looks.channels) if self.goals.ties else ([], [])
        again = shock_of(runs[0]) if runs else None
        again = again if again is not None and self.feasible(again) else None
        prospects = Prospects.of(menu, tied, known, again, channels)
        minutes, chased = learn(campaign), before.chased
        left = any(v.left for v in state.verdicts.values()) and not any(v.describes for v in state.verdicts.values())
        if first:
            chosen = [Choice(s, minutes.of(None, s)) for s in first][: self.count]
            considered: tuple[Choice, ...] = tuple(chosen)
        else:
            chosen, considered = choose_runs(prospects, minutes, runs, self.count)
            chosen = _with_second_probe(looks.disputes, chosen) if len(self.campaigns) == 1 else chosen
            if self.goals.ties and left and chased < MOST_UNEXPLAINED:
                chosen, chased = chase(menu, runs, minutes)[: self.count], chased + 1
        if not chosen:
            reason = f"no run of the menu brings what is missing: {missing(state)}"
            return replace(state, status=INCONCLUSIVE, reason=reason)
        chosen, enough = self.within(chosen, considered, spent)
        if enough:
            return replace(state, status=INCONCLUSIVE, reason=f"{enough}; {missing(state)}", considered=considered)
        reason, choices = missing(state), tuple(chosen)
        return replace(state, status=CONTINUE, reason=reason, choices=choices, considered=considered, chased=chased)

    def looks(self, before: Mapping[Place, Conclusion], final: bool) -> Looks:
        """What is seen at every place."""
        looks = Looks()
        for place, (campaign, name) in places(self.campaigns).items():
            if not final or place not in self.made:
                self.progress(f"{place}: {'diagnosing all runs' if final else 'looking at what is left'}")
            then, made = before.get(place, Conclusion()), self.made.get(place)
            looks[place] = look_at(campaign, name, then, final, self.later, made)
        return looks

    def known(self, verdicts: Mapping[Place, Conclusion]) -> KnownSoFar:
        """What is known by each probe, with what is named of it in the model; what the sensors' type adds to that; and
        how far it is what the goals want of every probe that has the sensor for it."""
        if not self.campaigns:
            return KnownSoFar(self.goals.ambients_c, targets(self.goals, None, population=self.population))
        found, fleets, wanted = dict[str, Characterization | None](), dict[str, WithFleet](), list[Target]()
        for one in self.campaigns:
            names, probe = looked_for(one), one.probe
            of = {name: verdicts[sensor_name(name, probe)] for name in names}
            extensions = {name: verdict.extension(name) for name, verdict in of.items() if verdict.causes}
            found[probe] = own = measured(one, extensions)
            if self.population is not None and own is not None:
                fleets[probe] = fleet = with_population(own, self.population)
                for channel, sentence in zip(fleet.probability, fleet.sentences, strict=True):
                    if not fleet.belongs(channel):
                        self.progress(sentence)
            wanted += [
                t for t in targets(self.goals, own, probe, fleets.get(probe), self.population) if t.channel in names
            ]
        return KnownSoFar(self.goals.ambients_c, wanted, found, fleets, self.population)

    def first_runs(self, found: Mapping[str, Characterization | None]) -> list[PlannedShock]:
        """The runs that a campaign begins with, as far as they show channels that no run has shown, those of rarer
        directions first; none where the first runs were many and showed nothing.

        Any other of the menu will do where the bench can make none of these, or the operator wants none.
        """
        lacking = {name for name in QUANTITIES if self.goals.ties or name in self.goals.channels}
        if self.campaigns:
            known = {(one.probe, n) for one in self.campaigns if (own := found[one.probe]) for n in own.channels()}
            there = {(one.probe, n) for one in self.campaigns for n in lacking if QUANTITIES[n].sensor in one.sensors}
            lacking = {name for _, name in there - known}
        if not lacking or len(self.runs) >= 2 * FEWEST_JUDGED:
            return []
        middle = min(self.goals.ambients_c, key=lambda t: abs(t - USUAL_C))
        begin = [s for s in opening(middle, self.usual) if self.usual.allows(s) and s.shows in lacking]
        others = [s for s in deciding_menu([middle], self.usual) if s.shows in lacking and self.feasible(s)]
        ways = [s.way for run in self.runs if (s := shock_of(run)) is not None]
        return sorted(filter(self.feasible, begin), key=lambda s: ways.count(s.way)) or others[: len(begin)]

    def within(self, chosen: list[Choice], considered: Sequence[Choice], spent: float) -> tuple[list[Choice], str]:
        """The chosen runs for which the minutes suffice that were given; and why there is none, if there is none.

        Where none were given it ends where no run brings enough, of those that are chosen for what they bring.
        """
        if self.goals.minutes is not None:
            ends = spent + np.cumsum([c.minutes for c in chosen])
            chosen = [c for c, end in zip(chosen, ends, strict=True) if end <= self.goals.minutes]
            return chosen, "" if chosen else f"the {self.goals.minutes:g} min given are spent"
        if len(self.runs) >= MOST_RUNS:
            return [], f"{len(self.runs)} runs are recorded, and no minutes were given for more"
        if not np.isnan(chosen[0].information) and max(c.worth for c in considered) < LEAST_GAIN:
            return [], f"no run brings {100 * LEAST_GAIN:g} % of a goal, and no minutes were given for more"
        return chosen, ""


def _with_second_probe(disputes: Sequence[OpenDispute], chosen: Sequence[Choice]) -> list[Choice]:
    """Runs with what a second probe, recorded beside a single one, is expected to bring."""
    shocks = [choice.shock for choice in chosen]
    more = np.zeros(len(shocks))
    for one in disputes if chosen else ():
        more = np.maximum(more, of_second_probe(one, shocks))
    return [replace(choice, beside=float(x)) for choice, x in zip(chosen, more, strict=True)]


def with_due(campaigns: Sequence[Campaign], before: Decision, due: Due | None = None) -> Decision:
    """A decision with the diagnoses that it left for later: made already, or made here from the probes' campaigns."""
    if not any(verdict.due for verdict in before.verdicts.values()):
        return before
    then = places(of_decision(one, before) for one in campaigns)
    verdicts = {
        place: ((due and due(place)) or look_at(*then[place], verdict).conclusion) if verdict.due else verdict
        for place, verdict in before.verdicts.items()
    }
    return replace(before, verdicts=verdicts)


def of_decision(campaign: Campaign, decision: Decision) -> Campaign:
    """The campaign as it was when a decision was taken, checked."""
    runs = tuple(run for run in campaign.runs if run.id in decision.recorded)
    return checked(replace(campaign, runs=runs)).campaign


def _demand_sensors(goals: Goals, campaigns: Sequence[Campaign]) -> None:
    """Refuse a goal of a sensor that no probe of the campaign has: no run would ever reach it."""
    there = {name for one in campaigns for name in looked_for(one)}
    for one in goals.precisions if campaigns else ():
        if not there & set(QUANTITY_OF[one.quantity]):
            lacking = " or ".join(QUANTITIES[name].instrument for name in QUANTITY_OF[one.quantity])
            has_none = f"{campaigns[0].name} has none; leave it out"
            raise InputError(f"--until: {one}: is a goal of a {lacking}, and {has_none}")
