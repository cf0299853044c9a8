"""What `import shockrig` offers: every name is there and documented, examples run, results show themselves."""

import ast
import dataclasses
import doctest
import importlib
import inspect
import json
import pkgutil
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import shockrig
import shockrig.files
from shockrig.files import profile_views, result_views
from shockrig.files.campaign import RunAir
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.flight_figure import plot_flight
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    ResponseTime,
    TemperatureProfile,
    Uncertain,
)

ROOT = Path(__file__).parents[2]
FUNCTIONS = [name for name in shockrig.__all__ if inspect.isfunction(getattr(shockrig, name))]
WITH_EXAMPLES = [
    *(f"shockrig.{m.name}" for m in pkgutil.iter_modules(shockrig.__path__) if not m.ispkg),
    *(f"shockrig.files.{m.name}" for m in pkgutil.iter_modules(shockrig.files.__path__)),
]
PROFILE = Profile(
    TemperatureProfile(Uncertain(7.5e-8, 2e-10), response_time_s=ResponseTime(0.3, 0.6, 1.0), noise_k=0.02),
    HumidityProfile((DiffusivityRow(0.0, 3e-12, 1e-14, 4), DiffusivityRow(20.0, 6e-12, 3e-14, 5)), noise_percent=0.07),
)
DIAGNOSIS = {
    "format": "shock-diagnosis/1",
    "campaign": "<i>bench</i>",
    "channels": {
        "temperature": {
            "verdict": "explained",
            "causes": [
                {
                    "effect": "stem_conduction",
                    "probability": 0.99,
                    "parameters": {
                        "fraction": {"value": 0.03, "standard_uncertainty": 0.001},
                        "time_constant_s": {"value": 8.1, "standard_uncertainty": 0.2},
                    },
                    "indistinguishable_from": ["air_relaxation"],
                }
            ],
            "gain": {
                "held_out_rmse_before": 0.21,
                "held_out_rmse_after": 0.021,
                "noise_floor": 0.02,
                "explained_fraction": 0.99,
                "interval_95": [0.98, 1.0],
            },
        },
        "humidity": {"verdict": "adequate", "causes": []},
    },
    "next_experiments": [{"airflow_m_s": 2.5}],
    "input_findings": ["runs 0003 and 0007 read in kelvin"],
}


@pytest.fixture(scope="module")
def campaign():
    return shockrig.read_campaign(shockrig.example("plain-rough"))


@pytest.fixture(scope="module")
def diagnoses():
    return {}


@pytest.fixture
def diagnosed_once(diagnoses, monkeypatch):
    """`diagnose` for two examples and a test that ask the same of one campaign: whoever is first makes it."""
    diagnose = shockrig.diagnose

    def remembered(campaign, channels):
        key = Path(getattr(campaign, "path", campaign)), *([channels] if isinstance(channels, str) else channels)
        return diagnoses.get(key) or diagnoses.setdefault(key, diagnose(campaign, channels=channels))

    monkeypatch.setattr(shockrig, "diagnose", remembered)


@pytest.fixture
def flight():
    time_s = np.arange(0.0, 20.0, 0.1)
    reading = np.where(time_s < 10.0, 15.0, 20.0)
    off = np.zeros(time_s.size, dtype=bool)
    flags = dict.fromkeys(FLAGS, off) | {"gap": time_s > 19.0}
    rows = Flight(time_s, reading, 3.0 * reading, *(np.full(time_s.size, np.nan) for _ in range(3)))
    found = Corrected(reading + 0.5, np.full(200, 0.1), 3.0 * reading - 1.0, np.full(200, 0.3), flags, ("a < b",))
    return rows, found


def test_all_is_complete():
    """`__all__`, what type checkers see, and what is imported on demand are the same names, and each is there."""
    tree = ast.parse(Path(shockrig.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If) and getattr(n.test, "id", "") == "TYPE_CHECKING")
    assert block.body[0].module == "typing"
    seen = {alias.name for statement in block.body[1:] for alias in statement.names}
    assert seen | {"__version__"} == set(shockrig.__all__)
    assert shockrig.__all__ == sorted(shockrig.__all__)
    for name in shockrig.__all__:
        assert getattr(shockrig, name) is not None
        assert name in dir(shockrig)
    with pytest.raises(AttributeError, match="no attribute 'planck'"):
        shockrig.planck  # noqa: B018


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_are_documented(name):
    """NumPy style: a sentence on the first line; parameters, what comes back and an example are said."""
    function = getattr(shockrig, name)
    text = inspect.getdoc(function)
    first, _, rest = text.partition("\n")
    assert first.endswith(".") and len(first) <= 115 and (not rest or rest.startswith("\n"))
    said = {
        name.strip("* ") for line in re.findall(r"^(\S.*?)(?: : .*)?$", text, re.MULTILINE) for name in line.split(",")
    }
    assert set(inspect.signature(function).parameters) <= said | {"path", "profile"}
    assert "Examples\n--------" in text or "See Also\n--------" in text


@pytest.mark.usefixtures("diagnosed_once")
@pytest.mark.parametrize("module", WITH_EXAMPLES)
def test_examples_do_what_they_show(module):
    loaded = importlib.import_module(module)
    done = doctest.testmod(loaded, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.failed == 0
    if module == "shockrig.correcting":
        assert done.attempted > 10


def test_an_example_that_does_not_ship_is_refused_with_those_that_do():
    with pytest.raises(shockrig.InputError, match="no example 'moon'; give one of .*ordinary-bench, plain-rough"):
        shockrig.example("moon")


def test_a_campaign_as_arrays_holds_every_reading_in_its_place(campaign):
    pytest.importorskip("xarray")
    data = campaign.to_xarray()
    for run in (campaign.runs[0], campaign.runs[-1]):
        row = data.sel(run=run.id)
        samples = run.hyt.time_s.size
        assert row.hyt_humidity_percent.values[:samples].tolist() == run.hyt.values["humidity_percent"].tolist()
        assert np.isnan(row.hyt_humidity_percent.values[samples:]).all()
        assert row.imet_time_s.values[0] == run.imet.time_s[0]
        assert float(row.airflow_m_s) == run.airflow_m_s
    assert data.hyt_humidity_percent.units == "%" and data.start_s.units == "s"


def test_a_campaign_with_one_sensor_and_unknown_airs_shows_itself(campaign):
    run = dataclasses.replace(campaign.runs[0], hyt=None, destination=RunAir(None, None), start_s=None)
    alone = dataclasses.replace(campaign, runs=(run,), name="<b>&")
    assert "&lt;b&gt;&amp;" in alone._repr_html_() and "<b>&" not in alone._repr_html_()
    assert alone.plot()._repr_png_().startswith(b"\x89PNG")
    pytest.importorskip("xarray")
    assert "hyt_time_s" not in alone.to_xarray() and np.isnan(alone.to_xarray().start_s.item())


def test_a_campaign_is_drawn_run_by_run_from_its_transfer_on(campaign):
    bead = campaign.plot(["0001", "0004"]).axes[0]
    assert len(bead.lines) == 2
    run = campaign.runs[0]
    assert np.allclose(bead.lines[0].get_xdata(), run.imet.time_s - run.start_s)
    with pytest.raises(shockrig.InputError, match="none of the runs 9999"):
        campaign.plot(["9999"])


def test_a_profile_shows_what_its_file_holds():
    frame = PROFILE.to_frame()
    assert frame.loc["temperature", "diffusivity_m2_s"] == 7.5e-8
    assert frame.loc["humidity", "standard_uncertainty"].to_list() == [1e-14, 3e-14]
    card = PROFILE._repr_html_()
    assert "(7.500 ± 0.020) × 10⁻⁸ m²/s" in card and "0.070 %RH" in card
    assert frame.loc["temperature", "t90_s"] == 0.6
    figure = PROFILE.plot()
    assert figure.axes[0].get_title("left") == "alpha of the bead: (7.500 ± 0.020) × 10⁻⁸ m²/s, t63 0.3000 s"
    (bars,) = figure.axes[0].containers
    assert np.allclose(bars.lines[0].get_ydata(), [3.0, 6.0])
    pytest.importorskip("xarray")
    data = PROFILE.to_xarray()
    assert float(data.diffusivity_m2_s.sel(ambient_temperature_c=20.0)) == 6e-12
    assert float(data.thermal_diffusivity_m2_s) == 7.5e-8


@pytest.mark.parametrize("channel", ["temperature", "humidity"])
def test_half_a_profile_shows_itself(channel):
    half = dataclasses.replace(PROFILE, **{channel: None})
    assert channel not in half.to_frame().index
    assert half.plot()._repr_png_().startswith(b"\x89PNG")
    assert "Sensor profile" in half._repr_html_()


def test_a_diagnosis_as_tables_has_a_row_for_each_parameter_and_for_each_channel():
    causes, gain = result_views.causes_frame(DIAGNOSIS), result_views.gain_frame(DIAGNOSIS)
    assert causes.loc["temperature", "parameter"].to_list() == ["fraction", "time_constant_s"]
    assert causes.loc["temperature", "indistinguishable_from"].to_list() == ["air_relaxation"] * 2
    assert causes.loc["humidity", "verdict"] == "adequate"
    assert gain.loc["temperature", "unit"] == "K" and gain.loc["temperature", "high_95"] == 1.0
    card = result_views.diagnosis_card(DIAGNOSIS)
    assert "0.210 K on unseen runs, 0.0210 with its causes (noise 0.0200)" in card
    assert "&lt;i&gt;bench" in card and "1 run<" in card and "read in kelvin" in card
    panels = result_views.plot_diagnosis(DIAGNOSIS).axes
    assert [bar.get_width() for bar in panels[0].patches] == [0.21, 0.021]


def test_a_corrected_flight_as_a_table_is_what_its_file_holds(flight):
    frame = result_views.flight_frame(*flight)
    assert frame.temperature_corrected_c.to_list() == (flight[0].temperature_c + 0.5).tolist()
    assert frame["flags"].to_list() == [""] * 191 + ["gap"] * 9
    card = result_views.flight_card(*flight)
    assert "changed by up to 0.500 K, standard uncertainty 0.10 K" in card and "a &lt; b" in card
    above, below, *_ = plot_flight(*flight).axes
    band = above.collections[0].get_paths()[0].vertices
    assert np.isclose(band[:, 1].max(), 20.5 + 1.96 * 0.1)
    assert below.get_ylim()[1] < 2.0 * 1.96 * 0.1  # it can be seen, whatever the flight's range
    pytest.importorskip("xarray")
    data = result_views.flight_dataset(*flight)
    assert data.temperature_corrected_c.standard_name == "air_temperature"
    assert data.temperature_uncertainty_k.units == "K" and data.humidity_corrected_percent.units == "%"
    assert int(data.flag_gap.sum()) == 9


def test_a_band_is_drawn_as_far_as_there_is_air_with_it(flight):
    """Of a humidity that nobody knows it had gone from -100 to 200 %RH."""
    read, found = flight
    climbing = dataclasses.replace(read, altitude_m=10.0 * read.time_s)
    unsure = dataclasses.replace(found, humidity_uncertainty_percent=np.full(read.time_s.size, 80.0))
    over_time, over_altitude = plot_flight(climbing, unsure).axes[2], plot_flight(climbing, unsure, "altitude").axes[1]
    for axes, across in ((over_time, 1), (over_altitude, 0)):
        ends = np.concatenate([path.vertices[:, across] for path in axes.collections[0].get_paths()])
        assert (ends.min(), ends.max()) == (0.0, 100.0)


def test_nothing_is_drawn_across_a_gap_and_a_value_alone_is(flight):
    """Of two flights in a log a line and a band led from the one to the other, over what nobody measured."""
    read, found = flight
    row = np.arange(read.time_s.size)
    time_s = read.time_s + 5000.0 * ((row >= 100).astype(float) + (row >= 101))
    parted = dataclasses.replace(read, time_s=time_s, altitude_m=10.0 * read.time_s)
    over_time, over_altitude = plot_flight(parted, found), plot_flight(parted, found, "altitude")
    longest = {over_time.axes[0]: (0, 10.0 / 60.0), over_altitude.axes[0]: (1, 100.0)}
    for axes, (along, most) in longest.items():
        assert [line.get_marker() for line in axes.lines] == ["None", ".", "None", "."]
        for line in axes.lines[::2]:
            points = line.get_xydata()
            pieces = np.split(points, np.flatnonzero(np.isnan(points).any(axis=1)))
            assert len(pieces) == 3 and max(np.ptp(one[1:, along]) for one in pieces) < most
        ends = [path.vertices[:, along] for drawn in axes.collections for path in drawn.get_paths()]
        assert max(np.ptp(one) for one in ends) < most and len(axes.collections) == 2
    assert np.count_nonzero(np.isnan(parted.plot().axes[0].lines[0].get_xdata())) == 2


def test_xarray_missing_is_said_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"pip install 'shockrig\[notebook\]'"):
        profile_views.profile_dataset(PROFILE)


def test_a_flight_is_corrected_alike_from_a_frame_and_from_its_file(tmp_path):
    time_s = np.round(np.arange(0.0, 60.0, 0.1), 3)
    noise = np.random.default_rng(1).standard_normal((2, time_s.size))
    front = 1.0 / (1.0 + np.exp(-(time_s - 30.0)))
    log = pd.DataFrame(
        {
            "time_s": time_s,
            "temperature_c": 15.0 + 5.0 * front + 0.02 * noise[0],
            "humidity_percent": 60.0 - 20.0 * front,
        }
    )
    file, profile = tmp_path / "flight.csv", tmp_path / "profile.json"
    log.rename(columns={"temperature_c": "bead"}).to_csv(file, index=False)
    shockrig.write_profile(PROFILE, profile)
    from_file = shockrig.correct(str(file), profile, columns={"temperature": "bead"})
    from_frame = shockrig.correct(log, PROFILE)
    pd.testing.assert_frame_equal(from_file.to_frame(), from_frame.to_frame())
    assert from_frame.notes == from_frame.result.notes
    assert "rows" in from_frame._repr_html_()
    with pytest.raises(TypeError, match="no setting 'cutof_hz'; known are cutoff_hz"):
        shockrig.correct(log, PROFILE, cutof_hz=1.0)
    with pytest.raises(shockrig.InputError, match="the DataFrame: no column 'seconds' for time; name one of its own"):
        shockrig.correct(log, PROFILE, columns={"time": "seconds"})


def test_a_diagnosis_is_carried_by_the_model_that_it_extends(tmp_path):
    """characterize(extend=...) takes a diagnosis or its file, and the profile carries the causes."""
    bench = shockrig.read_campaign(shockrig.example("ordinary-bench"))
    lag = {"verdict": "explained", "causes": [{"effect": "die_thermal_lag", "probability": 0.99}]}
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(DIAGNOSIS | {"channels": {"humidity": lag}}))
    extended = shockrig.characterize(bench, extend=file)
    assert [effect.effect for effect in extended.profile.humidity.effects] == ["die_thermal_lag"]
    assert extended.profile.temperature.effects == ()
    extended.write(tmp_path / "profile.json")
    assert shockrig.read_profile(tmp_path / "profile.json") == extended.profile


@pytest.mark.usefixtures("diagnosed_once")
def test_nothing_to_explain_extends_nothing(campaign):
    found = shockrig.diagnose(campaign, channels="temperature")
    assert found.verdicts == {"temperature": "adequate"} and found.causes == {"temperature": []}
    assert "adequate" in found._repr_html_() and len(found.to_frame()) == 1
    assert shockrig.characterize(campaign, extend=found).profile.temperature.effects == ()


def test_what_was_wrong_with_the_input_is_shown_with_the_result(campaign):
    """Two runs whose bead was logged in kelvin are set aside, and the result says so."""
    kelvin = [
        dataclasses.replace(run.imet, values={"temperature_c": run.imet.values["temperature_c"] + 273.15})
        for run in campaign.runs
    ]
    runs = tuple(dataclasses.replace(run, imet=trace) for run, trace in zip(campaign.runs, kelvin, strict=True))
    found = shockrig.characterize(dataclasses.replace(campaign, runs=runs))
    assert found.profile.temperature is None and found.profile.humidity is not None
    assert any("kelvin" in note for note in found.notes)
    assert "kelvin" in found._repr_html_()
