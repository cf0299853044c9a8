"""A ninth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- daniw/rt-l @930f51a, luftkanal/03/air_step_1_5_{90,45}.mat: a thermometer in a duct of air, whose heater gets 5 V
  after 1 V, with its valve open and half open, each 0.01 s (GPL 2.0)
- Carlosluzon9/Simulink---Asignatura @eb9533b, ensayo_real_2.mat: two thermometers of a control course's board, whose
  first heater gets three powers in turn, each 0.5 s, as its authors' filter leaves it (no licence stated); the longer
  log beside it, ensayo_real.mat, is left out: its clock runs ten times as fast
- GiulioLecci11/PeltierCell @44bbf63, PeltierCell/FAN_BJT_SystIdentif/acquisizione_ventola_automatica_millis.mat: both
  sides of a Peltier cell, of which one is heated for 65 s and left ten times and the other has a fan, each 0.25 s (no
  licence stated)
- sofiabouzo/PFC_Transportation_Device @6f27cd4, registros/datos_*.csv: a box that Peltier elements cool and that warms
  again, each 30 s (no licence stated)
- mihaozbot/Plate-Heat-Exchanger @21f5c5f, PHE_data/Staircase_up/measurement_steps_validation_all_2022_02_14_{07_25,
  17_45}.mat, PHE_data/Starcase_up_n_down/measurement_steps_all_2022_06_10_20_48_NORMAL.mat: the outlet of a plate heat
  exchanger, whose valve is opened and closed in steps while a thermostat swings its inlet by 2 K, each 2 s (MIT)
- Andy1978/Brautomat @4767efb, obsolete/PT100_calibration/captures/100deg_{2,3}.log: a DS18B20 in boiling water that
  cools, each second (GPL 3.0)
- jacqueline-wong/CEE4530 @b1f43c5, Project/Data/8gac_90gsand_15rpm_{1,2,4,6,8}_layer_trial{1,2}.xls: a photometer
  behind carbon and sand in one to eight layers that dyed water is pumped through, each 5 s (text, for all their name;
  no licence stated)
- yildirimozal/cnn-enose @447173a, UMAX.csv, UMAY.csv: four gas sensors that are held in a vapour and then in air (the
  odours of the MAPIR laboratory, Malaga; no licence stated); they state no times, a row counts as a second
- gomezferrerf/experimental-newton-cooling-law @d03d139, datos/temperaturas.csv: three thermometers on a bar of metal
  that was heated and cools, and one in the air, each 1.5 s (no licence stated)

Cuts follow a power, a valve, a note, or the file itself. Where none tells it, they follow what a plot shows: when the
cooling of the box ended within one log, when the vapour went (by the quickest sensor), from the hottest reading of the
water to the next handling, and of the bar the time between its handling and rows that were filled in later. What is no
temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, RH, Log, T, log_since, write_logs
from real_sets import RealSet
from real_seventh_sets import dye
from real_sixth_sets import write_beside
from real_third_sets import stretches
from scipy.io import loadmat

VALVES = ("90", "45")
CELL_EVERY_S = 0.25
BOX_OFF_S = 2660.0  # in the log of 18.02, when its cooling ended
BOX_COOLED = (
    *("06.03_sincarga", "06.03_sincarga_nuevo", "13.03_sincarga_otro", "18.02_sincarga"),
    *("2025-03-25_10-56_prefrio", "2025-04-01_09-51_prefrio", "2025-04-01_12-16_prefrio"),
)
BOX_LEFT = ("13.03_sincarga_subida", "18.02_sincarga", "2025-04-01_11-01_calentando")
OPENED = tuple(f"Staircase_up/measurement_steps_validation_all_2022_02_14_{one}" for one in ("07_25", "17_45"))
OPENED_AND_CLOSED = ("Starcase_up_n_down/measurement_steps_all_2022_06_10_20_48_NORMAL",)
VALVE_STEPS = 8  # of a longer log: up, and down again
BOILED = {"100deg_2": 1690.0, "100deg_3": 8000.0}  # and when the vessel is handled next
LAYERED = "jacqueline-wong/CEE4530/Project/Data/8gac_90gsand_15rpm_{}.xls"
LAYERS = ("1_layer_trial1", "2_layer_trial1", "4_layer_trial1", "6_layer_trial2", "8_layer_trial2")
SAMPLE_ROWS, GAS_SENSORS = 1042, 4
VAPOUR, VAPOUR_ROWS = 3, 420  # its label, and the rows before the quickest sensor falls
PERCENT_PER_V = 20.0  # of 5 V
BAR_S = (400.0, 1100.0)


def duct(cache: Path, out: Path) -> None:
    """From the row with the higher voltage on, each fifth."""
    logs = []
    for valve in VALVES:
        table = loadmat(cache / f"daniw/rt-l/luftkanal/03/air_step_1_5_{valve}.mat")
        rows = stretches(table["Heizung"].ravel())[-1]
        logs.append(log_since(table["Zeit"].ravel()[rows][::5], table["Temperatur"].ravel()[rows][::5]))
    write_logs(out, T, logs)


def _board(cache: Path) -> tuple[list[Log], list[Log]]:
    """Both thermometers, a run for each power of the first heater until the second is on; each fourth row."""
    table = loadmat(cache / "Carlosluzon9/Simulink---Asignatura/ensayo_real_2.mat")
    until = int(np.flatnonzero(table["Q2_Entrada"].ravel())[0])
    held = stretches(table["Q1_Entrada"].ravel()[:until])[1:]  # before the first its filter had not settled
    time_s = table["Tiempo"].ravel()
    return tuple(
        [log_since(time_s[rows][::4], table[f"{one}_Salida"].ravel()[rows][::4]) for rows in held]
        for one in ("T1", "T2")
    )


def board(cache: Path, out: Path) -> None:
    """The thermometer on the heater that is switched."""
    write_logs(out, T, _board(cache)[0])


def board_beside(cache: Path, out: Path) -> None:
    """The other one; the first stands for the measured air."""
    airs, logs = _board(cache)
    write_beside(out, logs, airs)


def _cell(cache: Path) -> tuple[np.ndarray, list[slice]]:
    """Both sides of the cell and whether it is heated, and the rows of each phase from the first heating on."""
    folder = cache / "GiulioLecci11/PeltierCell/PeltierCell/FAN_BJT_SystIdentif"
    table = loadmat(folder / "acquisizione_ventola_automatica_millis.mat")["data"]
    return table, stretches(table[:, 3])[1:]


def _cell_log(values: np.ndarray) -> Log:
    every = round(1.0 / CELL_EVERY_S)
    return log_since(np.arange(float(len(values[::every]))), values[::every])


def cell(cache: Path, out: Path) -> None:
    """The heated side after each heating; each fourth row."""
    table, phases = _cell(cache)
    write_logs(out, T, [_cell_log(table[rows, 1]) for rows in phases[1::2]])


def cell_beside(cache: Path, out: Path) -> None:
    """The other side from each heating to the next; the heated one stands for the measured air."""
    table, phases = _cell(cache)
    cycles = [slice(on.start, off.stop) for on, off in zip(phases[::2], phases[1::2], strict=True)]
    logs, airs = ([_cell_log(table[rows, k]) for rows in cycles] for k in (0, 1))
    write_beside(out, logs, airs)


def _box(names: Sequence[str], cooled: bool) -> Callable[[Path, Path], None]:
    """Files whole but for the one that has both."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            frame = pd.read_csv(cache / f"sofiabouzo/PFC_Transportation_Device/registros/datos_{name}.csv")
            if name in BOX_COOLED and name in BOX_LEFT:
                frame = frame[(frame["Tiempo"] < BOX_OFF_S) == cooled]
            logs.append(log_since(frame["Tiempo"].to_numpy(float), frame["Temperatura"].to_numpy(float)))
        write_logs(out, T, logs)

    return make


def _valve(names: Sequence[str]) -> Callable[[Path, Path], None]:
    """A run for each step of the valve; the first is left out: the log began with it."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            table = loadmat(cache / f"mihaozbot/Plate-Heat-Exchanger/PHE_data/{name}.mat")
            held = stretches(table["u"].ravel())[1 : 1 + VALVE_STEPS]
            logs += [log_since(table["t"].ravel()[rows], table["x"][rows, 1]) for rows in held]
        write_logs(out, T, logs)

    return make


def boiled(cache: Path, out: Path) -> None:
    """From its hottest on, each tenth row."""
    logs = []
    for name, until_s in BOILED.items():
        table = np.loadtxt(cache / f"Andy1978/Brautomat/obsolete/PT100_calibration/captures/{name}.log")
        table = table[table[:, 0] - table[0, 0] < until_s]
        table = table[int(np.argmax(table[:, 1])) :: 10]
        logs.append(log_since(table[:, 0], table[:, 1]))
    write_logs(out, T, logs)


def _vapour(sensor: int, rows: slice) -> Callable[[Path, Path], None]:
    """Each sample of one odour."""

    def make(cache: Path, out: Path) -> None:
        folder = cache / "yildirimozal/cnn-enose"
        label = np.loadtxt(folder / "UMAY.csv")
        volts = np.loadtxt(folder / "UMAX.csv", delimiter=",").reshape(label.size, SAMPLE_ROWS, GAS_SENSORS)
        runs = PERCENT_PER_V * volts[label == VAPOUR][:, rows, sensor]
        write_logs(out, RH, [log_since(np.arange(float(one.size)), one, RH) for one in runs])

    return make


def bar(cache: Path, out: Path) -> None:
    """Each thermometer a run."""
    frame = pd.read_csv(cache / "gomezferrerf/experimental-newton-cooling-law/datos/temperaturas.csv")
    table = frame[frame["Tiempo (s)"].between(*BAR_S)].to_numpy(float)
    logs, air = ([log_since(table[:, 0], table[:, k]) for k in which] for which in ((1, 2, 3), (4,)))
    write_beside(out, logs, 3 * air)


def ninth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    return [
        RealSet("duct of air to five times its voltage", T, duct, None, NO_WATER),
        RealSet("board at three powers in turn", T, board, None, NO_WATER),
        RealSet("board at three powers, the heater beside it", T, board_beside, None, NO_WATER),
        RealSet("heated side of a Peltier cell that cools", T, cell, None, NO_WATER),
        RealSet("fanned side of a Peltier cell, air from the heated one", T, cell_beside, None, NO_WATER),
        # Its air may be bedewed on the cold side.
        RealSet("box that Peltier elements cool", T, _box(BOX_COOLED, True), None, NOT_WARMED),
        RealSet("box that warms again", T, _box(BOX_LEFT, False), None, NOT_WARMED),
        RealSet("outlet of a plate heat exchanger, valve opened", T, _valve(OPENED), None, dry),
        RealSet("outlet of a plate heat exchanger, valve up and down", T, _valve(OPENED_AND_CLOSED), None, dry),
        RealSet("water that was boiled", T, boiled, None, NOT_WARMED),
        RealSet("dye behind layers of carbon and sand", RH, dye(LAYERED, LAYERS), None, dry),
        RealSet("gas sensor in vapour", RH, _vapour(1, slice(VAPOUR_ROWS)), None, dry),
        RealSet("gas sensor after vapour", RH, _vapour(0, slice(VAPOUR_ROWS, None)), None, dry),
        RealSet("bar of metal that cools, air beside it", T, bar, None, dry),
    ]
