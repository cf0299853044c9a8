"""The decision after each run: goals and ties as they stand, what each possible run is worth per minute, when to stop.

worth of a run = sum over goals of the share of what is wanted that it adds (variance wanted / variance then, at most 1)
               + sum over pairs of tied explanations of expected ln E / ln 100, as far as it is needed
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from shockrig.analysis.characterization.result import Characterization
from shockrig.analysis.checks.checked import checked
from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.analysis.planning.choose import UNTOLD, Choice, Designs, choose_runs, menu_of
from shockrig.analysis.planning.evidence import label_of
from shockrig.analysis.planning.foretold import expected_evidence
from shockrig.analysis.planning.goals import Goals
from shockrig.analysis.planning.judged import Look, Verdict, diagnosed, look_at, with_verdicts
from shockrig.analysis.planning.minutes import learn, spent_minutes
from shockrig.analysis.planning.precision import Target, gained_by, measured, targets
from shockrig.analysis.planning.shock import ORDINARY, USUAL_C, Shock, Surroundings, Usual, opening
from shockrig.analysis.planning.varied import variety
from shockrig.files.campaign import Campaign

CONTINUE, DONE, INCONCLUSIVE = "continue", "done", "inconclusive"
USUAL_BUDGET_MINUTES = 240.0  # where none is given
OTHER_PRESSURE = 0.03  # relative difference from which on a pressure is another one, and no weather
MOST_UNEXPLAINED = 4  # runs that are spent on what nothing explains
Progress = Callable[[str], None]
Due = Callable[[ChannelName], Verdict | None]


@dataclass(frozen=True)
class Decision:
    """What was found at one look, and what shall be done.

    Attributes
    ----------
    status : str
        "continue", "done" or "inconclusive".
    reason : str
        Why it stops or goes on.
    recorded : tuple of str
        Ids of the runs that it rests on.
    minutes_spent : float
    targets : tuple of Target
    verdicts : mapping of channel to Verdict
    choices : tuple of Choice
        The runs to record next, in order.
    considered : tuple of Choice
        The best of the menu, the chosen ones first.
    chased : int
        How many runs were chosen for what nothing explains.
    gained : float or None
        What the runs since the last decision brought to the rates that goals want [nats]; None where there are none.
    """

    status: str
    reason: str
    recorded: tuple[str, ...] = ()
    minutes_spent: float = 0.0
    targets: tuple[Target, ...] = ()
    verdicts: Mapping[ChannelName, Verdict] = field(default_factory=dict)
    choices: tuple[Choice, ...] = ()
    considered: tuple[Choice, ...] = ()
    chased: int = 0
    gained: float | None = None

    @property
    def tied(self) -> list[list[str]]:
        """The explanations that stand beside one another, a list for each channel that has any."""
        return [list(v.tied) for v in self.verdicts.values() if v.tied]


def anything(shock: Shock) -> bool:
    """A bench that can make every run of the menu."""
    return True


def decide(
    campaign: Campaign | None,
    goals: Goals,
    before: Decision | None = None,
    *,
    count: int = 1,
    feasible: Callable[[Shock], bool] = anything,
    vetoed: Sequence[Shock] = (),
    surroundings: Surroundings = ORDINARY,
    later: bool = False,
    due: Due | None = None,
    progress: Progress = lambda _: None,
) -> Decision:
    """Decide what to record next; a function of its arguments alone.

    Parameters
    ----------
    campaign : Campaign or None
        What has been recorded; None where nothing has.
    goals : Goals
    before : Decision, optional
        The last one on this campaign: which explanations were tied, since which runs.
    count : int
        How many runs to choose.
    feasible : function of a Shock
        Whether the bench can do it.
    vetoed : sequence of Shock
        Which the operator does not want.
    surroundings : Surroundings
        Pressures and lights that the bench can make, besides those that the campaign has had.
    later : bool
        Whether diagnoses are left for the time in which the next run is recorded: the decision says which are due, and
        the one after it rests on them. One that may end the campaign is not.
    due : function of a channel's name, optional
        Gives the verdict of a diagnosis that the last decision left, where somebody has made it; otherwise it is made
        here, with the same result.
    progress : function of a sentence, optional
    """
    if before is not None and campaign is not None:
        before = with_due(campaign, before, due)
    usual = usual_of(campaign, goals, surroundings)
    if campaign is not None:
        campaign = checked(campaign).campaign
    spent = 0.0 if campaign is None else sum(spent_minutes(campaign).values())
    recorded = () if campaign is None else tuple(run.id for run in campaign.runs)

    def allowed(shock: Shock) -> bool:
        return feasible(shock) and shock not in vetoed

    then = {} if before is None else before.verdicts
    looks, verdicts = _look(campaign, then, False, later, progress)
    found = measured(campaign, with_verdicts(verdicts))
    wanted = targets(goals, found)
    met = all(t.met for t in wanted) and not any(v.tied for v in verdicts.values())
    # What depends on a direction or an airflow that no run has had can be no finding.
    unvaried = goals.ties and variety(looks, menu_of(found, looks, goals, usual, allowed)).any()
    if met and recorded and not unvaried:
        looks, verdicts = _look(campaign, verdicts, True, later, progress)
        found = measured(campaign, with_verdicts(verdicts))
        wanted = targets(goals, found)
    chased = before.chased if before is not None else 0
    new = set(recorded) - set(before.recorded if before is not None else ())
    state = Decision(
        "", "", recorded, spent, tuple(wanted), verdicts, chased=chased, gained=gained_by(new, found, wanted)
    )
    first = _first(campaign, goals, found, usual)
    anchor = None if campaign is None or not campaign.runs else campaign.runs[0]
    designs = Designs.of(found, looks, wanted, goals, usual, allowed, anchor)
    if (designs.bonus == 0.0).all() and (ended := _ended(state, goals, looks)):
        return _with(state, *ended)
    minutes = learn(campaign)
    last = None if campaign is None or not campaign.runs else campaign.runs[-1]
    if first:
        chosen = [Choice(s, minutes.of(None, s), 0.0, UNTOLD, UNTOLD, UNTOLD) for s in first if allowed(s)][:count]
        considered = tuple(chosen)
    else:
        chosen, considered = choose_runs(designs, minutes, last, count, len(recorded))
        told = expected_evidence(list(looks.values()), [c.shock for c in (*chosen, *considered)])
        weighed = [replace(c, evidence=x) for c, x in zip((*chosen, *considered), told, strict=True)]
        chosen, considered = weighed[: len(chosen)], tuple(weighed[len(chosen) :])
    worst = {name: look.left_over for name, look in looks.items() if look.left_over}
    describes = any(v.describes for v in verdicts.values())
    if goals.ties and worst and chased < MOST_UNEXPLAINED and not first and not describes:
        chosen, chased = designs.chase(campaign, worst, minutes, chased, count), chased + 1
    if not chosen:
        return _with(state, INCONCLUSIVE, f"no run of the menu brings what is missing: {_missing(state)}")
    budget = USUAL_BUDGET_MINUTES if goals.minutes is None else goals.minutes
    within = [
        c for c, total in zip(chosen, np.cumsum([c.minutes for c in chosen]), strict=True) if spent + total <= budget
    ]
    if not within:
        return _with(state, INCONCLUSIVE, f"{budget:g} minutes are spent; {_missing(state)}", considered=considered)
    return _with(state, CONTINUE, _missing(state), tuple(within), considered, chased)


def _with(
    state: Decision,
    status: str,
    reason: str,
    choices: tuple[Choice, ...] = (),
    considered: tuple[Choice, ...] = (),
    chased: int | None = None,
) -> Decision:
    return replace(
        state,
        status=status,
        reason=reason,
        choices=choices,
        considered=considered,
        chased=state.chased if chased is None else chased,
    )


def with_due(campaign: Campaign, before: Decision, due: Due | None = None) -> Decision:
    """A decision with the diagnoses that it left for later: made already, or made here."""
    if not any(verdict.due for verdict in before.verdicts.values()):
        return before
    then = of_decision(campaign, before)
    verdicts = {
        name: ((due and due(name)) or diagnosed(then, name, verdict)) if verdict.due else verdict
        for name, verdict in before.verdicts.items()
    }
    return replace(before, verdicts=verdicts)


def of_decision(campaign: Campaign, decision: Decision) -> Campaign:
    """The campaign as it was when a decision was taken, checked."""
    runs = tuple(run for run in campaign.runs if run.id in decision.recorded)
    return checked(replace(campaign, runs=runs)).campaign


def _look(
    campaign: Campaign | None, before: Mapping[ChannelName, Verdict], final: bool, later: bool, progress: Progress
) -> tuple[dict[ChannelName, Look], dict[ChannelName, Verdict]]:
    looks: dict[ChannelName, Look] = {}
    for name in QUANTITIES:
        then = before.get(name, Verdict())
        if campaign is None:
            looks[name] = Look(then)
        else:
            progress(f"{name}: {'diagnosing all runs' if final else 'looking at what is left'}")
            looks[name] = look_at(campaign, name, then, final, later)
    return looks, {name: look.verdict for name, look in looks.items()}


def usual_of(campaign: Campaign | None, goals: Goals, surroundings: Surroundings) -> Usual:
    """What runs of a campaign have that nothing is said of, and what else they can have."""
    low, high = min(*goals.ambients_c, USUAL_C), max(*goals.ambients_c, 2 * USUAL_C)
    runs = () if campaign is None else campaign.runs
    airs = [a.temperature_c for r in runs for a in (r.source, r.destination) if a.temperature_c is not None]
    flows = [run.airflow_m_s for run in runs if run.airflow_m_s]
    lights = {float(x) for run in runs if isinstance(x := run.extra.get("irradiance_w_m2"), int | float) and x > 0}
    pressure = round(float(np.median([run.pressure_hpa for run in runs])), 2) if runs else Usual.pressure_hpa
    others = {round(p, -1) for run in runs if abs((p := run.pressure_hpa) / pressure - 1.0) > OTHER_PRESSURE}
    others |= {p for p in surroundings.pressures_hpa if abs(p / pressure - 1.0) > OTHER_PRESSURE}
    return Usual(
        airflow_m_s=round(float(np.median(flows)), 2) if flows else Usual.airflow_m_s,
        pressure_hpa=pressure,
        other=Surroundings(tuple(sorted(others)), tuple(sorted(lights | set(surroundings.irradiances_w_m2)))),
        coldest_c=round(min([low, *airs])),
        warmest_c=round(max([high, *airs])),
    )


def _first(campaign: Campaign | None, goals: Goals, found: Characterization | None, usual: Usual) -> list[Shock]:
    """The runs that a campaign begins with, as far as it lacks them: those that show a channel which none has shown."""
    middle = sorted(goals.ambients_c, key=lambda t: abs(t - USUAL_C))[0]
    begin = {shock: _shown_by(shock) for shock in opening(middle, usual) if usual.allows(shock)}
    there = [n for n, q in QUANTITIES.items() if campaign is None or q.sensor in campaign.sensors]
    wanted = [name for name in there if goals.ties or name in goals.channels]
    known = {} if found is None else found.channels()
    lacking = [name for name in wanted if name not in known]
    if campaign is not None and len(campaign.runs) >= 2 * len(begin):
        return []
    return [shock for shock, channel in begin.items() if channel in lacking]


def _shown_by(shock: Shock) -> ChannelName:
    """The channel that a run of the opening is for."""
    return "humidity" if shock.isothermal else "temperature"


def _ended(state: Decision, goals: Goals, looks: Mapping[ChannelName, Look]) -> tuple[str, str] | None:
    """Status and reason where nothing more is to be recorded."""
    if not state.recorded:
        return None
    met = all(target.met for target in state.targets)
    tied, verdicts = state.tied, state.verdicts.values()
    unexplained = [name for name, verdict in state.verdicts.items() if verdict.left]
    decided = not tied and all(v.runs or looks[n].problem is None for n, v in state.verdicts.items())
    if met and (not goals.ties or (decided and not unexplained)):
        named = [e for v in verdicts for e in v.named]
        return DONE, f"all goals are met; {'named: ' + ', '.join(named) if named else 'the plain model is enough'}"
    if met and goals.ties and unexplained and not tied and state.chased >= MOST_UNEXPLAINED:
        others = [label_of(v.causes, [v.causes, {}]) for v in verdicts if v.verdict == "described"]
        how = f"; it behaves like {' and '.join(others)}" if others else ""
        return (
            INCONCLUSIVE,
            f"{' and '.join(unexplained)}: something is left that nothing in the catalogue explains{how}",
        )
    return None


def _missing(state: Decision) -> str:
    """What is not reached yet, in one phrase."""
    short = [f"{t.label} {100 * t.relative:.2g} % for {100 * t.wanted:g} %" for t in state.targets if not t.met]
    parts = [", ".join(short)] if short else []
    parts += [f"{' and '.join(tied)} are tied" for tied in state.tied]
    parts += [f"{name}: something is left" for name, v in state.verdicts.items() if v.left]
    return "; ".join(parts) or "all directions and airflows, and a verdict on all runs"
