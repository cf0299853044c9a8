"""A sixth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- pfrapp/reflow-oven @8add2ee, measurements/2024-{07-27,08-03,10-27}/signals_step_*.log: a thermocouple in a toaster
  oven at 30, 50 and 100 % of its power, three times switched off again with its door closed, each 0.5 s (GPL 3.0)
- TiagoPrata/TCLabSP @e8dfcb0, Simulink (MATLAB R2016a)/00-PeriodoDeAmostragem/Ensaios/
  ens_IdentificacaoH1_0to50_{01..10}.mat: two thermometers of a control course's board, whose first heater is switched
  on to half of its power ten times, the fourth time while it is still hot, each 0.25 s (MIT)
- Pedebruin/SC42035-Integration-Project @ae23cb5, Code/Experiments/Step_H1-*_LEN{3660,9060,10860}_*.mat: another such
  board, whose first heater is switched on and off and whose second one gets three powers in turn, each second (no
  licence stated)
- creyesmiro/Temperature-Control-Lab @e5ede2b, tclab_matlab_gendata/data2Q.txt: a third such board, both of whose
  heaters get three powers in turn, each second (no licence stated)
- nebisman/UNThermal @2f4825f, code/python_code/experiment_files/Thermal_prbs_open_exp.csv: a heated plate of a
  control course at two powers in random turns, each 0.8 s (MIT)
- KeenanMcConkey/ENPH257-lab-heattransport @24ea0df, Data/HeatTransport_2017_{5_29,6_5,6_7,6_9}.csv: thermometers
  6 cm apart in a rod of aluminium, whose end is heated and left in turns, each second (no licence stated)
- ENPH253/ENPH257 @6350fed, Noober06{06vs,09hs,10hb,13vb}.csv: five thermometers in such a rod, upright or lying, sanded
  or black, heated at its end until it grows no hotter and then left, each 0.8 s (no licence stated)
- grap7936/ASEN-3802----Lab2-Group-1 @e6d2b59, *mA: eight thermocouples half an inch apart in bars of aluminium, brass
  and steel that are heated at one end, each 10 s (no licence stated)
- wickyw/Heatflow @f3c54f0, Renske/{Counter,EersteMeting,Parallel}{Temp,Flow}.txt and Renske/Metingen/{Temperature
  Couter Flow,Temperature Paralel flow,Flow Counter Flow,Flow Paralel Flow}.txt: the tank of a heat exchanger and the
  pipe that a pump feeds from it, five times, each second (no licence stated)

Every cut follows a power or a flow that the log states, or the file itself; none follows the reading that is judged.
Where a log does not state its power, the thermometer nearest to the source of the heat stands for the measured air.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_third_sets import stretches
from scipy.io import loadmat

# 2 K at the most for the thermometers of boards and rods; the authors of the bars draw 2 K too.
AIR_K = {"temperature_standard_uncertainty_k": 1.0}
TIMES_SWITCHED_ON, EVERY_S = range(1, 11), 0.25
LEAST_ROWS = 40  # of a power of the plate, 32 s
RODS = ("5_29", "6_5", "6_7", "6_9")
RODS_OF_TWO_SURFACES = ("0606vs", "0609hs", "0610hb", "0613vb")
PIPES = {
    "CounterTemp": "CounterFlow",
    "EersteMetingTemp": "EersteMetingFlow",
    "Metingen/Temperature Couter Flow": "Metingen/Flow Counter Flow",
    "Metingen/Temperature Paralel flow": "Metingen/Flow Paralel Flow",
    "ParallelTemp": "ParallelFlow",
}
PULSES = 7  # a second: the pump of the pipe runs


def write_beside(out: Path, logs: Sequence[Log], airs: Sequence[Log]) -> None:
    """Runs with a measured air."""
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], AIR_K)


def oven(cache: Path, out: Path) -> None:
    """A run for each power but the rest before the first, each second row."""
    logs = []
    for path in sorted((cache / "pfrapp/reflow-oven/measurements").glob("*/signals_step_*.log")):
        lines = path.read_text(encoding="utf-8").splitlines()
        frame = pd.read_csv(path, skiprows=next(i for i, line in enumerate(lines) if line.startswith("Index")))
        # The later form of the log calls its columns otherwise.
        reading = next(name for name in frame if name in ("Temperature (C)", "Oven temperature (C)"))
        power = next(name for name in frame if name.endswith("(percent)"))
        time_s, value = frame["Time (ms)"].to_numpy() / 1000.0, frame[reading].to_numpy()
        logs += [log_since(time_s[rows][::2], value[rows][::2]) for rows in stretches(frame[power].to_numpy())[1:]]
    write_logs(out, T, logs)


def _ten_times(cache: Path) -> tuple[list[Log], list[Log]]:
    """Both thermometers, a run for each file, each twentieth row; the first two are no readings."""
    folder = cache / "TiagoPrata/TCLabSP/Simulink (MATLAB R2016a)/00-PeriodoDeAmostragem/Ensaios"
    tables = [_table_in_object(folder / f"ens_IdentificacaoH1_0to50_{k:02d}.mat") for k in TIMES_SWITCHED_ON]
    return tuple([log_since(EVERY_S * np.arange(len(one))[2::20], one[2::20, k]) for one in tables] for k in (0, 1))


def _table_in_object(path: Path) -> np.ndarray:
    """The table of two columns of an object of MATLAB's, which lies in a file within the file."""
    name = "__function_workspace__"
    inner = loadmat(path, variable_names=[name])[name].tobytes()
    first = inner[8 : 16 + int.from_bytes(inner[12:16], "little")]
    held = loadmat(BytesIO(b" " * 124 + inner[:4] + first))[name]
    parts = held[0, 0]["MCOS"][0][-1].ravel()
    return next(one for one in parts if one.ndim == 2 and one.shape[1] == 2 and len(one) > 2)


def ten_times(cache: Path, out: Path) -> None:
    """The thermometer on the heater that is switched on."""
    write_logs(out, T, _ten_times(cache)[0])


def ten_times_beside(cache: Path, out: Path) -> None:
    """The other one, which stays off; the first stands for the measured air."""
    airs, logs = _ten_times(cache)
    write_beside(out, logs, airs)


def _heater(which: int, lengths_s: Sequence[int]) -> Callable[[Path, Path], None]:
    """A run for each pair of powers but the rest before the first, each tenth row."""

    def make(cache: Path, out: Path) -> None:
        folder, logs = cache / "Pedebruin/SC42035-Integration-Project/Code/Experiments", []
        for path in sorted(path for one in lengths_s for path in folder.glob(f"Step_H1-*_LEN{one}_*.mat")):
            log = loadmat(path, squeeze_me=True, struct_as_record=False)["Experiment"].idd
            value, power = log.OutputData[:-1, which], log.InputData[:-1]  # the last row was not filled
            held = stretches(100.0 * power[:, 0] + power[:, 1])[1:]
            logs += [log_since(np.arange(float(len(value)))[rows][::10], value[rows][::10]) for rows in held]
        write_logs(out, T, logs)

    return make


def three_powers(cache: Path, out: Path) -> None:
    """The first heater's thermometer, a run for each pair of powers but the rest before the first."""
    table = np.loadtxt(cache / "creyesmiro/Temperature-Control-Lab/tclab_matlab_gendata/data2Q.txt", delimiter=",")
    held = stretches(1000.0 * table[:, 1] + table[:, 2])[1:]
    write_logs(out, T, [log_since(table[rows, 0], table[rows, 3]) for rows in held])


def plate(cache: Path, out: Path) -> None:
    """A run for each power that was held for long enough."""
    frame = pd.read_csv(cache / "nebisman/UNThermal/code/python_code/experiment_files/Thermal_prbs_open_exp.csv")
    held = [rows for rows in stretches(frame["u"].to_numpy())[1:] if rows.stop - rows.start >= LEAST_ROWS]
    write_logs(out, T, [log_since(frame["t"].to_numpy()[rows], frame["y"].to_numpy()[rows]) for rows in held])


def rod(cache: Path, out: Path) -> None:
    """The second thermometer, the first of which is at the heated end; files whole, each fifth row."""
    folder = cache / "KeenanMcConkey/ENPH257-lab-heattransport/Data"
    frames = [pd.read_csv(folder / f"HeatTransport_2017_{day}.csv")[::5] for day in RODS]
    airs, logs = ([log_since(f["elapsed"].to_numpy(), f[one].to_numpy()) for f in frames] for one in ("temp1", "temp2"))
    write_beside(out, logs, airs)


def rod_of_two_surfaces(cache: Path, out: Path) -> None:
    """The thermometer in the middle, the fifth being at the heated end; files whole, each twentieth row."""
    folder = cache / "ENPH253/ENPH257"
    tables = [np.loadtxt(folder / f"Noober{one}.csv", delimiter=",")[::20] for one in RODS_OF_TWO_SURFACES]
    airs, logs = ([log_since(table[:, 0], table[:, k]) for table in tables] for k in (5, 3))
    write_beside(out, logs, airs)


def bars(cache: Path, out: Path) -> None:
    """The fourth thermocouple, the eighth being the nearest to the heater; files whole."""
    paths = sorted((cache / "grap7936/ASEN-3802----Lab2-Group-1").glob("*mA"))
    tables = [np.loadtxt(path) for path in paths]
    airs, logs = ([log_since(table[:, 0], table[:, k]) for table in tables] for k in (8, 4))
    write_beside(out, logs, airs)


def pipe(cache: Path, out: Path) -> None:
    """The thermometer in the pipe, that in the tank being the measured air, from when the meter counts a full flow."""
    folder, logs, airs = cache / "wickyw/Heatflow/Renske", [], []
    for name, flow in PIPES.items():
        paths = (folder / f"{one}.txt" for one in (name, flow))
        frame, meter = (pd.read_csv(path, sep="\t", decimal=",").dropna(axis=1) for path in paths)
        begin = meter.iloc[:, 0][meter.iloc[:, 1] >= PULSES].iloc[0]
        flowing = frame[frame.iloc[:, 0] >= begin].to_numpy()
        for kept, k in ((airs, 1), (logs, 3)):
            kept.append(log_since(flowing[:, k - 1], flowing[:, k]))
    write_beside(out, logs, airs)


def sixth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    return [
        RealSet("oven at three powers and off", T, oven, None, NO_WATER),
        RealSet("board ten times to half", T, ten_times, None, NO_WATER),
        RealSet("board ten times, the heater beside it", T, ten_times_beside, None, NO_WATER),
        RealSet("first heater of a board on and off", T, _heater(0, (3660,)), None, NO_WATER),
        RealSet("second heater of a board at three powers", T, _heater(1, (9060, 10860)), None, NO_WATER),
        RealSet("first of two heaters at three powers", T, three_powers, None, NO_WATER),
        RealSet("plate at two powers in random turns", T, plate, None, NO_WATER),
        RealSet("rod of aluminium, air from its hot end", T, rod, None, NO_WATER),
        RealSet("rods of two surfaces, air from the hot end", T, rod_of_two_surfaces, None, NO_WATER),
        RealSet("bars of three metals, air from the hot end", T, bars, None, NO_WATER),
        RealSet("pipe of a heat exchanger, air from the tank", T, pipe, None, dry),
    ]
