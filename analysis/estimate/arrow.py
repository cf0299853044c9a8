"""Normal equations of a model with random effects for each run: an arrow matrix, solved by eliminating each run's
block.

With J the sensitivities to theta, U those to a run's random effects, L^-1 their weights, all whitened:

    [ J'J + prior   J'U        ] [ theta ]
    [ U'J           U'U + L^-1 ] [ u_i   ]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arrow:
    """The equations at one point.

    Attributes
    ----------
    jacobian : ndarray (R, n, P)
        Whitened sensitivities of the prediction to theta.
    run_jacobian : ndarray (R, n, U)
        Likewise to each run's random effects.
    weight : ndarray (R, U)
        1 / variance of the random effects.
    prior_weight : ndarray (P,)
        1 / variance of what is known of theta; 0 where nothing is.
    """

    jacobian: Array
    run_jacobian: Array
    weight: Array
    prior_weight: Array

    @cached_property
    def _turned(self) -> Array:
        return self.run_jacobian.transpose(0, 2, 1)

    @cached_property
    def blocks(self) -> Array:
        """U'U + L^-1 of each run (R, U, U)."""
        blocks = self._turned @ self.run_jacobian
        index = np.arange(blocks.shape[-1])
        blocks[:, index, index] += self.weight
        return np.asarray(blocks)

    @cached_property
    def _coupled(self) -> tuple[Array, Array]:
        """U'J (R, U, P) and the blocks' solution of it."""
        coupled = self._turned @ self.jacobian
        return coupled, np.asarray(np.linalg.solve(self.blocks, coupled))

    @cached_property
    def normal(self) -> Array:
        """Normal matrix of theta, the runs' random effects eliminated (P, P)."""
        coupled, solved = self._coupled
        tall, flat = (x.reshape(-1, x.shape[-1]) for x in (self.jacobian, coupled))
        reduced = tall.T @ tall - flat.T @ solved.reshape(flat.shape)
        return np.asarray(reduced + np.diag(self.prior_weight))

    @property
    def told(self) -> Array:
        """The normal matrix without what is known before any reading (P, P)."""
        return self.normal - np.diag(self.prior_weight)

    def of_runs(self, runs: slice | NDArray[np.bool_]) -> Arrow:
        """The equations of some of the runs alone."""
        return replace(
            self, jacobian=self.jacobian[runs], run_jacobian=self.run_jacobian[runs], weight=self.weight[runs]
        )

    @cached_property
    def told_by_each(self) -> Array:
        """What each run alone tells (R, P, P), as `told`."""
        coupled, solved = self._coupled
        return np.asarray(np.swapaxes(self.jacobian, 1, 2) @ self.jacobian - np.swapaxes(coupled, 1, 2) @ solved)

    @cached_property
    def _own_weights(self) -> tuple[Array, Array]:
        """The diagonal of the equations: of the runs' random effects (R, U) and of theta (P,)."""
        return np.diagonal(self.blocks, axis1=1, axis2=2), (self.jacobian**2).sum(axis=(0, 1)) + self.prior_weight

    def damped(self, damping: float) -> Arrow:
        """The equations with every unknown held back by so much of its own weight (Marquardt 1963, doi
        10.1137/0111030): the more, the shorter a step and the nearer to the steepest descent."""
        if damping == 0.0:
            return self  # with what it has solved already
        runs, theta = self._own_weights
        return replace(self, weight=self.weight + damping * runs, prior_weight=self.prior_weight + damping * theta)

    def right_sides(self, residual: Array, own: Array, pull: Array) -> tuple[Array, Array]:
        """Right side of theta (P,), and the runs' steps at an unmoved theta (R, U).

        `residual` (R, n) is whitened; `own` (R, U) are the right sides of the runs' random effects, `pull` (P,) is what
        the prior adds for theta.
        """
        steps: Array = np.asarray(np.linalg.solve(self.blocks, own[..., None])[..., 0])
        coupled, _ = self._coupled
        right = self.jacobian.reshape(-1, self.jacobian.shape[-1]).T @ residual.ravel()
        right = right - coupled.reshape(-1, coupled.shape[-1]).T @ steps.ravel() + pull
        return right, steps

    def run_sides(self, residual: Array, deviations: Array) -> Array:
        """The right sides of the runs' random effects (R, U), of a whitened residual (R, n) taken at these."""
        return np.asarray((self._turned @ residual[..., None])[..., 0] - self.weight * deviations)

    def run_steps(self, steps: Array, move: Array) -> Array:
        """The runs' steps (R, U) when theta moves by `move` (P,)."""
        return np.asarray(steps - self._coupled[1] @ move)

    def covariance(self) -> Array:
        """Of theta (P, P); a parameter that the data do not see gets a huge variance and leaves the others alone."""
        scale = np.sqrt(np.maximum(np.diag(self.normal), 1e-12))
        correlation = self.normal / scale[:, None] / scale
        np.fill_diagonal(correlation, 1.0 + 1e-12)  # that of an unseen parameter is nought, and would be left out
        values, axes = np.linalg.eigh(correlation)
        # Along an axis that they see no better than rounding, below nought even, they say nothing: that is not certain.
        inverse = (axes / np.maximum(values, 1e-11 * values[-1])) @ axes.T
        return np.asarray(inverse / scale[:, None] / scale)

    def run_variances(self) -> Array:
        """Variances of the runs' random effects at a given theta (R, U)."""
        return np.asarray(np.diagonal(np.linalg.inv(self.blocks), axis1=1, axis2=2))

    def log_determinant(self) -> float:
        """Of the runs' blocks, all together."""
        return float(np.linalg.slogdet(self.blocks)[1].sum())

    def pull(self, column: Array) -> Array:
        """Right side of theta (P,) for readings that are all off by a whitened column (R, n): covariance @ pull is
        how far the estimate moves."""
        own = np.linalg.solve(self.blocks, (self._turned @ column[..., None]))[..., 0]
        coupled, _ = self._coupled
        whole = self.jacobian.reshape(-1, self.jacobian.shape[-1]).T @ column.ravel()
        return np.asarray(whole - coupled.reshape(-1, coupled.shape[-1]).T @ own.ravel())

    def shares(self) -> tuple[Array, Array]:
        """Where the covariance of theta comes from, as columns for errors of unit variance that are independent.

        Returns
        -------
        from_runs : ndarray (U, P, R)
            What each run's random effect moves theta by when it is off by its standard deviation.
        from_readings : ndarray (P, R n)
            What each whitened reading moves theta by.

        With what the prior lets theta be off by, their products with themselves add up to the covariance.
        """
        covariance = self.covariance()
        solved = self._coupled[1]
        from_runs = np.einsum("pq,ruq,ru->upr", covariance, solved, np.sqrt(self.weight))
        own = self.jacobian - self.run_jacobian @ solved
        return from_runs, covariance @ own.reshape(-1, own.shape[-1]).T

    def beyond_runs(self, difference: Array) -> tuple[Array, Array]:
        """Squared length (R,) of what of each run's whitened values (R, n) its random effects cannot take up, and what
        that says of theta: right sides (R, P)."""
        own = (self._turned @ difference[..., None])[..., 0]
        taken = np.linalg.solve(self.blocks, own[..., None])[..., 0]
        right = (difference[:, None] @ self.jacobian)[:, 0] - (taken[:, None] @ self._coupled[0])[:, 0]
        return (difference**2).sum(axis=1) - (own * taken).sum(axis=1), right

    def hidden(self, difference: Array) -> float:
        """Squared length of whitened values (R, n) that the runs' random effects cannot take up."""
        return float(self.beyond_runs(difference)[0].sum())

    def scores(
        self, columns: Array, residual: Array, deviations: Array, pull: Array | None = None
    ) -> tuple[Array, Array]:
        """Scores (C,) and their covariance (C, C) for whitened `columns` (R, n, C).

        What the residual says of each direction once theta and the runs' random effects have had their say; `pull` (P,)
        is what the prior adds for theta.
        """
        tall, flat, reduced, right = self._beside(columns, residual, deviations, pull)
        whole = tall.T @ tall - flat.T @ reduced
        p = self.jacobian.shape[-1]
        inverse = self._inverse(whole[:p, :p])
        normal = whole[p:, p:] - whole[p:, :p] @ inverse @ whole[:p, p:]
        return right[p:] - whole[p:, :p] @ inverse @ right[:p], normal

    def score_variances(
        self, columns: Array, residual: Array, deviations: Array, pull: Array | None = None, groups: Array | None = None
    ) -> tuple[Array, Array]:
        """Likewise the scores (C,) and their variances alone (C,): much less work where there are many columns.

        With `groups` (K, R), 1 for runs that belong to a group and 0 for others, those of each column where it is there
        in the runs of a group alone, (K, C).
        """
        p, runs = self.jacobian.shape[-1], self.jacobian.shape[0]
        # What the runs' random effects see of each direction, and what they take of it.
        seen = self._turned @ np.concatenate([self.jacobian, columns], axis=-1)
        taken_up = np.linalg.solve(self.blocks, seen)
        at_zero = residual + (self.run_jacobian @ deviations[..., None])[..., 0]
        right = -(np.swapaxes(taken_up, 1, 2) @ (self._turned @ at_zero[..., None]))[..., 0]  # (R, P + C)
        right[:, :p] += (at_zero[:, None] @ self.jacobian)[:, 0]
        right[:, p:] += (at_zero[:, None] @ columns)[:, 0]
        normal = -np.swapaxes(seen[..., :p], 1, 2) @ taken_up  # (R, P, P + C)
        turned = np.swapaxes(self.jacobian, 1, 2)
        normal[..., :p] += turned @ self.jacobian
        normal[..., p:] += turned @ columns
        size = np.einsum("rnc,rnc->rc", columns, columns) - (seen[..., p:] * taken_up[..., p:]).sum(axis=1)
        among = np.ones((1, runs)) if groups is None else groups
        coupled = np.tensordot(among, normal[..., p:], axes=1)  # (K, P, C)
        taken = self._inverse(normal[..., :p].sum(axis=0)) @ coupled
        of_theta = right[:, :p].sum(axis=0) + (0.0 if pull is None else pull)
        scores = among @ right[:, p:] - of_theta @ taken
        variances = among @ size - (coupled * taken).sum(axis=1)
        return (scores[0], variances[0]) if groups is None else (scores, variances)

    def _beside(
        self, columns: Array, residual: Array, deviations: Array, pull: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """Sensitivities to theta with `columns` behind them, what the runs' random effects see and take of these, all
        runs under one another, and the right side of both."""
        both = np.concatenate([self.jacobian, columns], axis=-1)
        coupled = self._turned @ both
        solved = np.linalg.solve(self.blocks, coupled)
        tall, flat, reduced = (x.reshape(-1, both.shape[-1]) for x in (both, coupled, solved))
        # The residual is taken at the runs' estimated deviations; the marginal score wants it at zero deviations.
        at_zero = residual + (self.run_jacobian @ deviations[..., None])[..., 0]
        right = tall.T @ at_zero.ravel() - reduced.T @ (self._turned @ at_zero[..., None]).ravel()
        right[: self.jacobian.shape[-1]] += 0.0 if pull is None else pull
        return tall, flat, reduced, right

    def _inverse(self, normal: Array) -> Array:
        """Of theta's normal matrix, the prior not yet in it (P, P)."""
        whole = normal + np.diag(self.prior_weight)
        scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        outer = np.outer(scale, scale)
        return np.asarray(np.linalg.pinv(whole / outer, rcond=1e-10, hermitian=True) / outer)
