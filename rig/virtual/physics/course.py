"""One pair of probes through one exposure, at any time of it.

Linear bodies in closed form, by the modes of their chains: z' = rate (gain u - z), and while the drive is straight,
u = u0 + s h, z = gain (u - s / rate) + (z0 - gain (u0 - s / rate)) exp(-rate h). A film whose D follows the water is
stepped.
"""

from __future__ import annotations

import bisect
import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh_tridiagonal

from shockrig.rig.virtual.physics.chains import FIRST_STEP_S, CellChain, Stepper
from shockrig.rig.virtual.physics.exposure import Exposure, air_after, shortest_change_s
from shockrig.rig.virtual.physics.moist import concentration_ppmv
from shockrig.rig.virtual.physics.probes import CORE_WEIGHTS, SORPTION_HEAT_S, Bodies, Probes
from shockrig.rig.virtual.truth import Truth

PIECES_PER_CHANGE = 100  # of a changing air, each taken as straight: 1e-5 of the change is neglected
SHORTEST_RAMP_S = 1e-6  # what is faster is a step: no number of digits would hold its slope
COARSER_WAITING = 4.0  # steps of a film that nobody tries
DRIVES = (0, 1, 0, 0, 2, 1)  # of the blocks of Probes: air, what the film's face sees, vapour


_FIELDS = [field.name for field in dataclasses.fields(Exposure)]


def follow(
    truth: Truth,
    exposure: Exposure[float],
    rate_factors: np.ndarray | None = None,
    state: list[np.ndarray] | None = None,
) -> ModalCourse:
    """The course of the probes through `exposure` (of numbers), from `state` or settled in the source air."""
    if exposure.duration_s < SHORTEST_RAMP_S:
        exposure = dataclasses.replace(exposure, duration_s=0.0)
    runs: dict[str, Any] = {
        k: np.array([v]) if isinstance(v, float) else v for k, v in vars(exposure).items() if k in _FIELDS
    }
    one_run: Exposure[np.ndarray] = Exposure(**runs)
    probes = Probes(truth, one_run, rate_factors, state)
    kind = SteppedCourse if truth.effect("concentration_dependent_diffusivity") else ModalCourse
    return kind(truth, exposure, probes)


def modes(chain: CellChain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates (n,) of the modes of a single run's chain, and cells from modes and modes from cells, (n, n)."""
    capacity, link = chain.capacity[0], chain.link[0]
    padded = np.concatenate([[0.0], link, chain.open_end])
    root = np.sqrt(capacity)
    rates, vectors = eigh_tridiagonal((padded[:-1] + padded[1:]) / capacity, -link / (root[:-1] * root[1:]))
    return rates, vectors / root[:, None], vectors.T * root


@dataclass(frozen=True)
class _Piece:
    """A stretch of straight drives `level` + `slope` h from `start_s` to `end_s`; z = rest + drift h + amplitude e."""

    start_s: float
    end_s: float
    level: np.ndarray
    slope: np.ndarray
    rest: np.ndarray
    drift: np.ndarray | None
    amplitude: np.ndarray


class ModalCourse:
    """In closed form; times may go back as far as has not been forgotten."""

    def __init__(self, truth: Truth, exposure: Exposure[float], probes: Probes):
        self._truth, self._exposure = truth, exposure
        self._wet_until_s = -np.inf if probes.wet_until_s is None else float(probes.wet_until_s[0])
        parts = [modes(block) for block in probes.blocks]
        film_rates, film_shapes, _ = parts[1]
        gains = [into.sum(axis=1) for _, _, into in parts]  # all cells of a chain end at its drive
        # The sorption heat's lag follows the film's mean: less the share of each of the film's modes, it is one more
        # mode that the film's own drive sets.
        heat = 1.0 / SORPTION_HEAT_S
        away = heat - film_rates
        away[np.abs(away) < 1e-6 * heat] = 1e-6 * heat
        shares = heat * (probes.film_widths @ film_shapes) / away
        gains[5] = np.array([1.0 - shares @ gains[1]])
        self._shapes = [shapes for _, shapes, _ in parts[:5]] + [np.ones((1, 1))]
        self._shares = shares
        self._rates = np.concatenate([rates for rates, _, _ in parts])
        self._gains = np.concatenate(gains)
        sizes = [rates.size for rates, _, _ in parts]
        self._which = np.repeat(DRIVES, sizes)
        ends = np.cumsum(sizes)
        self._slices = [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
        self._outputs = np.zeros((6, ends[-1]))
        bead, film, *lags = self._slices
        self._outputs[0, bead] = CORE_WEIGHTS @ self._shapes[0][:3]
        self._outputs[1, film] = probes.film_widths @ film_shapes
        for row, lag in enumerate(lags, 2):
            self._outputs[row, lag] = self._shapes[row][0]
        self._outputs[5, film] = shares
        cells = [part[0] for part in probes.start]
        z = [into @ part for (_, _, into), part in zip(parts, cells, strict=True)]
        z[5] = cells[5] - shares @ z[1]
        self._pieces = [self._piece(0.0, np.concatenate(z))]
        self._starts = [0.0]

    def _drives(self, since_s: float, wet: bool) -> np.ndarray:
        air_c, vapour = (float(part) for part in air_after(self._truth, self._exposure, since_s))
        face = concentration_ppmv(100.0, air_c, self._exposure.pressure_hpa) if wet else vapour
        return np.array([air_c, face, vapour])

    def _piece(self, start_s: float, z: np.ndarray) -> _Piece:
        moving, wet = start_s < self._exposure.duration_s, start_s < self._wet_until_s
        end_s = min(t for t in (self._exposure.duration_s, self._wet_until_s, np.inf) if t > start_s)
        end_s = min(end_s, start_s + shortest_change_s(self._truth, self._exposure, start_s) / PIECES_PER_CHANGE)
        if moving and wet:
            end_s = min(end_s, start_s + self._exposure.duration_s / PIECES_PER_CHANGE)
        level = self._drives(start_s, wet)
        if np.isinf(end_s):
            slope, rest, drift = np.zeros(3), self._gains * level[self._which], None
        else:
            slope = (self._drives(end_s, wet) - level) / (end_s - start_s)
            drift = self._gains * slope[self._which]
            rest = self._gains * level[self._which] - drift / self._rates
        return _Piece(start_s, end_s, level, slope, rest, drift, z - rest)

    def _at(self, since_s: float) -> _Piece:
        while (last := self._pieces[-1]).end_s < since_s:
            self._pieces.append(self._piece(last.end_s, self._z(last, last.end_s)))
            self._starts.append(last.end_s)
        return self._pieces[max(bisect.bisect_right(self._starts, since_s) - 1, 0)]

    def _z(self, piece: _Piece, since_s: float) -> np.ndarray:
        h = since_s - piece.start_s
        z = np.exp(self._rates * -h)
        z *= piece.amplitude
        z += piece.rest
        if piece.drift is not None:
            z += piece.drift * h
        return z

    def air(self, since_s: float) -> tuple[float, float]:
        """Air at the probes, degC and ppmv."""
        piece = self._at(since_s)
        now = piece.level + piece.slope * (since_s - piece.start_s)
        return float(now[0]), float(now[2])

    def bodies(self, since_s: float) -> Bodies[float]:
        """What the probes have come to, numbers."""
        return Bodies(*(self._outputs @ self._z(self._at(since_s), since_s)).tolist())

    def state(self, since_s: float) -> list[np.ndarray]:
        """The cells of each block, (1, n), to go on from."""
        z = self._z(self._at(since_s), since_s)
        cells = [shapes @ z[part] for shapes, part in zip(self._shapes, self._slices, strict=True)]
        cells[5] = cells[5] + self._shares @ z[self._slices[1]]
        return [part[None] for part in cells]

    def forget(self, since_s: float) -> None:
        """Nobody will ask for a time before `since_s` any more."""
        first = max(bisect.bisect_right(self._starts, since_s) - 1, 0)
        del self._pieces[:first], self._starts[:first]


@dataclass(frozen=True)
class _Moment:
    """The cells of the film and of the lag of its sorption heat, (1, n) and (1, 1), at a time, and the film's mean."""

    time_s: float
    film: np.ndarray
    warming: np.ndarray
    mean_ppmv: float


class SteppedCourse(ModalCourse):
    """As above but for the film, which is stepped as far as somebody asks, and straight between the steps."""

    def __init__(self, truth: Truth, exposure: Exposure[float], probes: Probes):
        super().__init__(truth, exposure, probes)
        self._film_widths = probes.film_widths
        self._coarser = 1.0 if exposure.shock else COARSER_WAITING
        self._stepper = Stepper(
            [probes.blocks[1], probes.blocks[5]],
            self._film_drives,
            [probes.start[1], probes.start[5]],
            refresh=lambda ahead: [probes.film_links(ahead[0]), None],
        )
        self._past = [self._moment()]

    def _film_drives(self, time_s: float) -> list[np.ndarray]:
        piece = self._at(0.5 * (self._stepper.time_s + time_s))  # the piece that the step lies in
        face = piece.level[1] + piece.slope[1] * (time_s - piece.start_s)
        return [np.array([face]), np.array([self._past[-1].mean_ppmv])]  # sorption heat acts back on nothing

    def _moment(self) -> _Moment:
        film, warming = self._stepper.state
        return _Moment(self._stepper.time_s, film, warming, float(film[0] @ self._film_widths))

    def _step(self) -> None:
        stepper = self._stepper
        began_s = stepper.time_s
        left_s = self._at(began_s + FIRST_STEP_S).end_s - began_s
        # a step ends where the drives bend, but a rounding error is no step
        stepper.step(max(min(self._coarser * stepper.longest_step_s(np.inf), left_s), FIRST_STEP_S))
        if began_s < self._wet_until_s <= stepper.time_s:  # what the face sees has jumped: small steps again
            stepper.restart(stepper.state, stepper.time_s)
            stepper.start_s = stepper.time_s
        self._past.append(self._moment())

    def _around(self, since_s: float) -> tuple[_Moment, _Moment, float]:
        """The moments before and after a time, and how far it is from the one to the other, 0 to 1."""
        while self._stepper.time_s < since_s or len(self._past) < 2:
            self._step()
        after = min(max(bisect.bisect_left(self._past, since_s, key=lambda m: m.time_s), 1), len(self._past) - 1)
        early, late = self._past[after - 1], self._past[after]
        return early, late, min(max((since_s - early.time_s) / (late.time_s - early.time_s), 0.0), 1.0)

    def bodies(self, since_s: float) -> Bodies[float]:
        """What the probes have come to, numbers."""
        early, late, share = self._around(since_s)
        return dataclasses.replace(
            super().bodies(since_s),
            film_ppmv=early.mean_ppmv + share * (late.mean_ppmv - early.mean_ppmv),
            warming_ppmv=float((early.warming + share * (late.warming - early.warming))[0, 0]),
        )

    def state(self, since_s: float) -> list[np.ndarray]:
        """The cells of each block, (1, n), to go on from."""
        early, late, share = self._around(since_s)
        cells = super().state(since_s)
        cells[1] = early.film + share * (late.film - early.film)
        cells[5] = early.warming + share * (late.warming - early.warming)
        return cells

    def forget(self, since_s: float) -> None:
        """Nobody will ask for a time before `since_s` any more."""
        super().forget(min(since_s, self._stepper.time_s))
        del self._past[: max(bisect.bisect_right(self._past, since_s, key=lambda m: m.time_s) - 1, 0)]
