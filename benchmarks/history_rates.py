"""How often a history says that something changed which has not, and how soon a change of D by 2 % is seen.

    python benchmarks/history_rates.py [--worlds 4] [--campaigns 16] [--first-seed 62000] [--out FILE]

In each rough world one sensor is recorded many times, with its D as it is and with its D 2 % higher. Each campaign's
figures go to --out once (JSON lines); histories are then drawn from them without putting back: 12 campaigns of the
unchanged sensor looked at after every one, and 6 of the unchanged one followed by two of the changed one.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from shockrig.analysis.characterize.budget import budgets, diffusivity_at, mean_diffusivity
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.history import Observation, chart, observed
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth

HIGHER = 1.02
FIGURES = ("alpha", "D", "mean D", "t63")
FILM = ("D", "mean D")
BEAD = ("alpha",)
DRAWS = 500
LONG, BEFORE = 12, 6
REPLICATES, EACH = 40, 800  # histories of each: with 100, one alarm by chance would be an upper end of 1 %
ALONG = 50  # histories for each of them that are looked at after every campaign


def recorded(seed: int, number: int, factor: float) -> dict[str, object]:
    """The figures of one campaign of a world's sensor, its D times `factor`."""
    truth = draw_truth(np.random.default_rng(seed), "rough")
    truth = replace(truth, diffusivity_20c_m2_s=truth.diffusivity_20c_m2_s * factor)
    rng = np.random.default_rng([seed, number, round(1000 * factor)])
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan(), rng, Path(folder) / "c"))
    result = characterize(campaign, number)
    alpha, t63, _ = budgets(result.temperature)
    film = result.humidity
    made = {"alpha": alpha, "t63": t63, "D": diffusivity_at(film, 20.0), "mean D": mean_diffusivity(film)[0]}
    own = {name: asdict(observed(budget, f"{number:03d}", "", "same")) for name, budget in made.items()}
    return {"seed": seed, "number": number, "factor": factor, "figures": own}


def of(line: dict, figure: str) -> Observation:
    """One figure of a line."""
    return Observation(**line["figures"][figure])


def scaled(line: dict, factor: float) -> dict:
    """A campaign with its estimates of alpha multiplied."""
    alpha = line["figures"]["alpha"]
    return {**line, "figures": {**line["figures"], "alpha": {**alpha, "value": factor * alpha["value"]}}}


def changed(lines: list[dict], figures: tuple[str, ...] = FIGURES) -> dict[str, tuple[int, ...]]:
    """Figure -> places at which a history says that it changed."""
    return {
        name: tuple(change.first for change in chart(name, "", "", [of(line, name) for line in lines]).changes)
        for name in figures
    }


def rates(lines: list[dict], rng: np.random.Generator) -> str:
    """The table, from all campaigns that are there."""
    alarms = whole = ever = seen_one = seen_two = right_place = trials = of_alpha = 0
    z = []
    for seed in sorted({line["seed"] for line in lines}):
        same = [line for line in lines if line["seed"] == seed and line["factor"] == 1.0]
        other = [line for line in lines if line["seed"] == seed and line["factor"] != 1.0]
        for name in ("alpha", "D", "mean D"):
            logs = np.log([of(line, name).value for line in same])
            own = (logs - logs.mean()) / [of(line, name).random for line in same]
            z += (own * np.sqrt(len(same) / (len(same) - 1))).tolist()
        for _ in range(DRAWS):
            order = rng.permutation(len(same))
            history = [same[i] for i in order[:LONG]]
            alarm = any(changed(history).values())
            alarms, whole = alarms + alarm, whole + 1
            ever += alarm or any(any(changed(history[:n]).values()) for n in range(2, LONG))
            later = [other[i] for i in rng.permutation(len(other))[:2]]
            one = changed([*history[:BEFORE], later[0]], FILM)
            two = changed([*history[:BEFORE], *later], FILM)
            seen_one, seen_two = seen_one + any(one.values()), seen_two + (any(one.values()) or any(two.values()))
            slower = [scaled(one, HIGHER) for one in history[BEFORE : BEFORE + 2]]
            of_alpha += any(changed([*history[:BEFORE], *slower[:n]], BEAD)["alpha"] for n in (1, 2))
            places = {place for found in (one, two) for each in found.values() for place in each}
            right_place, trials = right_place + (BEFORE in places), trials + 1
    worlds = len({line["seed"] for line in lines})
    return "\n".join(
        [
            f"{worlds} rough worlds, {len(lines)} campaigns, {DRAWS} histories drawn from each world's",
            f"campaign to campaign, in its stated uncertainty: rms {np.sqrt(np.mean(np.square(z))):.2f} of {len(z)}",
            f"unchanged, {LONG} campaigns: something said to have changed in {100 * alarms / whole:.2f} % of histories",
            f"unchanged, looked at after every one of {LONG}: ever, in {100 * ever / whole:.2f} %",
            f"D 2 % higher after {BEFORE}: seen with the first campaign in {100 * seen_one / trials:.1f} %, "
            f"within two in {100 * seen_two / trials:.1f} %, at the right place in {100 * right_place / trials:.1f} %",
            f"alpha's estimates 2 % higher after {BEFORE}: seen within two in {100 * of_alpha / trials:.1f} %",
        ]
    )


def pooled(lines: list[dict], rng: np.random.Generator) -> str:
    """False alarms in histories put together from the campaigns of all worlds, each as far off its own world's mean as
    it was, with the interval that a bootstrap over campaigns gives."""
    pool: list[dict[str, Observation]] = []
    for seed in sorted({line["seed"] for line in lines}):
        same = [line for line in lines if line["seed"] == seed and line["factor"] == 1.0]
        inflate = np.sqrt(len(same) / (len(same) - 1))
        means = {name: np.mean([np.log(of(line, name).value) for line in same]) for name in FIGURES}
        for line in same:
            off = {name: inflate * (np.log(of(line, name).value) - means[name]) for name in FIGURES}
            pool.append({name: replace(of(line, name), value=float(np.exp(off[name]))) for name in FIGURES})
    ever = 0
    for _ in range(REPLICATES * ALONG):
        history = [pool[i] for i in rng.permutation(len(pool))[:LONG]]
        looks = ([one[name] for one in history[:n]] for n in range(2, LONG + 1) for name in FIGURES)
        ever += any(chart("", "", "", look).changes for look in looks)
    along, count = 100.0 * ever / (REPLICATES * ALONG), REPLICATES * ALONG
    found = []
    for _ in range(REPLICATES):
        some = rng.integers(len(pool), size=len(pool))
        alarms = 0
        for _ in range(EACH):
            history = [pool[some[i]] for i in rng.integers(len(some), size=LONG)]
            alarms += any(chart(name, "", "", [one[name] for one in history]).changes for name in FIGURES)
        found.append(alarms / EACH)
    low, high = 100 * np.quantile(found, [0.025, 0.975])
    return (
        f"unchanged, {LONG} campaigns drawn from the {len(pool)} of all worlds, looked at after every one: ever, in "
        f"{along:.2f} % of {count}\n"
        f"unchanged, {LONG} campaigns drawn from the {len(pool)} of all worlds: something said to have changed in "
        f"{100 * np.mean(found):.2f} % (95 % of {REPLICATES} draws of the campaigns: {low:.2f} to {high:.2f} %)"
    )


def main(argv: list[str] | None = None) -> None:
    """Record what is missing, append it, print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--campaigns", type=int, default=16, help="of the unchanged sensor; a quarter as many changed")
    parser.add_argument("--first-seed", type=int, default=62000)
    parser.add_argument("--out", type=Path, help="JSON lines of campaigns already recorded; new ones are appended")
    args = parser.parse_args(argv)
    lines = []
    if args.out is not None and args.out.is_file():
        lines = [json.loads(line) for line in args.out.read_text().splitlines()]
    there = {(line["seed"], line["number"], line["factor"]) for line in lines}
    for seed in range(args.first_seed, args.first_seed + args.worlds):
        wanted = [(n, 1.0) for n in range(args.campaigns)] + [(n, HIGHER) for n in range(max(args.campaigns // 4, 2))]
        for number, factor in wanted:
            if (seed, number, factor) in there:
                continue
            lines.append(recorded(seed, number, factor))
            if args.out is not None:
                with args.out.open("a") as file:
                    file.write(json.dumps(lines[-1]) + "\n")
            print(f"world {seed}, campaign {number}, D times {factor:g}", file=sys.stderr, flush=True)
    print(rates(lines, np.random.default_rng(1)))
    print(pooled(lines, np.random.default_rng(2)))


if __name__ == "__main__":
    main()
