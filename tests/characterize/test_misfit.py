"""A plain model that misses what it is fitted to: how uncertain its response time is, and what is said where it has
none."""

import numpy as np
import pytest
from small_worlds import logged

from shockrig.analysis.characterize.budget import budgets
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.estimate.seen import by_themselves
from shockrig.files.errors import InputError


def campaign_of(folder, lags_s, slow=0.15, noise_k=0.005):
    """A probe, a part of whose response follows six times as slowly, in logs of which the start alone is known."""
    random, time, runs = np.random.default_rng(4), np.arange(-40.0, 400.0), []
    late = np.maximum(time, 0.0)
    for run, lag_s in enumerate(lags_s, 1):
        left = (1.0 - slow) * np.exp(-late / lag_s) + slow * np.exp(-late / (6.0 * lag_s))
        value = 20.0 + (30.0 if run % 2 else -15.0) * (1.0 - left) + random.normal(0.0, noise_k, time.size)
        runs.append((time - time[0], value))
    return logged(folder, runs, start_s=40.0)


def t63_s(lag_s, slow=0.15):
    """Of the same, from its closed form on a fine grid."""
    time = np.linspace(0.0, 10.0 * lag_s, 100001)
    left = (1.0 - slow) * np.exp(-time / lag_s) + slow * np.exp(-time / (6.0 * lag_s))
    return float(time[np.argmax(left < np.exp(-1.0))])


def test_a_precise_sensor_that_the_model_misses_has_a_response_time_all_the_same(tmp_path):
    """Residuals of a hundred times the noise say nothing of by how many times a time constant is unknown."""
    lags_s = (19.0, 21.5, 20.0, 18.5, 21.0, 20.0)
    found = characterize(campaign_of(tmp_path, lags_s), channels=["temperature"], quickly=True).temperature
    assert not found.explained and found.rmse > 20.0 * found.noise.standard_deviation
    (row,) = found.rows
    true, stated = float(np.median([t63_s(lag) for lag in lags_s])), row.response
    assert abs(stated.t63_s - true) < 2.0 * stated.standard_uncertainties_s[0] < 0.6 * true


def test_what_a_model_is_off_the_runs_own_times_is_uncertain(tmp_path):
    found = characterize(campaign_of(tmp_path, (20.0,) * 6), channels=["temperature"], quickly=True).temperature
    (row,), (part,) = found.rows, found.parts
    shown = {run: t63 for run, (t63, _, _) in by_themselves(part.channel).items()}
    assert [*shown.values()] == pytest.approx([t63_s(20.0)] * 6, rel=0.03)
    off = abs(np.log(row.response.t63_s / np.median([*shown.values()])))
    assert row.standard_uncertainty / row.diffusivity_m2_s >= 0.999 * off
    assert off > part.fit.covariance[0, 0] ** 0.5
    stated = np.hypot(part.fit.covariance[0, 0] ** 0.5, off) * row.diffusivity_m2_s
    assert row.standard_uncertainty == pytest.approx(stated, rel=1e-6)
    # What follows slowly is met later: by 90 % the plain model is further off, and says so.
    t90_s = np.median([t90 for _, t90, _ in by_themselves(part.channel).values()])
    sure = row.response.standard_uncertainties_s[1] / row.response.t90_s
    assert sure >= abs(np.log(row.response.t90_s / t90_s)) > 1.5 * off
    for budget, u in zip(budgets(found)[1:], row.response.standard_uncertainties_s, strict=False):
        assert budget.standard_uncertainty == pytest.approx(u, rel=1e-4)


def test_runs_that_no_model_joins_are_refused_with_the_times_that_they_show(tmp_path):
    campaign = campaign_of(tmp_path, (1.5, 3.0, 8.0, 20.0, 50.0, 100.0))
    said = r"the runs disagree in alpha by 1\d\d% \(seen in the readings, 63 % of the way takes 1\.9 to 10\d s\)"
    with pytest.raises(InputError, match=said):
        characterize(campaign, channels=["temperature"], quickly=True)


def test_readings_that_are_rounded_coarsely_are_as_noisy_as_that_makes_them(tmp_path):
    """At rest they show no noise at all, beside which every model had been off by a thousand times as much."""
    runs = []
    for run in range(4):
        time = np.arange(-200.0, 600.0)
        value = 20.2 + 19.7 * (run % 2 + (1 - 2 * (run % 2)) * (1.0 - np.exp(-np.maximum(time, 0.0) / 60.0)))
        runs.append((time - time[0], 0.5 * np.round(value / 0.5)))
    found = characterize(logged(tmp_path, runs, start_s=200.0), channels=["temperature"], quickly=True).temperature
    assert found.explained and found.noise.standard_deviation == pytest.approx(0.5 / np.sqrt(12.0), rel=0.05)
    assert found.rows[0].response.t63_s == pytest.approx(60.0, rel=0.02)


def test_errors_of_a_coarse_rounding_come_as_the_signal_crosses_codes(tmp_path):
    """Taken for independent they have a time to 63 % several times as far off, and by more than is stated."""
    off, sure = [], []
    for seed in range(2, 6):
        random, time, runs = np.random.default_rng(seed), np.arange(-120.0, 480.0), []
        for run in range(6):
            cold, warm = random.uniform(5.0, 10.0), random.uniform(30.0, 40.0)
            source, destination = (cold, warm) if run % 2 else (warm, cold)
            value = destination + (source - destination) * np.exp(-np.maximum(time, 0.0) / 60.0)
            runs.append((time - time[0], 0.5 * np.round((value + random.normal(0.0, 0.02, time.size)) / 0.5)))
        campaign = logged(tmp_path / str(seed), runs, start_s=120.0)
        found = characterize(campaign, channels=["temperature"], quickly=True).temperature
        off.append(found.rows[0].response.t63_s - 60.0)
        sure.append(found.rows[0].response.standard_uncertainties_s[0])
    assert np.sqrt(np.mean(np.square(off))) < 0.1
    assert np.sqrt(np.mean((np.array(off) / sure) ** 2)) < 1.2
