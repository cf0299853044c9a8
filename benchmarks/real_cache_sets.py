"""Campaigns from logs that others published, kept outside of this project: each file lies in a cache as published, at
DIR/OWNER/NAME/PATH of its repository on github.

- QuentinRauschenbach/Temperature_Logger @aee1916, data/adjusted/time_TSENSOR_*.LOG: eight DS18B20 probes plunged at
  once from the room into ice water, a reading each 1.15 s
- linnil1/2017_BIME_sensor @2f0e4c1, lab05/lab05log7.txt to 12: an RTD between cold and hot water, six plunges, a
  voltage each 10 ms; the temperatures of the waters stand in its README
- acherrera/arduino_weather_station @4352411, test_data/response_testing/20170414_response_test.txt: a BME280 between a
  flat and its fridge, each second
- lata-mas/Monitor_co2_pistas_educativas @1513a33, data/sensores.csv: CO2 sensors in a box into which CO2 is let and
  that is opened again, each 10 s; the fastest one (SCD30) serves as the measured air
- ellenrpark/optode_response @eb49a4f, data/test_dunk.csv: oxygen optodes moved between two waters, each second
- Gustavo053/tclab-esp32 @d3f55ad, Step_Response.csv, Step_Response_Regression.csv: a heater beside a transistor that
  measures temperature, switched on from rest, each second
- mpc-physical-science/projects @5165d22, labs-testing/cooling/cooling_trials_1.csv: warm water that cools in a film
  canister, three fillings of 16 to 26 g, and the air of the room beside it, each second

What is no temperature goes as a humidity, scaled into its range: oxygen in % of saturation, CO2 in units of 20 ppm.

A second group, found and cut before anything of it was judged:

- Brojowski/uas @0daeb91, cooling_slopes/*.csv: three motors of drones that cool after they were stopped, from their
  hottest on, a reading in degF each 0.7 s
- LukeChannings/gesha @81fbcaa, models/boiler_levels/measurement-history-heat-level-{2..10}.csv: the boiler of a coffee
  machine that cools after heating of nine sizes, and its group head beside it, each 0.1 s of which each tenth is taken
- dhill2522/ChE436-project @7ebdc16, step_test.csv: two heaters with their thermometers, switched on and to half
- oussama-sadki/Temperature-control @767061a, step_test.csv: one such heater, one run, a row a second without times
- AlekseyLobanov/cooling-down @9f85cd5, temperature.txt: five cups of hot water, 16 readings each by hand

Nothing was tuned to either group before it was counted once (`results/real_cache.txt`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from real_sets import RealSet, write_campaign

T, RH = "temperature", "humidity"
COLUMN = {T: "temperature_c", RH: "humidity_percent"}
PPM = 20.0  # of CO2 in a unit of the scale
APART_S = 1e6  # between logs that are put one after the other
NOT_WARMED = ("self_heating", "radiative_heating")
NO_WATER = ("condensation", "evaporative_cooling")
PROBES = ("DF", "DKB", "KM", "KS", "KiS", "LG", "QR", "SimonS")
PLUNGE = "2023-03-02 15:51:20", "2023-03-02 15:58:00"
WATERS_C = ((20.5, 56.0), (55.5, 21.0), (21.0, 76.0), (76.0, 22.0), (21.5, 68.0), (68.0, 22.0))
CO2_IN = ("2021-09-23 16:36", "2021-09-28 15:10", "2021-09-29 15:38")
CO2_OUT = ("2021-09-24 09:13", "2021-09-29 11:14", "2021-09-30 11:25")
CO2_LASTS_S = 2400.0
OPTODES = {"AA4330": ("AA3412", "AA3413", "AA3827"), "RBR": ("rbr210619", "rbr210624")}
INTO_S, LASTS_S = 690.0, 400.0  # of the second move of the optodes
STOPPED_US = 1100.0  # pulses for a motor that stands are 1000 us long
BOILER_LEVELS = range(2, 11)
HEATED_S = ((30.0, 795.0), (780.0, 1205.0))

Log = pd.DataFrame


def join_logs(logs: Sequence[Log]) -> tuple[Log, list[tuple[float, float]]]:
    """Logs one after the other, and where each lies."""
    if not logs:
        raise FileNotFoundError("no log of it was found")
    parts, cuts = [], []
    for i, log in enumerate(logs):
        since = log["time_s"] - log["time_s"].iloc[0] + i * APART_S
        parts.append(log.assign(time_s=since))
        cuts.append((i * APART_S, (i + 0.9) * APART_S))
    return pd.concat(parts, ignore_index=True), cuts


def write_logs(out: Path, channel: str, logs: Sequence[Log]) -> None:
    joined, cuts = join_logs(logs)
    write_campaign(out, channel, joined, cuts)


def _seconds(stamps: pd.Series) -> pd.Series:
    at = pd.to_datetime(stamps)
    return (at - at.iloc[0]).dt.total_seconds()


def probes(cache: Path, out: Path) -> None:
    """Each probe a run, as if one had been plunged eight times."""
    write_logs(out, T, [probe_log(cache, name) for name in PROBES])


def probe_log(cache: Path, name: str) -> Log:
    """The plunge as one of the eight probes has it."""
    path = cache / "QuentinRauschenbach/Temperature_Logger/data/adjusted" / f"time_TSENSOR_{name}.LOG"
    log = pd.read_csv(path, header=None, names=["stamp", "ms", "id", "value"], comment="#")
    log["value"] = pd.to_numeric(log["value"], errors="coerce")
    log = log[pd.to_datetime(log["stamp"]).between(*PLUNGE)].dropna()
    ms = pd.to_numeric(log["ms"])  # the logger's own clock, finer than its stamps
    return pd.DataFrame({"time_s": (ms - ms.iloc[0]) / 1000.0, COLUMN[T]: log["value"]})


def rtd(cache: Path, out: Path) -> None:
    """Volts to degC by one line through all plateaus and the waters' temperatures."""
    folder, period_s = cache / "linnil1/2017_BIME_sensor/lab05", 0.01
    volts = [np.loadtxt(folder / f"lab05log{i}.txt")[:, 2] for i in range(7, 13)]
    ends = [(np.median(v[:100]), np.median(v[-100:])) for v in volts]
    slope, offset = np.polyfit(np.ravel(ends), np.ravel(WATERS_C), 1)
    logs = [pd.DataFrame({"time_s": period_s * np.arange(v.size), COLUMN[T]: slope * v + offset}) for v in volts]
    write_logs(out, T, logs)


def _fridge_log(path: Path) -> Log:
    lines = path.read_text(encoding="utf-8", errors="ignore").splitlines()
    rows = [line.split(",")[:2] for line in lines if line.startswith("2017")]
    log = pd.DataFrame(rows, columns=["stamp", "value"])
    log["value"] = pd.to_numeric(log["value"], errors="coerce")
    stamps = pd.to_datetime(log["stamp"], format="%Y%m%d_%H%M%S", errors="coerce")
    keep = log["value"].notna() & stamps.notna()
    return pd.DataFrame({"time_s": _seconds(stamps[keep]), COLUMN[T]: log["value"][keep]})


def fridge(cache: Path, out: Path) -> None:
    """Moves of one afternoon, each from some two minutes before it."""
    path = cache / "acherrera/arduino_weather_station/test_data/response_testing/20170414_response_test.txt"
    log = _fridge_log(path)
    begins = _moves(log["time_s"].to_numpy(), log[COLUMN[T]].to_numpy())
    ends = [*begins[1:], float(log["time_s"].iloc[-1])]
    cuts = [(a - 60.0, min(b - 90.0, a + 3000.0)) for a, b in zip(begins, ends, strict=True)]
    write_campaign(out, T, log, [cut for cut in cuts if cut[0] > 0.0 and cut[1] - cut[0] > 900.0])


def _moves(time_s: np.ndarray, value: np.ndarray) -> list[float]:
    """Times at which a log turns by more than 0.5 K in a minute after it was quiet, a quarter of an hour apart."""
    even = np.arange(time_s[0], time_s[-1], 10.0)
    smooth = np.interp(even, time_s, value)
    fast = np.abs(smooth[6:] - smooth[:-6]) > 0.5
    slow_before = np.abs(smooth[6:-6] - smooth[:-12]) < 0.25
    found: list[float] = []
    for k in np.flatnonzero(fast[6:] & slow_before):
        at = float(even[k + 6])
        if not found or at - found[-1] > 900.0:
            found.append(at)
    return found


def _co2(sensor: str, begins: Sequence[str]) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        frame = pd.read_csv(cache / "lata-mas/Monitor_co2_pistas_educativas/data/sensores.csv")
        stamps = pd.to_datetime(frame.iloc[:, 0])
        frame["time_s"] = _seconds(stamps)
        log, air = (
            frame[["time_s", one]].dropna().assign(**{COLUMN[RH]: lambda f, one=one: f[one] / PPM})
            for one in (sensor, "scd30")
        )
        starts = [(pd.Timestamp(b) - stamps.iloc[0]).total_seconds() for b in begins]
        cuts = [(s, s + CO2_LASTS_S) for s in starts]
        # Data sheet of the SCD30: 30 ppm and 3 % of the reading.
        known = {"humidity_standard_uncertainty_percent": 2.0}
        columns = ["time_s", COLUMN[RH]]
        write_campaign(out, RH, log[columns], cuts, air[columns], known)

    return make


def _optodes(kind: str) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        frame = pd.read_csv(cache / "ellenrpark/optode_response/data/test_dunk.csv")
        time_s = (frame["UNIXTIME"] - frame["UNIXTIME"].iloc[0]) / 1000.0
        logs = []
        for name in OPTODES[kind]:
            value = frame[f"{name}_O2SAT"]
            keep = value.notna() & time_s.between(INTO_S, INTO_S + LASTS_S)
            logs.append(pd.DataFrame({"time_s": time_s[keep], COLUMN[RH]: value[keep]}))
        write_logs(out, RH, logs)

    return make


def heater(cache: Path, out: Path) -> None:
    """Two powers, each from rest; the second until the power changes."""
    folder = cache / "Gustavo053/tclab-esp32"
    logs = []
    for name, last_s in (("Step_Response.csv", 480.0), ("Step_Response_Regression.csv", 269.0)):
        frame = pd.read_csv(folder / name)
        inside = frame[(frame["Time"] >= 1.0) & (frame["Time"] <= last_s)]  # the first row holds no reading
        logs.append(pd.DataFrame({"time_s": inside["Time"], COLUMN[T]: inside["T1"]}))
    write_logs(out, T, logs)


def canister(cache: Path, out: Path) -> None:
    """Three fillings that cool from the first reading on."""
    path = cache / "mpc-physical-science/projects/labs-testing/cooling/cooling_trials_1.csv"
    table = np.genfromtxt(path, delimiter=",", skip_header=2, encoding="utf-8")
    logs, airs = [], []
    for first in (0, 5, 10):  # a run's columns: time, water, air, and two that follow from these
        for column, kept in ((1, logs), (2, airs)):
            rows = table[np.isfinite(table[:, first]) & np.isfinite(table[:, first + column])]
            kept.append(pd.DataFrame({"time_s": rows[:, first], COLUMN[T]: rows[:, first + column]}))
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0])


def log_since(time_s: np.ndarray, value: np.ndarray, channel: str = T) -> Log:
    """A log whose clock starts with its first reading."""
    return pd.DataFrame({"time_s": time_s - time_s[0], COLUMN[channel]: value})


def _motors(kind: str) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        logs = []
        for path in sorted((cache / "Brojowski/uas/cooling_slopes").glob(f"Spike-{kind}-*.csv")):
            frame = pd.read_csv(path, encoding="utf-8-sig")
            value = (frame["4LHE Temp (ºF)"].to_numpy() - 32.0) / 1.8
            stopped = int(np.flatnonzero(frame["ESC (µs)"] > STOPPED_US)[-1]) + 1
            hottest = stopped + int(np.argmax(value[stopped:]))
            logs.append(log_since(frame["Time (s)"].to_numpy()[hottest:], value[hottest:]))
        write_logs(out, T, logs)

    return make


def _boiler_log(cache: Path, level: int) -> pd.DataFrame:
    """Times [s], the boiler's and the group head's temperature [degC] after one heating, each tenth row."""
    folder = cache / "LukeChannings/gesha/models/boiler_levels"
    return pd.read_csv(folder / f"measurement-history-heat-level-{level}.csv").iloc[::10]


def boiler(cache: Path, out: Path) -> None:
    """It cools from its hottest on."""
    logs = []
    for level in BOILER_LEVELS:
        frame = _boiler_log(cache, level)
        hottest = int(np.argmax(frame["boilerTempC"].to_numpy()))
        logs.append(log_since(frame["time"].to_numpy()[hottest:] / 1000.0, frame["boilerTempC"].to_numpy()[hottest:]))
    write_logs(out, T, logs)


def group_head(cache: Path, out: Path) -> None:
    """The group head follows the boiler, which stands for the measured air."""
    frames = [_boiler_log(cache, level) for level in BOILER_LEVELS]
    logs, airs = (
        [log_since(f["time"].to_numpy() / 1000.0, f[one].to_numpy()) for f in frames]
        for one in ("groupheadTempC", "boilerTempC")
    )
    joined, cuts = join_logs(logs)
    # Data sheet of its converter (MAX31855): 2 K at the most.
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], {"temperature_standard_uncertainty_k": 1.0})


def two_heaters(cache: Path, out: Path) -> None:
    """Each of the two thermometers: switched on from rest, then to half the power."""
    table = np.genfromtxt(cache / "dhill2522/ChE436-project/step_test.csv", delimiter=",", skip_header=1)
    logs = []
    for begin, end in HEATED_S:
        inside = (table[:, 0] >= begin) & (table[:, 0] < end)
        logs += [log_since(table[inside, 0], table[inside, column]) for column in (6, 7)]
    write_logs(out, T, logs)


def one_heater(cache: Path, out: Path) -> None:
    """Power, temperature; a row a second."""
    table = np.loadtxt(cache / "oussama-sadki/Temperature-control/step_test.csv", delimiter=",")
    write_logs(out, T, [log_since(np.arange(float(len(table))), table[:, 1])])


def cups(cache: Path, out: Path) -> None:
    """Lines of all five in turns: clock, number of the cup, temperature."""
    lines = (cache / "AlekseyLobanov/cooling-down/temperature.txt").read_text(encoding="utf-8").splitlines()
    rows = [line.replace(":", " ").split() for line in lines if line.strip()]
    table = np.array([[3600.0 * float(h) + 60.0 * float(m) + float(s), float(c), float(t)] for h, m, s, c, t in rows])
    write_logs(out, T, [log_since(*table[table[:, 1] == cup][:, (0, 2)].T) for cup in range(1, 6)])


def cached_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    return [
        RealSet("eight probes plunged at once", T, probes, None, dry),
        RealSet("RTD between cold and hot water", T, rtd, None, dry),
        RealSet("BME280 between flat and fridge", T, fridge, None, ("radiative_heating", "evaporative_cooling")),
        RealSet("CO2 S8LP in a box, air from SCD30", RH, _co2("s8lp", (*CO2_IN, *CO2_OUT)), None, dry),
        RealSet("CO2 Fluke 975 in a box, air from SCD30", RH, _co2("fluke", CO2_IN), None, dry),
        RealSet("oxygen optodes AA4330", RH, _optodes("AA4330"), None, dry),
        RealSet("oxygen optodes RBR", RH, _optodes("RBR"), None, dry),
        RealSet("heater switched on", T, heater, None, NO_WATER),
        RealSet("water that cools in a canister, air beside it", T, canister, None, NOT_WARMED),
        *(RealSet(f"motor {kind} that cools", T, _motors(kind), None, dry) for kind in ("Mega", "Mini", "P80")),
        RealSet("boiler that cools", T, boiler, None, dry),
        RealSet("group head, the boiler beside it", T, group_head, None, dry),
        RealSet("two heaters on and to half", T, two_heaters, None, NO_WATER),
        RealSet("another lab's heater", T, one_heater, None, NO_WATER),
        RealSet("cups that cool", T, cups, None, NOT_WARMED),
    ]
