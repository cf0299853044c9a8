"""Sensors carried between two places, or two media: exponentials in closed form, at a time constant of each place."""

import json

import numpy as np
import pytest

from shockrig.analysis.diagnose.diagnose import diagnose
from shockrig.analysis.diagnose.gain import folds
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.without_model import runs_elsewhere
from shockrig.files.campaign import read_campaign

NOISE_K = 0.02


def left_of_step(since_s, tau_s, air_s):
    """What of a step a lump lacks, in air that comes to its new state with `air_s`, or at once: two lags in series."""
    own = np.exp(-since_s / tau_s)
    return own if not air_s else (tau_s * own - air_s * np.exp(-since_s / air_s)) / (tau_s - air_s)


def write(folder, runs, period_s, seed=1):
    """A campaign that states nothing but readings; `runs` are (from, to [degC], time constants of sensor and air)."""
    random = np.random.default_rng(seed)
    for i, (before_c, after_c, tau_s, *air) in enumerate(runs, start=1):
        run = folder / "runs" / f"{i:04d}"
        run.mkdir(parents=True)
        start_s = 30.0 * period_s + random.uniform(0.0, period_s)
        time = np.arange(0.0, start_s + 9.0 * tau_s + 60.0 * period_s, period_s)
        left = left_of_step(np.maximum(time - start_s, 0.0), tau_s, *(air or [0.0]))
        shown = after_c + (before_c - after_c) * left
        shown = shown + NOISE_K * random.standard_normal(time.size)
        rows = "".join(f"{t:.6g},{y:.4f}\n" for t, y in zip(time, shown, strict=True))
        (run / "imet.csv").write_text("time_s,temperature_c\n" + rows)
        (run / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": run.name}))
    head = {"format": "shock-campaign/1", "name": "carried", "sensors": {"imet": {"kind": "probe", "body": "lumped"}}}
    (folder / "campaign.json").write_text(json.dumps(head))
    return read_campaign(folder)


def told(campaign):
    (channel,) = diagnose(campaign).channels
    values = {cause.effect: channel.final.values()[cause.effect] for cause in channel.causes}
    return channel, {effect: found for effect, found in values.items() if effect != "quantization"}


@pytest.mark.trial
def test_a_box_with_a_fan_and_a_room_without(tmp_path):
    runs = [(21.0, 5.0, 50.0), (5.0, 21.0, 90.0)] * 4
    channel, found = told(write(tmp_path / "c", runs, 2.0))
    assert set(found) == {"direction_dependent_exchange"}
    ratio, spread = found["direction_dependent_exchange"]["ratio"]
    assert ratio == pytest.approx(90.0 / 50.0, abs=3.0 * spread) and spread < 0.02
    assert channel.verdict == "explained"
    assert channel.gain.before > 5.0 * NOISE_K and channel.gain.after == pytest.approx(NOISE_K, rel=0.05)
    assert np.exp(-channel.final.log_rates) == pytest.approx(90.0, rel=0.01)  # the rate is that of warming


@pytest.mark.parametrize(
    ("runs", "effect"),
    [
        ([(21.0, 5.0, 60.0, 30.0), (5.0, 21.0, 60.0, 0.0)], "slow_air_in_cooling"),
        pytest.param([(21.0, 5.0, 30.0, 0.0), (5.0, 21.0, 30.0, 70.0)], "slow_air_in_warming", marks=pytest.mark.trial),
    ],
)
def test_a_box_whose_air_recovers(tmp_path, runs, effect):
    channel, found = told(write(tmp_path / "c", runs * 4, 2.0))
    assert set(found) == {effect}
    value, spread = found[effect]["time_constant_s"]
    assert value == pytest.approx(max(air_s for *_, air_s in runs), abs=3.0 * spread)
    assert channel.verdict == "explained" and channel.gain.after == pytest.approx(NOISE_K, rel=0.05)
    assert np.exp(-channel.final.log_rates) == pytest.approx(runs[0][2], rel=0.01)


def test_the_same_in_both_places_is_nothing(tmp_path):
    channel, found = told(write(tmp_path / "c", [(21.0, 5.0, 70.0), (5.0, 21.0, 70.0)] * 4, 2.0))
    assert not found and channel.verdict == "adequate"


@pytest.mark.trial
def test_water_and_air(tmp_path):
    runs = [(22.0, 8.0, 1.4), (8.0, 22.0, 40.0), (22.0, 45.0, 1.4), (45.0, 22.0, 40.0)]
    runs += [(22.0, 15.0, 1.4), (15.0, 22.0, 40.0), (22.0, 60.0, 1.4), (60.0, 22.0, 40.0)]
    channel, found = told(write(tmp_path / "c", runs, 0.5))
    assert set(found) == {"other_medium"}
    ratio, spread = found["other_medium"]["ratio"]
    assert ratio == pytest.approx(40.0 / 1.4, abs=3.0 * spread)
    assert channel.gain.before > 1.0 and channel.gain.after < 3.0 * NOISE_K
    assert np.exp(-channel.final.log_rates) == pytest.approx(40.0, rel=0.01)


def test_labels_belong_to_the_runs(tmp_path):
    runs = [(22.0, 8.0, 1.4), (8.0, 22.0, 40.0), (22.0, 45.0, 1.4), (45.0, 22.0, 40.0), (10.0, 22.0, 40.0)]
    channel = build_channel(write(tmp_path / "c", runs, 0.5), "temperature")
    assert channel.conditions.elsewhere.tolist() == [True, False, True, False, False]
    assert channel.select(np.array([2, 3])).conditions.elsewhere.tolist() == [True, False]


def test_no_fold_takes_all_runs_of_a_kind(tmp_path):
    """Plunges that come every third run, as folds do: what their ratio is must be told without those held out."""
    runs = [(22.0, 60.0, 1.4), (60.0, 16.0, 40.0), (16.0, 22.0, 40.0)] * 3
    channel = build_channel(write(tmp_path / "c", runs, 0.5), "temperature")
    plunges = np.arange(9) % 3 == 0
    assert channel.conditions.elsewhere.tolist() == plunges.tolist()
    fold = folds(channel)
    assert np.bincount(fold).tolist() == [3, 3, 3]
    assert sorted(fold[plunges]) == [0, 1, 2]


NOT_RECORDED = np.full(6, np.nan)


@pytest.mark.parametrize(
    ("half_s", "condition", "marked"),
    [
        ([1.0, 1.2, 40.0, 1.1, 50.0, 45.0], NOT_RECORDED, [1, 1, 0, 1, 0, 0]),  # as many of either: the fast ones
        ([1.0, 40.0, 41.0, 1.1, 50.0, 45.0], NOT_RECORDED, [1, 0, 0, 1, 0, 0]),
        ([1.0, 1.2, 40.0, 1.1, 1.0, 45.0], NOT_RECORDED, [0, 0, 1, 0, 0, 1]),
        ([1.0, 1.2, 40.0, 1.1, 1.0, np.nan], NOT_RECORDED, []),  # one alone is no kind
        ([1.0, 1.2, 2.5, 1.1, 1.0, 2.6], NOT_RECORDED, []),  # as airflows make it
        ([1.0, 3.0, 12.0, 40.0, 1.1, 50.0], NOT_RECORDED, []),  # from one to the other by degrees
        ([1.0, 1.2, 40.0, 1.1, 50.0, 45.0], [9.0, 8.0, 0.1, 9.0, 0.2, 0.1], []),  # the airflow explains it
        ([1.0, 1.2, 40.0, 1.1, 50.0, 45.0], [1.0, 1.0, 0.0, 1.0, 0.0, 0.0], []),  # so does the direction
    ],
)
def test_two_kinds_of_runs(half_s, condition, marked):
    found = runs_elsewhere(np.array(half_s), [np.array(condition)])
    assert found.astype(int).tolist() == (marked or [0] * 6)
