"""Diffusion in chains of finite volumes, many chains stepped as one symmetric tridiagonal system.

V dx/dt = -K x + g (u(t) - x), stepped by BDF2 with variable steps (L-stable); the first step after a restart is
backward Euler and tiny.
A sphere is cells in r (areas r^2), a film is cells in x graded towards its open face, a lag is one cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lapack

from shockrig.files.compiled import demand_current

try:
    from shockrig.rig.virtual.physics import _march

    demand_current(_march)
except ImportError:  # built where there is a compiler
    _march = None  # type: ignore[assignment]

SPHERE_CELLS = 80
FILM_CELLS = 80
CAP_CAPACITY = 1e4  # of the film's own
FIRST_STEP_S = 2e-5
LONGEST_STEP_S = 0.01
STEPS_PER_AGE = (
    128  # a step is at most this fraction of the time since the last jump: self-similar answers stay resolved
)


@dataclass(frozen=True)
class CellChain:
    """Chains of n cells for r runs: `capacity` (r, n), `link` (r, n - 1) between cells, `open_end` (r,) to the drive
    beyond the last cell.
    """

    capacity: np.ndarray
    link: np.ndarray
    open_end: np.ndarray


def sphere_edges(cells: int = SPHERE_CELLS) -> np.ndarray:
    """Edges of spherical cells in r / R, shape (cells + 1,)."""
    return np.linspace(0.0, 1.0, cells + 1)


def sphere(rate_per_s: np.ndarray, biot: np.ndarray, edges: np.ndarray) -> CellChain:
    """Heat in a sphere: `rate_per_s` = alpha / R^2 (r,), `biot` = h R / k (r,), infinity where the surface is held at
    the drive.
    """
    centres = 0.5 * (edges[1:] + edges[:-1])
    rate = np.asarray(rate_per_s, dtype=float)
    capacity = np.broadcast_to((edges[1:] ** 3 - edges[:-1] ** 3) / 3.0, (rate.size, centres.size))
    link = rate[:, None] * edges[1:-1] ** 2 / np.diff(centres)
    return CellChain(capacity, link, rate / (1.0 - centres[-1] + 1.0 / np.asarray(biot, dtype=float)))


def core_weights(edges: np.ndarray) -> np.ndarray:
    """Weights of the first three cell means that give the value at the centre exactly for T = a + b r^2 + c r^4."""
    outer, inner = edges[1:4], edges[:3]
    volume = (outer**3 - inner**3) / 3.0
    moments = np.stack([(outer ** (3 + p) - inner ** (3 + p)) / ((3 + p) * volume) for p in (0, 2, 4)])
    return np.linalg.solve(moments, [1.0, 0.0, 0.0])


def film_edges(cells: int = FILM_CELLS, grading: float = 2.0) -> np.ndarray:
    """Edges of film cells in x / L from the sealed to the open face, (cells + 1,), finer by exp(`grading`) at the open
    face.
    """
    return -np.expm1(-grading * np.linspace(0.0, 1.0, cells + 1)) / -np.expm1(-grading)


def film_links(diffusivity: np.ndarray, biot: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Links (r, n - 1) and open end (r,) from the rate D / L^2 at each of the n faces after the sealed one,
    `diffusivity` (r, n).
    """
    centres = 0.5 * (edges[1:] + edges[:-1])
    last = diffusivity[:, -1]
    # the mass-transfer Biot number refers to the film's own D at the open face
    return diffusivity[:, :-1] / np.diff(centres), last / (1.0 - centres[-1] + 1.0 / np.asarray(biot, dtype=float))


def film(rate_per_s: np.ndarray, biot: np.ndarray, edges: np.ndarray) -> CellChain:
    """Vapour in a film: `rate_per_s` = D / L^2 (r,), `biot` mass-transfer Biot number (r,), infinity where the face is
    held at the drive.
    """
    rate = np.asarray(rate_per_s, dtype=float)
    widths = np.diff(edges)
    link, open_end = film_links(np.broadcast_to(rate[:, None], (rate.size, widths.size)), biot, edges)
    return CellChain(np.broadcast_to(widths, (rate.size, widths.size)), link, open_end)


def capped(inside: CellChain, time_constant_s: float) -> CellChain:
    """The same chain behind a cap: one more cell of so much capacity that what is inside does not load it.

    A filter cap holds far more air than the film takes water from, and its own lag depends on its pores alone.
    """
    runs = inside.open_end.size
    capacity = np.concatenate([inside.capacity, np.full((runs, 1), CAP_CAPACITY)], axis=1)
    link = np.concatenate([inside.link, inside.open_end[:, None]], axis=1)
    return CellChain(capacity, link, np.full(runs, CAP_CAPACITY / time_constant_s))


def lag(time_constant_s: float, runs: int) -> CellChain:
    """First-order lags behind the drive."""
    return CellChain(np.full((runs, 1), float(time_constant_s)), np.empty((runs, 0)), np.ones(runs))


class Stepper:
    """Steps several blocks of chains together in time.

    Parameters
    ----------
    blocks : list of Chain
    drive : callable
        t -> list of (r,) arrays, the value beyond the open end of each block at time t.
    state : list of (r, n) arrays
    time_s : float
        Time of the state; the drive is taken to jump here.
    refresh : callable, optional
        list of extrapolated states -> list of (link, open_end) or None for each block, where conductances follow the
        state.
    """

    def __init__(
        self,
        blocks: list[CellChain],
        drive: Callable[[float], list[np.ndarray]],
        state: list[np.ndarray],
        time_s: float = 0.0,
        refresh: Callable[[list[np.ndarray]], list[tuple[np.ndarray, np.ndarray] | None]] | None = None,
    ):
        self._drive, self._refresh = drive, refresh
        self.start_s = time_s
        sizes = [block.capacity.size for block in blocks]
        self._slices = [slice(end - size, end) for size, end in zip(sizes, np.cumsum(sizes), strict=True)]
        self._shapes = [block.capacity.shape for block in blocks]
        self._ends = np.concatenate(
            [
                np.arange(s.start, s.stop).reshape(shape)[:, -1]
                for s, shape in zip(self._slices, self._shapes, strict=True)
            ]
        )
        self._capacity = np.concatenate([block.capacity.ravel() for block in blocks])
        self._links = [(block.link, block.open_end) for block in blocks]
        self._assemble()
        self._factor: tuple[Any, ...] = (None,)
        self.restart(state, time_s)

    def restart(self, state: list[np.ndarray], time_s: float) -> None:
        """Go on from another state and time; the drive's jump stays where it was."""
        self._x = np.concatenate([np.asarray(part, dtype=float).ravel() for part in state])
        self.time_s = time_s
        self._before: np.ndarray | None = None
        self._last_step_s = 0.0

    def _assemble(self) -> None:
        off, diagonal, ends = [], [], []
        for (link, open_end), (runs, _) in zip(self._links, self._shapes, strict=True):
            padded = np.concatenate([np.zeros((runs, 1)), link, np.zeros((runs, 1))], axis=1)
            own = padded[:, :-1] + padded[:, 1:]
            own[:, -1] += open_end
            diagonal.append(own.ravel())
            off.append(padded[:, 1:].ravel())  # the zero at each chain's end keeps neighbours in the stack apart
            ends.append(open_end)
        self._diagonal = np.concatenate(diagonal)
        self._off = -np.concatenate(off)[:-1]
        self._open = np.concatenate(ends)

    def _unstack(self, x: np.ndarray) -> list[np.ndarray]:
        return [x[s].reshape(shape) for s, shape in zip(self._slices, self._shapes, strict=True)]

    @property
    def state(self) -> list[np.ndarray]:
        """Views of the blocks' states, (r, n) each."""
        return self._unstack(self._x)

    def step(self, step_s: float) -> None:
        """One step of `step_s`."""
        ratio = step_s / self._last_step_s if self._before is not None else 0.0
        if self._refresh is not None:
            ahead = self._x if self._before is None else self._x + ratio * (self._x - self._before)
            self._links = [
                new or old for new, old in zip(self._refresh(self._unstack(ahead)), self._links, strict=True)
            ]
            self._assemble()
        if self._refresh is not None or self._factor[0] != (step_s, ratio):
            now = (1.0 + 2.0 * ratio) / (1.0 + ratio)
            d, e, info = lapack.dpttrf(now * self._capacity + step_s * self._diagonal, step_s * self._off)
            if info:
                raise FloatingPointError(f"the diffusion step of {step_s} s is not positive definite (row {info})")
            self._factor = ((step_s, ratio), d, e, step_s * self._open)
        _, d, e, open_end = self._factor
        if self._before is None:
            right = self._capacity * self._x
        else:
            right = self._x * (1.0 + ratio)
            right -= self._before * (ratio * ratio / (1.0 + ratio))
            right *= self._capacity
        right[self._ends] += open_end * np.concatenate(self._drive(self.time_s + step_s))
        self._before = self._x
        self._x, _ = lapack.dpttrs(d, e, right, overwrite_b=1)
        self.time_s += step_s
        self._last_step_s = step_s

    def even_times_s(self, until_s: float) -> np.ndarray:
        """Ends of the steps to come, up to the first that is not before `until_s`, as long as all are to be as the last
        was and can be made by `advance`.
        """
        step_s = self._last_step_s
        if _march is None or self._refresh is not None or self._factor[0] != (step_s, 1.0):
            return np.empty(0)
        count = int((until_s - self.time_s) / step_s) + 2  # one more than there can be
        if step_s < LONGEST_STEP_S:  # the next longer one begins at twice the age of this one's beginning
            count = min(count, int(2.0 * STEPS_PER_AGE) + 2)
        times = np.add.accumulate(np.concatenate([[self.time_s], np.full(count, step_s)]))
        kept = int(np.searchsorted(times, until_s))
        if step_s < LONGEST_STEP_S:
            longer = np.flatnonzero(self._on_ladder(times) > step_s)
            kept = min(kept, int(longer[0])) if longer.size else kept
        return times[1 : 1 + kept]

    def advance(self, block: int, drive: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """A block's first cells, weighted, after each step of `even_times_s` on its drive, both (n, r). The block is
        then where these steps end; the stepper is once all blocks are, and `arrived` has been told."""
        assert self._before is not None  # steps are even after the first
        _, d, e, open_end = self._factor
        here, (runs, cells) = self._slices[block], self._shapes[block]
        stacked = (self._x, self._before, self._capacity, d, np.append(e, 0.0))
        pull = open_end[block * runs : (block + 1) * runs] * drive
        out = np.empty(drive.shape)
        parts = [np.array(one[here].reshape(runs, cells).T, order="C") for one in stacked]
        _march.advance(len(drive), cells, runs, (*parts, pull, np.ascontiguousarray(weights), out))
        self._x[here], self._before[here] = (one.T.ravel() for one in parts[:2])
        return out

    def arrived(self, time_s: float) -> None:
        """All blocks have been advanced to this time."""
        self.time_s = time_s

    def _on_ladder(self, time_s: np.ndarray) -> np.ndarray:
        """The longest step that the time since the last jump allows, on a ladder of doublings."""
        allowed = np.maximum((time_s - self.start_s) / STEPS_PER_AGE, FIRST_STEP_S)
        return np.asarray(FIRST_STEP_S * 2.0 ** np.floor(np.log2(allowed / FIRST_STEP_S)))

    def longest_step_s(self, cap_s: float | None = None) -> float:
        """The step that the time since the last jump allows, on a ladder of doublings so that factors are kept."""
        cap_s = LONGEST_STEP_S if cap_s is None else cap_s
        if self._before is None:
            return FIRST_STEP_S
        if self._last_step_s == cap_s:  # and the time since the jump has only grown
            return cap_s
        ladder = float(self._on_ladder(np.asarray(self.time_s)))
        return min(cap_s, ladder, 2.0 * self._last_step_s)  # BDF2 is stable for ratios below 1 + sqrt 2
