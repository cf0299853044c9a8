"""A fifth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- nbauersfeld/tclab @667c274, data/tclab.model.{4.7,q.2,q.3}.csv: two thermometers of a control course's board, on
  a heater that is switched in equal cycles or to random powers for random times, and on one beside it that is left
  off, each second (no licence stated); q.1 is left out: its readings are whole steps from 20.9495 degC on, as those of
  the board's emulator are
- jm1261/ThermocoupleMonitoring @da44eee, Tutorials/Cups_of_Tea.csv: five thermometers put into cups of hot tea, which
  cool, each 5 s (MIT)

Every cut follows the log's own labels or its clock; none follows the reading that is judged.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from real_cache_sets import NO_WATER, NOT_WARMED, T, log_since, write_logs
from real_sets import RealSet
from real_third_sets import stretches

PHASES = 8  # of the equal cycles: the first four, heated and left
LEAST_ROWS = 60  # of a random power, that is held for so long at least
CUPS = 5
INTO_TEA_S = 180.0  # from the begin of the log


def _board(cache: Path, name: str, column: str) -> list[pd.DataFrame]:
    """A log for each time that the heater's power is held."""
    frame = pd.read_csv(cache / f"nbauersfeld/tclab/data/tclab.model.{name}.csv")
    time_s, value = (frame["Time(ns)"] / 1e9).to_numpy(float), frame[column].to_numpy(float)
    held = stretches(frame["Q1"].to_numpy(float))[1:]  # before the first change it rests
    return [log_since(time_s[rows], value[rows]) for rows in held]


def cycles(cache: Path, out: Path) -> None:
    """The thermometer on the heater."""
    write_logs(out, T, _board(cache, "4.7", "T1")[:PHASES])


def beside(cache: Path, out: Path) -> None:
    """The thermometer on the other heater, in the same cycles."""
    write_logs(out, T, _board(cache, "4.7", "T2")[:PHASES])


def random_powers(cache: Path, out: Path) -> None:
    """All powers of two logs that were held for long enough."""
    logs = [one for name in ("q.2", "q.3") for one in _board(cache, name, "T1")]
    write_logs(out, T, [log for log in logs if len(log) >= LEAST_ROWS])


def tea(cache: Path, out: Path) -> None:
    """A run for each thermometer, the first minutes of the log."""
    frame = pd.read_csv(cache / "jm1261/ThermocoupleMonitoring/Tutorials/Cups_of_Tea.csv")
    stamps = pd.to_datetime(frame["Timestamp"])
    time_s = (stamps - stamps.iloc[0]).dt.total_seconds().to_numpy()
    first = time_s <= INTO_TEA_S
    logs = [log_since(time_s[first], frame[f"Sensor {k}"].to_numpy(float)[first]) for k in range(1, CUPS + 1)]
    write_logs(out, T, logs)


def fifth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    return [
        RealSet("board heated in equal cycles", T, cycles, None, NO_WATER),
        RealSet("board beside the heated one", T, beside, None, NO_WATER),
        RealSet("board at random powers", T, random_powers, None, NO_WATER),
        RealSet("five thermometers put into tea", T, tea, None, NOT_WARMED),
    ]
