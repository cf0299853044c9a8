"""Transfers slowed on purpose: the plain model knows how long these runs took, and no effect has to say it."""

from dataclasses import replace

import numpy as np
import pytest
from small_worlds import QUIET, small_plan

from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Model, Point
from shockrig.files.campaign import read_campaign
from shockrig.rig.virtual.batch import simulate_campaign

SLOWED = (1, 4)  # places in the plan: a humidity shock and a thermal one


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    plan = [replace(run, transfer_duration_s=2.0 if i in SLOWED else None) for i, run in enumerate(small_plan()[:9])]
    return read_campaign(simulate_campaign(QUIET, plan, 1, tmp_path_factory.mktemp("slow") / "c", write_duration=True))


def rate(name):
    if name == "temperature":
        return QUIET.thermal_diffusivity_m2_s / QUIET.bead_radius_m**2
    return float(QUIET.diffusivity_m2_s(20.0)) / QUIET.film_thickness_m**2


@pytest.mark.parametrize("name", ["temperature", "humidity"])
@pytest.mark.parametrize("stated", ["all", "the slowed"])
def test_the_plain_model_has_the_ramps_of_slowed_runs(recorded, name, stated):
    """Quiet sensors at their true rate: what is read is predicted to a few parts in ten thousand of the step."""
    campaign = recorded
    if stated == "the slowed":
        kept = [run if run.duration_s > 1.0 else replace(run, duration_s=None) for run in campaign.runs]
        campaign = replace(campaign, runs=tuple(kept))
    channel = build_channel(campaign, name)
    own = channel.conditions.ramp_own_s
    assert {channel.run_ids[i] for i in np.flatnonzero(np.isfinite(own))} == {f"{i + 1:04d}" for i in SLOWED}
    model = Model(channel)
    theta = np.full(channel.rates, np.log(rate(name)))
    predicted = model.predict(Point(theta, channel.at_rest()))[0]
    keep = (channel.count > 0) & (np.abs(channel.time_s) > 0.15) & channel.isothermal[:, None]
    if name == "temperature":
        keep = (channel.count > 0) & (np.abs(channel.time_s) > 0.15)
    step = np.abs(channel.quantity.air_step(channel.conditions)).max()
    assert np.abs(np.where(keep, channel.value - predicted, 0.0)).max() < 0.004 * step


def test_durations_that_only_scatter_are_not_slowed_on_purpose(recorded):
    runs = tuple(replace(run, duration_s=0.3 + 0.05 * i) for i, run in enumerate(recorded.runs))
    channel = build_channel(replace(recorded, runs=runs), "temperature")
    assert not np.isfinite(channel.conditions.ramp_own_s).any()
    median = np.median([run.duration_s for run in runs])
    assert channel.conditions.ramp_ratio == pytest.approx([run.duration_s / median for run in runs])
