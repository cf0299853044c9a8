"""How much the diagnosis hangs on each of its numbers: every one halved and doubled, on the same campaigns.

    python benchmarks/sensitivity.py [--numbers NAME ...] [--kinds NAME ...] [--seeds 8] [--first 47000]
        [--out FILE.jsonl]

A number is an entry of the table of thresholds (`level:effect`) or a constant of any module
(`diagnose.hums.TURN_CELLS`). Campaigns are rough ones of the standard plan:

    hidden   a third plain, a third with one effect, a third with two
    logger   with a mean, repeats or coarse steps of the logger in one channel, which is looked at
    untimed  as hidden, the start of no transfer recorded
    grown    as hidden, looked at after 6 and 12 runs and at the end, as a planner does
    planned  as hidden, the two runs that a planner wants next after 12 runs: right is that it goes on, other that it
             wants others. Every number of the rooms design and plan is one of its
    flown    four pairs of models of a sensor, and how flights rank that would tell them apart: other is another order,
             plan or sentence, the error minutes per nat of the best one
    hums     half with a hum of 0.03 to 1 of the noise, some of these with bursts; a quarter with air that walks at
             random; the plateaus alone are looked at
    whole    as hidden, and all that a diagnosis says is looked at: what was tried and what predicts, what it cannot
             tell, what it proposes. Every number of the rooms diagnose is one of its (`--numbers` for some of them)

Per number: how many channels are right (all that is hidden named, nothing else, the right verdict; of hums, the period
within 1 %), of how many anything else is said than as it is, and the error on unseen runs over that as it is (geometric
mean). A number at which nothing changes is one to leave out. With --out it can be stopped and resumed.
"""

from __future__ import annotations

import argparse
import ast
import atexit
import functools
import json
import pickle
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from ablation_rules import Rule, number_of, without
from resumed import scored

from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.menu import PlannedShock
from shockrig.analysis.diagnose import diagnose as diagnosing
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis, ChannelOutcome, outcome_of
from shockrig.analysis.diagnose.hums import bursts, without_hums
from shockrig.analysis.diagnose.next_experiments import next_experiments
from shockrig.analysis.diagnose.search import search
from shockrig.analysis.diagnose.thresholds import THRESHOLDS
from shockrig.analysis.estimate.channel import rebin
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.noise import estimate_noise
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.estimate.without_model import rounding_step
from shockrig.analysis.plan import decide_flight
from shockrig.analysis.plan.decide import decide
from shockrig.analysis.plan.decide_flight import advice, ranked
from shockrig.analysis.plan.decision import CONTINUE
from shockrig.analysis.plan.flight_plan import words
from shockrig.analysis.plan.look import FEWEST_JUDGED, Conclusion, look_at
from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.learned import read_learned
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect, draw_hidden
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Hidden, draw_truth

Line = dict[str, Any]

HIDDEN: tuple[str | int, ...] = ("none", 1, 2)
OF_LOGGER = ("moving_average", "quantization", "stale_samples")
LOOKS = (6, 12, None)  # after how many runs; None: all
PLANNED_AFTER, GOALS, RUNS_PLANNED = 12, "alpha 0.2 %, D 0.3 %, ties decided", 2
HUM_HZ, HUM_IN_NOISE = (0.03, 3.0), (0.03, 1.0)
WALK_IN_NOISE = 0.3  # a reading, of a walk at random
BURST_SHARE = 0.02
PERIOD_WITHIN = 0.01
LAG, SECOND_PATH = (["lag"], {"time_constant_s": 8.0}), (
    ["second_path"], {"time_constant_s": 4.0, "fraction": 0.15, "second_time_constant_s": 60.0},
)  # fmt: skip
WARM, DESCENT = (["ventilated_warmth"], {"rise_k_at_5_m_s": 0.3}), (["offset_in_descent"], {"offset_in_descent": 0.5})
NOTHING: tuple[list[str], dict[str, float]] = ([], {})
RIVALS = ((LAG, SECOND_PATH), (NOTHING, WARM), (NOTHING, DESCENT), (LAG, NOTHING))
AIR_AND_NOISE = (0.5, 0.1, 0.1, 0.1, 0.03, 0.01)  # standard deviations of what a flight's own numbers say
OF_HUMS = (
    "LEAST_P_VALUE", "LEAST_PLATEAU", "LONGEST_S", "PER_WIDTH", "LINE_TURNS", "SEEN_SQUARE", "FINE_FACTOR",
    "BESIDE_WIDTHS", "AROUND_WIDTHS", "LEFT_OUT_SIGMAS", "BURST_SIGMAS", "A_HANDFUL",
    "EXPECTED_SHARE", "NEAR_TURN", "FEWEST_TURNS", "TURN_CELLS", "LEAST_READINGS", "FEWEST_PLATEAUS",
)  # fmt: skip
NUMBERS_OF = {
    "hidden": [f"level:{name}" for name in THRESHOLDS],
    "untimed": ["diagnose.held_out.STARTS_TRIED"],
    "grown": [
        "design.evidence.FALSE_ALARMS",
        *(f"plan.look.{n}" for n in ("FEWEST_JUDGED", "MORE_RUNS", "MOST_TIED")),
    ],
    "hums": [f"diagnose.hums.{name}" for name in OF_HUMS],
}
AS_IT_IS = "as it is"
# Modules of the room diagnose whose numbers a search reads, as it does all of the room estimate.
SEARCHING = frozenset({"search", "candidates", "grammar", "prepare", "adequacy", "hums"})
# Others that it reads, or what makes a channel ready for it.
SEARCHED = {f"level:{name}" for name in ("effect", "form", "factor", "named", "anything", "hidden_noise")}
SEARCHED |= {
    f"design.{name}"
    for name in ("targets.FEWEST_RUNS", "recorded_so_far.VARIED_RATIO", "recorded_so_far.OTHER_PRESSURE")
}
SEARCHED.add("physics.air_exchange.DEW_FALLS_K")
_SEARCHES: dict[Any, Any] = {}


@functools.cache
def _folder() -> Path:
    folder = tempfile.mkdtemp(prefix="sensitivity")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def numbers_in(room: str, module: str = "*") -> list[str]:
    """All constants of the modules of a room of the analysis that hold a number: `room.module.NAME`."""
    home, found = Path(diagnosing.__file__).parents[1], []
    for path in sorted((home / room).glob(f"{module}.py")):
        for line in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(line, ast.Assign) and any(isinstance(part, ast.Constant) for part in ast.walk(line.value)):
                names = [one.id for to in line.targets for one in ast.walk(to) if isinstance(one, ast.Name)]
                places = [f"{room}.{path.stem}.{name}" for name in names if name.isupper()]
                found += [place for place in places if scaled(number_of(place), 2.0) is not None]
    return found


PLANNED, EXPECTED_NATS = PlannedShock.__init__, decide_flight.expected_nats
FLYING = ("plan.decide_flight.", "plan.flight_plan.")  # whose numbers are of flights
NO_THRESHOLDS = ("EARTH_RADIUS_M", "RANGE_OVER_SIGMA")


def scaled(own: Any, factor: float) -> Any:
    """A number times a factor, a whole number as a whole one; each of several; None of what holds none."""
    if isinstance(own, bool) or not isinstance(own, (int, float, tuple, dict, np.ndarray)):
        return None
    if isinstance(own, float) and np.isnan(own):
        return None
    if isinstance(own, int):
        return max(round(own * factor), 1)
    if isinstance(own, (tuple, dict)):
        parts = [scaled(one, factor) for one in (own.values() if isinstance(own, dict) else own)]
        if not parts or any(one is None for one in parts):
            return None
        return tuple(parts) if isinstance(own, tuple) else dict(zip(own, parts, strict=True))
    return own * factor


def campaign(seed: int, hidden: Sequence[Hidden]) -> Campaign:
    """A campaign of a seed, recorded where it is not there yet."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, "rough", hidden)
    path = _folder() / f"{seed}-{hash(repr([*hidden]))}"
    if not path.exists():
        simulate_campaign(truth, standard_plan(), rng, path)
    return read_campaign(path)


def _hidden(seed: int) -> tuple[Campaign, dict[str, list[str]]]:
    """A campaign of a seed, and what is hidden in each channel."""
    drawn = draw_hidden(np.random.default_rng([seed, 1]), HIDDEN[seed % len(HIDDEN)])
    return campaign(seed, drawn), {name: sorted(h.effect for h in drawn if name in h.channels) for name in QUANTITIES}


def _diagnosed(found: Campaign, hidden: dict[str, list[str]], every_word: bool = False) -> list[Line]:
    """What is said of some channels: verdict and names, or all that is no bare figure."""
    input_, lines = checked(found), []
    for name in hidden:
        channel = build_channel(input_.campaign, name)
        if channel is not None:
            one = diagnose_channel(channel, findings=input_.findings)
            named = sorted(cause.effect for cause in one.causes)
            right = named == hidden[name] and one.verdict == ("explained" if hidden[name] else "adequate")
            said = [one.verdict, named, [form.behaves_as for form in one.discovered]]
            said += _further(one) if every_word else []
            lines.append({"right": right and not one.discovered, "said": said, "error": one.gain.after})
    return lines


def _further(one: ChannelDiagnosis) -> list[Any]:
    """What a diagnosis says besides its verdict and names, as far as it is no bare figure."""
    factors = [[on.factor for on in form.depends_on] for form in one.discovered]
    ties = [sorted(cause.indistinguishable_from) for cause in one.causes]
    asked = [{k: v for k, v in run.items() if k != "expected_evidence"} for run in next_experiments(one)]
    return [factors, ties, sorted(one.tried), sorted(one.predicting.model.ids), len(one.cannot_tell), asked]


def diagnosed(seed: int) -> list[Line]:
    """What is said of each channel of a campaign."""
    return _diagnosed(*_hidden(seed))


def whole(seed: int) -> list[Line]:
    """All that is said of each channel of a campaign."""
    return _diagnosed(*_hidden(seed), every_word=True)


def of_logger(seed: int) -> list[Line]:
    """What is said of a channel beside which a logger does something to its readings."""
    rng = np.random.default_rng([seed, 3])
    name = str(rng.choice([*QUANTITIES]))
    one = draw_effect(rng, OF_LOGGER[seed % len(OF_LOGGER)], "comfortable", name)
    return _diagnosed(campaign(seed, [one]), {name: [one.effect]})


def untimed(seed: int) -> list[Line]:
    """The same where the start of no transfer was recorded."""
    found, hidden = _hidden(seed)
    return _diagnosed(replace(found, runs=tuple(replace(run, start_s=None) for run in found.runs)), hidden)


def grown(seed: int) -> list[Line]:
    """What a planner thinks of each channel in the end, and after how many runs it made its diagnoses."""
    found, hidden = _hidden(seed)
    lines = []
    for name in QUANTITIES:
        verdict, made = Conclusion(), []
        for runs in LOOKS:
            part = checked(replace(found, runs=found.runs[:runs])).campaign
            verdict = look_at(part, name, verdict, final=runs is None).conclusion
            made.append(verdict.runs)
        right = sorted(verdict.named) == hidden[name] and not verdict.tied
        lines.append({"right": right, "said": [verdict.verdict, *sorted(verdict.causes), *verdict.tied, made]})
    return lines


def planned(seed: int) -> list[Line]:
    """The runs that a planner wants next after some runs of a campaign, or why it wants none."""
    found, _ = _hidden(seed)
    part = replace(found, runs=found.runs[:PLANNED_AFTER])
    wants = decide([part], parse_goals(GOALS), count=RUNS_PLANNED, made=_outcomes(part))
    asked = [choice.shock.as_run() for choice in wants.choices]
    return [{"right": wants.status == CONTINUE, "said": [wants.status, asked]}]


def _outcomes(found: Campaign) -> dict[str, ChannelOutcome]:
    """What a diagnosis says of each channel of a campaign, made once: no number of planning has a say in it."""
    key = found.path, len(found.runs)
    if key not in _SEARCHES:
        channels = (build_channel(checked(found).campaign, name) for name in QUANTITIES)
        judged = [one for one in channels if one is not None and one.runs >= FEWEST_JUDGED]
        _SEARCHES[key] = {one.name: outcome_of(diagnose_channel(one)) for one in judged}
    outcomes: dict[str, ChannelOutcome] = _SEARCHES[key]
    return outcomes


def flown(seed: int) -> list[Line]:
    """How flights rank that would tell apart two models of a thermometer."""
    rivals, sizes = RIVALS[seed % len(RIVALS)], [2.0 * float(np.log(share)) for share in AIR_AND_NOISE]
    models = [{"laws": laws, "values": values, "probability": 0.5} for laws, values in rivals]
    channel = {"verdict": "tied", "unit": 1.0, "sizes": sizes, "rivals": models}
    head = {"format": "shock-learned/1", "altitude_m": [490.0, 610.0], "home": [46.8, 6.9, 491.0], "minutes": 10.0}
    path = _folder() / "learned.json"
    path.write_text(json.dumps(head | {"channels": {"temperature": channel}}))
    limits = decide_flight.FlightLimits(decide_flight.LEGAL_CEILING_M, decide_flight.ENDURANCE_MINUTES)
    best, *others = ranked(read_learned(path), limits)
    said = [best.what, words(best.legs), advice(best), [one.what for one in others]]
    return [{"right": best.nats > 0.0, "said": said, "error": best.minutes / best.nats}]


def hums(seed: int) -> list[Line]:
    """What the plateaus of a thermometer's runs show."""
    rng = np.random.default_rng([seed, 2])
    hum_hz, size = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in (HUM_HZ, HUM_IN_NOISE))
    noise = draw_truth(np.random.default_rng(seed), "rough", ()).temperature_noise
    spread = float(np.hypot(noise.white, noise.correlated))
    numbers = {
        "amplitude": size * spread,
        "hum_hz": hum_hz,
        "burst_share": BURST_SHARE if seed % 4 == 0 else 0.0,
    }
    hidden = () if seed % 2 else (Hidden("unknown_interference", numbers, ("temperature",)),)
    channel = build_channel(checked(campaign(seed, hidden)).campaign, "temperature")
    assert channel is not None
    if seed % 4 == 3:
        walks = [WALK_IN_NOISE * spread * np.cumsum(rng.standard_normal(time.size)) for time, _ in channel.samples]
        samples = [(time, value + walk) for (time, value), walk in zip(channel.samples, walks, strict=True)]
        channel = rebin(channel, samples, channel.bin_of, channel.die_samples, 1)
    quiet, found = without_hums(channel)
    noise_left = estimate_noise(quiet, rounding_step(quiet) or channel.quantity.resolution)
    burst = bursts(quiet, noise_left, 0.0)
    periods = [one.period_s.value for one in found if one.period_s is not None]
    right = len(periods) == len(hidden) and all(abs(one * hum_hz - 1.0) < PERIOD_WITHIN for one in periods)
    right = right and (burst is not None) == bool(hidden and numbers["burst_share"])
    return [{"right": right, "said": [[round(one, 3) for one in periods], burst is not None]}]


KINDS: dict[str, Callable[[int], list[Line]]] = {
    "hidden": diagnosed,
    "logger": of_logger,
    "untimed": untimed,
    "grown": grown,
    "planned": planned,
    "flown": flown,
    "hums": hums,
    "whole": whole,
}


NUMBERS_OF["logger"] = [f"level:{name}" for name in ("average_gain", "average_unlikely", "hidden_noise")]
NUMBERS_OF["logger"] += numbers_in("estimate", "coarse_codes")
NUMBERS_OF["planned"] = [*numbers_in("design"), *(one for one in numbers_in("plan") if not one.startswith(FLYING))]
NUMBERS_OF["planned"].append("design.evidence.REJECTED_FROM")
NUMBERS_OF["flown"] = [one for one in numbers_in("plan") if one.startswith(FLYING) and not one.endswith(NO_THRESHOLDS)]


def changed(name: str, factor: float) -> Rule:
    """A number times a factor; where no search reads it, what the search of the same problem found is not sought
    anew."""
    instead = {name: scaled(number_of(name), factor)}
    room, *module = name.split(".")
    if not (room == "estimate" or (room == "diagnose" and module[0] in SEARCHING) or name in SEARCHED):
        instead["diagnose.diagnose.search"] = _remembered
    if name.startswith(FLYING):
        instead["plan.decide_flight.expected_nats"] = _remembered_nats
    if name == "design.menu.LEAD_S":  # what runs have of which nobody says it
        instead["design.menu.PlannedShock.__init__"] = functools.partialmethod(_begun, lead_s=instead[name])
    return Rule(name, "", instead)


def _begun(shock: PlannedShock, *args: Any, lead_s: float, **named: Any) -> None:
    given = {"lead_s": lead_s} if len(args) < [one.name for one in fields(PlannedShock)].index("lead_s") + 1 else {}
    PLANNED(shock, *args, **given | named)


def _remembered(problem: Any, base: Any, earlier: Any, describing: bool, plain_at: Any) -> Any:
    """A search, once for each campaign's channel as it is searched."""
    key = problem.channel.name, base.ids, describing, repr(earlier), problem.channel.value.tobytes()
    if key not in _SEARCHES:
        _SEARCHES[key] = search(problem, base, earlier, describing, plain_at)
    return _SEARCHES[key]


def _remembered_nats(bins: Any, channel: str, learned: Any, candidates: Any) -> float:
    """What a flight is expected to say, once for each flight."""
    key = pickle.dumps((bins, learned.channels[channel].rivals, len(candidates)))
    if key not in _SEARCHES:
        _SEARCHES[key] = EXPECTED_NATS(bins, channel, learned, candidates)
    return float(_SEARCHES[key])


def row(lines: list[Line], usual: dict[tuple[Any, ...], Line]) -> str:
    """How many of some lines are right, say something else than usual, and their error over the usual one."""
    pairs = [(one, usual[one["kind"], one["seed"], one["place"]]) for one in lines]
    others = sum(one["said"] != then["said"] for one, then in pairs)
    ratios = [one["error"] / then["error"] for one, then in pairs if one.get("error") and then.get("error")]
    error = f"{np.exp(np.mean(np.log(ratios))):8.4f}" if ratios else f"{'':8}"
    return f"{sum(one['right'] for one in lines):>5}/{len(lines):<4}{others:>6} {error}"


def shown(number: str) -> str:
    """A number's value, or how many it holds."""
    if number == AS_IT_IS:
        return ""
    own = number_of(number)
    return f"{own:g}" if isinstance(own, (int, float)) else f"{len(own)} of them"


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=[*KINDS], choices=[*KINDS])
    parser.add_argument("--numbers", nargs="+", help="(default: those that have a say in a kind)")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=47000)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()

    def score(number: str, factor: float, kind: str, seed: int) -> list[Line]:
        with without(None if number == AS_IT_IS else changed(number, factor)):
            found = KINDS[kind](seed)
        named = {"number": number, "factor": factor, "kind": kind, "seed": seed}
        return [named | {"place": place} | line for place, line in enumerate(found)]

    seeds = range(args.first, args.first + args.seeds)
    jobs = [
        (number, factor, kind, seed)
        for kind in args.kinds
        for number in (AS_IT_IS, *(args.numbers or NUMBERS_OF.get(kind) or numbers_in("diagnose")))
        for factor in ((1.0,) if number == AS_IT_IS else (0.5, 2.0))
        for seed in seeds
    ]
    lines = scored(args.out, jobs, ("number", "factor", "kind", "seed"), score)
    lines = [line for line in lines if tuple(line[name] for name in ("number", "factor", "kind", "seed")) in set(jobs)]
    usual = {(one["kind"], one["seed"], one["place"]): one for one in lines if one["number"] == AS_IT_IS}
    print(f"seeds {seeds.start} to {seeds.stop - 1}")
    print(f"{'number':<34}{'value':>10}{'times':>6}{'right':>7}{'':3}{'other':>6} {'error':>8}")
    for kind in args.kinds:
        print(kind)
        for number, factor in dict.fromkeys(job[:2] for job in jobs if job[2] == kind):
            own = [one for one in lines if (one["kind"], one["number"], one["factor"]) == (kind, number, factor)]
            print(f"{number:<34}{shown(number):>10}{factor:>6g}{row(own, usual)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
