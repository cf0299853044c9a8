"""Logs of which nobody recorded the start or the airs, in air that is steady, drifts or settles: what is said of them.

    python benchmarks/drifting_airs.py [--first-seed S] [--worlds N]

A lag of 30 to 300 s between two airs, two to six runs, to and fro; readings each 1 to 10 s, noise of 0.02 K; two in
five worlds begin with the change. By turns (seed modulo 4): `steady` air; air that `drifts` evenly by 6 % of the step
(one standard deviation, each run its own); a `second part` of the sensor beside steady air, of 5 to 30 % and four to
nine times as slow; air that `settles` by as much, in 0.3 to 1 of the record. Air is followed on 6,000 steps of a
record, exactly from step to step. A name is wrong where the sensor has no second part, or it is another one than
`parallel_lag`.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

KINDS = ("steady", "drifts", "second part", "settles")
NOISE_K = 0.02
DRIFT_SHARE = 0.06
STEPS = 6000


@dataclass(frozen=True)
class World:
    """What was simulated: kind, time constant [s], share and time constant [s] of a second part, and each run's log as
    times [s] and readings [degC]."""

    kind: str
    tau_s: float
    share: float
    slow_s: float
    logs: tuple[tuple[Array, Array], ...]


def world(seed: int) -> World:
    """The world of one seed."""
    rng, kind = np.random.default_rng([77, seed]), KINDS[seed % len(KINDS)]
    runs, tau_s = int(rng.integers(2, 7)), float(np.exp(rng.uniform(np.log(30.0), np.log(300.0))))
    period_s, lasts_s = float(rng.choice([1.0, 2.0, 5.0, 10.0])), tau_s * rng.uniform(6.0, 14.0)
    share, slow_s = (rng.uniform(0.05, 0.3), tau_s * rng.uniform(4.0, 9.0)) if kind == "second part" else (0.0, 1.0)
    begun = rng.random() < 0.4
    since, logs = np.linspace(0.0, lasts_s, STEPS), []
    for k in range(runs):
        cold, warm = rng.normal(5.0, 1.0), rng.normal(40.0, 2.0)
        source, destination = (cold, warm) if k % 2 else (warm, cold)
        t = np.arange(0.0 if begun else -3.0 * tau_s, lasts_s, period_s)
        starts_s, drift = rng.uniform(0.0, period_s), DRIFT_SHARE * rng.standard_normal() * (destination - source)
        air = np.full(STEPS, destination)
        if kind == "drifts":
            air += drift * since / lasts_s
        if kind == "settles":
            air -= drift * np.expm1(-since / (lasts_s * rng.uniform(0.3, 1.0)))
        shown = (1.0 - share) * follow(air, source, tau_s, since[1])
        shown += share * follow(air, source, slow_s, since[1]) if share else 0.0
        value = np.where(t < starts_s, source, np.interp(t - starts_s, since, shown))
        logs.append((t - t[0], np.round(value + NOISE_K * rng.standard_normal(t.size), 3)))
    return World(kind, tau_s, share, slow_s, tuple(logs))


def follow(air: Array, source: float, tau_s: float, step_s: float) -> Array:
    """What a lag shows of air that holds each value for a step, from a source that it had settled to."""
    kept, shown, now = np.exp(-step_s / tau_s), np.empty(air.size), source
    for i, value in enumerate(air):
        shown[i] = now
        now = value + (now - value) * kept
    return shown


def judge(one: World) -> tuple[str, list[str], float, float]:
    """Verdict, what is named, the time constant over the true one, and seconds of the processor."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import Campaign, Run, RunAir, Trace

    unknown = RunAir(None, None)
    runs = tuple(
        Run(str(k), unknown, unknown, None, 1000.0, None, None, Trace(t, {"temperature_c": y}), None)
        for k, (t, y) in enumerate(one.logs)
    )
    channel = build_channel(
        Campaign("log", None, {}, 4e-4, 1e-5, runs, bodies={"imet": "lumped", "hyt": "film"}), "temperature"
    )
    assert channel is not None
    began = time.process_time()
    found = diagnose_channel(channel)
    spent = time.process_time() - began
    names = [cause.effect for cause in found.causes] + [f"form {one.behaves_as}" for one in found.discovered]
    return found.verdict, names, float(np.exp(-found.final.log_rates[0]) / one.tau_s), spent


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=60)
    args = parser.parse_args(argv)
    said: dict[str, list[tuple[str, bool, bool, float, float]]] = {kind: [] for kind in KINDS}
    for seed in range(args.first_seed, args.first_seed + args.worlds):
        one = world(seed)
        verdict, names, ratio, spent = judge(one)
        right = [name for name in names if one.share and name == "parallel_lag"]
        said[one.kind].append((verdict, len(names) > len(right), bool(right), ratio, spent))
        print(f"{seed} {one.kind}, {len(one.logs)} runs, {one.tau_s:.0f} s: {verdict} {names} {ratio:.3f}", flush=True)
    heads = ("worlds", "adequate", "explained", "wrong name", "found", "off by", "s")
    print(" " * 14 + "".join(f"{head:>12s}" for head in heads))
    for kind, rows in said.items():
        if rows:
            verdicts, wrong, right, ratios, spent = zip(*rows, strict=True)
            off = np.median(np.abs(np.log(ratios)))
            counts = (len(rows), verdicts.count("adequate"), verdicts.count("explained"), sum(wrong), sum(right))
            print(f"{kind:14s}{''.join(f'{n:12d}' for n in counts)}{off:12.4f}{np.median(spent):12.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
