"""A fifteenth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- FredericoMB/Tarentola_Thermal_Exchange_Rates @5d2cdbc, Data/cumulative_temperatures_data.csv: parts of geckos on a
  floor that water warms or cools, or from under a lamp, each 20 s, as differences to the first reading (no licence
  stated)
- ccoolbaugh/Individualized_Cooling_Data_Analysis @effb376, Example-Data/20180523_S0001_PCP_i{01..18}.csv: loggers that
  are put on a man's skin and taken off again, each minute (MIT)
- dryals/social-heterosis @5ea3477, therm_data/sensors/*.xlsx: loggers in small hives, each 5 minutes (no licence
  stated)
- tanaes/whopping_Voron_mods @62268ed, docs/frame_expansion/data/*.csv: the frame, the chamber and the heated bed of
  three printers, each 4 s (GPL 3)
- alcaemre/PHY324_thermal_diffusivity @d6fcbfa, trial{1,2,3}.csv: the inside of a tube of rubber that is moved between
  hot and cold water, each 5 s or 10 s (no licence stated)
- liammurray123/ScienceOne-Physics-Assignment-2 @7cd0df8, Trial {1,2,3}.csv: a DHT sensor's thermometer at a can that
  was heated and cools, each 2 s (no licence stated)
- SimonEnsemble/tank_inverse_problem @d6aca89, data/liq_level_data_{empty_test,empty_train,w_bottle}.csv: the level of
  water in a tank that runs empty, without and with a bottle in it, each 0.13 s (no licence stated)
- ameliaritger/arduino-ph-sensor @c3d6137, temp/data/CLEAN/CLEAN_{green_ard_hot,green_ard_ice,green_ard_ice2,
  green_mad_ice,green_mad_warm,red_ard_ice,red_mad_ice,red_mad_warm}.csv: the thermistors of two pH sensors in ice or
  warm water, as voltages, each 5 s or 15 s (Apache 2.0)
- Chongran-Zhao/VHB4910_data @a23efd8, single-step-relaxation/original_data/{1d5,2d0,2d5,3d0,3d5,4d0,5d0,6d0}.csv: the
  force of a tape that is stretched to eight lengths and held, each 20 ms or 50 ms (no licence stated)
- alany08/apchem-keystonelab-unit6 @a2447b3, data/trial{1,2,3,4}.csv: how much light is absorbed by iodide that iron
  oxidizes, each 0.5 s (GPL 3)

Cuts follow the authors' columns of treatment and animal, of the water that the tube is in and of what the bed is set
to, the hour from which on the hives count for their authors, the stretch that is reached, and the authors' files. Where
none tells it, they follow what a plot shows: when a logger was put on and taken off, which of the fifteen lay beside
the hives, the hottest reading of the can, the highest of the tank and the last clear one before the reaction. What is
no temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign

GECKOS = "FredericoMB/Tarentola_Thermal_Exchange_Rates/Data/cumulative_temperatures_data.csv"
GECKO_PLACES, GECKO_READINGS = ("Evora", "Portimao"), 20
SKIN = "ccoolbaugh/Individualized_Cooling_Data_Analysis/Example-Data"
SKIN_LOGGERS, SKIN_PERIOD_S = range(1, 19), 60.0
ROOM_C, ON_UNTIL = 23.0, 33  # the water of the suit is set lower then
TAKEN_OFF_FROM, TAKEN_OFF_UNTIL, WARM_C = 95, 125, 28.0
HIVES = "dryals/social-heterosis/therm_data/sensors"
BESIDE_HIVES, HIVE_HEAD = "F14F2000", 4  # numbers in the column above the readings
HIVE_PERIOD_S, HIVE_FROM, HIVE_READINGS = 300.0, 12, 72
PRINTERS = "tanaes/whopping_Voron_mods/docs/frame_expansion/data"
CHAMBERED = (  # those with a thermometer in the chamber
    *("expansion_quant_whoppingpochard#2514_2021-06-13_20-04-43", "frame_exp_quant_v3_2021-06-13_05-41-53"),
    "frame_temp_v_pos_2021-06-05_13-24-32",
)
SET_OFF = (*CHAMBERED[:2], "frame_exp_quant_v3_2021-06-12_12-54-36-mvieleers_V2.1253")
PRINTER_EVERY = 4
IN_CHAMBER = {"temperature_standard_uncertainty_k": 1.0}  # one place of a chamber that is stratified
RUBBER = "alcaemre/PHY324_thermal_diffusivity"
WATER = {"temperature_standard_uncertainty_k": 0.6}  # of 1 K at the most, as its authors state it
CAN = "liammurray123/ScienceOne-Physics-Assignment-2"
TANK = "SimonEnsemble/tank_inverse_problem/data"
TANK_EMPTY, PERCENT_PER_COUNT, TANK_EVERY = 510.0, 0.1, 5
ELECTRODES = "ameliaritger/arduino-ph-sensor/temp/data/CLEAN"
INTO_WATER = (
    *("green_ard_hot", "green_ard_ice", "green_ard_ice2", "green_mad_ice", "green_mad_warm"),
    *("red_ard_ice", "red_mad_ice", "red_mad_warm"),
)
ABOVE_MV = -50.0
TAPE = "Chongran-Zhao/VHB4910_data/single-step-relaxation/original_data"
STRETCHES = ("1d5", "2d0", "2d5", "3d0", "3d5", "4d0", "5d0", "6d0")
HELD_S, TAPE_PERIOD_S, PERCENT_PER_N = 600.0, 2.0, 10.0
IODIDE = "alany08/apchem-keystonelab-unit6/data"
PERCENT_PER_ABSORBANCE = 100.0


def _geckos(treatment: str, direction: str, part: str) -> Callable[[Path, Path], None]:
    """Each animal of two places a run, where most of its readings are there."""

    def make(cache: Path, out: Path) -> None:
        table = pd.read_csv(cache / GECKOS)
        table = table[(table["treat"] == treatment) & (table["heat"] == direction)].dropna(subset=part)
        animals = table[table["population"].isin(GECKO_PLACES)].sort_values("time").groupby("id")
        logs = [log_since(rows["time"].to_numpy(float), rows[part].to_numpy()) for _, rows in animals]
        write_logs(out, T, [log for log in logs if len(log) > GECKO_READINGS])

    return make


def _skin(cache: Path, number: int) -> np.ndarray:
    """degC."""
    text = (cache / SKIN / f"20180523_S0001_PCP_i{number:02d}.csv").read_text(encoding="latin1")
    return np.array(re.findall(r"^\d+,([-\d.]+)°C", text, re.MULTILINE), float)


def _each(value: np.ndarray, period_s: float) -> Log:
    return log_since(period_s * np.arange(value.size), value)


def put_on_skin(cache: Path, out: Path) -> None:
    """Those that were in the room at first, from their last reading there."""
    logs = []
    for number in SKIN_LOGGERS:
        value = _skin(cache, number)[:ON_UNTIL]
        if value[0] < ROOM_C:
            logs.append(_each(value[np.flatnonzero(value < ROOM_C)[-1] :], SKIN_PERIOD_S))
    write_logs(out, T, logs)


def taken_off_skin(cache: Path, out: Path) -> None:
    """Those that were warm, all from the same minute on."""
    values = [_skin(cache, number)[TAKEN_OFF_FROM:TAKEN_OFF_UNTIL] for number in SKIN_LOGGERS]
    write_logs(out, T, [_each(value, SKIN_PERIOD_S) for value in values if value[0] > WARM_C])


def _third_column(path: Path) -> np.ndarray:
    """A sheet's numbers in its column C."""
    with ZipFile(path) as archive:
        sheet = ET.fromstring(archive.read("xl/worksheets/sheet1.xml"))
    cells = [e for e in sheet.iter() if e.tag.endswith("}c") and e.get("r", "").startswith("C") and len(e)]
    return np.array([float(cell[-1].text or "nan") for cell in cells if cell.get("t", "n") == "n"])


def in_hives(cache: Path, out: Path) -> None:
    logs = []
    for path in sorted((cache / HIVES).glob("*.xlsx")):
        if not path.name.startswith(BESIDE_HIVES):
            value = _third_column(path)[HIVE_HEAD + HIVE_FROM :]
            logs.append(_each(value[:HIVE_READINGS], HIVE_PERIOD_S))
    write_logs(out, T, logs)


def _printer(cache: Path, name: str) -> pd.DataFrame:
    frame = pd.read_csv(cache / PRINTERS / f"{name}.csv", comment="#")
    stamps = pd.to_datetime(frame["time"], format="%Y/%m/%d-%H:%M:%S")
    return frame.assign(time_s=(stamps - stamps[0]).dt.total_seconds())


def printer_frames(cache: Path, out: Path) -> None:
    """While its bed is heated and after, the chamber beside it, each fourth row."""
    logs, airs = [], []
    for name in CHAMBERED:
        frame = _printer(cache, name)
        for _, rows in frame[::PRINTER_EVERY].groupby(frame["bed_target"] <= 0.0):
            for column, kept in (("frame_t", logs), ("chamber_t", airs)):
                kept.append(log_since(rows["time_s"].to_numpy(), rows[column].to_numpy()))
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], IN_CHAMBER)


def printer_beds(cache: Path, out: Path) -> None:
    """After they are set off, each fourth row."""
    logs = []
    for name in SET_OFF:
        rows = _printer(cache, name).query("bed_target <= 0")[::PRINTER_EVERY]
        logs.append(log_since(rows["time_s"].to_numpy(), rows["bed_t"].to_numpy()))
    write_logs(out, T, logs)


def rubber_tube(cache: Path, out: Path) -> None:
    """As long as it is in water, and that water."""
    logs, airs = [], []
    for trial in (1, 2, 3):
        table = pd.read_csv(cache / RUBBER / f"trial{trial}.csv")
        table.columns = ["time", "inside", "hot", "cold", "where"]
        table = table[table["where"].isin(["H", "C"])]
        water = np.where(table["where"] == "H", table["hot"], table["cold"])
        logs.append(log_since(table["time"].to_numpy(), table["inside"].to_numpy(float)))
        airs.append(log_since(table["time"].to_numpy(), water.astype(float)))
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], WATER)


def can_cools(cache: Path, out: Path) -> None:
    """From its hottest on."""
    logs = []
    for trial in (1, 2, 3):
        table = pd.read_csv(cache / CAN / f"Trial {trial}.csv").to_numpy(float)
        hottest = int(np.argmax(table[:, 1]))
        logs.append(log_since(*table[hottest:, :2].T))
    write_logs(out, T, logs)


def tank_empties(cache: Path, out: Path) -> None:
    """From its last highest reading on, each fifth row."""
    logs = []
    for name in ("empty_test", "empty_train", "w_bottle"):
        table = pd.read_csv(cache / TANK / f"liq_level_data_{name}.csv", comment="#").to_numpy(float)
        begin = int(np.flatnonzero(table[:, 1] == table[:, 1].max())[-1])
        end = begin + int(np.flatnonzero(table[begin:, 1] <= TANK_EMPTY)[0])
        time_s, level = table[begin:end:TANK_EVERY].T
        logs.append(log_since(time_s, PERCENT_PER_COUNT * level, RH))
    write_logs(out, RH, logs)


def thermistors_in_water(cache: Path, out: Path) -> None:
    """Files whole."""
    logs = []
    for name in INTO_WATER:
        table = pd.read_csv(cache / ELECTRODES / f"CLEAN_{name}.csv")
        stamps = pd.to_datetime(table["date_time"])
        since = (stamps - stamps[0]).dt.total_seconds()
        logs.append(log_since(since.to_numpy(), table["v4"].to_numpy() - ABOVE_MV, RH))
    write_logs(out, RH, logs)


def tape_held(cache: Path, out: Path) -> None:
    """From the stretch that it is held at, a reading each 2 s."""
    logs = []
    for stretch in STRETCHES:
        frame = pd.read_csv(cache / TAPE / f"{stretch}.csv", header=None, encoding="latin1", low_memory=False)
        table = frame.apply(pd.to_numeric, errors="coerce").dropna().to_numpy()
        since = table[:, 0] - table[np.argmax(table[:, 1]), 0]
        at = np.searchsorted(since, np.arange(0.0, HELD_S, TAPE_PERIOD_S))
        logs.append(log_since(since[at], PERCENT_PER_N * table[at, 2], RH))
    write_logs(out, RH, logs)


def iodide(cache: Path, out: Path) -> None:
    """From the last reading that is clear."""
    logs = []
    for trial in (1, 2, 3, 4):
        table = pd.read_csv(cache / IODIDE / f"trial{trial}.csv", header=None, comment="#").to_numpy(float)
        begin = int(np.flatnonzero(table[:, 1] > 0.0)[0]) - 1
        logs.append(log_since(table[begin:, 0], PERCENT_PER_ABSORBANCE * table[begin:, 1], RH))
    write_logs(out, RH, logs)


def fifteenth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry, worn = (*NOT_WARMED, *NO_WATER), (*NOT_WARMED, "condensation")
    return [
        RealSet("gecko's back over warm water", T, _geckos("Thigmothermy", "Heating", "Dorsum"), None, worn),
        RealSet("gecko's foot over cold water", T, _geckos("Thigmothermy", "Cooling", "Foot"), None, worn),
        RealSet("gecko's back after a lamp", T, _geckos("Heliothermy", "Cooling", "Dorsum"), None, worn),
        RealSet("loggers put on skin", T, put_on_skin, None, worn),
        RealSet("loggers taken off skin", T, taken_off_skin, None, worn),
        RealSet("loggers in hives", T, in_hives, None, ("self_heating", "condensation")),
        RealSet("frame of a printer, air from its chamber", T, printer_frames, None, NO_WATER),
        RealSet("bed of a printer that is set off", T, printer_beds, None, NO_WATER),
        RealSet("inside of a tube of rubber, air from the water", T, rubber_tube, None, dry),
        RealSet("DHT at a can that cools", T, can_cools, None, NOT_WARMED),
        RealSet("level of a tank that runs empty", RH, tank_empties, None, dry),
        RealSet("thermistors of pH sensors in ice and in warm water", RH, thermistors_in_water, None, dry),
        RealSet("force of a tape that is stretched and held", RH, tape_held, None, dry),
        RealSet("colour of iodide that iron oxidizes", RH, iodide, None, dry),
    ]
