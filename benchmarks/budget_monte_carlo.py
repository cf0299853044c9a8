"""A budget's standard uncertainty against a Monte Carlo of its inputs (JCGM 101), and against other programs' sums.

    python benchmarks/budget_monte_carlo.py [--worlds 24] [--draws 16] [--film-draws 160] [--first-seed N] [--out FILE]

In each rough world, plain and behind an air film in turn, the inputs of the budget (noise, what each run does of its
own, what all runs share) are drawn, readings made from them by the fitted model, and fitted again as a whole, each
figure taken from the fit. The budget's own prediction of each draw, straight or along the fit's ridge, is the control
variate: u by Monte Carlo is the budget's u times the ratio of the two standard deviations over the same draws. u is
that of the figure's logarithm. GTC and metrolopy, where they are installed, combine the same lines.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from common_errors import FILM, STATED

from shockrig.analysis.characterize import curvature
from shockrig.analysis.characterize.budget import Budget, budgets, log_figure
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import Extension
from shockrig.analysis.characterize.response_times import ResponseAir, response_slopes
from shockrig.analysis.characterize.result import Part
from shockrig.analysis.characterize.shifts import (
    airflow_exponent,
    disturbances,
    knows_airflow,
    shifts,
    temperature_slopes,
)
from shockrig.analysis.effects import structure_of
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.model import PERTURBED_INPUTS, TRIGGER, Point
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import draw_truth


@dataclass(frozen=True)
class Draw:
    """One draw: errors of theta (P,) by a fit of drawn readings, what the stated airs add to them, both together to
    first order; and the inputs: noise (R, bins) and runs' random effects (R, U) in standard deviations, what is known
    beforehand (P,), and the other inputs by name."""

    fitted: np.ndarray
    label: np.ndarray
    straight: np.ndarray
    noise: np.ndarray
    runs: np.ndarray
    beforehand: np.ndarray
    inputs: dict[str, float]


def drawn(part: Part, draws: int, rng: np.random.Generator) -> list[Draw]:
    """Draws of all inputs, each fitted as a whole."""
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
    made = []
    for _ in range(draws):
        noise = rng.standard_normal(channel.count.shape) * (channel.count > 0)
        runs = rng.standard_normal(problem.scatter.shape)
        shared = rng.standard_normal(len(model.shared))
        inputs = {name: float(rng.standard_normal()) for name in moved}
        power = exponent * float(rng.standard_normal())
        truth, theta = channel, found.theta.copy()
        for name, z in inputs.items():
            truth = PERTURBED_INPUTS[name][0](truth, z * float(getattr(channel.common, name)))
        theta[model.behind] = shared * [one.standard_uncertainty for one in model.shared]
        # A start that is noted wrongly is that: what was read, and when, stays as it was.
        own_off = runs / np.sqrt(arrow.weight)
        late_s = own_off[:, RunEffect.START].copy()
        own_off[:, RunEffect.START] = 0.0
        for k, one in enumerate(model.shared, start=model.behind.start):
            if one.name == TRIGGER:
                late_s += theta[k] * one.acts(channel)
                theta[k] = 0.0
        value = model.on(truth).predict(Point(theta, own_off))[0].copy()
        for run in range(channel.runs):
            filled = channel.count[run] > 0
            value[run, filled] += np.linalg.solve(problem.whitener[run][np.ix_(filled, filled)], noise[run, filled])
        noted = channel.time_s + late_s[:, None]
        read = np.where(channel.count > 0, value, channel.value)
        again = replace(own, channel=replace(channel, time_s=noted, value=read))
        reached = fit(again, found.structure, found.theta, adapt_scatter=False, tolerance=1e-6, iterations=100)
        # The rate that is stated is that at the stated temperature and airflow, not at the true ones.
        label = slopes * inputs.get("air_temperature_k", 0.0) * STATED.air_temperature_k
        label = label + rates * power * inputs.get("airflow_percent", 0.0) * STATED.airflow_percent / 100.0
        told = from_readings @ noise.ravel() + np.einsum("upr,ru->p", from_runs, runs)
        told -= (covariance * np.sqrt(prior))[:, model.behind] @ shared
        for name, z in inputs.items():
            told = told + moved[name] * z
        if "airflow_percent" in inputs and exponent:
            # its line stands for a product of two draws; the prediction takes the product itself
            told = told - moved["airflow_percent"] * inputs["airflow_percent"]
            told = told + rates * power * inputs["airflow_percent"] * STATED.airflow_percent / 100.0
        beforehand = np.zeros(theta.size)
        beforehand[model.behind] = -shared  # the truth is off by as much from what is known, not that from the truth
        made.append(Draw(reached.theta - found.theta, label, told, noise, runs, beforehand, inputs))
    return made


def along(part: Part, ridge: curvature.Ridge, draws: list[Draw]) -> tuple[np.ndarray, np.ndarray]:
    """Where the budget's ridge has fits to the inputs of draws end."""
    named = disturbances(part.problem, part.fit)
    readings = []
    for one in draws:
        seen = np.einsum("rbk,rb->rk", ridge.basis, one.noise) + np.einsum("rku,ru->rk", ridge.effects, one.runs)
        for name, (change, _) in zip(named, ridge.disturbances, strict=True):
            seen = seen + one.inputs.get(name, 0.0) * change
        readings.append(seen)
    return curvature.fits(ridge, np.array(readings), np.array([one.beforehand for one in draws]))


def figures_of(part: Part, ambient: int, air: ResponseAir, error: np.ndarray) -> dict[str, float]:
    """Logarithms of an ambient's figures where theta is off by `error`."""
    theta = part.fit.theta + error
    t63, t90, _ = response_slopes(part.channel, replace(part.fit, theta=theta), ambient, air)[0]
    return {part.channel.quantity.symbol: float(theta[ambient]), "t63": np.log(t63), "t90": np.log(t90)}


def within(budget: Budget, errors: np.ndarray) -> float:
    """Share of drawn figures in the interval that the budget states; `errors` are of their logarithms."""
    value, half = budget.value, budget.expanded_uncertainty
    low, high = budget.interval or (value - half, value + half)
    return float(np.mean((value * np.exp(errors) >= low) & (value * np.exp(errors) <= high)))


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


def world(seed: int, draws: int, film_draws: int) -> list[dict[str, object]]:
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
        if part.misfits(found.noise):
            continue  # its budget has a line for a misfit, which drawn readings do not have
        ridge = curvature.ridge(part.problem, part.fit, list(disturbances(part.problem, part.fit).values()))
        many = drawn(part, film_draws if ridge else draws, rng)
        linear, labels = (np.array([getattr(one, name) for one in many]) for name in ("straight", "label"))
        ended = None if ridge is None else along(part, ridge, many)
        for i, budget in enumerate(made):
            ambient = int(np.argmin(np.abs(part.channel.ambients_c - found.rows[i // 3].ambient_c)))
            if i % 3 == 0:
                there = [
                    figures_of(part, ambient, budget.air, error) for error in (one.fitted + one.label for one in many)
                ]
            of = log_figure(part, ambient, budget)
            slope = of(part.fit.theta)[1]
            foretold = linear @ slope
            if budget.interval is not None:
                foretold = curvature.reached(ridge, of, ended) + labels @ slope
            predicted, found_again = float(np.std(foretold)), np.array([one[budget.figure] for one in there])
            others = other_sums(budget)
            lines.append(
                {
                    "seed": seed,
                    "film": film,
                    "figure": budget.figure,
                    "relative_u": budget.standard_uncertainty / budget.value,
                    "how": "straight" if budget.interval is None else "propagated",
                    "u_over_monte_carlo": predicted / float(np.std(found_again)),
                    "straight_over_monte_carlo": float(np.std(linear @ slope) / np.std(found_again)),
                    "predicted_over_budget": predicted / (budget.standard_uncertainty / budget.value),
                    "correlation": float(np.corrcoef(foretold, found_again)[0, 1]),
                    "within_interval": within(budget, found_again - of(part.fit.theta)[0]),
                    "shares": sum(budget.share(line) for line in budget.lines),
                    "others": {name: u / budget.standard_uncertainty - 1.0 for name, (u, _) in others.items()},
                    "degrees": {name: nu / budget.degrees - 1.0 for name, (_, nu) in others.items()},
                }
            )
    return lines


def table(lines: list[dict]) -> str:
    """Worst and typical ratios."""
    rows = [
        f"{'worlds':<20}{'figure':<8}{'n':>4}{'u / Monte Carlo: median':>25}{'5 to 95 %':>16}{'within 5 %':>12}"
        f"{'propagated':>12}{'in interval':>13}"
    ]
    for film in (False, True):
        for figure in ("alpha", "D", "t63", "t90"):
            some = [x for x in lines if x["film"] == film and x["figure"] == figure]
            if not some:
                continue
            own = np.array([x["u_over_monte_carlo"] for x in some])
            how = sum(x["how"] == "propagated" for x in some)
            inside = np.mean([x["within_interval"] for x in some])
            low, high = np.quantile(own, [0.05, 0.95])
            name = f"{len({x['seed'] for x in lines if x['film'] == film})} rough, {'air film' if film else 'plain'}"
            rows.append(
                f"{name:<20}{figure:<8}{own.size:>4}{np.median(own):>25.3f}{low:>8.3f} to{high:>5.3f}"
                f"{100 * np.mean(np.abs(own - 1) < 0.05):>10.0f} %"
                f"{how:>12}{100 * inside:>11.1f} %"
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
    parser.add_argument("--draws", type=int, default=16)
    parser.add_argument("--film-draws", type=int, default=160, help="where the budget follows a ridge")
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
        new = world(seed, args.draws, args.film_draws)
        lines += new
        if args.out is not None:
            with args.out.open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in new)
        print(f"world {seed}", file=sys.stderr, flush=True)
    print(table(lines))


if __name__ == "__main__":
    main()
