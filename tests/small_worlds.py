"""Worlds of the virtual bench for tests: quiet sensors, and small campaigns on which every effect can act."""

import json
from dataclasses import replace

import numpy as np

from shockrig.files.campaign import read_campaign
from shockrig.rig.seams import Air
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import Shock, wide_plan
from shockrig.rig.virtual.truth import SMOOTH, TrueNoise, Truth, draw_truth

# Sensors without noise, rounding or scatter: what is read is what the equations say.
QUIET = Truth(
    thermal_diffusivity_m2_s=9e-8,
    diffusivity_20c_m2_s=8e-12,
    temperature_noise=TrueNoise(0.0),
    humidity_noise=TrueNoise(0.0),
    die_noise_k=0.0,
    chamber_scatter_k=0.0,
    chamber_scatter_percent=0.0,
    temperature_step_k=1e-6,
    humidity_step_percent=1e-6,
)
LIGHT = {"irradiance_w_m2": 800.0}


# A protocol of eight short runs: both ways in temperature at three airflows, both ways in humidity.
_HEAD = """
format = "shock-protocol/1"
name = "short"
[steps]
usual = [
  { do = "soak", over_s = 5, at_most_s = 600, reference_within_k = 0.05, reference_within_percent = 0.3 },
  { do = "record", for_s = 5 },
  { do = "transfer" },
  { do = "record", for_s = 40 },
]
"""
_RUN = """
[[run]]
airflow_m_s = {flow}
source = {{ temperature_c = {source[0]}, humidity_percent = {source[1]} }}
destination = {{ temperature_c = {destination[0]}, humidity_percent = {destination[1]} }}
"""
_WARM, _COOL, _DRY, _WET = (40, 18), (20, 55), (20, 20), (20, 80)
_BOTH_WAYS = [(_WARM, _COOL), (_COOL, _WARM)]
SHORT = "".join(
    [
        _HEAD,
        *(_RUN.format(flow=flow, source=a, destination=b) for flow in (2.5, 6.0, 12.0) for a, b in _BOTH_WAYS),
        *(_RUN.format(flow=6.0, source=a, destination=b) for a, b in ((_DRY, _WET), (_WET, _DRY))),
    ]
)


def small_plan():
    """Runs at 20 degC (both quantities, both directions, three airflows), some under light, two cold ones with dew."""
    wide = wide_plan()
    at_20 = [*wide[10:15], *wide[25:]]
    runs = [replace(run, extra=LIGHT) if i % 3 == 0 else run for i, run in enumerate(at_20)]
    runs += [wide[0], wide[1], wide[20], wide[21]]  # humidity shocks at 0 and 40 degC
    runs += [Shock(f"dew {flow:.0f}", Air(2.0, 60.0), Air(20.0, 70.0), flow) for flow in (4.0, 8.0)]
    return [replace(run, id=f"{i:04d}") for i, run in enumerate(runs, 1)]


def record(folder, seed, effects=(), tier=SMOOTH, plan=None, **changes):
    """A campaign of random sensors with `effects` hidden, `changes` made to what is true of them."""
    rng = np.random.default_rng(seed)
    truth = replace(draw_truth(rng, tier, effects), **changes)
    return read_campaign(simulate_campaign(truth, plan or small_plan(), rng, folder))


def logged(folder, runs, start_s=None):
    """A campaign of a probe in logs (times [s], readings [degC]) of which nothing else is known, but for the start."""
    for run, log in enumerate(runs, 1):
        home = folder / "runs" / f"{run:04d}"
        home.mkdir(parents=True)
        np.savetxt(home / "imet.csv", np.column_stack(log), "%.3f", ",", header="time_s,temperature_c", comments="")
        transfer = {} if start_s is None else {"transfer": {"start_s": start_s}}
        (home / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": home.name} | transfer))
    head = {"format": "shock-campaign/1", "name": "lags", "sensors": {"imet": {"kind": "a probe", "body": "lumped"}}}
    (folder / "campaign.json").write_text(json.dumps(head))
    return read_campaign(folder)
