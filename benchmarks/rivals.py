"""What one would fit without this project: one lag, two lags in series, two exponentials, the ideal body, each with a
dead time, by least squares over the training runs, and judged on runs that took no part.

Shares no code with `analysis`. A run's own start and two plateaus are placed by `place`, in training and, with all else
held, on held-out runs: the plateaus by linear least squares, the start by search, both within two standard
uncertainties of what the campaign states (10 ms; 0.02 K or 0.1 %RH), freely where it states nothing. Where the air was
measured the trace drives the models, and the two plateaus are an offset and a scale of the reading.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from records import Record, smooth
from scipy.optimize import least_squares, minimize_scalar

Array = NDArray[np.float64]
Modes = tuple[Array, Array]  # weights with sum 1, rates [1/s]

WITHIN = 2.0  # standard uncertainties
START_KNOWN_S = 0.01
AIR_KNOWN = {"temperature": 0.02, "humidity": 0.1}
TERMS = 60
TINY_S = 1e-9


# --- the models: shared parameters -> modes -------------------------------------------------------------------------


def _one_lag(p: Array) -> Modes:
    return np.ones(1), np.exp(-p[:1])


def _two_lags(p: Array) -> Modes:
    slow, fast = np.exp(p[0]), np.exp(p[0]) / (1.0 + 1e-3 + np.exp(p[1]))
    return np.array([slow, -fast]) / (slow - fast), 1.0 / np.array([slow, fast])


def _two_exponentials(p: Array) -> Modes:
    share = 1.0 / (1.0 + np.exp(-p[2]))
    return np.array([1.0 - share, share]), np.exp(-np.array([p[0], p[0] + np.exp(p[1])]))


def _sphere(p: Array) -> Modes:
    n = np.arange(1, TERMS + 1)
    return -2.0 * (-1.0) ** n, (n * np.pi) ** 2 * np.exp(-p[0])


def _film(p: Array) -> Modes:
    k = (np.arange(TERMS) + 0.5) * np.pi
    return 2.0 / k**2, k**2 * np.exp(-p[0])


@dataclass(frozen=True)
class Model:
    """A rival: its modes from its parameters, and the starts to try, given a first guess of ln t63 [s]."""

    name: str
    modes: Callable[[Array], Modes]
    starts: tuple[tuple[float, ...], ...]  # relative to ln t63 in the first parameter

    def guesses(self, log_t63: float) -> list[Array]:
        return [np.array([log_t63 + s[0], *s[1:]]) for s in self.starts]


MODELS = {
    "one lag": Model("one lag", _one_lag, ((0.0,), (-1.0,))),
    "two lags": Model("two lags", _two_lags, ((-0.2, 1.0), (-0.5, 0.0), (0.0, 3.0))),
    "two exponentials": Model(
        "two exponentials",
        _two_exponentials,
        ((-0.3, 0.5, -1.0), (-0.2, 1.0, -2.5), (-1.0, 0.0, 0.0), (-0.1, -0.5, 0.5)),
    ),
    "ideal body": Model("ideal body", _sphere, ((1.77,), (0.8,))),
}


def models(channel: str) -> dict[str, Model]:
    """The rivals of a channel: the ideal body is a sphere read at its core, or a film read as its mean."""
    if channel == "temperature":
        return MODELS
    return MODELS | {"ideal body": Model("ideal body", _film, ((1.14,), (0.2,)))}


# --- replies, placing, fitting --------------------------------------------------------------------------------------


def reply(modes: Modes, record: Record, start_s: float, dead_s: float) -> Array:
    """What the model shows at the record's stamps: share of a unit step from `start_s`, or the reply to the trace."""
    weights, rates = modes
    if record.air is None:
        since = np.maximum(record.time_s - start_s - dead_s, 0.0)
        shown = 1.0 - np.exp(-since[:, None] * rates) @ weights
        return np.where(since > 0.0, shown, 0.0)
    time, air = record.air
    z = np.full(rates.size, air[0])
    at = record.time_s - dead_s
    place = np.searchsorted(time, at, side="right")
    out = np.full(at.size, air[0])
    width = np.maximum(np.diff(time), TINY_S)
    slope = np.append(np.diff(air) / width, 0.0)
    decay = np.exp(-width[:, None] * rates)
    states, rests = np.empty((time.size, rates.size)), air[:, None] - slope[:, None] / rates
    for k in range(time.size):
        states[k] = z
        if k < width.size:
            z = rests[k] + slope[k] * width[k] + (z - rests[k]) * decay[k]
    inside = place > 0
    k = place[inside] - 1
    since = at[inside] - time[k]
    fading = np.exp(-since[:, None] * rates) * (states[k] - rests[k])
    out[inside] = (rests[k] + fading) @ weights + slope[k] * since * weights.sum()
    return out


def place(modes: Modes, record: Record, dead_s: float, channel: str) -> tuple[float, Array, Array]:
    """A run's own start, its two plateaus and the residuals (n,) where it fits best under a model that is held."""

    def missed(start_s: float) -> tuple[Array, Array]:
        shown = reply(modes, record, start_s, dead_s)
        ends = _plateaus(shown, record, channel)
        return record.value - ends[0] - (ends[1] - ends[0]) * shown, ends

    if record.air is not None:
        return record.onset_s, *missed(record.onset_s)[::-1]
    slowest = float(1.0 / modes[1].min())
    if record.start_s is not None:
        low, high = record.start_s - WITHIN * START_KNOWN_S, record.start_s + WITHIN * START_KNOWN_S
    else:
        period = float(np.median(np.diff(record.time_s)))
        low, high = record.onset_s - 2.0 * slowest - 5.0 * period, record.onset_s + slowest + 5.0 * period
    # The misfit over the start has one valley near the truth but may be flat far off: a scan, then a search.
    scan = np.linspace(low, high, 9 if record.start_s is not None else 33)
    squares = [float((missed(s)[0] ** 2).sum()) for s in scan]
    best = int(np.argmin(squares))
    around = scan[max(best - 1, 0)], scan[min(best + 1, scan.size - 1)]
    found = minimize_scalar(lambda s: float((missed(s)[0] ** 2).sum()), bounds=around, method="bounded")
    start = float(found.x) if found.fun < squares[best] else float(scan[best])
    return start, *missed(start)[::-1]


def _plateaus(shown: Array, record: Record, channel: str) -> Array:
    """Source and destination (2,) by linear least squares, held to what is known of them."""
    design = np.column_stack([1.0 - shown, shown])
    ends = np.linalg.lstsq(design, record.value, rcond=None)[0]
    known = [None, None] if record.air is not None else [record.source, record.destination]
    free = [i for i in (0, 1)]
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
    guess = np.log(np.median([_rough_t63(r) for r in records]))

    def residuals(p: Array) -> Array:
        shared, dead = (p[:-1], np.exp(p[-1])) if datable else (p, 0.0)
        parts = [place(model.modes(shared), r, dead, channel)[2] / np.sqrt(r.time_s.size) for r in thin]
        return np.nan_to_num(np.concatenate(parts), nan=1e6, posinf=1e6, neginf=-1e6)

    best = None
    for start in model.guesses(float(guess)):
        first = np.append(start, guess - 4.0) if datable else start
        bounds = first - 9.0, first + 9.0
        found = least_squares(residuals, first, bounds=bounds, x_scale=0.3, diff_step=1e-4, max_nfev=60)
        if best is None or found.cost < best.cost:
            best = found
    shared, dead = (best.x[:-1], float(np.exp(best.x[-1]))) if datable else (best.x, 0.0)
    fitted = Fitted(model, channel, shared, dead, 0.0)
    return Fitted(model, channel, shared, dead, _mean_rmse(errors(fitted, records)))


def _rough_t63(record: Record) -> float:
    end = np.median(record.value[-max(record.value.size // 20, 1) :])
    first = (
        np.median(record.value[record.time_s <= record.onset_s])
        if record.onset_s > record.time_s[0]
        else record.value[0]
    )
    share = (smooth(record.value) - first) / (end - first if end != first else 1.0)
    late = np.flatnonzero((share > 0.632) & (record.time_s > record.onset_s))
    reached = record.time_s[late[0]] if late.size else record.time_s[-1]
    return float(max(reached - record.onset_s, 0.5 * np.median(np.diff(record.time_s))))


def errors(fitted: Fitted, records: Sequence[Record]) -> dict[str, float]:
    """Mean square error of each run over its samples after the transfer, its start and plateaus placed."""
    found = {}
    for record in records:
        missed = place(fitted.modes, record, fitted.dead_s, fitted.channel)[2]
        found[record.id] = float(np.mean(missed[record.time_s >= record.onset_s] ** 2))
    return found


def _mean_rmse(found: dict[str, float]) -> float:
    return float(np.sqrt(np.mean(list(found.values()))))


def held_out(records: Sequence[Record], channel: str, folds: int) -> dict[str, dict[str, float]]:
    """For each rival the rms error of every run under a fit that never saw it; run k is in fold k % folds."""
    found: dict[str, dict[str, float]] = {}
    for name, model in models(channel).items():
        found[name] = {}
        for k in range(folds):
            train = [r for i, r in enumerate(records) if i % folds != k]
            test = [r for i, r in enumerate(records) if i % folds == k]
            if train and test:
                found[name] |= {i: float(np.sqrt(m)) for i, m in errors(fit_rival(model, train, channel), test).items()}
    return found
