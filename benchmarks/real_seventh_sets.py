"""A seventh group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- gergelytakacs/AutomationShield @bc0778f, matlab/examples/HeatShield/resultID.mat: the head of a 3D printer at six
  powers in turn, each 2 s (CC BY-NC-ND 4.0)
- Subve/System-identification @e96d6c5, heating_system.dat: a thermocouple behind a steel plate, which a halogen lamp
  heats at six voltages in turn, each 2 s (MIT; from DaISy, a collection of data for system identification)
- odacostaz/UNThermal @18b870f, code/python_code/unthermal/datafiles/Thermal_prbs_open_exp.csv: a heated plate of a
  control course at two powers in random turns, each 0.8 s (MIT)
- monroews/CEE4530 @9ee134c, Examples/data/Aeration_2019/*.xls: an oxygen probe in water that air is blown through, each
  5 s; Examples/data/Adsorption/*.xls: a photometer behind sand and carbon that dyed water is pumped through, each 5 s
  (text, for all their name; MIT)
- axarce/CEE4530 @fe61a32, Gas Transfer Lab/datafiles/*.txt: another group's oxygen probe, each second (no licence
  stated)
- TiansuanConstellation/MobiCom24-SatelliteCOTS @951b415, Temperature-HeatingRate/Data/*/*.csv: processors (Raspberry Pi
  4B, Atlas 200 DK) that are loaded for three hours and then rest, on the ground and in orbit, each second (no licence
  stated)
- valavakilian/enph257 @62683a6, *experiment_*.txt: thermometers in a rod of aluminium, whose end is heated and left in
  turns, each second (no licence stated)

Every cut follows a power, a note or a clock, or the file itself; none follows the reading that is judged. What is no
temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, RH, Log, T, log_since, write_logs
from real_sets import RealSet
from real_sixth_sets import write_beside
from real_third_sets import stretches
from scipy.io import loadmat

DAY_S = 86400.0
LEAST_ROWS = 40  # of a power of the plate, 32 s
PERCENT_PER_MG_L, ZERO_PERCENT = 10.0, 10.0  # of oxygen: probes read a little below zero
STRONG, WEAK = (700, 725, 750, 775, 800, 825), (100, 125, 175, 200, 225)  # airs [umol/s], as the files are called
OTHER_AIRS = (30, 70, 160, 370, 850, 2000)
ADSORPTION = "monroews/CEE4530/Examples/data/Adsorption/{}.xls"
SAND = ("0gac0_5mLpers", "0gac0_5mlperws", "120gsand")
CARBON = ("0_5gac", "0_601gac0_5mlpers", "1_66gac0_5mlpers", "2gac0_466mLpers", "4gac0_466mLpers")
LOADED_S, STARTED_S = 10800.0, 600.0  # within ten minutes of the log
IDLE_MA = 500.0  # at the most, of the Raspberry Pi in orbit in the median of a minute


def head(cache: Path, out: Path) -> None:
    """A run for each power, each fifth row."""
    table = loadmat(cache / "gergelytakacs/AutomationShield/matlab/examples/HeatShield/resultID.mat")["resultID"]
    time_s = 2.0 * np.arange(len(table))
    write_logs(out, T, [log_since(time_s[rows][::5], table[rows, 0][::5]) for rows in stretches(table[:, 1])])


def lamp(cache: Path, out: Path) -> None:
    """A run for each voltage; before the first it was 6 V."""
    table = np.loadtxt(cache / "Subve/System-identification/heating_system.dat")
    write_logs(out, T, [log_since(table[rows, 0], table[rows, 2]) for rows in stretches(table[:, 1])])


def plate(cache: Path, out: Path) -> None:
    """A run for each power that was held for long enough."""
    frame = pd.read_csv(cache / "odacostaz/UNThermal/code/python_code/unthermal/datafiles/Thermal_prbs_open_exp.csv")
    held = [rows for rows in stretches(frame["u"].to_numpy())[1:] if rows.stop - rows.start >= LEAST_ROWS]
    write_logs(out, T, [log_since(frame["t"].to_numpy()[rows], frame["y"].to_numpy()[rows]) for rows in held])


def _noted_rows(path: Path, column: str, note: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of the day and a column of a table with notes between its rows; of the rows after the last note alone."""
    lines = path.read_text(encoding="latin-1").splitlines()
    noted = [i for i, line in enumerate(lines) if not line[:1].isdigit()]
    names = next(line for line in lines if line.startswith("Day")).split("\t")
    k = next(i for i, name in enumerate(names) if column in name)
    rows = [line.split("\t") for line in lines[(noted[-1] + 1 if note else 1) :] if line[:1].isdigit()]
    table = np.array([[DAY_S * float(row[0]), float(row[k])] for row in rows])
    table = table[np.concatenate([[True], np.diff(table[:, 0]) > 0.0])]  # the logger repeats a stamp here and there
    return table[:, 0], table[:, 1]


def _oxygen(pattern: str, airs: tuple[int, ...]) -> Callable[[Path, Path], None]:
    """Files whole, one for each air."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for air in airs:
            time_s, mg_l = _noted_rows(cache / pattern.format(air), "DO probe")
            logs.append(log_since(time_s, ZERO_PERCENT + PERCENT_PER_MG_L * mg_l, RH))
        write_logs(out, RH, logs)

    return make


def dye(pattern: str, names: tuple[str, ...]) -> Callable[[Path, Path], None]:
    """From the note that dye is pumped to the end of the file, each of some names in `pattern`."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            time_s, mg_l = _noted_rows(cache / pattern.format(name), "(mg/L)", note=True)
            logs.append(log_since(time_s, ZERO_PERCENT + mg_l, RH))
        write_logs(out, RH, logs)

    return make


def _loaded_from(frame: pd.DataFrame, name: str) -> float:
    """When the load began: with the log, save for the Raspberry Pi in orbit, whose current tells it."""
    if "PiA" not in name:
        return float(frame["TIME"].iloc[0])
    first = frame[frame["TIME"] < frame["TIME"].iloc[0] + STARTED_S]
    idle = first["I_Pi-A"].rolling(61, center=True, min_periods=1).median() <= IDLE_MA
    return float(first["TIME"][idle].iloc[-1])


def _processor(folder: str, every: int, rests: bool) -> Callable[[Path, Path], None]:
    """Three hours of load of each file, and the rest after them if wanted; each `every`th row."""

    def make(cache: Path, out: Path) -> None:
        home = cache / "TiansuanConstellation/MobiCom24-SatelliteCOTS/Temperature-HeatingRate/Data"
        logs: list[Log] = []
        for path in sorted((home / folder).glob("*.csv")):
            frame = pd.read_csv(path).drop_duplicates("TIME")
            since = (frame["TIME"] - _loaded_from(frame, path.name)).to_numpy(float)
            for wanted in ((since >= 0.0) & (since < LOADED_S), since >= LOADED_S)[: 1 + rests]:
                logs.append(log_since(since[wanted][::every], frame["TEMP"].to_numpy(float)[wanted][::every]))
        write_logs(out, T, logs)

    return make


def rods(cache: Path, out: Path) -> None:
    """The second thermometer, the first of which is at the heated end; files whole, each fifth row."""
    logs, airs = [], []
    for path in sorted((cache / "valavakilian/enph257").glob("*xperiment_*.txt")):
        # Rows follow each other without a line's end, the last column is not connected.
        rows = re.findall(r"(\d\d):(\d\d):(\d\d\.\d{6})\s+([\d.]+)\s+([\d.]+)", path.read_text(encoding="utf-8"))
        table = np.array(rows, float)[::5]
        time_s = table[:, :3] @ (3600.0, 60.0, 1.0)
        for kept, k in ((airs, 3), (logs, 4)):
            kept.append(log_since(time_s, table[:, k]))
    write_beside(out, logs, airs)


def seventh_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    course = "monroews/CEE4530/Examples/data/Aeration_2019/{}.xls"
    others = "axarce/CEE4530/Gas Transfer Lab/datafiles/{}.txt"
    pi, pi_in_orbit = (_processor(f"{place}_pi_stress_and_infer", 20, True) for place in ("gnd", "sat"))
    atlas, atlas_in_orbit = (_processor(f"{place}_atlas_infer", 30, False) for place in ("gnd", "sat"))
    return [
        RealSet("printer's head at six powers", T, head, None, NO_WATER),
        RealSet("steel plate under a lamp", T, lamp, None, NO_WATER),
        RealSet("another plate at two powers", T, plate, None, NO_WATER),
        RealSet("oxygen of water under much air", RH, _oxygen(course, STRONG), None, dry),
        RealSet("oxygen of water under little air", RH, _oxygen(course, WEAK), None, dry),
        RealSet("oxygen of water under six airs", RH, _oxygen(others, OTHER_AIRS), None, dry),
        RealSet("dye behind sand", RH, dye(ADSORPTION, SAND), None, dry),
        RealSet("dye behind carbon", RH, dye(ADSORPTION, CARBON), None, dry),
        RealSet("Raspberry Pi at four loads and resting", T, pi, None, NO_WATER),
        RealSet("Raspberry Pi in orbit at four loads and resting", T, pi_in_orbit, None, NO_WATER),
        RealSet("Atlas board at eight loads", T, atlas, None, NO_WATER),
        RealSet("Atlas board in orbit at eight loads", T, atlas_in_orbit, None, NO_WATER),
        RealSet("rods of aluminium, air from the hot end", T, rods, None, NO_WATER),
    ]
