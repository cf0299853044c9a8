"""Flights in other forms: ArduPilot logs that pymavlink writes, InterMet's CSV, netCDF, maps; WMO's format; layers."""

import dataclasses
import json
import os
import re
import warnings
from datetime import UTC, datetime, timedelta
from pathlib import Path

import netCDF4
import numpy as np
import pandas as pd
import pytest

from shockrig.analysis.flight.comparisons import Layers
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.simulated.scenes import to_flight as frame_to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.files.errors import InputError
from shockrig.files.flight import Corrected, Flight, read_layout
from shockrig.files.flight_from_netcdf import read_netcdf
from shockrig.files.flight_rows import to_flight
from shockrig.files.flight_wmo import file_name
from shockrig.files.profile import write_profile
from shockrig.protocols.cli import main
from shockrig.protocols.flight_logs import to_csv

PROFILE = typical_profile()
START_S = 1_760_000_000.0  # 9 October 2025, 08:53:20 UTC
GPS_EPOCH_S, LEAP_S = 315_964_800.0, 18.0


@pytest.fixture(scope="module")
def flown():
    return fly(inversion(np.random.default_rng(0), top_m=450.0, ascent_m_s=6.0), PROFILE, 3)


def write_bin(path, log, *, hygrometers=1):
    """A dataflash log of sensors, barometer and GPS by pymavlink's own packing of its messages."""
    DFReader = pytest.importorskip("pymavlink.DFReader")
    formats = {
        "FMT": (128, 89, "BBnNZ", "Type,Length,Name,Format,Columns"),
        "HYGR": (130, 0, "QBff", "TimeUS,Id,Humidity,Temp"),
        "TEMP": (131, 0, "QBff", "TimeUS,Inst,Temp,Raw"),
        "BARO": (132, 0, "QBff", "TimeUS,I,Alt,Press"),
        "GPS": (133, 0, "QBBIHLLf", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt"),
    }
    size = {"Q": 8, "B": 1, "f": 4, "I": 4, "H": 2, "L": 4, "n": 4, "N": 16, "Z": 64}
    made = {}
    for name, (type_, length, form, columns) in formats.items():
        length = length or 3 + sum(size[c] for c in form)
        made[name] = DFReader.DFFormat(type_, name, length, form, columns)

    def packed(name, *values):
        return DFReader.DFMessage(made[name], list(values), True, None).get_msgbuf()

    content = [packed("FMT", f.type, f.len, f.name, f.format, ",".join(f.columns)) for f in made.values()]
    for row in log.itertuples():
        us = int(5e6 + 1e6 * row.time_s)
        since = START_S + row.time_s - GPS_EPOCH_S + LEAP_S
        week, ms = int(since // 604_800), int(round(1e3 * (since % 604_800)))
        for i in range(hygrometers):
            content.append(packed("HYGR", us, i, row.humidity_percent + 10 * i, row.temperature_c + 2))
        content.append(packed("TEMP", us, 0, row.temperature_c, 0.0))
        if row.Index % 5 == 0:
            content.append(packed("BARO", us, 0, row.altitude_m, 100.0 * row.pressure_hpa))
            content.append(
                packed("GPS", us, 0, 3, ms, week, 352_000_000 + 10 * row.Index, -974_000_000, 350.0 + row.altitude_m)
            )
    path.write_bytes(b"".join(content))


def test_an_ardupilot_log_that_pymavlink_wrote_is_read_as_it_was_flown(tmp_path, flown):
    log = flown.log.iloc[:200]
    write_bin(tmp_path / "flight.bin", log, hygrometers=2)
    assert to_csv(tmp_path / "flight.bin", tmp_path / "flight.csv")
    found = pd.read_csv(tmp_path / "flight.csv")
    np.testing.assert_allclose(found["time_s"], START_S + log["time_s"], atol=2e-3)
    for name, off in (("temperature_c", 0), ("humidity_percent", 0), ("humidity_sensor_temperature_c", None)):
        right = log[name] if off is not None else log["temperature_c"] + 2
        np.testing.assert_allclose(found[name], right, atol=1e-3)
    np.testing.assert_allclose(found["altitude_m"][::5], 350.0 + log["altitude_m"][::5], atol=0.01)
    np.testing.assert_allclose(found["pressure_hpa"][::5], log["pressure_hpa"][::5], atol=0.01)
    np.testing.assert_allclose(found["latitude_deg"][::5], 35.2 + 1e-6 * log.index[::5], atol=1e-7)
    assert to_csv(tmp_path / "flight.bin", tmp_path / "other.csv", columns={"humidity": "HYGR[2].Humidity"})
    second = pd.read_csv(tmp_path / "other.csv")["humidity_percent"]
    np.testing.assert_allclose(second, log["humidity_percent"] + 10, atol=1e-3)


def test_what_is_no_ardupilot_log_is_refused_in_a_line(tmp_path, flown):
    pytest.importorskip("pymavlink")
    (tmp_path / "flight.bin").write_bytes(b"not a log at all" * 40)
    with pytest.raises(InputError, match=r"flight\.bin: .*\.bin"):
        to_csv(tmp_path / "flight.bin", tmp_path / "x.csv")
    write_bin(tmp_path / "good.bin", flown.log.iloc[:50])
    with pytest.raises(InputError, match=r"no XYZ\.T for temperature; it has .*HYGR\.Humidity"):
        to_csv(tmp_path / "good.bin", tmp_path / "x.csv", columns={"temperature": "XYZ.T"})


def test_a_log_with_a_format_that_pymavlink_does_not_know_is_refused_in_a_line(tmp_path, capsys):
    """Nor does what pymavlink prints of it come out as if it were the command's."""
    log = tmp_path / "flight.bin"
    columns = ["time_s", "temperature_c", "humidity_percent", "altitude_m", "pressure_hpa"]
    write_bin(log, pd.DataFrame(np.ones((50, 5)), columns=columns))
    log.write_bytes(log.read_bytes().replace(b"QBff\0", b"QBSf\0"))
    with pytest.raises(InputError, match=r"flight\.bin: no readable ArduPilot log .*'S'"):
        to_csv(log, tmp_path / "x.csv")
    assert capsys.readouterr() == ("", "")


def test_from_the_log_to_wmos_format_in_one_command(tmp_path, flown, capsys):
    write_bin(tmp_path / "flight.bin", flown.log)
    write_profile(PROFILE, tmp_path / "profile.json")
    out = tmp_path / "wmo"
    command = ["correct", str(tmp_path / "flight.bin"), "--profile", str(tmp_path / "profile.json"), "--out", str(out)]
    assert main([*command, "--wmo", "007:ABC12"]) == 0
    (path,) = out.iterdir()
    assert path.name == "UASDC_007_ABC12_20251009085320Z.nc"
    assert re.fullmatch(r"UASDC_\d{3}_[a-zA-Z0-9]{1,5}_\d{14}Z\.nc", path.name)
    with netCDF4.Dataset(path) as data:
        assert data.Conventions == "CF-1.8, WMO-CF-1.0" and data.wmo__cf_profile == "FM 303-2024"
        assert data.featureType == "trajectory"
        assert data.platform_name == "ABC12" and data.processing_level == "c1" and data.flight_id == "flight"
        assert data.site_terrain_elevation_height == f"{data['altitude'][0]:.0f}m"
        assert data.title and data.history.endswith("shockrig correct flight.bin")
        assert data["altitude"].positive == "up"
        units = {
            "time": "seconds since 1970-01-01T00:00:00",
            "lat": "degrees_north",
            "lon": "degrees_east",
            "altitude": "meters",
            "air_temperature": "Kelvin",
            "humidity_mixing_ratio": "kg/kg",
            "air_pressure": "Pa",
        }
        for name, unit in units.items():
            assert data[name].units == unit and np.isnan(data[name]._FillValue)
        assert np.isfinite(np.ma.filled(data["air_temperature"][:], np.nan)).all()
        # w = 0.622 e / (p - e), with Magnus' formula for e as WMO gives it (WMO-No. 8, annex 4.B)
        t = data["air_temperature"][:] - 273.15
        e = 0.01 * data["relative_humidity"][:] * 6.112 * np.exp(17.62 * t / (243.12 + t))
        mixing = 0.622 * e / (0.01 * data["air_pressure"][:] - e)
        np.testing.assert_allclose(data["humidity_mixing_ratio"][:], mixing, rtol=0.01)
        truth = np.interp(data["time"][:] - START_S, flown.truth["time_s"], flown.truth["temperature_c"])
        assert np.sqrt(np.mean((t - truth) ** 2)) < 0.03
    assert path.name in capsys.readouterr().out


@pytest.mark.parametrize("conventions", ["cf:1.8", "cf:1.11"])
def test_a_checker_of_cf_conventions_finds_nothing(tmp_path, flown, conventions):
    """IOOS's compliance-checker, at its usual level, on WMO's format (CF 1.8) and on the file of this project's own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own, of libraries that change
        from compliance_checker.runner import CheckSuite, ComplianceChecker

        write_profile(PROFILE, tmp_path / "profile.json")
        log = flown.log.iloc[:300]
        log = log.assign(time_s=log["time_s"] + START_S, latitude_deg=35.2, longitude_deg=-97.4)
        log.to_csv(tmp_path / "flight.csv", index=False)
        out = tmp_path / ("wmo" if conventions == "cf:1.8" else "flight.nc")
        command = ["correct", str(tmp_path / "flight.csv"), "--profile", str(tmp_path / "profile.json")]
        wmo = ["--wmo", "007:ABC12"] if out.suffix == "" else []
        assert main([*command, "--out", str(out), *wmo]) == 0
        CheckSuite.load_all_available_checkers()
        path = next(out.iterdir()) if wmo else out
        found = tmp_path / "found.json"
        ComplianceChecker.run_checker(
            str(path), [conventions], 0, "normal", output_filename=str(found), output_format="json"
        )
    result = json.loads(found.read_text())[conventions]
    assert not [
        (one["name"], one["msgs"])
        for level in ("high_priorities", "medium_priorities")
        for one in result[level]
        if one["msgs"]
    ]


def exported(tmp_path, clock, dates="%Y/%m/%d"):
    """A log that InterMet's application downloaded: `clock` is its own at each row."""
    header = (
        "Time,COM Elapse,XQ-iMet-XQ Pressure,XQ-iMet-XQ Air Temperature,XQ-iMet-XQ Humidity,XQ-iMet-XQ Humidity Temp,"
        "XQ-iMet-XQ Date,XQ-iMet-XQ Time,XQ-iMet-XQ Longitude,XQ-iMet-XQ Latitude,XQ-iMet-XQ Altitude,"
        "XQ-iMet-XQ Sat Count"
    )
    rows = []
    for n in range(60):
        read_at = datetime(2023, 9, 14, 19, 33, 3, tzinfo=UTC) + timedelta(seconds=n)
        rows.append(
            f"{clock(n)},{5 * n},1002.50,{20 + 0.1 * n:.2f},{50 - 0.1 * n:.1f},21.00,{read_at:{dates}},"
            f"{read_at:%H:%M:%S},-97.4,35.2,{n}.0,9"
        )
    path = tmp_path / "20230914-193303-00061169.csv"
    path.write_text("\r\n".join([header, *rows]) + "\r\n")
    return path, [row.split(",") for row in rows]


@pytest.mark.parametrize("dates", ["%Y/%m/%d", "%d/%m/%Y"])
@pytest.mark.parametrize("stamp", ["%Y/%m/%d %H:%M:%S.%f", "%H:%M:%S.%f", "%Y/%m/%d %H:%M:%S"])
def test_a_log_that_was_downloaded_goes_by_the_sensors_own_clock(tmp_path, stamp, dates):
    begun = datetime(2023, 10, 2, 11, 0, 0, tzinfo=UTC)
    path, rows = exported(tmp_path, lambda n: (begun + timedelta(seconds=0.01 * n)).strftime(stamp), dates)
    flight = to_flight(rows, read_layout(path))
    np.testing.assert_allclose(flight.time_s, datetime(2023, 9, 14, 19, 33, 3, tzinfo=UTC).timestamp() + np.arange(60))
    assert flight.temperature_c[10] == 21.0 and flight.altitude_m[10] == 10.0


def test_a_log_that_was_recorded_goes_by_the_applications_clock(tmp_path):
    """It has fractions of a second, and a date where the sensor has no fix."""
    begun = datetime(2023, 10, 2, 11, 0, 0, 250000, tzinfo=UTC)
    path, rows = exported(tmp_path, lambda n: (begun + timedelta(seconds=n)).strftime("%Y/%m/%d %H:%M:%S.%f"))
    flight = to_flight(rows, read_layout(path))
    np.testing.assert_allclose(flight.time_s, begun.timestamp() + np.arange(60))


def test_another_sensors_log_is_said_to_be(tmp_path, capsys):
    path, _ = exported(tmp_path, lambda n: "12:00:00")
    for serial, said in (("61170", True), ("00061169", False)):
        sensors = {"imet": {"kind": "imet-xq", "serial": serial}}
        write_profile(dataclasses.replace(PROFILE, sensors=sensors), tmp_path / "profile.json")
        command = ["correct", str(path), "--profile", str(tmp_path / "profile.json")]
        assert main([*command, "--out", str(tmp_path / "out.csv")]) == 0
        assert ("it is of serial 61170, and the log of 61169" in capsys.readouterr().err) == said


@pytest.mark.parametrize(("operator", "airframe"), [("7", "ABC"), ("007", "TOOLONG"), ("007", ""), ("abc", "A1")])
def test_ids_that_wmo_would_send_back_are_refused(operator, airframe):
    with pytest.raises(InputError, match="--wmo"):
        file_name(operator, airframe, START_S)


def test_a_log_without_positions_has_no_wmo_file(tmp_path, flown, capsys):
    flown.log.iloc[:200].to_csv(tmp_path / "flight.csv", index=False)
    write_profile(PROFILE, tmp_path / "profile.json")
    command = ["correct", str(tmp_path / "flight.csv"), "--profile", str(tmp_path / "profile.json")]
    assert main([*command, "--out", str(tmp_path / "wmo"), "--wmo", "007:ABC12"]) == 2
    assert "latitude" in capsys.readouterr().err
    assert not (tmp_path / "wmo").exists()


def test_intermets_application_with_zeros_and_stamps_that_repeat(tmp_path):
    header = (
        "Time,COM Elapse,8-IST HYT 271 Humidity,XQ-iMet-XQ Pressure,XQ-iMet-XQ Air Temperature,XQ-iMet-XQ Humidity,"
        "XQ-iMet-XQ Humidity Temp,XQ-iMet-XQ Longitude,XQ-iMet-XQ Latitude,XQ-iMet-XQ Altitude"
    )
    rows = []
    for n in range(40):
        moment = datetime(2023, 3, 9, 10, 12, 33, 516000) + timedelta(seconds=0.5 * (n // 2))  # two rows a stamp
        stamp = moment.strftime("%Y/%m/%d %H:%M:%S.%f")[:-2]
        read = (
            f"0.00,1002.50,{20 + 0.1 * n:.2f},{50 - n:.2f},21.00,-97.4,35.2,{n}.0" if n > 3 else ",".join(["0.00"] * 8)
        )
        rows += [f"{stamp},{n},{read}"] * (2 if n == 11 else 1)
    path = tmp_path / "imet.csv"
    path.write_text("\r\n".join([header, *rows]) + "\r\n")
    layout = read_layout(path)
    flight = to_flight([row.split(",") for row in rows], layout)
    assert flight.time_s[0] == pytest.approx(datetime(2023, 3, 9, 10, 12, 33, 516000).timestamp(), abs=86400)
    assert np.isnan(flight.temperature_c[:4]).all() and np.isnan(flight.latitude_deg[:4]).all()
    assert flight.humidity_percent[4] == 46.0 and flight.pressure_hpa[4] == 1002.5
    steps = np.diff(flight.time_s[4:])
    assert steps[7] == pytest.approx(0.0, abs=1e-6)  # a row that was written twice
    assert np.delete(steps, 7) == pytest.approx(0.25, abs=1e-5)


@pytest.mark.parametrize(
    ("unit", "written", "read"),
    [
        ("K", 293.15, 20.0),
        ("degF", 68.0, 20.0),
        ("degrees_Celsius", 20.0, 20.0),
        ("", 20.0, 20.0),
        ("rankine", 1.0, None),
    ],
)
def test_units_of_netcdf_are_read_or_refused(tmp_path, unit, written, read):
    with netCDF4.Dataset(tmp_path / "in.nc", "w") as data:
        data.createDimension("obs", 3)
        for name, values, own in (("time", [0.0, 1.0, 2.0], "ms"), ("air_temperature", [written] * 3, unit)):
            variable = data.createVariable(name, "f8", ("obs",))
            variable[:], variable.units, variable.standard_name = values, own, name
    if read is None:
        with pytest.raises(InputError, match="'rankine', which is not known; give one of degc, k, degf$"):
            read_netcdf(tmp_path / "in.nc", {})
        return
    time_s, values = read_netcdf(tmp_path / "in.nc", {})[0]["temperature"]
    np.testing.assert_allclose(time_s, [0.0, 1e-3, 2e-3])
    np.testing.assert_allclose(values, read, atol=1e-9)


def test_a_unit_of_netcdf_that_says_above_what_is_one(tmp_path):
    """As ARM's soundings had it. Before: their altitude was left out."""
    with netCDF4.Dataset(tmp_path / "in.nc", "w") as data:
        data.createDimension("time", 3)
        units = {"time": "s", "alt": "meters above Mean Sea Level", "air_temperature": "degC"}
        for name, unit in units.items():
            variable = data.createVariable(name, "f8", ("time",))
            variable[:], variable.units = [1.0, 2.0, 3.0], unit
    np.testing.assert_allclose(read_netcdf(tmp_path / "in.nc", {})[0]["altitude"][1], [1.0, 2.0, 3.0])


def test_a_sounding_in_the_trajectory_form_of_netcdf_is_read(tmp_path):
    """CF keeps several flights in one array of (trajectory, level); a radiosonde's file has one, and counts its seconds
    since a launch that another variable dates. Before: "neither temperature nor humidity found"."""
    with netCDF4.Dataset(tmp_path / "in.nc", "w") as data:
        data.createDimension("trajectory", 1)
        data.createDimension("levels", 3)
        launch = data.createVariable("launch_time", "f8", ("trajectory",))
        launch[:], launch.units = [1550522484.0], "seconds since 1970-01-01 00:00:00 UTC"
        for name, unit, standard in (
            ("flight_time", "seconds since launchtime", "time"),
            ("ta", "degrees_Celsius", "air_temperature"),
            ("hur", "%", "relative_humidity"),
        ):
            variable = data.createVariable(name, "f4", ("trajectory", "levels"))
            variable[:], variable.units, variable.standard_name = [[1.0, 2.0, 3.0]], unit, standard
    found, _ = read_netcdf(tmp_path / "in.nc", {})
    for quantity in ("temperature", "humidity"):
        np.testing.assert_allclose(found[quantity], [[1.0, 2.0, 3.0]] * 2)


def test_readings_in_another_unit_are_said_to_be(flown):
    log = flown.log.iloc[:300].assign(humidity_percent=lambda log: log["humidity_percent"] / 100)
    assert any("if they are fractions of 1" in note for note in correct(frame_to_flight(log), PROFILE).notes)
    log = flown.log.iloc[:300].assign(temperature_c=lambda log: log["temperature_c"] + 273.15)
    assert any("is it in kelvin" in note for note in correct(frame_to_flight(log), PROFILE).notes)
    assert not any("fractions" in note for note in correct(frame_to_flight(flown.log.iloc[:300]), PROFILE).notes)


def test_netcdf_goes_in_and_comes_out(tmp_path, flown):
    log = flown.log.iloc[:900]
    with netCDF4.Dataset(tmp_path / "in.nc", "w") as data:
        data.createDimension("obs", len(log))
        for name, values, units, standard in (
            ("t", log["time_s"] / 60, "minutes since 2025-10-09T08:53:20", "time"),
            ("ta", log["temperature_c"] + 273.15, "K", "air_temperature"),
            ("hur", log["humidity_percent"] / 100, "1", "relative_humidity"),
            ("p", log["pressure_hpa"] * 100, "Pa", "air_pressure"),
        ):
            variable = data.createVariable(name, "f8", ("obs",))
            variable[:], variable.units, variable.standard_name = values, units, standard
    write_profile(PROFILE, tmp_path / "profile.json")
    command = ["correct", str(tmp_path / "in.nc"), "--profile", str(tmp_path / "profile.json")]
    assert main([*command, "--out", str(tmp_path / "out.nc")]) == 0
    with netCDF4.Dataset(tmp_path / "out.nc") as data:
        assert data["time"][0] == pytest.approx(START_S + log["time_s"].iloc[0], abs=1e-3)
        for channel, unit in (("temperature", "k"), ("humidity", "percent")):
            total, independent, common = (
                np.asarray(data[f"{channel}_uncertainty_{part}{unit}"][:]) for part in ("", "independent_", "common_")
            )
            np.testing.assert_allclose(total**2, independent**2 + common**2, rtol=1e-6)
            assert (common > 0).any() and data[f"{channel}_uncertainty_independent_{unit}"].independent_after_s > 0
        right = flown.truth["temperature_c"].to_numpy()[:900]
        assert np.sqrt(np.mean((data["temperature_corrected_c"][:] - right) ** 2)) < 0.03


def test_a_map_reads_a_log_of_any_layout(tmp_path, flown):
    log = flown.log.iloc[:100]
    lines = [f"{t:.1f};{273.15 + a:.3f};{b / 100:.5f}" for t, a, b in log.iloc[:, :3].itertuples(index=False)]
    (tmp_path / "log.txt").write_text("\n".join(["zeit;luft;feuchte", *lines]) + "\n")
    (tmp_path / "map.toml").write_text(
        'format = "shock-map/1"\n[log]\ntime = "zeit"\ntime_unit = "s"\n[sensor.S]\ntemperature = "luft"\n'
        'temperature_unit = "K"\nhumidity = "feuchte"\nhumidity_unit = "fraction"\n'
    )
    assert to_csv(tmp_path / "log.txt", tmp_path / "flight.csv", map_path=tmp_path / "map.toml")
    found = pd.read_csv(tmp_path / "flight.csv")
    np.testing.assert_allclose(found["temperature_c"], log["temperature_c"], atol=1e-3)
    np.testing.assert_allclose(found["humidity_percent"], log["humidity_percent"], atol=1e-3)


def test_noise_averages_out_in_a_layer_and_an_error_of_the_profile_does_not():
    n = 400
    time_s, height = 0.1 * np.arange(n), np.linspace(0.0, 199.9, n)
    values, nothing = np.full(n, 20.0), np.full(n, np.nan)
    flight = Flight(time_s, values, values, nothing, nothing, nothing, altitude_m=height)
    common = {"temperature": np.full(n, 0.03), "humidity": np.full(n, 0.0)}
    sigma = np.hypot(0.04, 0.03)
    done = Corrected(
        values, np.full(n, sigma), values, np.full(n, 0.5), {}, (), {}, common, {"temperature": 0.4, "humidity": 0.1}
    )
    layers = Layers(100.0)
    layers.add(flight.at(slice(0, 150)), done_part(done, slice(0, 150)))
    layers.add(flight.at(slice(150, n)), done_part(done, slice(150, n)))
    rows = list(layers.rows())
    assert [row[:3] for row in rows] == [(0.0, 100.0, 200), (100.0, 200.0, 200)]
    for row in rows:
        # 200 samples, four of which share an error, are 50
        assert row[5] == pytest.approx(0.04 / np.sqrt(50)) and row[6] == pytest.approx(0.03)
        assert row[4] == pytest.approx(np.hypot(0.04 / np.sqrt(50), 0.03))
        assert row[9] == pytest.approx(0.5 / np.sqrt(200)) and row[10] == 0.0


def done_part(done, part):
    values = (getattr(done, name)[part] for name in list(Corrected.__dataclass_fields__)[:4])
    common = {name: column[part] for name, column in done.common.items()}
    return Corrected(*values, {}, (), {}, common, done.independent_after_s)


def test_a_log_of_another_layout_is_read_as_import_reads_it(tmp_path, capsys, monkeypatch):
    """Semicolons, decimal commas, names in German, a line of metadata: the same rows as of the plain file."""
    monkeypatch.chdir(tmp_path)
    for name in ("flight.csv", "profile.json"):
        assert main(["example", name]) == 0
    rows = [line.split(",") for line in Path("flight.csv").read_text().splitlines()][1:300]
    lines = [";".join([row[0], *(cell.replace(".", ",") for cell in row[1:3])]) for row in rows]
    Path("log.csv").write_text("\n".join(["Ort: Labor 2;;", "Zeitpunkt;Temperatur (degC);Feuchte (%rF)", *lines]))
    plain = ["\n".join(",".join(row[:3]) for row in [["time", "temperature_c", "humidity_percent"], *rows])]
    Path("plain.csv").write_text(plain[0])
    capsys.readouterr()
    for log in ("plain", "log"):
        assert (
            main(["correct", f"{log}.csv", "--profile", "profile.json", "--out", f"{log}_out.csv", "--no-report"]) == 0
        )
    said = capsys.readouterr().err
    assert "read as shockrig import reads it: time 'Zeitpunkt', temperature 'Temperatur (degC)'" in said
    one, other = (pd.read_csv(f"{log}_out.csv") for log in ("plain", "log"))
    for column in ("temperature_corrected_c", "humidity_corrected_percent", "humidity_uncertainty_percent"):
        np.testing.assert_allclose(one[column], other[column], atol=2e-4)


def test_a_log_in_which_nothing_is_recognised_is_sent_to_a_map(tmp_path, capsys):
    write_profile(typical_profile(), tmp_path / "profile.json")
    (tmp_path / "log.csv").write_text("a;b;c\n0,1;20,5;45,0\n0,2;20,5;45,0\n")
    command = ["correct", str(tmp_path / "log.csv"), "--profile", str(tmp_path / "profile.json")]
    assert main([*command, "--out", str(tmp_path / "out.csv")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "not parted by commas" in line and "--map" in line
    assert main([*command, "--out", str(tmp_path / "out.xlsx")]) == 2
    assert "out.xlsx: the flight is written as .csv or .nc, a figure of it as .png" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv", "profile.json"]


def test_a_log_by_a_map_whose_clock_was_set_back_keeps_its_rows(tmp_path, flown):
    log = flown.log.iloc[:900].copy()
    log.loc[400:, "time_s"] -= 15.0
    log.loc[10, "temperature_c"] = np.nan
    lines = ["Zeit;A;B"]
    for row in log.itertuples():
        bead = "" if np.isnan(row.temperature_c) else f"{row.temperature_c:.2f}"
        lines.append(f"{row.time_s:.2f};{bead};{row.humidity_percent:.2f}".replace(".", ","))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    units = 'temperature_unit = "degC"\nhumidity_unit = "percent"\n'
    head = 'format = "shock-map/1"\nname = "m"\n[log]\ntime = "Zeit"\ntime_unit = "s"\n'
    (tmp_path / "map.toml").write_text(f'{head}[sensor.one]\ntemperature = "A"\nhumidity = "B"\n{units}')
    assert to_csv(tmp_path / "log.csv", tmp_path / "flight.csv", map_path=tmp_path / "map.toml")
    read = pd.read_csv(tmp_path / "flight.csv")
    assert len(read) == len(log)
    assert np.allclose(np.diff(read["time_s"]), np.diff(log["time_s"]), atol=0.006)
    for name in ("temperature_c", "humidity_percent"):
        assert np.allclose(read[name], log[name], atol=0.006, equal_nan=True)


def test_result_and_messages_name_the_log_and_no_file_in_between(tmp_path, flown, capsys):
    write_profile(PROFILE, tmp_path / "profile.json")
    for name, rows in (("flight.bin", 60), ("short.bin", 1)):
        write_bin(tmp_path / name, flown.log.iloc[:rows])
    command = ["--profile", str(tmp_path / "profile.json"), "--out", str(tmp_path / "out.nc")]
    assert main(["correct", str(tmp_path / "flight.bin"), *command]) == 0
    with netCDF4.Dataset(tmp_path / "out.nc") as data:
        assert data.source == "thermo-hygrometer log flight.bin"
    capsys.readouterr()
    assert main(["correct", str(tmp_path / "short.bin"), *command]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "short.bin") in line


def test_a_pipe_called_netcdf_is_refused(tmp_path, capsys):
    """The library would wait in it for ever, deaf to every signal."""
    os.mkfifo(tmp_path / "flight.nc")
    with pytest.raises(InputError, match="flight.nc: is a pipe, expected a file"):
        read_netcdf(tmp_path / "flight.nc", {})


def of_netcdf(tmp_path, *variables):
    """A file of variables: name, dimension, values and attributes."""
    with netCDF4.Dataset(tmp_path / "in.nc", "w") as data:
        for name, dimension, values, attributes in variables:
            if dimension not in data.dimensions:
                data.createDimension(dimension, len(values))
            variable = data.createVariable(name, "f8", (dimension,))
            variable[:] = values
            variable.setncatts(attributes)
    return tmp_path / "in.nc"


SINCE = {"standard_name": "time", "units": "seconds since 2026-01-01"}


def test_each_variable_of_netcdf_goes_by_the_times_of_its_own_dimension(tmp_path):
    path = of_netcdf(
        tmp_path,
        ("gps_time", "fix", [0.0, 100.0], SINCE),
        ("time", "ctd", [0.0, 1.0, 2.0], SINCE),
        ("ctd_time", "ctd", [0.5, 1.5, 2.5], SINCE),
        ("TEMP", "ctd", [4.0, 5.0, 6.0], {"standard_name": "sea_water_temperature", "coordinates": "ctd_time lat"}),
        ("probe", "ctd", [7.0, 8.0, 9.0], {"units": "degrees_Celsius"}),
        ("lone", "other", [1.0, 2.0, 3.0, 4.0], {}),
    )
    found, said = read_netcdf(path, {})
    np.testing.assert_allclose(found["temperature"][0] % 86400.0, [0.5, 1.5, 2.5])
    np.testing.assert_allclose(found["temperature"][1], [4.0, 5.0, 6.0])
    assert "temperature 'TEMP'; times 'ctd_time'" in said[0]
    found, _ = read_netcdf(path, {"temperature": "probe"})
    np.testing.assert_allclose(found["temperature"][0] % 86400.0, [0.0, 1.0, 2.0])
    with pytest.raises(InputError, match=r"'lone' for temperature has no times: .* lies over \(other\)"):
        read_netcdf(path, {"temperature": "lone"})


@pytest.mark.parametrize(
    ("unit", "values", "said"),
    [("dbar", [500.0, 600.0], "no air has as much"), ("furlong", [1.0, 2.0], "'furlong', which is not known")],
)
def test_a_pressure_of_netcdf_that_is_none_of_the_airs_is_left_out_and_said(tmp_path, unit, values, said):
    readings = ("time", "obs", [0.0, 1.0], SINCE), ("temperature", "obs", [20.0, 21.0], {"units": "degC"})
    path = of_netcdf(tmp_path, *readings, ("pressure", "obs", values, {"units": unit}))
    found, (_, *left_out) = read_netcdf(path, {})
    assert set(found) == {"temperature"} and said in " ".join(left_out)
    path = of_netcdf(tmp_path, *readings, ("pressure", "obs", [10.1, 9.8], {"units": "dbar"}))
    np.testing.assert_allclose(read_netcdf(path, {})[0]["pressure"][1], [1010.0, 980.0])


@pytest.mark.parametrize("way", [{"positive": "down"}, {"positive": "up"}, {}])
def test_a_depth_of_netcdf_is_an_altitude_downwards_and_times_may_be_nanoseconds(tmp_path, way):
    path = of_netcdf(
        tmp_path,
        ("time", "obs", [0.0, 2e9], SINCE | {"units": "nanoseconds since 2026-01-01"}),
        ("temperature", "obs", [20.0, 21.0], {"units": "degC"}),
        ("depth", "obs", [3.0, 4.0], {"standard_name": "depth", "units": "m"} | way),
    )
    found = read_netcdf(path, {})[0]
    np.testing.assert_allclose(found["altitude"][1], [3.0, 4.0] if way.get("positive") == "up" else [-3.0, -4.0])
    np.testing.assert_allclose(found["temperature"][0], 1767225600.0 + np.array([0.0, 2.0]))
