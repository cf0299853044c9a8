"""What a decision holds, when it is the last one, and what is missing until then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shockrig.analysis.planning.choose import Choice
from shockrig.analysis.planning.evidence import label_of
from shockrig.analysis.planning.goals import Goals
from shockrig.analysis.planning.judged import ChannelLook
from shockrig.analysis.planning.places import Place
from shockrig.analysis.planning.precision import FEWEST_RUNS, Target
from shockrig.analysis.planning.verdict import Verdict

CONTINUE, DONE, INCONCLUSIVE = "continue", "done", "inconclusive"
MOST_UNEXPLAINED = 4  # runs that are spent on what nothing explains


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
    verdicts : mapping of a place, a channel of a probe, to Verdict
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
    few : tuple of places
        Where ties are to be decided and all else is met, those of which too few runs are there to judge by.
    """

    status: str
    reason: str
    recorded: tuple[str, ...] = ()
    minutes_spent: float = 0.0
    targets: tuple[Target, ...] = ()
    verdicts: Mapping[Place, Verdict] = field(default_factory=dict)
    choices: tuple[Choice, ...] = ()
    considered: tuple[Choice, ...] = ()
    chased: int = 0
    unvaried: bool = False
    gained: float | None = None
    few: tuple[Place, ...] = ()

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
    decided = not tied and not state.few and all(v.runs or looks[n].problem is None for n, v in state.verdicts.items())
    if met and (not goals.ties or (decided and not unexplained)):
        named = dict.fromkeys(e for v in verdicts for e in v.named)
        enough = "the plain model is enough" if any(v.runs for v in verdicts) else "nothing was diagnosed"
        stands = f"named: {', '.join(named)}" if named else "" if tied else enough
        return DONE, "; ".join(filter(None, ("all goals are met", stands, *_said(tied))))
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
    short = [f"{t.label} {_how_well(t)}" for t in state.targets if not t.met]
    parts = [", ".join(short)] if short else []
    parts += _said(state.tied)
    parts += [f"{name}: something is left" for name, v in state.verdicts.items() if v.left]
    parts += [f"{place}: too few runs to judge by" for place in state.few]
    parts += ["a direction or an airflow has had fewer than two runs"] if state.unvaried else []
    return "; ".join(parts) or "a verdict on all runs is missing"


def _said(tied: Mapping[Place, list[str]]) -> list[str]:
    """What is tied, a phrase for each place."""
    return [f"{place}: {' and '.join(explanations)} are tied" for place, explanations in tied.items()]


def _how_well(target: Target) -> str:
    """How well it is known that is not known well enough."""
    if not target.runs:
        return "is not known yet"
    if target.relative <= target.wanted:
        return f"rests on fewer than {FEWEST_RUNS} runs"
    return f"{100 * target.relative:.2g} % for {100 * target.wanted:g} %"
