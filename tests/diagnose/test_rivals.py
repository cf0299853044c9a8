"""The rivals of benchmarks/rivals.py find what closed forms put into files, and predict runs that they never saw."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(BENCHMARKS)
    rivals = importlib.import_module("rivals")
    records = importlib.import_module("records")

NOISE = 0.02


def write(folder, rng, shown, known=True, runs=4, air=None, channel="temperature"):
    """A campaign whose reading is source + step * shown(time since the start)."""
    file, column = records.COLUMN[channel]
    starts = []
    for i in range(runs):
        run = folder / "runs" / f"{i:04d}"
        run.mkdir(parents=True)
        start, ends = rng.uniform(8, 30), ((40.0, 20.0), (20.0, 40.0))[i % 2]
        starts.append(start)
        time = np.arange(rng.uniform(0, 0.25), start + 60.0, 0.25)
        value = ends[0] + (ends[1] - ends[0]) * shown(time - start) + NOISE * rng.standard_normal(time.size)
        np.savetxt(run / file, np.column_stack([time, value]), "%.5f", ",", header=f"time_s,{column}", comments="")
        head = {"format": "shock-run/1", "id": run.name}
        if known:
            head |= {"source": {column: ends[0]}, "destination": {column: ends[1]}, "transfer": {"start_s": start}}
        if air is not None:
            beside = np.arange(0.0, start + 60.0, 0.2)
            trace = ends[0] + (ends[1] - ends[0]) * air(beside - start)
            rows = np.column_stack([beside, trace])
            np.savetxt(run / "air.csv", rows, "%.5f", ",", header=f"time_s,{column}", comments="")
        (run / "run.json").write_text(json.dumps(head))
    (folder / "campaign.json").write_text(json.dumps({"format": "shock-campaign/1"}))
    return starts


def fitted(folder, name, channel="temperature"):
    return rivals.fit_rival(rivals.models(channel)[name], records.read_records(folder, channel), channel)


def lag(tau, dead=0.0):
    return lambda t: -np.expm1(-np.maximum(t - dead, 0.0) / tau)


@pytest.mark.parametrize("known", [True, False])
def test_one_lag(tmp_path, known):
    write(tmp_path, np.random.default_rng(1), lag(3.0, 0.4), known)
    found = fitted(tmp_path, "one lag")
    assert np.exp(found.parameters[0]) == pytest.approx(3.0, rel=5e-3)
    assert found.dead_s == (pytest.approx(0.4, abs=0.02) if known else 0.0)
    assert found.train_rmse == pytest.approx(NOISE, rel=0.1)
    assert found.t63_s == pytest.approx(3.0, rel=5e-3)


def test_two_lags_in_series(tmp_path):
    def shown(t):
        t = np.maximum(t, 0.0)
        return 1 - (5.0 * np.exp(-t / 5.0) - 1.5 * np.exp(-t / 1.5)) / 3.5

    write(tmp_path, np.random.default_rng(2), shown)
    found = fitted(tmp_path, "two lags")
    assert sorted(1 / found.modes[1]) == pytest.approx([1.5, 5.0], rel=0.03)
    assert found.train_rmse == pytest.approx(NOISE, rel=0.1)
    assert fitted(tmp_path, "one lag").train_rmse > 3 * NOISE


def test_two_exponentials(tmp_path):
    write(tmp_path, np.random.default_rng(3), lambda t: 0.7 * lag(1.5)(t) + 0.3 * lag(12.0)(t))
    found = fitted(tmp_path, "two exponentials")
    weights, rates = found.modes
    assert 1 / rates == pytest.approx([1.5, 12.0], rel=0.03)
    assert weights[1] == pytest.approx(0.3, abs=0.01)
    assert found.train_rmse == pytest.approx(NOISE, rel=0.1)


@pytest.mark.parametrize(("channel", "t63"), [("temperature", 0.17091), ("humidity", 0.32025)])
def test_ideal_body(tmp_path, channel, t63):
    n = np.arange(100)

    def shown(t):
        tau = np.maximum(t, 1e-3)[:, None] / 20.0
        if channel == "temperature":
            s = 1 + 2 * ((-1.0) ** (n + 1) * np.exp(-(((n + 1) * np.pi) ** 2) * tau)).sum(axis=1)
        else:
            k = (2 * n + 1) * np.pi / 2
            s = 1 - 2 * (np.exp(-(k**2) * tau) / k**2).sum(axis=1)
        return np.where(t > 0, s, 0.0)

    write(tmp_path, np.random.default_rng(4), shown, channel=channel)
    found = fitted(tmp_path, "ideal body", channel)
    assert found.t63_s == pytest.approx(20.0 * t63, rel=5e-3)
    assert found.train_rmse == pytest.approx(NOISE, rel=0.1)


def test_a_measured_air_drives_the_rivals(tmp_path):
    chamber, tau = 6.0, 4.0

    def shown(t):
        t = np.maximum(t, 0.0)
        return 1 - (chamber * np.exp(-t / chamber) - tau * np.exp(-t / tau)) / (chamber - tau)

    write(tmp_path, np.random.default_rng(5), shown, known=False, air=lag(chamber))
    found = fitted(tmp_path, "one lag")
    assert np.exp(found.parameters[0]) == pytest.approx(tau, rel=0.01)
    assert found.train_rmse == pytest.approx(NOISE, rel=0.1)


def test_runs_that_took_no_part_are_predicted_to_the_noise_by_the_true_model_alone(tmp_path):
    write(tmp_path, np.random.default_rng(6), lambda t: 0.7 * lag(1.5)(t) + 0.3 * lag(12.0)(t), known=False)
    runs = records.read_records(tmp_path, "temperature")
    found = rivals.held_out(runs, "temperature", folds=2)
    assert found.pop(rivals.CHOSEN) == found["two exponentials"]
    assert set(found) == set(rivals.models("temperature"))
    for name, by_run in found.items():
        assert set(by_run) == {r.id for r in runs}
        worst = max(by_run.values())
        assert (worst < 1.15 * NOISE) == (name == "two exponentials"), (name, by_run)


@pytest.mark.parametrize("known", [True, False])
def test_a_held_run_keeps_what_it_states(tmp_path, known):
    """A run whose stated airs are wrong is bent no further than two standard uncertainties."""
    write(tmp_path, np.random.default_rng(7), lag(3.0), known, runs=2)
    for file in tmp_path.glob("runs/*/run.json"):
        head = json.loads(file.read_text())
        if known:
            head["destination"]["temperature_c"] += 1.0
            file.write_text(json.dumps(head))
    record = records.read_records(tmp_path, "temperature")[0]
    _, ends, _ = rivals.place((np.ones(1), np.array([1 / 3.0])), record, 0.0, "temperature")
    assert ends[1] == pytest.approx(record.destination - 0.04 if known else 20.0, abs=0.01)


def test_a_record_that_begins_before_the_sensor_has_settled(tmp_path):
    """In a steady measured air a warm sensor cools: its departure at the first sample is its own, the lag shared."""
    write(tmp_path, np.random.default_rng(8), lag(4.0), known=False, air=lambda t: (t > 0).astype(float), runs=1)
    folder = tmp_path / "runs" / "0001"
    folder.mkdir()
    time = np.arange(0.0, 40.0, 0.25)
    value = 20.0 + 3.0 * np.exp(-time / 4.0)
    columns = {"imet.csv": value, "air.csv": np.full(time.size, 20.0)}
    for file, column in columns.items():
        rows = np.column_stack([time, column])
        np.savetxt(folder / file, rows, "%.5f", ",", header="time_s,temperature_c", comments="")
    (folder / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": "0001"}))
    runs = records.read_records(tmp_path, "temperature")
    found = rivals.fit_rival(rivals.models("temperature")["one lag"], runs[:1], "temperature")
    assert rivals.errors(found, runs[1:])["0001"] < (3.0 * NOISE) ** 2
    wrong = rivals.Fitted(found.model, "temperature", found.parameters + np.log(1.5), found.dead_s, 0.0)
    assert rivals.errors(wrong, runs[1:])["0001"] > (3.0 * NOISE) ** 2
