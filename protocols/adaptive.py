"""The closed loop on a bench: after each run look, decide, log, and hand the next run to the recorder.

A decision stands in the campaign's log before its run begins, so a campaign that was killed goes on with the same one;
killed before that, it decides the same anew, because a decision is a function of the runs, the goals and the log. On a
bench in real time diagnoses are made while the next run is recorded, and the decision after it rests on them, whenever
they were ready; where the clock is virtual nothing waits, and each decision rests on a diagnosis of all runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.protocols.background import Background
from shockrig.protocols.decided import as_protocol, feasible_on, in_words, lines, minutes_left, surroundings_of
from shockrig.protocols.each_probe import seen_by, wanted_probes
from shockrig.protocols.made_before import outcomes
from shockrig.rig.clock import VirtualClock
from shockrig.rig.protocol import PlannedRun, Protocol
from shockrig.rig.recorder import read_state
from shockrig.rig.recorder.campaign_folder import planned_entry
from shockrig.rig.recorder.state import read_head

if TYPE_CHECKING:
    from shockrig.analysis.design.goals import Goals, Place
    from shockrig.analysis.design.menu import PlannedShock
    from shockrig.analysis.diagnose.diagnosed import ChannelOutcome
    from shockrig.analysis.plan.decision import Decision
    from shockrig.files.fleet_file import Population
    from shockrig.rig.bench import Bench

NAME = "adaptive"


class Loop:
    """Says which run comes next, whenever the recorder asks.

    Parameters
    ----------
    path : Path
        Campaign folder, new or to go on with.
    goals : Goals
    bench : Bench
        What can be chosen is what it can do; its operator is asked where `confirm` is true.
    added : sequence of PlannedRun
        What the operator wants recorded before anything is decided; what is recorded of it already is left out.
    confirm : bool
        Whether each choice waits for the operator: Enter, s to veto it, p to pause, a to abort.
    say : function of a line
    probe : str, optional
        By which of several probes alone it is decided; by all of them where none is named.
    """

    def __init__(
        self,
        path: Path,
        goals: Goals,
        bench: Bench,
        say: Callable[[str], None],
        added: Sequence[PlannedRun] = (),
        confirm: bool = False,
        probe: str | None = None,
        population: Population | None = None,
    ) -> None:
        self._path, self._goals, self._bench, self._say = path, goals, bench, say
        self._probe, self._population = probe, population
        self._added, self._confirm = list(added), confirm
        self._own: list[dict[str, Any]] | None = None  # runs that the operator had added before this process
        self._feasible = feasible_on(bench)
        self.decision: Decision | None = None
        self.waited_s = 0.0  # that the bench stood still for decisions, by its own clock
        self._later = not isinstance(bench.clock, VirtualClock)
        self._background = Background()
        self._made: dict[Place, ChannelOutcome] | None = None  # by a diagnosis that lay beside the campaign

    def __call__(self, left_out: str | None, now_s: float) -> Protocol | None:
        """The protocol with the next run, or None where the campaign is done; `left_out` was vetoed at a prompt."""
        from shockrig.files.plan_file import read_decisions

        state = read_state(self._path)
        log = read_decisions(self._path, self._probes())
        while self._added:
            run, *self._added = self._added
            if not self._there_already(run, state, log):
                return self._of_operator(run, self._behind(state))
        pending = self._pending(log, state.recorded)
        if pending is not None and left_out is None:
            self._think_on(log[-1])
            self._say(f"going on with the decision before: {pending.why}")
            return self._next(pending, state)
        vetoed = [pending] if pending is not None else []
        return self._decide(state, log, vetoed)

    def _there_already(self, run: PlannedRun, state: Any, log: list[dict[str, Any]]) -> bool:
        """Whether a run of the operator's was recorded by the same command, which was then killed."""
        if self._own is None:
            decided = {len(entry["recorded"]) for entry in log}
            places = {id_ for k, id_ in enumerate(state.recorded) if k not in decided}
            self._own = [entry for entry in read_head(self._path)["plan"] if entry["id"] in places]
        same = [entry for entry in self._own if planned_entry(run) | {"id": entry["id"]} == entry]
        if same:
            self._own.remove(same[0])
        return bool(same)

    def _probes(self) -> tuple[str, ...]:
        """By which it is decided."""
        return wanted_probes(self._path, self._probe)

    def _pending(self, log: list[dict[str, Any]], recorded: Sequence[str]) -> PlannedShock | None:
        """The run that was decided on and is not recorded; None where it is, or the decision was for another goal."""
        from shockrig.analysis.plan.decision import chosen

        if not log or log[-1]["until"] != str(self._goals) or log[-1]["recorded"] != list(recorded):
            return None
        runs = chosen(log[-1])
        return runs[0] if runs else None

    def _decide(self, state: Any, log: list[dict[str, Any]], vetoed: list[PlannedShock]) -> Protocol | None:
        from shockrig.analysis.design.menu import from_run
        from shockrig.analysis.plan.decide import decide
        from shockrig.analysis.plan.decision import CONTINUE, log_entry, plan_document, remembered
        from shockrig.files.plan_file import append_decision

        last = log[-1] if log else None
        if vetoed and last is not None:
            vetoed += [from_run(run) for run in last["vetoed"]]
        seen = seen_by(self._path, self._probes()) if state.recorded else []
        if self._made is None:
            self._made = outcomes(self._path, seen, self._say)
        while True:
            began_s = self._bench.clock.now()
            self.decision = decision = decide(
                seen,
                self._goals,
                remembered(last),
                feasible=partial(self._wanted, tuple(vetoed)),
                surroundings=surroundings_of(self._bench),
                later=self._later,
                due=self._background,
                made=self._made,
                population=self._population,
            )
            waited_s = self._bench.clock.now() - began_s
            self.waited_s += waited_s
            entry = log_entry(decision, self._goals, last, vetoed, waited_s, self._probes())
            append_decision(self._path, entry, sync=not self._bench.emulated)
            for line in lines(decision, plan_document(decision, self._goals)):
                self._say(line)
            left = minutes_left(decision)
            if left is not None:
                spent = decision.minutes_spent
                self._say(f"  about {left:.0f} min of bench time to the goals of precision, {spent:.0f} spent")
            if decision.status != CONTINUE:
                return None
            choice = decision.choices[0].shock
            if not self._confirm or self._agreed(choice):
                self._think_on(entry)
                return self._next(choice, state)
            vetoed = [choice, *vetoed]

    def _wanted(self, vetoed: Sequence[PlannedShock], shock: PlannedShock) -> bool:
        """Whether the bench can make a run that the operator has not vetoed."""
        return self._feasible(shock) and shock not in vetoed

    def _think_on(self, entry: dict[str, Any]) -> None:
        """Begin with the diagnoses that a decision left for later."""
        from shockrig.analysis.plan.decide import of_decision
        from shockrig.analysis.plan.decision import remembered

        decision = remembered(entry)
        due = {} if decision is None else {name: v for name, v in decision.verdicts.items() if v.due}
        if decision is not None and due:
            seen = seen_by(self._path, self._probes())
            self._background.begin([of_decision(one, decision) for one in seen], due)

    def close(self) -> None:
        """End what is thought beside the recording."""
        self._background.close()

    def _agreed(self, shock: PlannedShock) -> bool:
        """Whether the operator lets a choice pass. Raises what the person wants instead, but for a veto."""
        from shockrig.rig.bench_errors import RunRepeated, RunSkipped

        assert self._bench.operator is not None
        question = f"Next: {in_words(shock)} ({shock.why}). Enter records it, s vetoes it, p pauses, a aborts."
        while True:
            try:
                self._bench.operator.ask(question)
            except RunSkipped:
                return False
            except RunRepeated:
                self._say("this run is not recorded yet; --add records runs of your own, more of one as well")
            else:
                return True

    def _next(self, shock: PlannedShock, state: Any) -> Protocol:
        return as_protocol([shock], self._behind(state), NAME, str(self._goals), self._bench.pressures_hpa)

    @staticmethod
    def _behind(state: Any) -> int:
        """How many planned runs come before the next: all but those that were decided on and are not recorded."""
        planned = list(state.planned)
        while planned and planned[-1] not in state.recorded:
            planned.pop()
        return len(planned)

    def _of_operator(self, run: PlannedRun, continues: int) -> Protocol:
        from dataclasses import replace

        from shockrig.rig.protocol import run_id

        self._say(f"added by the operator: {run.note or 'a run'}")
        return Protocol(NAME, "", (replace(run, id=run_id(continues + 1)),), continues=continues)
