"""What a decision holds, when it is the last one, what is missing until then, and how the plan and the log say it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from shockrig.analysis.design.choose import Choice
from shockrig.analysis.design.explanation import label_of
from shockrig.analysis.design.goals import Goals, Place
from shockrig.analysis.design.menu import PlannedShock, from_run
from shockrig.analysis.design.targets import FEWEST_RUNS, Target
from shockrig.analysis.plan.look import FEWEST_JUDGED, ChannelLook, Conclusion
from shockrig.files.campaign_names import FIRST_PROBE
from shockrig.files.json_files import made_of, measured
from shockrig.files.plan_file import DECISION_FORMAT, PLAN_FORMAT

CONTINUE, DONE, INCONCLUSIVE = "continue", "done", "inconclusive"
MOST_UNEXPLAINED = 4  # runs that are spent on what nothing explains


@dataclass(frozen=True)
class Decision:
    """What was found at one look, and what shall be done.

    Attributes
    ----------
    status : str
        "continue", "done" or "inconclusive"; empty where nothing is decided yet.
    reason : str
        Why it stops or goes on.
    recorded : tuple of str
        Ids of the runs that it rests on.
    minutes_spent : float
    targets : tuple of Target
    verdicts : mapping of a place, a channel of a probe, to Conclusion
    choices : tuple of Choice
        The runs to record next, in order.
    considered : tuple of Choice
        The best of the menu, the chosen ones first.
    chased : int
        How many runs were chosen for what nothing explains.
    unvaried : bool
        Whether ties are to be decided, and fewer than two runs have had a direction or an airflow that is possible.
    gained : float or None
        What the runs since the last decision brought to the rates that goals want [nats]; None where there are none.
    """

    status: str = ""
    reason: str = ""
    recorded: tuple[str, ...] = ()
    minutes_spent: float = 0.0
    targets: tuple[Target, ...] = ()
    verdicts: Mapping[Place, Conclusion] = field(default_factory=dict)
    choices: tuple[Choice, ...] = ()
    considered: tuple[Choice, ...] = ()
    chased: int = 0
    unvaried: bool = False
    gained: float | None = None

    @property
    def tied(self) -> dict[Place, list[str]]:
        """The explanations that stand beside one another, of each place that has any."""
        return {place: list(v.tied) for place, v in self.verdicts.items() if v.tied}


def ended_by(state: Decision, goals: Goals, looks: Mapping[Place, ChannelLook]) -> tuple[str, str] | None:
    """Status and reason where nothing more is to be recorded."""
    if not state.recorded:
        return None
    met = all(target.met for target in state.targets)
    tied, verdicts = state.tied, state.verdicts.values()
    unexplained = [name for name, verdict in state.verdicts.items() if verdict.left]
    given_up = [place for place, look in looks.items() if look.given_up]
    judged = all(v.runs or looks[n].channel is None for n, v in state.verdicts.items())
    decided = judged and not tied and not given_up
    if met and (not goals.ties or (decided and not unexplained)):
        named, seen = dict.fromkeys(e for v in verdicts for e in v.named), any(v.runs for v in verdicts)
        enough = "the plain model is enough" if seen else "nothing was diagnosed"
        stands = f"named: {', '.join(named)}" if named else "" if tied else enough
        unseen = [
            f"{place}: no run shows it" for place, v in state.verdicts.items() if goals.ties and seen and not v.runs
        ]
        return DONE, "; ".join(filter(None, ("all goals are met", stands, *_said(tied), *unseen)))
    if met and given_up and not tied and not unexplained:
        too_few = f"fewer than {FEWEST_JUDGED} runs can be used, too few to judge by"
        return INCONCLUSIVE, f"{' and '.join(given_up)}: {too_few}"
    if met and goals.ties and unexplained and not tied and state.chased >= MOST_UNEXPLAINED:
        others = [label_of(v.causes, [v.causes, {}]) for v in verdicts if v.verdict == "described"]
        how = f"; it behaves like {' and '.join(others)}" if others else ""
        return (
            INCONCLUSIVE,
            f"{' and '.join(unexplained)}: something is left that nothing in the catalogue explains{how}",
        )
    return None


def missing(state: Decision) -> str:
    """What is not reached yet, in one phrase."""
    short: dict[tuple[str, str], list[Target]] = {}
    for target in state.targets:
        if not target.met:
            short.setdefault((target.named, _how_well(target)), []).append(target)
    parts = [", ".join(f"{name}{_places(those)} {how}" for (name, how), those in short.items())] if short else []
    parts += _said(state.tied)
    parts += [f"{name}: something is left" for name, v in state.verdicts.items() if v.left]
    parts += ["a direction or an airflow has had fewer than two runs"] if state.unvaried else []
    return "; ".join(parts) or "a verdict on all runs is missing"


def _said(tied: Mapping[Place, list[str]]) -> list[str]:
    """What is tied, a phrase for each place."""
    return [f"{place}: {' and '.join(explanations)} are tied" for place, explanations in tied.items()]


def _places(targets: Sequence[Target]) -> str:
    """The ambients of targets that are said together."""
    at = [f"{t.ambient_c:g}" for t in targets if t.ambient_c is not None]
    return f" at {', '.join(at)} degC" if at else ""


def _how_well(target: Target) -> str:
    """How well it is known that is not known well enough."""
    if not target.known:
        return "is not known yet"
    if not target.runs:
        return f"is known to {100 * target.relative:.2g} % by the fleet alone"
    if target.relative <= target.wanted:
        return f"rests on fewer than {FEWEST_RUNS} runs"
    return f"{100 * target.relative:.2g} % for {100 * target.wanted:g} %"


def plan_document(decision: Decision, goals: Goals) -> dict[str, Any]:
    """Content of a plan's file."""
    return {
        "format": PLAN_FORMAT,
        "status": decision.status,
        "goals": _goals(decision, goals),
        "runs": [_run(choice) for choice in decision.choices],
        "tied": list(decision.tied.values()),
        "minutes_spent": measured(decision.minutes_spent),
        "reason": decision.reason,
    }


def _goals(decision: Decision, goals: Goals) -> list[dict[str, Any]]:
    """Each number that is wanted, `now` in percent as the goal has it; then ties and minutes."""
    listed: list[dict[str, Any]] = [
        {
            "goal": f"{target.label} {100 * target.wanted:g} %",
            "now": measured(100 * target.relative) if target.known else None,
            "met": target.met,
        }
        for target in decision.targets
    ]
    if goals.ties:
        verdicts = decision.verdicts.values()
        judged = any(v.runs for v in verdicts) and not any(v.left for v in verdicts) and not decision.unvaried
        listed.append({"goal": "ties decided", "now": len(decision.tied), "met": judged and not decision.tied})
    if goals.minutes is not None:
        spent = decision.minutes_spent
        listed.append({"goal": f"minutes {goals.minutes:g}", "now": measured(spent), "met": spent <= goals.minutes})
    return listed


def _run(choice: Choice) -> dict[str, Any]:
    return {
        **choice.shock.as_run(),
        "expected_minutes": measured(choice.minutes),
        "expected_evidence": measured(choice.evidence),
        "expected_evidence_of_second_probe": measured(choice.beside),
        "expected_information": measured(choice.information),
        "expected_progress": measured(choice.goals),
        "expected_worth": measured(choice.worth),
    }


def log_entry(
    decision: Decision,
    goals: Goals,
    before: Mapping[str, Any] | None,
    vetoed: list[PlannedShock],
    waited_s: float = 0.0,
    probes: Sequence[str] = (FIRST_PROBE,),
) -> dict[str, Any]:
    """One line of a campaign's log of decisions; `before` is the line before it, `waited_s` how long the bench stood
    still for this decision [s], `probes` those whose records it rests on.
    """
    return {
        "format": DECISION_FORMAT,
        "number": 1 if before is None else int(before["number"]) + 1,
        "until": str(goals),
        "probes": list(probes),
        "recorded": list(decision.recorded),
        **plan_document(decision, goals) | {"format": DECISION_FORMAT},
        "targets": [asdict(t) | {"label": t.label, "progress": measured(t.progress)} for t in decision.targets],
        "verdicts": {place: _verdict(verdict) for place, verdict in decision.verdicts.items()},
        "considered": [_run(choice) for choice in decision.considered],
        "vetoed": [shock.as_run() for shock in vetoed],
        "chased": decision.chased,
        "waited_s": measured(waited_s),
        "realised": None if before is None else realised(decision, before),
    }


def realised(decision: Decision, before: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the runs since the decision before brought, beside what was expected of them; None where there were none."""
    new = [id_ for id_ in decision.recorded if id_ not in before["recorded"]]
    expected = before["runs"][: len(new)]
    if not new or not expected:
        return None
    told = 0.0
    for place, verdict in decision.verdicts.items():
        was = before["verdicts"].get(place, {}).get("dispute")
        for dispute in (*verdict.settled, verdict.dispute):
            if was and dispute and tuple(was["runs"]) == dispute.runs:
                told = max([told, *(x - y for x, y in zip(dispute.against, was["against"], strict=True))])
    return {
        "runs": new,
        "minutes": measured(decision.minutes_spent - before["minutes_spent"]),
        "expected_minutes": measured(sum(run["expected_minutes"] for run in expected)),
        "information": None if decision.gained is None else measured(decision.gained),
        "expected_information": _sum(run["expected_information"] for run in expected),
        "evidence": measured(told),
        # Of each run it was expected as if that were made alone; of several together it is less than the sum.
        "expected_evidence": expected[0]["expected_evidence"] if len(expected) == 1 else None,
    }


def _sum(values: Iterable[float | None]) -> float | None:
    """Of what was expected; None where of one run nothing could be."""
    known = list(values)
    return None if None in known else measured(sum(v for v in known if v is not None))


def _verdict(verdict: Conclusion) -> dict[str, Any]:
    """As `remembered` reads it, with the labels of what was tied."""
    said = asdict(verdict)
    for dispute, own in ((verdict.dispute, said["dispute"]), *zip(verdict.settled, said["settled"], strict=True)):
        if dispute is not None:
            own["labels"] = dispute.labels()
    return said


def remembered(entry: Mapping[str, Any] | None) -> Decision | None:
    """What the next decision has to know of the last one, from its line in the log; None where there is none."""
    if entry is None:
        return None
    verdicts = {place: made_of(Conclusion, said) for place, said in entry["verdicts"].items()}
    recorded = tuple(entry["recorded"])
    return Decision(entry["status"], entry["reason"], recorded, verdicts=verdicts, chased=entry["chased"])


def chosen(entry: Mapping[str, Any]) -> list[PlannedShock]:
    """The runs that a line of the log decided on."""
    return [from_run(run) for run in entry["runs"]]
