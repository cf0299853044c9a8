"""shockrig characterize: right within its uncertainties, whole folders or none, and every part that can be had."""

import contextlib
import io
import json
import shutil
from functools import partial
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest

from shockrig.analysis.characterize import part_fit
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import extension_of, read_extension
from shockrig.analysis.estimate.channel import LeftOut
from shockrig.analysis.estimate.fit_starts import RATE_BOUNDS_PER_S, Optimum
from shockrig.analysis.estimate.gather import why_none
from shockrig.analysis.estimate.model import Held
from shockrig.analysis.physics.modes import response_times, sphere_core, sphere_core_biot
from shockrig.files.campaign import read_campaign
from shockrig.files.errors import InputError
from shockrig.files.profile import StatedEffect, Uncertain, read_profile
from shockrig.protocols.cli import main
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.plans import standard_plan
from shockrig.rig.virtual.truth import ROUGH, SMOOTH, Hidden, draw_truth, with_effects

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "data" / "examples"
TRUTH = json.loads((EXAMPLES / "truth.json").read_text())


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """The command run once on the plain example: (what it left, what it printed, what went to standard error)."""
    out, printed, progress = tmp_path_factory.mktemp("characterize") / "out", io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(progress):
        assert main(["characterize", str(EXAMPLES / "plain-rough"), "--out", str(out), "--seed", "3"]) == 0
    return out, printed.getvalue(), progress.getvalue()


@pytest.fixture(scope="module")
def written(command):
    return command[0]


def test_the_example_of_another_program_is_recovered(written):
    truth, profile = TRUTH["plain-rough"], read_profile(written / "profile.json")
    alpha = profile.temperature.thermal_diffusivity_m2_s
    assert alpha.value == pytest.approx(truth["thermal_diffusivity_m2_s"], rel=0.005)
    assert abs(alpha.value - truth["thermal_diffusivity_m2_s"]) < 3 * alpha.standard_uncertainty
    assert [round(r.ambient_temperature_c) for r in profile.humidity.diffusivity_table] == [0, 10, 20, 30, 40, 50, 60]
    for row in profile.humidity.diffusivity_table:
        true = truth["diffusivity_m2_s"][str(round(row.ambient_temperature_c))]
        assert abs(row.diffusivity_m2_s - true) < 3 * row.standard_uncertainty
        if row.runs > 1:
            assert row.diffusivity_m2_s == pytest.approx(true, rel=0.005)
    assert profile.temperature.noise_k == pytest.approx(truth["noise_k"], rel=0.1)
    assert profile.humidity.noise_percent == pytest.approx(truth["noise_percent"], rel=0.1)
    assert profile.temperature.sampling_period_s == pytest.approx(0.1, abs=1e-3)


def test_the_folder_holds_profile_table_plots_and_a_page_that_needs_nothing_else(written):
    names = {file.name for file in written.iterdir()}
    plots = {f"{n}.png" for n in ("diffusivity", "temperature_runs", "humidity_runs", "temperature_residuals")}
    assert names >= {"profile.json", "diffusivity.csv", "report.html"} | plots
    document = json.loads((written / "profile.json").read_text())
    jsonschema.validate(document, json.loads((ROOT / "data/schemas/sensor-profile-1.json").read_text()))
    table = pd.read_csv(written / "diffusivity.csv")
    assert table["diffusivity_m2_s"].tolist() == pytest.approx(
        [row["diffusivity_m2_s"] for row in document["humidity"]["diffusivity_table"]], rel=1e-5
    )
    page = (written / "report.html").read_text()
    assert "http://" not in page and "https://" not in page and "<script" not in page
    assert page.index("alpha of the bead") < page.index("<img")
    left_out = document["provenance"]["left_out"]
    assert {entry["reason"] for entry in left_out} and all(entry["run"] in page for entry in left_out)
    used = document["provenance"]["runs_used"]["temperature"]
    assert len(used) + sum(e["channel"] == "temperature" for e in left_out) == 33


def test_the_searches_may_end_far_off(monkeypatch):
    """The fit begins from whichever left less, and finds its way from the edge of the rates."""

    def astray(misfit, *_):
        edge = float(np.log(RATE_BOUNDS_PER_S[0]))
        return Optimum(edge, float(misfit(np.array([edge]))[0]), 1)

    def alpha():
        return characterize(campaign, 3, channels=["temperature"]).temperature.rows[0].diffusivity_m2_s

    campaign = read_campaign(EXAMPLES / "plain-rough")
    stated = alpha()
    for search in ("evolve", "descend"):
        with monkeypatch.context() as patch:
            patch.setattr(part_fit, search, astray)
            assert alpha() == pytest.approx(stated, rel=1e-6)
    monkeypatch.setattr(part_fit, "evolve", astray)
    monkeypatch.setattr(part_fit, "descend", astray)
    assert alpha() == pytest.approx(stated, rel=1e-6)


def test_it_prints_alpha_the_table_and_where_the_report_is(command):
    written, out, err = command
    profile = json.loads((written / "profile.json").read_text())
    assert f"alpha = ({profile['temperature']['thermal_diffusivity_m2_s']['value'] * 1e8:.4f}" in out
    assert str(written / "report.html") in out
    assert len([line for line in out.splitlines() if "±" in line]) == 9  # alpha, its times, D at seven ambients
    assert "differential evolution" in err and "differential evolution" not in out
    assert profile["provenance"]["seed"] == 3


@pytest.mark.parametrize(
    ("tier", "seed"), [(SMOOTH, 101), (ROUGH, 102), pytest.param(ROUGH, 103, marks=pytest.mark.trial)]
)
def test_plain_worlds_come_back(tmp_path, tier, seed):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, tier)
    result = characterize(read_campaign(simulate_campaign(truth, standard_plan(), rng, tmp_path / "c")))
    (bead,) = result.temperature.rows
    rows = [(bead, truth.thermal_diffusivity_m2_s)]
    rows += [(r, float(truth.diffusivity_m2_s(r.ambient_c))) for r in result.humidity.rows if len(r.runs) > 1]
    assert len(rows) == 6
    for row, true in rows:
        assert row.diffusivity_m2_s == pytest.approx(true, rel=0.015)
        assert abs(row.diffusivity_m2_s - true) < 4 * row.standard_uncertainty
    assert result.temperature.explained and result.humidity.explained
    assert result.temperature.disagreement < 0.01


def test_response_times_are_those_of_the_fitted_diffusivity(written):
    profile = read_profile(written / "profile.json")
    rate = profile.temperature.thermal_diffusivity_m2_s.value / profile.temperature.bead_radius_m**2
    r = profile.temperature.response_time_s
    assert (r.t63_s, r.t90_s, r.t98_s) == pytest.approx((0.17091 / rate, 0.30352 / rate, 0.46660 / rate), rel=1e-4)
    for row in profile.humidity.diffusivity_table:
        t98 = row.response_time_s.t98_s
        assert t98 * row.diffusivity_m2_s / profile.humidity.film_thickness_m**2 == pytest.approx(1.50037, rel=1e-4)


def test_the_model_of_a_diagnosis_gives_the_materials_alpha(tmp_path):
    """A bead in a real air film: the plain alpha is an effective number far off, the extended one is the material's."""
    rng = np.random.default_rng(31)
    truth = with_effects(draw_truth(rng, SMOOTH), [Hidden("convective_film", {"biot_at_5_m_s": 0.15})])
    folder = simulate_campaign(truth, standard_plan(), rng, tmp_path / "c")
    diagnosis = tmp_path / "diagnosis.json"
    cause = {"effect": "convective_film", "probability": 0.99, "parameters": {"biot_at_5_m_s": {"value": 0.3}}}
    channels = {"temperature": {"verdict": "explained", "causes": [cause]}}
    diagnosis.write_text(json.dumps({"format": "shock-diagnosis/1", "channels": channels}))
    bead = partial(characterize, read_campaign(folder), channels=["temperature"])
    plain = bead().temperature
    extended = bead(extensions=read_extension(diagnosis)).temperature
    assert not plain.explained and extended.explained
    # A value stated far off leads least squares alone to a Biot number of 2.7.
    cause["parameters"]["biot_at_5_m_s"]["value"] = 5.0
    diagnosis.write_text(json.dumps({"format": "shock-diagnosis/1", "channels": channels}))
    astray = bead(extensions=read_extension(diagnosis)).temperature
    assert astray.effects[0].value("biot_at_5_m_s") == pytest.approx(
        extended.effects[0].value("biot_at_5_m_s"), rel=1e-3
    )
    assert plain.rows[0].diffusivity_m2_s < 0.2 * truth.thermal_diffusivity_m2_s
    product = extended.rows[0].diffusivity_m2_s * extended.effects[0].value("biot_at_5_m_s")
    assert product == pytest.approx(0.15 * truth.thermal_diffusivity_m2_s, rel=0.01)
    off = extended.rows[0].diffusivity_m2_s - truth.thermal_diffusivity_m2_s
    assert abs(off) < 3.5 * extended.rows[0].standard_uncertainty
    biot = extended.effects[0].value("biot_at_5_m_s") * _relative_ventilation(6.0)
    rate = extended.rows[0].diffusivity_m2_s / 4e-4**2
    expected = response_times(sphere_core_biot(biot).scaled(rate))
    r = extended.rows[0].response
    assert (r.t63_s, r.t90_s, r.t98_s) == pytest.approx(expected, rel=2e-3)
    assert r.t98_s > 3 * response_times(sphere_core().scaled(rate))[2]


def _relative_ventilation(airflow):
    nusselt = [2 + 0.6 * (v * 8e-4 / 1.5e-5) ** 0.5 * 0.71 ** (1 / 3) for v in (airflow, 5.0)]
    return nusselt[0] / nusselt[1]


def test_what_single_readings_show_is_held_and_not_fitted():
    extension = extension_of(
        [StatedEffect("quantization", {"step": Uncertain(0.2, 0.001)}), StatedEffect("hysteresis")]
    )
    assert extension.structure.held == (Held("quantization", "step", 0.2),)
    assert extension.structure.names == ("hysteresis.rh_percent",)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "line 1: not JSON"),
        ('{"format": "sensor-profile/1"}', "key format"),
        ('{"format": "shock-diagnosis/1", "channels": []}', "key channels"),
        ('{"format": "shock-diagnosis/1", "channels": {}}', "neither temperature nor humidity"),
        (
            '{"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": [{"effect": "magic"}]}}}',
            "channels.humidity.causes[0].effect",
        ),
        (
            '{"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": [{"effect": ["hysteresis"]}]}}}',
            "causes[0].effect: expected the id of an effect, found a list",
        ),
        (
            '{"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": [{"effect": "stem_conduction"}]}}}',
            "does not act on the humidity channel",
        ),
        (
            '{"format": "shock-diagnosis/1", "channels": {"humidity": {"causes": '
            '[{"effect": "hysteresis", "parameters": {"rh_percent": {"value": "much"}}}]}}}',
            "parameters.rh_percent",
        ),
    ],
)
def test_a_bad_diagnosis_is_named_by_its_key_and_nothing_is_written(tmp_path, capsys, content, words):
    (tmp_path / "d.json").write_text(content)
    arguments = ["characterize", str(EXAMPLES / "plain-rough"), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--extend", str(tmp_path / "d.json")]) == 2
    error = capsys.readouterr().err
    assert words in error and "d.json" in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "words"), [("none.json", "No such file"), (".", "Is a directory")])
def test_a_diagnosis_that_is_not_there_is_said_in_plain_words(tmp_path, capsys, name, words):
    arguments = ["characterize", str(EXAMPLES / "plain-rough"), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--extend", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert f"{words}" in error and "give the diagnosis.json of shockrig diagnose" in error and "Errno" not in error
    assert error.count("\n") == 1


def test_bad_campaigns_and_folders_end_with_two_and_one_line(tmp_path, capsys):
    assert main(["characterize", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    assert "no such campaign folder" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["characterize", str(EXAMPLES / "plain-rough"), "--out", str(tmp_path / "file")]) == 2
    assert "is a file" in capsys.readouterr().err
    assert main(["characterize", str(EXAMPLES / "plain-rough"), "--out", str(tmp_path), "--seed", "-1"]) == 2
    assert "--seed" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_one_sensor_alone_is_written_and_the_other_is_explained(tmp_path):
    folder, out = tmp_path / "c", tmp_path / "out"
    shutil.copytree(EXAMPLES / "plain-rough", folder, ignore=shutil.ignore_patterns("hyt.csv"))
    for run in sorted((folder / "runs").iterdir())[12:]:
        shutil.rmtree(run)
    assert main(["characterize", str(folder), "--out", str(out)]) == 0
    profile = read_profile(out / "profile.json")
    assert profile.humidity is None and profile.temperature is not None
    assert "no hyt.csv" in profile.provenance["missing"]["humidity"]
    assert not (out / "diffusivity.csv").exists()
    # The first three runs are isothermal: nothing moves the bead in them.
    for run in sorted((folder / "runs").iterdir())[3:]:
        shutil.rmtree(run)
    with pytest.raises(InputError, match="temperature: none of 3 runs can be used: no temperature step"):
        characterize(read_campaign(folder))


def test_a_bench_with_effects_is_sent_to_the_diagnosis(tmp_path, capsys):
    main(["characterize", str(EXAMPLES / "ordinary-bench"), "--out", str(tmp_path / "out")])
    assert "run shockrig diagnose" in capsys.readouterr().out
    assert "run shockrig diagnose" in (tmp_path / "out" / "report.html").read_text()
    # The film's D survives the slow transfer within its (enlarged) uncertainty.
    for row in read_profile(tmp_path / "out" / "profile.json").humidity.diffusivity_table:
        true = TRUTH["ordinary-bench"]["diffusivity_m2_s"][str(round(row.ambient_temperature_c))]
        assert abs(row.diffusivity_m2_s - true) < 3 * row.standard_uncertainty


def test_what_keeps_most_runs_from_being_used_is_said_first():
    left_out = [LeftOut(f"{n}", "humidity", reason) for n, reason in enumerate("abcd" + 9 * "e" + 3 * "d")]
    said = why_none(left_out)
    assert said == "none of 16 runs can be used: e (9 runs); d (4 runs); a (1 run); and 2 other reasons, of 2 runs"
