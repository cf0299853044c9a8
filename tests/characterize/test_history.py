"""Control charts: what has not changed is left alone, what has is dated, a bench's own error is no change."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_worlds import small_plan

from shockrig.analysis.characterize.budget import diffusivity_at, mean_diffusivity
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.history import FALSE_ALARMS, Observation, chart
from shockrig.analysis.report.certificate_page import steady
from shockrig.files.campaign import read_campaign
from shockrig.files.campaign_names import serial_numbers
from shockrig.protocols.cli import main
from shockrig.protocols.commands.history import called
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.truth import draw_truth


def campaigns(values, random=0.003, common=0.0, degrees=40.0, benches=None):
    benches = benches or ["one"] * len(values)
    return [
        Observation(f"c{i}", f"2026-{i + 1:02d}-01T00:00:00Z", value, random, common, degrees, bench)
        for i, (value, bench) in enumerate(zip(values, benches, strict=True))
    ]


def test_false_alarms_are_as_many_as_are_allowed():
    """Figures that scatter as they say: over one figure, at most a third of the rate that all may have together."""
    rng = np.random.default_rng(7)
    trials, found = 1500, 0
    for _ in range(trials):
        degrees = 20.0
        spread = 0.003 * np.sqrt(degrees / rng.chisquare(degrees, 8))  # as uncertainties known from 20 degrees are
        values = np.exp(0.003 * rng.standard_normal(8))
        stated = 0.003**2 / spread
        history = [replace(one, random=s) for one, s in zip(campaigns(values, degrees=degrees), stated, strict=True)]
        found += bool(chart("D", "x", "", history).changes)
    expected = trials * FALSE_ALARMS / 3
    assert found <= expected + 3 * np.sqrt(expected)


def test_a_step_is_found_with_its_size_and_its_place():
    rng = np.random.default_rng(4)
    values = np.exp(0.003 * rng.standard_normal(10)) * np.where(np.arange(10) >= 6, 1.03, 1.0)
    found = chart("D", "x", "m²/s", campaigns(values))
    (change,) = found.changes
    assert change.first == 6
    assert change.relative == pytest.approx(0.03, abs=3 * 0.003 * np.sqrt(1 / 6 + 1 / 4))
    assert change.standard_uncertainty == pytest.approx(1.03 * 0.003 * np.sqrt(1 / 6 + 1 / 4), rel=0.02)
    assert change.probability < 1e-3
    assert found.level[5] == found.level[0] != found.level[6] == found.level[9]
    assert ((found.low < values) & (values < found.high)).all()


def test_two_steps_are_two_changes():
    values = np.repeat([1.0, 1.04, 0.97], 4)
    assert [change.first for change in chart("D", "x", "", campaigns(values)).changes] == [4, 8]


def test_what_a_bench_always_had_is_no_change_and_does_not_hide_one():
    """An error of 5 % that all campaigns of the bench share neither widens nor makes a step."""
    same = chart("D", "x", "", campaigns(np.repeat([1.0, 1.02], 5), common=0.05))
    assert [change.first for change in same.changes] == [5]
    other = campaigns(np.repeat([1.0, 1.02], 5), common=0.05, benches=["old"] * 5 + ["new"] * 5)
    assert chart("D", "x", "", other).changes == ()
    large = campaigns(np.repeat([1.0, 1.5], 5), common=0.05, benches=["old"] * 5 + ["new"] * 5)
    (change,) = chart("D", "x", "", large).changes
    assert change.standard_uncertainty == pytest.approx(1.5 * 0.05 * np.sqrt(2), rel=0.02)


def test_a_level_is_as_sure_as_the_mean_of_its_campaigns():
    """Of independent ones by the root of their weights; what the bench shares averages out in none."""
    unlike = [
        replace(one, random=size) for one, size in zip(campaigns([1.0, 1.004, 0.999]), (0.001, 0.02, 0.02), strict=True)
    ]
    alone = chart("D", "x", "m²/s", unlike)
    assert alone.standard_uncertainty[-1] / alone.level[-1] == pytest.approx((1e6 + 2 * 2500) ** -0.5, rel=1e-6)
    shared = chart("D", "x", "m²/s", campaigns([1.0] * 9, common=0.05))
    assert shared.standard_uncertainty[-1] == pytest.approx(np.hypot(0.05, 0.001), rel=1e-6)
    assert "D of x: (1.000 ± 0.050) m²/s in 9 campaigns" in steady(shared)
    # Limits are of how campaigns differ, and of that the bench's error is no part.
    without = chart("D", "x", "m²/s", campaigns([1.0] * 9))
    assert np.allclose(shared.low, without.low) and np.allclose(shared.high, without.high)


def test_a_single_campaign_has_no_changes():
    found = chart("D", "x", "", campaigns([1.0]))
    assert found.changes == ()
    assert found.low[0] < 1.0 < found.high[0]


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    """Four campaigns of one sensor, months apart; before the last one its film has become 10 % faster."""
    folder = tmp_path_factory.mktemp("shelf")
    truth = draw_truth(np.random.default_rng(5), "rough")
    for i, factor in enumerate((1.0, 1.0, 1.0, 1.1)):
        own = replace(truth, diffusivity_20c_m2_s=factor * truth.diffusivity_20c_m2_s)
        path = simulate_campaign(own, small_plan()[::2], np.random.default_rng(50 + i), folder / f"c{i}", name=f"c{i}")
        for file in sorted(path.glob("runs/*/run.json")):
            content = json.loads(file.read_text())
            content["started_at"] = content["started_at"].replace("2026-05", f"2026-0{i + 1}")
            file.write_text(json.dumps(content))
        head = json.loads((path / "campaign.json").read_text())
        head["sensors"] = {name: sensor | {"serial": "V7"} for name, sensor in head["sensors"].items()}
        (path / "campaign.json").write_text(json.dumps(head))
    return folder, truth


def test_d_at_20_degrees_is_read_between_the_ambients(shelf):
    folder, truth = shelf
    result = characterize(read_campaign(folder / "c0"), channels=["humidity"]).humidity
    budget = diffusivity_at(result, 20.0)
    assert abs(budget.value / float(truth.diffusivity_m2_s(20.0)) - 1) < 4 * budget.standard_uncertainty / budget.value
    row = min(result.rows, key=lambda one: abs(one.ambient_c - 20.0))
    assert budget.value == pytest.approx(row.diffusivity_m2_s, rel=0.05 * abs(row.ambient_c - 20.0) + 1e-9)
    assert budget.standard_uncertainty == pytest.approx(row.standard_uncertainty, rel=0.2)
    assert diffusivity_at(result, 75.0) is None
    mean, over = mean_diffusivity(result)
    true = np.exp(np.mean(np.log([float(truth.diffusivity_m2_s(t)) for t in over])))
    assert abs(mean.value / true - 1) < 4 * mean.standard_uncertainty / mean.value
    # Over all ambients the runs' own scatter averages out.
    assert mean.random / mean.value < 0.95 * budget.random / budget.value


def test_the_command_says_what_changed_and_since_when(shelf, tmp_path, capsys):
    folder, _ = shelf
    assert main(["history", str(folder), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "D(20 °C) of V7 has changed by" in said
    assert "since c3 (2026-04-01); c2 (2026-03-01) was the last before." in said
    assert "alpha of V7: (" in said
    assert "in 4 campaigns; nothing has changed beyond its uncertainty." in said
    content = json.loads((tmp_path / "out" / "history.json").read_text())
    changed = {one["figure"]: one["changes"] for one in content["charts"]}
    assert changed["alpha"] == changed["t63"] == []
    (change,) = changed["D(20 °C)"]
    assert change["since"] == "c3"
    assert abs(change["relative"] - 0.1) < 4 * change["standard_uncertainty"]
    page = (tmp_path / "out" / "history.html").read_text()
    assert "c2 (2026-03-01) was the last before" in page
    assert len(list((tmp_path / "out").glob("chart_*.png"))) == 4
    (mean,) = (one for one in content["charts"] if "mean of" in one["figure"])
    (change,) = mean["changes"]
    assert change["since"] == "c3"
    assert abs(change["relative"] - 0.1) < 4 * change["standard_uncertainty"]


def test_campaigns_of_one_name_are_called_by_their_folders(shelf):
    campaigns = [read_campaign(shelf[0] / name) for name in ("c0", "c1", "c2")]
    alike = [replace(one, name="virtual") for one in campaigns[:2]] + campaigns[2:]
    assert list(called(alike).values()) == ["c0", "c1", "c2"]
    places = [Path("a/x"), Path("b/x"), Path("y")]
    moved = [replace(one, name="virtual", path=place) for one, place in zip(campaigns, places, strict=True)]
    assert list(called(moved).values()) == ["a/x", "b/x", "y"]


def test_a_copy_of_a_campaign_is_no_second_one(shelf, tmp_path, capsys):
    folder, _ = shelf
    for name in ("c0", "c1"):
        shutil.copytree(folder / name, tmp_path / name)
    shutil.copytree(folder / "c0", tmp_path / "safe")
    assert main(["history", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert f"{tmp_path / 'safe'}: the same readings as {tmp_path / 'c0'}; left out" in said.err
    assert "in 2 campaigns; nothing has changed" in said.out


def test_a_sensor_that_was_recorded_beside_another_has_that_campaign_in_its_history(shelf, tmp_path, capsys):
    folder, _ = shelf
    both = shutil.copytree(folder / "c0", tmp_path / "both")
    for file in sorted(both.glob("runs/*/*.csv")):
        shutil.copy(file, file.with_stem(f"{file.stem}-2"))
        file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))  # other readings than the copy's
    head = json.loads((both / "campaign.json").read_text())
    head["sensors"] |= {f"{name}-2": sensor for name, sensor in head["sensors"].items()}
    head["sensors"] |= {name: head["sensors"][name] | {"serial": "beside"} for name in ("imet", "hyt")}
    (both / "campaign.json").write_text(json.dumps(head))
    assert main(["history", str(both), str(folder / "c1"), "--serial", "V7"]) == 0
    said = capsys.readouterr()
    assert "alpha of V7: (" in said.out and "in 2 campaigns; nothing has changed" in said.out
    assert "probe 2" in said.out and "left out" not in said.err


def test_emulated_sensors_that_are_all_called_alike_are_not_one_sensor(shelf, tmp_path, capsys):
    """Two seeds had been one sensor, whose film had "changed"."""
    called = {"imet": "virtual-bead", "hyt": "virtual-film"}
    for name in ("c0", "c1"):
        head = json.loads((shutil.copytree(shelf[0] / name, tmp_path / name) / "campaign.json").read_text())
        head["sensors"] = {sensor: head["sensors"][sensor] | {"serial": serial} for sensor, serial in called.items()}
        (tmp_path / name / "campaign.json").write_text(json.dumps(head))
    assert main(["history", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("no serial number; left out") == 2 and "no sensor with two campaigns" in said
    # Without --serial, sensors of two campaigns are charted, as --help says: others were, with nothing to say of them.
    assert main(["history", str(tmp_path), str(shelf[0] / "c2")]) == 2
    assert "c2: the only campaign of its sensors; left out" in capsys.readouterr().err
    assert main(["list", str(tmp_path)]) == 0
    assert "virtual-bead" not in capsys.readouterr().out
    assert serial_numbers(head["sensors"], emulated=False) == called


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "nowhere: is no folder"),
        (["."], "holds no campaign"),
        (["SHELF", "--serial", "60123"], "no sensor with the serial number 60123"),
    ],
)
def test_bad_input_ends_with_one_line(shelf, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert main(["history", *(str(shelf[0]) if word == "SHELF" else word for word in words)]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
