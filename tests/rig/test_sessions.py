"""Where and with what a campaign was recorded: kept for each session, and held against the one before."""

import json
import shutil
from importlib import resources

import pytest

from shockrig.protocols.cli import main
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.recorder.session_record import changes

VIRTUAL = (resources.files("shockrig.data") / "benches" / "virtual.toml").read_text()


def bench(tmp_path, *changes):
    text = VIRTUAL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "bench.toml").write_text(text)
    return str(tmp_path / "bench.toml")


def head(tmp_path):
    return json.loads((tmp_path / "c/campaign.json").read_text())


def record(tmp_path, *arguments):
    return main(["run", "quick", "--out", str(tmp_path / "c"), *map(str, arguments)])


def test_a_session_says_who_with_what_and_where(tmp_path):
    calibrated = ('kind = "hyt-271"', 'kind = "hyt-271"\ncertificate = "K-17"\ncalibrated = 2026-04-01')
    assert record(tmp_path, "--bench", bench(tmp_path, calibrated), "--operator", "A. Uthor", "--seed", "1") == 0
    (session,) = head(tmp_path)["sessions"]
    assert session["operator"] == "A. Uthor" and session["software"].startswith("shockrig ")
    assert session["host"] and session["python"].count(".") == 2 and session["began_at"].endswith("Z")
    assert session["clock_synchronised"] in (True, False)
    assert session["calibration"] == {"hyt": {"certificate": "K-17", "calibrated": "2026-04-01"}}
    assert session["bench"]["hyt"]["conversion_s"] == 0.07  # as the file has it
    assert session["bench"]["imet"]["latency_s"] == 0.0  # as its default is
    assert session["bench"]["bench"]["pressure_hpa"] == 1013.25
    assert json.loads((tmp_path / "c/runs/0001/run.json").read_text())["session"] == 1


def test_a_campaign_that_goes_on_keeps_both_and_says_what_is_another(tmp_path, capsys):
    assert record(tmp_path, "--bench", bench(tmp_path), "--operator", "A", "--seed", "1") == 0
    shutil.rmtree(tmp_path / "c/runs/0002")
    other = bench(tmp_path, ("pressure_hpa = 1013.25", "pressure_hpa = 950.0"), ("0.07 #", "0.08 #"))
    capsys.readouterr()
    assert record(tmp_path, "--bench", other) == 0
    said = capsys.readouterr().err
    assert "another setting than in this campaign's last session: bench.pressure_hpa: 1013.25, now 950.0" in said
    assert "hyt.conversion_s: 0.07, now 0.08" in said
    first, second = head(tmp_path)["sessions"]
    assert (first["bench"]["bench"]["pressure_hpa"], second["bench"]["bench"]["pressure_hpa"]) == (1013.25, 950.0)
    assert second["operator"] == "A"  # asked once
    assert json.loads((tmp_path / "c/runs/0002/run.json").read_text())["session"] == 2


@pytest.mark.parametrize(
    ("part", "old", "new"),
    [
        ("imet", 'kind = "imet-xf"', "latency_s = 0.016"),
        ("hyt", "conversion_s = 0.07", "sampled_after_s = 0.02"),
    ],
)
def test_what_would_shift_time_stamps_is_refused_and_nothing_is_touched(tmp_path, capsys, part, old, new):
    assert record(tmp_path, "--bench", bench(tmp_path), "--seed", "1") == 0
    shutil.rmtree(tmp_path / "c/runs/0002")
    before = head(tmp_path)
    capsys.readouterr()
    assert record(tmp_path, "--bench", bench(tmp_path, (old, f"{old}\n{new}"))) == 2
    said = capsys.readouterr().err
    assert f"{part}.{new.partition(' ')[0]}: " in said and "that shifts the time stamps within one campaign" in said
    assert head(tmp_path) == before and not (tmp_path / "c/runs/0002").exists()


def test_the_snapshot_tells_nothing_of_what_is_sealed(tmp_path):
    """The emulated stage moves as slowly as its truth says; the bench file does not."""
    assert record(tmp_path, "--hide", "finite_transfer", "--seed", "3") == 0
    (session,) = head(tmp_path)["sessions"]
    assert session["bench"]["stage"]["feed_mm_min"] == 30000.0
    assert "virtual" not in session["bench"] and "seed" not in json.dumps(session)


def test_changes_are_found_wherever_they_are():
    before = {"stage": {"kind": "grbl", "feed": 1.0}, "hyt": {"retries": 3, "range": [1, 2]}}
    now = {"stage": {"kind": "manual"}, "hyt": {"retries": 5, "range": [1, 2]}}
    assert changes(before, now) == [
        "hyt.retries: 3, now 5",
        "stage.feed: 1.0, now not there",
        'stage.kind: "grbl", now "manual"',
    ]
    assert changes(before, before) == []
    with pytest.raises(BenchError, match="hyt.sampled_after_s: not there, now 0.05; that shifts"):
        changes({"hyt": {}}, {"hyt": {"sampled_after_s": 0.05}})
