"""Files that are not what they seem, through the commands: each is refused in one line with status 2, without waiting,
without a traceback, and without leaving anything behind."""

import base64
import copy
import hashlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import zlib
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from processes import PATIENCE_S, ended, heard

from shockrig.analysis.effects import CATALOGUE
from shockrig.files.campaign import read_campaign
from shockrig.protocols.cli import main
from shockrig.protocols.folder import whole_folder
from shockrig.rig.virtual.hide import open_seal, seal
from shockrig.rig.virtual.truth import draw_truth

pytestmark = pytest.mark.timeout(300)

PROFILE = {
    "format": "sensor-profile/1",
    "temperature": {"thermal_diffusivity_m2_s": {"value": 7.5e-8, "standard_uncertainty": 2e-10}},
    "humidity": {"diffusivity_table": [{"ambient_temperature_c": 20.0, "diffusivity_m2_s": 8e-12}]},
}
DIAGNOSIS = {"format": "shock-diagnosis/1", "channels": {"temperature": {"verdict": "adequate", "causes": []}}}


def a_pipe(path):
    os.mkfifo(path)


def a_socket(path):
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(os.path.relpath(path))  # the name of a socket is short


def a_folder(path):
    path.mkdir()


def an_endless_device(path):
    path.symlink_to("/dev/zero")


def a_circle(path):
    path.symlink_to(path.name)


ODD = (a_pipe, a_socket, a_folder, an_endless_device, a_circle)


def flight(path, times_s=None):
    """A quiet flight of 200 rows."""
    times_s = np.arange(200) * 0.1 if times_s is None else times_s
    rows = [f"{t!r},{20 + 0.01 * (i % 50):.3f},{50 + 0.02 * (i % 40):.3f}" for i, t in enumerate(map(float, times_s))]
    path.write_text("\n".join(["time_s,temperature_c,humidity_percent", *rows, ""]))
    return path


def profile(path, **channels):
    content = copy.deepcopy(PROFILE)
    for channel, changes in channels.items():
        content[channel] |= changes
    path.write_text(json.dumps(content))
    return path


def campaign(path):
    """Two short runs, as another logger would have them."""
    for number in ("0001", "0002"):
        folder = path / "runs" / number
        folder.mkdir(parents=True)
        (folder / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": number}))
        (folder / "imet.csv").write_text("time_s,temperature_c\n0,20\n1,21\n")
        (folder / "hyt.csv").write_text("time_s,humidity_percent,temperature_c,stale\n0,20,20,0\n1,21,20,0\n")
    (path / "campaign.json").write_text('{"format": "shock-campaign/1", "name": "c"}')
    return path


def entries(folder):
    return sorted(os.path.join(where, name) for where, folders, files in os.walk(folder) for name in folders + files)


def refused(capsys, words, *arguments):
    """Run a command that must refuse: status 2, one line of its own with these words, nothing more on the disk."""
    before = entries(".")
    assert main([str(argument) for argument in arguments]) == 2
    said = capsys.readouterr()
    own = [line for line in said.err.splitlines() if line.startswith(f"shockrig {arguments[0]}: ")]
    assert len(own) == 1 and "Traceback" not in said.err, said.err
    assert words in own[0]
    assert entries(".") == before
    return own[0]


READING = {
    "the flight of correct": lambda odd: ("correct", odd, "--profile", "p.json", "--out", "o.csv"),
    "the profile of correct": lambda odd: ("correct", "f.csv", "--profile", odd, "--out", "o.csv"),
    "the diagnosis of characterize": lambda odd: ("characterize", "c", "--extend", odd, "--out", "o"),
    "the log of import": lambda odd: ("import", "--imet", odd, "--out", "o"),
    "the log of import --map": lambda odd: ("import", odd, "--map", "haar", "--out", "o"),
    "the map of import": lambda odd: ("import", "f.csv", "--map", odd, "--out", "o"),
    "the profile of simulate": lambda odd: ("simulate", "inversion", "--profile", odd, "--out", "o"),
    "the protocol of run": lambda odd: ("run", odd, "--out", "o"),
    "the bench of run": lambda odd: ("run", "quick", "--bench", odd, "--out", "o"),
    "the bench of check": lambda odd: ("check", "--bench", odd),
    "the seal of reveal": lambda odd: ("reveal", odd, "--diagnosis", "none"),
    "the flight of emulate": lambda odd: ("emulate", "imet-xf", "--flight", odd),
    "the profile of emulate": lambda odd: ("emulate", "imet-xf", "--flight", "f.csv", "--profile", odd),
}
FLOWN = ("correct", "f.csv", "--profile", "p.json", "--out")
WRITING = {
    "correct": lambda odd: (*FLOWN, odd),
    "correct, netCDF": lambda odd: (*FLOWN, odd),
    "export": lambda odd: ("export", campaign(Path("c")), "--out", odd),
    "the seal of run": lambda odd: ("run", "quick", "--out", "o", "--sealed", odd),
    "the truth of emulate": lambda odd: ("emulate", "imet-xf", "--flight", "f.csv", "--truth", odd),
    "the library of emulate": lambda odd: ("emulate", "hyt-271", "--build", odd),
}


@pytest.mark.parametrize("make", ODD, ids=lambda make: make.__name__)
@pytest.mark.parametrize("case", READING)
def test_what_is_no_file_is_not_read(tmp_path, monkeypatch, capsys, case, make):
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv")), profile(Path("p.json")), campaign(Path("c"))
    make(Path("odd"))
    refused(capsys, "odd", *READING[case]("odd"))


@pytest.mark.parametrize("make", ODD, ids=lambda make: make.__name__)
@pytest.mark.parametrize("case", WRITING)
def test_what_is_no_file_is_not_written_over(tmp_path, monkeypatch, capsys, case, make):
    """A rename onto a pipe or a device would take its name away: as root, /dev/null's too."""
    monkeypatch.chdir(tmp_path)
    odd = Path("odd.nc" if "netCDF" in case or case == "export" else "odd")
    flight(Path("f.csv")), profile(Path("p.json"))
    make(odd)
    refused(capsys, "odd", *WRITING[case](odd))
    assert os.path.lexists(odd) and not (odd.is_file() and not odd.is_symlink())


@pytest.mark.parametrize("make", ODD, ids=lambda make: make.__name__)
@pytest.mark.parametrize(
    "name", ["campaign.json", "runs", "runs/0001/run.json", "runs/0001/imet.csv", "runs/0001/hyt.csv"]
)
def test_nothing_in_a_campaign_hangs_a_command(tmp_path, monkeypatch, capsys, name, make):
    monkeypatch.chdir(tmp_path)
    odd = campaign(Path("c")) / name
    shutil.rmtree(odd) if odd.is_dir() else odd.unlink()
    make(odd)
    refused(capsys, str(odd), "characterize", "c", "--out", "o")
    if name == "campaign.json":
        for command in (("status", "c"), ("watch", "c", "--once"), ("run", "quick", "--out", "c")):
            refused(capsys, str(odd), *command)
    else:
        assert main(["watch", "c", "--once"]) == 0


def test_a_pipe_in_place_of_a_journal_hangs_neither_who_watches_nor_who_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "quick", "--out", "c", "--seed", "1"]) == 0
    os.remove("c/runs/0001/journal.log")
    os.mkfifo("c/runs/0001/journal.log")
    assert main(["watch", "c", "--once"]) == 0
    os.mkdir("c/recording")
    os.rename("c/runs/0001", "c/recording/0001")
    assert main(["run", "quick", "--out", "c"]) == 0
    assert "journal.log: is a pipe" in capsys.readouterr().err
    assert Path("c/set_aside/0001-1").is_dir() and Path("c/runs/0001/run.json").is_file()


@pytest.fixture
def as_nobody():
    """A folder in which this process has no rights but its own: root may read everything."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        os.chmod(folder, 0o777)
        root = os.geteuid() == 0
        if root:
            os.seteuid(65534)
        try:
            yield Path(folder)
        finally:
            if root:
                os.seteuid(0)


@pytest.fixture
def recorded_before(tmp_path):
    """Whoever has no rights may not read the modules either that a recording imports."""
    assert main(["run", "quick", "--out", str(tmp_path / "c")]) == 0


def test_where_a_campaign_cannot_be_begun_no_sealed_truth_is_left(recorded_before, as_nobody, monkeypatch, capsys):
    monkeypatch.chdir(as_nobody)
    os.mkdir("o", 0)
    capsys.readouterr()
    assert main(["run", "quick", "--out", "o"]) == 2
    assert capsys.readouterr().err.count("shockrig run: o") == 1 and os.listdir() == ["o"]


@pytest.mark.parametrize("name", ["c", "c/runs", "c/runs/0001", "c/campaign.json", "c/runs/0001/hyt.csv"])
def test_what_may_not_be_read_is_said(as_nobody, monkeypatch, capsys, name):
    monkeypatch.chdir(as_nobody)
    campaign(Path("c"))
    mode = os.stat(name).st_mode
    os.chmod(name, 0)
    try:
        for command in (("characterize", "c", "--out", "o"), ("status", "c"), ("watch", "c", "--once")):
            status, said = main(list(command)), capsys.readouterr()
            assert status == 2 or (status == 0 and command[0] != "characterize" and name != "c/campaign.json")
            assert status == 0 or (said.err.count("\n") == 1 and name in said.err), said.err
        assert not Path("o").exists()
    finally:
        os.chmod(name, mode)


NAMES = {"too long": "x" * 300, "a path too long": "x/" * 3000, "a NUL": "a\0b", "half a character": "\ud800"}
NAMED = {
    "characterize": ("characterize", "{}", "--out", "o"),
    "characterize --out": ("characterize", "c", "--out", "{}"),
    "status": ("status", "{}"),
    "watch": ("watch", "{}", "--once"),
    "correct": ("correct", "{}", "--profile", "p.json", "--out", "o.csv"),
    "correct --profile": ("correct", "f.csv", "--profile", "{}", "--out", "o.csv"),
    "correct --out": ("correct", "f.csv", "--profile", "p.json", "--out", "{}"),
    "run --out": ("run", "quick", "--out", "{}"),
    "run --sealed": ("run", "quick", "--out", "o", "--sealed", "{}"),
    "check --out": ("check", "--out", "{}"),
    "import --out": ("import", "--imet", "f.csv", "--out", "{}"),
    "import --id": ("import", "--imet", "f.csv", "--out", "o", "--id", "{}"),
    "emulate --folder": ("emulate", "hyt-271", "--folder", "{}"),
    "emulate --link": ("emulate", "imet-xf", "--link", "{}"),
    "export": ("export", "{}", "--out", "o.nc"),
    "export --out": ("export", "c", "--out", "{}.nc"),
    "list": ("list", "{}"),
    "scan --out": ("scan", "--out", "{}", "--i2c", "/none"),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("case", NAMED)
def test_what_can_be_no_name_is_said(tmp_path, monkeypatch, capsys, case, name):
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv")), profile(Path("p.json")), campaign(Path("c"))
    said = refused(capsys, "", *(word.format(NAMES[name]) for word in NAMED[case]))
    said.encode("utf-8")


def test_names_of_any_bytes_are_names_in_any_locale(tmp_path):
    """In a process of its own, because the locale is the process's; a name that is not UTF-8, and one of umlauts."""
    for number, name in enumerate((b"b\xc3\xbccher", b"\xff\xfe")):
        shutil.copytree(campaign(tmp_path / f"c{number}"), tmp_path / os.fsdecode(name))
        for settings in ({"LANG": "C"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}):
            done = subprocess.run(
                [sys.executable, "-m", "shockrig", "status", name],
                cwd=tmp_path,
                env={k: v for k, v in os.environ.items() if not k.startswith("LC_")} | settings,
                capture_output=True,
                timeout=300,
            )
            assert (done.returncode, done.stderr) == (0, b"")
            assert b"2 runs recorded" in done.stdout


LEAP = np.where(np.arange(200) > 100, 1e9, 0.0)
TIMES = {
    "a leap": np.arange(200) * 0.1 + LEAP,
    "many leaps": np.arange(200) * 0.1 + 1e9 * (np.arange(200) // 20),
    "a leap back": np.arange(200) * 0.1 - LEAP,
    "years apart": np.arange(200) * 1e9,
    "nanoseconds apart": np.arange(200) * 1e-9,
    "beyond every clock": 1e300 * (1 + np.arange(200)),
}


@pytest.mark.parametrize("cutoff_hz", [None, "9e5", "1e-9"])
@pytest.mark.parametrize("method", ["smoother", "inverse", "paper"])
@pytest.mark.parametrize("times", TIMES)
def test_clocks_that_leap_are_flown_or_refused(tmp_path, monkeypatch, capsys, times, method, cutoff_hz):
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv"), TIMES[times])
    words = ["correct", "f.csv", "--profile", str(profile(Path("p.json"))), "--out", "o.csv", "--method", method]
    # The page of each method is drawn once.
    status = main(words + ([] if cutoff_hz is None else ["--cutoff-hz", cutoff_hz, "--no-report"]))
    said = capsys.readouterr().err
    assert status in (0, 2) and Path("o.csv").exists() == (status == 0)
    assert status == 0 or (
        said.count("\n") == 1 and said.startswith(("shockrig correct: f.csv: ", "shockrig correct: f.csv, line 2: "))
    )
    assert not Path("o.csv.part").exists()


def test_a_cutoff_that_no_sampling_reaches_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv")), profile(Path("p.json"))
    words = ("correct", "f.csv", "--profile", "p.json", "--out", "o.csv", "--method", "inverse", "--cutoff-hz")
    refused(capsys, "expected a positive number", *words, "1e9")
    refused(capsys, "a cut-off of 900000 Hz is not between 0.05 and 5 Hz", *words, "9e5")
    assert main([*words, "1"]) == 0


ABSURD = {
    "a gain of -1": ("temperature", "calibration_error", {"gain": -1.0, "offset": 0.0}),
    "a dead time of 1e9 s": ("temperature", "dead_time", {"delay_s": 1e9}),
    "an average over 1e12": ("humidity", "moving_average", {"samples": 1e12}),
    "a stem's share of 1": ("temperature", "stem_conduction", {"fraction": 1.0, "time_constant_s": 8.0}),
    "a hold of 1e9": ("humidity", "stale_samples", {"hold_samples": 1e9}),
    "a lag of 1e-300 s": ("temperature", "series_lag", {"time_constant_s": 1e-300}),
}


@pytest.mark.parametrize("case", ABSURD)
def test_effects_beyond_what_can_be_are_refused(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    channel, effect, parameters = ABSURD[case]
    flight(Path("f.csv"))
    profile(Path("p.json"), **{channel: {"effects": [{"effect": effect, "parameters": parameters}]}})
    said = refused(capsys, "cannot be; expected", "correct", "f.csv", "--profile", "p.json", "--out", "o.csv")
    assert effect in said and "take the effect out" in said


def test_the_ends_of_every_range_are_flown(tmp_path, monkeypatch, capsys):
    """The ranges that are refused by are those that a fit may give: each end of them must be corrected."""
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv"))
    flown = 0
    for entry in (entry for entry in CATALOGUE.values() if entry.in_flight is not None and entry.parameters):
        for end in ("low", "high"):
            stated = {"effect": entry.id, "parameters": {p.name: getattr(p, end) for p in entry.parameters}}
            profile(Path("p.json"), **{channel: {"effects": [stated]} for channel in entry.channels})
            status = main(["correct", "f.csv", "--profile", "p.json", "--out", "o.csv", "--no-report"])
            assert status == 0, (entry.id, end, capsys.readouterr().err)
            flown += 1
    assert flown > 30


NUMBERS = {
    "alpha": {"temperature": {"thermal_diffusivity_m2_s": {"value": 1e300}}},
    "its uncertainty": {"temperature": {"thermal_diffusivity_m2_s": {"value": 7e-8, "standard_uncertainty": 1e300}}},
    "D": {"humidity": {"diffusivity_table": [{"ambient_temperature_c": 0.0, "diffusivity_m2_s": 1e-300}]}},
    "noise": {"humidity": {"noise_percent": 1e300}},
    "period": {"temperature": {"sampling_period_s": 1e300}},
}


@pytest.mark.parametrize("case", NUMBERS)
def test_numbers_of_a_profile_beyond_what_can_be_are_refused(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    flight(Path("f.csv"))
    profile(Path("p.json"), **NUMBERS[case])
    refused(capsys, "cannot be; expected", "correct", "f.csv", "--profile", "p.json", "--out", "o.csv")


BIGNUM = 10**400
CAUSES = {
    "a list as effect": [{"effect": ["dead_time"]}],
    "a bignum as effect": [{"effect": BIGNUM}],
    "a list as parameter": [{"effect": "dead_time", "parameters": {"delay_s": [1]}}],
    "a bignum as parameter": [{"effect": "dead_time", "parameters": {"delay_s": BIGNUM}}],
    "a bignum as value": [{"effect": "dead_time", "parameters": {"delay_s": {"value": BIGNUM}}}],
    "a bignum as uncertainty": [
        {"effect": "dead_time", "parameters": {"delay_s": {"value": 1, "standard_uncertainty": BIGNUM}}}
    ],
    "a bignum as probability": [{"effect": "dead_time", "probability": BIGNUM}],
    "a number as look-alikes": [{"effect": "dead_time", "indistinguishable_from": 5}],
    "a list among look-alikes": [{"effect": "dead_time", "indistinguishable_from": [[1]]}],
    "a list as parameters": [{"effect": "dead_time", "parameters": [1]}],
    "a number as causes": 7,
    "a number as cause": [7],
}


@pytest.mark.parametrize("case", CAUSES)
def test_causes_of_another_kind_are_refused(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    stated = {**DIAGNOSIS, "channels": {"temperature": {"causes": CAUSES[case]}}}
    Path("d.json").write_text(json.dumps(stated))
    words = refused(capsys, "d.json: key ", "characterize", campaign(Path("c")), "--extend", "d.json", "--out", "o")
    assert len(words) < 400


SEEDS = {
    "infinity": "Infinity",
    "not a number": "NaN",
    "a list": "[1]",
    "5000 digits": "9" * 5000,
    "100 bits": str(2**100),
}


@pytest.mark.parametrize("case", SEEDS)
def test_seals_with_no_seed_are_refused(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    truth = draw_truth(np.random.default_rng(1))
    seal(Path("good"), truth, 2**64 - 1)
    assert open_seal(Path("good")) == (truth, 2**64 - 1)
    inner = f'{{"seed": {SEEDS[case]}, "truth": {json.dumps(truth.to_json())}}}'
    Path("s").write_text(json.dumps(sealed(zlib.compress(inner.encode()))))
    Path("d.json").write_text(json.dumps(DIAGNOSIS))
    refused(capsys, "s: not a sealed truth", "reveal", "s", "--diagnosis", "d.json")


def test_a_seal_that_unpacks_to_gigabytes_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    packer = zlib.compressobj(9)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(256)) + packer.flush()
    Path("s").write_text(json.dumps(sealed(packed)))
    Path("d.json").write_text(json.dumps(DIAGNOSIS))
    refused(capsys, "s: not a sealed truth", "reveal", "s", "--diagnosis", "d.json")


def sealed(packed):
    checksum = hashlib.sha256(packed).hexdigest()
    return {"format": "sealed-truth/1", "sha256": checksum, "sealed": base64.b64encode(packed).decode()}


KILLED = """
import os, signal, sys
from pathlib import Path
from shockrig.protocols.folder import whole_folder
with whole_folder(Path("o")) as folder:
    (folder / "half").write_text("half")
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
"""


ALONE = "from shockrig.protocols import folder; folder._reaper = lambda _: None\n" + KILLED


def test_what_a_killed_command_had_half_written_goes_with_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert subprocess.run([sys.executable, "-c", KILLED, "SIGKILL"], timeout=300).returncode == -signal.SIGKILL
    deadline = time.monotonic() + 30.0
    while entries("."):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_a_killed_command_left_is_cleared_away_by_the_next(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Killed with all that it had started: else a process that outlives it clears away.
    with subprocess.Popen([sys.executable, "-c", ALONE, "SIGKILL"]):
        pass
    assert [name for name in entries(".") if name.endswith("half")]
    with whole_folder(Path("o")) as held, whole_folder(Path("o2")) as folder:
        assert [entry.name for entry in Path().iterdir() if entry.name.startswith(".o.")] == [held.name]
        (folder / "whole").write_text("")
        (held / "whole").write_text("")
    assert entries(".") == ["./o", "./o/whole", "./o2", "./o2/whole"]


def test_what_another_command_is_writing_is_left_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = "import time; print('ready', flush=True); time.sleep(60)"
    code = KILLED.replace("os.kill(os.getpid(), getattr(signal, sys.argv[1]))", told)
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as other:
        try:
            heard(other, other.stdout, "ready")
            with whole_folder(Path("o")):
                pass
            assert [name for name in entries(".") if name.endswith("half")]
        finally:
            other.kill()


@pytest.mark.elsewhere
def test_a_command_that_is_told_to_end_leaves_nothing(tmp_path):
    """SIGTERM and a closed terminal, while the command waits for its worker processes."""
    campaign_ = Path(__file__).parents[2] / "data" / "examples" / "plain-rough"
    command = [sys.executable, "-m", "shockrig", "characterize", str(campaign_), "--out", "o"]
    for number in (signal.SIGTERM, signal.SIGHUP):
        with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as one:
            heard(one, one.stderr, "temperature")
            assert entries(tmp_path)
            ended(one, number)
        assert one.returncode == 128 + number
        assert entries(tmp_path) == []


def killed_import(call, count):
    """An import, in a process that is no more when it comes to a call of `os` for the nth time."""
    left, real = [count], getattr(os, call)

    def counted(*arguments, **options):
        left[0] -= 1
        if left[0] == 0:
            os._exit(9)
        return real(*arguments, **options)

    setattr(os, call, counted)
    main(["import", "--imet", "f.csv", "--out", "c"])


def test_an_import_that_was_killed_leaves_no_run_and_can_be_done_again(tmp_path, monkeypatch, capsys):
    """Killed at each file that it writes, and once more before the rename that makes the run count."""
    monkeypatch.chdir(tmp_path)
    Path("f.csv").write_text("time_s,temperature_c\n0,20\n1,21\n2,22\n")
    for call, times in (("replace", (1, 2, 3)), ("rename", (1,))):
        for count in times:
            killed = get_context("fork").Process(target=killed_import, args=(call, count))
            killed.start()
            killed.join(PATIENCE_S)
            assert killed.exitcode == 9
            assert main(["characterize", "c", "--out", "o"]) == 2
            assert main(["import", "--imet", "f.csv", "--out", "c"]) == 0, capsys.readouterr().err
            assert [run.id for run in read_campaign("c").runs] == ["0001"]
            assert not [name for name in entries("c") if name.endswith(".part")]
            shutil.rmtree("c")


@pytest.mark.parametrize("place", ["new", "empty", "there"])
def test_what_no_reader_takes_is_not_imported(tmp_path, monkeypatch, capsys, place):
    monkeypatch.chdir(tmp_path)
    Path("f.csv").write_text("time_s,temperature_c\n0,20\n1,21\n1e15,22\n")
    if place == "empty":
        Path("c").mkdir()
    elif place == "there":
        campaign(Path("c"))
    before = [(name, os.path.isfile(name) and Path(name).read_bytes()) for name in entries(".")]
    assert main(["import", "--imet", "f.csv", "--out", "c"]) == 2
    assert "nothing was imported" in capsys.readouterr().err
    assert [(name, os.path.isfile(name) and Path(name).read_bytes()) for name in entries(".")] == before


def test_two_hyphens_are_no_value(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    refused(capsys, "--pressure: is --", "import", "--imet", "f.csv", "--out", "o", "--pressure=--")


def test_names_of_any_bytes_are_printed(tmp_path):
    """On a terminal in UTF-8, whose encoding is strict."""
    shutil.copytree(campaign(tmp_path / "c"), tmp_path / os.fsdecode(b"\xff\xfe"))
    command = [sys.executable, "-m", "shockrig", "status", b"\xff\xfe"]
    strict = os.environ | {"PYTHONIOENCODING": "utf-8:strict"}
    done = subprocess.run(command, cwd=tmp_path, env=strict, capture_output=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, b"") and b"2 runs recorded" in done.stdout


def test_names_are_printed_where_the_terminal_has_ascii_alone(tmp_path):
    """As in the POSIX locale, whose standard output is not strict and has no letter beyond ASCII either."""
    head = json.loads((campaign(tmp_path / "c") / "campaign.json").read_text())
    (tmp_path / "c" / "campaign.json").write_text(json.dumps(head | {"name": "Mühle"}))
    command = [sys.executable, "-m", "shockrig", "status", "c"]
    ascii_alone = os.environ | {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(command, cwd=tmp_path, env=ascii_alone, capture_output=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, b"") and rb"M\xfchle: 2 runs recorded" in done.stdout


def test_runs_that_say_nothing_of_their_rate_alone_have_pages(tmp_path):
    """A short lag on slow ramps: all runs together tell it, and none by itself to a third."""
    campaign, rng, time_s = tmp_path / "ramps", np.random.default_rng(1), np.arange(0.0, 9000.0, 30.0)
    for number, direction in enumerate((1.0, -1.0, 1.0, 1.0), start=1):
        folder = campaign / "runs" / f"{number:04d}"
        folder.mkdir(parents=True)
        (folder / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": folder.name}))
        slope = direction * 6.0 / time_s[-1]
        air = 25.0 + slope * time_s
        for name, values in (("imet", air + slope * 80.0 * np.expm1(-time_s / 80.0)), ("air", air)):
            noisy = values + rng.normal(0.0, 0.02, time_s.size)
            rows = "".join(f"{t:g},{v:.3f}\n" for t, v in zip(time_s, noisy, strict=True))
            (folder / f"{name}.csv").write_text("time_s,temperature_c\n" + rows)
    sensors = {"imet": {"kind": "as logged", "body": "lumped"}}
    document = {"format": "shock-campaign/1", "name": "ramps", "sensors": sensors}
    (campaign / "campaign.json").write_text(json.dumps(document))
    for command in ("characterize", "diagnose"):
        assert main([command, str(campaign), "--out", str(tmp_path / command)]) == 0
    assert "cannot be set against single conditions" in (tmp_path / "diagnose" / "report.html").read_text()
