"""Errors that all runs share, drawn and put into recorded campaigns: do the stated uncertainties hold, does the budget
name the largest line?

    python benchmarks/common_errors.py [--worlds 48] [--first-seed 61000] [--film] [--out FILE]
    python benchmarks/common_errors.py --diagnose [--worlds 24] [--hide EFFECT ...] [--out FILE]

Rough worlds of the virtual bench. In each, what the bench wrote down is made wrong in all runs alike by a draw: airflow
2 %, airs 0.05 K and 0.5 %RH, trigger 10 ms, pressure 5 hPa, clock 50 millionths; campaign.json states as much. Truth is
what the sensors are. With --film an air film is hidden as well and carried by the model, so that alpha depends on the
airflow. Each world appends its lines to --out; the table is made from all lines that are there. With --diagnose the
worlds are diagnosed: nothing may be named that is not there, and what is hidden in them should be.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from shockrig.analysis.characterize.budget import Budget, budgets
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import Extension
from shockrig.analysis.diagnose.diagnose import diagnose
from shockrig.analysis.effects import structure_of
from shockrig.files.campaign import Campaign, Run, RunAir, read_campaign
from shockrig.files.common_uncertainty import INPUTS, CommonUncertainty
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import Truth, draw_truth

STATED = CommonUncertainty(
    air_temperature_k=0.05,
    air_humidity_percent=0.5,
    airflow_percent=2.0,
    pressure_hpa=5.0,
    trigger_offset_s=0.010,
    clock_ppm=50.0,
)
FILM = "convective_film"
WIDTHS = (10, 12, 10, 8, 9)


def falsified(campaign: Campaign, errors: dict[str, float], stated: CommonUncertainty | None) -> Campaign:
    """The campaign as a bench would have written it whose inputs are all off by `errors` (true less written)."""

    def air(given: RunAir) -> RunAir:
        return RunAir(
            None if given.temperature_c is None else given.temperature_c - errors["air_temperature_k"],
            None if given.humidity_percent is None else given.humidity_percent - errors["air_humidity_percent"],
        )

    def run(given: Run) -> Run:
        slower = 1.0 + 1e-6 * errors["clock_ppm"]
        traces = {
            name: replace(trace, time_s=trace.time_s * slower)
            for name in ("imet", "hyt")
            if (trace := getattr(given, name)) is not None
        }
        return replace(
            given,
            source=air(given.source),
            destination=air(given.destination),
            airflow_m_s=None
            if given.airflow_m_s is None
            else given.airflow_m_s / (1 + errors["airflow_percent"] / 100),
            pressure_hpa=given.pressure_hpa - errors["pressure_hpa"],
            start_s=None if given.start_s is None else given.start_s * slower - errors["trigger_offset_s"],
            **traces,
        )

    return replace(campaign, runs=tuple(run(one) for one in campaign.runs), common=stated)


def drawn(rng: np.random.Generator, stated: CommonUncertainty = STATED) -> dict[str, float]:
    """One draw of what all runs share."""
    return {name: float(getattr(stated, name) * rng.standard_normal()) for name in INPUTS}


def largest_in_truth(budget: Budget, truth: Truth) -> str:
    """The largest line if the inputs' uncertainties were known: the lines rescaled to how the world was drawn."""
    noise = truth.temperature_noise if budget.channel == "temperature" else truth.humidity_noise
    true = {"rate, run by run": truth.rate_scatter, "noise of the readings": noise_size(noise)}
    return max(
        budget.lines,
        key=lambda line: abs(line.sensitivity) * true.get(line.component, line.standard_uncertainty),
    ).component


def noise_size(noise: object) -> float:
    """Standard deviation of a channel's noise."""
    return float(np.hypot(noise.white, getattr(noise, "correlated", 0.0)))


def world(seed: int, film: bool) -> list[dict[str, object]]:
    """One line for each figure of one world."""
    rng = np.random.default_rng(seed)
    hidden = [draw_effect(rng, FILM)] if film else []
    truth = draw_truth(rng, "rough", hidden)
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan(), rng, Path(folder) / "c"))
        campaign = falsified(campaign, drawn(rng), STATED)
    extension = {"temperature": Extension(structure_of([FILM]))} if film else {}
    result = characterize(campaign, seed, extension)
    lines = []
    for name, found in result.channels().items():
        for budget in budgets(found):
            if budget.figure not in ("alpha", "D"):
                continue
            true = truth.thermal_diffusivity_m2_s
            if name == "humidity":
                assert budget.air.temperature_c is not None
                true = float(truth.diffusivity_m2_s(budget.air.temperature_c))
            lines.append(
                {
                    "seed": seed,
                    "film": film,
                    "figure": budget.figure,
                    "error": budget.value / true - 1.0,
                    "u": budget.standard_uncertainty / true,
                    "k": budget.coverage_factor,
                    "largest": budget.lines[0].component,
                    "largest_in_truth": largest_in_truth(budget, truth),
                }
            )
    return lines


def named(seed: int, effect: str | None = None) -> list[dict[str, object]]:
    """A line for each channel of one world with its draw of common errors, as stated: what its diagnosis names.

    `effect` is hidden plain to see; without one nothing is there to be named.
    """
    rng = np.random.default_rng(seed)
    hidden = [draw_effect(rng, effect)] if effect else []
    truth = draw_truth(rng, "rough", hidden)
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan(), rng, Path(folder) / "c"))
    errors = drawn(rng)
    found = diagnose(falsified(campaign, errors, STATED))
    acting = {channel: one.effect for one in hidden for channel in one.channels}
    return [
        {
            "seed": seed,
            "hidden": effect,
            "channel": channel.name,
            "there": [acting[channel.name]] if channel.name in acting else [],
            "named": [cause.effect for cause in channel.causes],
            "sigmas": {name: round(error / getattr(STATED, name), 2) for name, error in errors.items()},
        }
        for channel in found.channels
    ]


def names(lines: list[dict[str, object]]) -> str:
    """What diagnoses of worlds with common errors named, by what was there."""
    rows = [f"{'there':<26}{'worlds':>7}{'named':>8}{'wrong names':>13}  which, in which world"]
    for effect in sorted({x["hidden"] for x in lines}, key=str):
        own = [x for x in lines if x["hidden"] == effect]
        with_it = [x for x in own if x["there"]]
        right = sum(set(x["there"]) <= set(x["named"]) for x in with_it)
        wrong = {(x["seed"], x["channel"]): set(x["named"]) - set(x["there"]) for x in own}
        wrong = {at: sorted(more) for at, more in wrong.items() if more}
        worlds = len({x["seed"] for x in own})
        said = "; ".join(f"{seed} {channel}: {', '.join(more)}" for (seed, channel), more in wrong.items())
        in_worlds = len({seed for seed, _ in wrong})
        of_it = f"{right}/{len(with_it)}" if with_it else "-"
        rows.append(f"{effect or 'nothing':<26}{worlds:>7}{of_it:>8}{in_worlds:>13}  {said}".rstrip())
    return "\n".join(rows)


def table(lines: list[dict[str, object]]) -> str:
    """What of the errors lies within two standard uncertainties, and how often the largest line is named rightly."""
    heads = ("median u", "within 2 u", "within U", "rms z", "largest")
    rows = [f"{'worlds':<22}{'figure':<8}{'n':>5}" + "".join(f"{h:>{w}}" for h, w in zip(heads, WIDTHS, strict=True))]
    for film in (False, True):
        for figure in ("alpha", "D", "both"):
            own = [x for x in lines if x["film"] == film and figure in (x["figure"], "both")]
            if not own:
                continue
            z = np.array([x["error"] / x["u"] for x in own])
            k = np.array([x["k"] for x in own])
            right = np.mean([x["largest"] == x["largest_in_truth"] for x in own])
            worlds = len({x["seed"] for x in own})
            name = f"{worlds} rough, " + ("air film" if film else "plain")
            rows.append(
                f"{name:<22}{figure:<8}{len(own):>5}{100 * np.median([x['u'] for x in own]):>8.2f} %"
                f"{100 * np.mean(np.abs(z) < 2):>10.1f} %{100 * np.mean(np.abs(z) < k):>8.1f} %"
                f"{np.sqrt(np.mean(z**2)):>8.2f}{100 * right:>7.0f} %"
            )
    return "\n".join(rows)


def main(argv: list[str] | None = None) -> None:
    """Run the worlds, append their lines, print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=48)
    parser.add_argument("--first-seed", type=int, default=61000)
    parser.add_argument("--film", action="store_true", help="hide an air film, and carry it in the model")
    parser.add_argument("--out", type=Path, help="JSON lines of worlds already run; new ones are appended")
    parser.add_argument("--diagnose", action="store_true", help="diagnose the worlds instead")
    parser.add_argument("--hide", nargs="+", default=[None], metavar="EFFECT", help="with --diagnose: in turn")
    args = parser.parse_args(argv)
    lines: list[dict[str, object]] = []
    if args.out is not None and args.out.is_file():
        lines = [json.loads(line) for line in args.out.read_text().splitlines()]
    seeds = range(args.first_seed, args.first_seed + args.worlds)
    if args.diagnose:
        asked = [(seed, effect) for effect in args.hide for seed in seeds]
        there = {(line["seed"], line["hidden"]) for line in lines}
    else:
        asked = [(seed, args.film) for seed in seeds]
        there = {(line["seed"], line["film"]) for line in lines}
    for seed, what in asked:
        if (seed, what) in there:
            continue
        new = named(seed, what) if args.diagnose else world(seed, what)
        lines += new
        if args.out is not None:
            with args.out.open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in new)
        print(f"world {seed} {what or ''}".rstrip(), file=sys.stderr, flush=True)
    print(names(lines) if args.diagnose else table(lines))


if __name__ == "__main__":
    main()
