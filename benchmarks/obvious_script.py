"""What a user would write without this project: layered state space, scipy's lsim inside its differential evolution,
run by run. Benchmarks time it against the project's own fit; it reads a campaign by its file format alone.

    python benchmarks/obvious_script.py CAMPAIGN [--runs N] [--unknowns 1|4] [--layers N] [--popsize N] [--maxiter N]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution
from scipy.signal import lsim

from shockrig.analysis.physics.humidity import humidity_from_ppmv, ppmv_from_humidity
from shockrig.analysis.physics.schemes import film_layers, sphere_layers

PERIOD_S = 0.1
SMALLEST_STEP = 1.0  # degC or %RH
# log10 of diffusivity / length^2 [1/s]
BOUNDS = {"temperature": (-2.5, 1.5), "humidity": (-3.5, 1.0)}
# how far the start [s] and each of the two airs [degC, %RH] may be off where they are unknowns too: three sigma
START_BOUND_S = 0.03
AIR_BOUND = {"temperature": 0.06, "humidity": 0.3}


@dataclass(frozen=True)
class RunFit:
    """Diffusivity of one run and what it cost."""

    run: str
    channel: str
    ambient_c: float
    diffusivity_m2_s: float
    rmse: float
    evaluations: int
    seconds: float


def fit_campaign(
    campaign: Path,
    runs: int | None = None,
    unknowns: int = 1,
    layers: int = 10,
    scheme: str = "corrected",
    popsize: int = 15,
    maxiter: int = 1000,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _: None,
) -> list[RunFit]:
    """Fit every run that has a step and a start, channel by channel; the defaults are those of scipy.

    `unknowns` is 1 (the diffusivity alone) or 4 (and the start and the two airs, within what the bench knows of them).
    `runs` takes the first so many runs only. Runs without a step in a channel are no work and are left out.
    """
    description = json.loads((campaign / "campaign.json").read_text(encoding="utf-8"))
    lengths = {
        "temperature": description["sensors"].get("imet", {}).get("bead_radius_m", 4e-4),
        "humidity": description["sensors"].get("hyt", {}).get("film_thickness_m", 1e-5),
    }
    fits = []
    for folder in sorted(p for p in (campaign / "runs").iterdir() if p.is_dir())[:runs]:
        run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        for channel, length in lengths.items():
            objective = misfit(folder, run, channel, layers, scheme)
            if objective is None:
                continue
            air = AIR_BOUND[channel]
            bounds = [BOUNDS[channel], (-START_BOUND_S, START_BOUND_S), (-air, air), (-air, air)][:unknowns]
            begin = time.perf_counter()
            result = differential_evolution(
                objective, bounds, popsize=popsize, maxiter=maxiter, rng=np.random.default_rng(seed)
            )
            seconds = time.perf_counter() - begin
            diffusivity, rmse = 10 ** result.x[0] * length**2, float(result.fun)
            ambient_c = run["destination"]["temperature_c"]
            fits.append(RunFit(folder.name, channel, ambient_c, diffusivity, rmse, int(result.nfev), seconds))
            progress(f"{folder.name} {channel:11s} {diffusivity:.4g} m2/s, {result.nfev} runs of lsim, {seconds:.1f} s")
    return fits


def misfit(folder: Path, run: dict, channel: str, layers: int, scheme: str) -> Callable[[np.ndarray], float] | None:
    """RMSE (Eq. 17) of one run; None where the channel has no step or no file.

    Its argument is log10 of diffusivity / length^2 and, if they are unknowns too, how far the start, the source and the
    destination are off.
    """
    name, column = {"temperature": ("imet.csv", "temperature_c"), "humidity": ("hyt.csv", "humidity_percent")}[channel]
    airs, start = (run["source"], run["destination"]), run["transfer"].get("start_s")
    if start is None or not (folder / name).exists() or abs(airs[1][column] - airs[0][column]) < SMALLEST_STEP:
        return None
    data = pd.read_csv(folder / name).dropna(subset=["time_s", column])
    if "stale" in data:
        data = data[data["stale"] != 1]
    sampled, reading = data["time_s"].to_numpy(), data[column].to_numpy()
    build = sphere_layers if channel == "temperature" else film_layers
    temperatures = [air["temperature_c"] for air in airs]
    elapsed = PERIOD_S * np.arange(int((sampled[-1] - start) / PERIOD_S) + 3)

    def objective(unknown: np.ndarray) -> float:
        late, *off = [*unknown[1:], 0.0, 0.0, 0.0][:3]
        before, after = (air[column] + float(o) for air, o in zip(airs, off, strict=True))
        if channel == "humidity":
            before, after = (ppmv_from_humidity(h, t) for h, t in zip((before, after), temperatures, strict=True))
        model = build(scheme, layers, 10 ** float(unknown[0]))
        system = (model.a, model.b[:, None], model.c[None, :], np.zeros((1, 1)))
        air = np.full(elapsed.size, float(after))
        _, output, _ = lsim(system, air, elapsed, X0=np.full(layers, float(before)), interp=False)
        simulated = np.interp(sampled, start + late + elapsed, np.ravel(output), left=float(before))
        if channel == "humidity":
            simulated = humidity_from_ppmv(
                simulated, np.where(sampled > start + late, temperatures[1], temperatures[0])
            )
        return float(np.sqrt(np.mean((reading - simulated) ** 2)))

    return objective


def main(argv: list[str] | None = None) -> None:
    """Fit a campaign and print what each run gave and cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--runs", type=int, help="only the first so many runs (all)")
    parser.add_argument("--unknowns", type=int, choices=(1, 4), default=1, help="4: start and airs too (1)")
    parser.add_argument("--layers", type=int, default=10)
    parser.add_argument("--scheme", default="corrected", choices=("printed", "corrected", "collocation"))
    parser.add_argument("--popsize", type=int, default=15)
    parser.add_argument("--maxiter", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    fits = fit_campaign(
        args.campaign, args.runs, args.unknowns, args.layers, args.scheme, args.popsize, args.maxiter, args.seed,
        progress=lambda line: print(line, file=sys.stderr, flush=True),
    )  # fmt: skip
    table = pd.DataFrame(fits)
    print(table.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    print(f"{len(fits)} fits, {table['evaluations'].sum()} runs of lsim, {table['seconds'].sum():.1f} s")


if __name__ == "__main__":
    main()
