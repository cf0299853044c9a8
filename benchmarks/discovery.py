"""Descriptions of effects that nobody listed, against the truth: an entry of the catalogue is taken away and hidden.

    python benchmarks/discovery.py --kind one_out --seeds 2 --first-seed 100 [--effects stem_conduction,...]
    python benchmarks/discovery.py --kind none --seeds 10
    python benchmarks/discovery.py --kind two --seeds 4
    python benchmarks/discovery.py --kind both --seeds 1 --first-seed 100 --effects condensation
    python benchmarks/discovery.py --tables

Each trial appends one line to benchmarks/results/discovery.jsonl (one that is there already is not made again), with
the commit of the code that made it; `--tables` says what all lines there show. Kinds:
one_out (an entry taken away and hidden, or an effect from outside of the catalogue), none (plain worlds), two (two
catalogued effects, nothing taken away), both (the campaigns of one_out, both channels, for their time). Tolerances are
0: every significant remainder is material.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from discovery_film import EFFECT as FILM
from discovery_film import FilmTruth, draw_film, record_film
from discovery_right import BESIDE, RH, RIGHT, T, plan_for, unrecorded_plan
from discovery_tables import tables

if TYPE_CHECKING:
    from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
    from shockrig.analysis.estimate.channel import Channel
    from shockrig.files.campaign import Campaign
    from shockrig.rig.virtual.truth import Truth

RESULTS = Path(__file__).parent / "results" / "discovery.jsonl"
FRESH = 1_000_000
# Airflows [m/s] and further ambients [degC] that no standard campaign records: within what it does, and beyond.
BETWEEN, BEYOND = ((4.0, 8.5), (5.0, 25.0)), ((1.5, 18.0), (-8.0, 48.0))


@cache
def commit() -> str:
    """The commit of the code that runs: the one when it began."""
    return subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()


@lru_cache(maxsize=1)
def world(kind: str, effect: str, channel: str, seed: int, tier: str) -> tuple[Truth | FilmTruth, Campaign]:
    """A world with its hidden effects, and a campaign in it."""
    from shockrig.rig.virtual.hide import draw_effect, draw_hidden
    from shockrig.rig.virtual.truth import draw_truth

    rng = np.random.default_rng(seed)
    if effect == FILM:
        film = draw_film(rng)
        return film, recorded(film, plan_for(effect), rng)
    hidden = [draw_effect(rng, effect, "comfortable", channel)] if kind == "one_out" else []
    hidden += [draw_effect(rng, other, "comfortable") for other in BESIDE.get(effect, ())]
    if kind == "two":
        hidden = draw_hidden(rng, 2)
    truth = draw_truth(rng, tier, hidden)
    return truth, recorded(truth, plan_for(effect), rng)


def recorded(truth: Truth | FilmTruth, plan: list, rng_or_seed: np.random.Generator | int) -> Campaign:
    """A campaign by a plan in a world."""
    from shockrig.files.campaign import read_campaign
    from shockrig.rig.virtual.batch import simulate_campaign

    with tempfile.TemporaryDirectory() as folder:
        record = record_film if isinstance(truth, FilmTruth) else simulate_campaign
        return read_campaign(record(truth, plan, rng_or_seed, Path(folder) / "campaign"))


def both(effect: str, channel: str, seed: int, tier: str) -> dict:
    """Diagnose both channels of a world without the hidden effect's entry: how long each takes."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.estimate.gather import build_channel

    _, campaign = world("one_out", effect, channel, seed, tier)
    seconds, verdicts = {}, {}
    with without(effect):
        for name in (T, RH):
            began = time.process_time()
            verdicts[name] = diagnose_channel(build_channel(campaign, name), tolerance=Tolerance(0.0, 0.0)).verdict
            seconds[name] = round(time.process_time() - began, 1)
    known = {"kind": "both", "effect": effect, "channel": channel, "seed": seed, "tier": tier}
    return {"commit": commit(), **known, "verdicts": verdicts, "seconds": seconds}


@contextmanager
def without(effect: str) -> Iterator[None]:
    """The catalogue without an entry, where it has it."""
    from shockrig.analysis.effects import CATALOGUE

    order = dict(CATALOGUE)
    try:
        CATALOGUE.pop(effect, None)
        yield
    finally:
        CATALOGUE.clear()
        CATALOGUE.update(order)


def run(kind: str, effect: str, channel: str, seed: int, tier: str) -> dict:
    """Record a world, diagnose a channel of it without the hidden effect's entry, and score the description."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.discovered import plain

    truth, campaign = world(kind, effect, channel if kind == "one_out" else "", seed, tier)
    data, plan = build_channel(campaign, channel), plan_for(effect)
    began = time.process_time()
    with without(effect if kind == "one_out" else ""):
        found = diagnose_channel(data, tolerance=Tolerance(0.0, 0.0))
    seconds = time.process_time() - began
    fresh, elsewhere = None, []
    if kind == "one_out" and found.discovered and found.final.structure.effects:

        def again(plan: list, place: int) -> Channel | None:
            return build_channel(recorded(truth, plan, seed + place * FRESH), channel)

        fresh = fresh_gain(again(plan, 1), found)
        for place, (airflows, more) in enumerate((BETWEEN, BEYOND), 2):
            # A rate of the film is known at the ambients recorded, that of the bead at all.
            elsewhere.append(errors(again(unrecorded_plan(airflows, more if channel == T else ()), place), found))
    return {
        "commit": commit(),
        "kind": kind,
        "effect": effect,
        "channel": channel,
        "seed": seed,
        "tier": tier,
        "hidden": {h.effect: h.parameters for h in truth.effects if channel in h.channels},
        "verdict": found.verdict,
        "causes": [cause.effect for cause in found.causes],
        "certainty": {c.effect: [round(c.probability, 3), *c.indistinguishable_from] for c in found.causes},
        "discovered": [plain(one) for one in found.discovered],
        "held_out": [found.gain.before, found.gain.after, found.gain.noise_floor],
        "fresh_share": fresh,
        "elsewhere": elsewhere,
        "seconds": round(seconds, 1),
    }


def fresh_gain(channel: Channel | None, found: ChannelDiagnosis) -> float | None:
    """Share of the explainable error that the description, as fitted, removes on a fresh campaign of the same world."""
    from shockrig.analysis.diagnose.gain import kinds, summarise
    from shockrig.analysis.diagnose.held_out import plainly, run_errors
    from shockrig.analysis.diagnose.prepare import prepare

    if channel is None or channel.rates != found.problem.channel.rates:
        return None
    problem = prepare(channel, found.noise.averaged).problem
    before = run_errors(channel, problem, plainly(found.plain))
    after = run_errors(channel, problem, found.predicting.fit)
    return summarise(before, after, found.noise.standard_deviation, kinds(channel)).explained_fraction


def errors(channel: Channel | None, found: ChannelDiagnosis) -> tuple[float, float] | None:
    """Root-mean-square error on a campaign without and with what was described."""
    from shockrig.analysis.diagnose.held_out import run_errors
    from shockrig.analysis.diagnose.prepare import prepare

    if channel is None or channel.rates != found.problem.channel.rates:
        return None
    problem = prepare(channel, found.noise.averaged).problem
    fits = (found.plain, found.predicting.fit)
    return tuple(float(np.sqrt(run_errors(channel, problem, one).mean())) for one in fits)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", choices=("one_out", "none", "two", "both"), default="one_out")
    parser.add_argument("--effects", default="", help="ids, comma separated; all that can be scored if left out")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--tier", choices=("smooth", "rough"), default="rough")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--tables", action="store_true", help="only say what is recorded")
    args = parser.parse_args(argv)
    if args.tables:
        lines = [json.loads(line) for line in args.results.read_text(encoding="utf-8").splitlines()]
        print(tables(lines))
        return 0
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    wanted = [e for e in args.effects.split(",") if e]
    pairs = [pair for pair in RIGHT if not wanted or pair[0] in wanted]
    if args.kind in ("none", "two"):
        pairs = [("", T), ("", RH)]
    done = set()
    if args.results.exists():
        told = map(json.loads, args.results.read_text(encoding="utf-8").splitlines())
        done = {tuple(r[k] for k in ("kind", "effect", "channel", "seed", "tier")) for r in told}
    commit()
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        for effect, channel in pairs:
            if (args.kind, effect, channel, seed, args.tier) in done:
                continue
            if args.kind == "both":
                result = both(effect, channel, seed, args.tier)
            else:
                result = run(args.kind, effect, channel, seed, args.tier)
            with args.results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(result) + "\n")
            if args.kind == "both":
                print(seed, effect, channel, result["verdicts"], result["seconds"], flush=True)
                continue
            said = [
                (d["behaves_as"], d["driver"], [on["factor"] for on in d["depends_on"]]) for d in result["discovered"]
            ]
            print(
                seed,
                effect,
                channel,
                result["verdict"],
                result["causes"],
                said,
                f"{result['seconds']:.0f} s",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
