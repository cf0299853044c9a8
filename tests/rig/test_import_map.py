"""What must hold where log, map or arguments are wrong, and where the import dies: one line, and nothing written."""

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from made_up_logs import MAP, WAYS, lines_of, plain_log, text, written

from shockrig.files.campaign import read_campaign
from shockrig.files.campaign_lock import held
from shockrig.files.errors import InputError
from shockrig.protocols.cli import main
from shockrig.rig.logs.map_file import parse_map


def run(*arguments):
    return main(["import", *map(str, arguments)])


# what is wrong -> what is added to the map, or what is put for what in it; what the line says
BAD = {
    "not TOML": ("[sensor", r"map.toml: not TOML: Expected .*; fix the line"),
    "unknown key": ("[log]\nseparater = 'tab'\n", r"map.toml: \[log\]: unknown key 'separater'; did you mean"),
    "unknown table": ("[sensors.x]\n", r"map.toml: unknown key 'sensors'; did you mean 'sensor'"),
    "another format": (("[sensor", 'format = "shock-map/9"\n[sensor'), r'key format: expected "shock-map/1", found'),
    "no sensor": ((MAP, ""), r"map.toml: no \[sensor.NAME\] table"),
    "no column": ((MAP, "[sensor.x]\npressure = 'p'\n"), r"\[sensor.x\]: names no column; add temperature"),
    "misspelt column": (("temperature_c", "temperatur_c"), r"log.csv, line 1: no column 'temperatur_c'; did you mean"),
    "wrong unit": ("temperature_unit = 'hPa'\n", r"key sensor.bead.temperature_unit: expected one of degC, K"),
    "kelvin, says the map": ("temperature_unit = 'K'\n", r"column 'temperature_c': .* read in K, .*temperature_unit"),
    "unknown body": ("thermometer = { body = 'egg' }\n", r"key sensor.bead.thermometer.body: expected one of sphere"),
    "length in mm": ("thermometer = { bead_radius_m = 0.4 }\n", r"bead_radius_m: 0.4 cannot be"),
    "no such reference": ("reference = 'bed'\n", r"sensor.bead.reference: no sensor or column 'bed'; did you mean"),
    "only a reference": ("campaign = false\n", r"every sensor is only another's reference; say campaign = true"),
    "a name no folder can have": (("[sensor.bead]", '[sensor."a/b"]'), r"key sensor.a/b: expected a plain name"),
    "step without a time": ("[[step]]\nuse = true\n", r"key step\[1\].at: is missing"),
    "step outside": ("[[step]]\nat = 999\n", r"key step\[1\].at: 999 is not within the readings of .*0.25 to 339.75"),
    "step on another clock": ("[[step]]\nat = 2024-05-23T14:00:00\n", r"step\[1\].at: .* expected a number, in s"),
    "step of no sensor": ("[[step]]\nat = 80\nsensors = ['x']\n", r"step\[1\].sensors: expected names of .*bead"),
    "until before at": ("[[step]]\nat = 80\nuntil = 70\n", r"step\[1\]: from, at and until must follow"),
    "airflow in km/h": ("[runs]\nairflow_m_s = 1000\n", r"key runs.airflow_m_s: 1000 cannot be"),
    "another log": ("[[step]]\nlog = 'x.csv'\nat = 80\n", r"key step\[1\].log: 'x.csv' is not among the logs"),
    "all left out": (
        "[[step]]\nat = 80\nuse = false\n",
        r"no step makes a run: log.csv: step 1 the map says use = false; ",
    ),
    "steps too small to count": (
        "[steps]\nleast_temperature_k = 50\nleast_humidity_percent = 90\n",
        r"log.csv: no step is seen in it; look at it .* least_temperature_k",
    ),
    "time in another format": ("[log]\ntime = 'time_s'\ntime_format = '%H:%M'\n", r"column time_s: .* time_format"),
    "time and none": ("[log]\ntime = 'time_s'\nevery_s = 1.0\n", r"key log.every_s: .* log.time is stated"),
    "left out, and why": (
        "[[step]]\nat = 80\nuse = false\nnote = 'door stood open'\n",
        r"step 1 the map says use = false: door stood open; ",
    ),
    "no such time": ("[log]\ntime = 'Zeit'\n", r"map.toml: key log.time: no column 'Zeit'"),
    "time unit": ("[log]\ntime_unit = 'hPa'\n", r"key log.time_unit: expected one of s, ms"),
    "not a number": ("[runs]\nbefore_s = 'long'\n", r"key runs.before_s: expected a finite number, found 'long'"),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_bad_map_is_one_line_and_leaves_nothing(tmp_path, capsys, fault):
    change, expected = BAD[fault]
    log = written(tmp_path / "log.csv", WAYS["plain"])
    map_ = written(tmp_path / "map.toml", MAP + change if isinstance(change, str) else MAP.replace(*change))
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and re.search(expected, message), message
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "map.toml"]


BAD_LOGS = {
    "empty": ("", r"log.csv: is empty"),
    "prose": ("It rained.\nAll day long.\n" * 5, r"log.csv: no rows of"),
    "header only": ("time_s,temperature_c,humidity_percent\n", r"log.csv: no rows of numbers"),
    "NUL": (WAYS["plain"].replace("80.25,", "80.25\0\1,"), r"log.csv, line 162: holds a NUL byte"),
    "a column of words": (
        text(lines_of("time_s,temperature_c,humidity_percent", lambda t, a, b, n: f"{t},warm,{b}")),
        r"column 'temperature_c': 'warm' is not a number, nor are most",
    ),
}


@pytest.mark.parametrize("fault", BAD_LOGS)
def test_a_bad_log_is_one_line_and_leaves_nothing(tmp_path, capsys, fault):
    content, expected = BAD_LOGS[fault]
    log, map_ = written(tmp_path / "log.csv", content), written(tmp_path / "map.toml", MAP)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and re.search(expected, message), message
    assert not (tmp_path / "c").exists()


ARGUMENTS = {
    "neither look nor map": (("LOG", "--out", "c"), r"no --map: run shockrig import .* --look first"),
    "no out": (("LOG", "--map", "MAP"), r"--out: is missing"),
    "no log": (("--look",), r"no LOG given"),
    "an option of the other way": (
        ("LOG", "--map", "MAP", "--out", "c", "--airflow", 5),
        r"--airflow: is for one run at a time",
    ),
    "no such sensor": (
        ("LOG", "--map", "MAP", "--sensor", "beat", "--out", "c"),
        r"--sensor beat: .*did you mean 'bead'",
    ),
    "no such map": (("LOG", "--map", "x.toml", "--out", "c"), r"x.toml: .*or one that ships: haar, intermet, rbr"),
    "the log twice": (("LOG", "LOG", "--map", "MAP", "--out", "c"), r"log.csv: is given twice"),
}


@pytest.mark.parametrize("fault", ARGUMENTS)
def test_bad_arguments_are_one_line(tmp_path, capsys, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    plain_log(tmp_path)
    arguments, expected = ARGUMENTS[fault]
    places = {"LOG": "log.csv", "MAP": "map.toml"}
    assert run(*(places.get(a, a) for a in arguments)) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and re.search(expected, message), message
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "map.toml"]


def test_what_is_there_is_not_written_over(tmp_path, capsys):
    log, map_ = plain_log(tmp_path)
    assert run(log, "--look", "--out", tmp_path) == 0
    before = (tmp_path / "log.toml").read_bytes()
    assert run(log, "--look", "--out", tmp_path) == 2
    assert "may hold your corrections" in capsys.readouterr().err
    assert run(log, "--map", map_, "--look", "--out", tmp_path / "again") == 0
    assert sorted(p.name for p in (tmp_path / "again").iterdir()) == ["log.png"]  # the map is the user's
    assert run(log, "--map", map_, "--out", tmp_path) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "log.toml").read_bytes() == before


def test_runs_of_a_second_log_join_a_campaign_once(tmp_path, capsys):
    log, map_ = plain_log(tmp_path)
    again = written(tmp_path / "later.csv", Path(log).read_text(encoding="utf-8") + "\n")
    out = tmp_path / "out"
    assert run(log, "--map", map_, "--out", out) == 0
    before = len(read_campaign(out).runs)
    first = (out / "runs" / "0001" / "run.json").read_bytes()
    assert run(again, "--map", map_, "--out", out) == 0
    assert f"added to {before}" in capsys.readouterr().out
    campaign = read_campaign(out)
    assert len(campaign.runs) == 2 * before and campaign.runs[-1].id == f"{2 * before:04d}"
    assert (out / "runs" / "0001" / "run.json").read_bytes() == first
    assert run(again, "--map", map_, "--out", out) == 2
    assert "has the runs of later.csv already" in capsys.readouterr().err
    assert len(read_campaign(out).runs) == 2 * before


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            "thermometer = { kind = 'other' }\n",
            r"sensors.imet.kind not stated, the map 'other'; one campaign is of one",
        ),
        (("[sensor.bead]", "[sensor.second]"), r"its sensor is 'bead', the map's 'second'; give another --out"),
    ],
)
def test_runs_of_another_sensor_do_not_join(tmp_path, capsys, change, expected):
    log, map_ = plain_log(tmp_path)
    out = tmp_path / "out"
    assert run(log, "--map", map_, "--out", out) == 0
    before = sorted(p.name for p in out.rglob("*"))
    text_ = Path(map_).read_text(encoding="utf-8")
    other = written(tmp_path / "b.toml", text_ + change if isinstance(change, str) else text_.replace(*change))
    later = written(tmp_path / "later.csv", Path(log).read_text(encoding="utf-8") + "\n")
    assert run(later, "--map", other, "--out", out) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and re.search(expected, message), message
    assert sorted(p.name for p in out.rglob("*")) == before


def test_the_map_in_the_documentation_is_one():
    """Every key that docs/importing.md shows is read, and what it says of the sensors is what is meant."""
    page = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")
    map_ = parse_map(page.partition("```toml\n")[2].partition("```")[0], Path("doc.toml"))
    assert map_.wanted == ("open", "closed") and map_.sensors["closed"].reference == ("open",)
    assert map_.time == ("Date", "Time") and map_.layout.separator == "semicolon" and map_.layout.decimal == ","
    (step,) = map_.steps
    assert step.start == 1655.2 and step.facts["source"] == {"temperature_c": 16.0, "humidity_percent": 60.0}


KILLED = """
import os, sys
from shockrig.files import campaign_write
from shockrig.rig.logs import log_campaigns
whole, written = campaign_write.write_run, []
def dies(folder, document, tables, **more):
    if len(written) == 1:
        (folder / "imet.csv").write_text(tables["imet"][:100])
        os.kill(os.getpid(), 9)
    written.append(folder)
    whole(folder, document, tables, **more)
log_campaigns.write_run = dies
from shockrig.protocols.cli import main
from shockrig.rig.logs.map_file import parse_map
main(sys.argv[1:])
"""


def test_two_names_of_the_same_bytes_are_one_log(tmp_path, capsys):
    """Given together, and one after the other: they would be fitted and then called unseen."""
    log, map_ = plain_log(tmp_path)
    again = written(tmp_path / "again.csv", log.read_bytes())
    both = ["import", str(log), str(again), "--map", str(map_), "--out", str(tmp_path / "c")]
    assert main(both) == 2 and not (tmp_path / "c").exists()
    assert "again.csv: holds the same bytes as" in capsys.readouterr().err
    assert main([*both[:2], *both[3:]]) == 0
    assert main([both[0], *both[2:]]) == 2
    assert "has the runs of again.csv already as log.csv, which holds the same bytes" in capsys.readouterr().err


def test_a_folder_that_another_writes_to_is_left_alone(tmp_path, capsys):
    log, map_ = plain_log(tmp_path)
    command = ["import", str(log), "--map", str(map_), "--out", str(tmp_path / "c")]
    (tmp_path / "c").mkdir()
    with held(tmp_path / "c"):
        assert main(command) == 2
    assert "another recording or import is writing to this campaign" in capsys.readouterr().err
    assert main(command) == 0


def test_a_killed_import_leaves_no_run(tmp_path):
    """Killed within the second run: no reader finds a campaign, and the same command then makes a whole one."""
    log, map_ = plain_log(tmp_path)
    command = ["import", str(log), "--map", str(map_), "--out", str(tmp_path / "c")]
    done = subprocess.run([sys.executable, "-c", KILLED, *command], capture_output=True, text=True)
    assert done.returncode == -9, done.stderr
    deadline = time.monotonic() + 30.0  # what was half written is removed by a process that outlives it
    while (left := sorted(p.name for p in tmp_path.iterdir())) != ["log.csv", "map.toml"]:
        assert time.monotonic() < deadline, left
        time.sleep(0.02)
    with pytest.raises(InputError):
        read_campaign(tmp_path / "c")
    assert main(command) == 0
    assert len(read_campaign(tmp_path / "c").runs) == 3
