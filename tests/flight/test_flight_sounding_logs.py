"""Logs of soundings in the forms their programs write: Windsond, radiosonde_auto_rx, FlySight, InterMet."""

import json
import re
from datetime import UTC, datetime

import numpy as np
import pytest

import shockrig
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files import flight_known
from shockrig.files.errors import InputError
from shockrig.files.flight_known import KnownLog
from shockrig.files.profile import write_profile
from shockrig.protocols.cli import main
from shockrig.protocols.flight_logs import read_log

PROFILE = typical_profile()

WINDSOND = (
    "UTC time, Altitude (m MSL), Altitude (m AGL), Pressure (Pascal), Speed (m/s), Heading (degrees), Temperature (C), "
    "Relative humidity (%), Internal temperature (C), Latitude, Longitude, Rise speed (m/s)"
)
AUTO_RX = (
    "timestamp,serial,frame,lat,lon,alt,vel_v,vel_h,heading,temp,humidity,pressure,type,freq_mhz,snr,f_error_hz,sats,"
    "batt_v,burst_timer,aux_data"
)
HEAD = """$FLYS,1
$VAR,FIRMWARE_VER,v2024.06.09
$VAR,SESSION_ID,{session}
"""
SENSOR = """$COL,BARO,time,pressure,temperature
$UNIT,BARO,s,Pa,deg C
$COL,HUM,time,humidity,temperature
$UNIT,HUM,s,percent,{degree}
$COL,IMU,time,wx
$UNIT,IMU,s,deg/s
$COL,TIME,time,tow,week
$UNIT,TIME,s,s,
$DATA
"""
TRACK = """$COL,GNSS,time,lat,lon,hMSL,velN,velE,velD,hAcc,vAcc,sAcc,numSV
$UNIT,GNSS,,deg,deg,m,m/s,m/s,m/s,m,m,m/s,
$DATA
"""


AVAPS = """AVAPS-T04 STA 234150007 240811 172544.21
AVAPS-T04 COM   Sonde    Date    Time     Press   Temp   Humid  Dir    Spd    Veloc  Longitude   Latitude  Altitude
AVAPS-D04 P11 234150007 240811 173334.00 9999.00  21.50  40.00 999.00 999.00  99.00  999.000000  99.000000 99999.00
AVAPS-T04 LAU 234150007 240811 173334.50
AVAPS-D04 S00 234150007 240811 173334.50  147.83 -37.58  12.57 200.07 213.47 -13.20  -24.642752  11.038282 99999.00 \
  9  12.57 999.00   9  3.51 14499.51
AVAPS-D04 S10 234150007 240811 173334.75 9999.00  99.00 999.00 199.56 208.66 -16.36  999.000000  99.000000 99999.00 \
  9 999.00 999.00   9  4.08 99999.00
AVAPS-D04 S00 234150007 2408
AVAPS-D04 S00 234150007 240811 173335.00  148.15 -49.30  30.39 199.54 204.36 -17.72  -24.642461  11.039162 99999.00 \
  7  30.39 999.00   7  4.87 14496.38
AVAPS-T04 END 234150007 240811 175110.67
""".replace("\\\n", "")


def stamp(*when):
    return datetime(*when, tzinfo=UTC).timestamp()


def test_a_dropsonde_is_read_as_its_receiver_wrote_it(tmp_path):
    """Before: "no column of time recognised (columns: AVAPS-T04 STA ...); name it"."""
    (tmp_path / "D20240811_173334.4").write_text(AVAPS)
    flight, said = read_log(tmp_path / "D20240811_173334.4")
    np.testing.assert_allclose(flight.time_s, stamp(2024, 8, 11, 17, 33, 34) + np.array([0.5, 1.0]))
    np.testing.assert_allclose(flight.temperature_c, [-37.58, -49.3])
    np.testing.assert_allclose(flight.humidity_percent, [12.57, 30.39])
    np.testing.assert_allclose(flight.pressure_hpa, [147.83, 148.15])
    np.testing.assert_allclose(flight.altitude_m, [14499.51, 14496.38])
    np.testing.assert_allclose(flight.latitude_deg, [11.038282, 11.039162])
    assert any(
        "the sonde 234150007; 1 line before the launch left out; 1 damaged line left out" in note for note in said
    )
    (tmp_path / "D1").write_text(AVAPS.replace(" S", " P"))
    with pytest.raises(InputError, match="no line of a sonde behind its launch"):
        read_log(tmp_path / "D1")


def windsond(path, first="23:59:58", rows=4):
    begun = 86398 if first == "23:59:58" else 0
    lines = [WINDSOND]
    for n in range(rows):
        s = (begun + n) % 86400
        place = "46.813000, 6.943000" if n == 2 else " , "
        lines.append(
            f"{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}, {491 + n}, {n}, {95000 - 12 * n}, 3.10, 250.00, "
            f"{12 - 0.01 * n:.2f}, {60 + n:.2f}, {25.5 if n == 1 else ' '}, {place}, {'' if n == 0 else 1.8}"
        )
    path.write_text("\n".join(lines) + "\n")
    return path


def test_windsond_has_its_units_its_missing_cells_and_the_day_of_its_name(tmp_path):
    """Launched at 17:58 in a zone six hours behind: midnight in UTC comes two seconds later."""
    flight, said = read_log(windsond(tmp_path / "2023-05-31_1758.raw_history.csv"))
    np.testing.assert_allclose(flight.time_s, stamp(2023, 5, 31, 23, 59, 58) + np.arange(4))
    np.testing.assert_allclose(flight.pressure_hpa, 950.0 - 0.12 * np.arange(4))
    np.testing.assert_allclose(flight.altitude_m, 491.0 + np.arange(4))  # above the sea
    np.testing.assert_allclose(flight.temperature_c, 12 - 0.01 * np.arange(4))
    np.testing.assert_allclose(flight.humidity_percent, 60 + np.arange(4))
    assert np.isnan(flight.die_temperature_c).all()  # the sonde's inside is no die
    np.testing.assert_array_equal(flight.latitude_deg, [np.nan, np.nan, 46.813, np.nan])
    np.testing.assert_array_equal(flight.vertical_speed_m_s, [np.nan, 1.8, 1.8, 1.8])
    assert said[0].startswith("read as a raw history of Windsond: time from 'UTC time', temperature from 'Temp")
    assert said[0].endswith("times are of 2023-05-31, as the file's name says")
    unnamed, said = read_log(windsond(tmp_path / "flight.csv"))
    np.testing.assert_allclose(np.diff(unnamed.time_s), 1.0)
    assert "a day that neither the log nor its name says" in said[0]


@pytest.mark.parametrize("pressure", [True, False])
def test_a_radiosondes_log_has_no_values_that_stand_for_none(tmp_path, pressure):
    header = AUTO_RX if pressure else AUTO_RX.replace("pressure,", "")
    rows = [
        "2024-03-01T23:00:00.000Z,S1234567,100,46.81300,6.94300,1000.5,4.9,3.1,250.0,8.1,61.0,{}RS41,404.100,20.1,0,9,2.9,,",
        "2024-03-01T23:00:01.000Z,S1234567,101,46.81310,6.94310,1005.4,5.1,3.1,250.0,-273.0,-1.0,{}RS41,404.100,20.1,0,9,2.9,,",
        "2024-03-01T23:00:03.000Z,S1234567,103,46.81320,6.94320,1015.6,5.0,3.1,250.0,8.0,61.5,{}RS41,404.100,20.1,0,9,2.9,,",
    ]
    cells = ("899.1,", "-1.0,", "898.0,") if pressure else ("", "", "")
    path = tmp_path / "20240301-225800_S1234567_RS41_404100_sonde.log"
    path.write_text("\n".join([header, *(row.format(cell) for row, cell in zip(rows, cells, strict=True))]) + "\n")
    flight, said = read_log(path)
    np.testing.assert_allclose(flight.time_s, stamp(2024, 3, 1, 23) + np.array([0, 1, 3]))
    np.testing.assert_array_equal(flight.temperature_c, [8.1, np.nan, 8.0])
    np.testing.assert_array_equal(flight.humidity_percent, [61.0, np.nan, 61.5])
    np.testing.assert_array_equal(flight.pressure_hpa, [899.1, np.nan, 898.0] if pressure else [np.nan] * 3)
    np.testing.assert_array_equal(flight.altitude_m, [1000.5, 1005.4, 1015.6])
    np.testing.assert_array_equal(flight.vertical_speed_m_s, [4.9, 5.1, 5.0])
    assert "radiosonde_auto_rx" in said[0]


def frames(count=5, **more):
    def one(n):
        place = {"lat": 46.8, "lon": 6.9, "alt": 1000.0 + 5 * n, "vel_v": 5.0}
        air = {"temp": -273.0 if n == 1 else 8.0 - n, "humidity": 60.0 + n}
        sonde = {"type": "RS41", "id": "S1234567", "frame": n, "datetime": f"2024-03-01T23:00:0{n}.000Z"}
        return sonde | place | air | more

    return [one(n) for n in range(count)]


@pytest.mark.parametrize("form", ["lines", "array"])
def test_frames_of_a_radiosonde_come_in_order_and_once(tmp_path, form):
    own = frames()
    sent = [own[2], own[0], own[1], own[3], own[2], frames(1, id="T7")[0], own[4]]
    path = tmp_path / "sonde.json"
    path.write_text(
        "\n".join(map(json.dumps, sent)) + '\n{"type": "RS41", "fra' if form == "lines" else json.dumps(sent)
    )
    flight, said = read_log(path)
    np.testing.assert_allclose(flight.time_s, stamp(2024, 3, 1, 23) + np.arange(5))
    np.testing.assert_array_equal(flight.temperature_c, [8.0, np.nan, 6.0, 5.0, 4.0])
    np.testing.assert_array_equal(flight.humidity_percent, 60.0 + np.arange(5))
    assert "of the sonde S1234567; frames of 1 other sonde are left out" in said[0]
    assert ("1 damaged line left out (first: line 8)" in said[0]) == (form == "lines")


def test_udp_packets_of_a_radiosonde_go_on_past_midnight(tmp_path):
    packets = [
        {"type": "PAYLOAD_SUMMARY", "callsign": "S1", "latitude": 46.8, "longitude": 6.9, "altitude": 900.0,
         "speed": 11.2, "time": clock, "temp": 8.0, "humidity": 61.0, "frame": n, "model": "RS41"}
        for n, clock in enumerate(["23:59:55", "00:00:00", "00:00:05"])
    ]  # fmt: skip
    path = tmp_path / "packets.log"
    path.write_text("\n".join(map(json.dumps, packets)))
    flight, said = read_log(path)
    np.testing.assert_allclose(np.diff(flight.time_s), 5.0)
    assert flight.altitude_m[0] == 900.0 and flight.latitude_deg[0] == 46.8 and "a day that they do not say" in said[0]


def flysight(folder, session="a1", track_session="a1", degree="deg C", clock=True):
    """Humidity each second, pressure at 10 Hz, positions at 5 Hz from 2 s on."""
    week, of_week = divmod(stamp(2025, 7, 29, 15, 6, 30) - stamp(1980, 1, 6), 604800)
    lines = [HEAD.format(session=session) + SENSOR.format(degree=degree)]
    for n in range(100):
        t = 4000.0 + 0.1 * n
        lines.append(f"$BARO,{t:.3f},{77000 + n:.2f},31.04\n$IMU,{t:.3f},1.0\n")
        if n % 10 == 0:
            lines.append(f"$HUM,{t:.3f},{20 + n / 10},{30 + n / 10}\n")
            lines.append(f"$TIME,{t:.3f},{of_week + n / 10:.3f},{week:.0f}\n" if clock else "")
    (folder / "SENSOR.CSV").write_text("".join(lines) + "$HUM,4010.0,3")
    rows = [
        f"$GNSS,2025-07-29T15:06:{32 + k // 5:02d}.{k % 5 * 200:03d}Z,40.2712,-111.6169,{2375 + k / 5:.3f},0.1,0.2,"
        "-1.000,1.0,2.0,0.1,9\n"
        for k in range(40)
    ]
    (folder / "TRACK.CSV").write_text(HEAD.format(session=track_session) + TRACK + "".join(rows))


@pytest.mark.parametrize("name", ["SENSOR.CSV", "TRACK.CSV", ""])
def test_flysights_two_files_are_one_flight(tmp_path, name):
    flysight(tmp_path)
    flight, said = read_log(tmp_path / name)
    begun = stamp(2025, 7, 29, 15, 6, 30)
    np.testing.assert_allclose(flight.time_s, begun + np.arange(10), atol=1e-3)
    np.testing.assert_allclose(flight.temperature_c, 30 + np.arange(10))
    np.testing.assert_allclose(flight.humidity_percent, 20 + np.arange(10))
    np.testing.assert_allclose(flight.pressure_hpa, 770.0 + 0.1 * np.arange(10))
    assert np.isnan(flight.die_temperature_c).all()
    # no positions before the first and after the last
    np.testing.assert_allclose(flight.altitude_m, [np.nan] * 2 + [2375.0 + k for k in range(8)], atol=1e-3)
    np.testing.assert_allclose(flight.vertical_speed_m_s, [np.nan] * 2 + [1.0] * 8)
    assert flight.latitude_deg[5] == pytest.approx(40.2712)
    assert "position and vertical speed from TRACK.CSV" in said[0]
    assert "1 damaged line of SENSOR.CSV left out (first: line " in said[0]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"track_session": "b2"}, "TRACK.CSV is left out, since it is of another session than SENSOR.CSV"),
        ({"clock": False}, "TRACK.CSV is left out, since the sensors' clock is not known"),
    ],
)
def test_positions_of_another_session_or_clock_are_left_out(tmp_path, settings, said):
    flysight(tmp_path, **settings)
    flight, sentences = read_log(tmp_path / "SENSOR.CSV")
    assert shockrig.correct(tmp_path / "SENSOR.CSV", PROFILE).notes[0] == sentences[0]
    assert flight.altitude_m is None or np.isnan(flight.altitude_m).all()
    assert said in sentences[0] and flight.humidity_percent.size == 10


def test_intermets_clock_before_its_first_fix_is_none(tmp_path):
    """Until then it counts from the day of the receiver's firmware, and says altitude -17 m at 0, 0."""
    header = (
        "Time,COM Elapse,XQ-iMet-XQ Pressure,XQ-iMet-XQ Air Temperature,XQ-iMet-XQ Humidity,XQ-iMet-XQ Humidity Temp,"
        "XQ-iMet-XQ Date,XQ-iMet-XQ Time,XQ-iMet-XQ Longitude,XQ-iMet-XQ Latitude,XQ-iMet-XQ Altitude,"
        "XQ-iMet-XQ Sat Count,"
    )
    rows = ["2023/03/09 10:12:33.5160,0.000,1011.47,23.99,70,24.48,2015/10/18,00:00:20,0,0,-17,0,"]
    for n in range(4):
        rows.append(
            f"2023/03/09 10:12:33.6{n}00,0.{n},1011.7{n},30.1{n},86,31.3,2023/03/08,23:59:5{n + 6},6.943,46.813,"
            "491.5,5,"
        )
    rows.append("2023/03/09 10:12:33.6500,0.5,1011.75,30.15,86,31.3,2023/03/09,00:00:00,0,0,-17,0,")  # a lost fix
    path = tmp_path / "20230309-101220-00061169 #1.csv"
    path.write_text("\r\n".join([header, *rows]) + "\r\n")
    flight, said = read_log(path)
    np.testing.assert_array_equal(flight.time_s, [np.nan, *(stamp(2023, 3, 8, 23, 59, 56) + np.arange(5))])
    np.testing.assert_array_equal(flight.altitude_m, [np.nan, *[491.5] * 4, np.nan])
    assert flight.temperature_c[0] == 23.99 and flight.die_temperature_c[1] == 31.3
    assert "the clock is the sensor's own, 'XQ-iMet-XQ Time'" in said[0]


def test_correct_takes_them_and_says_what_was_read(tmp_path, capsys):
    write_profile(PROFILE, tmp_path / "profile.json")
    (tmp_path / "fly").mkdir()
    flysight(tmp_path / "fly")
    for log, word in (
        (windsond(tmp_path / "2023-06-01_1758.raw_history.csv", first="0", rows=300), "Windsond"),
        (tmp_path / "fly", "FlySight"),
    ):
        out = tmp_path / "out.csv"
        assert main(["correct", str(log), "--profile", str(tmp_path / "profile.json"), "--out", str(out)]) == 0
        assert (
            f"note: read as a {'raw history of ' if word == 'Windsond' else 'log of '}{word}" in capsys.readouterr().err
        )
    # what is a CSV file keeps its own columns
    assert main(["correct", str(windsond(tmp_path / "w.csv", rows=300)), "--profile", str(tmp_path / "profile.json"),
                 "--out", str(out)]) == 0  # fmt: skip
    assert out.read_text().startswith("UTC time,Altitude (m MSL)")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (
            "SENSOR.CSV",
            "$FLYS,1\n$VAR,SESSION_ID,a\n$COL,HUM,time,humidity,temp",
            "no line .DATA: it ends in its header",
        ),
        ("SENSOR.CSV", HEAD + SENSOR + "$BARO,1,2,3\n", "no lines of .HUM"),
        (
            "SENSOR.CSV",
            HEAD + SENSOR + "$HUM,1\n$HUM,2\n$HUM,3,40,20\n",
            "line 13: 2 lines are not what the header says",
        ),
        ("SENSOR.CSV", HEAD + SENSOR.format(degree="deg F?") + "$HUM,3,40,20\n", "temperature is in 'deg F.'"),
        ("TRACK.CSV", HEAD + TRACK, "it has positions alone; put SENSOR.CSV of the same flight beside it"),
        ("15-06-28.CSV", "time,lat,lon,hMSL,velN,velE,velD,hAcc,vAcc,sAcc,gpsFix,numSV\n", "a track of FlySight 1"),
        ("sonde.json", '{"temp": 1,\n"hum": 2}\n', "line 1: no frame of a sonde"),
        ("sonde.json", '[{"temp": 1}, ', "line 1: not JSON"),
        ("sonde.json", '{"datetime": "2024-03-01T23:00:00Z", "temp": -273.0, "humidity": -1}\n', "no frame has a time"),
        ("sonde.json", '{"temp": 5.0, "id": ["a"]}\n', "no frame has a time"),
        ("w.csv", WINDSOND + "\n", "no rows under the header"),
    ],
)
def test_what_cannot_be_read_is_one_line_and_status_2(tmp_path, capsys, name, content, said):

    (tmp_path / name).write_text(content)
    write_profile(PROFILE, tmp_path / "profile.json")
    command = ["correct", str(tmp_path / name), "--profile", str(tmp_path / "profile.json")]
    assert main([*command, "--out", str(tmp_path / "out.csv")]) == 2
    error = capsys.readouterr().err
    assert re.search(said, error) and name in error and error.count("\n") == 1


def test_a_known_log_says_by_what_its_times_are_multiplied_too(monkeypatch, tmp_path):
    columns = {"time": "Uptime", "temperature": "T", "humidity": "U", "altitude": "Feet"}
    factor = {"time": 0.001, "altitude": 0.3048}
    log = KnownLog("a log of somebody", columns, frozenset(("Uptime", "Feet")), factor=factor)
    monkeypatch.setattr(flight_known, "KNOWN_LOGS", (*flight_known.KNOWN_LOGS, log))
    (tmp_path / "log.csv").write_text("Uptime,T,U,Feet\n500,20.0,50,100\n1500,20.1,50,200\n")
    flight = shockrig.read_flight(tmp_path / "log.csv")
    assert flight.time_s.tolist() == [0.5, 1.5]
    assert flight.altitude_m == pytest.approx([30.48, 60.96])
