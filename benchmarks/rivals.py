"""What one would fit without this project: one lag, two lags in series, two exponentials, the ideal body, each with a
dead time, by least squares over the training runs, and judged on runs that took no part.

Shares no code with `analysis`. A run's own start and two plateaus are placed by `place`, in training and, with all else
held, on held-out runs: the plateaus by linear least squares, the start by search, both within two standard
uncertainties of what the campaign states (10 ms; 0.02 K or 0.1 %RH), freely where it states nothing. Where the air was
measured the trace drives the models; what its lowest and its highest value are off by, within two standard
uncertainties of the reference, stands for the plateaus, and a run that had not settled when its record began has that
departure as a third coefficient. A sensor beside a reference need not read what that reads: there each of the lags
stands once more with a line, a gain and an offset of the air that all runs share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from records import Record, smooth
from rival_models import Model, Modes, models
from scipy.linalg import solve_banded
from scipy.optimize import least_squares, minimize_scalar

Array = NDArray[np.float64]

WITHIN = 2.0  # standard uncertainties
START_KNOWN_S = 0.01
AIR_KNOWN = {"temperature": 0.02, "humidity": 0.1}
TINY_S = 1e-9
CHOSEN = "best in training"
SMALL = 1e-4  # of a parameter, to see what it does
LINES = 3  # rounds of a line and a lag in turns
SETTLED = 3.0  # t63 from the begin of a record on, from which it says what the line is
LINED = ("one lag", "two lags")
WIDE = 4.0  # in ln: how far a parameter may go from its first guess


def reply(modes: Modes, record: Record, start_s: float, dead_s: float) -> Array:
    """What the model shows at the record's stamps: share of a unit step from `start_s`, or the reply to the trace."""
    weights, rates = modes
    if record.air is None:
        since = np.maximum(record.time_s - start_s - dead_s, 0.0)
        shown = 1.0 - np.exp(-since[:, None] * rates) @ weights
        return np.where(since > 0.0, shown, 0.0)
    time, air = record.air
    at = record.time_s - dead_s
    place = np.searchsorted(time, at, side="right")
    out = np.full(at.size, air[0])
    width = np.maximum(np.diff(time), TINY_S)
    slope = np.append(np.diff(air) / width, 0.0)
    decay = np.exp(-width[:, None] * rates)
    states, rests = np.empty((time.size, rates.size)), air[:, None] - slope[:, None] / rates
    driven = rests[:-1] * (1.0 - decay) + (slope[:-1] * width)[:, None]
    for j in range(rates.size):  # z' = decay z + driven, from one reading of the air to the next
        band = np.vstack([np.ones(time.size), np.append(-decay[:, j], 0.0)])
        states[:, j] = solve_banded((1, 0), band, np.append(air[0], driven[:, j]))
    inside = place > 0
    k = place[inside] - 1
    since = at[inside] - time[k]
    fading = np.exp(-since[:, None] * rates) * (states[k] - rests[k])
    out[inside] = (rests[k] + fading) @ weights + slope[k] * since * weights.sum()
    return out


def place(modes: Modes, record: Record, dead_s: float, channel: str) -> tuple[float, Array, Array]:
    """A run's own start, its two plateaus and the residuals (n,) where it fits best under a model that is held."""
    if record.air is not None:
        return record.onset_s, *levels(modes, record, record.onset_s, dead_s, channel)

    def square(start_s: float) -> float:
        return float((levels(modes, record, start_s, dead_s, channel)[1] ** 2).sum())

    # The misfit over the start has one valley near the truth but may be flat far off: a scan, then a search.
    scan = np.linspace(*_range_of_start(modes, record), 7 if record.start_s is not None else 17)
    squares = [square(s) for s in scan]
    best = int(np.argmin(squares))
    around = scan[max(best - 1, 0)], scan[min(best + 1, scan.size - 1)]
    found = minimize_scalar(square, bounds=around, method="bounded", options={"xatol": 1e-4 * (around[1] - around[0])})
    start = float(found.x) if found.fun < squares[best] else float(scan[best])
    return start, *levels(modes, record, start, dead_s, channel)


def _range_of_start(modes: Modes, record: Record) -> tuple[float, float]:
    """Where a run's start may lie [s]."""
    if record.start_s is not None:
        return record.start_s - WITHIN * START_KNOWN_S, record.start_s + WITHIN * START_KNOWN_S
    late = float((modes[0] / modes[1]).sum()) + 5.0 * float(np.median(np.diff(record.time_s)))
    return record.onset_s - 2.0 * late, record.onset_s + late


def levels(modes: Modes, record: Record, start_s: float, dead_s: float, channel: str) -> tuple[Array, Array]:
    """A run's plateaus and residuals (n,) where everything else is held."""
    if record.air is not None:
        return _place_in_air(modes, record, dead_s)
    shown = reply(modes, record, start_s, dead_s)
    ends = _plateaus(shown, record, channel)
    return ends, record.value - ends[0] - (ends[1] - ends[0]) * shown


def _place_in_air(modes: Modes, record: Record, dead_s: float) -> tuple[Array, Array]:
    """What a measured air is off by at its two ends, and what a reading had not settled from when it began."""
    assert record.air is not None
    weights, rates = modes
    first, (low, high) = min(record.time_s[0], record.air[0][0]), (record.air[1].min(), record.air[1].max())
    shown = reply(modes, record, first, dead_s)
    share = (shown - low) / max(high - low, TINY_S)
    unsettled = np.exp(-(record.time_s - first)[:, None] * rates) @ weights
    design, left = np.column_stack([1.0 - share, share, unsettled]), record.value - shown
    bound, off, free = WITHIN * record.air_uncertainty, np.zeros(3), [0, 1, 2]
    for _ in range(3):
        rest = left - design @ np.where(np.isin(np.arange(3), free), 0.0, off)
        off[free] = np.linalg.lstsq(design[:, free], rest, rcond=None)[0]
        beyond = [i for i in free if i < 2 and abs(off[i]) > bound]
        if not beyond:
            break
        off[beyond] = np.sign(off[beyond]) * bound
        free = [i for i in free if i not in beyond]
    return off, left - design @ off


def _plateaus(shown: Array, record: Record, channel: str) -> Array:
    """Source and destination (2,) by linear least squares, held to what is known of them."""
    design = np.column_stack([1.0 - shown, shown])
    ends = np.linalg.lstsq(design, record.value, rcond=None)[0]
    known = [record.source, record.destination]
    free = [0, 1]
    for i in (0, 1):
        if known[i] is None:
            continue
        bound = WITHIN * AIR_KNOWN[channel]
        if abs(ends[i] - known[i]) > bound:
            ends[i] = known[i] + np.sign(ends[i] - known[i]) * bound
            free.remove(i)
    if len(free) == 1:  # the other end anew, beside the one that is held
        i, j = free[0], 1 - free[0]
        column = design[:, i]
        ends[i] = column @ (record.value - design[:, j] * ends[j]) / max(float(column @ column), 1e-12)
        if known[i] is not None:
            ends[i] = np.clip(ends[i], known[i] - WITHIN * AIR_KNOWN[channel], known[i] + WITHIN * AIR_KNOWN[channel])
    return ends


@dataclass(frozen=True)
class Fitted:
    """A rival as fitted to training runs: shared parameters, dead time [s], the error over the training samples."""

    model: Model
    channel: str
    parameters: Array
    dead_s: float
    train_rmse: float
    line: tuple[float, float] = (1.0, 0.0)  # gain and offset of a measured air

    @property
    def modes(self) -> Modes:
        return self.model.modes(self.parameters)

    @property
    def t63_s(self) -> float:
        """Time to 1 - 1/e of a step, dead time left out [s]."""
        weights, rates = self.modes
        time = np.geomspace(1e-3, 60.0, 4000) / rates.min()
        shown = 1.0 - np.exp(-time[:, None] * rates) @ weights
        return float(np.interp(1.0 - np.exp(-1.0), shown, time))


def fit_rival(model: Model, records: Sequence[Record], channel: str) -> Fitted:
    """Fit one rival to training runs: shared parameters and dead time by multi-start least squares.

    The dead time is fitted only where something says when the change began (a stated start, a measured air).
    """
    thin = [r.thinned() for r in records]
    datable = any(r.start_s is not None or r.air is not None for r in records)
    guess = float(np.log(np.median([_rough_t63(r) for r in records])))
    tried = [_descend(model, thin, channel, first, guess, datable) for first in model.guesses(guess)]
    best = min(tried, key=lambda found: found[0])[1]
    shared, dead = (best[:-1], float(np.exp(best[-1]))) if datable else (best, 0.0)
    fitted = Fitted(model, channel, shared, dead, 0.0)
    return Fitted(model, channel, shared, dead, _mean_rmse(errors(fitted, records)))


def fit_line(model: Model, records: Sequence[Record], channel: str) -> Fitted:
    """The same where the air was measured, with a gain and an offset of the air: in turns with the lags."""
    line = (1.0, 0.0)
    for _ in range(LINES):
        fitted = fit_rival(model, [_on_line(r, line) for r in records], channel)
        design, shown = [], []
        for record in records:
            reply_to_air = reply(fitted.modes, record, record.onset_s, fitted.dead_s)
            settled = record.time_s - record.time_s[0] > SETTLED * fitted.t63_s
            design.append(np.column_stack([reply_to_air, np.ones(reply_to_air.size)])[settled])
            shown.append(record.value[settled])
        found = np.linalg.lstsq(np.concatenate(design), np.concatenate(shown), rcond=None)[0]
        line = float(found[0]), float(found[1])
    fitted = replace(fit_rival(model, [_on_line(r, line) for r in records], channel), line=line)
    return replace(fitted, train_rmse=_mean_rmse(errors(fitted, records)))


def _on_line(record: Record, line: tuple[float, float]) -> Record:
    """A run with its measured air on a line."""
    if record.air is None:
        return record
    return replace(record, air=(record.air[0], line[0] * record.air[1] + line[1]))


def _descend(
    model: Model, records: Sequence[Record], channel: str, first: Array, guess: float, datable: bool
) -> tuple[float, Array]:
    """Least squares from one first guess: its cost and the shared parameters, the log of the dead time last.

    Every run's start is a parameter of its own that moves that run alone; its plateaus follow from the rest.
    """
    shared = np.append(first, guess - 4.0) if datable else first
    n = shared.size
    windows = np.array([_range_of_start(model.modes(first), r) for r in records])
    steps = SMALL * np.append(np.ones(n), windows[:, 1] - windows[:, 0])
    ends = np.cumsum([r.time_s.size for r in records])

    def missed(p: Array, i: int) -> Array:
        modes, dead = (model.modes(p[: n - 1]), np.exp(p[n - 1])) if datable else (model.modes(p[:n]), 0.0)
        return levels(modes, records[i], p[n + i], dead, channel)[1] / np.sqrt(records[i].time_s.size)

    def residuals(p: Array) -> Array:
        return np.concatenate([missed(p, i) for i in range(len(records))])

    def jacobian(p: Array) -> Array:
        now, table = residuals(p), np.zeros((ends[-1], p.size))
        for k in range(p.size):
            moved = p.copy()
            moved[k] += steps[k]
            for i in range(len(records)) if k < n else [k - n] if records[k - n].air is None else []:
                rows = slice(ends[i] - records[i].time_s.size, ends[i])
                table[rows, k] = (missed(moved, i) - now[rows]) / steps[k]
        return table

    begin = np.append(shared, [place(model.modes(first), r, 0.0, channel)[0] for r in records])
    low, high = np.append(shared - WIDE, windows[:, 0]), np.append(shared + WIDE, windows[:, 1])
    scale = np.append(np.full(n, 0.3), 0.1 * (windows[:, 1] - windows[:, 0]))
    begin = np.clip(begin, low, high)
    found = least_squares(residuals, begin, jacobian, bounds=(low, high), x_scale=scale, max_nfev=80)
    return float(found.cost), found.x[:n]


def _rough_t63(record: Record) -> float:
    end = np.median(record.value[-max(record.value.size // 20, 1) :])
    before = record.value[record.time_s <= record.onset_s]
    first = np.median(before) if before.size else record.value[0]
    share = (smooth(record.value) - first) / (end - first if end != first else 1.0)
    late = np.flatnonzero((share > 0.632) & (record.time_s > record.onset_s))
    reached = record.time_s[late[0]] if late.size else record.time_s[-1]
    return float(max(reached - record.onset_s, 0.5 * np.median(np.diff(record.time_s))))


def errors(fitted: Fitted, records: Sequence[Record]) -> dict[str, float]:
    """Mean square error of each run over its samples, its start and plateaus placed."""
    found = {}
    for record in (_on_line(r, fitted.line) for r in records):
        missed = place(fitted.modes, record, fitted.dead_s, fitted.channel)[2]
        found[record.id] = float(np.mean(missed[record.time_s >= record.judged_from_s] ** 2))
    return found


def _mean_rmse(found: dict[str, float]) -> float:
    return float(np.sqrt(np.mean(list(found.values()))))


def held_out(records: Sequence[Record], channel: str, folds: int) -> dict[str, dict[str, float]]:
    """For each rival the rms error of every run under a fit that never saw it; run k is in fold k % folds.

    `CHOSEN` is the rival that leaves least of each fold's training runs: what one can choose without the held-out ones.
    """
    beside = all(r.air is not None for r in records)
    lined = {f"{name} and a line": models(channel)[name] for name in LINED if beside}
    found: dict[str, dict[str, float]] = {name: {} for name in (*models(channel), *lined, CHOSEN)}
    for k in range(folds):
        train = [r for i, r in enumerate(records) if i % folds != k]
        test = [r for i, r in enumerate(records) if i % folds == k]
        if not (train and test):
            continue
        fitted = {name: fit_rival(model, train, channel) for name, model in models(channel).items()}
        fitted |= {name: fit_line(model, train, channel) for name, model in lined.items()}
        fitted[CHOSEN] = min(fitted.values(), key=lambda f: f.train_rmse)
        for name, rival in fitted.items():
            found[name] |= {i: float(np.sqrt(m)) for i, m in errors(rival, test).items()}
    return found
