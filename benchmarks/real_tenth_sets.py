"""A tenth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- robwiss/analyze_cadr @617713a, sds011/data_mesh/20220{805a,805b,805c,806a,806b}_GermGuardian_CDAP4500BCA_5_spd.csv,
  pms5003/data_mesh/20220705{c..k}_4_ArcticP14_4_Starkvind_100_pwr.csv, pms5003/data_{jet/20220623,mesh/20220712,
  smoke/20220712}_ACH_vd.csv: dust sensors in a chamber full of salt or smoke, whose air is cleaned or left, each second
  (MIT)
- rosiekrasnoff/CEE4530 @28a08fa, Lab5-Reactor Characteristics/reactor data/trial {1..4}.xls: a photometer behind a
  stirred tank with and without baffles into which dye was poured, each 5 s; Lab2-Acid Rain/Lab_2_Acid_Rain.xls,
  Lab_2_Acid_rain_with_half_ANC.xls: a pH probe in a stirred tank that acid runs into, each 5 s (text, for all their
  name; no licence stated)
- FelixYuHengYang/CEE4530 @877fad3, Lab 5 - Reactors/Files/Exp{2,3,4}.txt: the same of another group, whose baffles have
  holes, each second (no licence stated)
- LMWB/Quattro-Stagioni @51c7658, Testing/{ds18b20,pt1000}-log.csv: a DS18B20 and a PT1000, held together by a rubber
  band, in a pitcher of hot water that cools, and two more in the air beside it, each 5 s (MIT)
- mochiim/H22 @4b1fc5c, termokopper.txt: hot drink in a mug whose wall melts and freezes again, each 0.5 s (no licence
  stated)
- deets/beehive-monitor @0208232, calibration-data/*.data and 2020-10-30-humidity-test-with-silica/*.TXT: eight SHT3x
  of a beehive in a box that a hot bottle or cup warmed, each 8 to 16 s, or that was dried with silica gel, each 90 s
  (MIT)
- COAST-Lab/c3po @207abcd, Calibrations/Intercomparison Experiment/C3PO_6/2026_07_30_C3PO6.csv and the YSI's file beside
  it: the thermometer of a conductivity logger and of a multiprobe in a bath whose set point is changed, each 20 s and
  10 s (MIT)
- APMonitor/arduino @f36e65a, 2_Regression/1st_order_SISO/APM_Python_with_stats/data.csv: a heated transistor of a
  control course at three powers in turn, each second, in degF (Apache 2.0)

Cuts follow a power, a note, a limit of the counter, or the rows that the authors themselves begin with. Where none
tells it, they follow what a plot shows: the highest reading of a dye or a drink, when the bottle was put in and, two
minutes before the note says so, taken out, and when the dried box was opened. What is no temperature goes as a
humidity, scaled into its range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_sixth_sets import write_beside
from real_third_sets import stretches

CLEANER = "sds011/data_mesh/20220{}_GermGuardian_CDAP4500BCA_5_spd.csv"
CLEANED = ("805a", "805b", "805c", "806a", "806b")
BEGUN_UG_M3 = 500.0  # where the authors' own evaluation begins
FANS = tuple(f"data_mesh/20220705{one}_4_ArcticP14_4_Starkvind_100_pwr" for one in "cdefghijk")
LEFT_ALONE = ("data_jet/20220623_ACH_vd", "data_mesh/20220712_ACH_vd", "data_smoke/20220712_ACH_vd")
COUNTER_LIMIT = 65535
CLEAN_PERCENT, PERCENT_PER_UG_M3, PERCENT_PER_COUNT = 10.0, 0.1, 0.001
TANKS = "rosiekrasnoff/CEE4530/Lab5-Reactor Characteristics/reactor data/trial {}.xls"
BAFFLES = "FelixYuHengYang/CEE4530/Lab 5 - Reactors/Files/Exp{}.txt"
DAY_LENGTH_S = 86400.0
DYE_PERCENT, PERCENT_PER_PH = 2.0, 10.0  # of 1 mg/L, of 1
ACID_RAIN = {"Lab_2_Acid_Rain": 26, "Lab_2_Acid_rain_with_half_ANC": 17}  # and the rows that the authors begin with
PITCHER_FIELDS = {"ds18b20": (6, 9), "pt1000": (10, 15)}  # of the thermometer in the water and of one in the air
# An SHT3x gives words of 16 bits.
WORD, SHT_SPAN_C, SHT_ZERO_C = 65535.0, 175.0, -45.0
HIVE_SENSORS = ("0444", "0445", "0544", "0545", "0644", "0645", "0744", "0745")
# UTC, of the notes in local time: when the bottle was taken out, or the log begins after it, and when all ended.
BOTTLE_OUT = (
    ("hot-bottle-insulated", "2021-10-03T19:43", "2021-10-03T21:05"),
    ("2021-10-11-hot-bottle-insulated", "2021-10-11T15:08", "2021-10-11T16:36"),
    ("2021-10-12-hot-bottle-insulated", "2021-10-12T09:55", "2021-10-12T10:57"),
)
CUP_OUT = ("hot-cup-insulated", "2021-10-03T17:12", "2021-10-03T19:02")
BOTTLE_IN = ("2021-10-12-hot-bottle-insulated", "2021-10-12T09:27", "2021-10-12T09:53")
DRIED = ("2021-10-27T09:30", "2021-10-28T09:15")  # from when the box was opened to the last row
# The logger's clock starts when it is plugged in.
PLUGGED_IN, CLOCK_STARTS = pd.Timestamp("2026-07-29 09:26:15"), 946684800
BATH = (
    ("2026-07-29 10:11:30", "2026-07-29 10:45:00"),
    ("2026-07-29 10:45:00", "2026-07-29 12:34:00"),
    ("2026-07-29 13:15:20", "2026-07-30 13:35:00"),
)
MULTIPROBE_K = {"temperature_standard_uncertainty_k": 0.1}


def _dusty(frame: pd.DataFrame, column: str, begin: int, every: int, scale: float) -> Log:
    rows = frame.iloc[begin::every]
    return log_since(rows["time"].to_numpy(), CLEAN_PERCENT + scale * rows[column].to_numpy(float), RH)


def cleaned(cache: Path, out: Path) -> None:
    """From the first row below the authors' limit after the maximum."""
    logs = []
    for one in CLEANED:
        frame = pd.read_csv(cache / "robwiss/analyze_cadr" / CLEANER.format(one))
        value = frame["pm2.5"].to_numpy()
        top = int(np.argmax(value))
        begin = top + int(np.flatnonzero(value[top:] <= BEGUN_UG_M3)[0])
        logs.append(_dusty(frame, "pm2.5", begin, 1, PERCENT_PER_UG_M3))
    write_logs(out, RH, logs)


def _counted(names: Sequence[str], every: int) -> Callable[[Path, Path], None]:
    """After the last row at the counter's limit."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            frame = pd.read_csv(cache / f"robwiss/analyze_cadr/pms5003/{name}.csv")
            begin = int(np.flatnonzero(frame[">0.3"] >= COUNTER_LIMIT)[-1]) + 1
            logs.append(_dusty(frame, ">0.3", begin, every, PERCENT_PER_COUNT))
        write_logs(out, RH, logs)

    return make


def _bench_table(path: Path, first: int = 0) -> np.ndarray:
    """Seconds of the day and the first probe, from a row on (notes are rows too), notes left out."""
    frame = pd.read_csv(path, sep="\t").iloc[first:, :2].apply(pd.to_numeric, errors="coerce").dropna()
    frame = frame.drop_duplicates(frame.columns[0])  # the logger repeats a stamp here and there
    return frame.to_numpy() * (DAY_LENGTH_S, 1.0)


def _washed_out(pattern: str, names: Sequence[int], every: int) -> Callable[[Path, Path], None]:
    """From the most dye on."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            table = _bench_table(cache / pattern.format(name))
            table = table[int(np.argmax(table[:, 1])) :: every]
            logs.append(log_since(table[:, 0], DYE_PERCENT * table[:, 1], RH))
        write_logs(out, RH, logs)

    return make


def acid(cache: Path, out: Path) -> None:
    """From the authors' own first row to the end."""
    logs = []
    for name, first in ACID_RAIN.items():
        table = _bench_table(cache / f"rosiekrasnoff/CEE4530/Lab2-Acid Rain/{name}.xls", first)
        logs.append(log_since(table[:, 0], PERCENT_PER_PH * table[:, 1], RH))
    write_logs(out, RH, logs)


def pitcher(cache: Path, out: Path) -> None:
    """Files whole, each twelfth row; milliseconds and thousandths of a degree."""
    logs, airs = [], []
    for name, (water, air) in PITCHER_FIELDS.items():
        text = (cache / f"LMWB/Quattro-Stagioni/Testing/{name}-log.csv").read_text(encoding="utf-8")
        rows = [line.split(",") for line in text.splitlines() if line.startswith("tick")]
        table = np.array([[row[1], row[water], row[air]] for row in rows if len(row) > air], float)[::12] / 1000.0
        for kept, k in ((logs, 1), (airs, 2)):
            kept.append(log_since(table[:, 0], table[:, k]))
    write_beside(out, logs, airs)


def mug(cache: Path, out: Path) -> None:
    """From the hottest on, each tenth row."""
    table = np.loadtxt(cache / "mochiim/H22/termokopper.txt")[:, (0, 2)]
    table = table[int(np.argmax(table[:, 1])) :: 10]
    write_logs(out, T, [log_since(table[:, 0], table[:, 1])])


def _hive_log(lines: Sequence[str], sensor: str, begin: str, end: str) -> Log:
    """Temperature and humidity of one sensor between two times."""
    rows = []
    for line in lines:
        head, *found = line.split(";")
        word = next((one.split(",") for one in found if one.startswith(sensor)), None)
        if word is not None:
            rows.append((head.split(",")[1][:19], int(word[1][1:], 16), int(word[2][1:], 16)))
    frame = pd.DataFrame(rows, columns=["stamp", "t", "h"])
    frame = frame.sort_values("stamp").drop_duplicates("stamp")  # two windows wrote into one file at times
    stamps = pd.to_datetime(frame["stamp"])
    frame = frame[(stamps >= pd.Timestamp(begin)) & (stamps < pd.Timestamp(end))]
    since = (stamps[frame.index] - pd.Timestamp(begin)).dt.total_seconds().to_numpy()
    log = log_since(since, SHT_ZERO_C + SHT_SPAN_C * frame["t"].to_numpy() / WORD)
    return log.assign(**{COLUMN[RH]: 100.0 * frame["h"].to_numpy() / WORD})


def _hive(cuts: Sequence[tuple[str, str, str]], sensors: Sequence[str], channel: str) -> Callable[[Path, Path], None]:
    """A run for each cut and sensor; a hygrometer has its own temperature beside it."""

    def make(cache: Path, out: Path) -> None:
        columns = ["time_s", COLUMN[T]] if channel == T else ["time_s", COLUMN[T], COLUMN[RH]]
        logs = []
        for name, begin, end in cuts:
            path = cache / f"deets/beehive-monitor/calibration-data/{name}.data"
            lines = path.read_text(encoding="ascii").splitlines()
            logs += [_hive_log(lines, one, begin, end)[columns] for one in sensors]
        write_logs(out, channel, logs)

    return make


def dried(cache: Path, out: Path) -> None:
    """Each sensor a run; the card's lines have the sensors' addresses in two fields."""
    folder = cache / "deets/beehive-monitor/calibration-data/2020-10-30-humidity-test-with-silica"
    lines = []
    for path in sorted(folder.glob("*.TXT")):
        for line in path.read_text(encoding="ascii").splitlines():
            field = line.rstrip(", ").split(",")
            if line.startswith("#V2") and len(field) > 4 * len(HIVE_SENSORS):
                words = [f"{a}{b},{t},{h}" for a, b, h, t in zip(*(field[k::4] for k in (3, 4, 5, 6)), strict=True)]
                lines.append(";".join([f"{field[1]},{field[2]}", *words]))
    write_logs(out, RH, [_hive_log(lines, one, *DRIED) for one in HIVE_SENSORS])


def bath(cache: Path, out: Path) -> None:
    """A run for each set point but the first and but the minutes after salt was added; each third row."""
    folder = cache / "COAST-Lab/c3po/Calibrations/Intercomparison Experiment"
    text = next(folder.glob("Kor Measurement File Export*")).read_text(encoding="utf-16")
    air = pd.read_csv(StringIO(text[text.index("TIME (h:mm") :]))
    air["stamp"] = pd.to_datetime(air.iloc[:, 1] + " " + air.iloc[:, 0], format="%m/%d/%Y %I:%M:%S %p")
    air = air.sort_values("stamp").drop_duplicates("stamp")
    frame = pd.read_csv(folder / "C3PO_6/2026_07_30_C3PO6.csv").apply(pd.to_numeric, errors="coerce").dropna()
    frame = frame.iloc[int(np.flatnonzero(frame["Real_Time"].diff() < 0.0)[-1]) :]  # since it was plugged in last
    frame["stamp"] = PLUGGED_IN + pd.to_timedelta(frame["Real_Time"] - CLOCK_STARTS, unit="s")
    logs, airs = [], []
    for begin, end in BATH:
        for kept, table, reading in ((logs, frame, "Temp_C"), (airs, air, "TEMP °C")):
            rows = table[(table["stamp"] >= pd.Timestamp(begin)) & (table["stamp"] < pd.Timestamp(end))].iloc[::3]
            since = (rows["stamp"] - pd.Timestamp(begin)).dt.total_seconds().to_numpy()
            kept.append(pd.DataFrame({"time_s": since, COLUMN[T]: rows[reading].to_numpy(float)}))
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], MULTIPROBE_K)


def transistor(cache: Path, out: Path) -> None:
    """A run for each power but the rest before the first."""
    frame = pd.read_csv(cache / "APMonitor/arduino/2_Regression/1st_order_SISO/APM_Python_with_stats/data.csv")
    value = (frame["temperature"].to_numpy() - 32.0) / 1.8
    held = stretches(frame["voltage"].to_numpy())[1:]
    write_logs(out, T, [log_since(frame["time"].to_numpy(float)[rows], value[rows]) for rows in held])


def tenth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry, dark, one = (*NOT_WARMED, *NO_WATER), ("radiative_heating",), HIVE_SENSORS[:1]
    return [
        RealSet("dust sensor, an air cleaner on", RH, cleaned, None, dry),
        RealSet("dust counter, fans before filters", RH, _counted(FANS, 1), None, dry),
        RealSet("dust counter, dust that settles", RH, _counted(LEFT_ALONE, 5), None, dry),
        RealSet("dye that leaves tanks with and without baffles", RH, _washed_out(TANKS, (1, 2, 3, 4), 1), None, dry),
        RealSet("dye that leaves tanks whose baffles have holes", RH, _washed_out(BAFFLES, (2, 3, 4), 5), None, dry),
        RealSet("pH of a tank that acid runs into", RH, acid, None, dry),
        RealSet("pitcher of hot water, air beside it", T, pitcher, None, NOT_WARMED),
        RealSet("mug whose wall melts", T, mug, None, NOT_WARMED),
        RealSet("SHT3x in a box, bottle or cup taken out", T, _hive((CUP_OUT, *BOTTLE_OUT), one, T), None, dark),
        RealSet("humidity in a box, bottle taken out", RH, _hive(BOTTLE_OUT, one, RH), None, dark),
        RealSet("eight SHT3x in a box, bottle put in", T, _hive((BOTTLE_IN,), HIVE_SENSORS, T), None, NO_WATER),
        RealSet("eight SHT3x in a box after silica gel", RH, dried, None, (*dark, *NO_WATER)),
        RealSet("thermometer in a bath, air from a multiprobe", T, bath, None, dry),
        RealSet("heated transistor at three powers", T, transistor, None, NO_WATER),
    ]
