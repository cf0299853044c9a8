"""The same 40 virtual campaigns through two states of the project, side by side: what a rebuilding changed.

    python benchmarks/same_numbers.py --work /tmp/same --old OLD_ENV/bin/shockrig --new NEW_ENV/bin/shockrig

runs `characterize` and `diagnose` of both commands on each campaign, prints what they say, and sums up the differences
in units of the old standard uncertainty. What is done is kept in the work folder, a JSON line for each campaign and
command, so that it can be stopped, resumed, and run for one of the two alone.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

CHANNELS = ("temperature", "humidity")
REFERENCE_C = 20.0  # where D is compared
ORDINARY = ("convective_film", "finite_transfer", "stem_conduction", "die_thermal_lag")
MIX = (  # campaigns, what is hidden, tier
    (12, "none", "rough"),
    (16, 1, "rough"),
    (6, 2, "rough"),
    (3, ORDINARY, "rough"),
    (3, 1, "smooth"),
)
FIRST_SEED = 41000
ZERO_TOLERANCE = ("--tolerance-k", "0", "--tolerance-percent", "0")  # for the commands that have one: name everything


@dataclass(frozen=True)
class Trial:
    """One campaign: its seed, what is hidden in it (as the draw takes it), and the bench's tier."""

    seed: int
    which: str | int | tuple[str, ...]
    tier: str

    @property
    def label(self) -> str:
        return "ordinary" if isinstance(self.which, tuple) else str(self.which)


@dataclass(frozen=True)
class Difference:
    """How far a number of the new command is from the old one's, in the old standard uncertainties."""

    name: str
    old: float
    new: float
    in_u: float


def trials() -> list[Trial]:
    kinds = [(which, tier) for count, which, tier in MIX for _ in range(count)]
    return [Trial(FIRST_SEED + i, which, tier) for i, (which, tier) in enumerate(kinds)]


def simulated(trial: Trial, work: Path) -> tuple[Path, dict[str, list[str]]]:
    """The trial's campaign folder, made where it is not there yet, and the effects hidden in each channel."""
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.hide import draw_hidden
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import draw_truth

    rng = np.random.default_rng(trial.seed)
    truth = draw_truth(rng, trial.tier, draw_hidden(rng, trial.which))
    path = work / "campaigns" / str(trial.seed)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        simulate_campaign(truth, standard_plan(), rng, path)
    hidden = {name: sorted(h.effect for h in truth.effects if name in h.channels) for name in CHANNELS}
    return path, hidden


def measured(command: Path, campaign: Path, out: Path) -> dict[str, Any]:
    """What `command` finds in a campaign, and the processor seconds that it takes."""
    shutil.rmtree(out, ignore_errors=True)
    takes = subprocess.run([command, "diagnose", "--help"], capture_output=True, text=True, check=True).stdout
    options = ZERO_TOLERANCE if ZERO_TOLERANCE[0] in takes else ()
    seconds = {
        "characterize": _run(command, "characterize", campaign, "--out", out / "plain"),
        "diagnose": _run(command, "diagnose", campaign, "--out", out / "diagnosis", *options),
    }
    diagnosis = json.loads((out / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    found = {
        "seconds": seconds,
        "plain": material(json.loads((out / "plain" / "profile.json").read_text(encoding="utf-8"))),
        "extended": material(json.loads((out / "diagnosis" / "profile.json").read_text(encoding="utf-8"))),
        "channels": {name: _found(channel) for name, channel in diagnosis["channels"].items()},
    }
    shutil.rmtree(out)
    return found


def _run(command: Path, *arguments: str | Path) -> float:
    """Processor seconds of one call with its workers. Raises SystemExit where it fails, with its last line."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = os.times()
    done = subprocess.run([command, *map(str, arguments)], capture_output=True, text=True, env=environment)
    after = os.times()
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise SystemExit(f"{command} {arguments[0]} {arguments[1]}: status {done.returncode}: {last[0]}")
    return after.children_user - before.children_user + after.children_system - before.children_system


def material(profile: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Of each channel in a profile: alpha, or D at the ambient nearest to 20 degC, and its standard uncertainty."""
    found = {}
    if "temperature" in profile:
        alpha = profile["temperature"]["thermal_diffusivity_m2_s"]
        found["temperature"] = alpha["value"], alpha["standard_uncertainty"]
    if "humidity" in profile:
        table = profile["humidity"]["diffusivity_table"]
        row = min(table, key=lambda row: abs(row["ambient_temperature_c"] - REFERENCE_C))
        found["humidity"] = row["diffusivity_m2_s"], row["standard_uncertainty"]
    return found


def _found(channel: dict[str, Any]) -> dict[str, Any]:
    gain = channel["gain"]
    return {
        "verdict": channel["verdict"],
        "causes": {
            cause["effect"]: {
                name: (value["value"], value["standard_uncertainty"]) for name, value in cause["parameters"].items()
            }
            for cause in channel["causes"]
        },
        "gain": None if gain is None else gain["explained_fraction"],
    }


def cached(name: str, command: Path | None, work: Path, chosen: list[Trial]) -> dict[int, dict[str, Any]]:
    """The results of one side by seed: those in the work folder, and with a command those that are missing there."""
    kept = work / f"{name}.jsonl"
    results: dict[int, dict[str, Any]] = {}
    if kept.exists():
        results = {line["seed"]: line for line in map(json.loads, kept.read_text(encoding="utf-8").splitlines())}
    for trial in chosen if command is not None else ():
        if trial.seed in results:
            continue
        campaign, hidden = simulated(trial, work)
        result = {"seed": trial.seed, "hidden": hidden, **measured(command, campaign, work / f"{name}_{trial.seed}")}
        results[trial.seed] = result
        with kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")
        print(f"{name} {trial.seed} {sum(result['seconds'].values()):.0f} s", file=sys.stderr, flush=True)
    return results


def differences(old: dict[str, Any], new: dict[str, Any], channel: str) -> Iterator[Difference]:
    """The numbers that both sides state of one channel: the material's, and the parameters of causes named by both."""
    pairs = [(stage, old[stage].get(channel), new[stage].get(channel)) for stage in ("plain", "extended")]
    if set(old["channels"][channel]["causes"]) != set(new["channels"][channel]["causes"]):
        pairs = pairs[:1]  # the extended ones are of two different models
    for effect, parameters in old["channels"][channel]["causes"].items():
        other = new["channels"][channel]["causes"].get(effect, {})
        pairs += [(f"{effect}.{name}", value, other.get(name)) for name, value in parameters.items()]
    for name, before, after in pairs:
        if before is None or after is None:
            continue
        step = after[0] - before[0]
        yield Difference(name, before[0], after[0], 0.0 if step == 0.0 else step / before[1] if before[1] else np.inf)


def line(trial: Trial, channel: str, old: dict[str, Any], new: dict[str, Any]) -> str:
    """One channel of one campaign: the plain number of both, verdict, causes and gain of both, processor time."""
    plain = next(differences(old, new, channel), None)
    numbers = "-" if plain is None else f"{plain.old:.5g} {plain.new:.5g} {plain.in_u:+.4f} u"
    sides = []
    for side in (old, new):
        found = side["channels"][channel]
        gain = "-" if found["gain"] is None else f"{found['gain']:.4f}"
        sides.append(f"{found['verdict']} [{', '.join(sorted(found['causes'])) or '-'}] {gain}")
    said = f"both {sides[0]}" if sides[0] == sides[1] else f"old {sides[0]} | new {sides[1]}"
    spent = " ".join(f"{sum(side['seconds'].values()):.0f}" for side in (old, new))
    return f"{trial.seed} {trial.label:8} {trial.tier:6} {channel[:4]} {numbers:36} {said}  {spent} s"


def summary(chosen: list[Trial], old: dict[int, dict[str, Any]], new: dict[int, dict[str, Any]]) -> str:
    """The differences over all campaigns, and every channel whose verdict or causes differ, with what was hidden."""
    by_kind: dict[str, list[tuple[Difference, int]]] = {"plain": [], "extended": [], "causes' parameters": []}
    gains: list[float] = []
    changed: dict[str, list[str]] = {"verdict": [], "causes": []}
    channels = 0
    for seed in (trial.seed for trial in chosen):
        for name in old[seed]["channels"]:
            if name not in new[seed]["channels"]:
                continue
            channels += 1
            before, after = old[seed]["channels"][name], new[seed]["channels"][name]
            for step in differences(old[seed], new[seed], name):
                by_kind.get(step.name, by_kind["causes' parameters"]).append((step, seed))
            if before["gain"] is not None and after["gain"] is not None:
                gains.append(abs(after["gain"] - before["gain"]))
            for key, what in (("verdict", str), ("causes", sorted)):
                if what(before[key]) != what(after[key]):
                    changed[key].append(
                        f"    {seed} {name}: old {what(before[key])}, new {what(after[key])},"
                        f" hidden {old[seed]['hidden'][name] or 'nothing'}"
                    )
    lines = [f"{len(chosen)} campaigns, {channels} channels, seeds {chosen[0].seed} to {chosen[-1].seed}"]
    for kind, steps in by_kind.items():
        if steps:
            largest, seed = max(steps, key=lambda step: abs(step[0].in_u))
            median = np.median([abs(step.in_u) for step, _ in steps])
            lines.append(
                f"  {kind:20} {len(steps):4} numbers: median difference {median:.2g} u,"
                f" largest {abs(largest.in_u):.2g} u ({largest.name} of {seed})"
            )
    if gains:
        lines.append(
            f"  gain                 {len(gains):4} numbers: median {np.median(gains):.2g}, largest {max(gains):.2g}"
        )
    for key, cases in changed.items():
        lines += [f"  another {key:12} {len(cases):4} of {channels}", *cases]
    for stage in ("characterize", "diagnose"):
        spent = [np.array([side[trial.seed]["seconds"][stage] for trial in chosen]) for side in (old, new)]
        lines.append(
            f"  {stage:20} {spent[0].mean():.1f} s of processor a campaign before, {spent[1].mean():.1f} s now:"
            f" ratio {spent[0].sum() / spent[1].sum():.2f}; longest {spent[0].max():.1f} s and {spent[1].max():.1f} s"
        )
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--old", type=Path, metavar="SHOCKRIG", help="the command of the old state; without: what is kept"
    )
    parser.add_argument(
        "--new", type=Path, metavar="SHOCKRIG", help="the command of the new state; without: what is kept"
    )
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="where campaigns and results are kept")
    parser.add_argument("--seeds", type=int, nargs="+", metavar="SEED", help="only these campaigns")
    args = parser.parse_args(argv)
    args.work.mkdir(parents=True, exist_ok=True)
    chosen = [trial for trial in trials() if args.seeds is None or trial.seed in args.seeds]
    old, new = (cached(name, command, args.work, chosen) for name, command in (("old", args.old), ("new", args.new)))
    both = [trial for trial in chosen if trial.seed in old and trial.seed in new]
    if not both:
        print("no campaign has been through both commands yet")
        return 0
    print(
        "seed, hidden, tier, channel, alpha or D at 20 degC: old, new, difference; diagnosis; processor time: old, new"
    )
    for trial in both:
        for name in old[trial.seed]["channels"]:
            if name in new[trial.seed]["channels"]:
                print(line(trial, name, old[trial.seed], new[trial.seed]))
    print(summary(both, old, new))
    return 0


if __name__ == "__main__":
    sys.exit(main())
