"""The logs of `real_passes.py`: what of them is judged, and how each sensor responds, by other dives of it.

Least squares that share no code with the correction: a profile of the water, linear in its nodes, seen through lags in
series; for a sonde, the line of the air that it falls into, carried back to the launch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.signal import lfilter

CORMORANTS = "cpforager-1.3.1/data/PER_PSC_2008_11/*LBOU_{}_*TDR*.csv"
SEAL = "scikit_divemove-1.0.0/skdiveMove/tests/data/ag_mk7_2002_022.nc"
SONDES = "pydropsonde-0.4.1/example_data"
GLIDER = "basestation3/testdata/sg171_EKAMSAT_Apr24/p17101{}.nc"
GLIDER_FOUND, GLIDER_JUDGED = ("05", "09"), ("04", "06", "08")  # dives, as numbers 101xx
SONDE_FOLDERS = ("HALO/Level_0/HALO*/D*", "P3/Level_0/*/D*", "HALO/Level_0/empty_afile/D*")
OF_SONDES, OF_BIRDS, OF_SEAL, OF_GLIDER = (0.3, 1.6, 0.02), (4.0, 42.0, 2.0), (20.0, 170.0, 10.0), (1.0, 15.0, 0.25)
GRID = tuple(np.arange(*lags_s) for lags_s in (OF_SONDES, OF_BIRDS, OF_SEAL, OF_GLIDER))
FOUND_BY = (CORMORANTS.format(55), CORMORANTS.format(56), SEAL, f"{SONDES}/{SONDE_FOLDERS[0]}", GLIDER.format("04"))


@dataclass(frozen=True)
class Log:
    """What is corrected, and what is judged: `up` and `down` weigh rows, `air` is what their difference is in truth."""

    frame: pd.DataFrame
    up: np.ndarray
    down: np.ndarray
    air: np.ndarray

    def error(self, values: np.ndarray) -> np.ndarray:
        return (self.up - self.down) @ values - self.air

    def uncertainty(self, values: np.ndarray) -> np.ndarray:
        return np.hypot(self.up @ values, self.down @ values)


@dataclass(frozen=True)
class Dive:
    """Depth and reading on an even grid, and how the reading stood and went as the dive began."""

    depth_m: np.ndarray
    reading_c: np.ndarray
    start_c: float
    slope_k_s: float


@dataclass(frozen=True)
class Response:
    """Lags in series [s], the slowest last, and the scatter of their estimates."""

    lags_s: np.ndarray
    scatter_s: np.ndarray


@dataclass(frozen=True)
class RealSet:
    name: str
    what: str
    logs: list[Log]
    response: Response
    noise_k: float
    step_s: float  # of the grid that windows are laid on; 0: row by row
    # Samples, odd, up to some third of the lag: one as long as a dive makes both ways agree, whatever was read.
    windows: tuple[int, ...]
    lags_tried_s: np.ndarray
    figure: Callable[[list[np.ndarray]], float]


def rms(errors: Iterable[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(list(errors)) ** 2)))


def median_rms(errors: Iterable[np.ndarray]) -> float:
    return float(np.median([rms([one]) for one in errors]))


# --- the response, by least squares that know nothing of the correction ---


def lagged(inputs: np.ndarray, lag_s: float, start: float, step_s: float) -> np.ndarray:
    """Columns through one first-order lag, each straight between its samples."""
    keep = np.exp(-step_s / lag_s)
    middle = (inputs[1:] + inputs[:-1]) / 2.0
    first = np.full((1, inputs.shape[1]), start)
    return np.vstack([first, lfilter([1.0 - keep], [1.0, -keep], middle, axis=0, zi=keep * first)[0]])


def misfit(dives: list[Dive], lags_s: np.ndarray, step_s: float, layer_m: float) -> np.ndarray:
    """What is left of dives through one profile of the water, which is linear in its nodes."""
    nodes = np.arange(0.0, max(dive.depth_m.max() for dive in dives) + layer_m, layer_m)
    seen, left = [], []
    for dive in dives:
        water = np.array([np.interp(dive.depth_m, nodes, node) for node in np.eye(nodes.size)]).T
        started = np.zeros((dive.depth_m.size, 1))
        for k, lag_s in enumerate(lags_s):
            water = lagged(water, lag_s, 0.0, step_s)
            # What stands before the last lag is that which makes the reading go as it goes at first.
            started = lagged(started, lag_s, dive.start_c + dive.slope_k_s * sum(lags_s[k + 1 :]), step_s)
        seen.append(water)
        left.append(dive.reading_c - started[:, 0])
    a, y = np.vstack(seen), np.concatenate(left)
    stiff = 0.05 * np.sqrt(y.size / nodes.size) * np.diff(np.eye(nodes.size), 2, axis=0)
    profile = np.linalg.lstsq(np.vstack([a, stiff]), np.r_[y, np.zeros(len(stiff))], rcond=None)[0]
    return y - a @ profile


def response_of(groups: list, start_s: list[float], step_s: float, layer_m: float) -> Response:
    """Per group (waters, each the dives through it) the lags that leave least; their mean and scatter."""

    def left(log_lags: np.ndarray, waters: list) -> float:
        return float(np.mean(np.concatenate([misfit(d, np.exp(log_lags), step_s, layer_m) for d in waters]) ** 2))

    found = [np.exp(minimize(left, np.log(start_s), args=(g,), method="Nelder-Mead").x) for g in groups]
    return Response(np.mean(found, axis=0), np.std(found, axis=0, ddof=1))


# --- the four sets ---


def runs(depth: np.ndarray, below: float, deepest: float) -> list[tuple[int, int]]:
    """Stretches below a depth that reach another."""
    edges = np.flatnonzero(np.diff(np.r_[0, (depth > below).astype(int), 0]))
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if depth[a:b].max() > deepest]


def passes(frame: pd.DataFrame, dives: list[tuple[int, int]], top: float, layer: float) -> Log:
    """Each layer of each dive: the last time up through it, less the first time down."""
    depth, up, down = -frame.altitude_m.to_numpy(), [], []
    for a, b in dives:
        turn = a + int(np.argmax(depth[a:b]))
        for z in np.arange(top, depth[turn] - 1.5 * layer, layer):
            ways = [np.flatnonzero((depth[i:k] >= z) & (depth[i:k] < z + layer)) + i for i, k in ((a, turn), (turn, b))]
            if min(w.size for w in ways):
                first, last = (
                    np.split(w, np.flatnonzero(np.diff(w) > 1) + 1)[i] for w, i in zip(ways, (0, -1), strict=True)
                )
                down.append(np.isin(np.arange(depth.size), first) / first.size)
                up.append(np.isin(np.arange(depth.size), last) / last.size)
    return Log(frame, np.array(up), np.array(down), np.zeros(len(up)))


def bouts(path: Path) -> list[pd.DataFrame]:
    """Five dives and more that follow one another within 90 s, and a minute around them."""
    raw = pd.read_csv(path)
    stamp = pd.to_datetime(raw.date + " " + raw.time, format="mixed")
    time = (stamp - stamp.iloc[0]).dt.total_seconds().to_numpy()
    found: list[list[tuple[int, int]]] = [[]]
    for a, b in runs(raw.pressure.to_numpy(), 1.0, 4.0):
        if found[-1] and time[a] - time[found[-1][-1][1] - 1] > 90.0:
            found.append([])
        found[-1].append((a, b))
    frame = pd.DataFrame({"time_s": time, "temperature_c": raw.temperature, "altitude_m": -raw.pressure})
    spans = [(time[f[0][0]] - 60.0, time[f[-1][1] - 1] + 60.0) for f in found if len(f) >= 5]
    return [frame[(time >= a) & (time <= b)].reset_index(drop=True) for a, b in spans]


def cormorants(folder: Path) -> RealSet:
    first, other = (bouts(next(folder.glob(CORMORANTS.format(bird)))) for bird in (55, 56))
    groups, step_s = [], 0.2
    estimated = slice(3, 5)  # the first bird's second day; all else of both birds is judged
    for frame in first[estimated]:
        time, depth, reading = frame.time_s.to_numpy(), -frame.altitude_m.to_numpy(), frame.temperature_c.to_numpy()
        dives = []
        for a, b in runs(depth, 1.0, 4.0):
            near = (time > time[a] - 4.0) & (time < time[a] + 1.5)
            _, slope, start = np.polyfit(time[near] - time[a], reading[near], 2)
            grid = np.arange(time[a], time[b - 1], step_s)
            dives.append(Dive(np.interp(grid, time, depth), np.interp(grid, time, reading), start, slope))
        groups.append([[dive for dive in dives if dive.depth_m.size >= 40]])
    del first[estimated]
    judged = first + other
    logs = [passes(f, runs(-f.altitude_m.to_numpy(), 1.5, 4.0), 2.5, 1.0) for f in judged]
    deepest = max(-f.altitude_m.min() for f in judged)
    what = f"up minus down in each metre, {len(logs)} bouts of dives to {deepest:.0f} m by two birds, 10 Hz"
    response = response_of(groups, [3.0, 12.0], step_s, 2.0)
    return RealSet("cormorants, water", what, logs, response, 0.01, 0.1, (11, 21, 31, 41, 51, 61), GRID[1], rms)


def fur_seal(folder: Path) -> RealSet:
    with netCDF4.Dataset(folder / SEAL) as d:
        time, depth, reading = (
            np.ma.filled(d[n][:].astype(float), np.nan) for n in ("date_time", "depth", "temperature")
        )
    there = np.isfinite(depth) & np.isfinite(reading)
    time, depth, reading = time[there], depth[there], reading[there]
    dives = [
        (a, b) for a, b in runs(depth, 6.0, 25.0) if b - a > 10 and np.ptp(time[a - 12 : b + 8]) < 5.0 * (b - a + 21)
    ]
    half, step_s = len(dives) // 2, 5.0
    waters = [[Dive(depth[a - 3 : b + 1], reading[a - 3 : b + 1], reading[a - 3], 0.0)] for a, b in dives[:half]]
    logs = []
    for a, b in dives[half:]:
        w = slice(a - 24, b + 12)
        frame = pd.DataFrame({"time_s": time[w], "temperature_c": reading[w], "altitude_m": -depth[w]})
        logs.append(passes(frame, [(24, 24 + b - a)], 8.0, 4.0))
    what = f"up minus down in each 4 m, {len(logs)} dives of one fur seal, 5 s, steps of 0.1 K"
    response = response_of([waters[i::4] for i in range(4)], [40.0], step_s, 6.0)
    return RealSet("fur seal, water", what, logs, response, 0.03, step_s, (3, 5, 7, 9), GRID[2], rms)


def sonde(path: Path) -> pd.DataFrame:
    """A sonde's rows from 20 s before its launch until 90 s after it; `flies` is false before."""
    launch, rows = None, []
    for line in path.read_text(errors="replace").splitlines():
        cells = line.split()
        if " LAU " in line[:16]:
            launch = cells[4]
        if line.startswith("AVAPS-D") and cells[1] in ("S00", "P00") and len(cells) > 16:
            rows.append((cells[1] == "S00", cells[4], float(cells[5]), float(cells[6])))
    found = pd.DataFrame(rows, columns=["flies", "clock", "pressure_hpa", "temperature_c"])
    seconds = [int(c[:2]) * 3600 + int(c[2:4]) * 60 + float(c[4:]) for c in [*found.clock, launch]]
    found["time_s"] = np.round(np.array(seconds[:-1]) - seconds[-1], 2)
    sound = (found.pressure_hpa < 2000.0) & found.temperature_c.between(-95.0, 90.0) & found.time_s.between(-20.0, 90.0)
    return found[sound].drop(columns="clock").reset_index(drop=True)


def air_at(frame: pd.DataFrame, lag_s: float) -> np.ndarray:
    """The air where the sonde is, from the straight line through 7 to 20 s, when a lag of a second is long over."""
    w = frame[frame.time_s.between(7.0, 20.0)]
    air = w.temperature_c + lag_s * np.gradient(w.temperature_c, w.time_s)
    return np.polyval(np.polyfit(w.pressure_hpa, air, 1), frame.pressure_hpa)


def lag_of(frame: pd.DataFrame) -> float:
    """The one lag that leads from the first reading in free air through the first 4 s."""
    m = (frame.flies & frame.time_s.between(0.0, 4.0)).to_numpy()
    time, reading = frame.time_s.to_numpy()[m], frame.temperature_c.to_numpy()[m]

    def left(lag_s: float) -> float:
        air, value, total = air_at(frame, lag_s)[m], reading[0], 0.0
        for i, keep in enumerate(np.exp(-np.diff(time) / lag_s)):
            value = keep * value + (1.0 - keep) * (air[i] + air[i + 1]) / 2.0
            total += (value - reading[i + 1]) ** 2
        return total

    return float(min(np.arange(0.3, 2.5, 0.02), key=left))


def dropsondes(folder: Path) -> RealSet:
    frames = [sonde(path) for pattern in SONDE_FOLDERS for path in sorted((folder / SONDES).glob(pattern))]
    lags = [lag_of(frame) for frame in frames[::2]]
    response, logs = Response(np.array([np.median(lags)]), np.array([np.std(lags, ddof=1)])), []
    for frame in frames[1::2]:
        judged = np.flatnonzero(frame.flies & frame.time_s.between(0.3, 3.99))
        pick = np.eye(len(frame))[judged]
        logs.append(Log(frame.drop(columns="flies"), pick, 0.0 * pick, air_at(frame, response.lags_s[0])[judged]))
    what = f"first 4 s after the launch less the air's own line, median of {len(logs)} sondes, 2 Hz"
    return RealSet("dropsondes, air", what, logs, response, 0.02, 0.0, (0,), GRID[0], median_rms)


def dive_of(path: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows of a glider's optode, which lags, within those of the CTD beside it, which hardly does."""
    with netCDF4.Dataset(path) as d:
        names = ("aa4831_time", "aa4831_temp", "ctd_time", "temperature_raw", "time", "depth")
        own_s, own_c, ctd_s, ctd_c, time_s, depth_m = (np.ma.filled(d[n][:].astype(float), np.nan) for n in names)
    ctd = pd.DataFrame({"time_s": ctd_s, "temperature_c": ctd_c}).dropna()
    known = np.isfinite(depth_m)
    own = pd.DataFrame({"time_s": own_s, "temperature_c": own_c}).dropna().drop_duplicates("time_s")
    own = own[own.time_s.between(ctd.time_s.iloc[0], ctd.time_s.iloc[-1])].sort_values("time_s")
    frame = own.assign(altitude_m=-np.interp(own.time_s, time_s[known], depth_m[known]))
    return frame.reset_index(drop=True), ctd


def glider(folder: Path) -> RealSet:
    found = []
    for dive in GLIDER_FOUND:
        frame, ctd = dive_of(folder / GLIDER.format(dive))
        grid_s = np.arange(ctd.time_s.iloc[0], ctd.time_s.iloc[-1])
        water = np.interp(grid_s, ctd.time_s, ctd.temperature_c)[:, None]
        behind = [frame.temperature_c - np.interp(frame.time_s, grid_s, lagged(water, lag_s, water[0, 0], 1.0)[:, 0])
                  for lag_s in GRID[3]]  # fmt: skip
        best = int(np.argmin([np.std(left) for left in behind]))
        found.append((GRID[3][best], float(np.mean(behind[best]))))
    lags_s, offsets_k = zip(*found, strict=True)
    response, logs = Response(np.array([np.mean(lags_s)]), np.array([np.std(lags_s, ddof=1)])), []
    for dive in GLIDER_JUDGED:
        frame, ctd = dive_of(folder / GLIDER.format(dive))
        water = np.interp(frame.time_s, ctd.time_s, ctd.temperature_c) + np.mean(offsets_k)
        pick = np.eye(len(frame))
        logs.append(Log(frame, pick, 0.0 * pick, water))
    what = f"less the CTD beside it, {len(logs)} dives of a glider's optode to 500 m, 5 and 10 s"
    return RealSet("glider, water", what, logs, response, 0.005, 1.0, (5, 11, 21, 31), GRID[3], rms)
