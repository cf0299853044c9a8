"""What must hold of importing logs: whatever a log looks like, its steps and values come out, nothing is invented."""

import json
import re
import time
import tracemalloc
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from made_up_logs import (
    DAY,
    FAHRENHEIT,
    LOG,
    MAP,
    MARKED,
    NIGHT,
    TWO,
    WAYS,
    date,
    halves,
    in_full,
    labview,
    lines_of,
    plain,
    plain_log,
    series,
    text,
    two_sensors,
    written,
)

import shockrig
from shockrig.analysis.checks.campaign_checks import check_campaign
from shockrig.files.campaign import read_campaign
from shockrig.files.unit_names import quantity_of, unit_in_name
from shockrig.protocols.cli import main
from shockrig.rig.logs import clock_columns
from shockrig.rig.logs.first_map import look_at
from shockrig.rig.logs.found import steps_of
from shockrig.rig.logs.map_file import parse_map
from shockrig.rig.logs.order import in_order
from shockrig.rig.logs.sensor_logs import read_sensors
from shockrig.rig.logs.text import Layout, scan


def run(*arguments):
    return main(["import", *map(str, arguments)])


def rows_of_log():
    return zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, strict=True)


@pytest.mark.parametrize("way", WAYS)
def test_every_way_of_writing_gives_the_same_runs(tmp_path, way, capsys):
    """Imported by the map that a first look writes: three runs, their steps found, every reading as recorded."""
    log = written(tmp_path / "log.csv", WAYS[way])
    map_ = written(tmp_path / "log.toml", look_at([log], tmp_path / "log.toml").text)
    out = tmp_path / "campaign"
    assert run(log, "--map", map_, "--out", out) == 0, capsys.readouterr().err
    campaign = read_campaign(out)
    assert [one.id for one in campaign.runs] == ["0001", "0002", "0003"]
    assert all(
        one.start_s is None and one.airflow_m_s is None and one.source.temperature_c is None for one in campaign.runs
    )
    temperature = (LOG.temperature_c - 32.0) / 1.8 if way in FAHRENHEIT else LOG.temperature_c
    there = np.arange(LOG.time_s.size) % 17 != 3 if way in MARKED else np.ones(LOG.time_s.size, dtype=bool)
    for folder, at_s in zip(sorted((out / "runs").iterdir()), LOG.steps_s, strict=True):
        head = json.loads((folder / "run.json").read_text())
        bead, film = series(folder, "imet"), series(folder, "hyt")
        begin_s = in_full(film["time_s"], film["humidity_percent"], LOG.time_s, LOG.humidity_percent)
        in_full(bead["time_s"], bead["temperature_c"], LOG.time_s[there], temperature[there])
        off_s = begin_s + head["step_seen_s"] - at_s
        assert abs(off_s) < 2.0 * head["step_seen_standard_uncertainty_s"] < 2.0
        assert head["imported"]["log"] == "log.csv" and "transfer" not in head


def test_columns_that_differ_in_nothing_but_their_unit_are_two_sensors_where_they_disagree(tmp_path):
    """As a thermocouple in degC beside an oven's own display in degF: the map that is written can be read."""
    lines = lines_of("time_s,Temp (C),Temp (F)", lambda t, a, b, n: f"{t:.2f},{a:.2f},{1.8 * a + 35.0:.2f}")
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert [dict(one.columns) for one in look.map.sensors.values()] == [
        {"temperature": ("Temp (C)", "degC")},
        {"temperature": ("Temp (F)", "degF")},
    ]
    lines = lines_of("time_s,Set Temp (C),Temp (C)", lambda t, a, b, n: f"{t:.2f},{35 if t > 80.0 else 22},{a:.2f}")
    look = look_at([written(tmp_path / "set.csv", text(lines))], tmp_path / "set.toml")
    assert len(look.map.sensors) == 1 and "Set Temp (C)" in look.notes[-1]


@pytest.mark.parametrize("name", ["tempF", "Temp_F_inside", "temp_f_probe1", "Temp1F", "Temp F 1"])
def test_a_letter_behind_the_word_for_a_temperature_is_its_unit(tmp_path, name):
    """The map that is written says so, and one that states no unit is read so."""
    lines = lines_of(f"time_s,{name}", lambda t, a, b, n: f"{t:.2f},{1.8 * a + 32.0:.2f}")
    log = written(tmp_path / "log.csv", text(lines))
    (sensor,) = look_at([log], tmp_path / "log.toml").map.sensors.values()
    assert dict(sensor.columns) == {"temperature": (name, "degF")}
    map_ = written(tmp_path / "map.toml", f"[sensor.x]\ntemperature = '{name}'\n")
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    assert read_campaign(tmp_path / "c").runs[0].imet.values["temperature_c"][0] == pytest.approx(22.0, abs=0.2)


def test_a_letter_is_a_sensors_where_others_have_other_letters(tmp_path):
    head = ",".join(f"Temp{letter}" for letter in "ABCDEF")
    lines = lines_of(f"time_s,{head}", lambda t, a, b, n: f"{t:.2f}" + f",{a}" * 6)
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert [dict(one.columns)["temperature"] for one in look.map.sensors.values()] == [
        (f"Temp{letter}", "degC") for letter in "ABCDEF"
    ]
    lines = lines_of("time_s,tempC,tempF,hum", lambda t, a, b, n: f"{t:.2f},{a:.2f},{1.8 * a + 32.0:.2f},{b}")
    look = look_at([written(tmp_path / "both.csv", text(lines))], tmp_path / "both.toml")
    assert len(look.map.sensors) == 1 and "tempF" in look.notes[-1]


@pytest.mark.parametrize("header", ["time_s,Temp [°C]", "time_s,temp"])
def test_a_hot_end_is_in_the_unit_that_its_log_names(tmp_path, capsys, header):
    """From 235 to 275 degC and back, as kelvin could be: they are where nobody says otherwise."""
    unit = " C" if "[" not in header else ""
    lines = lines_of(header, lambda t, a, b, n: f"{t:.2f},{235.0 + 40.0 * (a - 22.0) / 13.0:.2f}{unit}")
    log = written(tmp_path / "log.csv", text(lines))
    assert run(log, "--look", "--out", tmp_path) == 0 and "impossible" not in capsys.readouterr().out
    assert run(log, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 0
    campaign = read_campaign(tmp_path / "c")
    assert campaign.runs[0].imet.values["temperature_c"][-1] == pytest.approx(275.0, abs=0.5)
    assert campaign.runs[0].extra["imported"]["temperatures"] == "named"
    assert "kelvin" not in [one.kind for one in check_campaign(campaign)]
    log.write_text(log.read_text().replace(header, "time_s,temp").replace(" C\n", "\n"))
    assert 'temperature_unit = "K"' in look_at([log], tmp_path / "other.toml").text


def test_logs_of_one_layout_tell_together_whether_the_day_comes_first(tmp_path):
    """Of the third of January and of the seventeenth: the second one tells that the month stands before the day."""
    logs = []
    for day in (3, 17):
        stamps = date("%m/%d/%Y %H:%M:%S.%f", datetime(2026, 1, day, 12, tzinfo=UTC))
        logs.append(written(tmp_path / f"{day}.csv", text(plain("Date Time,Temp,RH", stamps))))
    look = look_at(logs, tmp_path / "log.toml")
    assert "%m/%d/%Y" in look.text and "nothing in the log tells" not in look.text
    assert [len(steps) for steps in look.steps] == [3, 3]


def test_what_a_person_knows_of_a_step_is_written(tmp_path):
    """A trigger is transfer.start_s to the microsecond; airs, airflow, pressure, duration and sensors as stated."""
    log, map_ = plain_log(
        tmp_path,
        'thermometer = { kind = "bead", serial = "7", body = "lumped", bead_radius_m = 2e-4 }\n'
        'hygrometer = { kind = "film", film_thickness_m = 5e-6 }\n'
        "[runs]\nairflow_m_s = 5.0\npressure_hpa = 950.0\n"
        "[[step]]\nat = 80.0\nuncertainty_s = 0.5\nstart = 80.13\nduration_s = 0.4\nairflow_m_s = 2.5\n"
        "source = { temperature_c = 22.0, humidity_percent = 40.0 }\ndestination = { temperature_c = 35.0 }\n"
        "[[step]]\nat = 170.5\nfrom = 150.0\nuntil = 200.0\n",
    )
    assert run(log, "--map", map_, "--out", tmp_path / "c", "--name", "known") == 0
    campaign = read_campaign(tmp_path / "c")
    first, second = campaign.runs
    begins_s = LOG.time_s[np.abs(LOG.time_s - (80.13 - first.start_s)).argmin()]
    assert first.start_s == pytest.approx(80.13 - begins_s, abs=1e-9)
    assert (first.airflow_m_s, first.pressure_hpa, first.duration_s) == (2.5, 950.0, 0.4)
    assert (first.source.temperature_c, first.destination.temperature_c) == (22.0, 35.0)
    assert first.source.humidity_percent == 40.0 and first.destination.humidity_percent is None
    assert second.start_s is None and second.airflow_m_s == 5.0
    assert second.imet.time_s[-1] == pytest.approx(50.0, abs=0.5)
    assert second.extra["step_seen_s"] == pytest.approx(20.25, abs=1e-6)  # 170.5, from the first reading at 150.25
    assert campaign.name == "known" and campaign.bead_radius_m == 2e-4 and campaign.film_thickness_m == 5e-6
    assert campaign.bodies == {"imet": "lumped", "hyt": "film"} and campaign.sensors["imet"]["serial"] == "7"


@pytest.mark.parametrize("reference", ['reference = "fast"', 'reference = ["temp fast [°C]", "rh"]'])
def test_one_sensor_is_the_measured_air_of_another(tmp_path, reference):
    """Named by its table or by its columns: air.csv is its readings, over the whole run and one more on either side."""
    log = two_sensors(tmp_path)
    map_ = written(tmp_path / "map.toml", TWO.replace("{reference}", reference))
    assert run(log, "--map", map_, "--sensor", "slow", "--out", tmp_path / "c") == 0
    campaign = read_campaign(tmp_path / "c")
    assert len(campaign.runs) == 3 and campaign.runs[0].hyt is None
    for one in campaign.runs:
        assert one.air.time_s[0] < one.imet.time_s[0] and one.air.time_s[-1] >= one.imet.time_s[-1]
        zero_s = in_full(
            one.air.time_s - one.air.time_s[0], one.air.values["temperature_c"], LOG.time_s, LOG.temperature_c
        )
        in_full(
            one.air.time_s - one.air.time_s[0], one.air.values["humidity_percent"], LOG.time_s, LOG.humidity_percent
        )
        assert one.imet.time_s[0] == 0.0 and zero_s - one.air.time_s[0] in LOG.time_s
    stated = json.loads((tmp_path / "c/runs/0001/run.json").read_text()).get("reference")
    by_table = {"temperature_time_constant_s": 0.5, "humidity_standard_uncertainty_percent": 0.8}
    assert stated == (by_table if "fast" == reference.split('"')[1] else None)


def slow_beside_a_chamber():
    """A log that begins 35 s before a chamber's controller overshoots, and a sensor in it with a lag of three minutes,
    too slow to show a change of its own so soon."""
    time_s = 3.3 * np.arange(230)
    since = np.maximum(time_s - 35.0, 0.0)
    chamber = 25.0 - 3.5 * np.exp(-((since / 12.0) ** 2)) - 1.1 * np.exp(-(((since - 45.0) / 13.0) ** 2)) * (since > 0)
    sensor = np.full(time_s.size, chamber[0])
    for k in range(1, time_s.size):
        sensor[k] = sensor[k - 1] + (1.0 - np.exp(-3.3 / 180.0)) * (chamber[k - 1] - sensor[k - 1])
    rows = zip(time_s, chamber, np.round(sensor, 2), strict=True)
    return "time_s,chamber_temp,probe_temp\n" + "".join(f"{t:.1f},{a:.3f},{b:.2f}\n" for t, a, b in rows)


def test_a_sensor_too_slow_for_a_change_of_its_own_follows_the_air_beside_it(tmp_path, capsys):
    """It moved where its reference did, and the run is not cut at a step that makes none: all that was recorded."""
    log = written(tmp_path / "log.csv", slow_beside_a_chamber())
    beside = (
        '[sensor.air]\ntemperature = "chamber_temp"\n[sensor.probe]\ntemperature = "probe_temp"\nreference = "air"\n'
    )
    assert run(log, "--map", written(tmp_path / "m.toml", beside), "--out", tmp_path / "c") == 0
    (only,) = read_campaign(tmp_path / "c").runs
    assert only.imet.time_s.size == 230 and only.air is not None
    alone = written(tmp_path / "alone.toml", beside + '[[step]]\nat = 36.0\nsensors = ["air"]\n')
    assert run(log, "--map", alone, "--out", tmp_path / "d") == 2
    assert "the map gives it to air alone: name probe in its sensors too, or delete" in capsys.readouterr().err


def test_a_first_look_without_a_run_says_what_to_do(tmp_path, capsys):
    """As of a record that begins in its response, of which that is one run; and of a sensor that is not connected."""
    time_s = np.arange(0.0, 2000.0, 11.0)
    rows = [f"{t:.0f},{25.0 - 5.0 * np.exp(-t / 300.0):.3f},0.0,0.0" for t in time_s]
    log = written(tmp_path / "log.csv", "\n".join(["time_s,temp a,temp b,rh b", *rows, ""]))
    assert run(log, "--look", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "next: " not in said and "one run: shockrig import --imet LOG" in said
    assert run(log, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 2
    assert "a record that begins in its response is one run" in capsys.readouterr().err
    assert run("--imet", log, "--imet-temperature", "temp a", "--out", tmp_path / "c") == 0
    dead = written(tmp_path / "dead.csv", "\n".join(["time_s,temp b,rh b", *(f"{t:.0f},0.0,0.0" for t in time_s), ""]))
    capsys.readouterr()
    assert run(dead, "--look", "--out", tmp_path / "d") == 2
    assert "temp b, rh b: holds nothing but zeros (not connected?); no other column" in capsys.readouterr().err


def test_a_reading_on_the_way_is_no_power_on_value(tmp_path):
    """An oven that warms in steps of its display passes 85 degC; a sensor that reads it for a moment was started."""
    time_s = np.arange(0.0, 300.0, 0.5)
    oven = np.round(np.minimum(25.0 + 0.5 * time_s[::3].repeat(3)[: time_s.size], 100.0) / 1.5) * 1.5 + 1.0
    assert (oven == 85.0).any()
    started = np.where((time_s > 100.0) & (time_s < 101.0), 85.0, 30.0 + 0.01 * time_s)
    rows = [f"{t},{a:.2f},{b:.2f}" for t, a, b in zip(time_s, oven, started, strict=True)]
    look = look_at([written(tmp_path / "log.csv", "\n".join(["time_s,temp a,temp b", *rows, ""]))], tmp_path / "m.toml")
    said = " ".join(look.logs[0].log.remarks)
    assert "1 reading of 'temp b' that is 85 (DS18B20" in said and "temp a" not in said


def test_only_what_the_sensors_of_a_step_did_is_told(tmp_path, capsys):
    log = two_sensors(tmp_path)
    step = f'[[step]]\nat = {LOG.steps_s[0]}\nsensors = ["fast"]\n'
    map_ = written(tmp_path / "map.toml", TWO.replace("{reference}", "") + step)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    said = capsys.readouterr().out
    assert "fast.temperature: " in said and "slow.temperature: " not in said


BESIDE = '[sensor.air]\ntemperature = "chamber_temp"\n[sensor.probe]\ntemperature = "probe_temp"\nreference = "air"\n'


@pytest.mark.parametrize("steps", ["", '[[step]]\nat = 1500\n[[step]]\nat = 1900\nsensors = ["air"]\n'])
def test_a_run_is_not_cut_where_its_reference_overshoots(tmp_path, capsys, steps):
    """A chamber goes beyond its new level and comes back after 400 s, while the probe in it is on its way."""
    random = np.random.default_rng(0)
    time_s = np.arange(0.0, 6000.0, 3.0)
    chamber = 20.0 + np.where(time_s >= 1500.0, 13.0, 0.0) - np.where(time_s >= 1900.0, 3.0, 0.0)
    probe = np.full(time_s.size, 20.0)
    for k in range(1, time_s.size):
        probe[k] = probe[k - 1] + (1.0 - np.exp(-3.0 / 200.0)) * (chamber[k - 1] - probe[k - 1])
    noise = random.normal(0.0, 0.02, (2, time_s.size))
    rows = zip(time_s, chamber + noise[0], probe + noise[1], strict=True)
    log = written(
        tmp_path / "log.csv",
        "time_s,chamber_temp,probe_temp\n" + "".join(f"{t:.1f},{a:.3f},{b:.3f}\n" for t, a, b in rows),
    )
    assert run(log, "--map", written(tmp_path / "m.toml", BESIDE + steps), "--out", tmp_path / "c") == 0
    (only,) = read_campaign(tmp_path / "c").runs
    assert only.imet.time_s[-1] > 2000.0
    assert ("probe was still on its way from step 1: it is in that run" in capsys.readouterr().out) == (not steps)


def test_a_change_whose_start_nobody_can_tell_leaves_the_run_before_it_half_of_the_way(tmp_path):
    """A plunge, and a bath that then cools for an hour: the slow change begins anywhere, the plunge's run stays."""
    random = np.random.default_rng(7)
    time_s = np.arange(0.0, 4000.0, 1.0)
    value = 20.0 + 47.0 * (time_s >= 300.0) * np.exp(-np.maximum(time_s - 360.0, 0.0) / 900.0)
    value += random.normal(0.0, 0.05, time_s.size)
    log = written(
        tmp_path / "log.csv",
        "time_s,temp\n" + "".join(f"{t:.1f},{v:.2f}\n" for t, v in zip(time_s, value, strict=True)),
    )
    map_ = written(tmp_path / "m.toml", '[sensor.bead]\ntemperature = "temp"\n')
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    first = read_campaign(tmp_path / "c").runs[0]
    seen_s = first.extra["step_seen_s"]
    assert first.imet.time_s[-1] - seen_s > 20.0 and first.imet.values["temperature_c"][-1] > 60.0


def test_several_sensors_make_a_campaign_each(tmp_path, capsys):
    """A folder each under --out; what is only a reference makes none, unless it is asked for."""
    log = two_sensors(tmp_path)
    both = written(tmp_path / "both.toml", TWO.replace("{reference}", ""))
    assert run(log, "--map", both, "--out", tmp_path / "both") == 0
    assert sorted(p.name for p in (tmp_path / "both").iterdir()) == ["fast", "slow"]
    assert [len(read_campaign(tmp_path / "both" / name).runs) for name in ("fast", "slow")] == [3, 3]
    beside = written(tmp_path / "beside.toml", TWO.replace("{reference}", 'reference = "fast"'))
    assert run(log, "--map", beside, "--out", tmp_path / "one") == 0
    assert read_campaign(tmp_path / "one").runs[0].air is not None
    assert run(log, "--map", beside, "--sensor", "fast", "--out", tmp_path / "other") == 0
    assert read_campaign(tmp_path / "other").runs[0].hyt is not None
    said = capsys.readouterr().out
    assert "air measured beside the sensor (air.csv): 3 of 3 runs" in said
    assert "not known: the airflow, 3 of 3 runs; state airflow_m_s in the map" in said
    assert f"next: shockrig diagnose {tmp_path / 'one'} --out" in said


def test_several_logs_make_one_campaign(tmp_path):
    log = written(tmp_path / "a.csv", WAYS["plain"])
    other = written(tmp_path / "b.csv", WAYS["plain"] + "\n")
    map_ = written(tmp_path / "m.toml", MAP + '[[step]]\nlog = "a.csv"\nat = 80.1\n')
    assert run(log, other, "--map", map_, "--out", tmp_path / "c") == 0
    heads = [json.loads((p / "run.json").read_text()) for p in sorted((tmp_path / "c/runs").iterdir())]
    # One step stated for a.csv; b.csv has none stated, so its three are found.
    assert [head["imported"]["log"] for head in heads] == ["a.csv", "b.csv", "b.csv", "b.csv"]


def test_a_clock_that_starts_anew_and_a_gap_divide_a_log(tmp_path, capsys):
    """Twice the same log after one another, and 200 s cut out where nothing happens: no step is lost or made."""
    lines = plain("time_s,temperature_c,humidity_percent")
    gap = [line for line in lines[1:] if not 100.0 < float(line.split(",")[0]) < 160.0]
    log = written(tmp_path / "log.csv", text([*lines, *gap]))
    map_ = written(tmp_path / "map.toml", MAP)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    said = capsys.readouterr().out
    assert "the clock starts anew once (first in line 682)" in said and "a gap of 60" in said
    assert run(log, "--look", "--out", tmp_path / "look") == 0
    looked = capsys.readouterr().out
    assert ", piece 1\n" in looked and ", piece 2\n" in looked  # a time that is there twice is told by its piece
    seen = [json.loads((p / "run.json").read_text())["imported"]["at"] for p in sorted((tmp_path / "c/runs").iterdir())]
    assert [float(at) for at in seen] == pytest.approx([*LOG.steps_s, *LOG.steps_s], abs=1.0)
    # A step stated by a time that is there twice must say in which piece.
    map_.write_text(MAP + "[[step]]\nat = 80.1\n")
    assert run(log, "--map", map_, "--out", tmp_path / "d") == 2
    assert "is there 2 times, the clock starts anew; add piece = N" in capsys.readouterr().err
    map_.write_text(MAP + "[[step]]\nat = 80.1\npiece = 2\n")
    assert run(log, "--map", map_, "--out", tmp_path / "d") == 0


def test_a_log_whose_newest_row_stands_on_top_is_read_from_its_end(capsys, tmp_path):
    """And where its clock was set besides, the two pieces are told apart as in any other log."""
    stamps = np.concatenate([np.arange(200.0), np.arange(50.0, 150.0)])[::-1]
    ordered = in_order(stamps, {"t": np.arange(300.0)[::-1]}, np.arange(2, 302), "auto")
    assert ordered.pieces == (slice(0, 200), slice(200, 300)) and (np.diff(ordered.values["t"]) == 1.0).all()
    assert "from the last to the first" in ordered.remarks[0] and "(first in line 101)" in ordered.remarks[1]
    log = written(tmp_path / "log.csv", WAYS["the newest row on top"])
    assert run(log, "--look", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "one every 0.5 s" in said and "out of order" not in said and "starts anew" not in said


@pytest.mark.parametrize("name", ["T", "T [C]"])
def test_a_temperature_that_falls_is_no_clock_of_which_the_newest_row_is_on_top(name):
    cells = [[f"{20 - 0.1 * n:.1f}", f"{50 + n % 3}"] for n in range(60)]
    assert clock_columns.guess_clock([name, "rh"], cells, ["", ""]) is None


def test_times_that_nobody_can_read_are_not_made_up_for_by_what_rises_beside_them(tmp_path, capsys):
    """Numbers of rows had been seconds, 10 s apart as these are; the column and what stands in it are named."""
    stamps = date("%Y~%j~%H%M%S")
    rows = [f"{n},{stamps(10 * n)},{20.0 if n < 60 else 30.0}" for n in range(200)]
    log = written(tmp_path / "log.csv", text(["tick,Time,Temp (C)", *rows]))
    assert run(log, "--look", "--out", tmp_path) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "Time holds '2026~121~" in said and 'time = "Time", time_format = "..."' in said


@pytest.mark.parametrize("names", ["packetnr,hh,mm,ss,T,rh", "hour,minute,second,T,rh,n"])
def test_hours_minutes_and_seconds_in_a_column_each_are_times_of_day(names):
    """As a receiver of satellites gives them: no column of times was recognised."""
    at = {"hh": lambda n: 11, "mm": lambda n: 50 + n // 60, "ss": lambda n: n % 60}
    at |= {"hour": at["hh"], "minute": at["mm"], "second": at["ss"], "packetnr": int, "n": int}
    cells = [[str(at.get(name, lambda n: 20 + n % 3)(n)) for name in names.split(",")] for n in range(90)]
    clock = clock_columns.guess_clock(names.split(","), cells, [""] * 6)
    assert clock is not None and clock.format == "%H %M %S" and clock.is_of_day
    first = ["hh", "mm", "ss"] if "hh" in names else ["hour", "minute", "second"]
    assert list(clock.columns) == first


def test_names_that_rows_hold_no_cell_for_are_said(tmp_path, capsys):
    """The names were taken from the left without a word: whichever columns a logger left out, all behind it stood under
    another's name."""
    lines = lines_of("time_s;temperature_c;humidity_percent;altitude_m;lat", lambda t, a, b, n: f"{t:.2f};{a};{b}")
    log = written(tmp_path / "log.csv", text(lines))
    assert run(log, "--look", "--out", tmp_path) == 0
    assert "rows hold 3 cells, too few for the line of names" in capsys.readouterr().out
    lines = lines_of("time;lat;lon;temperature_c", lambda t, a, b, n: f";{a};{b}")
    assert run(written(tmp_path / "shifted.csv", text(lines)), "--look", "--out", tmp_path) == 2
    assert "rows hold no cell for temperature_c, or for others" in capsys.readouterr().err


def test_dates_with_times_of_day_that_go_on_are_the_clock_whatever_their_column_is_called(tmp_path, capsys):
    """As a feed that is downloaded has them, far behind; a date that stands still there is when something was made."""
    stamped = date("%Y-%m-%d %H:%M:%S.%f -0800")
    lines = lines_of(
        "id,feed,place,temperature,bought_at,created_at,updated_at",
        lambda t, a, b, n: f"{n},7,hall,{a},2020-01-01 12:00:00,{stamped(t)},{stamped(t)}",
    )
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert look.map.time == ("created_at",)
    lines = lines_of("id,feed,place,value,created_at", lambda t, a, b, n: f"{n},7,hall,{a},{stamped(t)}")
    assert run(written(tmp_path / "value.csv", text(lines)), "--look", "--out", tmp_path) == 2
    assert '[log] time = "created_at" and [sensor.NAME]' in capsys.readouterr().err
    lines = lines_of(
        "time_s,id,feed,temperature,created_at", lambda t, a, b, n: f"{t:.2f},{n},7,{a},{stamped(60.0 * (t // 60.0))}"
    )
    look = look_at([written(tmp_path / "both.csv", text(lines))], tmp_path / "both.toml")
    assert look.map.time == ("time_s",)
    lines = lines_of("Tempo,Temp In (C)", lambda t, a, b, n: f"{t:.2f},{a}")
    look = look_at([written(tmp_path / "tempo.csv", text(lines))], tmp_path / "tempo.toml")
    assert look.map.time == ("Tempo",) and len(look.map.sensors) == 1


@pytest.mark.parametrize("zone", ["UTC", "GMT"])
def test_a_zone_behind_a_time_is_read(tmp_path, zone):
    """As ThingSpeak and Adafruit IO export a channel."""
    stamps = date(f"%Y-%m-%d %H:%M:%S {zone}")
    lines = lines_of("created_at,entry_id,temperature", lambda t, a, b, n: f"{stamps(2.0 * t)},{n},{a}")
    log = written(tmp_path / "feeds.csv", text(lines))
    look = look_at([log], tmp_path / "feeds.toml")
    assert look.map.time == ("created_at",) and len(look.steps[0]) == 3
    assert run(log, "--map", written(tmp_path / "m.toml", look.text), "--out", tmp_path / "c") == 0
    first = read_campaign(tmp_path / "c").runs[0]
    assert first.started_at.startswith("2026-05-01T12:0") and np.diff(first.imet.time_s) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("name", "unit_s"), [("Minuto", 60.0), ("Minuten", 60.0), ("segundos", 1.0), ("Stunden", 3600.0)]
)
def test_a_unit_of_time_is_known_in_other_languages(tmp_path, name, unit_s):
    """Minutes that were taken for seconds make every response sixty times as fast."""
    lines = lines_of(f"{name},temperatura", lambda t, a, b, n: f"{t / unit_s:.6f},{a}")
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert look.logs[0].log.period_s == pytest.approx(0.5, rel=0.01) and not any("time:" in said for said in look.notes)


@pytest.mark.parametrize(
    ("names", "sensors"),
    [
        ("Temperatura,Umidade", {"sensor"}),
        ("TEMPERATURA 2,HUMEDAD 2", {"sensor2"}),
        ("Temperatures (C),Umidità", {"sensor"}),
        ("TMP,umidita", {"sensor"}),
    ],
)
def test_quantities_in_other_languages_are_no_sensors_names(tmp_path, names, sensors):
    """A column TEMPERATURA had been the temperature of a sensor A, Temperatures that of one s."""
    lines = lines_of(f"time_s,{names}", lambda t, a, b, n: f"{t:.2f},{a},{b}")
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert set(look.map.sensors) == sensors
    (sensor,) = look.map.sensors.values()
    assert {"temperature", "humidity"} <= set(sensor.columns)


def easylog():
    """As Lascar's EasyLog exports: the logger's number stands in the first row alone."""
    stamps = date("%Y-%m-%d %H:%M:%S.%f")
    return lines_of(
        "Fridge 2,Time,Celsius(°C),Humidity(%rh),Dew Point(°C),Serial Number",
        lambda t, a, b, n: f"{n + 1},{stamps(t)},{a},{b},9.1{'' if n else ',010012345'}",
    )


def elapsed(t):
    return f"{int(t // 3600)}:{int(t // 60 % 60):02d}:{t % 60:05.2f}"


EXPORTS = {
    "EasyLog": easylog(),
    "LogTag": lines_of(
        "Reading,Elapsed,Date,Time,Temperature,Humidity",
        lambda t, a, b, n: f"{n},{elapsed(t)},{date('%d-%m-%Y,%H:%M:%S.%f')(t)},{a},{b}",
    ),
    "MadgeTech": plain("Date,Time,Temperature (°C),Humidity (%RH)", date("%m/%d/%Y,%I:%M:%S.%f %p")),
    "Rotronic": lines_of(
        "Date\tTime\t%rh\t°C\tDP °C", lambda t, a, b, n: f"{date('%d/%m/%Y%t%H:%M:%S.%f')(t)}\t{b}\t{a}\t{a - 15:.2f}"
    ),
    "Sensirion": plain("Local_Date_Time\tT_SHT4x\tRH_SHT4x", date("%Y-%m-%dT%H:%M:%S.%f"), "\t"),
    "SwitchBot": lines_of(
        "Date,Temperature_Celsius(℃),Relative_Humidity(%),DPT(℃),VPD(kPa),Abs Humidity(g/m³)",
        lambda t, a, b, n: f'"{date("%b %d, %Y %H:%M:%S.%f")(t)}",{a},{b},9.1,1.2,8.8',
    ),
}


@pytest.mark.parametrize("logger", EXPORTS)
def test_what_a_loggers_program_exports_is_read(tmp_path, logger):
    """Of each its clock, its temperature and its humidity, and nothing that was computed from these."""
    look = look_at([written(tmp_path / "log.txt", text(EXPORTS[logger]))], tmp_path / "log.toml")
    log = look.logs[0].log
    (sensor,) = look.map.sensors.values()
    assert set(sensor.columns) == {"temperature", "humidity", "die_temperature"} and len(look.steps[0]) == 3
    assert log.time_s.size == LOG.time_s.size and log.period_s == pytest.approx(0.5)
    assert log.origin_s == pytest.approx(DAY.timestamp() + LOG.time_s[0], abs=0.01)
    assert (log.values[sensor.columns["temperature"][0]] == LOG.temperature_c).all()
    assert (log.values[sensor.columns["humidity"][0]] == LOG.humidity_percent).all()


def test_a_date_in_parts_without_names_is_one(tmp_path, capsys):
    parts = date("%Y %-m %-d %-H %-M %-S")
    log = written(tmp_path / "log.txt", text(lines_of("", lambda t, a, b, n: f"{parts(t)} {a}")[::2]))
    columns = ", ".join(f'"{n + 1}"' for n in range(6))
    map_ = f'[log]\nheader_line = 0\ntime = [{columns}]\n[sensor.x]\ntemperature = "7"\n'
    map_ = written(tmp_path / "map.toml", map_)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0, capsys.readouterr().err
    assert len(read_campaign(tmp_path / "c").runs) == 3


def test_more_notes_than_rows_are_notes(tmp_path, capsys):
    """As a logger prints them to a terminal; the map says what parts the cells of the rows."""
    rows = lines_of("time_s,temperature_c,humidity_percent", lambda t, a, b, n: f"{t:.2f},{a},{b}")
    log = written(tmp_path / "log.txt", text([line for row in rows for line in (*["waiting for the sensor"] * 3, row)]))
    map_ = written(tmp_path / "map.toml", '[log]\nseparator = "comma"\n' + MAP)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0, capsys.readouterr().err
    assert len(read_campaign(tmp_path / "c").runs) == 3


def test_of_a_sensor_that_jumps_and_drifts_back_it_is_not_said_that_it_did_not_move(tmp_path, capsys):
    time_s = np.arange(0.0, 400.0)
    stays, back = 20.0 + 10.0 * (time_s >= 200.0), 20.0 + 10.0 * (time_s >= 200.0) * np.exp(-(time_s - 200.0) / 40.0)
    noise = 0.01 * np.random.default_rng(1).standard_normal((2, 400))
    rows = [f"{t:.0f},{a:.3f},{b:.3f}" for t, a, b in zip(time_s, stays + noise[0], back + noise[1], strict=True)]
    log = written(tmp_path / "log.csv", text(["time_s,temp_a,temp_b", *rows]))
    map_ = written(tmp_path / "map.toml", "[sensor.a]\ntemperature = 'temp_a'\n[sensor.b]\ntemperature = 'temp_b'\n")
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0, capsys.readouterr().err
    said = capsys.readouterr().out
    assert "b shows no step there" in said and "did not move" not in said


def test_times_without_a_date_are_times_of_day_whatever_their_format(tmp_path, capsys):
    """Hour, minute and second in columns of their own, past midnight: no day of 1900, and no clock that starts anew."""
    log = written(tmp_path / "log.csv", text(plain("h,m,s,temp,rh", date("%H,%M,%S.%f", NIGHT))))
    said = '[log]\ntime = ["h", "m", "s"]\ntime_format = "%H %M %S.%f"\n[sensor.a]\ntemperature = "temp"\n'
    map_ = written(tmp_path / "m.toml", said)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    shown = capsys.readouterr().out
    assert "1900" not in shown and "starts anew" not in shown and "23:58:20" in shown  # 80.13 s after 23:57
    campaign = read_campaign(tmp_path / "c")
    assert len(campaign.runs) == 3 and campaign.runs[0].extra["imported"]["times"] == "named"
    steps = '[[step]]\nat = "23:58:20.1"\n[[step]]\nat = "23 59 50.7"\n'
    assert run(log, "--map", written(tmp_path / "n.toml", said + steps), "--out", tmp_path / "d") == 0
    assert len(read_campaign(tmp_path / "d").runs) == 2


def test_coarse_stamps_are_spread(tmp_path, capsys):
    """Stamps of whole seconds at two readings a second: times come out to half a reading, none is lost."""
    log = written(
        tmp_path / "log.csv", text(plain("time_s,temperature_c,humidity_percent", time=lambda t: f"{int(t)}"))
    )
    assert run(log, "--map", written(tmp_path / "m.toml", MAP), "--out", tmp_path / "c") == 0
    assert "680 rows share coarse stamps and are spread evenly" in capsys.readouterr().out
    for one in read_campaign(tmp_path / "c").runs:
        assert np.diff(one.imet.time_s) == pytest.approx(0.5, abs=1e-6)


def test_readings_that_come_again_under_a_coarse_stamp_keep_their_place():
    """Whole minutes at a reading a second, of a sensor that shows tenths: it rests, and goes in half a minute."""
    row = np.arange(3600)
    reading = np.round(20.0 + 5.0 * np.clip((row - 1830) / 30.0, 0.0, 1.0), 1)
    ordered = in_order(60.0 * (row // 60), {"t": reading}, row + 1, "auto")
    assert ordered.remarks[0].startswith("3600 rows share coarse stamps")
    assert ordered.time_s == pytest.approx(row + 0.5)
    # Rows that are there twice are so under any stamp.
    twice = in_order(np.repeat(60.0 * row, 2), {"t": np.repeat(reading, 2)}, np.arange(7200) + 1, "auto")
    assert twice.remarks == ("3600 rows repeat a stamp and its readings and are left out",)


def test_a_short_piece_beside_rows_taken_evenly_keeps_its_rows():
    """Whole seconds of rows every 0.6 s: thirty of them, and after a pause many, which alone are enough for a line."""
    stamps = np.floor(0.6 * np.arange(30))
    late = np.floor(200.0 + 0.6 * np.arange(900))
    time_s = np.concatenate([stamps, late])
    ordered = in_order(time_s, {"t": 0.01 * np.arange(930.0)}, np.arange(930) + 1, "auto")
    assert ordered.time_s.size == 930 and (np.diff(ordered.time_s) > 0.0).all()
    assert np.abs(ordered.time_s - time_s).max() <= 1.0


@pytest.mark.parametrize("period_s", [1.141, 2.6, 0.85])
def test_stamps_too_coarse_for_even_rows_are_taken_evenly(tmp_path, capsys, period_s):
    """Whole seconds of rows that come every 1.141 s (0, 1, 2, 3, 5): times on a line, if not told otherwise."""
    header = "time_s,temperature_c,humidity_percent"
    log = written(tmp_path / "log.csv", text(plain(header, time=lambda t: f"{int(t / 0.5 * period_s)}")))
    assert run(log, "--map", written(tmp_path / "m.toml", MAP), "--out", tmp_path / "c") == 0
    said = capsys.readouterr().out
    assert f"one every {period_s:.4g} s" in said and "bear stamps in steps of 1 s" in said
    for one in read_campaign(tmp_path / "c").runs:
        assert np.diff(one.imet.time_s) == pytest.approx(period_s, rel=1e-3)
    kept = written(tmp_path / "k.toml", '[log]\nrepeated_stamps = "first"\n' + MAP)
    assert run(log, "--map", kept, "--out", tmp_path / "d") == 0
    assert "bear stamps in steps of" not in capsys.readouterr().out
    for one in read_campaign(tmp_path / "d").runs:
        assert (np.diff(one.imet.time_s) % 1.0 == 0.0).all()


def test_a_clock_that_starts_anew_after_few_rows_loses_none():
    """A first session of 46 rows had been sorted into the second one, and its readings left out."""
    stamps = np.concatenate([np.arange(1.0, 47.0), np.arange(1.0, 511.0)])
    ordered = in_order(stamps, {}, range(stamps.size), "auto")
    assert ordered.pieces == (slice(0, 46), slice(46, 556)) and (ordered.time_s == stamps).all()
    assert any("the clock starts anew once" in said for said in ordered.remarks)


@pytest.mark.parametrize("late", [slice(60, 70), slice(60, 61), slice(20, 80)])
def test_rows_that_came_late_are_sorted_however_many_they_are(late):
    rows = np.arange(200.0)
    behind = np.concatenate([rows[: late.start], rows[late.stop : 90], rows[late], rows[90:]])
    ordered = in_order(behind, {}, range(200), "auto")
    assert ordered.pieces == (slice(0, 200),) and (ordered.time_s == rows).all()


def test_rows_that_were_lost_do_not_make_stamps_coarse():
    """A row every second, one in twenty lost by chance, and each stretch between holes for itself."""
    stamps = np.flatnonzero(np.random.default_rng(3).random(2000) > 0.05).astype(float)
    ordered = in_order(stamps, {}, range(stamps.size), "auto")
    assert (ordered.time_s == stamps).all() and not ordered.remarks
    true = 1.2 * np.arange(400.0)
    stamps = np.concatenate([np.floor(true), 520.0 + np.floor(true), 1040.0 + np.arange(50.0)])
    ordered = in_order(stamps, {}, range(stamps.size), "auto")
    assert np.diff(ordered.time_s[:400]) == pytest.approx(1.2, rel=1e-3)
    assert np.diff(ordered.time_s[400:800]) == pytest.approx(1.2, rel=1e-3)
    assert (ordered.time_s[800:] == stamps[800:]).all() and (np.diff(ordered.time_s) > 0.0).all()
    assert "800 rows bear stamps in steps of 1 s and come every 1.2 s" in ordered.remarks[0]


def test_the_largest_number_there_is_is_an_absurd_stamp():
    stamps = 0.5 * np.arange(700.0)
    ordered = in_order(np.where(stamps == 339.5, 1e308, stamps), {}, range(700), "auto")
    assert (ordered.time_s == stamps[stamps != 339.5]).all()


def test_a_log_without_names_says_how_it_is_read(tmp_path, capsys):
    log = written(tmp_path / "log.csv", text(plain("time_s,temperature_c,humidity_percent")[1:]))
    assert run(log, "--look", "--out", tmp_path / "look") == 2
    said = capsys.readouterr().err
    assert 'header_line = 0, time = "1" and [sensor.NAME] temperature = "N"' in said and "numbers from 1 to 3" in said
    map_ = '[log]\nheader_line = 0\ntime = "1"\n[sensor.bead]\ntemperature = "2"\nhumidity = "3"\n'
    assert run(log, "--map", written(tmp_path / "m.toml", map_), "--out", tmp_path / "c") == 0


def test_a_unit_that_only_the_cells_name_is_the_readings_unit(tmp_path):
    """A map that states no unit reads 71.6 °F as 22 °C; a k behind a number makes no thermometer of a resistor."""
    readings = zip(LOG.time_s, LOG.temperature_c, strict=True)
    rows = [f"{t:.2f},{1.8 * c + 32.0:.2f} °F,{10.0 + c:.1f}k" for t, c in readings]
    log = written(tmp_path / "log.csv", text(["time,temp,resistor", *rows]))
    map_ = written(tmp_path / "m.toml", '[sensor.bead]\ntemperature = "temp"\n')
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    bead = series(tmp_path / "c" / "runs" / "0001", "imet")["temperature_c"]
    assert np.median(bead[:50]) == pytest.approx(22.0, abs=0.05)
    first = look_at([log], tmp_path / "log.toml").text
    assert 'temperature_unit = "degF"' in first and "by its name no temperature" in first.split("resistor")[0]


def test_a_unit_in_the_cells_of_the_times_is_theirs(tmp_path):
    rows = [f"{1.6e9 + t:.3f}s,{c:.2f}" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    log = written(tmp_path / "log.csv", text(["time,temp", *rows]))
    map_ = written(tmp_path / "m.toml", look_at([log], tmp_path / "m.toml").text)
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    runs = read_campaign(tmp_path / "c").runs
    assert len(runs) == 3 and np.diff(runs[0].imet.time_s) == pytest.approx(0.5, abs=1e-3)


def test_a_comment_may_name_more_columns_than_there_are(tmp_path):
    """As numpy writes a header of its own beside a table that has grown no further."""
    rows = [f"{t:.18e},{c:.18e}" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    scanned = scan(written(tmp_path / "log.csv", text(["# time,heater temp,P,I", *rows])), Layout())
    assert scanned.names == ("time", "heater temp")


@pytest.mark.parametrize("name", ["Motor Efficiency (%)", "duty cycle [%]", "charge_percent"])
def test_a_percentage_of_something_else_is_no_humidity(name):
    assert quantity_of(name, "percent") is None
    assert quantity_of("Kanal 2 [%]", "percent") == "humidity"


@pytest.mark.parametrize("name", ["Humidifier Level", "dehumidifier_state"])
def test_a_device_that_makes_humidity_is_no_hygrometer(name):
    """Its setting was another sensor's humidity."""
    assert quantity_of(name, None) is None and quantity_of("Indoor Humidity", None) == "humidity"


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("Compressor Temp", "temperature"), ("compressor", None), ("Tx Attempts ()", None), ("template", None),
        ("Evaporator temp", "temperature"), ("thermostat", None), ("baro_temp", "temperature"),
        ("Discharge Temp", "temperature"), ("charge temp", None), ("Air Compressor Pressure", "pressure"),
        ("ror_f", None),
    ],
)  # fmt: skip
def test_a_word_within_a_word_says_nothing(name, quantity):
    """A fridge's compressor had a pressure, a modem's attempts were in degC, and a rate of rise was in degF."""
    assert quantity_of(name, unit_in_name(name)) == quantity


@pytest.mark.parametrize("name", ["HUM_ABS.d", "Absolute Humidity", "AbsoluteHumidity", "specific humidity"])
def test_an_absolute_humidity_is_no_relative_one(name):
    """Before: of an aircraft's HUM_ABS.d and HUM_REL.d the first was taken."""
    assert quantity_of(name, None) is None and quantity_of(name.lower().replace("hum", "pres"), None) != "humidity"
    assert quantity_of("HUM_REL.d", None) == "humidity" and quantity_of("abs. Feuchte", None) is None


def test_a_flag_for_errors_is_no_humidity():
    """Before: of a dropsonde's raw CSV 'FRAME BLOCK error (0-1)' was, and 'RSS421 RH (%)' another one."""
    assert quantity_of("FRAME BLOCK error (0-1)", unit_in_name("FRAME BLOCK error (0-1)")) is None


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("Speed(km/hr)", None), ("rain mm/hr", None), ("Wind Speed km/hr", "airflow"),
        ("T/HR", "humidity"), ("hr", "humidity"),
    ],
)  # fmt: skip
def test_an_hour_in_a_unit_is_no_humidity(name, quantity):
    """Beside 'Humidity(%)' a note had named 'Speed(km/hr)' as another."""
    assert quantity_of(name, None) == quantity


def test_a_speed_in_km_hr_is_one():
    assert unit_in_name("Speed(km/hr)") == "km/h" and quantity_of("Speed(km/hr)", "km/h") == "airflow"


def test_columns_that_are_not_used_are_said_and_german_humidity_is_known(tmp_path, capsys):
    names = ("time [s]", "Kanal 1 [°C]", "Kanal 2 [% r.F.]", "Channel X")
    rows = zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, LOG.time_s, strict=True)
    lines = [";".join(names), *(";".join(f"{value:.3f}" for value in row) for row in rows)]
    log = written(tmp_path / "log.csv", "\n".join(lines) + "\n")
    assert run(log, "--look", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "not used, by its name no temperature, humidity, pressure or airflow: Channel X" in said
    assert "one sensor\n" in said and 'humidity = "Kanal 2 [% r.F.]"' in (tmp_path / "log.toml").read_text("utf-8")


def test_a_raw_count_with_a_thermometers_name_does_not_stand_in_the_way_of_the_others(tmp_path, capsys):
    """As an NTC's number from its converter: what is left is looked at, and the map says why the column is not in it.
    Where it is all that there is, what cannot be is said as before."""
    lines = lines_of("time_s,temp,ntc,rh", lambda t, a, b, n: f"{t:.2f},{a:.2f},{2000 + 10 * a:.0f},{b:.2f}")
    log = written(tmp_path / "log.csv", text(lines))
    assert run(log, "--look", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "one sensor" in said and "3 steps seen" in said and "hardly any of it can be" in said and "ntc" in said
    assert run(log, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 0
    log.write_text(text(lines_of("time_s,ntc", lambda t, a, b, n: f"{t:.2f},{2000 + 10 * a:.0f}")))
    assert run(log, "--look", "--out", tmp_path / "again") == 2
    assert "column 'ntc': 2220 cannot be" in capsys.readouterr().err


def test_a_unit_that_a_person_states_is_no_slip_however_hot_it_is(tmp_path, capsys):
    """A kiln at 200 to 900 degC, whose column is called temp: the error asks for the unit, and it is taken."""
    kiln = 200.0 + 35.0 * (LOG.temperature_c - LOG.temperature_c.min())
    rows = [f"{t:.2f},{c:.2f}" for t, c in zip(LOG.time_s, kiln, strict=True)]
    log = written(tmp_path / "log.csv", text(["time_s,temp", *rows]))
    map_ = written(tmp_path / "m.toml", '[sensor.kiln]\ntemperature = "temp"\n')
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 2
    assert "state the right temperature_unit in the map" in capsys.readouterr().err
    map_.write_text(map_.read_text("utf-8") + 'temperature_unit = "degC"\n', "utf-8")
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0, capsys.readouterr().err
    assert len(read_campaign(tmp_path / "c").runs) == 3


@pytest.mark.parametrize("name", ["Front-temp Setting", "heater temp setting (C)"])
def test_a_temperature_that_somebody_sets_is_no_sensor(name):
    assert quantity_of(name, None) is None


def test_a_count_of_rows_is_no_clock_where_its_name_is_one_word():
    assert clock_columns.counters(["packetnr", "recno", "PacketID", "pressure", "samplerate"]) == [
        "packetnr",
        "recno",
        "PacketID",
    ]


def test_a_log_without_times_is_read_by_the_time_from_row_to_row(tmp_path, capsys):
    rows = [f"{80.0 if t > 80.0 else 0.0},{c}" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    log = written(tmp_path / "log.csv", text(["heater,temperature_c", *rows]))
    assert run(log, "--look", "--out", tmp_path / "look") == 2
    assert "every_s = 1.0" in capsys.readouterr().err
    still = written(tmp_path / "still.toml", '[log]\ntime = "heater"\n[sensor.bead]\ntemperature = "temperature_c"\n')
    assert run(log, "--map", still, "--out", tmp_path / "c") == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "column heater: holds the same over and over" in said and "every_s = 1.0" in said
    even = written(tmp_path / "even.toml", '[log]\nevery_s = 0.5\n[sensor.bead]\ntemperature = "temperature_c"\n')
    assert run(log, "--map", even, "--out", tmp_path / "c") == 0
    runs = read_campaign(tmp_path / "c").runs
    assert len(runs) == 3 and np.diff(runs[0].imet.time_s) == pytest.approx(0.5)


def test_a_file_of_nothing_but_readings_is_read_by_the_time_from_one_to_the_next(tmp_path, capsys):
    log = written(tmp_path / "log.txt", text([f"{value:.2f}" for value in LOG.temperature_c]))
    assert run(log, "--look", "--out", tmp_path / "look") == 2
    assert "where it holds readings alone" in (said := capsys.readouterr().err) and "every_s = 1.0" in said
    map_ = '[log]\nheader_line = 0\nevery_s = 0.5\n[sensor.bead]\ntemperature = "1"\n'
    assert run(log, "--map", written(tmp_path / "m.toml", map_), "--out", tmp_path / "c") == 0
    runs = read_campaign(tmp_path / "c").runs
    assert len(runs) == 3 and np.diff(runs[0].imet.time_s) == pytest.approx(0.5)


@pytest.mark.parametrize(("since_s", "unit_s"), [(DAY.timestamp(), 1e-3), (DAY.timestamp(), 1.0), (0.0, 1.0)])
def test_a_column_of_times_that_a_map_names_and_says_no_more_of_is_understood_as_one_that_is_called_so(
    tmp_path, since_s, unit_s, capsys
):
    """Milliseconds since 1970 beside a number of the row had been seconds since then: a row every 500 s."""
    times = (since_s + LOG.time_s) / unit_s
    rows = [f"{n},{t:.2f},{c:.2f}" for n, (t, c) in enumerate(zip(times, LOG.temperature_c, strict=True))]
    map_ = '[log]\nheader_line = 0\ntime = "2"\n[sensor.bead]\ntemperature = "3"\n'
    log, map_path = written(tmp_path / "log.csv", text(rows)), written(tmp_path / "m.toml", map_)
    assert run(log, "--look", "--map", map_path, "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "one every 0.5 s" in said and "its name is none of times" not in said
    assert run(log, "--map", map_path, "--out", tmp_path / "c") == 0
    first = read_campaign(tmp_path / "c").runs[0]
    assert np.diff(first.imet.time_s) == pytest.approx(0.5, abs=0.02)
    assert (first.started_at is None) == (since_s == 0.0)


@pytest.mark.parametrize(("names", "first"), [("setpoint;temp;rh", "1"), ("time;setpoint;temp", "time")])
def test_a_line_of_names_that_is_one_short_leaves_the_first_column_without(tmp_path, names, first):
    """As R writes row names; but where a word for time comes first, the last column has none."""
    rows = [
        f"{DAY + timedelta(seconds=t):%d.%m.%Y %H:%M:%S.%f};20;{c:.2f};{h:.2f}"
        for t, c, h in zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, strict=True)
    ]
    scanned = scan(written(tmp_path / "log.csv", text([names, *rows])), Layout())
    assert scanned.names == ("1", "setpoint", "temp", "rh") if first == "1" else ("time", "setpoint", "temp", "4")


def test_names_that_stop_before_the_columns_do_are_those_of_the_first(tmp_path):
    rows = [f"{t:.2f}\t{c:.2f}\t{c:.2f}\t{c:.2f}\t" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    scanned = scan(written(tmp_path / "log.csv", text(["Second\tTime\tTemperatures (C)", *rows])), Layout())
    assert scanned.names == ("Second", "Time", "Temperatures (C)", "4", "5")


def test_tabs_part_what_blanks_would_part_into_as_many_cells(tmp_path):
    """LabVIEW's header has more lines of so many words than a short log has rows."""
    head = labview()[: -LOG.time_s.size]
    rows = plain("", separator="\t", decimal=",")[:6]
    scanned = scan(written(tmp_path / "log.lvm", text([*head, *rows])), Layout())
    assert (scanned.separator, scanned.names, len(scanned.rows)) == ("\t", ("X_Value", "Temperature", "Humidity"), 6)
    moved = scan(written(tmp_path / "moved.csv", text(["\t\t\tTime\tTemperature\tHumidity", *rows])), Layout())
    assert moved.names == ("Time", "Temperature", "Humidity")


def test_dates_in_two_ways_are_said_to_be(tmp_path, capsys):
    rows = plain("when,temp", time=date("%m/%d/%Y %H:%M:%S"))
    rows[400:] = plain("", time=date("%m/%d/%y %I:%M:%S %p"))[400:]
    assert run(written(tmp_path / "log.csv", text(rows)), "--look", "--out", tmp_path) == 2
    said = capsys.readouterr().err
    assert "written in two ways (05/01/2026 12:00:00 and 05/01/26 12:05:39 PM)" in said, said


def test_a_state_is_what_the_row_says_that_it_is_of(tmp_path, capsys):
    """As Home Assistant exports the history of several entities."""
    stamps = date("%Y-%m-%dT%H:%M:%S.%fZ")
    body = [
        *lines_of("", lambda t, a, b, n: f"sensor.battery,97,{stamps(t)}"),
        *lines_of("", lambda t, a, b, n: f"sensor.attic_temperature,{a:.2f},{stamps(t)}"),
        *lines_of("", lambda t, a, b, n: f"sensor.attic_humidity,{b:.2f},{stamps(t)}"),
    ]
    log = written(tmp_path / "log.csv", text(["entity_id,state,last_changed", *body]))
    assert run(log, "--look", "--out", tmp_path) == 0
    map_ = (tmp_path / "log.toml").read_text()
    assert 'only = { "entity_id" = "sensor.attic_temperature" }' in map_ and '\ntemperature = "state"' in map_
    assert run(log, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 0
    assert len(read_campaign(tmp_path / "c").runs) == 3
    humid = look_at([log], tmp_path / "other.toml", sensor="sensor.attic_humidity")
    assert '\nhumidity = "state"' in humid.text and len(humid.steps[0]) == 3
    assert run(log, "--look", "--sensor", "sensor.attic_humidity", "--out", tmp_path / "other") == 0
    assert '\nhumidity = "state"' in (tmp_path / "other" / "log.toml").read_text()
    assert run(log, "--look", "--sensor", "sensor.attic", "--out", tmp_path / "third") == 2


def test_a_value_is_what_a_name_in_its_row_says(tmp_path):
    lines = [f"{t:.2f},Temperature {k},{a + k:.2f}" for t, a, _ in rows_of_log() for k in (1, 2)]
    log = written(tmp_path / "log.csv", text(["time_s,name,value", *lines]))
    look = look_at([log], tmp_path / "log.toml")
    assert 'only = { "name" = "Temperature 1" }' in look.text and '\ntemperature = "value"' in look.text
    assert len(look.steps[0]) == 3 and look.whose == ("Temperature 1", "Temperature 2")


def test_rows_may_be_told_apart_by_two_columns(tmp_path, capsys):
    """As InfluxDB exports tables: of which sensor a row is, and of what. Neither tells it by itself, so all of them
    were one sensor's, its clock beginning anew with each table."""
    stamps = date("%Y-%m-%dT%H:%M:%S.%fZ")
    tables = [(what, where) for where in ("hall", "attic") for what in ("co2", "temp", "rh")]
    of = {"co2": lambda a, b: 400.0 + a, "temp": lambda a, b: a, "rh": lambda a, b: b}
    body = [
        f",,{k},2026-05-01T00:00:00Z,{stamps(t)},{of[what](a, b) + k:.2f},{what},{where}"
        for k, (what, where) in enumerate(tables)
        for t, a, b in rows_of_log()
    ]
    head = ["#default,last,,,,,,", ",result,table,_start,_time,_value,_field,place"]
    log = written(tmp_path / "influx.csv", text([*head, *body]))
    assert run(log, "--look", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert "the rows of place hall alone" in said and "[log] only in the map: rh, co2\n" in said
    assert 'only = { "_field" = "temp", "place" = "hall" }' in (tmp_path / "influx.toml").read_text()
    assert run(log, "--map", tmp_path / "influx.toml", "--out", tmp_path / "c") == 0
    for one in read_campaign(tmp_path / "c").runs:
        in_full(one.imet.time_s, one.imet.values["temperature_c"], LOG.time_s, np.round(LOG.temperature_c + 1.0, 2))
    assert run(log, "--look", "--sensor", "rh", "--out", tmp_path / "rh") == 0
    assert '\nhumidity = "_value"' in (tmp_path / "rh" / "influx.toml").read_text()
    bare = '[log]\ntime = "_time"\nonly = { "place" = "hall" }\n[sensor.hall]\ntemperature = "_value"\n'
    assert run(log, "--map", written(tmp_path / "bare.toml", bare), "--out", tmp_path / "d") == 2
    assert "its rows are of 3 sensors, told apart by the column '_field'" in capsys.readouterr().err


@pytest.mark.parametrize(("names", "sensors"), [("t1,h1,t12,h12", ["t1", "t12"]), ("T 1,H 1,T 2,H 2", ["T-1", "T-2"])])
def test_a_humidity_is_called_as_its_temperature_is(tmp_path, names, sensors):
    """Of h1 beside t1 it had been said that by its name it is nothing."""
    lines = lines_of(f"time,{names}", lambda t, a, b, n: f"{t},{a},{b},{a + 1},{b + 1}")
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert list(look.map.sensors) == sensors
    assert all({"temperature", "humidity"} <= set(one.columns) for one in look.map.sensors.values())
    lines = lines_of("time,h1,h2,temp", lambda t, a, b, n: f"{t},{a},{b},{a}")
    look = look_at([written(tmp_path / "other.csv", text(lines))], tmp_path / "other.toml")
    assert list(look.map.sensors) == ["temp"], "a heater's duty, for all that is known"


def test_a_column_of_units_says_what_the_one_before_it_holds(tmp_path):
    """As PreSens exports an optode: its oxygen had been a humidity, since the mode is humid, and its pressure in degC,
    as the temperature before it."""
    names = "time,Value,O2_Unit,Mode,Temp,Temp_Unit,Pressure,Pressure_Unit,T0,T0_Unit"
    lines = lines_of(names, lambda t, a, b, n: f"{t},{b},ppm (mg/L),Humid,{a},°C,{1000 + n % 2},hPa,{a + 1},°C")
    look = look_at([written(tmp_path / "log.csv", text(lines))], tmp_path / "log.toml")
    assert set(look.map.sensors) == {"Temp", "T0"}
    assert look.map.sensors["Temp"].columns["pressure"] == ("Pressure", "hPa")
    lines = lines_of("time,temp,unit,rh,unit", lambda t, a, b, n: f"{t},{1.8 * a + 32},F,{b},%")
    (sensor,) = look_at([written(tmp_path / "two.csv", text(lines))], tmp_path / "two.toml").map.sensors.values()
    assert (sensor.columns["temperature"], sensor.columns["humidity"]) == (("temp", "degF"), ("rh", "percent"))
    lines = lines_of("time,unit,temp,unit,rh", lambda t, a, b, n: f"{t},F,{1.8 * a + 32},%,{b}")
    (sensor,) = look_at([written(tmp_path / "left.csv", text(lines))], tmp_path / "left.toml").map.sensors.values()
    assert (sensor.columns["temperature"], sensor.columns["humidity"]) == (("temp", "degF"), ("rh", "percent"))


def test_a_word_behind_a_number_may_begin_the_next_name(tmp_path):
    """Of "19 Soil Humidity: 122" Soil had been a unit, and 122 a humidity."""
    rows = [
        f"{t} - Temp: {a:.2f} C Humidity: {b:.1f} Soil Humidity: 122 Light: 30 lux Out Temp: {a:.1f} Celsius"
        for t, a, b in rows_of_log()
    ]
    log = written(tmp_path / "log.txt", text(rows))
    assert scan(log, Layout()).behind == ("Temp (C)", "Humidity", "Soil Humidity", "Light", "Out Temp (Celsius)")


def test_names_may_be_shortened_by_a_point_and_stamps_count_without_zeros(tmp_path):
    """As boards print them: "Temp. 23.41 - humid. 61.43 %" and "RTC time: 0:0:5" had been no readings, or no times."""
    stamps = date("%d/%m/%Y - %H:%M:%S")
    rows = [f"{stamps(2.0 * t)} - Lat. 0.00 - Temp. {a:.2f} - humid. {b:.2f} %  - Co2 400" for t, a, b in rows_of_log()]
    rows[0] = "00/00/2000" + rows[0][10:]  # the clock was not set yet
    look = look_at([written(tmp_path / "air.txt", text(["- DataLog -", *rows]))], tmp_path / "air.toml")
    assert set(look.map.sensors["sensor"].columns) >= {"temperature", "humidity"} and len(look.steps[0]) == 3
    rows = [f" temperature: {a:.1f}^C  pH:3.07 RTC time: 0:{int(t) // 60}:{int(t) % 60}" for t, a, _ in rows_of_log()]
    look = look_at([written(tmp_path / "ph.txt", text(rows))], tmp_path / "ph.toml")
    assert look.map.time == ("time",) and look.logs[0].log.time_s[-1] == pytest.approx(LOG.time_s[-1], abs=1.0)


def test_minutes_and_seconds_are_no_time_of_day(tmp_path):
    """A roaster's 00:01 beside its first second had been a minute: every response was sixty times as slow."""
    elapsed = [f"{int(2 * t) // 60:02d}:{int(2 * t) % 60:02d}" for t in LOG.time_s]
    rows = [f"{2 * t:.0f},{stamp_},{a}" for stamp_, (t, a, _) in zip(elapsed, rows_of_log(), strict=True)]
    look = look_at([written(tmp_path / "both.csv", text(["seconds,time,temp", *rows]))], tmp_path / "both.toml")
    assert look.map.time == ("seconds",) and look.logs[0].log.period_s == pytest.approx(1.0, rel=1e-4)
    rows = [row.partition(",")[2] for row in rows]
    look = look_at([written(tmp_path / "one.csv", text(["time,temp", *rows]))], tmp_path / "one.toml")
    assert any('if they are minutes and seconds, say time_format = "%M:%S"' in note for note in look.notes)
    map_ = parse_map('[log]\ntime = "time"\ntime_format = "%M:%S"\n[sensor.a]\ntemperature = "temp"\n', tmp_path / "m")
    assert read_sensors(tmp_path / "one.csv", map_).log.period_s == pytest.approx(1.0, rel=1e-4)


def test_settings_that_name_a_temperature_are_no_log(tmp_path, capsys):
    """One record is none: a run.json had been taken for a log without times."""
    content = json.dumps({"name": "run 3", "temperature": 21.5, "humidity": 40, "duration_s": 600}, indent=1)
    assert run(written(tmp_path / "run.json", content), "--look", "--out", tmp_path) == 2
    assert "no column of times" not in capsys.readouterr().err


def test_a_row_that_fills_more_of_the_names_than_the_others_is_one(tmp_path):
    """A Kestrel's first row says also where and when its session was: it stood for metadata, and was lost."""
    rows = [f"{t};{c:.2f};session" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    rows[0] += ";Session 1;here"
    rows[50] += ";Session 2"
    names = "time;temp;kind;record;place"
    scanned = scan(written(tmp_path / "log.csv", text(["Model;5500L", names, "s;°C", *rows])), Layout())
    assert len(scanned.rows) == len(rows) - 1 and scanned.names == ("time", "temp", "kind")
    assert scanned.cells(scanned.rows[:2]) == [row.split(";")[:3] for row in rows[:2]]
    assert scanned.odd == {"of another number of cells": (1, 54)} and "Model;5500L" in scanned.metadata


def test_runs_side_by_side_with_times_of_their_own_are_pointed_out(tmp_path):
    rows = [f"{t},{c},{1.01 * t:.3f},{c}" for t, c in zip(LOG.time_s, LOG.temperature_c, strict=True)]
    log = written(tmp_path / "log.csv", text(["Time (s),Temp (°C),Time (s),Temp (°C)", *rows]))
    said = look_at([log], tmp_path / "log.toml").text
    assert "# not used, other times than Time (s), by which all readings are timed; state it as time" in said


def test_stamps_of_a_sensor_that_is_read_before_the_row_is_written_are_pointed_out(tmp_path):
    """Each of its own, as the row's time is the last one's; a count of what the loop took is none."""
    readings = zip(LOG.time_s + 1.6e9, LOG.temperature_c, strict=True)
    rows = [f"{t:.6f},{c},{t - 0.4:.6f},{c},{t - 1e-5:.6f},0.39{n % 7}" for n, (t, c) in enumerate(readings)]
    log = written(tmp_path / "log.csv", text(["time,t0,time_t0,t1,time_t1,elapsed", *rows]))
    said = look_at([log], tmp_path / "log.toml").text
    assert (
        "# not used, other times than time, by which all readings are timed; state it as time for its own: time_t0"
        in said
    )
    assert "airflow: time_t1, elapsed\n" in said


def test_held_readings_are_thinned(tmp_path, capsys):
    """A log of 8 Hz of a sensor that is read every half second: the repeats go, what is left is what was read."""
    rows = zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, strict=True)
    body = [f"{t + k / 8:.3f},{a},{b}" for t, a, b in rows for k in range(4)]
    log = written(tmp_path / "log.csv", text(["time_s,temperature_c,humidity_percent", *body]))
    assert run(log, "--map", written(tmp_path / "m.toml", MAP), "--out", tmp_path / "c") == 0
    assert "each reading stands in about 4 rows" in capsys.readouterr().out
    for one in read_campaign(tmp_path / "c").runs:
        in_full(one.imet.time_s, one.imet.values["temperature_c"], LOG.time_s, LOG.temperature_c)


def test_held_readings_are_thinned_where_many_are_as_the_one_before(tmp_path, capsys):
    """A fast logger of a converter of a quarter kelvin: between changes lies one reading, or two, or three."""
    rows = zip(LOG.time_s, np.round(4.0 * LOG.temperature_c + 0.4 * np.sin(5.0 * LOG.time_s)) / 4.0, strict=True)
    body = [f"{t + k / 10:.3f},{a}" for t, a in rows for k in range(5)]
    log = written(tmp_path / "log.csv", text(["time_s,temperature_c", *body]))
    assert run(log, "--look", "--out", tmp_path) == 0
    assert "each reading stands in about 5 rows" in capsys.readouterr().out


def one_sensor_a_row(stamps, other="B", name="sensor_id"):
    """As databases export several sensors: a row each, the second one 3 K warmer and much slower."""
    slow = np.interp(LOG.time_s - 20.0, LOG.time_s, LOG.temperature_c) + 3.0
    first, second = stamps
    rows = zip(LOG.time_s, LOG.temperature_c, slow, strict=True)
    body = [row for t, a, b in rows for row in (f"{first(t)},A,{a:.2f}", f"{second(t)},{other},{b:.2f}")]
    return text([f"time,{name},temperature_c", *body])


stamp = date("%Y-%m-%d %H:%M:%S.%f")


def in_blocks():
    """The rows of each sensor in three blocks, of which somebody put the last two in the wrong order."""
    head, *rows = one_sensor_a_row((stamp, stamp)).splitlines()
    mine, others = rows[::2], rows[1::2]
    blocks = [mine[:200], others[:200], mine[400:], others[400:], mine[200:400], others[200:400]]
    return text([head, *(row for block in blocks for row in block)])


@pytest.mark.parametrize(
    "log",
    [
        one_sensor_a_row((stamp, stamp)),
        one_sensor_a_row((lambda t: f"{t:.2f}", lambda t: f"{t:.2f}")),
        one_sensor_a_row((stamp, lambda t: stamp(t + 0.21))),
        one_sensor_a_row((stamp, stamp), name="where"),
        text(sorted(one_sensor_a_row((stamp, stamp)).splitlines(), key=lambda row: (row[0] != "t", row.split(",")[1]))),
        in_blocks(),
    ],
    ids=["same stamps", "same counts", "in turn", "an unknown name", "one after the other", "in disordered blocks"],
)
def test_rows_of_several_sensors_are_told_apart(tmp_path, capsys, log):
    """Taken for one sensor's they are spread over their stamps, and their steps are as fast as neither's."""
    path = written(tmp_path / "log.csv", log)
    assert run(path, "--look", "--out", tmp_path) == 0
    assert (
        "680 lines of another" in (said := capsys.readouterr().out) and "others, for [log] only in the map: B" in said
    )
    assert 'only = { "' in (text_ := (tmp_path / "log.toml").read_text())
    assert run(path, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 0
    for one in read_campaign(tmp_path / "c").runs:
        in_full(one.imet.time_s, one.imet.values["temperature_c"], LOG.time_s, LOG.temperature_c)
    bare = "".join(line for line in text_.splitlines(keepends=True) if not line.startswith("only"))
    assert run(path, "--map", written(tmp_path / "bare.toml", bare), "--out", tmp_path / "d") == 2
    assert "its rows are of 2 sensors" in capsys.readouterr().err
    with pytest.raises(shockrig.InputError, match="has the sensors 'A', 'B'; name one by sensor="):
        shockrig.import_log(path)
    second = shockrig.import_log(path, sensor="B")
    assert min(one.imet.values["temperature_c"].min() for one in second.runs) > 24.0


def test_what_changes_from_row_to_row_and_is_no_sensor(tmp_path):
    """A resistance that the temperature is made of, a controller's output, a relay, and a count within the second."""
    rows = enumerate(zip(LOG.time_s, LOG.temperature_c, strict=True))
    body = [
        f"{stamp(t)[:19]},{round(40 * a)},{'on' if n % 7 < 3 else 'off'},{n % 2},{round(40 * a) / 40}"
        for n, (t, a) in rows
    ]
    log = written(tmp_path / "log.csv", text(["time,ohm,relay,within,temperature_c", *body]))
    assert not look_at([log], tmp_path / "log.toml").whose
    read_c = np.round(4.0 * (LOG.temperature_c + np.random.default_rng(1).normal(0.0, 0.3, LOG.time_s.size))) / 4.0
    body = [f"{t},{round(2.0 * (93.0 - a) + 0.01 * t)},{a}" for t, a in zip(LOG.time_s, read_c, strict=True)]
    log = written(tmp_path / "control.csv", text(["time_s,output,temperature_c", *body]))
    assert not look_at([log], tmp_path / "control.toml").whose


def test_a_logger_button_exports_dates_of_twelve_hours_and_a_column_of_units(tmp_path):
    """Blanks part its rows, too, into a date, a time of day and a rest that is no number."""
    head = [
        "1-Wire/iButton Part Number: DS1921G-F5",
        "Mission Start:  Wed Aug 14 02:01:00 UTC 2013",
        "Total Samples:  437",
    ]
    lines = lines_of("Date/Time,Unit,Value", lambda t, a, b, n: f"{halves(t)},C,{a:.2f}")
    look = look_at([written(tmp_path / "log.csv", text([*head, "", *lines]))], tmp_path / "log.toml")
    (sensor,) = look.map.sensors.values()
    assert dict(sensor.columns) == {"temperature": ("Value", "degC")} and len(look.steps[0]) == 3
    assert not any("not used" in said for said in look.notes)


def test_what_is_taken_for_granted_of_the_time_is_said(tmp_path, capsys):
    """A time in ms that does not say so makes every response a thousand times as slow; a date, another day."""
    counts = written(tmp_path / "count.csv", text(plain("time,temperature_c", lambda t: f"{1000 * t:.0f}")))
    dates = written(tmp_path / "date.csv", text(plain("time,temp", date("%d/%m/%Y %H:%M:%S.%f"))))
    for log, said in ((counts, 'if they are ms, say time_unit = "ms"'), (dates, "nothing in the log tells")):
        assert run(log, "--look", "--out", tmp_path) == 0
        assert said in capsys.readouterr().out
        assert any(said in note for note in shockrig.import_log(log).notes)


@pytest.mark.parametrize("stamp", ["%a %b %d %H:%M:%S %Y", "%a %b %d %H:%M:%S EDT %Y", "%a %d %b %H:%M:%S BST %Y"])
def test_dates_as_a_shell_writes_them_are_times(tmp_path, stamp):
    """`Mon Sep 28 16:18:02 EDT 2020`, of Unix's date and C's ctime: no column of times was seen."""
    begins = datetime(2020, 9, 28, 23, 50, tzinfo=UTC)
    rows = [
        f"{38.9 + 5 * (k > 40) + 0.01 * (k % 3):.3f}C,{(begins + timedelta(seconds=30 * k)).strftime(stamp)}"
        for k in range(100)
    ]
    look = look_at([written(tmp_path / "log.csv", text(rows))], tmp_path / "log.toml")
    log = look.logs[0].log
    assert log.period_s == 30.0 and log.time_s[-1] - log.time_s[0] == 99 * 30.0
    assert look.steps[0][0].step.at_s == pytest.approx(40.5 * 30.0, abs=30.0)


def test_seconds_of_a_long_log_are_no_milliseconds(tmp_path):
    """Of 30,000 rows, five a second, "of which 30 pass between readings": between those picked from all of it."""
    rows = [f"{k // 5},{20 + 10 * (k > 15_000) + 0.01 * (k % 7):.2f}" for k in range(30_000)]
    look = look_at([written(tmp_path / "log.csv", text(["time,temp", *rows]))], tmp_path / "log.toml")
    assert look.logs[0].log.period_s == pytest.approx(0.2, rel=0.01)
    assert not any("if they are ms" in said for said in look.notes)


def intermet(tmp_path):
    """InterMet's application: two ports, one without a sensor, zeros until the first reading, stamps that repeat."""
    names = (
        "Time,COM Elapse,8-IST HYT 271 Humidity,8-IST HYT 271 Temperature,9-IST HYT 271 Humidity,"
        "9-IST HYT 271 Temperature,XQ-iMet-XQ Pressure,XQ-iMet-XQ Air Temperature,XQ-iMet-XQ Humidity,"
        "XQ-iMet-XQ Humidity Temp,XQ-iMet-XQ Date"
    )
    body = []
    for n, (t, a, b) in enumerate(zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, strict=True)):
        moment = datetime(2023, 3, 9, 10, 12, 33, 516000) + timedelta(seconds=float(t))
        stamp = moment.strftime("%Y/%m/%d %H:%M:%S.%f")[:-2]
        read = (
            f"{b:.2f},{a + 1:.2f},0.00,0.00,1002.50,{a:.2f},{b + 2:.2f},{a + 2:.2f}"
            if n > 20
            else ",".join(["0.00"] * 8)
        )
        body += [f"{stamp},{n * 500},{read},2023/03/09"] * (1 + (n % 10 == 3))
    return written(tmp_path / "imet.csv", text([names, *body], "\r\n"))


def test_the_csv_file_of_intermets_application_is_known(tmp_path, capsys):
    log = intermet(tmp_path)
    assert run(log, "--look", "--out", tmp_path) == 0
    content = (tmp_path / "imet.toml").read_text()
    assert "known as a CSV file of InterMet's application" in content and "9-IST-HYT" not in content
    map_ = parse_map(content, tmp_path / "imet.toml")
    assert set(map_.sensors) == {"8-IST-HYT-271", "XQ-iMet-XQ"}
    assert dict(map_.sensors["8-IST-HYT-271"].columns) == {
        "humidity": ("8-IST HYT 271 Humidity", "percent"),
        "die_temperature": ("8-IST HYT 271 Temperature", "degC"),
    }
    assert run(log, "--map", tmp_path / "imet.toml", "--out", tmp_path / "c") == 0
    said = capsys.readouterr().out
    assert (
        "68 rows repeat a stamp and its readings" in said
        and "21 rows in which XQ-iMet-XQ reads nothing but zeros" in said
    )
    pair = read_campaign(tmp_path / "c/XQ-iMet-XQ")
    assert [one.pressure_hpa for one in pair.runs] == [1002.5] * 3 and pair.sensors["imet"]["kind"] == "imet-xq"
    in_full(pair.runs[0].hyt.time_s, pair.runs[0].hyt.values["temperature_c"], LOG.time_s, LOG.temperature_c + 2)
    # The map that ships knows it as well, and finds the steps by itself.
    assert run(log, "--map", "intermet", "--out", tmp_path / "d") == 0
    assert len(read_campaign(tmp_path / "d").runs) == 3


def test_a_sensor_whose_body_nobody_states_is_a_single_lag(tmp_path):
    log, map_ = plain_log(tmp_path, 'thermometer = { kind = "sht35" }\nhygrometer = { kind = "hyt-271" }\n')
    assert run(log, "--map", map_, "--out", tmp_path / "c") == 0
    assert read_campaign(tmp_path / "c").bodies == {"imet": "lumped", "hyt": "film"}


def test_a_long_log_is_read_in_little_room(tmp_path):
    """Eighty bytes a row beside its text, from its bytes to its steps (a million rows: 80 MB), where lines and cells as
    texts of their own took seven hundred."""
    random = np.random.default_rng(1)
    rows = 60_000
    time_s = 0.5 * np.arange(rows)
    value = 20.0 + 10.0 * ((time_s // 5000.0) % 2) + random.normal(0.0, 0.03, rows)
    log = written(
        tmp_path / "long.csv",
        "time_s,temp,rh\n"
        + "".join(f"{t:.1f},{v:.2f},40.{k % 7}\n" for k, (t, v) in enumerate(zip(time_s, value, strict=True))),
    )
    look_at([log], tmp_path / "warm.toml")  # imports and caches are not the log's
    tracemalloc.start()
    try:
        seen = look_at([log], tmp_path / "m.toml")
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(seen.steps[0]) == 5
    assert most < 80 * rows + log.stat().st_size + 4_000_000  # and a block of rows as text


@pytest.mark.parametrize(
    ("text", "format_"),
    [
        ("a remark", None),
        ("2026/05/03 12:30:05", "%Y/%m/%d %H:%M:%S"),
        ("3-May-2026 1:30 pm", "%d-%b-%Y %I:%M %p"),
        ("2026_5_3_9_30_5", "%Y_%m_%d_%H_%M_%S"),
        ("Sun May  3 09:30:05 CEST 2026", "%a %b %d %H:%M:%S CEST %Y"),
        ("Sun, 03 May 2026 09:30:05 GMT", "%a, %d %b %Y %H:%M:%S GMT"),
    ],
)
def test_a_text_is_tried_in_formats_of_its_own_marks_only(monkeypatch, text, format_):
    """Of 1088, each of which strptime compiles anew."""
    asked, really = set(), clock_columns._moment
    monkeypatch.setattr(clock_columns, "_moment", lambda text, format_: asked.add(format_) or really(text, format_))
    assert clock_columns.guess_format([text] * 3)[0] == format_
    assert len(asked) < 60


def test_a_map_says_why_a_step_is_not_used_and_import_says_the_same(tmp_path, capsys):
    time_s = np.arange(0.0, 900.0, 1.0)
    value = 20.0 + 10.0 * (1.0 - np.exp(-np.maximum(time_s - 100.0, 0.0) / 5.0))
    for begins_s in (500.0, 512.0, 524.0):
        value += 3.0 * np.clip((time_s - begins_s) / 4.0, 0.0, 1.0)
    value += np.random.default_rng(1).normal(0.0, 0.01, time_s.size)
    rows = [f"{t:.1f},{v:.2f}" for t, v in zip(time_s, value, strict=True)]
    log = written(tmp_path / "log.csv", "\n".join(["time_s,temp", *rows, ""]))
    assert run(log, "--look", "--out", tmp_path) == 0
    (seen,) = re.findall(r"not used: (came in 3 stages .*)", capsys.readouterr().out)
    assert re.search("use = false +# true beside a reference", (tmp_path / "log.toml").read_text())
    assert run(log, "--map", tmp_path / "log.toml", "--out", tmp_path / "c") == 0
    said = capsys.readouterr().out
    assert f"not used: {seen}\n" in said and f"step 2: the map says use = false: {seen}\n" in said


def test_what_comes_back_later_is_no_part_of_a_step_that_a_map_states(tmp_path):
    """A step of 4 K, and a slow swell of 6 K behind it, which is none: its level is where it was before the swell."""
    time_s = np.arange(0.0, 4600.0, 5.0)
    value = 10.0 + 4.0 * (1.0 - np.exp(-np.maximum(time_s - 1000.0, 0.0) / 10.0))
    value += 6.0 * np.sin(np.pi * np.clip((time_s - 2000.0) / 3000.0, 0.0, 1.0)) ** 2
    value += np.random.default_rng(3).normal(0.0, 0.03, time_s.size)
    rows = [f"{t:.1f},{v:.2f}" for t, v in zip(time_s, value, strict=True)]
    log = written(tmp_path / "log.csv", "\n".join(["time_s,temp", *rows, ""]))
    look = look_at([log], tmp_path / "log.toml")
    for steps in (*look.steps, steps_of(look.logs[0], look.map)):
        assert len(steps) == 1 and steps[0].step.moves[0].after == pytest.approx(14.0, abs=0.1)


def test_days_that_may_be_seconds_are_pointed_out(tmp_path):
    """Rows every 72 min in a spreadsheet's days are 20 a second as well: seconds, and a word on it."""
    log = written(tmp_path / "log.csv", text(plain("time,temp,rh", time=lambda t: f"{46143.5 + t / 10.0:.3f}")))
    look = look_at([log], tmp_path / "log.toml")
    assert look.logs[0].log.period_s == pytest.approx(0.05)
    assert any('if they are a spreadsheet\'s days, say time_unit = "days"' in said for said in look.notes)


def test_a_file_of_one_line_is_told_at_once(tmp_path, capsys):
    """Names were sought in all 20 MB of a JSON file: that took minutes."""
    content = json.dumps([{"time": k, "temperature": 20.0, "note": "all in one line"} for k in range(60_000)])
    began = time.monotonic()
    assert run(written(tmp_path / "log.json", content), "--look", "--out", tmp_path) == 2
    assert time.monotonic() - began < 5.0 and "Export it as CSV" in capsys.readouterr().err
