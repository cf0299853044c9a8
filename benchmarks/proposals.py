"""Runs that a diagnosis proposes: recorded, and diagnosed again, do they name what is hidden, with nothing tied?

Poor starts, one effect hidden in each: four equal runs of the pairs of `loop_twins.py`, and every other run of a plan
at one airflow. What each proposal asks for, and what is said before and after, is a line.

    python benchmarks/proposals.py --twins 701 702 --airflow 3 4 5 6 7 8
    python benchmarks/proposals.py --twins 701 --numbers design.choose.LEAST_GAIN design.menu.LONG_S

With `--numbers` each of them is halved and doubled in turn (`sensitivity.py` says which there are): of how many worlds
other runs are asked for than with all numbers as they are, and what comes of them. Diagnoses do not read these numbers:
one of the same runs is made once.
"""

from __future__ import annotations

import argparse
import functools
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ablation_rules import without
from loop_bench import FileBench
from loop_twins import BOTH, PAIRS, RUNS_OF_START, START
from sensitivity import changed, shown

from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.diagnose.next_experiments import next_experiments
from shockrig.analysis.estimate.gather import build_channel
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import plan_from_runs, single_airflow_plan
from shockrig.rig.virtual.truth import ROUGH, draw_truth

T, RH = "temperature", "humidity"
OF_AIRFLOW = (("self_heating", T), ("convective_film", T), ("vapour_boundary_layer", RH))
Runs = Sequence[Mapping[str, Any]]
World = tuple[Callable[[int, int, Runs, Path], tuple[str, str]], int, int]


def twins(seed: int, pair: int, asked: Runs, folder: Path) -> tuple[str, str]:
    """Four equal runs, and those asked for; the effect and its channel."""
    channel, *both = PAIRS[pair]
    rng, hidden = np.random.default_rng([seed, pair]), both[seed % 2]
    truth = draw_truth(rng, ROUGH, [draw_effect(rng, hidden, "comfortable", None if hidden in BOTH else channel)])
    bench = FileBench(truth, folder / "c", 1000 * seed + pair)
    start = replace(START[channel], irradiance_w_m2=800.0 if "radiative_heating" in both else 0.0)
    for run in (*[start.as_run()] * RUNS_OF_START, *asked):
        bench.record_run(run)
    return hidden, channel


def one_airflow(seed: int, kind: int, asked: Runs, folder: Path) -> tuple[str, str]:
    """Every other run of a plan at one airflow, and those asked for; the effect and its channel."""
    effect, channel = OF_AIRFLOW[kind]
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, ROUGH, [draw_effect(rng, effect)])
    plan = [*single_airflow_plan()[::2], *plan_from_runs(asked, first=100)]
    simulate_campaign(truth, plan, np.random.default_rng([seed, len(asked)]), folder / "c")
    return effect, channel


@functools.cache
def said(world: World, asked: str = "[]") -> tuple[str, ChannelDiagnosis]:
    """What is hidden in a world, and the diagnosis of its channel once the runs `asked` (JSON) are recorded as well."""
    make, seed, which = world
    with tempfile.TemporaryDirectory() as folder:
        hidden, channel = make(seed, which, json.loads(asked), Path(folder))
        found = build_channel(checked(read_campaign(Path(folder) / "c")).campaign, channel)
    assert found is not None
    return hidden, diagnose_channel(found)


def counted(worlds: Sequence[World], number: str = "", factor: float = 1.0) -> tuple[dict[str, int], list[str]]:
    """What comes of what is asked for in some worlds, with a number times a factor, and what that is in each; without a
    number each is printed."""
    counts, every = dict.fromkeys(("worlds", "tied", "runs asked for", "right", "right and alone"), 0), []
    for world in worlds:
        hidden, before = said(world)
        with without(changed(number, factor) if number else None):
            asked = next_experiments(before)
        every.append(json.dumps([{k: v for k, v in run.items() if k != "expected_evidence"} for run in asked]))
        counts["worlds"] += 1
        if not asked:
            continue
        _, after = said(world, every[-1])
        named, then = ([cause.effect for cause in one.causes] for one in (before, after))
        alone = not after.search.rivals()
        if not number:
            why = ", ".join(dict.fromkeys(str(run["reason"]) for run in asked))
            went = f"{' '.join(named)}; {len(asked)} x {why}: {' '.join(then)}{'' if alone else ' (tied)'}"
            print(f"{hidden:35} {world[1]:4}  {went}", flush=True)
        counts["tied"] += 1
        counts["runs asked for"] += len(asked)
        counts["right"] += then == [hidden]
        counts["right and alone"] += then == [hidden] and alone
    return counts, every


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twins", type=int, nargs="*", default=[], help="seeds of pairs of look-alikes")
    parser.add_argument("--airflow", type=int, nargs="*", default=[], help="seeds of plans at one airflow")
    parser.add_argument("--numbers", nargs="*", default=[], help="numbers of design: room.module.NAME")
    parser.add_argument("--times", type=float, nargs="*", default=[0.5, 2.0])
    args = parser.parse_args(argv)
    worlds: list[World] = [
        *((twins, seed, pair) for seed in args.twins for pair in range(len(PAIRS))),
        *((one_airflow, seed, kind) for seed in args.airflow for kind in range(len(OF_AIRFLOW))),
    ]
    usual, every = counted(worlds)
    print(", ".join(f"{value} {name}" for name, value in usual.items()))
    if args.numbers:
        print(f"{'number':<40}{'value':>10}{'times':>6}{'other':>7}{'runs':>6}{'right':>7}{'alone':>7}")
    for number in args.numbers:
        for factor in args.times:
            counts, own = counted(worlds, number, factor)
            others = sum(one != then for one, then in zip(own, every, strict=True))
            those = (counts[name] for name in ("runs asked for", "right", "right and alone"))
            columns = "".join(f"{count:>{w}}" for count, w in zip((others, *those), (7, 6, 7, 7), strict=True))
            print(f"{number:<40}{shown(number):>10}{factor:>6g}{columns}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
