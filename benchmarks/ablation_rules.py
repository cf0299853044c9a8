"""The rules, caps and thresholds of the diagnosis, each with what stands in its place where it is taken away.

A rule that the code of the day does not have (renamed, deleted) is said to be missing, and nothing else happens.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

HOME = "shockrig.analysis"
INF = float("inf")


@dataclass(frozen=True)
class Rule:
    """One rule: where it stands (module.name, or `level:` and a threshold), what it does, and its neutral values.

    `instead` is {place: constant or function}.
    """

    name: str
    does: str
    instead: dict[str, Any]

    @property
    def acts(self) -> bool:
        """Whether functions stand for it, which say by themselves whether they did anything."""
        return all(callable(value) or isinstance(value, property) for value in self.instead.values())

    @property
    def marks(self) -> set[str]:
        """Names that code must mention for the rule to have a say in it."""
        return {place.rpartition(".")[2].removeprefix("level:") for place in self.instead}


def _same(thing: Any, *_: Any, **__: Any) -> Any:
    return thing


def _never(*_: Any, **__: Any) -> bool:
    return False


def _always(*_: Any, **__: Any) -> bool:
    return True


def _none(*_: Any, **__: Any) -> None:
    return None


def _nothing(*_: Any, **__: Any) -> list[Any]:
    return []


def _no_text(*_: Any, **__: Any) -> str:
    return ""


def _second(_: Any, thing: Any, *__: Any, **___: Any) -> Any:
    return thing


def _aic(parameters: int) -> float:
    return 2.0 * max(parameters, 1)


def _no_exchange(self: Any, current: Any, swap: bool = True) -> tuple[Any, dict[str, Any], bool]:
    """Each effect stands by its own necessity, with nothing tried in its place."""
    search = import_module(f"{HOME}.diagnosis.search")
    standing = {}
    for effect in self.added(current):
        bare = self.dropped(current, effect)
        worth = search.borne_out(self.problem, bare, current)
        standing[effect] = search.Standing(bare.deviance - current.deviance, worth, {}, {})
    return current, standing, False


def level(name: str, value: float, does: str) -> Rule:
    return Rule(name, does, {f"level:{name}": value})


S, K, N, D = "diagnosis.search.", "diagnosis.kept.", "diagnosis.naming.", "discovery.discover."
A, G, R, W = "diagnosis.adequacy.", "diagnosis.gain.", "diagnosis.refitting.", "diagnosis.diagnose."

RULES = (
    # The verdict.
    level("adequacy", -1.0, "the model-free tests: nothing is ever left by them"),
    level("held_out_excess", INF, "an error of twice the noise on unseen runs is a remainder"),
    level("rate_scatter", INF, "rates that scatter by 2.2 % are an effect"),
    level("stated_scatter", 1.0, "stated uncertainties may be exceeded by 1.7"),
    Rule("least hum", "a line counts from a quarter of the noise on", {f"{A}LEAST_HUM": 0.0}),
    Rule("bursts", "a reading belongs to a burst from 5.5 sigma on", {f"{A}BURST": INF}),
    Rule("hum beside slow noise", "the noise beside a line is taken as it is", {f"{A}_beside": np.ones_like}),
    Rule("restless", "hum and bursts are described from the plateaus", {f"{W}restless": lambda *_: ()}),
    Rule("nothing else", "a hum alone is 'described'", {f"{W}nothing_else": _never}),
    # Caps of a probability.
    Rule("in doubt", "a shape beside what is left has 0.8 or 0.5 at most", {f"{W}in_doubt": _same}),
    level("shape_in_doubt", 1.0, "cap at 0.8 of what is beside a remainder, or of one run"),
    level("shape_beside_most", 1.0, "cap at 0.5 where most of the error is left"),
    level("outdone", 1.0, "cap at 0.5 of a cause that a plain behaviour outdoes"),
    Rule("tied by forms", "a cause shares its odds with like laws and forms", {f"{W}tied": _same}),
    Rule("no surer", "no likelier than beside what is left later", {f"{K}_no_surer": _same}),
    Rule("no surer than runs", "parameters no surer than a jackknife", {f"{W}no_surer_than_runs": _second}),
    Rule("film's temperature unknown", "cap at 0.5 of shapes there", {f"{K}own_temperature_unknown": _never}),
    Rule("film's air unknown", "cap at 0.5 of bodies there", {f"{K}air_of_a_film_unknown": _never}),
    Rule("one of two readings", "how an unknown film reads is in doubt", {f"{K}_one_of_two_readings": _never}),
    Rule(
        "caps of a description",
        "0.5 with work ended or a remainder, 0.97 in any case",
        {f"{D}UNTRIED": 1.0, f"{D}MOST_CERTAIN": 1.0},
    ),
    Rule("inflation of ties", "beside a remainder ties are wider", {f"{A}Adequacy.inflation": property(lambda _: 1.0)}),
    # What is named.
    Rule("certain", "beside a remainder a cause must dwarf it", {f"{K}_certain": _always}),
    level("certain_excess", 0.0, "by 20 times what is left"),
    level("certain_least", 0.0, "and by 200 of deviance besides"),
    Rule("plain shape", "a shape is no claim where the body is unknown", {f"{K}_plain_shape": _never}),
    Rule("dropped", "what unseen runs do not bear out is dropped", {f"{K}_dropped": _nothing}),
    Rule("unproven", "one run bears no cause out", {f"{K}_unproven": _nothing}),
    level("many_runs", INF, "with 20 runs the fit's evidence may stand for the gain"),
    level("plain_to_see", 0.0, "one run must show a shape by 1.5 in mean squares"),
    Rule("unsettled", "no shape from a run that has not settled", {f"{K}_unsettled": _never}),
    Rule("weighed alike", "a wrong model is fitted for what it predicts", {f"{K}weighed_alike": _second}),
    Rule(
        "anything",
        "a number that may be anything is none",
        {f"{S}says_nothing": _no_text, f"{K}says_nothing": _no_text},
    ),
    Rule("refused", "an entry's own refusal", {f"{S}refused": _never, f"{K}refused": _never, f"{N}refused": _never}),
    Rule("doubts", "plain forms in a name's place", {f"{W}doubts": _nothing}),
    Rule("from rivals", "search again from the law of a missed effect", {f"{W}from_rivals": _none}),
    Rule(
        "from a description",
        "search again from what a description's law is",
        {"diagnosis.describing.from_description": _none},
    ),
    Rule("plainly", "a form must beat a name by odds of 400", {f"{N}PLAINLY": 6.0}),
    Rule("average", "a running mean that the response shows", {f"{W}likelier_average": _none}),
    Rule("not gaussian", "codes say less than their variance, by 1.5", {"level:not_gaussian": 1.0}),
    # The penalty.
    Rule("false alarms", "penalty from 1 % of plain campaigns; instead: AIC", {"diagnosis.thresholds._quantile": _aic}),
    Rule(
        "rarity",
        "what benches rarely have must bring more",
        {"inference.effect.Effect.rarity": lambda *_: 0.0},
    ),
    Rule("Student", "a drop counts by Student's t", {f"{S}evidence": _second}),
    Rule("less scatter", "an effect that replaces scatter is worth it", {f"{S}LESS_SCATTER": INF}),
    Rule("worse without", "each effect must help unseen runs", {f"{K}worse_without": _always}),
    Rule("trace", "a hundredth of the error is no gain", {f"{G}TRACE": 0.0}),
    Rule("usual spread", "gains scatter by half before runs say so", {f"{G}USUAL_SPREAD": 0.0}),
    Rule("confidence", "a gain is one at 97.5 %", {f"{G}CONFIDENCE": 0.5}),
    # The search.
    Rule("exchange", "each effect against all in its place", {f"{S}Stepwise.exchange": _no_exchange}),
    Rule("backward", "effects that no longer earn their place go", {f"{S}Stepwise.backward": _second}),
    Rule(
        "in its place",
        "rivals begin from where the one found led",
        {f"{S}Stepwise._transfers_marked": property(_never)},
    ),
    Rule("worth a fit", "a quarter of the penalty to first order", {f"{S}WORTH_A_FIT": 0.0}),
    Rule("finished", "three candidates are carried to the end", {f"{S}FINISHED": 1}),
    Rule("limit of fits", "200 fits of a search", {f"{S}MOST_FITS": 1e9}),
    Rule("mirror", "a share at its end changes places with the body", {f"{R}mirror": _none, f"{S}mirror": _none}),
    Rule("nudges", "fits from beside a step", {f"{R}_nudged": _nothing}),
    Rule("unstuck", "runs stuck before a step are moved", {f"{R}unstuck": _second}),
    Rule("far rounds", "five rounds where the model is plainly wrong", {f"{R}FAR_ROUNDS": 1}),
    # The description.
    Rule("all descriptions", "the grammar's search", {f"{W}describe_rest": _none}),
    Rule("alone", "a description may do without the names", {"diagnosis.describing.alone": _never}),
    Rule(
        "idle", "names not worth their penalty beside it go", {"diagnosis.describing.without_idle": lambda p, q, f: f}
    ),
    Rule("two forms", "at most two forms, the second where half is gone", {f"{D}MOST": 1}),
    Rule("hardly", "no second form where half is left", {f"{D}HARDLY": INF}),
    Rule(
        "null of the maximum",
        "what the best of all forms reaches by chance",
        {"discovery.scores.null_of_the_maximum": lambda *_: 0.0},
    ),
    Rule("certain description", "10 times what is left, and 60", {f"{D}CERTAIN": 0.0, f"{D}CERTAIN_LEAST": 0.0}),
    Rule(
        "by condition", "whole conditions must be predicted", {"discovery.conditions.Judged.holds": property(_always)}
    ),
    Rule("says something", "no number at its end", {f"{D}says_something": _always, f"{N}says_something": _always}),
    Rule("most of it", "a description must end 0.9 of the error", {"diagnosis.describing.MOST": 0.0}),
    Rule("plainest", "forms that a flight can use go first", {f"{D}_plainest": lambda found, left: found[0]}),
    Rule("less", "factors not worth their number go", {f"{D}_less": lambda p, stages, now, work: (stages, now)}),
    Rule("factor", "a factor must bring 14, not 6", {"discovery.race.FACTOR": 6.0}),
)


def _modules() -> list[Any]:
    return [m for name, m in sorted(sys.modules.items()) if name.startswith(HOME) and m is not None]


def _owner(place: str) -> tuple[Any, str] | None:
    """The module or class that holds a name, and the name there; None where the code has it no more."""
    parts = place.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            owner = import_module(".".join([HOME, *parts[:cut]]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:-1]:
            owner = getattr(owner, part, None)
        return (owner, parts[-1]) if owner is not None and hasattr(owner, parts[-1]) else None
    return None


def _thresholds() -> dict[str, Any]:
    try:
        table: dict[str, Any] = import_module(f"{HOME}.diagnosis.thresholds").THRESHOLDS
    except (ModuleNotFoundError, AttributeError):
        return {}
    return table


def there(rule: Rule) -> bool:
    """Whether the code has what a rule replaces."""
    return all(
        place[6:] in _thresholds() if place.startswith("level:") else _owner(place) is not None
        for place in rule.instead
    )


def _differs(one: Any, other: Any) -> bool:
    """Whether two results may be different: arrays and what holds them are, unless they are the same object."""
    if one is other:
        return False
    plain = (bool, int, float, str, tuple, list, type(None))
    try:
        return not (isinstance(one, plain) and isinstance(other, plain) and one == other)
    except ValueError:
        return True


def _watched(was: Any, instead: Any, fired: Callable[[], None]) -> Any:
    """A function or property that says when it does what its neutral one would not."""
    own, other = (thing.fget if isinstance(thing, property) else thing for thing in (was, instead))

    def watched(*args: Any, **kwargs: Any) -> Any:
        result = own(*args, **kwargs)
        if other is _no_exchange or _differs(result, other(*args, **kwargs)):
            fired()
        return result

    return property(watched) if isinstance(was, property) else watched


@contextmanager
def watching(rules: Sequence[Rule]) -> Iterator[set[str]]:
    """The rules that functions stand for and that do something while it lasts; each is in the set once it has."""
    fired: set[str] = set()
    with ExitStack() as stack:
        for rule in rules:
            for place, value in rule.instead.items():
                found = None if place.startswith("level:") else _owner(place)
                if found is None or not (callable(value) or isinstance(value, property)):
                    continue
                was = inspect.getattr_static(*found)
                own = _watched(was, value, lambda name=rule.name: fired.add(name))
                stack.enter_context(without(Rule(rule.name, rule.does, {place: own})))
        yield fired


@contextmanager
def without(rule: Rule | None) -> Iterator[None]:
    """The analysis without a rule, in every module that has its name."""
    undo: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
    try:
        for place, value in rule.instead.items() if rule else ():
            if place.startswith("level:"):
                table, key = _thresholds(), place[6:]
                undo.append((table.__setitem__, (key, table[key])))
                table[key] = replace(table[key], value=value)
                continue
            found = _owner(place)
            assert found is not None
            owner, name = found
            was = inspect.getattr_static(owner, name)
            holders = [owner] if isinstance(owner, type) else _holders(name, was)
            for holder in holders:
                undo.append((setattr, (holder, name, was)))
                setattr(holder, name, value)
        yield
    finally:
        for act, args in reversed(undo):
            act(*args)


def _holders(name: str, thing: Any) -> list[Any]:
    """Modules that have imported a constant or function under its name."""
    return [m for m in _modules() if m.__dict__.get(name) is thing and not isinstance(m, type)]


def lines(rule: Rule) -> int:
    """Lines of code of a rule: of its function, and those that mention it."""
    count = 0
    for place in rule.instead:
        if place.startswith("level:"):
            count += sum(f'"{place[6:]}"' in text for m in _modules() for text in _source(m))
            continue
        found = _owner(place)
        if found is None:
            continue
        owner, name = found
        thing = inspect.getattr_static(owner, name)
        thing = thing.fget if isinstance(thing, property) else getattr(thing, "__wrapped__", thing)
        home = sys.modules[owner.__module__] if isinstance(owner, type) else owner
        if inspect.isfunction(thing):
            count += len(inspect.getsourcelines(thing)[0])
        count += sum(name in text.split("#")[0] for text in _source(home)) - inspect.isfunction(thing)
    return max(count, 1)


def _source(module: Any) -> list[str]:
    return inspect.getsource(module).splitlines()
