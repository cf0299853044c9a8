"""Fleets for tests and benchmarks: statistics drawn straight from the population's model, and campaigns of the virtual
bench whose sensors are of one type."""

import json
from dataclasses import replace

import numpy as np

from shockrig.analysis.fleet.statistics import CampaignStatistics, ChannelStatistics, Responses, RunRates, film
from shockrig.files.fleet_file import Coordinate, design
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import draw_truth

AMBIENTS_C = (0.0, 10.0, 20.0, 30.0, 40.0)
NODES = (film(0.0), film(20.0), film(40.0))
MIX = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [0.6, 0.3, 0.7]])  # D at one temperature goes with that at others


RUNS = 12  # of a drawn campaign, for each of its numbers


def drawn_fleet(
    rng,
    count,
    *,
    spread=0.02,
    uncertainty=0.004,
    common=0.0,
    off=None,
    since=None,
    ambients_c=AMBIENTS_C,
    probes=1,
    run_scatter=0.0,
    run_share=0.0,
):
    """Statistics of `count` sensors on one bench, and each one's true (ln alpha, ln D over the ambients).

    `off` (place -> shift of ln D) does not belong; `since` (place, shift) is where another batch of films begins;
    `common` is what one error of the bench does to every number. `probes` are side by side in a campaign, and their
    runs scatter in rate by `run_scatter`, of which `run_share` of the variance is the same in all of them.
    """
    asked = [film(t) for t in ambients_c]
    error, m = common * rng.standard_normal(), len(asked)
    found, truths = [], []
    for i in range(count):
        if i % probes == 0 and run_scatter:
            beside = rng.standard_normal((1 + m, RUNS))
        alpha = np.log(8e-8) + spread * rng.standard_normal()
        nodes = np.log([4e-12, 8e-12, 1.5e-11]) + spread * (MIX @ rng.standard_normal(3)) + (off or {}).get(i, 0.0)
        nodes = nodes + (since[1] if since and i >= since[0] else 0.0)
        d = design(NODES, asked) @ nodes
        noise = uncertainty * rng.standard_normal(1 + m) + error
        runs = np.zeros((1 + m, 0))
        if run_scatter:
            runs = np.sqrt(run_share) * beside + np.sqrt(1.0 - run_share) * rng.standard_normal((1 + m, RUNS))
            noise = noise + run_scatter * runs.mean(axis=1)
        bead = statistics(
            [Coordinate("temperature", "alpha")],
            alpha + noise[:1],
            uncertainty,
            common,
            4e-4,
            "sphere",
            runs[:1],
            run_scatter,
        )
        film_ = statistics(asked, d + noise[1:], uncertainty, common, 1e-5, "film", runs[1:], run_scatter)
        serials = {"temperature": f"X{i + 8}", "humidity": f"H{i + 8}"}
        began = f"2026-01-{1 + i * 28 // count:02d}T00:00:00Z"
        channels = {"temperature": bead, "humidity": film_}
        path, probe = f"c{i // probes}", str(1 + i % probes)
        found.append(CampaignStatistics(f"c{i}", path, probe, f"f{i}", began, "bench", serials, channels))
        truths.append((alpha, d))
    return found, truths


def statistics(coordinates, value, uncertainty, common, length_m, body, runs, run_scatter):
    size = len(coordinates)
    moves = np.kron(np.eye(size), np.full((1, runs.shape[1]), run_scatter / max(runs.shape[1], 1)))
    rates = RunRates(
        tuple(map(str, range(runs.size))),
        (runs - runs.mean(axis=1, keepdims=True)).ravel() if runs.size else runs[0],
        moves,
    )
    shared = {"airflow_percent": np.full(size, common)} if common else {}
    own = uncertainty**2 * np.eye(size) + moves @ moves.T
    variance = np.diag(own) + common**2
    responses = Responses(np.arange(size), np.log(0.3 * length_m**2) - value, variance, -np.eye(size))
    return ChannelStatistics(
        tuple(coordinates),
        value,
        own,
        shared,
        responses,
        10,
        True,
        body,
        length_m,
        0.02,
        0.1,
        rates,
    )


def drawn_sensor(base, rng, spread=0.02):
    """Another virtual pair of sensors of the type of `base`."""
    z = rng.standard_normal(3)
    return replace(
        base,
        thermal_diffusivity_m2_s=float(base.thermal_diffusivity_m2_s * np.exp(spread * z[0])),
        diffusivity_20c_m2_s=float(base.diffusivity_20c_m2_s * np.exp(spread * z[1])),
        activation_k=float(base.activation_k + 1500.0 * spread * z[2]),
    )


def short_plan():
    """Eleven runs: both quantities at 0, 20 and 40 degC."""
    wide = wide_plan()
    return [*wide[0:2], wide[3], *wide[10:15], *wide[20:22], wide[23]]


def record_sensor(truth, plan, seed, folder, serial):
    """A campaign of one virtual pair of sensors, with serial numbers; returns its folder."""
    path = simulate_campaign(truth, plan, np.random.default_rng(seed), folder, name=folder.name)
    head = json.loads((path / "campaign.json").read_text())
    for name, letter in (("imet", "X"), ("hyt", "H")):
        head["sensors"][name]["serial"] = f"{letter}{serial}"
    (path / "campaign.json").write_text(json.dumps(head))
    return path


def type_of_sensors(seed, tier="rough"):
    """What the sensors of a fleet are drawn about."""
    return draw_truth(np.random.default_rng(seed), tier)
