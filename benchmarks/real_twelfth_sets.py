"""A twelfth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- PalmStudio/Biophysics_database_palm @1ca38ae, 00-data/climate/climate.zip (and, for the times,
  00-data/door_opening/Mic3_door_opening.csv): the air of two growth chambers with palms, its CO2 after the door was
  open and its temperature when the set point falls, each 30 s (no licence stated)
- KROVINSKI/19-Hollings-RespirometryData @f1b995d, Calibration Trial - 6.3.2019 EMT ch.{02,04}_O2.csv,
  Trial_{B_6.6,C_6.11,G_6.18}_{BLANK,crab_*}_O2.csv: oxygen optodes put into water without oxygen and then into chambers
  of fresh seawater, each 5 s (no licence stated)
- Faskally/loggercal @eece136, data-raw/100214/FullCalibration_100214.csv: fifteen loggers of temperature put into a
  bath of ice and, a week later, when it had warmed, taken out of it, each minute (MIT)
- PubInv/moonrat @fd118d0, moonratII/heat_data/{HI3cont,HI4cont_empty,MID6_cont,ALUM_cont,2PAD_LOW.cont}.csv: incubators
  that heat up at several powers, loaded and empty, each 30 s (AGPL 3.0)
- kristindickerson/slugheat_old @30615f9, inputs/Old_HFData/OldFormats/RetroFlux-2000/E08/00e08p{01..20}.pen: a
  thermistor of a probe that is pushed into the sea floor and, some ten minutes later, drawn out or heated for a moment,
  each 10 s as the authors' program takes it (no licence stated)
- IoTsec/Room-Climate-Datasets @f26ea40, datasets-location_A/room_climate-location_A-measurement{01,09,..57}.csv: a
  thermometer and a hygrometer of a room that one or two enter and leave, each 4 s (no licence stated)
- markus1203/MoBiMet @2c43d72, Sensor_Test/Temperatur_and_Humidity/Data/Ta_RH_Test-2020-04-03.csv: thermometers and
  hygrometers of four makes carried out of doors in the evening, each minute (no licence stated)

Cuts follow the authors' records of the door, of the people, of the probe and of the heating, the set point, and the
gap in a log while an optode was moved. Where none tells it, they follow what a plot shows: at which closings of the
door the CO2 was high, when a logger left its bath, and below which temperature the incubators rise without a break.
What is no temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, PPM, RH, Log, T, log_since, write_logs
from real_sets import RealSet

CLIMATE = "PalmStudio/Biophysics_database_palm/00-data/climate/climate.zip"
DOOR_SHUT = (
    *("2021-03-05 16:00:42", "2021-03-08 16:52:18", "2021-03-18 16:52:59", "2021-03-22 15:09:23"),
    *("2021-03-26 13:59:27", "2021-03-29 15:45:39", "2021-03-30 13:28:47", "2021-04-08 11:23:19"),
    *("2021-04-20 15:46:30", "2021-04-28 14:35:18"),
)
SHUT_FROM_S, SHUT_TO_S = 60.0, 5400.0
CHAMBER_LOGS = range(1, 12)
EVENINGS = "Mic4_data_clim_2.csv"
EVENING_ROWS = 80
SEAWATER = "KROVINSKI/19-Hollings-RespirometryData"
PERCENT_PER_MG_L, MG_L_PER_SATURATION = 7.0, 0.09  # of fresh water at 20 degC, in % of air saturation
NO_OXYGEN_MG_L, MOVED_S = 0.5, 30.0
INTO_NONE = (
    *(f"Calibration Trial - 6.3.2019 EMT ch.{one}" for one in ("02", "04")),
    *(f"Trial_C_6.11_crab_CH03_{one}" for one in ("32", "33")),
    *(f"Trial_G_6.18_{one}" for one in ("BLANK", "crab_CH05_36", "crab_CH05_5", "crab_CH07_11")),
)
INTO_SEAWATER = (
    *("Trial_B_6.6_BLANK", "Trial_C_6.11_BLANK"),
    *(f"Trial_C_6.11_crab_{one}" for one in ("CH03_15", "CH03_33", "CH05_14", "CH09_28", "CH10_28")),
    *(f"Trial_G_6.18_{one}" for one in ("BLANK", "crab_CH05_32", "crab_CH05_5", "crab_CH07_11", "crab_CH07_4")),
)
FRESH_S = 300.0
LOGGERS = "Faskally/loggercal/data-raw/100214/FullCalibration_100214.csv"
LOGGER_COLUMNS, LOGGER_HEAD = range(2, 17), 5
ICE_FROM_C, ICE_ROWS = 1.0, 45
TAKEN_OUT, STILL_LOGGED = 10010, 10024
TAKEN_OUT_K = 0.1
INCUBATORS = ("HI3cont", "HI4cont_empty", "MID6_cont", "ALUM_cont", "2PAD_LOW.cont")
THROTTLED_C = 34.5  # half a degree below what the control is set to
PROBE = "kristindickerson/slugheat_old/inputs/Old_HFData/OldFormats/RetroFlux-2000/E08/00e08p{:02d}.pen"
HEATED_PROBE, THERMISTOR = (1, 3, 5, 7, 9, 11, 13, 16, 18), 5
PUSHED_PROBE = tuple(one for one in range(1, 21) if one not in HEATED_PROBE)  # and drawn out unheated
RECORD_S, MILLIKELVIN = 10.0, 1000.0
ROOM = "IoTsec/Room-Climate-Datasets/datasets-location_A/room_climate-location_A-measurement{:02d}.csv"
ROOMS = (1, 9, 17, 25, 37, 45, 53, 57)
ROOM_FIELDS = ["id", "ms", "time_s", "node", T, RH, "light1", "light2", "people", "activity", "door", "window"]
NODE = {T: 4, RH: 2}
CARRIED = "markus1203/MoBiMet/Sensor_Test/Temperatur_and_Humidity/Data/Ta_RH_Test-2020-04-03.csv"
CARRIED_S = 1800.0
THERMOMETERS = (*(f"{k}_{one}" for one in ("HTU21D_Ta", "MCP9808", "BME680_Ta", "BME280_Ta") for k in (1, 2)),)
HYGROMETERS = ("1_HTU21D", "2_HTU21D", "1_BME680", "2_BME680", "1_BME280")  # the other BME280's column is no humidity


def _chamber(cache: Path, name: str) -> pd.DataFrame:
    """One log by its stamps: set point and reading of temperature and humidity, and the CO2."""
    with ZipFile(cache / CLIMATE) as archive:
        frame = pd.read_csv(BytesIO(archive.read(name)), encoding="latin1").iloc[:, [1, 2, 3, 4, 5, 8]]
    frame.columns = ["stamp", "set_t", T, "set_rh", RH, "co2"]
    return frame.assign(stamp=pd.to_datetime(frame["stamp"]))


def door_shut(cache: Path, out: Path) -> None:
    """From a minute after the door was shut."""
    frame = pd.concat([_chamber(cache, f"Mic3_data_clim_{i}.csv") for i in CHAMBER_LOGS])
    logs = []
    for shut in DOOR_SHUT:
        since = (frame["stamp"] - pd.Timestamp(shut)).dt.total_seconds()
        inside = since.between(SHUT_FROM_S, SHUT_TO_S)
        logs.append(log_since(since[inside].to_numpy(), frame["co2"][inside].to_numpy(float) / PPM, RH))
    write_logs(out, RH, logs)


def evenings(cache: Path, out: Path) -> None:
    """From where the set point begins to fall."""
    frame = _chamber(cache, EVENINGS)
    falls = np.flatnonzero(np.diff(frame["set_t"]) < 0.0)
    begins = falls[np.diff(falls, prepend=-EVENING_ROWS) >= EVENING_ROWS]
    since = (frame["stamp"] - frame["stamp"].iloc[0]).dt.total_seconds().to_numpy()
    rows = [slice(one, one + EVENING_ROWS) for one in begins]
    write_logs(out, T, [log_since(since[one], frame[T].to_numpy(float)[one]) for one in rows])


def _optode(cache: Path, name: str) -> np.ndarray:
    """Seconds and mg/L, whatever the unit; the last line is broken off at times."""
    lines = (cache / SEAWATER / f"{name}_O2.csv").read_text(encoding="latin1").splitlines()[2:]
    rows = [line.replace('"', "").split(",") for line in lines]
    factor = MG_L_PER_SATURATION if rows[0][9] == "%a.s." else 1.0
    return np.array([(60.0 * float(row[6]), factor * float(row[8])) for row in rows if len(row) > 9])


def _moved(table: np.ndarray) -> int:
    """The first row after the gap that follows the water without oxygen."""
    low = int(np.flatnonzero(table[:, 1] < NO_OXYGEN_MG_L)[0])
    return low + 1 + int(np.flatnonzero(np.diff(table[low:, 0]) > MOVED_S)[0])


def _oxygen(out: Path, tables: Sequence[np.ndarray]) -> None:
    write_logs(out, RH, [log_since(one[:, 0], PERCENT_PER_MG_L * one[:, 1], RH) for one in tables])


def into_none(cache: Path, out: Path) -> None:
    """From the first row, or since the air where the log begins there, until the gap."""
    tables = [_optode(cache, name) for name in INTO_NONE]
    _oxygen(out, [table[: _moved(table)] for table in tables])


def into_seawater(cache: Path, out: Path) -> None:
    """From the gap on."""
    tables = []
    for name in INTO_SEAWATER:
        table = _optode(cache, name)
        table = table[_moved(table) :]
        tables.append(table[table[:, 0] < table[0, 0] + FRESH_S])
    _oxygen(out, tables)


def _loggers(cache: Path) -> np.ndarray:
    lines = (cache / LOGGERS).read_text(encoding="latin1").splitlines()[LOGGER_HEAD:]
    table = [[line.split(",")[k] for k in LOGGER_COLUMNS] for line in lines]
    return pd.DataFrame(table).apply(pd.to_numeric, errors="coerce").to_numpy()


def _each_minute(out: Path, parts: Sequence[np.ndarray]) -> None:
    """Minutes without a reading are left out."""
    kept = [(60.0 * np.flatnonzero(np.isfinite(part)), part[np.isfinite(part)]) for part in parts]
    write_logs(out, T, [log_since(*one) for one in kept])


def into_ice(cache: Path, out: Path) -> None:
    """Those loggers that have not yet cooled when the log begins."""
    table = _loggers(cache)
    _each_minute(out, [one[:ICE_ROWS] for one in table.T if one[0] > ICE_FROM_C])


def out_of_bath(cache: Path, out: Path) -> None:
    """Those that log long enough, from the minute before they warm."""
    parts = []
    for one in _loggers(cache).T:
        after = one[TAKEN_OUT:]
        if np.isfinite(after[STILL_LOGGED - TAKEN_OUT]):
            parts.append(after[int(np.flatnonzero(np.diff(after) > TAKEN_OUT_K)[0]) :])
    _each_minute(out, parts)


def incubators(cache: Path, out: Path) -> None:
    """From the first row until the control begins to throttle the heater."""
    logs = []
    for name in INCUBATORS:
        table = pd.read_csv(cache / f"PubInv/moonrat/moonratII/heat_data/{name}.csv").to_numpy(float)
        end = int(np.flatnonzero(table[:, 1] > THROTTLED_C)[0])
        logs.append(log_since(table[:end, 0] / 1000.0, table[:end, 1]))
    write_logs(out, T, logs)


def _probe(cache: Path, one: int) -> tuple[int, int, np.ndarray]:
    """The record in which it was pushed, the one of the heating, and seconds and temperature of one thermistor."""
    text = (cache / PROBE.format(one)).read_text(encoding="latin1")
    lines = [line.split() for line in text.splitlines() if line.strip()]
    table = np.array([row for row in lines[6:] if len(row) == len(lines[6])], float)[:, (0, THERMISTOR)]
    return int(lines[3][0]), int(lines[4][0]), table * (RECORD_S, 1.0 / MILLIKELVIN)


def pushed(cache: Path, out: Path) -> None:
    """From the push to the last row before it was drawn out."""
    logs = []
    for one in PUSHED_PROBE:
        begin, _, table = _probe(cache, one)
        logs.append(log_since(*table[table[:, 0] >= RECORD_S * begin].T))
    write_logs(out, T, logs)


def heated(cache: Path, out: Path) -> None:
    """From the hottest on after the heating."""
    logs = []
    for one in HEATED_PROBE:
        _, begin, table = _probe(cache, one)
        table = table[table[:, 0] > RECORD_S * begin]
        logs.append(log_since(*table[int(np.argmax(table[:, 1])) :].T))
    write_logs(out, T, logs)


def _room(channel: str) -> Callable[[Path, Path], None]:
    """From when the first one comes in until the room is empty again."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for one in ROOMS:
            frame = pd.read_csv(cache / ROOM.format(one), header=None, names=ROOM_FIELDS, skipinitialspace=True)
            rows = frame[(frame["people"] > 0) & (frame["node"] == NODE[channel])].drop_duplicates("time_s")
            log = log_since(rows["time_s"].to_numpy(float), rows[T].to_numpy(float))
            logs.append(log if channel == T else log.assign(**{COLUMN[RH]: rows[RH].to_numpy(float)}))
        write_logs(out, channel, logs)

    return make


def _carried(cache: Path, columns: Sequence[str], name: str) -> list[Log]:
    frame = pd.read_csv(cache / CARRIED)
    stamps = pd.to_datetime(frame["Time"])
    since = (stamps - stamps.iloc[0]).dt.total_seconds()
    early = since < CARRIED_S
    table = frame[list(columns)][early].apply(pd.to_numeric, errors="coerce").set_axis([name] * len(columns), axis=1)
    return [table.iloc[:, k].to_frame().assign(time_s=since[early])[["time_s", name]] for k in range(len(columns))]


def thermometers_out(cache: Path, out: Path) -> None:
    """Each a run, from the first row on."""
    write_logs(out, T, _carried(cache, THERMOMETERS, COLUMN[T]))


def hygrometers_out(cache: Path, out: Path) -> None:
    """Each a run, with its own temperature."""
    warm = _carried(cache, [f"{one}_Ta" for one in HYGROMETERS], COLUMN[T])
    moist = _carried(cache, [f"{one}_RH" for one in HYGROMETERS], COLUMN[RH])
    write_logs(out, RH, [a.assign(**{COLUMN[RH]: b[COLUMN[RH]]}) for a, b in zip(warm, moist, strict=True)])


def twelfth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry, dark = (*NOT_WARMED, *NO_WATER), ("radiative_heating",)
    return [
        RealSet("CO2 of a growth chamber, its door shut", RH, door_shut, None, dry),
        RealSet("growth chamber in the evening", T, evenings, None, NO_WATER),
        RealSet("oxygen optodes into water without it", RH, into_none, None, dry),
        RealSet("oxygen optodes into fresh seawater", RH, into_seawater, None, dry),
        RealSet("loggers put into ice", T, into_ice, None, dry),
        RealSet("loggers taken out of a bath", T, out_of_bath, None, dark),
        RealSet("incubators that heat up", T, incubators, None, NO_WATER),
        RealSet("probe pushed into the sea floor", T, pushed, None, dry),
        RealSet("probe in the sea floor, heated for a moment", T, heated, None, dry),
        RealSet("thermometer of a room that one enters", T, _room(T), None, NO_WATER),
        RealSet("hygrometer of a room that one enters", RH, _room(RH), None, dark),
        RealSet("eight thermometers carried out of doors", T, thermometers_out, None, ()),
        RealSet("five hygrometers carried out of doors", RH, hygrometers_out, None, ()),
    ]
