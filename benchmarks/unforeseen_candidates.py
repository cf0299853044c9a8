"""Simple models of a campaign of one sensor, fitted by least squares and judged on another campaign of the same sensor.

Shares no code with `analysis`. Each is the body's own modes at a rate of each ambient's (one of all for a thermometer),
or a lag, with one thing more: a lag before it, a share that follows late, a rate that depends on one condition or is
another one from a run on, a calibration line. A run's airs and start are placed within two of their stated standard
uncertainties, the same way for every model.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from unforeseen_worlds import RH, T, modes

Array = NDArray[np.float64]

THINNED = 90  # readings of a run in a fit, densest after the transfer
STARTS = np.linspace(-0.02, 0.02, 9)  # [s] from what is stated: two standard uncertainties
AIR = {T: 0.04, RH: 0.2}  # two standard uncertainties of a stated air


@dataclass(frozen=True)
class Data:
    """A campaign of one channel: readings (R, n) at times since the stated start, their weights (1 or 0), the airs'
    values before and after (R,), the share of the first that shows in the second air, and the conditions."""

    time_s: Array
    value: Array
    weight: Array
    ends: Array
    shown: Array
    ambient: NDArray[np.int64]
    conditions: dict[str, Array]


def read(campaign: Path, channel: str, thin: bool) -> Data:
    """A campaign from its files."""
    from records import read_records

    from shockrig.rig.virtual.physics.moist import saturation_pressure_hpa

    records = read_records(campaign, channel)
    heads = [json.loads((campaign / "runs" / r.id / "run.json").read_text(encoding="utf-8")) for r in records]
    airs = np.array(
        [[(h[e]["temperature_c"], h[e]["humidity_percent"]) for e in ("source", "destination")] for h in heads]
    )
    rows = []
    for record in records:
        assert record.start_s is not None
        since = record.time_s - record.start_s
        keep = np.arange(since.size)
        if thin:
            late = np.geomspace(0.05, since[-1], THINNED - 8)
            keep = np.unique(np.searchsorted(since, [*np.linspace(since[0], -0.3, 8), *late]).clip(0, since.size - 1))
        rows.append((since[keep], record.value[keep]))
    width = max(t.size for t, _ in rows)
    time, value, weight = (np.zeros((len(rows), width)) for _ in range(3))
    for i, (t, y) in enumerate(rows):
        time[i, : t.size], value[i, : t.size], weight[i, : t.size] = t, y, 1.0
        time[i, t.size :] = t[-1]
    which = 0 if channel == T else 1
    shown = np.ones(len(rows))
    if channel == RH:  # the vapour of the first air, in air of the second's temperature
        shown = np.asarray(saturation_pressure_hpa(airs[:, 0, 0]) / saturation_pressure_hpa(airs[:, 1, 0]))
    step = airs[:, 1, which] - airs[:, 0, which]
    order = np.arange(len(rows), dtype=float)
    conditions = {
        "run order": order / order.max() - 0.5,
        "direction": 0.5 * np.sign(step),
        "airflow": np.log(np.array([h["airflow_m_s"] for h in heads]) / 6.0),
        "step": np.log(np.maximum(np.abs(step), 1.0) / 20.0),
        "humidity": airs[:, 1, 1] / 100.0 - 0.5,
        "ambient": (airs[:, 1, 0] - 20.0) / 20.0,
    }
    levels = np.round(airs[:, 1, 0] / 5.0)
    ambient = np.unique(levels, return_inverse=True)[1] if channel == RH else np.zeros(len(rows), dtype=np.int64)
    return Data(time, value, weight, airs[:, :, which], shown, np.asarray(ambient), conditions)


Shape = tuple[Array, Array, Array]  # weights and rates of each run's modes (R, m); gain and offset (2,)


@dataclass(frozen=True)
class Model:
    """Log rates of the ambients, then `more` parameters from `starts`; `shape` makes the runs' modes of them."""

    name: str
    more: tuple[tuple[float, ...], ...]
    shape: Callable[[Array, Array, Data, str], Shape]


def _body(rate: Array, channel: str, count: int = 25) -> tuple[Array, Array]:
    weights, rates = modes(channel)
    weights = np.append(weights[: count - 1], weights[count - 1 :].sum())
    return np.tile(weights, (rate.size, 1)), rate[:, None] * rates[:count]


LINE = np.array([0.0, 0.0])


def _plain(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    return (*_body(rate, channel), LINE)


def _one_lag(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    return np.ones((rate.size, 1)), rate[:, None] * 5.0, LINE


def _behind_a_lag(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    weights, rates = _body(rate, channel)
    q = np.exp(-p[0]) * np.ones((rate.size, 1))
    apart = q - rates
    apart = np.where(np.abs(apart) < 1e-6 * q, 1e-6 * q, apart)
    own = weights * q / apart
    return np.hstack([own, 1.0 - own.sum(axis=1, keepdims=True)]), np.hstack([rates, q]), LINE


def _share_late(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    weights, rates = _body(rate, channel)
    share, q = np.tanh(p[0]), np.exp(-p[1]) * np.ones((rate.size, 1))
    return np.hstack([(1.0 - share) * weights, np.full(q.shape, share)]), np.hstack([rates, q]), LINE


def _lags_in_parallel(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    share = 1.0 / (1.0 + np.exp(-p[0]))
    rates = rate[:, None] * 5.0 * np.array([[1.0, np.exp(-np.abs(p[1]))]])
    return np.tile([1.0 - share, share], (rate.size, 1)), rates, LINE


def _depends(name: str) -> Callable[[Array, Array, Data, str], Shape]:
    def shape(rate: Array, p: Array, data: Data, channel: str) -> Shape:
        return (*_body(rate * np.exp(p[0] * data.conditions[name]), channel), LINE)

    return shape


def _group(share: float) -> Callable[[Array, Array, Data, str], Shape]:
    def shape(rate: Array, p: Array, data: Data, channel: str) -> Shape:
        later = data.conditions["run order"] + 0.5 >= share
        return (*_body(rate * np.exp(p[0] * later), channel), LINE)

    return shape


def _line(rate: Array, p: Array, data: Data, channel: str) -> Shape:
    return (*_body(rate, channel), p)


def candidates(channel: str) -> list[Model]:
    """All of them."""
    found = [
        Model("plain", ((),), _plain),
        Model("one lag", ((),), _one_lag),
        Model("two exponentials", ((-1.5, 1.5),), _lags_in_parallel),
        Model("behind a lag", ((-3.0,), (0.0,)), _behind_a_lag),
        Model("a share late", ((0.05, 1.0), (0.05, 3.0)), _share_late),
        Model("calibration line", ((0.0, 0.0),), _line),
    ]
    factors = ["run order", "direction", "airflow", "step", "humidity"] + (["ambient"] if channel == T else [])
    found += [Model(f"rate by {name}", ((0.0,),), _depends(name)) for name in factors]
    return found + [Model(f"another body from {share:.2f} on", ((0.0,),), _group(share)) for share in (0.3, 0.5, 0.7)]


def _missed(shape: Shape, data: Data, late_s: Array, channel: str) -> Array:
    """Residuals (R, n) with the airs placed."""
    weights, rates, (gain, offset) = shape
    since = data.time_s - late_s[:, None]
    after = np.maximum(since, 0.0)
    gone = np.zeros_like(after)
    for k in range(weights.shape[1]):
        gone += weights[:, k : k + 1] * np.exp(-np.minimum(rates[:, k : k + 1] * after, 700.0))
    moved = since > 0.0
    columns = np.stack([np.where(moved, data.shown[:, None] * gone, 1.0), np.where(moved, 1.0 - gone, 0.0)], axis=-1)
    columns = columns * (1.0 + gain)
    left = data.value - offset - (columns @ data.ends[:, :, None])[..., 0]
    weighted = columns * data.weight[..., None]
    normal = np.einsum("rni,rnj->rij", weighted, columns) + 1e-9 * np.eye(2)
    right = np.einsum("rni,rn->ri", weighted, left)
    most = AIR[channel]
    off = np.clip(np.linalg.solve(normal, right[..., None])[..., 0], -most, most)
    for i, j in ((0, 1), (1, 0)):  # the other end anew beside one that is held
        off[:, i] = np.clip((right[:, i] - normal[:, i, j] * off[:, j]) / normal[:, i, i], -most, most)
    return np.asarray((left - (columns @ off[:, :, None])[..., 0]) * data.weight)


def _placed(shape: Shape, data: Data, channel: str) -> tuple[Array, Array]:
    """Each run's start (R,) within what is stated, and its sum of squares there."""
    squares = np.array([(_missed(shape, data, np.full(data.shown.size, s), channel) ** 2).sum(axis=1) for s in STARTS])
    return STARTS[np.argmin(squares, axis=0)], squares.min(axis=0)


def _fitted(model: Model, data: Data, channel: str, first: float) -> Array:
    """Parameters by least squares: from each start, the runs' own starts placed twice on the way."""
    ambients, best = int(data.ambient.max()) + 1, (np.inf, np.zeros(0))
    for more in model.more:
        p = np.array([*[first] * ambients, *more])
        late, cost = np.zeros(data.shown.size), np.inf
        for _ in range(2):

            def residuals(q: Array, late: Array = late) -> Array:
                return _missed(_shape(model, q, data, channel), data, late, channel).ravel()

            found = least_squares(residuals, p, bounds=(p - 6.0, p + 6.0), max_nfev=25, x_scale=0.3)
            p = found.x
            late, squares = _placed(_shape(model, p, data, channel), data, channel)
            cost = float(squares.sum())
        if cost < best[0]:
            best = (cost, p)
    return best[1]


def _shape(model: Model, p: Array, data: Data, channel: str) -> Shape:
    ambients = int(data.ambient.max()) + 1
    return model.shape(np.exp(p[:ambients])[data.ambient], p[ambients:], data, channel)


def judged(campaign: Path, fresh: Path, channel: str) -> dict[str, Array]:
    """Mean square error of each run of the fresh campaign (R,) under each candidate fitted to the other."""
    data, test = read(campaign, channel, thin=True), read(fresh, channel, thin=False)
    found, first = {}, _rough(data, channel)
    for model in candidates(channel):
        p = _fitted(model, data, channel, first)
        first = float(p[: int(data.ambient.max()) + 1].mean()) if model.name == "plain" else first
        squares = _placed(_shape(model, p, test, channel), test, channel)[1]
        found[model.name] = squares / test.weight.sum(axis=1)
    return found


def _rough(data: Data, channel: str) -> float:
    """Log of the rate at which the plain body leaves least, from a scan."""
    rates = np.geomspace(1e-3, 10.0, 33)
    squares = []
    for rate in rates:
        shape = _plain(np.full(data.shown.size, rate), np.zeros(0), data, channel)
        left = _missed(shape, data, np.zeros(data.shown.size), channel)
        squares.append(float((left**2).sum()))
    return float(np.log(rates[int(np.argmin(squares))]))
