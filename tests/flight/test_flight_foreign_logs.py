"""Flights as other makers' loggers write them: clocks, names, lines of metadata and units, slow rows, plumes."""

import csv
from pathlib import Path

import numpy as np
import pandas
import pytest
from scipy.signal import lfilter

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.screen import screen
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight, read_layout
from shockrig.files.flight_rows import to_flight
from shockrig.files.profile import read_profile, write_profile
from shockrig.files.ranges import RANGES
from shockrig.protocols.cli import main
from shockrig.protocols.flight_logs import to_csv

PROFILE = typical_profile()
PLACE = "latitude,longitude,altitude"


def rms(error):
    return float(np.sqrt(np.nanmean(np.square(error))))


def read(tmp_path, header, rows):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    layout = read_layout(path)
    return to_flight(list(csv.reader(path.read_text().splitlines()))[1:], layout)


def run(tmp_path, capsys, text, *arguments, profile=PROFILE):
    write_profile(profile, tmp_path / "profile.json")
    (tmp_path / "log.csv").write_text(text)
    command = ["correct", str(tmp_path / "log.csv"), "--profile", str(tmp_path / "profile.json")]
    status = main([*command, "--out", str(tmp_path / "out.csv"), *arguments])
    return status, capsys.readouterr().err


def test_hours_minutes_and_seconds_in_one_number_are_no_seconds(tmp_path):
    clock = [f"{10 + s // 3600}{s // 60 % 60:02d}{s % 60:02d}" for s in range(3570, 3640, 3)]
    flight = read(tmp_path, "Time,Temperature", [f"{stamp},{20 + 0.01 * i:.2f}" for i, stamp in enumerate(clock)])
    np.testing.assert_allclose(np.diff(flight.time_s), 3.0)
    assert flight.time_s[0] == 10 * 3600 + 3570


@pytest.mark.parametrize("seconds", [range(0, 50), range(140, 320), range(0, 6000, 100), range(0, 6000, 47)])
def test_seconds_stay_seconds(tmp_path, seconds):
    flight = read(tmp_path, "Time,Temperature", [f"{s},{20 + 0.01 * s:.2f}" for s in seconds])
    np.testing.assert_allclose(flight.time_s, list(seconds))


def test_a_time_of_day_has_no_date_and_no_wmo_file(tmp_path, capsys):
    rows = [f"11:{s // 60:02d}:{s % 60:02d},{20 + 0.01 * s:.2f},45,48.1,11.5,{500 + s}" for s in range(200)]
    flight = read(tmp_path, f"time,temperature,humidity,{PLACE}", rows)
    assert flight.time_s[0] == 11 * 3600
    text = "\n".join([f"time,temperature,humidity,{PLACE}", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text, "--wmo", "007:ABC12")
    assert status == 2 and "no date" in said


def test_degrees_and_minutes_are_no_wmo_position(tmp_path, capsys):
    rows = [f"2026-05-01 11:00:{s:02d},{20 + 0.01 * s:.2f},45,4032.06,-8854.8,{500 + s}" for s in range(60)]
    text = "\n".join([f"time,temperature,humidity,{PLACE}", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text, "--wmo", "007:ABC12")
    assert status == 2 and "decimal degrees" in said


def test_a_clock_that_was_set_by_millennia_has_its_page(tmp_path, capsys):
    rows = [f"{s + 1e11 * (s > 300)},{20 + 0.1 * np.sin(s / 9):.2f}" for s in range(600)]
    status, _ = run(tmp_path, capsys, "\n".join(["time_s,temperature_c", *rows]) + "\n")
    assert status == 0 and (tmp_path / "out.html").is_file()


@pytest.mark.parametrize("name", ["Scan Count", "SCANS", "RecNum", "Sample #", "No.", "index"])
def test_a_count_of_rows_is_no_clock(tmp_path, capsys, name):
    rows = [f"{1.3 + 0.1 * s:.1f},{15 + 0.1 * np.sin(s / 9):.2f},{s}" for s in range(60)]
    text = "\n".join([f"pressure,temperature,{name}", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    assert status == 2 and f"a count of rows is no clock: {name}" in said and "every_s" in said
    status, _ = run(tmp_path, capsys, text, "--column", f"time={name}")
    assert status == 0


def test_a_pressure_that_rises_is_no_clock(tmp_path, capsys):
    rows = [f"{1.3 + 0.1 * s:.1f},{15 + 0.1 * np.sin(s / 9):.2f}" for s in range(60)]
    status, said = run(tmp_path, capsys, "\n".join(["PRES,TEMP", *rows]) + "\n")
    assert status == 2 and "every_s" in said


SEA_BIRD = [
    "* Sea-Bird SBE 9 Data File:",
    "# nquan = 4",
    "# name 0 = scan: Scan Count",
    "# name 1 = timeS: Time, Elapsed [seconds]",
    "# name 2 = prDM: Pressure, Digiquartz [db]",
    "# name 3 = t090C: Temperature [ITS-90, deg C]",
    "# span 3 = 4.0, 5.0",
    "*END*",
]
MK21 = [
    "// MK21 EXPORT DATA FILE  (EDF)",
    "Depth Coeff. 1   :  0.0",
    "Field1            :  Time (sec)",
    "Field2            :  Resistance (ohms)",
    "Field3            :  Depth (m)",
    "Field4            :  Temperature (°C)",
    "// Data",
]
KESTREL = [
    '"Device Name","WEATHER"',
    '"FORMATTED DATE_TIME","Temperature","Wind Chill","Wind Speed","Data Type","Notes","More"',
    '"YYYY-MM-DD HH:MM:SS","°C","°C","km/h"',
]


@pytest.mark.parametrize(
    ("head", "row", "time", "temperature"),
    [
        (SEA_BIRD, "{n:6d} {n:8.1f} {n:8.3f} {c:9.4f}", "Time, Elapsed [seconds]", "Temperature [ITS-90, deg C]"),
        (MK21, "{n:.1f}\t5410.8\t{n:.2f}\t{c:.4f}", "Time (sec)", "Temperature (°C)"),
        (
            KESTREL,
            '"2023-06-14 {hour:02d}:{minute:02d}:00 {half}. m.","{comma}","20,5","3,6","session"',
            "FORMATTED DATE_TIME",
            "Temperature",
        ),
    ],
    ids=["Sea-Bird", "MK21", "Kestrel"],
)
def test_names_that_are_listed_and_halves_of_the_day_are_read(tmp_path, capsys, head, row, time, temperature):
    rows = []
    for n in range(90):
        hour, c = 11 + n // 60, f"{4 + 0.1 * np.sin(n / 9):.4f}"
        half = "a" if hour < 12 else "p"
        rows.append(row.format(n=n, c=float(c), comma=c.replace(".", ","), hour=hour, minute=n % 60, half=half))
    status, said = run(tmp_path, capsys, "\n".join([*head, *rows]) + "\n")
    assert status == 0 and f"time {time!r}, temperature {temperature!r}" in said
    with (tmp_path / "out.csv").open() as stream:
        written = list(csv.DictReader(stream))
    times = [float(one["time_s"]) for one in written]
    np.testing.assert_allclose(np.diff(times), 60.0 if head is KESTREL else 1.0)
    assert float(written[9]["temperature_c"]) == pytest.approx(4 + 0.1 * np.sin(1.0), abs=1e-4)
    if head is KESTREL:
        assert float(written[9]["airspeed_m_s"]) == pytest.approx(1.0)


def test_an_altitude_under_names_parted_otherwise_is_no_clock(tmp_path, capsys):
    rows = [f"{s // 60}\t{s % 60}\t{20 - 0.1 * s:.2f}\t{2.5 * s:.1f}\t{2.4 * s:.1f}" for s in range(200)]
    status, said = run(tmp_path, capsys, "\n".join(["min sec T[C]     Altitude[m] GeoPot[m']", *rows]) + "\n")
    assert status == 2 and "it has: min, sec, T[C], Altitude[m], GeoPot[m']" in said and "to be added" in said


@pytest.mark.parametrize("deepest", [100.0, 1900.0])
def test_a_pressure_of_water_tells_no_altitude(deepest):
    time_s = np.arange(3000.0)
    depth = 1.0 + deepest * (1.0 - np.abs(time_s / 1500.0 - 1.0))
    unknown = np.full(3000, np.nan)
    flight = Flight(time_s, 15.0 - 0.01 * depth + 0.2 * np.sin(time_s / 300.0), unknown, unknown, unknown, depth)
    said = " ".join(correct(flight, PROFILE).notes)
    assert "taken as unknown, for the altitude too" in said and "ascent and descent" not in said


@pytest.mark.parametrize(
    ("header", "places"),
    [("DateTime,T,RH", (0, 1)), ("DateTime,t,rh", (0, 1)), ("t,T,RH", (0, 1)), ("T,t,RH", (1, 0))],
)
def test_t_is_the_temperature_where_another_column_is_the_time(tmp_path, header, places):
    path = tmp_path / "log.csv"
    path.write_text(header + "\n")
    place = read_layout(path).place
    assert (place["time"], place["temperature"]) == places


def test_a_lone_capital_t_is_no_time(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("T,RH\n")
    with pytest.raises(InputError, match="no column of time"):
        read_layout(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Serial,5,\nFirmware,1.2,\nTime,Temperature,Humidity\n1,20,45\n", "line 3"),
        ("2026:05:01_11:00:00,20.1,45.2\n2026:05:01_11:00:02,20.2,45.3\n", "no line of names"),
    ],
)
def test_what_is_wrong_with_a_log_is_said_with_its_remedy(tmp_path, capsys, text, said):
    status, error = run(tmp_path, capsys, text)
    assert status == 2 and said in error and len(error.splitlines()) == 1


def test_a_log_whose_newest_row_comes_first_is_read(tmp_path, capsys):
    rows = "".join(f"{100 - s},{20 + 0.1 * np.sin(s / 9):.2f}\n" for s in range(50))
    status, said = run(tmp_path, capsys, "time_s,temperature_c\n" + rows)
    assert status == 0 and "the rows run backwards in time" in said
    assert list(pandas.read_csv(tmp_path / "out.csv").time_s[:2]) == [100.0, 99.0]


def test_a_channel_that_is_not_recognised_is_said_to_be(tmp_path, capsys):
    rows = [f"{s},{45 + 0.1 * np.sin(s / 9):.2f},{20 + 0.1 * np.sin(s / 9):.2f}" for s in range(60)]
    status, said = run(tmp_path, capsys, "\n".join(["time,humidity,board temperature", *rows]) + "\n")
    assert status == 0 and "if there is one ('board temperature'?), --column temperature=NAME" in said


@pytest.mark.parametrize(
    ("names", "taken", "others"),
    [
        ("temp,ext_temp", "ext_temp", ["temp"]),
        ("temperature,Ambient Temperature (C),board_temp", "Ambient Temperature (C)", ["temperature", "board_temp"]),
        ("Temp,SHT_Temp,BME_Temp", "Temp", ["SHT_Temp", "BME_Temp"]),
        ("TEMPbox,TEMP1,cpu_temp", "TEMP1", ["TEMPbox", "cpu_temp"]),
        ("temp,text", "temp", []),
    ],
)
@pytest.mark.parametrize("separator", [",", ";"])
def test_of_several_temperatures_the_airs_is_taken_and_the_others_are_named(
    tmp_path, capsys, names, taken, others, separator
):
    count = names.count(",") + 1
    rows = [",".join([f"{s}", *(f"{20 + k + 0.1 * np.sin(s / 9):.2f}" for k in range(count))]) for s in range(60)]
    text = "\n".join([f"time,{names}", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text.replace(",", separator))
    named = f"temperature {taken!r} is taken, and not {', '.join(map(repr, others))}"
    assert status == 0 and (named in said if others else "is taken" not in said)
    if separator == ",":
        status, said = run(tmp_path, capsys, text, "--column", f"temperature={taken}")
        assert status == 0 and "is taken, and not" not in said


def test_a_humidity_is_taken_with_the_temperature_of_its_own_name(tmp_path, capsys):
    """A thermometer in an inlet was corrected with the hygrometer of another box: 'RHsamp' was none by its name."""
    rows = [f"{s},NA,{20 + 0.1 * np.sin(s / 9):.2f},{44 + 0.1 * np.sin(s / 9):.2f},19.7,41.6" for s in range(60)]
    status, said = run(tmp_path, capsys, "\n".join(["DateTime,CO2,TEMPsamp,RHsamp,TEMP1,RH1", *rows]) + "\n")
    assert status == 0 and "temperature 'TEMPsamp', humidity 'RHsamp'" in said
    assert "humidity 'RHsamp' is taken, and not 'RH1'" in said


def test_a_column_that_cannot_be_what_it_is_called_is_left_out_where_there_is_another(tmp_path, capsys):
    """A logger that writes an iMet-XQ2's integers beside what they mean was refused: "2386 cannot be"."""
    names = "host_timestamp,temperature_raw,temperature_c,humidity_raw,relative_humidity_pct"
    cells = (f"{2386 + s % 5},{23.86 + 0.01 * (s % 5):.2f},{310 + s // 9},{31 + 0.1 * (s // 9):.1f}" for s in range(60))
    rows = "".join(f"2026-08-26T20:18:{s:02d}.104+01:00,{one}\n" for s, one in enumerate(cells))
    status, said = run(tmp_path, capsys, f"{names}\n{rows}")
    assert status == 0 and "temperature 'temperature_c', humidity 'relative_humidity_pct'" in said
    assert "column 'temperature_raw' is left out: hardly any of it can be what its name says" in said
    status, said = run(tmp_path, capsys, f"{names}\n{rows}".replace("temperature_c", "c"))
    assert status == 2 and "2386 cannot be" in said  # the only one may be in another unit


@pytest.mark.parametrize("separator", [",", ";"])
@pytest.mark.parametrize(("name", "status"), [("hght", 2), ("level", 2), ("", 2), ("TimeElapsed", 0)])
def test_what_merely_rises_is_no_time(tmp_path, capsys, name, status, separator):
    """Heights of a sounding's levels, and a table's numbers of rows, were taken for seconds."""
    rows = "".join(f"{90 + 5 * s},{20 + 0.1 * np.sin(s / 9):.2f},{40 + 0.1 * s:.1f}\n" for s in range(60))
    found, said = run(tmp_path, capsys, (f"{name},temp,rh\n" + rows).replace(",", separator))
    assert found == status and (status == 0 or "no column of time" in said or "by a map" in said)


def test_of_two_altitudes_the_one_that_is_not_empty_is_taken(tmp_path, capsys):
    """The result had no altitude, without a word."""
    rows = [f"{s},{20 + 0.1 * np.sin(s / 9):.2f},,NaN,{5 * s}" for s in range(60)]
    text = "\n".join(["time,temperature,altitude,alt,gpsalt", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "altitude 'altitude' is empty, and 'gpsalt' is taken" in said
    place = read_layout(tmp_path / "log.csv").place
    assert place["altitude"] == 4 and place["temperature"] == 1
    status, said = run(tmp_path, capsys, text.replace("alt,gpsalt", "b,c"))
    assert status == 0 and "altitude 'altitude' is empty" in said and "is taken" not in said
    status, said = run(tmp_path, capsys, text.replace(",,NaN", ",3,NaN"))
    assert status == 0 and "is empty" not in said
    assert read_layout(tmp_path / "log.csv").place["altitude"] == 2
    (tmp_path / "log.csv").write_text(text.replace("gpsalt", "other"))
    assert read_layout(tmp_path / "log.csv").place["altitude"] == 2  # of none that is full the first


def test_lines_of_another_layout_that_cannot_be_read_are_said(tmp_path, capsys):
    rows = [f"{s};{20 + 0.1 * np.sin(s / 9):.2f}" for s in range(60)]
    rows[30] = "30;20.1;1;2"
    status, said = run(tmp_path, capsys, "\n".join(["time;temperature", *rows]) + "\n")
    assert status == 0 and "1 line of another number of cells left out (in line 32)" in said


def test_a_second_column_of_one_name_is_named_and_can_be_taken(tmp_path, capsys):
    """By the name that an import gives it; there was no word of it, and no name."""
    rows = [f"{s},{20 + 0.1 * np.sin(s / 9):.2f},{60 + 0.1 * np.sin(s / 9):.2f}" for s in range(60)]
    text = "\n".join(["time,Temperature (C),Temperature (C)", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "temperature 'Temperature (C)' is taken, and not 'Temperature (C) #2'" in said
    assert 15.0 < pandas.read_csv(tmp_path / "out.csv").temperature_corrected_c.median() < 25.0
    status, said = run(tmp_path, capsys, text, "--column", "temperature=Temperature (C) #2")
    assert status == 0 and "is taken, and not" not in said
    assert 55.0 < pandas.read_csv(tmp_path / "out.csv").temperature_corrected_c.median() < 65.0


def test_lines_of_metadata_and_a_row_of_units_go_by_the_map_that_look_writes(tmp_path, capsys):
    head = ["Version,1.0,", "Serial,77,", "Started,1780000000,s,"]
    names = "UTC Date,UTC Time,Altitude ASL,Pressure,Air Temp C,Rel Hum C,Speed Over Ground,Latitude,Longitude"
    units = "MM/DD/YY,HH:MM:SS,m,mB,C,%,m/s,deg,deg"
    rows = [
        f"05/29/26,16:17:{s:02d},{360 + 3 * s:.1f},{970 - 0.35 * s:.2f},{22 - 0.02 * s:.2f},{55 + 0.1 * s:.1f},0.2,"
        f"{35.2226 + 1e-6 * s:.6f},-97.4394"
        for s in range(60)
    ]
    log = tmp_path / "log.csv"
    log.write_text("\n".join([*head, names, units, *rows]) + "\n")
    assert main(["import", str(log), "--look", "--out", str(tmp_path / "look")]) == 0
    assert to_csv(log, tmp_path / "flight.csv", map_path=tmp_path / "look" / "log.toml")
    found = pandas.read_csv(tmp_path / "flight.csv")
    assert found["temperature_c"][50] == pytest.approx(21.0) and found["humidity_percent"][50] == pytest.approx(60.0)
    assert found["altitude_m"][50] == pytest.approx(510.0) and found["latitude_deg"][50] == pytest.approx(35.22265)
    assert found["time_s"][0] == pandas.Timestamp("2026-05-29 16:17:00").timestamp()
    assert "airspeed_m_s" not in found
    capsys.readouterr()


def test_an_altitude_in_feet_comes_by_a_map_in_metres(tmp_path):
    (tmp_path / "log.csv").write_text("sec;warm;Alt (ft)\n" + "".join(f"{s};20.{s};{1000 + s}\n" for s in range(9)))
    (tmp_path / "map.toml").write_text('[log]\ntime = "sec"\n[sensor.S]\ntemperature = "warm"\naltitude = "Alt (ft)"\n')
    assert to_csv(tmp_path / "log.csv", tmp_path / "flight.csv", map_path=tmp_path / "map.toml")
    assert pandas.read_csv(tmp_path / "flight.csv")["altitude_m"][0] == pytest.approx(304.8)


@pytest.mark.parametrize("housed", [False, True])
def test_the_stated_profile_of_the_documentation_is_one_and_its_lags_are_what_it_says(tmp_path, capsys, housed):
    text = (Path(__file__).parents[2] / "docs" / "flights_reading.md").read_text(encoding="utf-8")
    profile, _, below = text.partition("```json\n")[2].partition("```")
    if housed:  # the second lag that is stated below it
        profile = profile.replace('"effects": []', below.partition("`")[2].partition("`")[0], 1)
    (tmp_path / "stated.json").write_text(profile)
    time_s = np.arange(0.0, 600.0, 1.0)
    air = 15.0 + 4.0 * np.sin(time_s / 40.0)
    rng = np.random.default_rng(1)

    def lagged(values, lag_s):
        fine = np.arange(0.0, 600.0, 0.01)
        seen = lfilter([0.01 / lag_s], [1.0, 0.01 / lag_s - 1.0], np.interp(fine, time_s, values) - values[0])
        return values[0] + seen[::100]

    inside = lagged(air, 2.5) if housed else air
    log = pandas.DataFrame({"time_s": time_s, "temperature_c": lagged(inside, 8.0) + 0.02 * rng.standard_normal(600)})
    log["humidity_percent"] = 40.0 + 0.1 * rng.standard_normal(600)
    log.to_csv(tmp_path / "flight.csv", index=False)
    files = [str(tmp_path / "flight.csv"), "--profile", str(tmp_path / "stated.json"), "--out", str(tmp_path / "o.csv")]
    assert main(["correct", *files]) == 0
    done = pandas.read_csv(tmp_path / "o.csv")
    error = np.abs(done["temperature_corrected_c"] - air)[30:-30]
    assert error.max() < 0.15 and np.abs(log["temperature_c"] - air)[30:-30].max() > 0.7
    # a quarter of a lag that is uncertain by a quarter
    assert done["temperature_uncertainty_k"].max() == pytest.approx(0.25 * 8.0 * 4.0 / 40.0, rel=0.3)
    capsys.readouterr()


@pytest.mark.parametrize("period_s", [1.0, 2.0, 47.0])
def test_twenty_rows_have_an_uncertainty_in_proportion(tmp_path, period_s):
    """A balloon's row every 47 s was stated to 100 K."""
    (tmp_path / "stated.json").write_text(
        '{"format": "sensor-profile/1", "sensors": {"imet": {"body": "lumped"}}, "temperature": {"bead_radius_m": 4e-4,'
        ' "thermal_diffusivity_m2_s": {"value": 8e-9, "standard_uncertainty": 4e-10}, "noise_k": 0.02, "effects": []}}'
    )
    profile = read_profile(tmp_path / "stated.json")
    inside, errors, sizes = [], [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        step = period_s / max(round(period_s / 0.05), 20)
        fine = np.arange(-200.0, 20 * period_s, step)
        air = 20.0 - 0.005 * fine + 0.15 * np.sqrt(step) * np.cumsum(rng.standard_normal(fine.size))
        reading = air[0] + lfilter([step / 20.0], [1.0, step / 20.0 - 1.0], air - air[0])
        time_s, nothing = np.arange(20) * period_s, np.full(20, np.nan)
        air, reading = (np.interp(time_s, fine, values) for values in (air, reading))
        reading += 0.02 * rng.standard_normal(20)
        done = correct(Flight(time_s, reading, nothing, nothing, nothing, nothing), profile)
        errors.append([rms(done.temperature_c - air), rms(reading - air)])
        inside.append(np.mean(np.abs(done.temperature_c - air) < 1.96 * done.temperature_uncertainty_k))
        sizes.append(rms(done.temperature_uncertainty_k))
    corrected, raw = np.sqrt(np.mean(np.square(errors), axis=0))
    assert corrected < 0.9 * raw and np.mean(inside) > 0.85
    assert max(sizes) < 6.0 * raw


def test_readings_in_a_plume_are_not_implausible_and_absurd_ones_are():
    """Calm air on the way to a plume, a row every 2 s: readings wander by many times the usual there."""
    wrongly = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        calm, plume = 45.0 + 0.05 * rng.standard_normal(200), 50.0 + np.cumsum(rng.normal(0.0, 2.5, 200))
        reading = np.concatenate([calm, np.clip(plume, 35.0, 65.0), calm])
        absurd = [60, 280, 340]
        reading[absurd] = 100.0
        found = screen(2.0 * np.arange(reading.size), reading, RANGES["humidity_reading_percent"], 0.06)
        assert found.implausible[absurd].all()
        wrongly += np.count_nonzero(found.implausible) - len(absurd)
    assert wrongly <= 12  # of 1200, at the plume's edges


def test_rows_of_two_sensors_are_no_flight_of_one(tmp_path, capsys):
    """One sensor a row, 10 K apart, as databases export them: both had been one sensor's, without a word."""
    both = (("A", 20.0), ("B", 30.0))
    rows = [f"{i},{name},{warm + 0.01 * (i % 5):.2f},50" for i in range(300) for name, warm in both]
    text = "\n".join(["time_s,sensor_id,temperature_c,humidity_percent", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    assert status == 2 and not (tmp_path / "out.csv").exists()
    assert "log.csv: its rows are of 2 sensors, told apart by the column 'sensor_id' (A, B)" in said
    assert said.rstrip().endswith("and give it by --map")


def test_short_logs_are_screened_as_well():
    for count in range(1, 40):
        reading = 20.0 + 0.1 * np.sin(np.arange(count))
        reading[count // 2] = 60.0 if count > 8 else reading[count // 2]
        found = screen(np.arange(float(count)), reading, RANGES["temperature_c"], 0.02)
        assert np.flatnonzero(found.implausible).tolist() == ([count // 2] if count > 8 else [])


def test_the_turn_of_a_fast_change_is_not_implausible_in_slow_rows():
    rng = np.random.default_rng(1)
    reading = 18.0 + 0.4 * np.sin(np.arange(120) / 17.0) + 0.02 * rng.standard_normal(120)
    reading[60:66] += [0.2, 0.45, 0.7, 0.3, 0.1, 0.0]
    found = screen(3.0 * np.arange(120), reading, RANGES["temperature_c"], 0.02)
    assert not found.implausible.any()


def test_a_log_whose_cells_carry_their_unit_is_read(tmp_path, capsys):
    """As a StratoLogger writes its temperature: 76.7F. Before: 200 of 200 rows could not be read as numbers."""
    celsius = 24.0 + 0.5 * np.sin(np.arange(200) / 20.0)
    rows = [f"{0.5 * i:g},{22 + i},{1.8 * c + 32.0:.2f}F,7.9" for i, c in enumerate(celsius)]
    text = "\n".join(["time_s,altitude_ft,temperature,voltage", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    done = pandas.read_csv(tmp_path / "out.csv")
    assert status == 0 and "temperature 'temperature'" in said
    np.testing.assert_allclose(done["temperature_c"], celsius, atol=0.01)
    np.testing.assert_allclose(done["altitude_m"], 0.3048 * (22.0 + np.arange(200)), atol=0.01)
    status, said = run(tmp_path, capsys, text, "--column", "temperature=temperature")
    assert status == 2 and "and their unit: leave out --column" in said


def test_a_date_and_time_joined_by_dashes_is_one_with_its_thousandths(tmp_path):
    stamps = ("2022-5-7--11-24-56-316", "2022-5-7--11-24-56-745", "2022-5-7--11-24-57-5", "2022_5_7_11_24_57")
    flight = read(tmp_path, "Time,Temperature", [f"{stamp},21.{i}" for i, stamp in enumerate(stamps)])
    begins_s = pandas.Timestamp("2022-05-07T11:24:56Z").timestamp()
    np.testing.assert_allclose(flight.time_s - begins_s, [0.316, 0.745, 1.005, 1.0], atol=1e-6)


def test_a_log_without_names_is_told_where_its_first_row_lacks_readings(tmp_path):
    (tmp_path / "log.csv").write_text("2026/04/23 09:48:59,0,nan,n/a,19.75\n2026/04/23 09:49:10,0,14.4,22.24,19.75\n")
    with pytest.raises(InputError, match="no line of names: read it by a map with header_line = 0"):
        read_layout(tmp_path / "log.csv")


def test_a_humidity_that_stands_at_zero_has_its_page(tmp_path, capsys):
    """Warnings are errors here. Before: the page's spectrum of it was no power at all, on a scale of logarithms."""
    rows = [f"{0.5 * i:g},{20 + np.sin(i / 20.0):.3f},0" for i in range(400)]
    status, said = run(tmp_path, capsys, "\n".join(["time_s,temperature_c,humidity_percent", *rows]) + "\n")
    assert status == 0 and "stands at 0 %RH" in said and (tmp_path / "out.html").stat().st_size > 0


def test_readings_behind_their_names_in_a_column_of_text_are_read(tmp_path, capsys):
    """As radiosondy.info exports what sondes send by APRS. Before: neither temperature nor humidity was found."""
    t, h = 15.2 - 0.1 * np.arange(120), 60.0 + 10.0 * np.sin(np.arange(120) / 9.0)
    rows = [
        f"S123;52.0{i:03d};17.1;{100 + 20 * i};2023-05-11 10:{i // 30:02d}:{2 * i % 60:02d};"
        f"Clb=5.0m/s t={t[i]:.1f}C h={h[i]:.1f}% 403.01MHz Type=RS41-SGP"
        for i in range(120)
    ]
    text = "\n".join(["SONDE;Latitude;Longitude;Altitude;Datetime;Description", *rows]) + "\n"
    status, said = run(tmp_path, capsys, text)
    done = pandas.read_csv(tmp_path / "out.csv")
    assert status == 0 and "read as columns: Clb (m/s), temperature (C), humidity (%)" in said
    np.testing.assert_allclose(done["temperature (C)"], t, atol=0.051)
    assert done["humidity_corrected_percent"].notna().all() and done["Altitude"].iloc[-1] == 100 + 20 * 119


def test_lines_of_names_and_readings_are_read(tmp_path, capsys):
    """As a CanSat's debug port writes them; a line that was cut lacks what is behind. Before: no columns were found."""
    rows = [f"SGCan>Time:{0.5 * i:g}|Temp:{20 + 0.01 * i:.2f}|Press:{1000 - i}|Lat:69.29|" for i in range(100)]
    rows[40] = rows[40][:24]
    status, said = run(tmp_path, capsys, "\n".join(["Starting up", *rows]) + "\n")
    done = pandas.read_csv(tmp_path / "out.csv")
    assert status == 0 and "read as columns: Time, Temp, Press, Lat" in said
    assert len(done) == 100 and done["Temp"].iloc[-1] == 20.99 and np.isnan(done["Press"].iloc[40])


@pytest.mark.parametrize("before", ["", "{i} - ", "10:{m:02d}:{s:02d}.120 -> ", "[2026-05-03 10:{m:02d}:{s:02d}] "])
def test_a_line_for_each_reading_is_read(tmp_path, capsys, before):
    """As debug ports write records, a terminal's clock before each line or not. Before: no columns were found."""
    lines = ["Starting up"]
    for i in range(100):
        record = [f"Seconds: {i}"] * (not before) + [f"Temperature: {20 + 0.01 * i:.2f}", f"Pressure: {1000 - i}"]
        if i == 40:
            record.pop()
        lines += [before.format(i=i, m=i // 60, s=i % 60) + one for one in record]
    status, said = run(tmp_path, capsys, "\n".join(lines) + "\n")
    done = pandas.read_csv(tmp_path / "out.csv")
    first = "time" if before else "Seconds"
    assert status == 0 and f"read as columns: {first}, Temperature, Pressure" in said
    assert len(done) == 100 and done["Temperature"].iloc[-1] == 20.99 and np.isnan(done["Pressure"].iloc[40])


def test_a_remark_with_numbers_in_it_is_no_column(tmp_path, capsys):
    rows = [f"{0.5 * i:g},{20 + 0.01 * i:.2f},T=5 n=3" for i in range(100)]
    status, said = run(tmp_path, capsys, "\n".join(["time_s,temperature_c,note", *rows]) + "\n")
    assert status == 0 and "read as columns" not in said


def test_positions_and_heights_by_gps_and_barometer_are_known_by_name(tmp_path):
    flight = read(
        tmp_path, "time,temp,gps_lat,gps_long,baro_alt", [f"{i},20.{i},48.1,11.{i},{500 + i}" for i in range(9)]
    )
    assert flight.latitude_deg[0] == 48.1 and flight.longitude_deg[8] == 11.8 and flight.altitude_m[8] == 508


def test_a_weather_meters_own_pressure_is_taken_and_a_wind_is_no_airspeed(tmp_path, capsys):
    """Kestrel writes the pressure that is reduced to the sea first. The wind of a log with positions, or a speed that
    is nobody's, had been the airspeed of whatever flew."""
    rows = [f'"{s}";"{20 - 0.01 * s:.1f}";"45";"1013,2";"{900 - 0.1 * s:.1f}";"8,0";"48,1"' for s in range(300)]
    head = "Time (s);Temperature;Relative Humidity;Barometric Pressure;Station Pressure;Wind Speed;Latitude"
    status, said = run(tmp_path, capsys, "\n".join([head, *rows]).replace(".", ","))
    assert status == 0 and "pressure 'Station Pressure'" in said
    assert "airflow 'Wind Speed' is not taken" in said and "temperature 'Temperature'" in said
    status, said = run(tmp_path, capsys, "\n".join([head.replace("Wind Speed", "Speed (m/s)"), *rows]))
    assert status == 0 and "airflow 'Speed (m/s)' is not taken" in said
    flown = head.replace("Wind Speed", "Air Speed")
    status, said = run(tmp_path, capsys, "\n".join([flown, *rows]).replace(".", ","))
    assert status == 0 and "airflow 'Air Speed'" in said and "not taken" not in said


def test_hundredths_nanoseconds_and_centimetres_are_units(tmp_path, capsys):
    """As MAVLink and drivers of the MS5611 have them: 25.1 degC had been 2510, and 12 m 1200."""
    rows = [f"{20_000_000 * k},{2510 + k % 3},{94199 - k},{1200 + k}" for k in range(300)]
    names = "Timestamp_ns,Temperature_cdegC,Pressure_Pa,Altitude (cm)"
    status, said = run(tmp_path, capsys, "\n".join([names, *rows]))
    assert status == 0 and "is in cdegC" in said
    given = pandas.read_csv(tmp_path / "out.csv").temperature_corrected_c
    assert given.between(25.0, 25.2).all()
    flight = read(tmp_path, names, rows)
    assert np.isclose(flight.altitude_m[0], 12.0) and np.isclose(flight.time_s[-1], 299 * 0.02)


def test_the_third_of_a_kind_is_no_temperature(tmp_path, capsys):
    """A rocket's igniters: the third was offered as a temperature, and taken for one where there is no other."""
    rows = [f"{s};{20 - 0.01 * s:.2f};0;0;{s % 2};0" for s in range(120)]
    text = "\n".join(["time;temperature;igniter_a;igniter_b;igniter_c;igniter_d", *rows])
    for log in (text, text.replace(";", ",")):
        status, said = run(tmp_path, capsys, log)
        assert status == 0 and "igniter_c" not in said
    assert read_layout(tmp_path / "log.csv").place.keys() == {"time", "temperature"}
    status, said = run(tmp_path, capsys, text.replace("igniter_a", "temp_f").replace("igniter_c", "temp_c"))
    assert status == 0 and "temp_c" in said


def test_nothing_is_said_of_a_sensor_that_is_not_taken(tmp_path, capsys):
    """Its missing values had been, and the one inside had been taken, as it stands first."""
    rows = [f"{s};{20 + 0.01 * s:.2f};;{15 - 0.01 * s:.2f};{50 + 0.01 * s:.2f}".replace(".", ",") for s in range(120)]
    rows[7] = "7;;;14,9;50,1"
    text = "\n".join(["time;temp_in;hum_in;temp_out;hum_out", *rows])
    status, said = run(tmp_path, capsys, text)
    assert status == 0 and "temperature 'temp_out' is taken, and not 'temp_in'" in said and "missing" not in said


def two_columns_under_one_name(kind):
    if kind == "a date and its time":
        rows = [f"2020-01-01 12:{s // 60:02d}:{s % 60:02d} {20 - s / 100:.2f} {40 + s / 50:.1f}" for s in range(600)]
        return ["Time Temp RH", *rows]
    names = "    Time  AscRate  Hgt/MSL  Temp   RH   Dir"  # as Vaisala's DigiCORA writes them
    units = " min  s      m/s        m  degC    %   deg"
    rows = [
        f"{s // 60:4d} {s % 60:2d} {5.0:8.1f} {100 + 5 * s:8d} {20 - s / 100:5.2f} {40 + s / 50:.1f} {90:3d}"
        for s in range(4000)
    ]
    return [names, units, *rows]


@pytest.mark.parametrize("kind", ["a date and its time", "minutes and seconds"])
def test_a_time_in_two_columns_under_one_name_moves_no_other(tmp_path, capsys, kind):
    """The names behind it had moved by one: the temperature was read as the humidity, or the humidity as a temperature,
    and the first column's minutes as times."""
    lines = two_columns_under_one_name(kind)
    status, said = run(tmp_path, capsys, "\n".join(lines))
    assert status == 0 and "temperature 'Temp'" in said and "humidity 'RH'" in said and "stamps" not in said
    given = pandas.read_csv(tmp_path / "out.csv")
    rows = len(given)
    np.testing.assert_allclose(np.diff(given.time_s), 1.0)
    np.testing.assert_allclose(given.temperature_c, 20 - np.arange(rows) / 100, atol=0.006)
    np.testing.assert_allclose(given.humidity_percent, 40 + np.arange(rows) / 50, atol=0.06)
    if kind == "minutes and seconds":
        np.testing.assert_allclose(given.altitude_m, 100 + 5 * np.arange(rows))


def test_a_message_that_two_stations_heard_is_of_one_sensor(tmp_path, capsys):
    """A tracker's rows by radio: the stations that passed them on had been some twenty sensors of one balloon."""
    heard = np.random.default_rng(3).integers(0, 20, 160)
    rows = []
    for i, station in enumerate(heard):
        reading = "" if i % 4 == 0 else f"{20 - 0.05 * i:.2f}"
        for by in (station, (station + 1) % 20)[: 1 + (i % 4 < 2)]:
            rows.append(f"2023-04-28 12:{i // 6:02d}:{i % 6}0,WIDE-K{by}x,{reading}")
    status, said = run(tmp_path, capsys, "\n".join(["Time,Path,Temperature", *rows]))
    assert status == 0 and "sensors" not in said


def test_a_row_that_lacks_a_cell_is_no_line_of_names(tmp_path, capsys):
    """A tracker's first message, without the last word of the others: its readings had been the columns' names."""
    stamps = [f"2024-04-08 12:{i // 60:02d}:{i % 60:02d}" for i in range(300)]
    rows = [f"{at} K-12: {29 - i / 50:.2f}C  {984 - i:.2f}hPa 4.4V !w" for i, at in enumerate(stamps)]
    status, said = run(tmp_path, capsys, "\n".join([rows[0].replace(" !w", ""), *rows[1:]]))
    assert status == 0 and "29.00C" not in said and "984.00hPa" not in said
    given = pandas.read_csv(tmp_path / "out.csv")
    np.testing.assert_allclose(given.temperature_c, 29 - np.arange(1, 300) / 50, atol=0.006)
