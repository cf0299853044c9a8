"""A third group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- sjchiass/pitemp @f2ee9b9, data/minmax_1111000011_w30.csv: the processor of a Raspberry Pi in an open case, which a
  script loads until it grows no hotter and rests until it grows no colder, each second (BSD 3-clause)
- SAPSAN-CYBERSEC/uconsole-cm5-thermal-test @35d7171, data/{stress,cooldown,video}.csv: another such processor in a
  closed case after idling, after load and after rest, each 5 s (CC BY 4.0)
- aceisScope/pidtunning @c535499, cooldown_20130419_*.csv, warmup_20130419_13.58.50.csv: a cold finger that a Peltier
  element cools with full current or leaves, and the detector on it, each second (no licence stated)
- rupakrokade/sbhs-manual @5aad482, Step-test_manual/step1.dat, step2.dat, step_data: a small plate between heater and
  fan, whose heater is stepped, each second or 0.1 s (no licence stated)
- concavegit/toasty-blanket @c73c26c, data/heatingTemps.csv, coolingTemps.csv: a thermistor in a heated blanket, each
  0.9 s (no licence stated)
- Biological-Microsystems-Laboratory/3d-printed-oxygen-control-insert @c3db85e,
  data/{150805,150807,150812}/analyzed-oxygen-values-*.csv: oxygen at the bottom of wells whose rows get gases of 0, 5,
  10 and 21 %, three trials, each 5 min (MIT)
- RonakornST/EE436_Lab_Control @5c98e6d, P1/data_thermal_pulse.txt: a heated process of a control course (TecQuipment
  CE2000), heater on and off in turns, each 0.07 s (no licence stated)
- INTO-CPS-Association/example_digital-twin_incubator @2f08c4f,
  software/incubator/datasets/20230501_calibration_empty_system/20230501_calibration_empty_system.csv: air in a box
  that a controller heats on and off, each 3 s (no licence stated)
- kmiikki/sensors @d49747d, calibration_tools/rh-analysis/cal/merged-20250407-114016.csv and
  calibration_tools/thp-t-flats/analysis-t/merged-20250129-132716.csv: BME280 beside a reference probe in air of ten
  levels of humidity, and of three of temperature, each second (MIT)

Every cut follows the log's own labels, its clock or what its authors wrote; none follows the reading that is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign

CYCLES = 6  # of the Raspberry Pi, of load and of rest each: the first that the log has
WELLS_EVERY_S = 300.0
GASES = 3  # rows of wells whose gas changes: the fourth gets the 21 % that all start with
TRIALS = ("150805", "150807", "150812")
PHASES = 10  # of the incubator: the first that its controller made
DEGC_PER_V = 10.0  # of the heated process, whose log is in volts: a scale only
RH_LEVELS, T_LEVELS = 10, 3  # as many as the authors list (rh1-ranks.txt, t1-ranks.txt)
KELVIN = 273.15


def stretches(label: np.ndarray) -> list[slice]:
    """Rows between two changes of a label."""
    edges = np.flatnonzero(label[1:] != label[:-1]) + 1
    return [slice(a, b) for a, b in pairwise([0, *edges.tolist(), label.size])]


def pi_cycles(cache: Path, out: Path) -> None:
    """Phases as the script labels them. The first rest is left out: it began at rest."""
    frame = pd.read_csv(cache / "sjchiass/pitemp/data/minmax_1111000011_w30.csv")
    stamps = pd.to_datetime(frame["datetime"])
    time_s = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
    label, value = frame["obs_type"].to_numpy(str), frame["temp"].to_numpy()
    phases = [rows for rows in stretches(label) if label[rows.start] in ("warmup", "cooldown")]
    write_logs(out, T, [log_since(time_s[rows], value[rows]) for rows in phases[1 : 1 + 2 * CYCLES]])


def console(cache: Path, out: Path) -> None:
    """A file for each phase; that of idling alone has no step."""
    folder = cache / "SAPSAN-CYBERSEC/uconsole-cm5-thermal-test/data"
    frames = [pd.read_csv(folder / f"{name}.csv") for name in ("stress", "cooldown", "video")]
    write_logs(out, T, [log_since(f["t_s"].to_numpy(float), f["temp_c"].to_numpy()) for f in frames])


def _finger_logs(cache: Path) -> list[tuple[Log, Log]]:
    """Cold finger and detector, a file each run: the element is switched with its first row."""
    names = ("cooldown_20130419_13.24.44", "cooldown_20130419_15.45.06", "warmup_20130419_13.58.50")
    tables = [pd.read_csv(cache / f"aceisScope/pidtunning/{name}.csv", header=None) for name in names]
    return [tuple(log_since(t[2].to_numpy(), t[k].to_numpy()) for k in (3, 4)) for t in tables]


def finger(cache: Path, out: Path) -> None:
    """What the element cools."""
    write_logs(out, T, [log for log, _ in _finger_logs(cache)])


def detector(cache: Path, out: Path) -> None:
    """What lies on the finger, which stands for the measured air."""
    logs = _finger_logs(cache)
    joined, cuts = join_logs([log for _, log in logs])
    # At rest before the first cooling the two differ by 2 K; no data sheet is known.
    known = {"temperature_standard_uncertainty_k": 1.0}
    write_campaign(out, T, joined, cuts, join_logs([air for air, _ in logs])[0], known)


def plate(cache: Path, out: Path) -> None:
    """A run for each power of the heater that is not nil. Of the log at 10 Hz each tenth row is taken, as of others."""
    logs = []
    for name, every in (("step1.dat", 1), ("step2.dat", 1), ("step_data", 10)):
        text = (cache / "rupakrokade/sbhs-manual/Step-test_manual" / name).read_text(encoding="utf-8")
        # What is left of a program's matrix around the rows of one file.
        table = np.loadtxt(text.replace("data7=[", "").replace("];", "").splitlines())
        time_s, power, _, value = table.T
        # A lone row at the head of step2 still has the power of step1.
        held = [rows for rows in stretches(power) if power[rows.start] > 0.0 and rows.stop - rows.start > 1]
        logs += [log_since(time_s[rows][::every], value[rows][::every]) for rows in held]
    write_logs(out, T, logs)


def blanket(cache: Path, out: Path) -> None:
    """Both files whole; their time runs from the switching."""
    folder = cache / "concavegit/toasty-blanket/data"
    frames = [pd.read_csv(folder / f"{name}.csv") for name in ("heatingTemps", "coolingTemps")]
    write_logs(out, T, [log_since(f["t"].to_numpy(), f["T"].to_numpy() - KELVIN) for f in frames])


def wells(cache: Path, out: Path) -> None:
    """The first well of each row of six, all rows of the table; the gas was changed after the third."""
    folder = cache / "Biological-Microsystems-Laboratory/3d-printed-oxygen-control-insert/data"
    logs = []
    for trial in TRIALS:
        # One of the files ends its lines as old Macintoshes did.
        text = (folder / trial / f"analyzed-oxygen-values-{trial}.csv").read_text(encoding="utf-8")
        table = np.loadtxt(text.splitlines(), delimiter=",")
        time_s = WELLS_EVERY_S * np.arange(float(len(table)))
        logs += [log_since(time_s, table[:, 6 * row], RH) for row in range(GASES)]
    write_logs(out, RH, logs)


def process(cache: Path, out: Path) -> None:
    """First sensor, a run each time the heater's input changes; each fifth row. The log ends early in a seventh."""
    path = cache / "RonakornST/EE436_Lab_Control/P1/data_thermal_pulse.txt"
    table = np.loadtxt(path, skiprows=5)[:-1]  # the last row is nil in all columns
    time_s, value, _, power = table.T
    logs = [log_since(time_s[rows][::5], DEGC_PER_V * value[rows][::5]) for rows in stretches(power)[:-1]]
    write_logs(out, T, logs)


def incubator(cache: Path, out: Path) -> None:
    """A run each time the controller switches, from its first heating on."""
    folder = cache / "INTO-CPS-Association/example_digital-twin_incubator/software/incubator/datasets"
    frame = pd.read_csv(folder / "20230501_calibration_empty_system/20230501_calibration_empty_system.csv")
    time_s, value = frame["time_t1"].to_numpy(float) / 1e9, frame["t1"].to_numpy()
    phases = stretches(frame["heater_on"].to_numpy())[1 : 1 + PHASES]
    write_logs(out, T, [log_since(time_s[rows], value[rows]) for rows in phases])


def _merged(path: Path, names: Sequence[str]) -> tuple[pd.DataFrame, np.ndarray]:
    """Columns with the clock before them, and the clock."""
    frame = pd.read_csv(path)
    return frame[["Time (s)", *names]].rename(columns={"Time (s)": "time_s"}), frame["Time (s)"].to_numpy()


def _equal_parts(time_s: np.ndarray, parts: int) -> list[tuple[float, float]]:
    """The times of the steps are not written down, the air is: the record in as many equal parts as it has levels."""
    return list(pairwise(np.linspace(time_s[0], time_s[-1] + 1.0, parts + 1).tolist()))


def humid(cache: Path, out: Path) -> None:
    """The first BME280, with its own temperature beside."""
    path = cache / "kmiikki/sensors/calibration_tools/rh-analysis/cal/merged-20250407-114016.csv"
    frame, time_s = _merged(path, ("RH1% (%)", "t1 (°C)", "RHref (%RH)"))
    log = frame.rename(columns={"RH1% (%)": COLUMN[RH], "t1 (°C)": COLUMN[T]})[["time_s", COLUMN[RH], COLUMN[T]]]
    air = frame.rename(columns={"RHref (%RH)": COLUMN[RH]})[["time_s", COLUMN[RH]]]
    # Data sheets of such probes promise 1 %RH.
    write_campaign(out, RH, log, _equal_parts(time_s, RH_LEVELS), air, {"humidity_standard_uncertainty_percent": 1.0})


def slow_reference(cache: Path, out: Path) -> None:
    """Of the two the authors call the reference the slower (algorithm.md): the BME280 stands for the measured air."""
    path = cache / "kmiikki/sensors/calibration_tools/thp-t-flats/analysis-t/merged-20250129-132716.csv"
    frame, time_s = _merged(path, ("t1 (°C)", "Tref (°C)"))
    log, air = (frame.rename(columns={one: COLUMN[T]})[["time_s", COLUMN[T]]] for one in ("Tref (°C)", "t1 (°C)"))
    # Data sheet of the BME280: 1 K at the most.
    write_campaign(out, T, log, _equal_parts(time_s, T_LEVELS), air, {"temperature_standard_uncertainty_k": 0.5})


def third_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    return [
        RealSet("Raspberry Pi between load and rest", T, pi_cycles, None, NO_WATER),
        RealSet("console under load and after", T, console, None, NO_WATER),
        RealSet("cold finger", T, finger, None, NOT_WARMED),
        RealSet("detector, the cold finger beside it", T, detector, None, NOT_WARMED),
        RealSet("plate between heater and fan", T, plate, None, NO_WATER),
        RealSet("heated blanket", T, blanket, None, NO_WATER),
        RealSet("oxygen in wells", RH, wells, None, dry),
        RealSet("heated process in pulses", T, process, None, NO_WATER),
        RealSet("incubator on and off", T, incubator, None, NO_WATER),
        RealSet("BME280 in ten humidities, air from a reference", RH, humid, None, ("evaporative_cooling",)),
        RealSet("reference thermometer, air from a BME280", T, slow_reference, None, dry),
    ]
