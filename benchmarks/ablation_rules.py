"""The rules, caps and thresholds of the diagnosis, each with what stands in its place where it is taken away.

A rule that the code of the day does not have (renamed, deleted) is said to be missing, and nothing else happens.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
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


def _never(*_: Any, **__: Any) -> bool:
    return False


def _none(*_: Any, **__: Any) -> None:
    return None


def _nothing(*_: Any, **__: Any) -> list[Any]:
    return []


def _second(_: Any, thing: Any, *__: Any, **___: Any) -> Any:
    return thing


def _stated(ready: Any, found: Any, stands: Any, shown: Any, whole: bool) -> Any:
    return stands


def _sound_as_it_is(self: Any, near: Any, one: Any) -> Any:
    """A model is kept as it was fitted, or not at all."""
    candidates = import_module(f"{HOME}.diagnose.candidates")
    return self.keep(one) if candidates.sound(one.fit, one.ids - self.fixed) else None


def level(name: str, value: float, does: str) -> Rule:
    return Rule(name, does, {f"level:{name}": value})


S, C, G, D = "diagnose.race.", "diagnose.candidates.", "diagnose.gain.", "diagnose.diagnose."
A, R, N, E = "diagnose.adequacy.", "estimate.refitting.", "estimate.noise.", "estimate."

RULES = (
    # The verdict.
    level("adequacy", -1.0, "the model-free tests: nothing is ever left by them"),
    level("held_out_excess", INF, "an error of twice the noise on unseen runs is a remainder"),
    level("rate_scatter", INF, "rates that scatter by 2.2 % are an effect"),
    level("stated_scatter", 1.0, "stated uncertainties may be exceeded by 1.7"),
    Rule("hum taken out", "a hum of the plateaus is taken out first", {f"{D}without_hums": lambda c: (c, ())}),
    Rule("bursts", "bursts are described from the plateaus", {f"{D}bursts": _none}),
    Rule("refuted", "a model that runs held out refute is not stated", {f"{D}refuted": _never}),
    Rule("predicting", "another model may predict than is stated", {"diagnose.predicting.predicting_model": _stated}),
    # What a model is held against before any data, and from when on it is stated.
    level("effect", 1.0, "nats against an effect; instead: AIC"),
    level("form", 0.0, "nats against a form beside an entry"),
    level("factor", 0.0, "nats against each condition of a form"),
    level("named", 0.5, "an effect more is stated from 0.75 on"),
    level("tie", 1.0, "a twentieth of the weight is a tie"),
    Rule("rarity", "what benches rarely have must bring more", {f"{E}effect.Effect.rarity": lambda *_: 0.0}),
    # What says nothing.
    level("anything", INF, "a number that may be anything is none"),
    Rule("end of range", "nor is one at the end of its range", {f"{C}at_bound": lambda *_: ()}),
    Rule("refused", "an entry's own refusal", {f"{C}refused": _never}),
    Rule("unended", "no shape from a run that still moves", {f"{C}_unended": _never}),
    Rule("sound part", "what a new effect leaves idle goes", {f"{S}Race._sound_part": _sound_as_it_is}),
    # The score.
    Rule("discrepancy", "each model is wrong by something of its own", {f"{E}predictive.DISCREPANCIES": np.zeros(1)}),
    Rule("misfit", "readings scatter more about a wrong model", {f"{E}predictive.MISFITS": np.zeros(0)}),
    Rule("noise of a run", "a run's noise is not quite known", {f"{E}predictive.NOISE_DEGREES": 1e6}),
    # The search.
    Rule("forms", "the grammar", {f"{C}forms": _nothing}),
    Rule("groups", "forms in groups of runs", {f"{S}bare_forms": lambda *_: ()}),
    Rule("simplest", "a form's conditions are taken away and others added", {f"{S}Race.simplest": _second}),
    Rule("pruned", "what gains no longer goes", {f"{S}Race.pruned": _second}),
    Rule("exchanged", "each effect against the others in its place", {f"{S}Race.exchanged": _second}),
    Rule("within reach", "a fit may bring 3 nats more than its promise", {f"{S}WITHIN_REACH": 0.0}),
    Rule(
        "far", "from a plainly wrong model fits begin anew", {f"{S}FAR_DISCREPANCY": INF, f"{S}plainly_wrong": _never}
    ),
    Rule("begun", "12 candidates are begun; instead: 6", {f"{S}BEGUN_COUNT": 6}),
    Rule("finished", "two are carried to the end; instead: one", {f"{S}FINISHED_COUNT": 1}),
    Rule("starts", "two starts each; instead: one", {f"{S}STARTS_EACH": 1}),
    Rule("nudges", "fits from beside where one ended", {f"{R}_nudged": _nothing}),
    Rule("unstuck", "runs stuck before a step are moved", {f"{R}unstuck": _second}),
    # The noise.
    Rule("average", "a running mean that the response shows", {f"{D}likelier_average": _none}),
    Rule("not_gaussian", "codes say less than their variance, by 1.5", {f"{E}coarse_codes.NOT_GAUSSIAN": 1.0}),
    Rule("no memory without end", "noise remembers 0.995 at most", {f"{N}LONGEST_MEMORY": 1.0 - 1e-9}),
    Rule("kinks", "a piece with a kink is no plateau", {f"{N}KINKED_DEVIATIONS": INF}),
    # Runs held out.
    Rule("placed", "a held-out run's own start and airs, within 2 sigma", {"diagnose.held_out.PLACED_WITHIN": 0.0}),
    Rule("untold", "no prediction by a part that does not tell the rate", {f"{G}UNTOLD_SIGMA": INF}),
    # What runs are used, and what may vary between them.
    Rule("slight steps", "a run of a tenth of the largest step is left out", {f"{E}gather.SLIGHT_STEP": 0.0}),
    Rule("rates' scatter", "rates scatter by 3 % at most", {f"{E}problem.RATE_SCATTER_LIMIT": 10.0}),
    Rule("unknown airflow", "rates scatter by half without airflow", {f"{E}problem.UNVENTILATED_LIMIT": 0.03}),
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
        table: dict[str, Any] = import_module(f"{HOME}.diagnose.thresholds").THRESHOLDS
    except (ModuleNotFoundError, AttributeError):
        return {}
    return table


def number_of(place: str) -> Any:
    """The number that stands at a place, as a rule says it."""
    if place.startswith("level:"):
        return _thresholds()[place[6:]]
    found = _owner(place)
    if found is None:
        raise ValueError(f"no number at {place}")
    return getattr(*found)


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
        if _differs(result, other(*args, **kwargs)):
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
                table[key] = value
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
