"""A fourth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- 100prznt/TemperatureProbeQualification @b44ad91, Runs/010_DS18B20_ORG/TempLog.csv and
  Runs/004/TempLog_2021-1-17_18-29.csv: a DS18B20 and a Pt100 in a dry block that goes from 0 to 105 degC in steps of
  15 K, with the block's own reading, each 4 s (CC0 1.0)
- FNR13/TCLab-Predictive-Control @87a1c44, Code/P3/matfiles/openloop_data_train.mat: two heaters with their
  thermometers, of which one heater is set to eight powers in turn, each 5 s (no licence stated)
- dowlinglab/pyomo-doe @4feb3bd, data/validation_experiment_env_2_step_50_run_{1,2,3}.csv: another lab's heater,
  switched on to half of its power three times, each second (BSD 3-clause)
- JohanOlson1/Heat-transfer-in-a-Cup @487ef0b, Ny mapp/small_exp{1..5}.txt: hot water in a small beaker, five fillings
  that cool from 80 degC, by hand each 30 s (no licence stated)
- AguaClara/Dissolved-Gas @942fb98, Data/Testing{Hot,Cold,Maximum,Minimum}Temperature*.xls (text, for all their name):
  a probe in a vessel through which a tap runs, hot or cold, each 5 s (no licence stated)
- keatoncable/Heat-Transfer-Lab @52f0aed, {Sphere,Cube}_{Natural,Forced}.txt: a sphere of steel and a cube that are
  taken from ice into the air of a room, still and from a fan, each 0.02 s (no licence stated)
- cellularmitosis/logs @31b3970, 20180115-tec-calibration/run3/controller.csv: a small chamber that a Peltier element
  holds at a set point, which goes up by 1 K each 5 min and back by 10 K (MIT)
- AminDar/CO2-Sensors @6a734a2, Co2-Record-Evaluate/Raw/measure241007_124139.csv: four CO2 sensors in a room that is
  filled and then aired, each 1 to 10 s (MIT)
- myphysicslabathome/Water-Cooling-Curve @e9d5ef9, Water Cooling {Without,With} Fan.dat: a PT1000 in hot water that
  cools, each second (CC BY 4.0)
- martinxyz/um-hotend-sim @8a5e26c, coldstart.txt and temptests.txt: the nozzle of a 3D printer that cools, once
  without and once with a fan, each 0.1 s (no licence stated)

Every cut follows a set point, a note or a label in the log, or the file itself; none follows the reading judged.
What is no temperature goes as a humidity, as in `real_cache_sets.py`: CO2 in units of 40 ppm.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_third_sets import stretches
from scipy.io import loadmat

# On the plateaus the Pt100 and the block's own reading differ by up to 0.3 K.
BLOCK_K = {"temperature_standard_uncertainty_k": 0.2}
BLOCK_COLUMNS = {"004": ("stamp", "set", "block", "pt100", "dut"), "010": ("set", "stamp", "block", "pt100", "dut")}
# The authors' README: 2 K at the most for these thermometers.
HEATERS_K = {"temperature_standard_uncertainty_k": 1.0}
FILLINGS = range(1, 6)
DAY_S = 86400.0
TAPS = ("Hot", "Cold", "Maximum", "Minimum")
HOLD_S = 300.0  # of each set point of the chamber, which its log has no times for
PPM = 40.0  # of CO2 in a unit of the scale


def _block_logs(path: Path, run: str, read: str, air: str) -> tuple[list[Log], list[Log]]:
    """A run for each set point; rows before the first have none."""
    frame = pd.read_csv(path, header=0, names=BLOCK_COLUMNS[run], encoding="latin-1")
    stamps = pd.to_datetime(frame["stamp"], format="%d.%m.%Y %H:%M:%S")
    time_s = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
    held = [rows for rows in stretches(frame["set"].fillna(-1.0).to_numpy()) if frame["set"].notna()[rows.start]]
    return tuple([log_since(time_s[rows], frame[one].to_numpy()[rows]) for rows in held] for one in (read, air))


def _block(run: str, name: str, read: str, air: str) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        logs, airs = _block_logs(cache / "100prznt/TemperatureProbeQualification/Runs" / name, run, read, air)
        joined, cuts = join_logs(logs)
        write_campaign(out, T, joined, cuts, join_logs(airs)[0], BLOCK_K)

    return make


def _powers(cache: Path) -> tuple[list[Log], list[Log]]:
    """Both thermometers, a run for each power; the first of twice the length."""
    table = loadmat(cache / "FNR13/TCLab-Predictive-Control/Code/P3/matfiles/openloop_data_train.mat")
    time_s, power = table["t"].ravel().astype(float), table["u"][0]
    return tuple([log_since(time_s[rows], y[rows]) for rows in stretches(power)] for y in table["y"])


def eight_powers(cache: Path, out: Path) -> None:
    """The heater that is stepped."""
    write_logs(out, T, _powers(cache)[0])


def neighbour(cache: Path, out: Path) -> None:
    """The other heater stays off: its thermometer follows the first, which stands for the measured air."""
    airs, logs = _powers(cache)
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], HEATERS_K)


def half_power(cache: Path, out: Path) -> None:
    """Each file whole; the heater is on from its first row."""
    folder = cache / "dowlinglab/pyomo-doe/data"
    frames = [pd.read_csv(folder / f"validation_experiment_env_2_step_50_run_{k}.csv") for k in (1, 2, 3)]
    write_logs(out, T, [log_since(f["Time"].to_numpy(), f["T1"].to_numpy()) for f in frames])


def beaker(cache: Path, out: Path) -> None:
    """Each file whole."""
    folder = cache / "JohanOlson1/Heat-transfer-in-a-Cup/Ny mapp"
    tables = [np.loadtxt(folder / f"small_exp{k}.txt", skiprows=1) for k in FILLINGS]
    write_logs(out, T, [log_since(table[:, 0], table[:, 1]) for table in tables])


def _tap_log(path: Path) -> Log | None:
    """Rows after the last note that a trial starts, at which the tap is turned on; none where nobody noted it."""
    lines = path.read_text(encoding="utf-8").splitlines()
    column = lines[0].split("\t").index("Temperature In (C)")
    started = [i for i, line in enumerate(lines) if "start" in line.lower()]
    if not started:
        return None
    rows = [line.split("\t") for line in lines[started[-1] + 1 :] if line[:1].isdigit()]
    table = np.array([[float(row[0]), float(row[column])] for row in rows])
    return log_since(DAY_S * table[:, 0], table[:, 1])


def tap(cache: Path, out: Path) -> None:
    """A file each time the tap was turned on, in the order of their names."""
    folder = cache / "AguaClara/Dissolved-Gas/Data"
    paths = sorted(path for one in TAPS for path in folder.glob(f"Testing{one}Temperature*.xls"))
    write_logs(out, T, [log for log in map(_tap_log, paths) if log is not None])


def _steel(body: str) -> Callable[[Path, Path], None]:
    """Both files whole, each fiftieth row."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for air in ("Natural", "Forced"):
            lines = (cache / f"keatoncable/Heat-Transfer-Lab/{body}_{air}.txt").read_text(encoding="utf-8").splitlines()
            head = next(i for i, line in enumerate(lines) if line.startswith("X_Value"))
            table = np.loadtxt(lines[head + 1 :], usecols=(0, 1))[::50]
            logs.append(log_since(table[:, 0], table[:, 1]))
        write_logs(out, T, logs)

    return make


def chamber(cache: Path, out: Path) -> None:
    """A run for each set point but that at which it began, each fourth row. Rows in 5 min are the clock."""
    path = cache / "cellularmitosis/logs/20180115-tec-calibration/run3/controller.csv"
    table = np.loadtxt(path, delimiter=",")
    held = stretches(table[:, 0])
    time_s = HOLD_S / (held[0].stop - held[0].start) * np.arange(float(len(table)))
    write_logs(out, T, [log_since(time_s[rows][::4], table[rows, 1][::4]) for rows in held[1:]])


def aired_room(cache: Path, out: Path) -> None:
    """Filling and airing of each sensor, as if one had been there; blank rows are between the two."""
    frame = pd.read_csv(
        cache / "AminDar/CO2-Sensors/Co2-Record-Evaluate/Raw/measure241007_124139.csv",
        sep=";",
        skip_blank_lines=False,
    )
    stamps = pd.to_datetime(frame["Time"], errors="coerce")
    there = stamps.notna().to_numpy()
    time_s = (stamps - stamps[there].iloc[0]).dt.total_seconds().to_numpy()
    phases = [rows for rows in stretches(there) if there[rows.start]]
    values = frame.iloc[:, 1:].to_numpy() / PPM
    write_logs(out, RH, [log_since(time_s[rows], one[rows], RH) for rows in phases for one in values.T])


def fan(cache: Path, out: Path) -> None:
    """Both files whole."""
    folder = cache / "myphysicslabathome/Water-Cooling-Curve"
    tables = [np.loadtxt(folder / f"Water Cooling {one} Fan.dat") for one in ("Without", "With")]
    write_logs(out, T, [log_since(table[:, 0], table[:, 1]) for table in tables])


def nozzle(cache: Path, out: Path) -> None:
    """From the last change of the target, which is to nil, to the end of the file; each tenth row."""
    logs = []
    for name in ("coldstart", "temptests"):
        table = np.loadtxt(cache / f"martinxyz/um-hotend-sim/{name}.txt")
        off = table[stretches(table[:, 2])[-1]][::10]
        logs.append(log_since(off[:, 0], off[:, 1]))
    write_logs(out, T, logs)


def fourth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    of_dut = _block("010", "010_DS18B20_ORG/TempLog.csv", "dut", "pt100")
    of_pt100 = _block("004", "004/TempLog_2021-1-17_18-29.csv", "pt100", "block")
    return [
        RealSet("DS18B20 in a dry block, air from a Pt100", T, of_dut, None, dry),
        RealSet("Pt100 in a dry block, air from the block", T, of_pt100, None, dry),
        RealSet("heater of eight powers", T, eight_powers, None, NO_WATER),
        RealSet("its neighbour, the heater beside it", T, neighbour, None, NO_WATER),
        RealSet("heater to half three times", T, half_power, None, NO_WATER),
        RealSet("water in a small beaker", T, beaker, None, NOT_WARMED),
        RealSet("probe under a tap", T, tap, None, dry),
        # Ice-cold steel in a room may be bedewed, and the walls warm it.
        RealSet("sphere of steel out of ice", T, _steel("Sphere"), None, ("self_heating",)),
        RealSet("cube of steel out of ice", T, _steel("Cube"), None, ("self_heating",)),
        RealSet("chamber by one kelvin", T, chamber, None, NO_WATER),
        RealSet("CO2 of a room filled and aired", RH, aired_room, None, dry),
        RealSet("water with a fan and without", T, fan, None, NOT_WARMED),
        RealSet("nozzle that cools", T, nozzle, None, NO_WATER),
    ]
