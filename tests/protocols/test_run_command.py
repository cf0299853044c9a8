"""What must hold for whoever types `shockrig run` and `shockrig status`: the whole way through the real drivers."""

import json
import math
import shutil
import signal
import subprocess
import sys
import time
from importlib import resources
from pathlib import Path

import jsonschema
import pytest
from processes import ended, in_background, wait_for

from shockrig.protocols.cli import COMMANDS, main
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.hide import open_seal

TINY = """
format = "shock-protocol/1"
name = "tiny"
airflow_m_s = 6.0
[steps]
usual = [
  { do = "soak", over_s = 2, at_most_s = 60, probes_within_k = 1, probes_within_percent = 2 },
  { do = "record", for_s = 2 },
  { do = "transfer" },
  { do = "record", for_s = 3 },
]
[[run]]
source = { temperature_c = 20, humidity_percent = 50 }
destination = { temperature_c = 30, humidity_percent = 30 }
[[run]]
source = { temperature_c = 30, humidity_percent = 30 }
destination = { temperature_c = 20, humidity_percent = 50 }
"""


@pytest.fixture
def tiny(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return path


def run(*arguments):
    return main(["run", *map(str, arguments)])


def rows(path):
    names, *lines = [line.split(",") for line in path.read_text().splitlines()]
    return [dict(zip(names, map(float, line), strict=True)) for line in lines]


def test_emulated_sensors_of_two_seeds_are_two(tiny, tmp_path):
    """`list` and `history` had made one history of all sensors of the virtual bench."""
    for name, seed in (("a", 1), ("b", 2), ("c", 1)):
        assert run(tiny, "--seed", seed, "--probes", 2, "--out", tmp_path / name) == 0
    sensors = [json.loads((tmp_path / name / "campaign.json").read_text())["sensors"] for name in "abc"]
    assert sensors[0] == sensors[2]
    assert len({sensor["serial"] for one in sensors for sensor in one.values()}) == 8


def check_schema(name, path):
    schema = json.loads((resources.files("shockrig.data") / "schemas" / f"{name}.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(json.loads(path.read_text()), schema)


def test_quick_campaign_on_the_embedded_bench(tmp_path, capsys):
    out = tmp_path / "quick"
    assert run("quick", "--out", out, "--seed", 5) == 0
    said = capsys.readouterr()
    assert f"2 runs in {out}" in said.out and f"sealed truth: {out}.sealed" in said.out
    assert "run 0001 (1/2): 20 degC 55 %RH -> 40 degC 17 %RH, 6 m/s" in said.err
    check_schema("shock-campaign-1", out / "campaign.json")
    for folder in (out / "runs").iterdir():
        check_schema("shock-run-1", folder / "run.json")
    truth, seed = open_seal(Path(f"{out}.sealed"))
    assert seed == 5 and truth.effects == ()
    # The bead's plateaus are the airs of the plan; the sensor's t63 is that of the sealed alpha (.17091 R^2 / alpha).
    head = json.loads((out / "runs/0001/run.json").read_text())
    imet = rows(out / "runs/0001/imet.csv")
    start_s = head["transfer"]["start_s"]
    before = [row["temperature_c"] for row in imet if row["time_s"] < start_s]
    assert sum(before) / len(before) == pytest.approx(20.0, abs=0.05)
    assert imet[-1]["temperature_c"] == pytest.approx(40.0, abs=0.2)
    level_c = 20 + 20 * (1 - math.exp(-1))
    late = next(i for i, row in enumerate(imet) if row["time_s"] > start_s and row["temperature_c"] > level_c)
    (t0, v0), (t1, v1) = ((imet[i]["time_s"], imet[i]["temperature_c"]) for i in (late - 1, late))
    t63_s = t0 + (level_c - v0) / (v1 - v0) * (t1 - t0) - start_s
    expected_s = 0.17091 * truth.bead_radius_m**2 / truth.thermal_diffusivity_m2_s
    assert t63_s == pytest.approx(expected_s, abs=0.05)  # interpolated between samples 0.1 s apart
    # No truth within the campaign.
    text = "".join(p.read_text() for p in out.rglob("*") if p.is_file())
    assert f"{truth.thermal_diffusivity_m2_s:.4g}"[:5] not in text


def test_the_same_seed_gives_the_same_readings(tmp_path, tiny):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert run(tiny, "--out", tmp_path / name, "--seed", seed) == 0
    first, again, other = ((tmp_path / n / "runs/0002/hyt.csv").read_bytes() for n in "abc")
    assert first == again and first != other


def test_hidden_effects_are_sealed_beside_the_campaign(tmp_path, tiny):
    out = tmp_path / "c"
    sealed = tmp_path / "elsewhere.json"
    assert run(tiny, "--out", out, "--hide", "stem_conduction,quantization", "--sealed", sealed, "--rough") == 0
    truth, _ = open_seal(sealed)
    assert {hidden.effect for hidden in truth.effects} == {"stem_conduction", "quantization"}
    assert truth.trigger_jitter_s > 0
    assert not (tmp_path / "c.sealed").exists()
    everything = b"".join(p.read_bytes() for p in out.rglob("*") if p.is_file())
    assert b"stem_conduction" not in everything and b"quantization" not in everything


def test_a_link_in_a_circle_is_refused_in_a_line(tmp_path, tiny, capsys):
    for name in ("c.sealed", "c"):
        (tmp_path / name).symlink_to(name)
        assert run(tiny, "--out", tmp_path / "c") == 2
        said = capsys.readouterr().err.splitlines()
        assert len([line for line in said if line.startswith("shockrig run: ")]) == 1
        assert not any("Traceback" in line for line in said)
        (tmp_path / name).unlink()
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_a_campaign_goes_on_with_the_same_sensors(tmp_path, tiny, capsys):
    out = tmp_path / "c"
    assert run(tiny, "--out", out, "--hide", "stem_conduction") == 0
    truth = open_seal(Path(f"{out}.sealed"))
    shutil.rmtree(out / "runs/0002")
    assert main(["status", str(out)]) == 0
    assert "missing: 0002" in capsys.readouterr().out
    assert run(tiny, "--out", out, "--hide", "stem_conduction") == 0
    assert "(1 recorded now)" in capsys.readouterr().out
    assert open_seal(Path(f"{out}.sealed")) == truth
    assert run(tiny, "--out", out) == 0 and "(0 recorded now)" in capsys.readouterr().out


def test_dry_run_prints_the_plan_and_touches_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("standard", "--dry-run") == 0
    plan = capsys.readouterr().out
    assert "36 runs on virtual bench (emulated instruments) with imet, hyt" in plan
    assert "soak at the source until the reference is stable to 0.05 K and 0.3 %RH over 30 s, at most 20 min" in plan
    assert "bench time: 79 min where every soak is stable at once" in plan
    assert plan.endswith("ready: shockrig run standard --out CAMPAIGN\n")  # what shockrig check says
    assert run("standard", "--dry-run", "--seed", 3, "--rough", "--fleet", 7, "--out", "new one") == 0
    assert capsys.readouterr().out.endswith(
        "ready: shockrig run standard --out 'new one' --fleet 7 --seed 3 --rough\n"  # no others than those looked at
    )
    assert list(tmp_path.iterdir()) == []


REFUSED = {
    "no out": ([], r"--out CAMPAIGN is missing"),
    "no such effect": (["--out", "c", "--hide", "gremlins"], r"gremlins.* is not known"),
    "no such bench": (["--out", "c", "--bench", "nowhere.toml"], r"nowhere.toml: No such file"),
    "seal within": (["--out", "c", "--sealed", "old/truth.json"], r"lies in the campaign"),
    "not a campaign": (["--out", "thesis"], r"neither empty nor a campaign"),
    "an old seal": (["--out", "d"], r"d.sealed: is the sealed truth of another campaign"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_is_refused_leaves_nothing_behind(tmp_path, tiny, capsys, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").mkdir()
    (tmp_path / "old/campaign.json").write_text("{}")
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis/chapter1.tex").write_text("years of work")
    (tmp_path / "d.sealed").write_text("")
    before = sorted(tmp_path.rglob("*"))
    arguments, message = REFUSED[fault]
    assert run(tiny, *arguments) == 2
    error = capsys.readouterr().err
    assert __import__("re").search(message, error) and error.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_options_for_emulated_sensors_are_refused_on_a_real_bench(tmp_path, tiny, capsys):
    bench = resources.files("shockrig.data") / "benches" / "manual.toml"
    for option in (["--seed", "1"], ["--hide", "none"], ["--sealed", "x"], ["--rough"]):
        assert run(tiny, "--bench", bench, "--out", tmp_path / "c", *option) == 2
        assert f"{option[0]} is for emulated instruments" in capsys.readouterr().err


def test_status_of_what_is_not_a_campaign(tmp_path, capsys):
    remedy = "give the folder that holds campaign.json"
    assert f"nope: no such campaign folder; {remedy}" in refused(capsys, "status", str(tmp_path / "nope"))
    assert f"is no campaign (it has no campaign.json); {remedy}" in refused(capsys, "status", str(tmp_path))
    (tmp_path / "campaign.json").write_text("{")
    error = refused(capsys, "status", str(tmp_path))
    assert "campaign.json, line 1: not JSON" in error and "fix or restore the file" in error


# command -> its arguments, without an --out
ARGUMENTS = {
    "example": ["steps.csv"],
    "characterize": ["c"],
    "diagnose": ["c"],
    "correct": ["f.csv", "--profile", "p.json"],
    "simulate": ["frontal"],
    "demo": [],
    "tour": [],
    "demo-flights": [],
    "onboard": ["p.json"],
    "emulate": ["imet-xf"],
    "import": ["--imet", "log.csv"],
    "plan": ["c", "--until", "alpha 1 %"],
    "run": ["quick"],
    "check": [],
    "scan": [],
    "slips": [],
    "export": ["c"],
    "certify": ["c"],
    "history": ["c"],
    "fleet": ["c"],
    "learn": ["f.csv"],
    "fly": ["--bench", "drone", "--profile", "p.json"],
    "hil": ["f.csv"],
}


def refused(capsys, *arguments):
    """The one line that a command refuses its arguments with."""
    assert main([*arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_an_empty_out_and_a_seed_beyond_64_bits(tmp_path, capsys, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main([command, "--help"])
    usage = capsys.readouterr().out.partition("\n\n")[0]
    given = ARGUMENTS.get(command)
    if "--out " in usage:
        for empty in (["--out", ""], ["--out", "  "], ["--out="]):
            assert "--out: is empty; give a value" in refused(capsys, command, *given, *empty)
    if "--seed " in usage:
        out = ["--out", "out"] if "--out " in usage else []
        for seed in (str(2**64), "1" * 40, "-1"):
            error = refused(capsys, command, *given, *out, "--seed", seed)
            assert f"--seed {seed}: expected" in error and "64 bits" in error
    if "--hide " in usage:
        assert "--hide: is empty" in refused(capsys, command, *given, "--out", "out", "--hide", "")
    assert list(tmp_path.iterdir()) == []


def test_an_empty_argument_is_refused(capsys):
    assert refused(capsys, "status", "") == "shockrig status: an argument is empty; give a value\n"


def test_the_largest_seed_can_be_recorded_with_and_gone_on_with(tmp_path, tiny):
    out = tmp_path / "c"
    assert run(tiny, "--out", out, "--seed", 2**64 - 1) == 0
    shutil.rmtree(out / "runs/0002")
    assert run(tiny, "--out", out) == 0
    assert open_seal(Path(f"{out}.sealed"))[1] == 2**64 - 1


@pytest.mark.elsewhere
@pytest.mark.parametrize(
    ("number", "begin", "code"),
    [
        (signal.SIGINT, None, 130),
        (signal.SIGINT, in_background, 130),
        (signal.SIGTERM, in_background, 128 + signal.SIGTERM),
    ],
)
def test_a_signal_leaves_a_campaign_that_goes_on(tmp_path, number, begin, code):
    out = tmp_path / "c"
    command = [sys.executable, "-m", "shockrig", "run", "quick", "--out", str(out)]
    root = Path(__file__).parents[2]
    process = subprocess.Popen(command, cwd=root, stderr=subprocess.PIPE, text=True, preexec_fn=begin)
    wait_for(lambda: list(out.glob("recording/*/journal.log")), process)
    time.sleep(0.1)
    _, errors = ended(process, number)
    assert process.returncode == code and "Traceback" not in errors
    assert not list(out.glob("recording/*"))
    finished = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=300)
    assert finished.returncode == 0 and "2 runs in" in finished.stdout


def test_a_campaign_and_its_seal_go_into_folders_that_are_not_there_yet(tmp_path, tiny):
    assert run(tiny, "--seed", "1", "--out", tmp_path / "may" / "first" / "campaign") == 0
    assert open_seal(tmp_path / "may" / "first" / "campaign.sealed")[1] == 1


def test_of_a_recording_that_is_not_begun_no_folder_is_left(tmp_path, tiny, monkeypatch):
    def refuse(*arguments, **settings):
        raise BenchError("no")

    monkeypatch.setattr("shockrig.rig.runner.record_campaign", refuse)
    assert run(tiny, "--seed", "1", "--out", tmp_path / "may" / "campaign") == 2
    assert list(tmp_path.iterdir()) == [tiny]


REAL = """
[bench]
name = "my bench"
clock = "real"
[sensors.imet]
kind = "imet-xf"
port = "{0}/no-imet"
[sensors.hyt]
kind = "hyt-271"
bus = "{0}/no-i2c"
[stage]
kind = "manual"
[reference]
kind = "set-points"
"""


def test_a_start_that_fails_leaves_nothing_and_says_each_fault_with_its_remedy(tmp_path, tiny, capsys):
    bench = tmp_path / "bench.toml"
    bench.write_text(REAL.format(tmp_path))
    before = sorted(tmp_path.rglob("*"))
    assert run(tiny, "--bench", bench, "--out", tmp_path / "may" / "c") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    remedies = {
        "imet (imet-xf on": "no such port: check that it is plugged in",
        "hyt (hyt-271 on": "no such bus: switch I2C on",
    }
    for line, (name, remedy) in zip(lines, remedies.items(), strict=True):
        assert line.startswith(f"shockrig run: {name}") and remedy in line
    assert sorted(tmp_path.rglob("*")) == before


def test_a_start_that_fails_leaves_an_older_campaign_as_it_was(tmp_path, tiny, capsys):
    bench = tmp_path / "bench.toml"
    bench.write_text(REAL.format(tmp_path))
    old = tmp_path / "c"
    old.mkdir()
    assert run(tiny, "--bench", bench, "--out", old) == 2
    assert old.is_dir() and not list(old.iterdir())


def test_going_on_with_a_real_campaign_speaks_of_its_bench_and_of_no_seal(tmp_path, tiny, capsys):
    out = tmp_path / "c"
    assert run(tiny, "--out", out, "--seed", 1) == 0
    head = json.loads((out / "campaign.json").read_text())
    assert head["emulated"] is True
    head |= {"emulated": False, "bench": "my bench"}  # as if recorded there
    (out / "campaign.json").write_text(json.dumps(head))
    Path(f"{out}.sealed").unlink()
    capsys.readouterr()
    error = refused(capsys, "run", str(tiny), "--out", str(out))
    assert "was recorded on the bench 'my bench', not on emulated instruments; name it by --bench" in error
    assert "seal" not in error


def test_emulated_instruments_cannot_be_forgotten(tmp_path, tiny, capsys):
    """In the first line, in the plan, in campaign.json, and to whoever watches."""
    out = tmp_path / "c"
    assert run(tiny, "--dry-run") == 0
    assert "2 runs on virtual bench (emulated instruments)" in capsys.readouterr().out
    assert run(tiny, "--out", out, "--seed", 1) == 0
    first = capsys.readouterr().err.splitlines()[0]
    assert first == "emulated instruments: what is recorded now is invented by the virtual bench, not measured"
    assert json.loads((out / "campaign.json").read_text())["emulated"] is True
    assert main(["status", str(out)]) == 0
    assert "emulated instruments: invented, not measured" in capsys.readouterr().out
    assert main(["watch", str(out), "--once"]) == 0
    assert "EMULATED" in capsys.readouterr().out
    assert main(["characterize", str(out), "--out", str(tmp_path / "r")]) == 0
    said = "emulated instruments: invented, not measured (campaign c)"
    assert (
        f'<h1>Characterization of c</h1>\n<p class="warning"><strong>{said}' in (tmp_path / "r/report.html").read_text()
    )
    assert json.loads((tmp_path / "r/profile.json").read_text())["provenance"]["data"] == said


@pytest.fixture
def by_hand(tmp_path, monkeypatch):
    """The shipped protocol for a person, cut to its first two runs."""
    monkeypatch.chdir(tmp_path)
    whole = (resources.files("shockrig.data") / "protocols" / "manual.toml").read_text()
    path = Path("manual.toml")
    path.write_text("[[run]]".join(whole.split("[[run]]")[:3]))
    return path


def test_a_protocol_for_a_person_asks_for_the_bench(by_hand, capsys):
    error = refused(capsys, "run", "manual", "--out", "c")
    assert "--bench is missing" in error and "give --bench virtual for invented data" in error
    assert list(Path().iterdir()) == [by_hand]
    assert run("manual", "--dry-run") == 0  # nothing is recorded
    assert run(by_hand, "--bench", "virtual", "--out", "c") == 0
    assert json.loads(Path("c/campaign.json").read_text())["emulated"] is True


@pytest.mark.parametrize(("answer", "records"), [("", False), ("q", False), ("no", False), ("yes", True)])
def test_the_question_at_a_terminal_takes_nothing_but_yes_for_yes(by_hand, capsys, monkeypatch, answer, records):
    import io

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("sys.stdin", Terminal(f"{answer}\n"))
    assert run(by_hand, "--out", "c") == (0 if records else 2)
    assert Path("c").exists() == records
    assert "Record invented data on the virtual bench instead? [yes/No]" in capsys.readouterr().err


def test_shipped_benches_go_by_their_names(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("quick", "--bench", "raspberry-pi", "--dry-run") == 1  # its instruments are not here
    said = capsys.readouterr().out
    assert "2 runs on raspberry pi with imet, hyt" in said and "\nnot ready, " in said
    error = refused(capsys, "run", "quick", "--bench", "pi", "--dry-run")
    assert "or one of drone, manual, raspberry-pi, virtual" in error
