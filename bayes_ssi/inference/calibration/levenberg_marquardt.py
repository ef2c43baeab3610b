"""Least squares from many starts at once, by Levenberg's and Marquardt's method.

Every row descends by itself: its steps do not depend on the others, which are only evaluated in
the same batches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray

# Residuals (B, m) of points (B, d), which are those of the rows (B,) of all starts; NaN where the
# model has no answer.
Residuals = Callable[[FloatArray, NDArray[np.intp]], FloatArray]

# Forward differences: rounding of residuals, which are differences of numbers near one divided by
# errors, and truncation balance.
DIFFERENCE_STEP = 1e-7
# Damping as a share of the squares' curvature: at first, and by what it changes (Marquardt 1963).
FIRST_DAMPING, DAMPING_FACTOR, MOST_DAMPING = 1e-3, 10.0, 1e8
# A step may be this long, in prior standard deviations, and the search goes no further out.
LONGEST_STEP, FARTHEST = 2.0, 8.0


class LeastSquares(NamedTuple):
    """Where descents of n starts ended.

    Attributes:
        z: (n, d).
        halves: (n,), half the sums of squares; infinite where the model has no answer at the start.
        curvatures: (n, d, d), JᵀJ of the Jacobian J at the end, or one step before it.
    """

    z: FloatArray
    halves: FloatArray
    curvatures: FloatArray
    n_evaluations: int


def descend(
    residuals: Residuals, starts: FloatArray, most_steps: int, tolerance: float
) -> LeastSquares:
    """Descend from every row of ``starts`` (n, d).

    Args:
        starts: (n, d).
    """
    z = np.array(starts, dtype=float)
    n, d = z.shape
    rows = np.arange(n)
    current = residuals(z, rows)
    n_evaluations = n
    halves = _halves(current)
    curvatures = np.tile(np.eye(d), (n, 1, 1))
    slopes = np.zeros((n, d))
    damping = np.full(n, FIRST_DAMPING)
    active = rows[np.isfinite(halves)]
    moved = active
    for _ in range(most_steps):
        if not len(active):
            break
        if len(moved):
            jacobians = _jacobians(residuals, z[moved], moved, current[moved])
            curvatures[moved] = np.einsum("nmi,nmj->nij", jacobians, jacobians)
            slopes[moved] = np.einsum("nmi,nm->ni", jacobians, current[moved])
        steps = _steps(curvatures[active], slopes[active], damping[active])
        tried = np.clip(z[active] + steps, -FARTHEST, FARTHEST)
        expected = -np.einsum("ni,ni->n", slopes[active], tried - z[active])
        new = residuals(tried, active)
        n_evaluations += d * len(moved) + len(active)
        new_halves = _halves(new)
        down = new_halves < halves[active]
        damping[active] *= np.where(down, 1.0 / DAMPING_FACTOR, DAMPING_FACTOR)
        settled = (expected < tolerance) | (damping[active] > MOST_DAMPING)
        moved = active[down]
        z[moved], current[moved], halves[moved] = tried[down], new[down], new_halves[down]
        moved, active = active[down & ~settled], active[~settled]
    return LeastSquares(z, halves, curvatures, n_evaluations)


def _halves(residuals: FloatArray) -> FloatArray:
    """Half the sum of squares (n,); infinite where a residual is not finite."""
    halves = 0.5 * np.einsum("nm,nm->n", residuals, residuals)
    return np.where(np.isfinite(halves), halves, np.inf)


def _jacobians(
    residuals: Residuals, z: FloatArray, rows: NDArray[np.intp], at_z: FloatArray
) -> FloatArray:
    """Jacobians (n, m, d) by forward differences, all in one batch; 0 where there are none."""
    n, d = z.shape
    ahead = z[:, None, :] + DIFFERENCE_STEP * np.eye(d)
    values = residuals(ahead.reshape(-1, d), np.repeat(rows, d)).reshape(n, d, -1)
    differences = (values - at_z[:, None, :]) / DIFFERENCE_STEP
    return np.where(np.isfinite(differences), differences, 0.0).transpose(0, 2, 1)


def _steps(curvatures: FloatArray, slopes: FloatArray, damping: FloatArray) -> FloatArray:
    """Damped Gauss-Newton steps (n, d), no longer than the longest."""
    scale = np.einsum("nii->ni", curvatures) + np.finfo(float).tiny
    damped = curvatures + np.einsum("n,ni,ij->nij", damping, scale, np.eye(slopes.shape[1]))
    steps = -np.linalg.solve(damped, slopes[..., None])[..., 0]
    length = np.sqrt(np.einsum("ni,ni->n", steps, steps))
    return steps * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-300))[:, None]
