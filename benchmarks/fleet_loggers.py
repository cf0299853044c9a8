"""A public fleet: eight DS18B20 loggers plunged at once, each a sensor of its own.

    python benchmarks/fleet_loggers.py --cache DIR

The logs (QuentinRauschenbach/Temperature_Logger @aee1916) lie as published at
DIR/QuentinRauschenbach/Temperature_Logger/data/adjusted and are no part of this project.
Each logger is characterized from its one plunge as two time constants beside one another; the fleet of all eight says
each one's time to 63 %, beside that of two exponentials fitted to it alone (`rivals.py`). Then each is left out: the
mean sensor of the other seven predicts its plunge, beside the simple models fitted to these seven.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from real_cache_sets import PROBES, probe_log
from real_sets import write_campaign
from records import read_records
from rival_models import Model
from rivals import CHOSEN, Fitted, errors, fit_rival, held_out, models

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import extension_of
from shockrig.analysis.fleet.fleet import fleet_of
from shockrig.analysis.fleet.statistics import CampaignStatistics, statistics_of
from shockrig.files.campaign import read_campaign
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.fingerprint import fingerprint
from shockrig.files.fleet_file import Population

T = "temperature"
LAG = StatedEffect("parallel_lag", {"fraction": Uncertain(0.4), "time_constant_s": Uncertain(20.0)})


def main(argv: list[str] | None = None) -> None:
    """Print a line for each logger, then the fleet's."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, metavar="DIR")
    args = parser.parse_args(argv)
    with tempfile.TemporaryDirectory() as folder:
        campaigns = [campaign_of(args.cache, name, Path(folder) / name) for name in PROBES]
        records = [read_records(path, T)[0] for path in campaigns]
        known = [measured(path) for path in campaigns]
    fleet = fleet_of(known)
    within = 0
    print(f"{'logger':<8}{'two exponentials':>17}{'alone, s':>16}{'in the fleet, s':>18}{'belongs':>9}")
    for name, sensor, record in zip(PROBES, by_name(fleet.sensors, known), records, strict=True):
        figure = sensor.channels[T].figures[0]
        rival = fit_rival(models(T)["two exponentials"], [record], T).t63_s
        own, shrunk = figure.own_t63_s, figure.t63_s
        within += all(abs(t.value - rival) < 2.0 * t.standard_uncertainty for t in (own, shrunk))
        texts = [f"{t.value:.2f} +- {t.standard_uncertainty:.2f}" for t in (own, shrunk)]
        belongs = "yes" if sensor.channels[T].belongs else "no"
        print(f"{name:<8}{rival:>17.2f}{texts[0]:>16}{texts[1]:>18}{belongs:>9}")
    print(f"both within two uncertainties of the two exponentials: {within} of {len(PROBES)}")
    for k, one in enumerate(fleet.population.coordinates):
        mean, spread = fleet.population.mean[k], np.sqrt(np.diag(fleet.population.covariance))[k]
        print(f"{'ln ' if one.log else ''}{one.figure}: mean {mean:.3f}, from logger to logger {spread:.3f}")
    left_out = []
    for k, record in enumerate(records):
        type_ = fleet_of([one for i, one in enumerate(known) if i != k]).population
        left_out.append(errors(as_fitted(type_), [record])[record.id])
    ours = float(np.sqrt(np.mean(left_out)))
    by_run = held_out([unique(r, i) for i, r in enumerate(records)], T, len(records))
    rivals = {name: float(np.sqrt(np.mean(np.square(list(e.values()))))) for name, e in by_run.items()}
    best = min((name for name in rivals if name != CHOSEN), key=rivals.__getitem__)
    print("left out, rms in K: " + ", ".join(f"{name} {error:.3f}" for name, error in rivals.items()))
    print(f"the fleet's mean sensor {ours:.3f}: {ours / rivals[best]:.2f} of the best of them ({best})")


def campaign_of(cache: Path, name: str, out: Path) -> Path:
    """A logger's plunge as a campaign of its own."""
    log = probe_log(cache, name)
    write_campaign(out, T, log, [(0.0, float(log["time_s"].iloc[-1]) + 1.0)])
    head = json.loads((out / "campaign.json").read_text())
    head["sensors"]["imet"]["serial"] = name
    (out / "campaign.json").write_text(json.dumps(head))
    return out


def measured(path: Path) -> CampaignStatistics:
    """What a plunge says, as two time constants."""
    campaign = read_campaign(path)
    return statistics_of(characterize(campaign, 0, {T: extension_of([LAG])}), fingerprint(campaign))


def by_name(sensors, known):
    """The fleet's sensors in the order of the loggers."""
    found = {sensor.serials[T]: sensor for sensor in sensors}
    return [found[one.serials[T]] for one in known]


def as_fitted(type_: Population) -> Fitted:
    """The type's mean sensor, judged as a rival is."""
    mean = {one.figure: float(value) for one, value in zip(type_.coordinates, type_.mean, strict=True)}
    fast_s = type_.lengths_m[T] ** 2 / np.exp(mean["alpha"])
    slow_s, share = np.exp(mean["parallel_lag.time_constant_s"]), mean["parallel_lag.fraction"]
    modes = np.array([1.0 - share, share]), 1.0 / np.array([fast_s, slow_s])
    return Fitted(Model("fleet", lambda p: modes, ()), T, np.zeros(0), 0.0, 0.0)


def unique(record, place: int):
    """A record by a name of its own: each campaign has one run, and all are called alike."""
    return replace(record, id=f"{place}")


if __name__ == "__main__":
    main()
