"""An eighth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- jesnyder/mycoReactor @da1480e, results/heater/{202602111606,202602111639,202603031510}.csv: an SHT30 over a
  heating pad that is switched on to 40 or 60 degC, three times, each 10 s (MIT)
- yasinovgu/Temperature-Control-Lab @7b6d4bd, Data/step_data.mat: two thermometers of a control course's board, whose
  first heater gets a fifth of its power and then three fifths, each second (no licence stated)
- Prince899/Heat-Transfer-Experimentation @bb633d4, mixedconvectioncooling.txt: three thermometers along a hollow rod of
  copper that was heated and cools in the air of a fan, and one in that air, each 3 s (no licence stated)
- rfirsov04/UT24-Cooling-Prototype @dc6c506, Data/Test {3,4,5,6} - 15A *: sensors on cells of a battery that gives 15 A
  from the first row on and warms the more the emptier it is, without a fan and with three arrangements of fans, each
  second (no licence stated)
- WeissGroupVanderbilt/Response-Time-Reduction @b6de656, TrainingData/FEMExperimentalFitExamples/*.txt: the optical
  response of porous silicon that a protein solution of five concentrations is put on, each 187 s or 107 s (no licence
  stated)
- loanagr/Temperature_sensor @507886a, Tsensor_measurements/files_timeaxis/*.LOG, Tsensor_measurements/
  tsensor_calibration.log: eight DS18B20 in ice water that is warmed by a kelvin in 80 s, each 1.1 s, and a laboratory's
  thermometer beside them, read at each kelvin (no licence stated); they are the probes of `real_cache_sets.py`, after
  the plunge that is judged there
- felypemaciel/temp_control @c66b4b5, serial_output.csv: the extruder of a 3D printer, whose heater gets twice its
  voltage, each 0.05 s (no licence stated)
- jckantor/CBE30338 @9341811, notebooks/data/0B.99-Step_Test_Data.csv: two thermometers of another such board, whose
  first heater is switched on to half of its power, each second (CC BY-NC-ND 4.0)
- scottjames/coffee-roasting @f797287, logs/roast_*.alog: the probe among the beans of a coffee roaster and the one in
  its air, six roasts, each 1.5 s (MIT)

Every cut follows a power, a mark in the log, the other thermometer's clock, or the file itself; none follows the
reading that is judged. What is no temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import APART_S, COLUMN, NO_WATER, NOT_WARMED, RH, Log, T, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_sixth_sets import write_beside
from real_third_sets import stretches
from scipy.io import loadmat

WARMINGS = ("202602111606", "202602111639", "202603031510")
NO_READING_C = -45.0  # what an SHT30 gives for a word of zeros
NO_FAN = "Test 3 - 15A 4S5P No fan/15A_CC_nofan"
FANS = (
    "Test 4 - 15A 4S5P Fan/4S_80mmfan_15A_CC",
    "Test 5 - 15A 4S5P Dual Segment Fan/tempzener15A4S",
    "Test 6 - 15A 4S5P Dual Segment Dual Fan/tempzener15A4Soutlet",
)
# The maker's table of the cells' sensors, as the authors have it in Test4_5_6_Heat_Transfer_Estimation.m.
CELL_C = np.arange(0.0, 61.0, 5.0)
CELL_V = np.array([2.17, 2.11, 2.05, 1.99, 1.92, 1.86, 1.80, 1.74, 1.68, 1.63, 1.59, 1.55, 1.51])
BLOCK = 10  # rows that the authors average: a step of their converter is 0.4 K
SOLUTIONS = ("20g_L", "2g_L", "2e_1g_L", "2e_2g_Ltodo", "2e_3g_Ltodo")
PERCENT_PER_SHIFT, ZERO_PERCENT = 5000.0, 10.0  # the greatest response is 0.0136
PROBES = ("DF", "DKB", "KM", "KS", "KiS", "LG", "QR", "SimonS")
# Its readings are written down as it passes whole degrees, by hand.
BY_HAND_K = {"temperature_standard_uncertainty_k": 0.1}
ROASTS = (
    *("26-05-10_1438_R58_brazil_250", "26-05-17_1235_R59_brazil_250", "26-05-17_1252_R60_sumava_cos"),
    *("26-06-07_1157_R61_sumava", "26-06-07_1217_R62_brazil", "26-07-19_R65_sumava_cos"),
)
CHARGE, DROP = 0, 6  # among the marks of a roast


def pad(cache: Path, out: Path) -> None:
    """From the first row with the heater on to the last before the log says otherwise or the sketch starts anew."""
    logs = []
    for name in WARMINGS:
        path = cache / f"jesnyder/mycoReactor/results/heater/{name}.csv"
        frame = pd.read_csv(path, encoding="latin-1", on_bad_lines="skip")
        phases = stretches(frame["Heater"].to_numpy(str) == "ON")
        frame = frame[next(rows for rows in phases if frame["Heater"][rows.start] == "ON")]
        time_s = pd.to_timedelta(frame["TimeElapsed"]).dt.total_seconds().to_numpy()
        value = pd.to_numeric(frame["Temperature"]).to_numpy()
        there = value > NO_READING_C
        logs.append(log_since(time_s[there], value[there]))
    write_logs(out, T, logs)


def _two_powers(cache: Path) -> tuple[list[Log], list[Log]]:
    """Both thermometers, a run for each power."""
    table = loadmat(cache / "yasinovgu/Temperature-Control-Lab/Data/step_data.mat")["step_data"]
    table = table[1:]  # the first row is no reading
    table[:, 0] = table[:, 0].round(1)
    held = [table[rows] for rows in stretches(table[:, 1])]
    held = [one[np.diff(one[:, 0], prepend=-1.0) > 0.0] for one in held]  # a second stands there twice
    return tuple([log_since(one[:, 0], one[:, k]) for one in held] for k in (3, 4))


def two_powers(cache: Path, out: Path) -> None:
    """The thermometer on the heater that is switched."""
    write_logs(out, T, _two_powers(cache)[0])


def two_powers_beside(cache: Path, out: Path) -> None:
    """The other one, which stays off; the first stands for the measured air."""
    airs, logs = _two_powers(cache)
    write_beside(out, logs, airs)


def rod(cache: Path, out: Path) -> None:
    """The file whole, each thermometer a run."""
    path = cache / "Prince899/Heat-Transfer-Experimentation/mixedconvectioncooling.txt"
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    time_s = pd.to_timedelta([row[0] for row in rows]).total_seconds().to_numpy()
    table = np.array([row[1:] for row in rows], float)
    write_beside(out, [log_since(time_s, table[:, k]) for k in (1, 2, 3)], 3 * [log_since(time_s, table[:, 0])])


def _cells(names: Sequence[str], which: Sequence[int]) -> Callable[[Path, Path], None]:
    """Files whole but for the first row and the end, which were not filled."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            table = loadmat(cache / f"rfirsov04/UT24-Cooling-Prototype/Data/{name}.mat")
            for k in which:
                volts = table[f"voltageA{k}"].ravel()
                volts = volts[volts > 0.0]
                mean = volts[: len(volts) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
                value = np.interp(-mean, -CELL_V, CELL_C)
                logs.append(log_since(BLOCK * np.arange(float(len(value))), value))
        write_logs(out, T, logs)

    return make


def silicon(cache: Path, out: Path) -> None:
    """Files whole; their time runs from the solution's arrival."""
    folder = cache / "WeissGroupVanderbilt/Response-Time-Reduction/TrainingData/FEMExperimentalFitExamples"
    tables = [np.loadtxt(folder / f"{name}.txt") for name in SOLUTIONS]
    write_logs(out, RH, [log_since(one[:, 0], ZERO_PERCENT + PERCENT_PER_SHIFT * one[:, 1], RH) for one in tables])


def warmed_water(cache: Path, out: Path) -> None:
    """From the first reading of the laboratory's thermometer to the last, each probe a run."""
    folder = cache / "loanagr/Temperature_sensor/Tsensor_measurements"
    names = ["stamp", "ms", "id", "value"]
    air = pd.read_csv(folder / "tsensor_calibration.log", comment="#", names=names)
    stamps = pd.to_datetime(air["stamp"], utc=True).dt.tz_localize(None)
    begin, lasts_s = stamps.iloc[0], (stamps.iloc[-1] - stamps.iloc[0]).total_seconds()
    air_log = pd.DataFrame({"time_s": (stamps - begin).dt.total_seconds(), COLUMN[T]: air["value"]})
    logs, airs, cuts = [], [], []
    for i, name in enumerate(PROBES):
        frame = pd.read_csv(folder / f"files_timeaxis/{name}.LOG", comment="#", names=names)
        frame = frame.apply(lambda one: one if one.name in ("stamp", "id") else pd.to_numeric(one, errors="coerce"))
        frame = frame.dropna(subset=["ms", "value"])
        since = (pd.to_datetime(frame["stamp"], format="ISO8601") - begin).dt.total_seconds()
        running_s = frame["ms"] / 1000.0  # the logger's own clock, finer than its stamps
        time_s = running_s + (since - running_s).median()
        inside = time_s.between(0.0, lasts_s)
        logs.append(pd.DataFrame({"time_s": time_s[inside] + i * APART_S, COLUMN[T]: frame["value"][inside]}))
        airs.append(air_log.assign(time_s=air_log["time_s"] + i * APART_S))
        cuts.append((i * APART_S, (i + 0.9) * APART_S))
    write_campaign(out, T, pd.concat(logs), cuts, pd.concat(airs), BY_HAND_K)


def extruder(cache: Path, out: Path) -> None:
    """From the doubling on, each fiftieth row."""
    table = np.loadtxt(cache / "felypemaciel/temp_control/serial_output.csv", delimiter=",", skiprows=1)
    on = table[stretches(table[:, 2])[-1]][::50]
    write_logs(out, T, [log_since(on[:, 1], on[:, 0])])


def _to_half(cache: Path) -> list[Log]:
    """Both thermometers, from the row with which the heater is on."""
    frame = pd.read_csv(cache / "jckantor/CBE30338/notebooks/data/0B.99-Step_Test_Data.csv")
    frame = frame[frame["Q1"] > 0.0]
    return [log_since(frame["Time"].to_numpy(), frame[one].to_numpy()) for one in ("T1", "T2")]


def to_half(cache: Path, out: Path) -> None:
    """The thermometer on the heater."""
    write_logs(out, T, _to_half(cache)[:1])


def to_half_beside(cache: Path, out: Path) -> None:
    """The other one; the first stands for the measured air."""
    airs, logs = _to_half(cache)
    write_beside(out, [logs], [airs])


def roasts(cache: Path, out: Path) -> None:
    """From the mark that beans are put in to the mark that they are let out; the probe in the air is the air."""
    logs, airs = [], []
    for name in ROASTS:
        path = cache / f"scottjames/coffee-roasting/logs/roast_{name}.alog"
        roast = ast.literal_eval(path.read_text(encoding="utf-8"))
        rows = slice(roast["timeindex"][CHARGE], roast["timeindex"][DROP])
        table = np.array([roast["timex"], roast["temp1"], roast["temp2"]]).T[rows]
        table = table[(table[:, 1:] > 0.0).all(axis=1)]  # -1: no answer
        for kept, k in ((airs, 1), (logs, 2)):
            kept.append(log_since(table[:, 0], table[:, k]))
    write_beside(out, logs, airs)


def eighth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    return [
        RealSet("SHT30 over a heating pad", T, pad, None, NO_WATER),
        RealSet("heater at a fifth and at three fifths", T, two_powers, None, NO_WATER),
        RealSet("beside a heater at a fifth and at three fifths", T, two_powers_beside, None, NO_WATER),
        RealSet("copper rod before a fan, air beside it", T, rod, None, NO_WATER),
        RealSet("cells of a battery without a fan", T, _cells((NO_FAN,), (2, 3, 4, 5)), None, NO_WATER),
        RealSet("cell of a battery with three fans", T, _cells(FANS, (2,)), None, NO_WATER),
        RealSet("porous silicon in five solutions", RH, silicon, None, dry),
        RealSet("eight probes in water that is warmed, air beside them", T, warmed_water, None, dry),
        RealSet("extruder to twice its voltage", T, extruder, None, NO_WATER),
        RealSet("another board to half", T, to_half, None, NO_WATER),
        RealSet("beside the heater of another board", T, to_half_beside, None, NO_WATER),
        # Beans dry as they are roasted.
        RealSet("bean probe of a roaster, air from the other probe", T, roasts, None, ("self_heating",)),
    ]
