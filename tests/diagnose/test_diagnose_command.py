"""shockrig diagnose: files that others can read, honest sentences, a profile with the material's values, whole or not.

The campaigns come from another solver (data/examples) or from the virtual bench; how well causes are named is tested
elsewhere.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from processes import ended, heard, in_background

from shockrig.analysis.characterize.part_fit import read_extension
from shockrig.analysis.diagnose.diagnose import NO_STEP
from shockrig.analysis.diagnose.race import MOST_FITS
from shockrig.files.campaign import read_campaign
from shockrig.files.numbers import measured
from shockrig.files.profile import read_profile
from shockrig.protocols.cli import main
from shockrig.protocols.reveal import score
from shockrig.rig.virtual.hide import open_seal

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "data" / "schemas"
EXAMPLES = ROOT / "data" / "examples"


@pytest.fixture(scope="module")
def film(demonstrated):
    """A bead behind an air film, as the demonstration diagnoses it: (folder, truth, sealed, printed)."""
    home, printed, _ = demonstrated
    truth, _ = open_seal(home / "campaign.sealed")
    return home / "diagnosis", truth, home / "campaign.sealed", printed


def load(folder, name):
    return json.loads((folder / name).read_text())


def test_the_air_film_is_named_and_the_answer_scores_against_the_seal(film):
    out, truth, sealed, _ = film
    assert score(sealed, out / "diagnosis.json").exact
    cause = load(out, "diagnosis.json")["channels"]["temperature"]["causes"][0]
    found = cause["parameters"]["biot_at_5_m_s"]
    true = truth.effect("convective_film")["biot_at_5_m_s"]
    assert abs(found["value"] - true) < 3 * found["standard_uncertainty"] < 0.5 * true


def test_the_files_keep_to_their_schemas(film):
    out = film[0]
    for name, schema in (("diagnosis.json", "shock-diagnosis-1.json"), ("profile.json", "sensor-profile-1.json")):
        jsonschema.validate(load(out, name), load(SCHEMAS, schema))


def test_the_profile_holds_the_materials_diffusivity_and_the_effect(film):
    out, truth, *_ = film
    profile = read_profile(out / "profile.json")
    alpha = profile.temperature.thermal_diffusivity_m2_s
    assert abs(alpha.value - truth.thermal_diffusivity_m2_s) < 3 * alpha.standard_uncertainty
    assert [e.effect for e in profile.temperature.effects] == ["convective_film"]
    assert profile.humidity.effects == ()
    for row in profile.humidity.diffusivity_table:
        true = float(truth.diffusivity_m2_s(row.ambient_temperature_c))
        assert row.diffusivity_m2_s == pytest.approx(true, rel=0.02)


def test_the_response_time_of_the_extended_bead_is_that_of_film_and_glass(film):
    """One exponential, R^2 (1/Bi + 1/5) / (3 alpha), behind R^2 / (10 alpha) (Carslaw and Jaeger 9.4, small Bi)."""
    out, truth, *_ = film
    profile = read_profile(out / "profile.json").temperature
    flows = [run.airflow_m_s for run in read_campaign(out.parent / "campaign").runs]
    reynolds = np.array([np.median(flows), 5.0]) * 8e-4 / 1.5e-5
    nusselt = 2.0 + 0.6 * np.sqrt(reynolds) * 0.71 ** (1 / 3)
    biot = truth.effect("convective_film")["biot_at_5_m_s"] * nusselt[0] / nusselt[1]
    scale = 0.0004**2 / truth.thermal_diffusivity_m2_s
    expected = scale * (1 / biot + 1 / 5) / 3 + scale / 10
    assert profile.response_time_s.t63_s == pytest.approx(expected, rel=0.03)


def test_correlations_are_a_correlation_matrix_with_names(film):
    for channel in load(film[0], "diagnosis.json")["channels"].values():
        matrix = np.array(channel["correlations"]["matrix"])
        names = channel["correlations"]["parameters"]
        assert matrix.shape == (len(names), len(names))
        assert np.allclose(np.diag(matrix), 1.0) and np.allclose(matrix, matrix.T, atol=1e-3)
        assert np.linalg.eigvalsh(matrix).min() > -1e-2
    temperature = load(film[0], "diagnosis.json")["channels"]["temperature"]["correlations"]
    # Behind a film of small Biot number the response fixes alpha x Bi, so the two go against one another.
    assert temperature["parameters"] == ["alpha", "convective_film.biot_at_5_m_s"]
    assert temperature["matrix"][0][1] < -0.9


def test_what_is_printed_is_what_the_files_say(film):
    out, _, _, printed = film
    gain = load(out, "diagnosis.json")["channels"]["temperature"]["gain"]
    assert "temperature: explained\n  The bead does not follow" in printed and "humidity: adequate" in printed
    cause = load(out, "diagnosis.json")["channels"]["temperature"]["causes"][0]
    found = cause["parameters"]["biot_at_5_m_s"]
    assert f"air film around it (Biot {measured(found['value'], found['standard_uncertainty'])} at 5 m/s)" in printed
    assert str(out / "report.html") in printed
    assert gain["held_out_rmse_after"] < 1.1 * gain["noise_floor"] < 0.2 * gain["held_out_rmse_before"]


def test_characterize_can_take_the_diagnosis_up(film):
    extensions = read_extension(film[0] / "diagnosis.json")
    assert extensions["temperature"].structure.ids == ("convective_film",)


def test_an_earlier_diagnosis_of_the_same_campaign_alone_is_taken(film, tmp_path, capsys):
    first, second, bead = film[0], tmp_path / "second", tmp_path / "bead"
    shutil.copytree(first.parent / "campaign", bead, ignore=shutil.ignore_patterns("hyt.csv"))
    assert main(["diagnose", str(bead), "--out", str(second), "--from", str(first)]) == 0
    a, b = (load(folder, "diagnosis.json")["channels"]["temperature"] for folder in (first, second))
    assert [c["effect"] for c in a["causes"]] == [c["effect"] for c in b["causes"]] == ["convective_film"]
    assert all(0 < one["work"]["fits"] < MOST_FITS and not one["work"]["ended_early"] for one in (a, b))
    other = load(first, "diagnosis.json") | {"campaign": "another"}
    (tmp_path / "other.json").write_text(json.dumps(other))
    capsys.readouterr()
    asked = ["diagnose", str(bead), "--out", str(tmp_path / "third"), "--from", str(tmp_path / "other.json")]
    assert main(asked) == 2
    said = capsys.readouterr().err
    assert "another" in said and "--from" in said
    assert not (tmp_path / "third").exists()


def test_the_report_shows_before_and_after_and_needs_nothing_else(film):
    out = film[0]
    page = (out / "report.html").read_text()
    assert "<script" not in page and "http-equiv" in page
    for word in (
        "Ranz and Marshall",
        "Models by their weight",
        "crossing an inversion",
        "State the airflow",
        "correlated by",
    ):
        assert word in page, word
    for name in ("temperature_before_after", "temperature_residuals", "humidity_residuals", "inversion"):
        assert (out / f"{name}.png").stat().st_size > 5000
    assert not (out / "humidity_before_after.png").exists()  # nothing was extended there


def test_what_was_emulated_is_said_to_be_invented(film):
    out = film[0]
    said = "emulated instruments: invented, not measured"
    page = (out / "report.html").read_text()
    assert page.index(said) < page.index("The bead does not follow")  # before the verdict
    assert said in load(out, "profile.json")["provenance"]["data"]


@pytest.fixture
def two_runs(tmp_path):
    """Two runs of an example, in which humidity steps and temperature does not."""
    return some_runs(tmp_path / "campaign", slice(2))


def some_runs(campaign, kept, *left_out):
    """A copy of an example of another program with those of its 33 runs that are wanted, less files."""
    shutil.copytree(EXAMPLES / "plain-rough", campaign, ignore=shutil.ignore_patterns(*left_out))
    runs = sorted((campaign / "runs").iterdir())
    for run in runs:
        if run not in runs[kept]:
            shutil.rmtree(run)
    return campaign


@pytest.mark.parametrize("threads, why", [(0, NO_STEP), (1, "none of 2 runs can be used: no imet.csv")])
def test_two_runs_are_diagnosed_and_name_nothing(threads, why, two_runs, tmp_path, capsys):
    """Also where the process has threads of its own: then its helpers are not forked. A channel without a diagnosis is
    said to have none, and for what reason."""
    for file in two_runs.glob("runs/*/imet.csv") if why != NO_STEP else ():
        file.unlink()
    done = threading.Event()
    for _ in range(threads):
        threading.Thread(target=done.wait).start()
    try:
        assert main(["diagnose", str(two_runs), "--out", str(tmp_path / "out")]) == 0
    finally:
        done.set()
    assert f"The thermometer could not be diagnosed: {why}." in capsys.readouterr().out
    channels = load(tmp_path / "out", "diagnosis.json")["channels"]
    assert list(channels) == ["humidity"]
    assert channels["humidity"]["verdict"] == "adequate" and channels["humidity"]["causes"] == []


def test_runs_without_a_step_are_refused_and_nothing_is_left(two_runs, tmp_path, capsys):
    for file in two_runs.glob("runs/*/hyt.csv"):
        file.unlink()
    assert main(["diagnose", str(two_runs), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert NO_STEP in said and "no hyt.csv" in said and str(two_runs) in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["campaign"]


@pytest.mark.parametrize("arguments, word", [(["--seed", "-1"], "--seed"), ([], "campaign.json")])
def test_bad_input_is_named(arguments, word, tmp_path, capsys):
    assert main(["diagnose", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out"), *arguments]) == 2
    assert word in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_one_sensor_alone_is_diagnosed_and_the_other_is_said_to_be_missing(tmp_path, capsys):
    campaign = some_runs(tmp_path / "campaign", slice(24, None), "hyt.csv")
    assert main(["diagnose", str(campaign), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "temperature: adequate" in printed and "The hygrometer could not be diagnosed" in printed
    diagnosis = load(tmp_path / "out", "diagnosis.json")
    assert list(diagnosis["channels"]) == ["temperature"] and diagnosis["channels"]["temperature"]["causes"] == []
    assert "humidity" not in load(tmp_path / "out", "profile.json")


@pytest.mark.elsewhere
@pytest.mark.parametrize(
    ("interrupt", "number", "begin", "code"),
    [
        (os.killpg, signal.SIGINT, None, 130),
        (os.kill, signal.SIGINT, None, 130),
        (os.kill, signal.SIGTERM, in_background, 128 + signal.SIGTERM),
    ],
)
def test_a_signal_ends_all_processes_with_one_line_and_leaves_nothing(tmp_path, interrupt, number, begin, code):
    """As a terminal sends Ctrl-C, to the command and to its branches; and to the command alone, which ends them."""
    some_runs(tmp_path / "bead", slice(28, None), "hyt.csv")
    # The search takes for ever, so that the command is at it however late the signal comes.
    endless = (
        "import sys, time; from shockrig.analysis.diagnose import diagnose; from shockrig.protocols.cli import main"
    )
    endless += "; diagnose.measure_gain = lambda *_: time.sleep(3600); sys.exit(main())"
    command = [sys.executable, "-c", endless, "diagnose", "bead", "--out", "out"]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "preexec_fn": begin}
    with subprocess.Popen(command, cwd=tmp_path, env=env, start_new_session=True, **how) as process:
        try:
            heard(process, process.stderr, "gain")
            if begin is in_background:
                os.killpg(process.pid, signal.SIGINT)  # which is for the script
            interrupt(process.pid, number)
            # the pipes are at their end when the last process has closed them
            printed, errors = ended(process)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, printed) == (code, ""), errors
    assert "Traceback" not in errors and (code != 130 or errors.splitlines()[-1].endswith("stopped by Ctrl-C"))
    assert [path.name for path in tmp_path.iterdir()] == ["bead"]
