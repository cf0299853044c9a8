"""The flight that would decide: what says more about which models, and what a pilot gets of it."""

import json
import math

import numpy as np
import pytest
from pymavlink import mavutil, mavwp

from shockrig.analysis.plan.decide_flight import (
    FlightLimits,
    bins_along,
    candidates_of,
    expected_nats,
    menu,
    planned_bins,
    ranked,
)
from shockrig.analysis.plan.flight_plan import Straight, minutes
from shockrig.files.errors import InputError
from shockrig.files.learned import read_learned
from shockrig.protocols.cli import main

HOME = (46.8130, 6.9430, 491.0)
SIZES = [2.0 * math.log(share) for share in (0.5, 0.1, 0.1, 0.1, 0.03, 0.01)]
LAG = {"laws": ["lag"], "values": {"time_constant_s": 8.0}, "probability": 0.5}
TWO_PATHS = {
    "laws": ["second_path"],
    "values": {"time_constant_s": 4.0, "fraction": 0.15, "second_time_constant_s": 60.0},
    "probability": 0.5,
}
NOTHING = {"laws": [], "values": {}, "probability": 0.5}
WARM = {"laws": ["ventilated_warmth"], "values": {"rise_k_at_5_m_s": 0.3}, "probability": 0.5}
IN_DESCENT = {"laws": ["offset_in_descent"], "values": {"offset_in_descent": 0.5}, "probability": 0.5}
LIMITS = FlightLimits()


def document(*rivals, **changed):
    channel = {"verdict": "tied", "unit": 1.0, "sizes": SIZES, "rivals": rivals}
    return {
        "format": "shock-learned/1",
        "channels": {"temperature": channel},
        "altitude_m": [490.0, 610.0],
        "home": HOME,
        "minutes": 10.0,
        **changed,
    }


@pytest.fixture
def learned(tmp_path):
    def written(*rivals, **changed):
        (tmp_path / "learned.json").write_text(json.dumps(document(*rivals, **changed)))
        return read_learned(tmp_path / "learned.json")

    return written


def nats(bins, file):
    return expected_nats(bins, "temperature", file, candidates_of("temperature", file.channels["temperature"]))


def straight(file, speed_m_s, ways=("up",)):
    """The way up alone, and more of them, between 10 and 120 m."""
    heights = np.r_[10.0, [120.0 if way == "up" else 10.0 for way in ways]]
    ends = np.arange(heights.size) * 110.0 / speed_m_s
    time = np.arange(0.0, ends[-1], 1.0)
    return bins_along(time, np.interp(time, ends, heights), np.full(time.size, speed_m_s), file)


def of_menu(what, file):
    return next(plan for said, plan in menu(LIMITS).items() if said == what)


def test_a_hover_tells_a_second_path_from_a_lag_and_a_bare_ascent_does_less_per_minute(learned):
    file = learned(LAG, TWO_PATHS)
    hover = of_menu("fast up, a hover at the top, fast down", file)
    ascent = straight(file, 2.5)
    assert nats(planned_bins(hover, file), file) / minutes(hover) > nats(ascent, file) / ascent.minutes


def test_one_pass_says_nothing_of_an_offset_in_descent_and_its_descent_does(learned):
    file = learned(NOTHING, IN_DESCENT)
    assert nats(straight(file, 2.5), file) == pytest.approx(0.0, abs=1e-6)
    assert nats(straight(file, 2.5, ("up", "down")), file) > 1.0


def test_two_airspeeds_tell_of_warmth_and_one_says_nothing(learned):
    """The same offset at all times is any air's; at two airspeeds it is the sensor's."""
    file = learned(NOTHING, WARM)
    assert nats(straight(file, 2.5, ("up", "down")), file) < 0.05
    level = of_menu("level out and back at two airspeeds", file)
    assert nats(planned_bins(level, file), file) > 3.0


def test_air_that_changes_more_makes_every_flight_say_less(learned):
    still = learned(LAG, NOTHING)
    channel = document(LAG, NOTHING)["channels"]["temperature"] | {"sizes": [*SIZES[:2], 0.0, 0.0, -2.0, SIZES[-1]]}
    restless = learned(channels={"temperature": channel})
    plan = of_menu("up and down fast", still)
    assert nats(planned_bins(plan, restless), restless) < 0.5 * nats(planned_bins(plan, still), still)


def test_flights_are_ranked_within_limits(learned):
    limits = FlightLimits(ceiling_m=90.0, endurance_minutes=3.0)
    flights = ranked(learned(NOTHING, LAG), limits)
    rates = [one.nats_per_minute for one in flights]
    assert rates == sorted(rates, reverse=True) and rates[0] > 0.0
    assert all(one.minutes <= 3.0 for one in flights)
    assert max(leg.to_m for one in flights for leg in one.legs if isinstance(leg, Straight)) == 90.0
    with pytest.raises(InputError, match="no air to pass twice"):
        ranked(learned(LAG), FlightLimits(ceiling_m=30.0))
    with pytest.raises(InputError, match="takes less than 1 minutes"):
        ranked(learned(LAG), FlightLimits(endurance_minutes=1.0))


@pytest.mark.parametrize("suffix", [".waypoints", ".plan"])
def test_the_command_writes_a_mission_and_says_what_a_pilot_reads(tmp_path, learned, capsys, suffix):
    learned(NOTHING, WARM)
    out = tmp_path / f"next{suffix}"
    assert main(["plan", "--flights", str(tmp_path), "--out", str(out), "--ceiling", "100", "--endurance", "8"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("the next flight: ") and "at night or under a closed cloud" in said
    assert "nats expected between nothing / ventilated warmth" in said and f"mission: {out}" in said
    if suffix == ".plan":
        assert json.loads(out.read_text())["mission"]["plannedHomePosition"] == list(HOME)
        return
    loader = mavwp.MAVWPLoader()
    items = [loader.wp(k) for k in range(loader.load(str(out)))]
    assert (items[0].x, items[0].y, items[0].z) == pytest.approx(HOME)
    assert items[1].command == mavutil.mavlink.MAV_CMD_NAV_TAKEOFF
    assert items[-1].command == mavutil.mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
    assert max(one.z for one in items[1:]) <= 100.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "x.toml"], "ends in .waypoints or .plan"),
        (["--out", "x.plan"], "does not say where home is; give --home"),
        (["--home", "46.8,6.9"], "expected latitude, longitude"),
        (["--home", "95,6.9,0"], "home: latitude 95"),
        (["--until", "alpha 1 %"], "--until is for a bench"),
        (["--ceiling", "nan"], "no air to pass twice"),
        (["--ceiling", "inf"], "a ceiling inf cannot be"),
        (["--endurance", "nan"], "no flight to 120 m"),
        (["--endurance", "0"], "no flight to 120 m"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_a_line(tmp_path, monkeypatch, learned, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    learned(LAG, home=None)
    assert main(["plan", "--flights", ".", *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("rivals", "changed", "said"),
    [
        ([], {"format": "shock-plan/1"}, 'expected "shock-learned/1"'),
        ([], {"channels": {}}, "channels: expected one or more"),
        ([], {"channels": {"wind": {}}}, "channels.wind: no channel"),
        ([], {"altitude_m": [5.0]}, "altitude_m: expected two numbers"),
        ([], {"home": [46.8, 600.0, 5.0]}, "home: expected latitude"),
        ([LAG | {"probability": 2.0}], {}, r"rivals\[0\].probability"),
        ([LAG | {"laws": ["lagg"]}], {}, r"no law 'lagg'; did you mean 'lag'\?"),
        ([LAG | {"values": {}}], {}, "time_constant_s nan; expected 0.1 to 400 s"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_its_key(learned, rivals, changed, said):
    with pytest.raises(InputError, match=said):
        ranked(learned(*rivals, **changed), LIMITS)


def test_a_bench_still_needs_its_words(capsys):
    assert main(["plan", "c", "--out", "n.toml"]) == 2
    assert "--until GOALS is missing" in capsys.readouterr().err
    assert main(["plan", "c", "--ceiling", "100"]) == 2
    assert "give --flights LEARNED" in capsys.readouterr().err
