"""Other people's benches: their integrators against closed forms (Carslaw and Jaeger 1959; Crank 1975), and what they
write."""

import json

import numpy as np
import pytest
from foreign_lab import (
    KINDS,
    Arrival,
    Lab,
    LabLogger,
    LabReference,
    LabRun,
    Written,
    ideal_step,
    make_body,
    one_approach,
    ramp,
    record,
    steps_of,
    two_stage,
)
from scipy.special import jn_zeros, jv

from shockrig.files.campaign import read_campaign
from shockrig.rig.bench_errors import BenchError

OF_A_STEP = 1e-4
QUIET = LabLogger(period_s=0.1, rounding=0.0, white=0.0)
N = np.arange(200)
BETA = jn_zeros(0, 200)


def series(kind, tau):
    """Share of a unit step at dimensionless times tau (n,) = rate t, surface held at the air."""
    t = np.asarray(tau, dtype=float)[:, None]
    n = N + 1
    if kind == "sphere":
        return 1 + 2 * ((-1.0) ** n * np.exp(-((n * np.pi) ** 2) * t)).sum(axis=1)
    if kind == "sphere_mean":
        return 1 - 6 / np.pi**2 * (np.exp(-((n * np.pi) ** 2) * t) / n**2).sum(axis=1)
    if kind == "cylinder":
        return 1 - 2 * (np.exp(-(BETA**2) * t) / (BETA * jv(1, BETA))).sum(axis=1)
    if kind == "cylinder_mean":
        return 1 - 4 * (np.exp(-(BETA**2) * t) / BETA**2).sum(axis=1)
    odd = (2 * N + 1) * np.pi / 2
    if kind == "plate":
        return 1 - 2 * ((-1.0) ** N / odd * np.exp(-(odd**2) * t)).sum(axis=1)
    if kind == "film":
        return 1 - 2 * (np.exp(-(odd**2) * t) / odd**2).sum(axis=1)
    return 1 - np.exp(-t[:, 0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("t63_s", [0.05, 3.0, 500.0])
def test_body_follows_its_series(kind, t63_s):
    body = make_body(kind, t63_s)
    time = t63_s * np.geomspace(0.05, 20.0, 200)
    assert np.abs(body.step(time) - series(kind, body.rate_per_s * time)).max() < OF_A_STEP
    assert body.weights.sum() == pytest.approx(1.0, abs=1e-9)


def test_landmarks_are_the_published_ones():
    # t50, t63, t90, t98 of the sphere's core and the film's mean, in units of 1 / rate
    published = {"sphere": (0.13879, 0.17091, 0.30352, 0.46660), "film": (0.19673, 0.32025, 0.84809, 1.50037)}
    for kind, known in published.items():
        body = make_body(kind, 7.0)
        found = [body.time_to_s(share) * body.rate_per_s for share in (0.5, 1 - np.exp(-1), 0.9, 0.98)]
        assert found == pytest.approx(known, rel=3e-4)
        assert body.time_to_s(1 - np.exp(-1)) == pytest.approx(7.0, rel=1e-9)


def test_lump_in_a_sheath_is_two_exponentials():
    # C1 x1' = K (x2 - x1), C2 x2' = -K (x2 - x1) + G (u - x2), C1 = K = 1: s^2 C2 + s (C2 + 1 + G) + G = 0
    time_constant, capacity = 0.4, 0.7
    bare_t63 = 1.0  # of a lump with C1 = K = 1
    body = make_body("lumped", 5.0, sheath=(time_constant, capacity))
    conductance = capacity / (time_constant * bare_t63)
    poles = -np.roots([capacity, capacity + 1.0 + conductance, conductance])
    poles = np.sort(poles * body.rate_per_s)
    assert np.sort(body.rates_per_s) == pytest.approx(poles, rel=1e-9)
    slow, fast = poles
    time = np.linspace(0.0, 40.0, 300)
    known = 1 - (fast * np.exp(-slow * time) - slow * np.exp(-fast * time)) / (fast - slow)
    assert np.abs(body.step(time) - known).max() < 1e-9
    assert body.time_to_s(1 - np.exp(-1)) == pytest.approx(5.0)


def test_slow_share_is_a_lag_beside_the_body():
    body = make_body("lumped", 2.0, slow=(0.2, 8.0))
    time = np.linspace(0.0, 60.0, 300)
    fast, slow = body.rates_per_s
    assert fast / slow == pytest.approx(8.0)
    known = 1 - 0.8 * np.exp(-fast * time) - 0.2 * np.exp(-slow * time)
    assert np.abs(body.step(time) - known).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_an_approach_is_what_the_step_response_integrates_to(kind):
    """Duhamel: the reply to any air is the integral of its changes times the step response."""
    body, tau = make_body(kind, 2.0), 5.0
    time = np.linspace(1.5, 30.0, 8)
    shown = one_approach(1.0, 10.0, 30.0, tau).shown_by(body, time)
    later = np.linspace(0.0, 1.0, 4001)
    for at, reply in zip(time - 1.0, shown, strict=True):
        s = at * later**2  # dense where the chamber is fast
        rate = np.exp(-s / tau) / tau
        known = 10.0 + 20.0 * np.trapezoid(series_or_zero(kind, body.rate_per_s * (at - s)) * rate, s)
        assert reply == pytest.approx(known, abs=20.0 * OF_A_STEP)


def series_or_zero(kind, tau):
    """The series, and at times too short for its terms its limit, zero of the core or the square root of a mean."""
    shown = series(kind, np.maximum(tau, 1e-4))
    return np.where(tau > 1e-4, shown, shown * np.sqrt(np.maximum(tau, 0.0) / 1e-4))


def test_a_lag_in_every_air_against_its_closed_form():
    body, start = make_body("lumped", 4.0), 3.0
    time = np.linspace(0.0, 60.0, 601)
    since = np.maximum(time - start, 0.0)
    tau = 4.0
    assert np.abs(ideal_step(start, 0, 1).shown_by(body, time) - (1 - np.exp(-since / tau))).max() < 1e-10
    length = 7.0

    def integral(t):
        t = np.maximum(t, 0.0)
        return t - tau * (1 - np.exp(-t / tau))

    known = (integral(since) - integral(since - length)) / length
    assert np.abs(ramp(start, 0, 1, length).shown_by(body, time) - known).max() < 1e-10

    def approach(slow):
        return 1 - (slow * np.exp(-since / slow) - tau * np.exp(-since / tau)) / (slow - tau)

    known = 0.7 * approach(2.0) + 0.3 * approach(30.0)
    assert np.abs(two_stage(start, 0, 1, 2.0, 30.0, 0.3).shown_by(body, time) - known).max() < 1e-5
    both = steps_of([ideal_step(3.0, 0, 1), ideal_step(20.0, 1, -1)]).shown_by(body, time)
    known = 1 - np.exp(-since / tau) - 2 * (1 - np.exp(-np.maximum(time - 20.0, 0) / tau))
    assert np.abs(both - known).max() < 1e-10


def test_body_refuses_a_kind_it_does_not_know():
    with pytest.raises(ValueError, match="cube.*expected one of sphere"):
        make_body("cube", 1.0)


def bench(channel="temperature", **changed):
    plan = (LabRun(40.0, 20.0, 12.5, 60.0), LabRun(20.0, 40.0, 31.0, 80.0))
    return Lab(channel, make_body("plate", 3.0), Arrival(), changed.pop("logger", QUIET), plan, **changed)


def test_a_campaign_says_only_what_the_lab_wrote_down(tmp_path):
    record(bench(written=Written(start=False, airs=False, airflow=False)), 1, tmp_path / "bare")
    run = json.loads((tmp_path / "bare/runs/0001/run.json").read_text())
    assert set(run) == {"format", "id"}
    truth = record(bench(written=Written(body="plate")), 1, tmp_path / "full")
    campaign = read_campaign(tmp_path / "full")
    assert campaign.sensors["imet"]["body"] == "plate"
    for run, start in zip(campaign.runs, truth.start_s, strict=True):
        assert run.start_s == pytest.approx(start, abs=0.05) and run.start_s != start
        assert run.airflow_m_s == 5.0 and run.source.temperature_c is not None
        assert run.imet is not None and run.hyt is None
    assert "t63" not in "".join(p.read_text() for p in (tmp_path / "full").rglob("*.json"))


def test_readings_are_the_body_at_the_stamps(tmp_path):
    truth = record(bench(channel="humidity"), 5, tmp_path / "c")
    for run, start, step in zip(read_campaign(tmp_path / "c").runs, truth.start_s, ((40, 20), (20, 40)), strict=True):
        assert run.imet is None
        rate = truth.rate_per_s * np.maximum(run.hyt.time_s - start, 0.0)
        shown = np.where(rate > 1e-3, series("plate", np.maximum(rate, 1e-3)), 0.0)
        known = step[0] + (step[1] - step[0]) * shown
        assert np.abs(run.hyt.values["humidity_percent"] - known).max() < 20 * OF_A_STEP


def test_noise_is_as_loud_and_as_long_as_asked_for(tmp_path):
    logger = LabLogger(period_s=0.5, rounding=0.0, white=0.03, correlated=0.04, correlation_time_s=2.0, lost=0.1)
    plan = (LabRun(20.0, 20.0, 10.0, 20_000.0),)
    record(Lab("temperature", make_body("lumped", 1.0), Arrival(), logger, plan), 3, tmp_path / "c")
    trace = read_campaign(tmp_path / "c").runs[0].imet
    noise = trace.values["temperature_c"] - 20.0
    assert noise.std() == pytest.approx(0.05, rel=0.03)
    assert trace.time_s.size == pytest.approx(0.9 * 40_000, rel=0.01)
    next_to = np.flatnonzero(np.isclose(np.diff(trace.time_s), 0.5))
    known = 0.04**2 * np.exp(-0.5 / 2.0)
    assert np.mean(noise[next_to] * noise[next_to + 1]) == pytest.approx(known, rel=0.1)


def test_rounded_readings_lie_on_their_steps(tmp_path):
    record(bench(logger=LabLogger(0.1, 0.0625, 0.01)), 3, tmp_path / "c")
    value = read_campaign(tmp_path / "c").runs[0].imet.values["temperature_c"]
    assert np.abs(value / 0.0625 - np.rint(value / 0.0625)).max() < 1e-6


def test_measured_air_is_the_course_behind_the_references_own_lag(tmp_path):
    reference = LabReference(2.0, 0.0, LabLogger(0.25, 0.0, 0.0))
    made = bench(reference=reference, written=Written(start=False, airs=False, airflow=False))
    record(made, 1, tmp_path / "c")
    folder = tmp_path / "c/runs/0001"
    time, air = np.loadtxt(folder / "air.csv", delimiter=",", skiprows=1).T
    known = 20.0 + 20.0 * np.exp(-np.maximum(time - 12.5, 0.0) / 2.0)
    assert np.abs(air - known).max() < 1e-6
    stated = json.loads((folder / "run.json").read_text())["reference"]
    assert stated == {"temperature_time_constant_s": 2.0, "temperature_standard_uncertainty_k": 0.0}


def test_rates_scatter_from_run_to_run_as_asked_for(tmp_path):
    plan = (LabRun(0.0, 1.0, 1.0, 4.0),) * 60
    quiet = LabLogger(0.5, 0.0, 0.0)
    record(Lab("temperature", make_body("lumped", 2.0), Arrival(), quiet, plan, rate_scatter=0.05), 2, tmp_path / "c")
    rates = []
    for run in read_campaign(tmp_path / "c").runs:
        late = run.imet.time_s > 1.5
        rates.append(np.mean(-np.log1p(-run.imet.values["temperature_c"][late]) / (run.imet.time_s[late] - 1.0)))
    assert np.std(np.log(rates)) == pytest.approx(0.05, rel=0.3)
    assert np.mean(rates) == pytest.approx(0.5, rel=0.03)


def test_the_same_seed_gives_the_same_files(tmp_path):
    loud = LabLogger(0.1, 0.01, 0.03, 0.02, 1.0, 0.05)
    for name in "ab":
        record(bench(logger=loud), 9, tmp_path / name)
    record(bench(logger=loud), 10, tmp_path / "c")
    text = {n: (tmp_path / n / "runs/0002/imet.csv").read_text() for n in "abc"}
    assert text["a"] == text["b"] != text["c"]
    with pytest.raises(BenchError, match="exists already"):
        record(bench(), 9, tmp_path / "a")
    with pytest.raises(BenchError, match="no runs"):
        record(Lab("humidity", make_body("film", 1.0), Arrival(), loud, ()), 9, tmp_path / "d")
