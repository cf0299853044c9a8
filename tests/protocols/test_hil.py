"""A flight that comes round: what each stage lost, and faults of a link named from the logs alone."""

from dataclasses import replace

import numpy as np
import pytest

from shockrig.analysis.checks.link import HeardMessages, SentRows, link_findings
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.protocols.cli import main

FAULTS = ("loss@10-22", "delay@28-40", "units@46-58", "stamps@64-76", "one_old@82-94")
WINDOW_S = 5.0


@pytest.fixture(scope="module")
def air(tmp_path_factory):
    """Two minutes of simulated air, at 12 Hz."""
    pytest.importorskip("pymavlink")
    weather = inversion(np.random.default_rng([3, 1]))
    path = tmp_path_factory.mktemp("air") / "air.csv"
    columns = (weather.time_s, weather.temperature_c, weather.humidity_percent, weather.airspeed_m_s,
               weather.pressure_hpa, weather.altitude_m)  # fmt: skip
    table = np.array([one[::8] for one in columns]).T
    header = "time_s,temperature_c,humidity_percent,airspeed_m_s,pressure_hpa,altitude_m"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.5f")
    return path


def test_a_flight_comes_round_and_five_faults_of_the_link_are_named(air, tmp_path, capsys):
    arguments = [word for fault in FAULTS for word in ("--fault", fault)]
    assert main(["hil", str(air), "--out", str(tmp_path / "out"), "--fault", "silence@100-104", *arguments]) == 0
    said = capsys.readouterr().out
    found = [line for line in said.splitlines() if line.startswith("found:")]
    for words, start_s in (
        ("lost", 10), ("held back", 28), ("another unit", 46), ("stamps are repeated", 64), ("one poll old", 82),
    ):  # fmt: skip
        named = [line for line in found if words in line]
        assert named
        for line in named:  # within a window of where it was
            first, last = (float(word) for word in line.split(", ")[1].split(" s:")[0].split(" to "))
            assert abs(first - start_s) <= WINDOW_S + 0.5 and abs(last - (start_s + 12)) <= WINDOW_S + 0.5
    assert any("imet is silent" in line for line in found)
    stages = {line.split("  ")[0].strip(): line.split() for line in said.splitlines() if line.endswith("%RH")}
    rms = {name: (float(words[-4]), float(words[-2])) for name, words in stages.items()}
    assert rms["on board"] < rms["as read"] and rms["after landing"] < rms["on board"]
    page = (tmp_path / "out" / "0001" / "hil.html").read_text()
    assert "What each stage lost" in page and "nothing of this was measured" in page


def test_without_a_fault_nothing_is_found_and_messages_lose_what_their_types_round(air, tmp_path, capsys):
    short = tmp_path / "air.csv"
    short.write_text("".join(air.read_text().splitlines(keepends=True)[:650]))  # 52 s
    assert main(["hil", str(short), "--out", str(tmp_path / "out"), "--seed", "7"]) == 0
    said = capsys.readouterr().out
    assert "found:" not in said
    rms = {line.split()[1]: float(line.split()[-2]) for line in said.splitlines() if line.startswith("message")}
    assert rms["HYGROMETER_SENSOR"] == pytest.approx(0.01 / np.sqrt(12), rel=0.1)
    assert rms["NAMED_VALUE_FLOAT"] < 1e-5 and 0.003 < rms["Hygrometer"] < 0.01
    log = np.genfromtxt(tmp_path / "out" / "0001" / "flight.csv", delimiter=",", names=True, usecols=range(17))
    assert np.mean(log["sent_s"] - log["came_s"] < 0.1) > 0.99
    assert np.isfinite(log["airspeed_m_s"]).mean() > 0.95 and np.isfinite(log["altitude_m"]).mean() > 0.95


def test_a_flight_that_cannot_be_is_refused(air, tmp_path, capsys):
    assert main(["hil", str(air), "--out", str(tmp_path / "out"), "--fault", "alarm@1"]) == 2
    assert "no fault 'alarm' here; there are loss" in capsys.readouterr().err


def test_a_link_that_says_nothing_at_all_is_named():
    time_s = np.arange(0.0, 30.0, 0.1)
    sent = SentRows(time_s, time_s + 0.01, 20.0 + 0.01 * time_s, 50.0 - 0.1 * time_s)
    nothing = np.zeros(0)
    heard = HeardMessages("mute", nothing, nothing, nothing, nothing, nothing, nothing.astype(int), 256, 0.01)
    (only,) = link_findings(sent, [heard])
    assert only.fault == "silent" and (round(only.from_s), round(only.to_s)) == (0, 30)


def test_rows_without_a_value_are_not_missed_in_messages_that_cannot_say_so():
    time_s, nothing = np.arange(0.0, 30.0, 0.1), np.zeros(0)
    sent = SentRows(time_s, time_s + 0.01, 20.0 + 0.01 * time_s, np.full(time_s.size, np.nan))
    heard = HeardMessages("mute", nothing, nothing, nothing, nothing, nothing, nothing.astype(int), 256, 0.01)
    assert link_findings(sent, [heard]) and not link_findings(sent, [replace(heard, whole=True)])
