"""A fourteenth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- anaijazi/thermalManikinSleep @20210d2, data/calibration/hobo/{20211226_Calibration_{2,3,4},20211227_Calibration_1}.csv
  (and, for the times, data/calibration/startstop.csv): loggers' probes in a bath that is warmed from 15 to 25 and to
  35 degC, each 5 s, in degF (no licence stated)
- dotmote/sapflow @d6f5dbb, software/data_analysis/csvAggregator/dataToAggregate/
  {1,2}_{1563433200,1563436800}_sampleData.csv: a thermometer beside the heater of a sap-flow gauge, which is switched
  on for a moment each half an hour, each 3 s (no licence stated)
- junbinzhao/FluxCalR @6b7caf1, inst/extdata/Flux_example_1_LGR.txt: water vapour and methane of a chamber that is set
  on the ground and lifted again, as a laser's analyser has them, each second (MIT)
- Qepanna/goFlux @501e0f8, inst/extdata/UGGA/UGGA.txt (and, for the times, inst/extdata/aux_UGGA/aux_UGGA.txt): the
  water vapour of another such chamber, each second (GPL 2)
- embedded-sergey/FishResp-GUI @d1c40da, Trial data/qboxaqua/qboxaqua.csv: the oxygen of a chamber in which a fish
  breathes, and which a pump flushes now and then, each second (GPL 3)
- IsaqueNunes/e-nose_v2 @634427c, data/positive_{25..28}.csv: an SHT31 and a BME680 in a box with a sample, which gas
  sensors warm, each 22 s (no licence stated)
- GenericLab/CO2-soil-respiration-chamber @6024160, measurements/{ot1-22-3,ot2-22-3,ot3-26-03,ot3-26-03rep}.csv: a
  hygrometer with its thermometer and a CO2 sensor in a chamber that is put on soil for a day, each 30 s (no licence
  stated)
- Wazurim/Design2 @6490714, Data/essaie2_temp.txt: three thermistors on a plate that a Peltier element heats and then
  leaves, each second (no licence stated)
- Dennis-van-Gils/project-INA228-thermistor-logger @cd4c6fb, data/calibration_260511/{260511_151804_1_ramp_up,
  260512_185755_{1_ramp_up,2_ramp_down,3_ramp_up}}.txt, data/calibration_260514/SteinhartHartFitReport_0x40_260515.json:
  a Pt100 in a body of copper, and a bead thermistor beside it, in a bath that goes through 22 K in 220 minutes, each
  second (MIT)

Cuts follow the authors' records of the bath, of the pulses of heat, of the chamber and of the pump, the power of the
plate, and the authors' files of one sample or one ramp each. Where none tells it, they follow what a plot shows: the
bath's first warming on the first of its days, when the chamber was set on the ground and lifted, the hottest reading
after a pulse of heat, and when the hygrometer comes into the moist air. What is no temperature goes as a humidity,
scaled into its range.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_twelfth_sets import PERCENT_PER_MG_L

BATH = "anaijazi/thermalManikinSleep/data/calibration/hobo"
BATH_LOGS = (  # name, column of the probe, and when the bath was set to 25 and to 35 degC and the probe was taken out
    *((f"20211226_Calibration_{one}", 2, "13:36:00", "14:29:00", "15:18:00") for one in (2, 3, 4)),
    *(("20211227_Calibration_1", one, "15:37:00", "16:14:00", "16:56:00") for one in (2, 3)),
)
PROBE_ROW_S = 5.0  # one logger's stamps have no seconds
ALOFT_S = 60.0
GAUGE = "dotmote/sapflow/software/data_analysis/csvAggregator/dataToAggregate"
GAUGE_LOGS = tuple(f"{one}_{hour}_sampleData" for one in (1, 2) for hour in (1563433200, 1563436800))
AFTER_PULSE_S = 600.0
LASER_LOG = "junbinzhao/FluxCalR/inst/extdata/Flux_example_1_LGR.txt"
SET_DOWN = ("12:04:10", "12:33:30", "12:45:22", "12:59:40", "13:14:42")
LIFTED = ("12:15:30", "12:30:00", "12:42:23", "12:57:35", "13:11:02")
SET_DOWN_S, LIFTED_S = 240.0, 60.0
OTHER_LASER = "Qepanna/goFlux/inst/extdata"
CLOSED_S = 180.0
WATER_PPM, METHANE_PPM = 400.0, 0.3  # in a unit of the scale
PUMPED = "embedded-sergey/FishResp-GUI/Trial data/qboxaqua/qboxaqua.csv"
NOSE = "IsaqueNunes/e-nose_v2/data"
NOSE_SAMPLES = range(25, 29)
ON_SOIL = "GenericLab/CO2-soil-respiration-chamber/measurements"
SOIL_LOGS = ("ot1-22-3", "ot2-22-3", "ot3-26-03", "ot3-26-03rep")
MOIST_STEP, MOIST_FULL = 2.0, 100.0
SOIL_FROM_S, SOIL_TO_S, SOIL_EVERY, SOIL_PPM = 7200.0, 79200.0, 10, 100.0
PELTIER_PLATE = "Wazurim/Design2/Data/essaie2_temp.txt"
RAMPED = "Dennis-van-Gils/project-INA228-thermistor-logger/data"
RAMPS = ("260511_151804_1_ramp_up", *(f"260512_185755_{one}" for one in ("1_ramp_up", "2_ramp_down", "3_ramp_up")))
RAMP_EVERY = 30
BEAD = {"temperature_standard_uncertainty_k": 0.04}  # of the residuals that its authors fitted it with
ZERO_C_K = 273.15


def _since_midnight(stamps: pd.Series) -> pd.Series:
    return (stamps - stamps.dt.normalize()).dt.total_seconds()


def _seconds_of(clock: str) -> float:
    return pd.Timedelta(clock).total_seconds()


def _window(since: pd.Series, value: pd.Series, begin: float, end: float, channel: str = T) -> Log:
    inside = since.between(begin, end) & value.notna()
    return log_since(since[inside].to_numpy(), value[inside].to_numpy(float), channel)


def _bath_log(cache: Path, name: str, column: int) -> tuple[pd.Series, pd.Series]:
    """Seconds since midnight, degC."""
    frame = pd.read_csv(cache / BATH / f"{name}.csv", skiprows=1, encoding="latin1")
    stamps = pd.to_datetime(frame.iloc[:, 1], format="mixed")
    since = _since_midnight(stamps) + PROBE_ROW_S * stamps.groupby(stamps).cumcount()
    return since, (pd.to_numeric(frame.iloc[:, column], errors="coerce") - 32.0) / 1.8


def bath_warmed(cache: Path, out: Path) -> None:
    """Each probe twice."""
    logs = []
    for name, column, *clocks in BATH_LOGS:
        first, second, end = map(_seconds_of, clocks)
        log = _bath_log(cache, name, column)
        logs += [_window(*log, first, second), _window(*log, second, end)]
    write_logs(out, T, logs)


def out_of_warm_bath(cache: Path, out: Path) -> None:
    """Those that log for longer than a minute then."""
    logs = []
    for name, column, *clocks in BATH_LOGS:
        log, begin = _bath_log(cache, name, column), _seconds_of(clocks[-1])
        if log[0].iloc[-1] > begin + 2.0 * ALOFT_S:
            logs.append(_window(*log, begin, np.inf))
    write_logs(out, T, logs)


def pulses(cache: Path, out: Path) -> None:
    """From the hottest reading after each pulse."""
    logs = []
    for name in GAUGE_LOGS:
        frame = pd.read_csv(cache / GAUGE / f"{name}.csv")
        after = frame["millisSinceHeatPulse"] / 1000.0
        for _, rows in frame.groupby((after.diff() < 0.0).cumsum()):
            since = after[rows.index]
            if since.iloc[0] < AFTER_PULSE_S and since.iloc[-1] > AFTER_PULSE_S:
                logs.append(_window(since, rows["tc2"], since[rows["tc2"].idxmax()], AFTER_PULSE_S))
    write_logs(out, T, logs)


def _laser(path: Path, gas: str, stamp: str) -> tuple[pd.Series, pd.Series]:
    """Seconds since midnight, ppm; what follows the readings is the analyser's signature."""
    frame = pd.read_csv(path, skiprows=1, skipinitialspace=True, on_bad_lines="skip", dtype=str)
    frame.columns = frame.columns.str.strip()
    stamps = pd.to_datetime(frame["Time"], format=stamp, errors="coerce")
    return _since_midnight(stamps), pd.to_numeric(frame[gas], errors="coerce")


def chamber_set_down(cache: Path, out: Path) -> None:
    since, water = _laser(cache / LASER_LOG, "[H2O]_ppm", "%m/%d/%Y %H:%M:%S.%f")
    begins = [_seconds_of(one) for one in SET_DOWN]
    write_logs(out, RH, [_window(since, water / WATER_PPM, at, at + SET_DOWN_S, RH) for at in begins])


def chamber_lifted(cache: Path, out: Path) -> None:
    since, methane = _laser(cache / LASER_LOG, "[CH4]_ppm", "%m/%d/%Y %H:%M:%S.%f")
    begins = [_seconds_of(one) for one in LIFTED]
    write_logs(out, RH, [_window(since, methane / METHANE_PPM, at, at + LIFTED_S, RH) for at in begins])


def chamber_closed(cache: Path, out: Path) -> None:
    """From the begin of each measurement, as its authors noted it."""
    since, water = _laser(cache / OTHER_LASER / "UGGA/UGGA.txt", "[H2O]_ppm", "%d/%m/%Y %H:%M:%S.%f")
    notes = pd.read_csv(cache / OTHER_LASER / "aux_UGGA/aux_UGGA.txt", sep="\t")
    begins = sorted(_since_midnight(pd.to_datetime(notes["start.time"])))
    write_logs(out, RH, [_window(since, water / WATER_PPM, at, at + CLOSED_S, RH) for at in begins])


def pump_on(cache: Path, out: Path) -> None:
    """As long as the pump runs, but for the time before the first stop."""
    frame = pd.read_csv(cache / PUMPED)
    since, oxygen, pump = frame.iloc[:, 0], PERCENT_PER_MG_L * frame.iloc[:, 1], frame["Latest: PWM: F=1, C=0"]
    begins, ends = since[pump.diff() > 0.0], since[pump.diff() < 0.0].iloc[1:]
    write_logs(out, RH, [_window(since, oxygen, *both, RH) for both in zip(begins, ends, strict=False)])


def _nose(columns: Sequence[str], channel: str) -> Callable[[Path, Path], None]:
    """Files whole; a hygrometer has its own temperature beside it."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for sample in NOSE_SAMPLES:
            frame = pd.read_csv(cache / NOSE / f"positive_{sample}.csv")
            stamps = pd.to_datetime(frame["Timestamp"])
            table = frame[list(columns)].set_axis([COLUMN[one] for one in (T, RH)][: len(columns)], axis=1)
            logs.append(table.assign(time_s=(stamps - stamps[0]).dt.total_seconds()))
        write_logs(out, channel, logs)

    return make


def _soil_log(cache: Path, name: str) -> pd.DataFrame:
    frame = pd.read_csv(cache / ON_SOIL / f"{name}.csv")
    stamps = pd.to_datetime(frame["created_at"])
    names = {"field1": COLUMN[T], "field3": "ppm", "field4": COLUMN[RH]}
    return frame.rename(columns=names).assign(time_s=(stamps - stamps[0]).dt.total_seconds())


def hygrometer_on_soil(cache: Path, out: Path) -> None:
    """From the row before it rises by more than two percent until it reads a hundred."""
    logs = []
    for name in SOIL_LOGS:
        frame = _soil_log(cache, name)
        begin = int(np.flatnonzero(frame[COLUMN[RH]].diff() > MOIST_STEP)[0]) - 1
        end = begin + int(np.flatnonzero(frame[COLUMN[RH]][begin:] >= MOIST_FULL)[0])
        logs.append(frame[["time_s", COLUMN[T], COLUMN[RH]]][begin:end])
    write_logs(out, RH, logs)


def soil_for_a_day(cache: Path, out: Path) -> None:
    """From two hours after the log's first row, each tenth row."""
    logs = []
    for name in SOIL_LOGS:
        frame = _soil_log(cache, name)[::SOIL_EVERY]
        logs.append(_window(frame["time_s"], frame["ppm"] / SOIL_PPM, SOIL_FROM_S, SOIL_TO_S, RH))
    write_logs(out, RH, logs)


def plate_left(cache: Path, out: Path) -> None:
    """Each thermistor a run, from when the power goes off."""
    table = np.loadtxt(cache / PELTIER_PLATE)
    off = int(np.flatnonzero(np.diff(table[:, 1]))[-1]) + 1
    write_logs(out, T, [log_since(table[off:, 0], table[off:, one]) for one in (2, 3, 4)])


def ramps(cache: Path, out: Path) -> None:
    """Ohms of the thermistor to degC as its authors calibrated it later, without the copper; each thirtieth row."""
    report = cache / RAMPED / "calibration_260514/SteinhartHartFitReport_0x40_260515.json"
    coefficients = json.loads(report.read_text())["coeffs"]
    logs, airs = [], []
    for name in RAMPS:
        path = cache / RAMPED / f"calibration_260511/{name}.txt"
        table = np.loadtxt(path, skiprows=2, usecols=(0, 1, 2), encoding="utf-8")[::RAMP_EVERY]
        powers = np.log(table[:, 2])[:, None] ** (0, 1, 3)
        logs.append(log_since(table[:, 0], table[:, 1]))
        airs.append(log_since(table[:, 0], 1.0 / (powers @ coefficients) - ZERO_C_K))
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], BEAD)


def fourteenth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry, dark = (*NOT_WARMED, *NO_WATER), ("radiative_heating",)
    return [
        RealSet("probes in a bath that is warmed", T, bath_warmed, None, dry),
        RealSet("probes taken out of a warm bath", T, out_of_warm_bath, None, dark),
        RealSet("sap-flow gauge after a pulse of heat", T, pulses, None, NO_WATER),
        RealSet("water vapour of a chamber that is set down", RH, chamber_set_down, None, dry),
        RealSet("methane of a chamber that is lifted", RH, chamber_lifted, None, dry),
        RealSet("water vapour of a chamber that is closed", RH, chamber_closed, None, dry),
        RealSet("oxygen of a fish's chamber while a pump runs", RH, pump_on, None, dry),
        RealSet("SHT31 in a box that gas sensors warm", T, _nose(["SHT_Temp"], T), None, NO_WATER),
        RealSet(
            "BME680 hygrometer in a box that gas sensors warm", RH, _nose(["BME_Temp", "BME_Hum"], RH), None, NO_WATER
        ),
        RealSet("hygrometer put on moist soil", RH, hygrometer_on_soil, None, ("evaporative_cooling",)),
        RealSet("CO2 of a chamber on soil for a day", RH, soil_for_a_day, None, dry),
        RealSet("plate that a Peltier element leaves", T, plate_left, None, NO_WATER),
        RealSet("Pt100 in copper on ramps, air from a thermistor", T, ramps, None, dry),
    ]
