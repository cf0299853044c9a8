"""A thirteenth group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- januarharianto/respR @c0ce01f, vignettes/{fishMR.txt,zebrafish.csv}: the oxygen of chambers in which fish breathe, and
  which are flushed now and then, each 1 s and 2 s (GPL 3)
- ning-y/plants-pm-data @7ad0216, data/05-analysis-proper/{19-octa-nothing-3d,20octa-nothing3d,21octa-nothing-3d,
  21octb-nothing-3d,22octa-nothing-3d,25octa-plant-3d,25octb-plant-3d,26octa-plant-3d,27octa-plant-3d,28octa-plant-3d}
  .csv: fine dust of smoke in a box, empty or with a potted plant, each minute (no licence stated)
- uwenji/MemmertControl @3a80d6a, data/log/incubator_history.json: an incubator's own thermometer and three probes in
  it, each 72 s. The file holds three hours and was committed anew each minute: it lies as data/log/COMMIT/
  incubator_history.json, as it was at each of `INCUBATOR_COMMITS` (no licence stated)
- Teitei011/DELTA-B3112GG @ea6b11b, csv/{ground,normal_stand,cooling_stand,cooling_Test_{300,500,1000,2000,2200}}.csv: a
  laptop's graphics chip after all work was given to the processor beside it, each 5 s (MIT)
- Groves-Dixon-Matz-laboratory/Acropora_gene_expression_meta @eaed5a0, beww_experiment/
  {chilled/chilled_official_TREATMENT_12-5-18,heat/official_heat_TREATMENT_12-10-18,three_way/official_All_three_
  {Cold_to_hot,Hot_to_Cold,heat2_alongside_allThree}_12-12-18}.csv: a logger in tanks with corals whose water is chilled
  or heated, each 5 minutes (no licence stated)
- EngOtiato/temperature-control @25f0353, Raw_Experimental_Data/{1L_WBT_FROM_25_100,Without_Lid_0cm_a}.xlsx: water in an
  electric pot at five powers, three times each, and at five fillings, each 10 s (Apache 2.0)

Cuts follow the set point of the incubator, the last reading at which a dust sensor is saturated, and the authors' files
and columns of one heating each. Where none tells it, they follow what a plot shows: when oxygen begins to rise, and
from when to when the tanks are chilled or heated. What is no temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, RH, T, log_since, write_logs
from real_sets import RealSet, write_campaign
from real_seventh_sets import DAY_S
from real_twelfth_sets import PERCENT_PER_MG_L

FISH = "januarharianto/respR/vignettes"
FISH_HEAD, FISH_STAMP, FISH_OXYGEN = 13, 1, 5
FLUSHED_AT_S = (4002.0, 35245.0, 38270.0, 41297.0, 44650.0, 58100.0, 59767.0)
FLUSHED_S = 340.0
ZEBRAFISH_ROWS, ZEBRAFISH_CHANNELS = slice(238, 330), range(3, 7)
SMOKE = "ning-y/plants-pm-data/data/05-analysis-proper"
EMPTY_BOX = "19-octa-nothing-3d", "20octa-nothing3d", "21octa-nothing-3d", "21octb-nothing-3d", "22octa-nothing-3d"
PLANTED_BOX = tuple(f"{day}-plant-3d" for day in ("25octa", "25octb", "26octa", "27octa", "28octa"))
SATURATED, PERCENT_PER_UG_M3, SMOKE_S = 999.0, 0.1, 21600.0
INCUBATOR = "uwenji/MemmertControl/data/log"
INCUBATOR_COMMITS = (
    *("85562d43e", "b7133d0a3", "77967dd2e", "5a5188e96", "d62065a83", "d1d935e13", "301fc1a60", "f8b7f4e38"),
    *("e7042477d", "b1a9ba100", "2ac9c968a", "8f7b2433e", "808975625", "3ad534165", "b13539475"),
)
SET_ANEW = (
    *("2025-10-31 22:18", "2025-11-01 03:21", "2025-11-01 10:05", "2025-11-01 14:05"),
    *("2025-11-01 20:22", "2025-11-02 03:08"),
)
SET_ANEW_S = 14000.0
ELSEWHERE_K = {"temperature_standard_uncertainty_k": 1.0}  # the probes rest one to two kelvin above the thermometer
LAPTOP = "Teitei011/DELTA-B3112GG/csv"
STANDS = ("ground", "normal_stand", "cooling_stand", *(f"cooling_Test_{rpm}" for rpm in (300, 500, 1000, 2000, 2200)))
CORAL_TANKS = "Groves-Dixon-Matz-laboratory/Acropora_gene_expression_meta/beww_experiment"
THREE_WAY = "three_way/official_All_three_{}_12-12-18"
COLD_FIRST, HOT_FIRST = THREE_WAY.format("Cold_to_hot"), THREE_WAY.format("Hot_to_Cold")
# Minutes since a log's first row.
CHILLED = (
    ("chilled/chilled_official_TREATMENT_12-5-18", 10.0, 355.0),
    (COLD_FIRST, 75.0, 195.0),
    (HOT_FIRST, 200.0, 320.0),
)
HEATED = (
    ("heat/official_heat_TREATMENT_12-10-18", 20.0, 190.0),
    (HOT_FIRST, 75.0, 195.0),
    (COLD_FIRST, 205.0, 325.0),
    (THREE_WAY.format("heat2_alongside_allThree"), 75.0, 250.0),
)
POT = "EngOtiato/temperature-control/Raw_Experimental_Data"
BELOW_BOILING_C, POT_EVERY = 95.0, 3
POT_SHEETS, IN_WATER, HOTTEST = range(1, 6), "D", "K"


def flushes(cache: Path, out: Path) -> None:
    lines = (cache / FISH / "fishMR.txt").read_text(encoding="latin1").splitlines()[FISH_HEAD:]
    rows = [line.split("\t") for line in lines]
    table = np.array([(row[FISH_STAMP], row[FISH_OXYGEN]) for row in rows if len(row) > FISH_OXYGEN], float)
    log = log_since(table[:, 0], PERCENT_PER_MG_L * table[:, 1], RH)
    write_campaign(out, RH, log, [(at, at + FLUSHED_S) for at in FLUSHED_AT_S])


def four_chambers(cache: Path, out: Path) -> None:
    """Each chamber a run, from where its oxygen begins to rise to where it falls again."""
    lines = (cache / FISH / "zebrafish.csv").read_text(encoding="latin1").splitlines()
    rows = [line.split(",") for line in lines if line[2:3] == ":" == line[5:6]][ZEBRAFISH_ROWS]
    clock = pd.to_timedelta([row[0] for row in rows]).total_seconds().to_numpy()
    since = (clock - clock[0]) % DAY_S  # midnight is among them
    oxygen = [np.array([row[k] for row in rows], float) for k in ZEBRAFISH_CHANNELS]
    write_logs(out, RH, [log_since(since, PERCENT_PER_MG_L * one, RH) for one in oxygen])


def _smoke(names: Sequence[str]) -> Callable[[Path, Path], None]:
    """From the first reading after the last one at which the sensor is saturated."""

    def make(cache: Path, out: Path) -> None:
        logs = []
        for name in names:
            frame = pd.read_csv(cache / SMOKE / f"{name}.csv", header=None, names=["stamp", "kind", "value"])
            frame = frame[frame["kind"] == "pm2.5"]
            value = frame["value"].to_numpy(float)
            since = (pd.to_datetime(frame["stamp"]) - pd.Timestamp(0)).dt.total_seconds().to_numpy()
            first = int(np.flatnonzero(value >= SATURATED)[-1]) + 1
            inside = (since >= since[first]) & (since < since[first] + SMOKE_S)
            logs.append(log_since(since[inside], PERCENT_PER_UG_M3 * value[inside], RH))
        write_logs(out, RH, logs)

    return make


def _probe_in_incubator(number: int) -> Callable[[Path, Path], None]:
    """From each change of the set point on."""

    def make(cache: Path, out: Path) -> None:
        files = [cache / INCUBATOR / one / "incubator_history.json" for one in INCUBATOR_COMMITS]
        entries = {row["timestamp"]: row["readings"] for path in files for row in json.loads(path.read_text())["data"]}
        stamps = sorted(entries)
        since = (pd.to_datetime(pd.Series(stamps)) - pd.Timestamp(SET_ANEW[0])).dt.total_seconds()
        log, air = (
            pd.DataFrame({"time_s": since, COLUMN[T]: [entries[one][name] for one in stamps]}).dropna()
            for name in (f"TempSensor{number}Read", "Temp1Read")
        )
        begins = [(pd.Timestamp(at) - pd.Timestamp(SET_ANEW[0])).total_seconds() for at in SET_ANEW]
        write_campaign(out, T, log, [(at, at + SET_ANEW_S) for at in begins], air, ELSEWHERE_K)

    return make


def graphics_chip(cache: Path, out: Path) -> None:
    frames = [pd.read_csv(cache / LAPTOP / f"{name}.csv") for name in STANDS]
    since = [(pd.to_datetime(one["Timestamp"]) - pd.Timestamp(0)).dt.total_seconds().to_numpy() for one in frames]
    logs = [log_since(at, one["GPU_Temp"].to_numpy(float)) for at, one in zip(since, frames, strict=True)]
    write_logs(out, T, logs)


def _tanks(cuts: Sequence[tuple[str, float, float]]) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        logs = []
        for name, begin, end in cuts:
            frame = pd.read_csv(cache / CORAL_TANKS / f"{name}.csv", encoding="utf-8-sig").iloc[:, :2]
            stamps = pd.to_datetime(frame.iloc[:, 0], format="%m/%d/%y %H:%M")
            since = (stamps - stamps.iloc[0]).dt.total_seconds()
            inside = since.between(60.0 * begin, 60.0 * end)
            logs.append(log_since(since[inside].to_numpy(), frame.iloc[:, 1][inside].to_numpy(float)))
        write_logs(out, T, logs)

    return make


def _sheet(path: Path, number: int) -> pd.DataFrame:
    """A sheet's numbers by the letters of their columns; cells that hold text are missing."""
    with ZipFile(path) as archive:
        text = archive.read(f"xl/worksheets/sheet{number}.xml").decode()
    rows = []
    for row in (e for _, e in ET.iterparse(StringIO(text)) if e.tag.endswith("}row")):
        cells = [cell for cell in row if cell.get("t", "n") == "n" and len(cell)]
        rows.append({cell.get("r").rstrip("0123456789"): float(cell[-1].text) for cell in cells})
    return pd.DataFrame([row for row in rows if "A" in row])


def five_powers(cache: Path, out: Path) -> None:
    """Each column a run, until shortly before the water boils, each third row."""
    table = _sheet(cache / POT / "1L_WBT_FROM_25_100.xlsx", 1)
    logs = []
    for name in table.columns.drop("A"):
        column = table[["A", name]].dropna().to_numpy()
        end = int(np.flatnonzero(column[:, 1] > BELOW_BOILING_C)[0])
        logs.append(log_since(*column[:end:POT_EVERY].T))
    write_logs(out, T, logs)


def _five_fillings(column: str) -> Callable[[Path, Path], None]:
    """Each sheet a run, from its first row on; the power comes a minute or so later."""

    def make(cache: Path, out: Path) -> None:
        sheets = [_sheet(cache / POT / "Without_Lid_0cm_a.xlsx", k)[["A", column]].dropna() for k in POT_SHEETS]
        write_logs(out, T, [log_since(*one.to_numpy().T) for one in sheets])

    return make


def thirteenth_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry = (*NOT_WARMED, *NO_WATER)
    probes = ("condensation", "evaporative_cooling", "radiative_heating")
    return [
        RealSet("oxygen of a fish's chamber, flushed", RH, flushes, None, dry),
        RealSet("oxygen of four chambers, flushed", RH, four_chambers, None, dry),
        RealSet("smoke in an empty box", RH, _smoke(EMPTY_BOX), None, dry),
        RealSet("smoke in a box with a plant", RH, _smoke(PLANTED_BOX), None, dry),
        RealSet("first probe of an incubator, air from its thermometer", T, _probe_in_incubator(1), None, probes),
        RealSet("third probe of an incubator, air from its thermometer", T, _probe_in_incubator(3), None, probes),
        RealSet("graphics chip beside a processor at work", T, graphics_chip, None, NO_WATER),
        RealSet("tanks that are chilled", T, _tanks(CHILLED), None, NOT_WARMED),
        RealSet("tanks that are heated", T, _tanks(HEATED), None, ("condensation",)),
        RealSet("water in a pot at five powers", T, five_powers, None, ("condensation",)),
        RealSet("water of five fillings in an open pot", T, _five_fillings(IN_WATER), None, ("condensation",)),
        RealSet("hottest place of an open pot", T, _five_fillings(HOTTEST), None, NO_WATER),
    ]
