"""What somebody does in the first hour: a log in a notebook, a flight in whatever form, and what goes wrong there."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import shockrig
from shockrig.analysis.report.characterize_page import verdict
from shockrig.files.campaign import RunAir
from shockrig.files.flight_figure import plot_flight
from shockrig.files.headline import headlines
from shockrig.protocols.cli import main
from shockrig.remedies import WORDS, in_python

ROOT = Path(__file__).parents[2]
DOCUMENTED = re.compile(r"auto(?:function|class|exception):: shockrig\.(\w+)")
OPTION = re.compile(r"(?<![\w-])--[a-z]")


@pytest.fixture(scope="module")
def log():
    return shockrig.import_log(shockrig.example("steps.csv"))


@pytest.fixture(scope="module")
def found(log):
    return log.characterize()


@pytest.fixture(scope="module")
def corrected():
    return shockrig.correct(shockrig.example("flight.csv"), shockrig.example("profile.json"))


def test_the_api_page_has_every_public_name():
    documented = set(DOCUMENTED.findall((ROOT / "docs" / "api.md").read_text(encoding="utf-8")))
    assert documented == set(shockrig.__all__) - {"__version__"}


def test_every_result_has_a_table_arrays_a_figure_and_a_card():
    results = [one for name in shockrig.__all__ if isinstance(one := getattr(shockrig, name), type)]
    shown = {"to_frame", "to_xarray", "plot", "_repr_html_"}
    lacking = {one.__name__ for one in results if not shown <= set(dir(one))}
    assert lacking == {"InputError"}


def test_a_log_gives_the_time_constants_that_it_was_made_with(found):
    """benchmarks/make_examples.py: 4 s and 9 s."""
    table = found.to_frame()
    for channel, tau_s in (("temperature", 4.0), ("humidity", 9.0)):
        row = table.loc[[channel]].iloc[0]
        assert 0.0 < row.t63_standard_uncertainty_s < 0.02 * tau_s
        assert abs(row.t63_s - tau_s) < 3.0 * row.t63_standard_uncertainty_s


def test_of_a_lumped_sensor_tau_is_the_headline_and_of_others_the_diffusivity(found):
    name, value = headlines(found.profile)[0]
    assert name == "tau of the thermometer" and re.fullmatch(r"\([34]\.\d+ ± 0\.0\d+\) s", value)
    assert "alpha" not in found._repr_html_() and "alpha" not in repr(found)
    film = dataclasses.replace(found.profile, temperature=None, sensors={})
    assert headlines(film)[0][0].startswith("D of the film")


def test_the_page_of_a_lumped_sensor_speaks_of_no_bead(found):
    assert verdict(found.result).startswith("One lag describes the thermometer: residuals of")


def test_channels_of_a_plan_are_those_that_are_asked_for(log):
    with pytest.raises(shockrig.InputError, match="holds a goal of humidity, which channels='temperature' leaves out"):
        shockrig.plan(log, until="D 5 %", channels="temperature")
    planned = shockrig.plan(log, until="ties decided", channels="temperature", runs=1)
    assert planned.status and not any("humidity" in str(goal["goal"]) for goal in planned.goals)


def test_a_goal_of_a_sensor_that_nobody_recorded_is_refused_and_tau_is_one_of_every_sensor():
    columns = {"time": "Time (UTC)", "temperature": "Probe T (degC)"}
    bead = shockrig.import_log(shockrig.example("steps.csv"), columns=columns)
    with pytest.raises(shockrig.InputError, match="until=: D 1 %: is a goal of a hygrometer, and steps has none"):
        bead.plan(until="D 1 %")
    planned = bead.plan(until="tau 1 %")
    assert [goal["goal"] for goal in planned.goals] == ["tau 1 %"] and planned.goals[0]["met"]


def test_no_certificate_states_a_diffusivity_of_lengths_that_nobody_stated(tmp_path, capsys):
    columns = {"time": "Time (UTC)", "temperature": "Probe T (degC)"}
    shockrig.import_log(shockrig.example("steps.csv"), columns=columns, out=tmp_path / "bead")
    assert main(["certify", str(tmp_path / "bead"), "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    certificate = json.loads((tmp_path / "out" / "certificate.json").read_text())
    assert [one["figure"] for one in certificate["figures"]] == ["t63", "t90"]
    page = (tmp_path / "out" / "certificate.html").read_text()
    assert "t63 of the thermometer = " in page and "alpha" not in page and "bead_radius" not in page


def test_a_frame_and_its_file_make_one_campaign(log):
    frame = pd.read_csv(shockrig.example("steps.csv"))
    by_index = frame.set_index(pd.to_datetime(frame.pop("Time (UTC)")))
    for given in (pd.read_csv(shockrig.example("steps.csv")), by_index):
        made = shockrig.import_log(given)
        assert [run.imet.time_s.tolist() for run in made.runs] == [run.imet.time_s.tolist() for run in log.runs]


def test_what_is_not_used_of_a_log_is_said(log):
    assert log.notes == () and "note" not in repr(log)
    frame = pd.read_csv(shockrig.example("steps.csv"))
    frame["battery"], frame["door"] = 3.7, 0.0
    made = shockrig.import_log(frame)
    assert len(made.notes) == 1 and "not used" in made.notes[0] and "battery, door" in made.notes[0]
    assert repr(made).endswith("; 1 note>") and made.notes[0] in made._repr_html_()


def test_a_log_of_one_sensor_lacks_no_other(tmp_path, capsys):
    frame = pd.read_csv(shockrig.example("steps.csv"))
    columns = {"time": "Time (UTC)", "temperature": "Probe T (degC)"}
    shockrig.import_log(frame, columns=columns, out=tmp_path / "bead")
    assert main(["characterize", str(tmp_path / "bead"), "--out", str(tmp_path / "out")]) == 0
    assert "humidity" not in "".join(capsys.readouterr())


def test_columns_that_nobody_would_guess_are_named(log):
    frame = pd.read_csv(shockrig.example("steps.csv")).set_axis(["x", "y", "z"], axis=1)
    made = shockrig.import_log(frame, columns={"time": "x", "temperature": "y"}, airflow_m_s=3.0)
    assert repr(made) == "<Campaign 'log': 4 runs, imet in 4>"
    assert {run.airflow_m_s for run in made.runs} == {3.0}
    with pytest.raises(shockrig.InputError, match="columns: there is no quantity 'temp'"):
        shockrig.import_log(frame, columns={"temp": "y"})


def test_a_campaign_that_is_kept_is_read_again(tmp_path, log):
    kept = shockrig.import_log(shockrig.example("steps.csv"), out=tmp_path / "kept")
    assert len(shockrig.read_campaign(tmp_path / "kept").runs) == len(kept.runs) == len(log.runs)
    with pytest.raises(shockrig.InputError, match="is there already"):
        shockrig.import_log(shockrig.example("steps.csv"), out=tmp_path / "kept")


@pytest.mark.parametrize("name", ["flight.bin", "flight.nc", "frame"])
def test_a_flight_is_the_same_in_every_form(name, corrected):
    if name == "flight.bin":
        pytest.importorskip("pymavlink")
    flight = pd.read_csv(shockrig.example("flight.csv")) if name == "frame" else shockrig.example(name)
    other = shockrig.correct(flight, shockrig.example("profile.json"))
    assert other.flight.altitude_m is not None
    np.testing.assert_allclose(other.result.humidity_percent, corrected.result.humidity_percent, atol=0.02)


def test_the_example_flight_is_corrected_to_its_air(corrected):
    truth = pd.read_csv(shockrig.example("truth.csv"))
    for column in ("temperature_c", "humidity_percent"):
        off = [getattr(one, column) - truth[column].to_numpy() for one in (corrected.flight, corrected.result)]
        as_read, left = (float(np.sqrt(np.mean(values**2))) for values in off)
        assert left < 0.1 * as_read


@pytest.mark.parametrize("channel", ["temperature", "humidity"])
def test_a_channel_by_itself_is_characterized_and_corrected(channel, log, corrected):
    other = {"temperature": "humidity", "humidity": "temperature"}[channel]
    alone = log.characterize(channels=channel)
    assert getattr(alone.profile, other) is None and alone.notes == ()
    done = shockrig.correct(shockrig.example("flight.csv"), alone, channels=[channel])
    assert done.profile == alone.profile and not any(".csv" in note for note in done.notes)


def test_a_channel_that_is_not_there_is_refused_in_a_sentence(log):
    bead = shockrig.import_log(
        pd.read_csv(shockrig.example("steps.csv")), columns={"time": "Time (UTC)", "temperature": "Probe T (degC)"}
    )
    for call in (bead.characterize, bead.diagnose):
        with pytest.raises(
            shockrig.InputError, match=r"has no readings of humidity; leave that channel out \(it has temp"
        ):
            call(channels="humidity")
    with pytest.raises(shockrig.InputError, match="there is no channel 'temp'; give 'temperature', 'humidity' or both"):
        log.characterize(channels=["temp"])
    with pytest.raises(shockrig.InputError, match="the profile has no humidity"):
        shockrig.correct(shockrig.example("flight.csv"), bead.characterize(), channels="humidity")


def test_a_table_is_told_from_what_has_no_names():
    with pytest.raises(shockrig.InputError, match="log: expected a path, paths or a DataFrame, got Series"):
        shockrig.import_log(pd.Series([1.0, 2.0]))
    with pytest.raises(shockrig.InputError, match="flight: expected a path, a Flight or a DataFrame, got ndarray"):
        shockrig.correct(np.zeros(3), shockrig.example("profile.json"))


def test_results_are_short_to_print(log, found, corrected):
    planned = shockrig.Planned((), (), "done", "all goals are met")
    for one in (log, found, found.profile, corrected, planned):
        assert repr(one).startswith("<") and "\n" not in repr(one) and len(repr(one)) < 300


def test_goals_are_planned_for_from_a_campaign(log):
    done = shockrig.plan(log, until="tau 20 %", channels="temperature", runs=1)
    assert done.status in ("continue", "done") and done.goals[0]["met"]
    pytest.importorskip("xarray")
    assert done.to_xarray().sizes.get("run", 0) == len(done.runs)
    assert done.plot()._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(shockrig.InputError, match="until: is missing; give goals such as"):
        shockrig.plan(log)


def drawn(figure):
    """The panels of a figure, each of which has to have something drawn in it."""
    assert all(axes.lines or axes.collections or axes.patches or axes.texts for axes in figure.axes)
    return figure.axes


@pytest.mark.parametrize("channels", [None, "temperature", "humidity"])
def test_what_was_fitted_is_drawn_without_an_empty_panel(log, channels):
    found = log.characterize(channels=channels)
    steps = drawn(found.plot())[0]
    assert len(steps.lines) >= 8  # readings and fit of each run that is shown
    drawn(found.profile.plot())


def test_a_campaigns_axis_is_what_its_runs_know(log):
    assert drawn(log.plot())[0].get_xlabel() == "time since the step was seen, s"
    first = shockrig.read_campaign(shockrig.example("plain-rough"))
    assert drawn(first.plot(["0001"]))[0].get_xlabel() == "time since the transfer, s"
    run = dataclasses.replace(first.runs[0], start_s=None, hyt=None, destination=RunAir(None, None))
    alone = dataclasses.replace(first, runs=(run,)).plot()
    assert len(drawn(alone)) == 1 and alone.axes[0].get_xlabel() == "time since the first reading, s"


def test_pressure_that_nobody_stated_is_missing(log):
    assert log.to_frame()["pressure_hpa"].isna().all()
    stated = shockrig.import_log(shockrig.example("steps.csv"), pressure_hpa=900.0)
    assert set(stated.to_frame()["pressure_hpa"]) == {900.0}


def test_a_flight_that_was_read_shows_itself_as_every_result_does(tmp_path):
    flight = shockrig.read_flight(shockrig.example("flight.csv"))
    assert repr(flight).startswith("<Flight: rows 901; has temperature_c, humidity_percent, airspeed_m_s, ")
    frame = flight.to_frame()
    assert len(frame) == 901 and frame.columns[0] == "time_s" and "die_temperature_c" not in frame
    assert flight.to_xarray().altitude_m.attrs == {"units": "m"} and "and 896 more rows" in flight._repr_html_()
    over_time, over_altitude = flight.plot(), flight.plot("altitude")
    assert len(over_time.axes) == len(over_altitude.axes) == 2
    assert [line.get_label() for line in over_altitude.axes[0].lines] == ["ascent", "descent"]
    with pytest.raises(shockrig.InputError, match="no altitude that changes"):
        shockrig.read_flight(frame[["time_s", "temperature_c"]]).plot("altitude")


def test_a_flight_is_drawn_over_time_and_over_altitude(corrected):
    panels = drawn(corrected.plot())
    assert panels[-1].get_xlabel() == "time since 2026-05-05 06:30:00 UTC, s"
    profiles = drawn(corrected.plot("altitude"))
    assert profiles[0].get_ylabel() == "altitude, m" and len(profiles) == 2
    dive = dataclasses.replace(corrected.flight, altitude_m=-corrected.flight.altitude_m)
    labels = [line.get_label() for line in drawn(plot_flight(dive, corrected.result, "altitude"))[0].lines]
    assert {"as read, ascent", "as read, descent"} <= set(labels)
    low = dataclasses.replace(corrected.flight, altitude_m=None)
    with pytest.raises(shockrig.InputError, match="no altitude that changes"):
        plot_flight(low, corrected.result, "altitude")
    bead = dataclasses.replace(corrected.flight, humidity_percent=np.full(901, np.nan))
    assert len(drawn(plot_flight(bead, corrected.result))) == 2


@pytest.mark.parametrize(
    "call",
    [
        lambda folder: shockrig.import_log(folder / "none.csv"),
        lambda folder: shockrig.import_log(pd.DataFrame({"a": ["x", "y"]})),
        lambda folder: shockrig.import_log(pd.DataFrame({"time": range(500), "temperature": 20.0})),
        lambda folder: shockrig.import_log(shockrig.example("steps.csv"), sensor="nix"),
        lambda folder: shockrig.correct(pd.DataFrame({"a": [1.0]}), shockrig.example("profile.json")),
        lambda folder: shockrig.correct(pd.DataFrame({"time": [1.0, 2.0]}), shockrig.example("profile.json")),
        lambda folder: shockrig.correct(
            shockrig.example("flight.bin"), shockrig.example("profile.json"), columns={"humidity": "NIX.H"}
        ),
        lambda folder: shockrig.correct(
            shockrig.example("flight.csv"), shockrig.example("profile.json"), columns={"humidity": "nix"}
        ),
        lambda folder: shockrig.correct(shockrig.example("flight.csv"), folder / "none.json"),
        lambda folder: shockrig.read_campaign(folder),
        lambda folder: shockrig.plan(shockrig.example("plain-rough"), until="quickly"),
    ],
)
def test_errors_give_pythons_remedies(call, tmp_path):
    with pytest.raises(shockrig.InputError) as caught:
        call(tmp_path)
    assert not OPTION.search(re.sub(r"shockrig import FILE --look", "", str(caught.value))), caught.value
    assert "/tmp/tmp" not in str(caught.value)


def test_every_option_that_a_message_of_logs_names_has_pythons_words():
    """Messages of what Python calls: whoever adds one with an option finds it here."""
    folders = [ROOT / "files", ROOT / "rig" / "logs", ROOT / "analysis" / "flight", ROOT / "analysis" / "planning"]
    files = [file for folder in folders for file in folder.glob("*.py") if file.stem != "one_run"]  # a command's alone
    files += [ROOT / "protocols" / name for name in ("flight_logs.py", "ardupilot.py", "made_before.py")]
    said = set()
    for file in files:
        said |= set(re.findall(r"--[a-z][a-z-]+(?:[ =][A-Za-z.{][\w.{}\[\]]*=\w+)?", file.read_text(encoding="utf-8")))
    known = {"--look", "--map", "--sensor", "--out", "--name", "--until"}
    left = {text for text in said if not text.startswith("--column") and text.split("=")[0].split()[0] not in known}
    assert left <= {"--wmo", "--cutoff-hz", "--probe"}, left
    assert all(not OPTION.search(re.sub("FILE --look", "", words)) for _, words in WORDS)
    assert in_python("name it with --column time=NAME") == "name it with columns={'time': ...}"


def test_a_start_that_nobody_recorded_is_looked_for_once(log, monkeypatch):
    """Looks, fits and diagnoses of one campaign ask for it again and again, and it is most of a plan's time."""
    from shockrig.analysis.estimate import gather

    asked = []
    monkeypatch.setattr(gather, "estimate_start", lambda time_s, value: asked.append(time_s) or 50.0)
    fresh = shockrig.import_log(shockrig.example("steps.csv"))
    unseen = tuple(dataclasses.replace(run, extra={}) for run in fresh.runs)  # as if no import had
    fresh = dataclasses.replace(fresh, runs=unseen)
    for _ in range(2):
        gather.usable_runs(fresh, "temperature")
        gather.usable_runs(fresh, "humidity")
    assert len(asked) == 2 * len(fresh.runs)


def test_a_certificate_uses_the_diagnosis_beside_the_campaign(tmp_path, log):
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.protocols.made_before import KEY, current, made_from

    kept = shockrig.import_log(shockrig.example("steps.csv"), out=tmp_path / "mine")
    assert current(tmp_path / "mine", kept) is None
    (tmp_path / "mine-diagnosis").mkdir()
    document = {
        "format": "shock-diagnosis/1",
        "campaign": kept.name,
        "channels": {"temperature": {"verdict": "adequate", "causes": []}},
        KEY: made_from(kept, Tolerance()),
    }
    (tmp_path / "mine-diagnosis" / "diagnosis.json").write_text(json.dumps(document))
    assert current(tmp_path / "mine", kept) == tmp_path / "mine-diagnosis" / "diagnosis.json"
    more = dataclasses.replace(kept, runs=kept.runs[:-1])
    assert current(tmp_path / "mine", more) is None
