"""Several probes of one kind in one campaign: recorded at once, each read, judged and characterized by itself."""

import json
import tomllib
from importlib import resources
from types import SimpleNamespace

import numpy as np
import pytest

from shockrig.files.campaign import read_campaign, read_probes
from shockrig.files.campaign_names import probes_of, sensor_and_probe, sensor_name
from shockrig.files.errors import InputError
from shockrig.files.profile import read_profile
from shockrig.protocols.cli import main
from shockrig.protocols.reveal import score
from shockrig.rig.bench import open_bench
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import check_bench
from shockrig.rig.protocol import Faults
from shockrig.rig.recorder import judge
from shockrig.rig.seams import Air, Move, Outcome, Reading
from shockrig.rig.virtual.hide import open_seal
from shockrig.rig.virtual.truth import of_probe

VIRTUAL = (resources.files("shockrig.data") / "benches" / "virtual.toml").read_text()
SECOND = """
[sensors.imet-2]
kind = "imet-xf"
port = "virtual"
serial = "second-bead"

[sensors.hyt-2]
kind = "hyt-271"
bus = "virtual"
serial = "second-film"
conversion_s = 0.07

[stage]"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two probes recorded at once and characterized."""
    folder = tmp_path_factory.mktemp("probes")
    (folder / "bench.toml").write_text(VIRTUAL.replace("\n[stage]", SECOND))
    assert main(["run", "quick", "--bench", str(folder / "bench.toml"), "--out", str(folder / "c"), "--seed", "3"]) == 0
    assert main(["characterize", str(folder / "c"), "--out", str(folder / "p")]) == 0
    return folder


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("imet", ("imet", "1")),
        ("hyt-2", ("hyt", "2")),
        ("imet-left", ("imet", "left")),
        ("imet-1", None),
        ("imet-", None),
        ("imet-a/b", None),
        ("air", None),
        ("imet.8", None),
    ],
)
def test_names_of_probes_sensors(name, place):
    assert sensor_and_probe(name) == place
    if place is not None:
        assert sensor_name(*place) == name


def test_probes_are_in_their_order():
    assert probes_of(["hyt-10", "imet-2", "imet", "air", "imet-left", "hyt-2"]) == ("1", "2", "10", "left")


def test_every_probe_is_recorded_and_other_programs_read_the_first(recorded):
    stated = json.loads((recorded / "c/campaign.json").read_text())["sensors"]
    assert list(stated) == ["imet", "hyt", "imet-2", "hyt-2"] and stated["hyt-2"]["serial"] == "second-film"
    for name in stated:
        assert (recorded / "c/runs/0001" / f"{name}.csv").is_file()
    assert read_probes(recorded / "c") == ("1", "2")
    first, second = read_campaign(recorded / "c"), read_campaign(recorded / "c", "2")
    assert set(first.sensors) == set(second.sensors) == {"imet", "hyt"}
    assert second.sensors["imet"]["serial"] == "second-bead" and second.name == f"{first.name}, probe 2"
    # a reader that knows nothing of probes
    columns = np.loadtxt(recorded / "c/runs/0001/imet.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(columns[:, 1], first.runs[0].imet.values["temperature_c"])
    assert not np.array_equal(columns[:, 1], second.runs[0].imet.values["temperature_c"][: len(columns)])


def alpha_within_four(folder, truth):
    """A profile's alpha; it and D lie within four of their uncertainties of what is true."""
    profile = read_profile(folder / "profile.json")
    alpha = profile.temperature.thermal_diffusivity_m2_s
    assert abs(alpha.value - truth.thermal_diffusivity_m2_s) < 4 * alpha.standard_uncertainty
    (row,) = profile.humidity.diffusivity_table
    true = truth.diffusivity_m2_s(row.ambient_temperature_c)
    assert abs(row.diffusivity_m2_s - true) < 4 * row.standard_uncertainty
    return alpha


def test_each_probe_has_its_own_rates(recorded):
    """Both within four of their uncertainties of what is true of them, and far from one another."""
    truth, _ = open_seal(recorded / "c.sealed")
    found = {}
    for probe, its, folder in (("1", truth, "p"), ("2", of_probe(truth, "2"), "p/probe-2")):
        found[probe] = alpha_within_four(recorded / folder, its)
    apart = abs(found["1"].value - found["2"].value)
    assert apart > 10 * max(one.standard_uncertainty for one in found.values())
    assert ", probe 2" in (recorded / "p/probe-2/report.html").read_text()


def test_one_probe_alone_goes_where_it_is_told(recorded, capsys):
    capsys.readouterr()
    assert main(["characterize", str(recorded / "c"), "--out", str(recorded / "alone"), "--probe", "2"]) == 0
    assert "probe 1" not in capsys.readouterr().out and not (recorded / "alone/probe-2").exists()
    both = [read_profile(recorded / folder / "profile.json") for folder in ("alone", "p/probe-2")]
    assert both[0].temperature == both[1].temperature
    with pytest.raises(InputError, match="no probe '3'; name one of 1, 2"):
        read_campaign(recorded / "c", "3")


def test_a_further_probe_is_exported_and_listed(recorded, capsys):
    out = recorded / "second.jsonl"
    assert main(["export", str(recorded / "c"), "--probe", "2", "--out", str(out)]) == 0
    (descriptor,) = {
        line["data_keys"]["imet_temperature_c"]["source"]
        for kind, line in map(json.loads, out.read_text().splitlines())
        if kind == "descriptor" and line["name"] == "imet"
    }
    assert descriptor == "imet-xf second-bead"
    assert main(["list", str(recorded)]) == 0
    said = capsys.readouterr().out
    assert "imet-2 second-bead" in said and "p/probe-2: alpha" in said and "sigma" not in said


def test_the_seal_is_opened_for_a_probe(recorded):
    stated = {"format": "shock-diagnosis/1", "campaign": "c", "channels": {"temperature": {"verdict": "adequate"}}}
    first, second = (score(recorded / "c.sealed", stated, probe) for probe in ("1", "2"))
    assert first.truth.thermal_diffusivity_m2_s != second.truth.thermal_diffusivity_m2_s
    assert second.truth.effects == first.truth.effects


ONE_UNIT = """[sensors.imet]
kind = "imet-xf"
port = "virtual"

[sensors.hyt]
kind = "imet-humidity"

[sensors.imet-2]
kind = "imet-bead"
serial = "NTC B"

[sensors.hyt-2]
kind = "imet-humidity"
line = "17"

"""


def test_both_beads_and_films_of_one_unit_are_recorded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bench = VIRTUAL[: VIRTUAL.index("[sensors.imet]")] + ONE_UNIT + VIRTUAL[VIRTUAL.index("[stage]") :]
    (tmp_path / "b.toml").write_text(bench)
    assert main(["run", "quick", "--bench", "b.toml", "--out", "c", "--seed", "5"]) == 0
    stated = json.loads((tmp_path / "c/campaign.json").read_text())["sensors"]
    assert {name: one["kind"] for name, one in stated.items()} == {
        "imet": "imet-xf", "hyt": "hyt-271", "imet-2": "imet-xf", "hyt-2": "hyt-271",
    }  # fmt: skip
    truth, _ = open_seal(tmp_path / "c.sealed")
    assert main(["characterize", "c", "--out", "p"]) == 0
    for its, folder in ((truth, "p"), (of_probe(truth, "2"), "p/probe-2")):
        alpha_within_four(tmp_path / folder, its)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('line = "17"', 'line = "4"', 'line = "4": lines of "imet" with this id bring no humidity_percent .*8, 17'),
        ('kind = "imet-bead"', 'kind = "imet-bead"\nthrough = "hyt"', 'through = "hyt" names no iMet sensor'),
    ],
)
def test_what_a_unit_does_not_read_is_no_sensor(tmp_path, old, new, says):
    bench = VIRTUAL[: VIRTUAL.index("[sensors.imet]")] + ONE_UNIT + VIRTUAL[VIRTUAL.index("[stage]") :]
    with pytest.raises(BenchError, match=says):
        open_bench(check_bench(tomllib.loads(bench.replace(old, new)), "bench.toml"))


def test_a_bench_names_its_probes(tmp_path):
    def bench(old, new):
        return check_bench(tomllib.loads(VIRTUAL.replace(old, new)), "bench.toml")

    assert list(bench("[sensors.hyt]", "[sensors.hyt-2]").sensors) == ["imet", "hyt-2"]
    with pytest.raises(BenchError, match=r"unknown key 'bme'.*known: imet, hyt, imet-2, hyt-2"):
        bench("[sensors.hyt]", "[sensors.bme]")
    with pytest.raises(BenchError, match="unknown key 'imet-1'"):
        bench("[sensors.imet]", "[sensors.imet-1]")
    only = tomllib.loads(VIRTUAL)
    only["sensors"] = {f"{name}-2": table for name, table in only["sensors"].items()}
    with pytest.raises(BenchError, match="first probe's sensors are called imet and hyt"):
        check_bench(only, "bench.toml")


def test_a_run_counts_only_with_every_probe_in_its_airs():
    def readings(name, after_c):
        return tuple(
            Reading(name, Outcome.OK, t, t, {"temperature_c": 40.0 if t < 5.0 else after_c}, b"", t)
            for t in np.arange(0.0, 40.0, 0.1).tolist()
        )

    def record(second_c):
        both = {"imet": readings("imet", 20.0), "imet-2": readings("imet-2", second_c)}
        return SimpleNamespace(
            header={"sensors": list(both)},
            zero_s=0.0,
            last_s=40.0,
            move=Move(5.0, 5.2),
            airs={"source": [Air(40.0, 20.0)], "destination": [Air(20.0, 50.0)]},
            recorded=both.__getitem__,
        )

    assert judge(record(20.5), Faults()) is None
    assert judge(record(38.0), Faults()).startswith("imet-2 stood at 38.0 degC in the destination air")
