"""A decision as files have it: the plan (`shock-plan/1`), and the entry of the campaign's log with all it rests on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from shockrig.analysis.planning.choose import Choice, progress
from shockrig.analysis.planning.decision import Decision
from shockrig.analysis.planning.evidence import Dispute
from shockrig.analysis.planning.goals import Goals
from shockrig.analysis.planning.places import Place
from shockrig.analysis.planning.precision import Target
from shockrig.analysis.planning.shock import PlannedShock, from_run
from shockrig.analysis.planning.verdict import Verdict
from shockrig.files.campaign_names import FIRST_PROBE
from shockrig.files.json_files import measured
from shockrig.files.plan import DECISION_FORMAT, PLAN_FORMAT


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
            "now": measured(100 * target.relative) if target.runs else None,
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
        "targets": [_target(target) for target in decision.targets],
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
        was = before["verdicts"].get(place, {})
        disputes = [(verdict.dispute, verdict.against)] if verdict.dispute is not None else []
        for dispute, against in (*verdict.settled, *disputes):
            if was.get("dispute", {}).get("runs") == list(dispute.runs):
                told = max([told, *(x - y for x, y in zip(against, was["against"], strict=True))])
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


def _progress(target: Target) -> float:
    return progress(target, target.relative**2, target.runs)


def _target(target: Target) -> dict[str, Any]:
    return {
        "channel": target.channel,
        "label": target.label,
        "relative": measured(target.relative),
        "wanted": target.wanted,
        "runs": target.runs,
        "progress": measured(_progress(target)),
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    open_ = {} if verdict.dispute is None else {"dispute": _dispute(verdict.dispute)}
    return {
        "verdict": verdict.verdict,
        "runs": verdict.runs,
        "causes": {effect: dict(values) for effect, values in verdict.causes.items()},
        "against": [measured(x) for x in verdict.against],
        "out": [list(ids) for ids in verdict.out],
        "looks": verdict.looks,
        "final": verdict.final,
        "due": verdict.due,
        "settled": [_dispute(d) | {"against": [measured(x) for x in against]} for d, against in verdict.settled],
        **open_,
    }


def _dispute(dispute: Dispute) -> dict[str, Any]:
    return {
        "explanations": [{e: dict(v) for e, v in one.items()} for one in dispute.explanations],
        "labels": dispute.labels(),
        "runs": list(dispute.runs),
    }


def _dispute_of(said: Mapping[str, Any]) -> Dispute:
    return Dispute(tuple(said["explanations"]), tuple(said["runs"]))


def remembered(entry: Mapping[str, Any] | None) -> Decision | None:
    """What the next decision has to know of the last one, from its line in the log; None where there is none."""
    if entry is None:
        return None
    verdicts: dict[Place, Verdict] = {}
    for place, said in entry["verdicts"].items():
        dispute = said.get("dispute")
        verdicts[place] = Verdict(
            said["verdict"],
            said["runs"],
            said["causes"],
            None if dispute is None else _dispute_of(dispute),
            tuple(said["against"]),
            tuple(tuple(ids) for ids in said["out"]),
            said["looks"],
            tuple((_dispute_of(one), tuple(one["against"])) for one in said["settled"]),
            bool(said.get("final")),
            bool(said.get("due")),
        )
    return Decision(
        entry["status"], entry["reason"], tuple(entry["recorded"]), verdicts=verdicts, chased=entry["chased"]
    )


def chosen(entry: Mapping[str, Any]) -> list[PlannedShock]:
    """The runs that a line of the log decided on."""
    return [from_run(run) for run in entry["runs"]]
