"""A budget's standard uncertainty against a Monte Carlo of its inputs (JCGM 101), and against other programs' sums.

    python benchmarks/budget_monte_carlo.py [--worlds 24] [--draws 40] [--first-seed 63000] [--out FILE]

In each rough world, plain and behind an air film in turn, the inputs of the budget (noise, what each run does of its
own, what all runs share) are drawn, readings made from them by the fitted model, and fitted again as a whole. The
linear budget's own prediction of each draw is the control variate: u by Monte Carlo is the budget's u times the ratio
of the two standard deviations over the same draws, which a few dozen draws give to half a percent. GTC and metrolopy,
where they are installed, combine the same lines.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from common_errors import FILM, STATED

from shockrig.analysis.characterization.budget import Budget, budgets
from shockrig.analysis.characterization.characterize import characterize
from shockrig.analysis.characterization.extension import Extension
from shockrig.analysis.characterization.response_times import response_slopes
from shockrig.analysis.characterization.result import Part
from shockrig.analysis.characterization.shifts import airflow_exponent, knows_airflow, shifts, temperature_slopes
from shockrig.analysis.effects import structure_of
from shockrig.analysis.inference.common import PERTURBED, TRIGGER
from shockrig.analysis.inference.fit import fit
from shockrig.analysis.inference.model import Point
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth


def drawn_errors(part: Part, draws: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Errors of theta (draws, P): by fits of drawn readings, and as the linear budget predicts them."""
    problem, found, channel = part.problem, part.fit, part.channel
    model, arrow = found.model, found.arrow
    own = problem.with_rate_scatter(found.rate_scatter)
    from_runs, from_readings = arrow.shares()
    covariance, prior = arrow.covariance(), model.priors()[1]
    moved = {name: shift for name, shift in shifts(problem, found).items() if name != TRIGGER}
    exponent = 0.0 if knows_airflow(problem, found) else airflow_exponent(found)
    slopes = np.zeros(found.theta.size)
    if not channel.quantity.pooled:
        slopes[model.rates] = temperature_slopes(found)
    rates = np.zeros(found.theta.size)
    rates[model.rates] = 1.0
    fitted, linear = [], []
    for _ in range(draws):
        noise = rng.standard_normal(channel.count.shape) * (channel.count > 0)
        runs = rng.standard_normal(problem.scatter.shape)
        shared = rng.standard_normal(len(model.shared))
        inputs = {name: float(rng.standard_normal()) for name in moved}
        power = exponent * float(rng.standard_normal())
        truth, theta = channel, found.theta.copy()
        for name, z in inputs.items():
            truth = PERTURBED[name][0](truth, z * float(getattr(channel.common, name)))
        theta[model.behind] = shared * [one.standard_uncertainty for one in model.shared]
        value = model.on(truth).predict(Point(theta, runs / np.sqrt(arrow.weight)))[0].copy()
        for run in range(channel.runs):
            filled = channel.count[run] > 0
            value[run, filled] += np.linalg.solve(problem.whitener[run][np.ix_(filled, filled)], noise[run, filled])
        again = replace(own, channel=replace(channel, value=np.where(channel.count > 0, value, channel.value)))
        reached = fit(again, found.structure, found.theta, adapt_scatter=False, tolerance=1e-4)
        # The rate that is stated is that at the stated temperature and airflow, not at the true ones.
        label = slopes * inputs.get("air_temperature_k", 0.0) * STATED.air_temperature_k
        label = label + rates * power * inputs.get("airflow_percent", 0.0) * STATED.airflow_percent / 100.0
        fitted.append(reached.theta - found.theta + label)
        told = from_readings @ noise.ravel() + np.einsum("upr,ru->p", from_runs, runs)
        told -= (covariance * np.sqrt(prior))[:, model.behind] @ shared
        for name, z in inputs.items():
            told = told + moved[name] * z
        if "airflow_percent" in inputs and exponent:
            # its line stands for a product of two draws; the prediction takes the product itself
            told = told - moved["airflow_percent"] * inputs["airflow_percent"]
            told = told + rates * power * inputs["airflow_percent"] * STATED.airflow_percent / 100.0
        linear.append(told)
    return np.array(fitted), np.array(linear)


def other_sums(budget: Budget) -> dict[str, tuple[float, float]]:
    """u and effective degrees of freedom of the same lines by GTC and metrolopy, where they are installed."""
    found = {}
    try:
        import GTC

        lines = [(x.sensitivity, x.standard_uncertainty, min(x.degrees, 1e9)) for x in budget.lines]
        whole = sum(c * GTC.ureal(0.0, u, nu) for c, u, nu in lines)
        found["GTC"] = (float(whole.u), float(whole.df))
    except ImportError:
        pass
    try:
        from metrolopy import gummy

        whole = sum(
            line.sensitivity * gummy(0.0, u=line.standard_uncertainty, dof=min(line.degrees, 1e9))
            for line in budget.lines
        )
        found["metrolopy"] = (float(whole.u), float(whole.dof))
    except ImportError:
        pass
    return found


def world(seed: int, draws: int) -> list[dict[str, object]]:
    """One line for each figure of one world."""
    rng = np.random.default_rng(seed)
    film = bool(seed % 2)
    truth = draw_truth(rng, "rough", [draw_effect(rng, FILM)] if film else [])
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan(), rng, Path(folder) / "c"))
    extension = {"temperature": Extension(structure_of([FILM]))} if film else {}
    result = characterize(replace(campaign, common=STATED), seed, extension)
    lines = []
    for found in result.channels().values():
        made, (part, *_) = budgets(found), found.parts
        if part.enlarged(found.noise) > 1.0:
            continue  # its budget has a line for a misfit, which drawn readings do not have
        errors, linear = drawn_errors(part, draws, rng)
        for i, budget in enumerate(made):
            ambient = int(np.argmin(np.abs(part.channel.ambients_c - found.rows[i // 3].ambient_c)))
            slope = np.zeros(part.fit.theta.size)
            slope[ambient] = budget.value
            if budget.figure in ("t63", "t90"):
                place = ("t63", "t90").index(budget.figure)
                slope = response_slopes(part.channel, part.fit, ambient, budget.air)[1][place]
            predicted = float(np.std(linear @ slope))
            others = other_sums(budget)
            lines.append(
                {
                    "seed": seed,
                    "film": film,
                    "figure": budget.figure,
                    "relative_u": budget.standard_uncertainty / budget.value,
                    "u_over_monte_carlo": predicted / float(np.std(errors @ slope)),
                    "predicted_over_budget": predicted / budget.standard_uncertainty,
                    "shares": sum(budget.share(line) for line in budget.lines),
                    "others": {name: u / budget.standard_uncertainty - 1.0 for name, (u, _) in others.items()},
                    "degrees": {name: nu / budget.degrees - 1.0 for name, (_, nu) in others.items()},
                }
            )
    return lines


def table(lines: list[dict]) -> str:
    """Worst and typical ratios."""
    rows = [f"{'worlds':<20}{'figure':<8}{'n':>4}{'u / Monte Carlo: median':>25}{'5 to 95 %':>16}{'within 5 %':>12}"]
    for film in (False, True):
        for figure in ("alpha", "D", "t63", "t90"):
            own = np.array([x["u_over_monte_carlo"] for x in lines if x["film"] == film and x["figure"] == figure])
            if not own.size:
                continue
            low, high = np.quantile(own, [0.05, 0.95])
            name = f"{len({x['seed'] for x in lines if x['film'] == film})} rough, {'air film' if film else 'plain'}"
            rows.append(
                f"{name:<20}{figure:<8}{own.size:>4}{np.median(own):>25.3f}{low:>8.3f} to{high:>5.3f}"
                f"{100 * np.mean(np.abs(own - 1) < 0.05):>10.0f} %"
            )
    rows.append(f"shares add to 100 % within {100 * max(abs(x['shares'] - 1) for x in lines):.1g} %")
    for name in sorted({name for x in lines for name in x["others"]}):
        u = max(abs(x["others"][name]) for x in lines if name in x["others"])
        nu = max(abs(x["degrees"][name]) for x in lines if name in x["degrees"])
        rows.append(f"{name}: u differs by {u:.1g} at most, effective degrees of freedom by {nu:.1g} (relatively)")
    return "\n".join(rows)


def main(argv: list[str] | None = None) -> None:
    """Run the worlds, append their lines, print the table of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=24)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=63000)
    parser.add_argument("--out", type=Path, help="JSON lines of worlds already run; new ones are appended")
    args = parser.parse_args(argv)
    lines = []
    if args.out is not None and args.out.is_file():
        lines = [json.loads(line) for line in args.out.read_text().splitlines()]
    there = {line["seed"] for line in lines}
    for seed in range(args.first_seed, args.first_seed + args.worlds):
        if seed in there:
            continue
        new = world(seed, args.draws)
        lines += new
        if args.out is not None:
            with args.out.open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in new)
        print(f"world {seed}", file=sys.stderr, flush=True)
    print(table(lines))


if __name__ == "__main__":
    main()
