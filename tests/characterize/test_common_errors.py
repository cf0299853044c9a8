"""What is off in all runs alike: stated, fitted under its prior, counted in every uncertainty, named as no cause."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from benchmark_scripts import benchmark
from small_worlds import record

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.shifts import LARGEST_EXPONENT, airflow_exponent, shifts
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.effects import CATALOGUE, structure_of
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN, Model, Point
from shockrig.analysis.estimate.noise import estimate_noise, whiteners
from shockrig.analysis.estimate.problem import make_problem
from shockrig.files.campaign import read_campaign
from shockrig.files.common_uncertainty import INPUTS, NOTHING_COMMON, ORDINARY_LABORATORY, CommonUncertainty
from shockrig.files.errors import InputError
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import check_bench
from shockrig.rig.virtual.hide import draw_effect

SCHEMA = json.loads((Path(__file__).parents[2] / "data/schemas/shock-campaign-1.json").read_text())
NONE_OFF = dict.fromkeys(INPUTS, 0.0)
falsified = benchmark("common_errors").falsified


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return record(tmp_path_factory.mktemp("common") / "c", 5, tier="rough")


def stating(folder, common):
    (folder / "runs/0001").mkdir(parents=True)
    (folder / "runs/0001/run.json").write_text('{"format": "shock-run/1"}')
    head = {"format": "shock-campaign/1", "name": "x", "sensors": {}, "common_uncertainty": common}
    (folder / "campaign.json").write_text(json.dumps(head))
    return read_campaign(folder), head


def test_what_is_stated_is_read_and_what_is_left_out_is_an_ordinary_laboratorys(tmp_path):
    found, head = stating(tmp_path, {"airflow_percent": 0.6, "trigger_offset_s": None})
    jsonschema.validate(head, SCHEMA)
    assert found.common.airflow_percent == 0.6
    assert found.common.trigger_offset_s == ORDINARY_LABORATORY.trigger_offset_s
    assert found.common.by_default == set(INPUTS) - {"airflow_percent"}
    assert stating(tmp_path / "nothing", None)[0].common is None


@pytest.mark.parametrize(
    ("common", "said"),
    [
        ({"airflow_percent": "good"}, "key common_uncertainty.airflow_percent: expected a finite number"),
        ({"trigger_offset_s": -0.01}, "key common_uncertainty.trigger_offset_s: -0.01 cannot be"),
        ({"trigger_offset_s": 100.0}, "is it in milliseconds"),
        ([1], "key common_uncertainty: expected an object"),
    ],
)
def test_a_statement_that_cannot_be_is_refused_by_its_key(tmp_path, common, said):
    with pytest.raises(InputError, match=r"campaign\.json") as error:
        stating(tmp_path, common)
    assert said in str(error.value)


def test_the_virtual_bench_states_that_nothing_common_is_off(campaign):
    assert campaign.common == NOTHING_COMMON
    assert not campaign.common.by_default
    jsonschema.validate(json.loads((campaign.path / "campaign.json").read_text()), SCHEMA)


def test_a_bench_file_states_what_its_campaigns_will():
    content = tomllib.loads((Path(__file__).parents[2] / "data/benches/virtual.toml").read_text())
    assert check_bench(content, "b.toml").common == {}
    stated = {"airflow_percent": 2.0, "trigger_offset_s": 0.005}
    assert check_bench(content | {"common_uncertainty": stated}, "b.toml").common == stated
    for wrong, said in (({"airflow": 2.0}, "unknown key 'airflow'"), ({"clock_ppm": -1}, "-1 cannot be")):
        with pytest.raises(BenchError, match=said):
            check_bench(content | {"common_uncertainty": wrong}, "b.toml")


def test_a_campaign_that_states_nothing_is_fitted_as_one_without_common_errors(campaign):
    for name in ("temperature", "humidity"):
        models = [Model(build_channel(replace(campaign, common=common), name)) for common in (None, NOTHING_COMMON)]
        assert [model.names for model in models] == [("ln rate",) * model.channel.rates for model in models]


@pytest.mark.parametrize(("name", "air"), [("temperature", "air_temperature_k"), ("humidity", "air_humidity_percent")])
def test_a_common_error_moves_every_run_as_the_input_itself_would(campaign, name, air):
    channel = build_channel(replace(campaign, common=ORDINARY_LABORATORY), name)
    model = Model(channel)
    assert model.names[-2:] == ("trigger_offset_s", air)
    late_s, off = 0.013, 0.4
    theta = model.start(np.full(channel.rates, -0.5))
    theta[model.behind] = late_s, off
    conditions = channel.conditions
    moved = {field: getattr(conditions, field) + off for field in channel.quantity.air_fields}
    truly = replace(channel, time_s=channel.time_s - late_s, conditions=replace(conditions, **moved))
    at_rest = Model(truly).start(np.full(channel.rates, -0.5))
    expected = Model(truly).predict(Point(at_rest, truly.at_rest()))
    assert model.predict(Point(theta, channel.at_rest())) == pytest.approx(expected, abs=1e-9)


def test_runs_without_a_trigger_or_airs_do_not_share_their_errors(campaign):
    channel = build_channel(replace(campaign, common=ORDINARY_LABORATORY), "temperature")
    unknown = np.arange(channel.runs) % 2 == 0
    air = replace(channel.conditions, start_known=~unknown, airs_known=~unknown)
    for one in Model(replace(channel, conditions=air)).shared:
        assert all(where.tolist() == (~unknown).tolist() for where in one.moves.values())


def test_the_fit_finds_a_common_error_and_the_rates_beside_it(campaign):
    """Exact readings of a bench whose trigger is 15 ms late and whose airs are 0.08 K off."""
    channel = build_channel(replace(campaign, common=ORDINARY_LABORATORY), "temperature")
    model, off = Model(channel), (0.015, 0.08)
    theta = model.start(np.array([-0.7]))
    theta[model.behind] = off
    exact = replace(channel, value=model.predict(Point(theta, channel.at_rest()))[0])
    problem = make_problem(exact, whiteners(channel, estimate_noise(channel)))
    found = fit(problem, PLAIN, model.start(np.array([0.2])))
    assert found.theta[0] == pytest.approx(-0.7, abs=3e-3)
    # Under a prior of one standard uncertainty, and with runs that scatter: nearly all of it.
    assert found.theta[model.behind] == pytest.approx(off, rel=0.12)


def test_an_uncertainty_grows_with_what_is_stated_and_never_falls(campaign):
    def uncertainties(common):
        found = characterize(replace(campaign, common=common))
        return np.array([row.standard_uncertainty for c in found.channels().values() for row in c.rows])

    nothing, ordinary = uncertainties(NOTHING_COMMON), uncertainties(ORDINARY_LABORATORY)
    coarse = uncertainties(CommonUncertainty(0.5, 5.0, 20.0, 50.0, 0.05, 1000.0))
    assert (ordinary > nothing * 0.98).all()
    assert (coarse > ordinary).all()
    # D is stated at a temperature: 0.5 K are worth some 3 % a kelvin.
    assert (coarse[1:] > 1.4 * nothing[1:]).all()


def test_a_shift_is_what_fitting_anew_with_the_other_input_gives(tmp_path):
    """The sensitivity by implicit differentiation against the refit, for an airflow under an air film."""
    rng = np.random.default_rng(3)
    recorded = record(tmp_path / "c", 3, [draw_effect(rng, "convective_film")], tier="rough")
    stated = replace(NOTHING_COMMON, airflow_percent=2.0)
    structure = structure_of(["convective_film"])

    def fitted(percent):
        channel = build_channel(falsified(recorded, NONE_OFF | {"airflow_percent": percent}, stated), "temperature")
        problem = make_problem(channel, whiteners(channel, estimate_noise(channel)))
        start = Model(channel, structure).start(np.array([-0.5]))
        return problem, fit(problem, structure, start, adapt_scatter=False, tolerance=1e-9)

    problem, nominal = fitted(0.0)
    expected = fitted(2.0)[1].theta - nominal.theta
    shift = shifts(problem, nominal)["airflow_percent"]
    biot = nominal.model.place("convective_film.biot_at_5_m_s")
    assert abs(shift[biot]) > 0.003
    assert shift[biot] == pytest.approx(expected[biot], rel=0.05)


def test_an_effective_rate_depends_on_the_airflow_as_far_as_runs_leave_open(campaign):
    stated = replace(NOTHING_COMMON, airflow_percent=2.0)
    found = characterize(replace(campaign, common=stated), channels=["temperature"]).temperature
    (part,) = found.parts
    told = airflow_exponent(part.fit)
    assert told < 0.05  # three airflows were recorded, and the bead does not care
    same = replace(part.channel.conditions, airflow_m_s=np.full(part.channel.runs, 5.0))
    model = replace(part.fit.model, channel=replace(part.channel, conditions=same))
    assert airflow_exponent(replace(part.fit, model=model)) == pytest.approx(LARGEST_EXPONENT)
    assert shifts(part.problem, part.fit)["airflow_percent"][0] == pytest.approx(0.02 * told)


def diagnosed(campaign, errors, common, name="temperature"):
    channel = build_channel(falsified(campaign, NONE_OFF | errors, common), name)
    return [cause.effect for cause in diagnose_channel(channel).causes]


@pytest.mark.parametrize(
    ("errors", "stated", "alone"),
    [
        ({"trigger_offset_s": 0.025}, {"trigger_offset_s": 0.010}, "dead_time"),
        pytest.param(
            {"air_temperature_k": 0.2}, {"air_temperature_k": 0.1}, "calibration_error", marks=pytest.mark.trial
        ),
    ],
)
def test_no_cause_is_named_that_a_stated_common_error_explains(campaign, errors, stated, alone):
    assert diagnosed(campaign, errors, None) == [alone]
    assert diagnosed(campaign, errors, replace(NOTHING_COMMON, **stated)) == []


@pytest.mark.trial
def test_a_cause_beyond_what_is_stated_keeps_its_name(campaign):
    stated = replace(NOTHING_COMMON, trigger_offset_s=0.010)
    assert diagnosed(campaign, {"trigger_offset_s": 0.08}, stated) == ["dead_time"]


def test_effects_refuse_what_the_bench_itself_may_be_off_by(campaign):
    stated = CommonUncertainty(air_temperature_k=0.1, trigger_offset_s=0.01, clock_ppm=100.0)
    channel = build_channel(replace(campaign, common=stated), "temperature")
    trials = {
        "dead_time": ({"delay_s": 0.03}, {"delay_s": 0.04}),
        "clock_drift": ({"ppm": -300.0}, {"ppm": 400.0}),
        "calibration_error": ({"gain": 0.005, "offset": 0.0}, {"gain": 0.02, "offset": 0.0}),
    }
    for name, (small, large) in trials.items():
        refused = CATALOGUE[name].candidacy.refused
        assert refused(channel, small, None), name
        assert not refused(channel, large, None), name
    assert not CATALOGUE["calibration_error"].candidacy.refused(
        build_channel(campaign, "temperature"), {"gain": 0.0, "offset": 0.0}, None
    )


@pytest.mark.trial
def test_coverage_benchmark_makes_its_table(tmp_path):
    """One world of the benchmark, with a film in the model: alpha within three standard uncertainties."""
    script = benchmark("common_errors")
    (line, *others) = script.world(61000, True)
    assert abs(line["error"]) < 3 * line["u"]
    assert line["largest_in_truth"]
    assert {one["figure"] for one in others} == {"D"}
    assert "1 rough, air film" in script.table([line, *others])
