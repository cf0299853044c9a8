"""What a machine draws and finds, as JSON: python machine_process.py draws|fits [--nudged up|down] [CAMPAIGN].

Nudged, what numpy computes by exp, log and powers (draws), or every reading (fits), is off by one last bit.
"""

import argparse
import json
from dataclasses import asdict, replace

import numpy as np

NUDGED = ("exp", "expm1", "log", "log10", "sqrt", "power", "sin", "cos", "tanh")


def draws():
    """Truths and their further probes, effects, and plans; of many seeds."""
    from benchmark_scripts import benchmark

    from shockrig.rig.protocol import load_protocol
    from shockrig.rig.virtual.hide import DRAWS, STRENGTHS, draw_effect, draw_hidden
    from shockrig.rig.virtual.plans import extended_plan, wide_plan
    from shockrig.rig.virtual.realistic import drawable
    from shockrig.rig.virtual.truth import TIERS, Truth, draw_truth, of_probe

    found = {}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = draw_truth(rng, TIERS[seed % 3], draw_hidden(rng))
        truths = [truth, *(of_probe(truth, probe) for probe in ("2", "mast"))]
        truths.append(of_probe(Truth.from_json(truth.to_json()), "2"))
        found[f"truth {seed}"] = [asdict(one) for one in truths]
    for strength in (*STRENGTHS, 0.5):
        rng = np.random.default_rng(1)
        names = drawable() if strength == "realistic" else DRAWS
        found[f"effects {strength}"] = [asdict(draw_effect(rng, name, strength)) for name in names for _ in range(5)]
    found["plans"] = [asdict(shock) for shock in (*extended_plan(), *wide_plan())]
    found["protocols"] = [asdict(load_protocol(name)) for name in ("quick", "standard", "extended", "manual")]
    worlds = benchmark("foreign_worlds")
    foreign = [worlds.draw(name, seed).bench.plan for name in ("lags", "chamber_air") for seed in (1, 2)]
    found["foreign"] = [[asdict(transfer) for transfer in plan] for plan in foreign]
    return found


def fits(campaign):
    """Names, and numbers with their uncertainties, of a characterization and of the bead's diagnosis."""
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.diagnose.diagnose import diagnose

    found = characterize(campaign, 1)
    numbers = {"alpha": [(r.diffusivity_m2_s, r.standard_uncertainty) for r in found.temperature.rows]}
    numbers["D"] = [(row.diffusivity_m2_s, row.standard_uncertainty) for row in found.humidity.rows]
    runs = tuple(replace(run, hyt=None) for run in campaign.runs)
    (bead,) = diagnose(replace(campaign, runs=runs)).channels
    for effect, values in bead.final.values().items():
        numbers |= {f"{effect} {name}": [pair] for name, pair in values.items()}
    names = [bead.verdict, [(c.effect, c.indistinguishable_from) for c in bead.causes], list(found.temperature.runs)]
    return {"names": names, "numbers": numbers}


def nudged(function, towards):
    return lambda *arguments, **options: np.nextafter(function(*arguments, **options), towards)


def of_nudged_readings(campaign, towards):
    def moved(trace):
        values = {name: np.nextafter(value, towards) for name, value in trace.values.items()}
        return replace(trace, values=values)

    runs = tuple(replace(run, imet=moved(run.imet), hyt=moved(run.hyt)) for run in campaign.runs)
    return replace(campaign, runs=runs)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("draws", "fits"))
    parser.add_argument("campaign", nargs="?")
    parser.add_argument("--nudged", choices=("up", "down"))
    given = parser.parse_args()
    towards = {"up": np.inf, "down": -np.inf}.get(given.nudged)
    if given.what == "draws":
        for name in NUDGED if towards is not None else ():
            setattr(np, name, nudged(getattr(np, name), towards))
        print(json.dumps(draws()))
    else:
        from shockrig.files.campaign import read_campaign

        read = read_campaign(given.campaign)
        print(json.dumps(fits(read if towards is None else of_nudged_readings(read, towards))))
