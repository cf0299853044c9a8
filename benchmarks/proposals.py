"""Runs that a diagnosis proposes: recorded, and diagnosed again, do they name what is hidden, with nothing tied?

Poor starts, one effect hidden in each: four equal runs of the pairs of `loop_twins.py`, and every other run of a plan
at one airflow. What each proposal asks for, and what is said before and after, is a line.

    python benchmarks/proposals.py --twins 701 702 --airflow 3 4 5 6 7 8
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from loop_bench import FileBench
from loop_twins import BOTH, PAIRS, RUNS_OF_START, START

from shockrig.analysis.checks.campaign_checks import checked
from shockrig.analysis.diagnose.diagnose import diagnose_channel, next_experiments
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.estimate.gather import build_channel
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import plan_from_runs, single_airflow_plan
from shockrig.rig.virtual.truth import ROUGH, draw_truth

T, RH = "temperature", "humidity"
OF_AIRFLOW = (("self_heating", T), ("convective_film", T), ("vapour_boundary_layer", RH))
Runs = Sequence[Mapping[str, Any]]


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


def said(folder: Path, channel: str) -> ChannelDiagnosis:
    """The diagnosis of a channel."""
    found = build_channel(checked(read_campaign(folder / "c")).campaign, channel)
    assert found is not None
    return diagnose_channel(found)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twins", type=int, nargs="*", default=[], help="seeds of pairs of look-alikes")
    parser.add_argument("--airflow", type=int, nargs="*", default=[], help="seeds of plans at one airflow")
    args = parser.parse_args(argv)
    worlds: Iterable[tuple[Any, int, int]] = [
        *((twins, seed, pair) for seed in args.twins for pair in range(len(PAIRS))),
        *((one_airflow, seed, kind) for seed in args.airflow for kind in range(len(OF_AIRFLOW))),
    ]
    counts = dict.fromkeys(("worlds", "tied", "runs asked for", "right", "right and alone"), 0)
    for make, seed, which in worlds:
        with tempfile.TemporaryDirectory() as folder:
            hidden, channel = make(seed, which, (), Path(folder))
            before = said(Path(folder), channel)
        asked = next_experiments(before)
        counts["worlds"] += 1
        if not asked:
            continue
        with tempfile.TemporaryDirectory() as folder:
            make(seed, which, asked, Path(folder))
            after = said(Path(folder), channel)
        named, then = ([cause.effect for cause in one.causes] for one in (before, after))
        alone = not after.search.rivals()
        why = ", ".join(dict.fromkeys(str(run["reason"]) for run in asked))
        went = f"{' '.join(named)}; {len(asked)} x {why}: {' '.join(then)}{'' if alone else ' (tied)'}"
        print(f"{hidden:35} {seed:4}  {went}")
        counts["tied"] += 1
        counts["runs asked for"] += len(asked)
        counts["right"] += then == [hidden]
        counts["right and alone"] += then == [hidden] and alone
    print(", ".join(f"{value} {name}" for name, value in counts.items()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
