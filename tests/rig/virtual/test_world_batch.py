"""Campaigns of the virtual world: what a user reads in the files must be what the truth and the equations say."""

import csv
import dataclasses
import json

import numpy as np
import pytest
from small_worlds import QUIET

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import Protocol, load_protocol
from shockrig.rig.seams import Air
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.effects import KINDS, RH, T
from shockrig.rig.virtual.physics import chains
from shockrig.rig.virtual.physics.moist import humidity_percent, saturation_pressure_hpa
from shockrig.rig.virtual.plans import (
    Shock,
    plan_from_protocol,
    plan_from_runs,
    single_airflow_plan,
    single_direction_plan,
    standard_plan,
    wide_plan,
)
from shockrig.rig.virtual.truth import Hidden, TrueNoise, Truth, draw_truth, with_effects

WARM = Shock("up", Air(10.0, 50.0), Air(30.0, 20.0), 6.0, duration_s=50.0, lead_s=10.037)
COOL = Shock("down", Air(30.0, 20.0), Air(10.0, 60.0), 2.5, duration_s=50.0, lead_s=10.061)
WET = Shock("wet", Air(20.0, 20.0), Air(20.0, 80.0), 6.0, duration_s=50.0, lead_s=10.043)
DRY = Shock("dry", Air(20.0, 80.0), Air(20.0, 20.0), 12.0, duration_s=50.0, lead_s=10.085)
PLAN = [WARM, COOL, WET, DRY]
DEWY = Shock("dewy", Air(5.0, 50.0), Air(30.0, 60.0), duration_s=50.0, lead_s=10.05, extra={"irradiance_w_m2": 800.0})


def ventilation(airflow_m_s):
    """Ranz and Marshall 1952 for a bead of 0.8 mm: 2 + 0.6 Re^1/2 Pr^1/3."""
    return 2 + 0.6 * (airflow_m_s * 8e-4 / 1.5e-5) ** 0.5 * 0.71 ** (1 / 3)


def read(campaign, run):
    """Times since the transfer and columns of both files."""
    folder = campaign / "runs" / run
    start_s = json.loads((folder / "run.json").read_text())["transfer"]["start_s"]
    tables = {}
    for name in ("imet", "hyt"):
        with (folder / f"{name}.csv").open() as file:
            rows = list(csv.DictReader(file))
        tables[name] = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
        tables[name]["since_s"] = tables[name]["time_s"] - start_s
    return tables["imet"], tables["hyt"]


@pytest.fixture
def simulate(tmp_path):
    def make(*effects, truth=QUIET, plan=PLAN, seed=1, **options):
        changed = dataclasses.replace(truth, effects=effects)
        out = tmp_path / f"campaign{len(list(tmp_path.iterdir()))}"
        return simulate_campaign(changed, plan, seed, out, **options)

    return make


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return simulate_campaign(QUIET, [*PLAN, DEWY], 1, tmp_path_factory.mktemp("plain") / "campaign")


def test_plain_temperature_follows_the_series(plain):
    imet, _ = read(plain, "up")
    since, n = imet["since_s"], np.arange(1, 400)
    late = since > 0.02
    fourier = QUIET.thermal_diffusivity_m2_s / QUIET.bead_radius_m**2 * since[late]
    core = 1 + 2 * np.sum((-1.0) ** n * np.exp(-(n**2) * np.pi**2 * fourier[:, None]), axis=1)
    assert np.abs(imet["temperature_c"][late] - (10 + 20 * core)).max() < 20 * 1.5e-4
    assert np.abs(imet["temperature_c"][since < 0] - 10).max() < 1e-4


def test_plain_humidity_is_the_mean_ppmv_at_the_airs_temperature(plain):
    _, hyt = read(plain, "up")
    since, n = hyt["since_s"], 2 * np.arange(2000) + 1
    late = since > 0.02
    fourier = QUIET.diffusivity_m2_s(30.0) / QUIET.film_thickness_m**2 * since[late]
    mean = 1 - 8 / np.pi**2 * np.sum(np.exp(-(n**2) * np.pi**2 * fourier[:, None] / 4) / n**2, axis=1)
    ratio = saturation_pressure_hpa(10.0) / saturation_pressure_hpa(30.0)
    exact = 50 * ratio + (20 - 50 * ratio) * mean
    assert np.abs(hyt["humidity_percent"][late] - exact).max() < 5e-3
    # the die lags the air by first order in plain worlds too
    die = 30 - 20 * np.exp(-np.maximum(since, 0) / QUIET.die_time_constant_s)
    assert np.abs(hyt["temperature_c"] - die).max() < 0.012


NEUTRAL = {
    "finite_transfer": {"duration_s": 0.0},
    "convective_film": {"biot_at_5_m_s": 1e9},
    "vapour_boundary_layer": {"biot_at_5_m_s": 1e9},
    "direction_dependent_diffusivity": {"ratio_drying_to_wetting": 1.0},
    "saturation_clipping": {"limit_percent": 200.0},
    "moving_average": {"samples": 1},
    "stale_samples": {"hold_samples": 1},
    "quantization": {"step": 1e-6},
    "condensation": None,  # has no strength: dew forms or does not
    "die_thermal_lag": None,
    "exchange_temperature": None,
    "series_lag": {"time_constant_s": 1e-6},
}
BESIDE = {"exchange_temperature": "convective_film"}  # what acts on another effect alone


@pytest.mark.parametrize("name", [name for name in KINDS if NEUTRAL.get(name, {}) is not None])
def test_an_effect_of_no_strength_is_no_effect(simulate, plain, name):
    times = {"time_constant_s", "decay_s", "period_s", "onset_s"}
    parameters = {p: 5.0 if p in times else 0.0 for p in KINDS[name].parameters} | NEUTRAL.get(name, {})
    plan = [*PLAN, DEWY]
    same = simulate(Hidden(name, parameters), plan=plan)
    for run in plan:
        for before, after in zip(read(plain, run.id), read(same, run.id), strict=True):
            for column in before:
                assert after[column] == pytest.approx(before[column], abs=2.1e-4), column


STRONG = {
    "finite_transfer": {"duration_s": 0.5},
    "air_relaxation": {
        "fraction": 0.05,
        "time_constant_s": 8.0,
        "room_temperature_c": 24.0,
        "room_humidity_percent": 40.0,
    },
    "convective_film": {"biot_at_5_m_s": 0.12},
    "vapour_boundary_layer": {"biot_at_5_m_s": 5.0},
    "direction_dependent_diffusivity": {"ratio_drying_to_wetting": 0.8},
    "concentration_dependent_diffusivity": {"slope_per_unit_activity": 0.5},
    "slow_relaxation": {"fraction": 0.08, "time_constant_s": 20.0},
    "stem_conduction": {"fraction": 0.05, "time_constant_s": 9.0},
    "self_heating": {"rise_k_at_5_m_s": 0.3},
    "die_thermal_lag": {},
    "hysteresis": {"rh_percent": 1.0},
    "calibration_error": {"gain": 0.01, "offset": 0.3},
    "saturation_clipping": {"limit_percent": 75.0},
    "dead_time": {"delay_s": 0.3},
    "moving_average": {"samples": 8},
    "stale_samples": {"hold_samples": 4},
    "quantization": {"step": 0.2},
    "radiative_heating": {"kelvin_per_w_m2_at_5_m_s": 5e-4},
    "evaporative_cooling": {"depression_k": 0.3, "time_constant_s": 20.0},
    "clock_drift": {"ppm": 10000.0},
    "condensation": {"drying_time_s": 5.0},
    "wall_radiation": {"rise_k_at_10_k": 0.2, "wall_temperature_c": 22.0},
    "calibration_temperature": {"percent_per_k": 0.05},
    "series_lag": {"time_constant_s": 3.0},
    "unknown_air_cycling": {"amplitude_k": 0.2, "period_s": 9.0},
    "unknown_chamber_overshoot": {"fraction": 0.05, "decay_s": 5.0, "period_s": 8.0},
    "unknown_rate_with_temperature": {"per_kelvin": 0.01},
    "unknown_log_creep": {"fraction": 0.01, "onset_s": 2.0},
    "unknown_sorption_heat": {"kelvin_s_per_percent": 0.08},
    "unknown_run_drift": {"per_run": 0.05},
    "unknown_gain_drift": {"per_minute": 0.02},
    "unknown_interference": {"amplitude": 0.1, "hum_hz": 1.3, "burst_share": 0.05},
}


def test_every_effect_has_a_strength_here():
    assert set(STRONG) == set(KINDS) - set(BESIDE), "each effect has a line in STRONG"


@pytest.mark.parametrize("name", [name for name in KINDS if name not in BESIDE])
def test_an_effect_acts_in_its_channels_and_in_no_other(simulate, plain, name):
    plan = [*PLAN, DEWY]
    changed = simulate(Hidden(name, STRONG[name]), plan=plan)
    largest = {T: 0.0, RH: 0.0}
    for run in plan:
        (imet, hyt), (imet2, hyt2) = read(plain, run.id), read(changed, run.id)
        largest[T] = max(largest[T], np.abs(imet2["temperature_c"] - imet["temperature_c"]).max())
        largest[RH] = max(largest[RH], np.abs(hyt2["humidity_percent"] - hyt["humidity_percent"]).max())
    for channel, size in largest.items():
        if channel in KINDS[name].channels:
            assert size > 0.05, channel
        else:
            assert size < 2e-4, channel


def test_known_sizes_of_the_steady_effects(simulate):
    imet, hyt = read(simulate(Hidden("calibration_error", {"gain": 0.01, "offset": 0.3})), "up")
    assert imet["temperature_c"][-1] == pytest.approx(30 * 1.01 + 0.3, abs=2e-3)
    assert hyt["humidity_percent"][-1] == pytest.approx(20 * 1.01 + 0.3, abs=2e-2)
    _, wet = read(simulate(Hidden("hysteresis", {"rh_percent": 1.0})), "wet")
    assert wet["humidity_percent"][0] == pytest.approx(20.0, abs=1e-3)
    assert wet["humidity_percent"][-1] == pytest.approx(79.0, abs=2e-2)
    _, dry = read(simulate(Hidden("hysteresis", {"rh_percent": 1.0})), "dry")
    assert dry["humidity_percent"][-1] == pytest.approx(21.0, abs=2e-2)
    heated = simulate(Hidden("self_heating", {"rise_k_at_5_m_s": 0.3}))
    slow, fast = read(heated, "down")[0], read(heated, "dry")[0]
    assert slow["temperature_c"][-1] - 10 == pytest.approx(0.3 * ventilation(5.0) / ventilation(2.5), rel=1e-3)
    assert fast["temperature_c"][-1] - 20 == pytest.approx(0.3 * ventilation(5.0) / ventilation(12.0), rel=1e-3)


def test_ramp_and_dead_time_are_late_by_what_they_say(simulate):
    def lateness(campaign):
        """Area between the destination and the reading, over the step: first moment of the response, s."""
        imet, _ = read(campaign, "up")
        dense = np.arange(-5.0, 39.0, 0.001)
        return np.trapezoid(30.0 - np.interp(dense, imet["since_s"], imet["temperature_c"]), dense) / 20 - 5.0

    plain = lateness(simulate())
    assert plain == pytest.approx(QUIET.bead_radius_m**2 / (6 * QUIET.thermal_diffusivity_m2_s), abs=2e-3)
    assert lateness(simulate(Hidden("finite_transfer", {"duration_s": 0.5}))) - plain == pytest.approx(0.25, abs=2e-3)
    assert lateness(simulate(Hidden("dead_time", {"delay_s": 0.3}))) - plain == pytest.approx(0.3, abs=2e-3)
    film = lateness(simulate(Hidden("convective_film", {"biot_at_5_m_s": 0.5})))
    biot = 0.5 * ventilation(6.0) / ventilation(5.0)
    diffusive_s = QUIET.bead_radius_m**2 / QUIET.thermal_diffusivity_m2_s
    assert film - plain == pytest.approx(diffusive_s / (3 * biot), rel=2e-3)  # energy balance of the whole sphere
    stem = lateness(simulate(Hidden("stem_conduction", {"fraction": 0.05, "time_constant_s": 6.0})))
    assert stem == pytest.approx(0.95 * plain + 0.05 * 6.0, abs=2e-3)


def test_die_lag_reads_a_cold_die_as_moist(simulate):
    """A die 10 K colder than air of 20 degC and 50 %RH reads 45 %RH more."""
    run = Shock("die", Air(-20.0, 50.0), Air(20.0, 50.0), duration_s=80.0, lead_s=10.0)
    truth = dataclasses.replace(QUIET, diffusivity_20c_m2_s=5e-11)
    _, hyt = read(simulate(Hidden("die_thermal_lag"), truth=truth, plan=[run]), "die")
    at = np.argmin(np.abs(hyt["temperature_c"] - 10.0))
    assert hyt["humidity_percent"][at] == pytest.approx(95.0, abs=1.5)


def test_logger_effects_are_seen_in_the_files(simulate):
    noisy = dataclasses.replace(QUIET, temperature_noise=TrueNoise(0.02), humidity_noise=TrueNoise(0.1))
    averaged, _ = read(simulate(Hidden("moving_average", {"samples": 5}), truth=noisy), "wet")
    before = averaged["temperature_c"][10:100] - 20
    assert before.std() == pytest.approx(0.02 / 5**0.5, rel=0.35)
    assert np.corrcoef(before[1:], before[:-1])[0, 1] > 0.5
    _, held = read(simulate(Hidden("stale_samples", {"hold_samples": 4}), truth=noisy), "wet")
    runs = np.diff(np.flatnonzero(np.diff(held["humidity_percent"])))
    assert (runs == 4).all() and (held["stale"] == 0).all()
    coarse, _ = read(simulate(Hidden("quantization", {"step": 0.1}), truth=noisy), "wet")
    assert np.allclose(np.round(coarse["temperature_c"] / 0.1) * 0.1, coarse["temperature_c"], atol=1e-4)


def test_correlated_noise_has_its_size_and_time_constant(simulate):
    truth = dataclasses.replace(QUIET, temperature_noise=TrueNoise(0.0, 0.02, 0.5))
    run = Shock("long", Air(20.0, 50.0), Air(20.0, 50.0), duration_s=300.0)
    imet, _ = read(simulate(truth=truth, plan=[run]), "long")
    noise = imet["temperature_c"] - 20.0
    assert noise.std() == pytest.approx(0.02, rel=0.15)
    assert np.corrcoef(noise[5:], noise[:-5])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.1)


def test_rough_benches_scatter_as_the_contract_says(tmp_path):
    truth = draw_truth(np.random.default_rng(4), "rough")
    plan = [dataclasses.replace(WET, id=str(i), duration_s=12.0, lead_s=10.0) for i in range(150)]
    campaign = simulate_campaign(truth, plan, 3, tmp_path / "c")
    runs = [json.loads((campaign / "runs" / run.id / "run.json").read_text()) for run in plan]
    jitter = np.array([run["transfer"]["start_s"] for run in runs]) - 10.0
    assert jitter.std() == pytest.approx(0.010, rel=0.3)
    samples = sum(len(read(campaign, run.id)[0]["time_s"]) for run in plan)
    assert samples / (150 * 120) == pytest.approx(1 - truth.missing_fraction, abs=0.003)


def test_same_seed_same_files_other_seed_other_files(simulate):
    truth = draw_truth(np.random.default_rng(8), "rough")
    first, again, other = (simulate(truth=truth, seed=s) for s in (5, 5, 6))
    for name in ("run.json", "imet.csv", "hyt.csv"):
        texts = [(c / "runs" / "up" / name).read_text() for c in (first, again, other)]
        assert texts[0] == texts[1] != texts[2]


@pytest.mark.skipif(chains._march is None, reason="march.c was not built")
@pytest.mark.parametrize(
    "names", [(), ("condensation", "finite_transfer"), ("air_relaxation", "series_lag", "unknown_sorption_heat")]
)
def test_steps_made_by_c_and_by_lapack_write_the_same_files(simulate, monkeypatch, names):
    hidden = [Hidden(name, STRONG[name]) for name in names]
    compiled = simulate(*hidden, plan=[WARM, DRY, DEWY])
    monkeypatch.setattr(chains, "_march", None)
    plain = simulate(*hidden, plan=[WARM, DRY, DEWY])
    assert compiled != plain
    for file in (file for file in plain.rglob("*") if file.is_file()):
        assert (compiled / file.relative_to(plain)).read_bytes() == file.read_bytes()


def test_the_truth_stays_out_of_the_campaign(simulate):
    campaign = simulate(Hidden("stem_conduction", {"fraction": 0.05, "time_constant_s": 9.0}))
    for path in campaign.rglob("*"):
        assert path.is_dir() or "stem" not in path.read_text()
    assert "duration_s" not in json.loads((campaign / "runs" / "up" / "run.json").read_text())["transfer"]


def test_measured_and_slowed_transfers_are_stated(simulate):
    ramp = Hidden("finite_transfer", {"duration_s": 0.4})
    slow = dataclasses.replace(WARM, id="slow", transfer_duration_s=2.0)
    for options, expected in (({}, [None, 2.0]), ({"write_duration": True}, [0.4, 2.0])):
        campaign = simulate(ramp, plan=[WARM, slow], **options)
        stated = [json.loads((campaign / "runs" / r / "run.json").read_text())["transfer"] for r in ("up", "slow")]
        assert [s.get("duration_s") for s in stated] == expected


def test_plans():
    plan = wide_plan()
    assert len(plan) == 33 and len({run.id for run in plan}) == 33
    assert {run.airflow_m_s for run in plan} == {2.5, 6.0, 12.0}
    assert {run.airflow_m_s for run in single_airflow_plan()} == {6.0}
    assert all(
        run.source.temperature_c > run.destination.temperature_c
        or run.source.humidity_percent < run.destination.humidity_percent
        for run in single_direction_plan()
    )
    for run in plan:
        if abs(run.source.temperature_c - run.destination.temperature_c) > 15:
            vapour = [
                a.humidity_percent * saturation_pressure_hpa(a.temperature_c) for a in (run.source, run.destination)
            ]
            assert max(vapour) / min(vapour) < 1.25
    wanted = {
        "source": {"temperature_c": 5, "humidity_percent": 30},
        "destination": {"temperature_c": 25, "humidity_percent": 40},
        "airflow_m_s": 3.0,
        "transfer": {"duration_s": 2.0},
    }
    (run,) = plan_from_runs([wanted], first=34)
    assert (run.id, run.source, run.airflow_m_s, run.transfer_duration_s) == ("0034", Air(5.0, 30.0), 3.0, 2.0)
    with pytest.raises(BenchError, match="run 1"):
        plan_from_runs([{"source": {"temperature_c": 5}}])


def test_the_standard_plan_is_the_shipped_protocol():
    plan = standard_plan()
    assert len(plan) == 36 and {run.destination.temperature_c for run in plan} == {0.0, 10.0, 20.0, 30.0, 40.0}
    assert (plan[3].source, plan[3].destination, plan[3].airflow_m_s) == (Air(20.0, 14.0), Air(0.0, 55.0), 6.0)
    assert {run.airflow_m_s for run in plan} == {2.5, 6.0, 12.0}
    # 10 s on the plateau, 30 s before three thermal shocks, and less than another until the transfer; 150 s after it
    # in the cold, where the campaign begins and closes, 70 s at 40 degC
    assert all(10.0 <= run.lead_s % 20.0 < 11.0 for run in plan)
    longer = [run for run in plan if run.lead_s > 30.0]
    assert len(longer) == 3 and all(run.source.temperature_c != run.destination.temperature_c for run in longer)
    assert plan[0].duration_s - plan[0].lead_s == plan[-1].duration_s - plan[-1].lead_s == pytest.approx(150.0)
    assert plan[-2].duration_s - plan[-2].lead_s == pytest.approx(70.0)
    phases = np.sort([run.lead_s % 0.1 for run in plan])
    assert np.diff(phases).max() < 0.01  # the sampling is crossed everywhere
    unknown = load_protocol("standard").runs[0]
    unknown = dataclasses.replace(unknown, source=Air(None, 50.0))
    with pytest.raises(BenchError, match="run 0001: both airs"):
        plan_from_protocol(Protocol("mine", "", (unknown,)))


def test_drawn_sensors_are_in_the_ranges_that_they_state():
    for seed in range(200):
        truth = draw_truth(np.random.default_rng(seed), "rough" if seed % 2 else "smooth")
        assert 0.5 <= 0.4666 * 1.6e-7 / truth.thermal_diffusivity_m2_s <= 2.5
        assert 0.5 <= 0.32025 * 1e-10 / truth.diffusivity_20c_m2_s <= 6.0
        assert 2.0 <= truth.diffusivity_m2_s(40.0) / truth.diffusivity_m2_s(0.0) <= 5.0
        table = truth.diffusivity_m2_s(np.arange(-10.0, 61.0))
        assert (np.diff(table) > 0).all()
        assert Truth.from_json(truth.to_json()) == truth


def test_a_hidden_film_leaves_the_reading_about_as_fast():
    truth = with_effects(QUIET, [Hidden("convective_film", {"biot_at_5_m_s": 0.1})])
    assert truth.thermal_diffusivity_m2_s > 3 * QUIET.thermal_diffusivity_m2_s


def test_refusals(simulate, tmp_path):
    with pytest.raises(BenchError, match="no runs"):
        simulate(plan=[])
    with pytest.raises(BenchError, match="exists already"):
        simulate_campaign(QUIET, PLAN, 1, tmp_path)
    with pytest.raises(BenchError, match="not known"):
        Hidden("magic")
    with pytest.raises(BenchError, match="parameters must be"):
        Hidden("dead_time", {"delay": 1.0})
    with pytest.raises(BenchError, match="channels must be"):
        Hidden("self_heating", {"rise_k_at_5_m_s": 1.0}, (RH,))
    assert humidity_percent(1e4, 20.0, 1013.25) > 0
