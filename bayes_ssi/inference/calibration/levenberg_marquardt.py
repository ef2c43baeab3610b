"""Least squares from many starts at once, by Levenberg's and Marquardt's method.

Every row descends by itself: its steps do not depend on the others, which are only evaluated in
the same batches.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray

# Residuals (B, m) of points (B, d), which are those of the rows (B,) of all starts; NaN where the
# model has no answer.
Residuals = Callable[[FloatArray, NDArray[np.intp]], FloatArray]


@dataclass(frozen=True)
class DescentSettings:
    """How descents go on; lengths are in prior standard deviations."""

    tolerance: float = 1e-3  # fall of half the sum of squares that is worth no step, in nats
    difference_step: float = 1e-7  # where rounding of residuals and truncation balance
    first_damping: float = 1e-3  # as a share of the squares' curvature (Marquardt 1963)
    damping_factor: float = 10.0  # by which every step changes it
    most_damping: float = 1e8  # with which steps are too short to go on
    longest_step: float = 2.0
    farthest: float = 8.0  # that a search goes out


DEFAULT = DescentSettings()


def descend(
    residuals: Residuals,
    starts: FloatArray,
    most_steps: int,
    settings: DescentSettings = DEFAULT,
) -> tuple[FloatArray, FloatArray]:
    """Descend from every row of ``starts`` (n, d).

    Returns:
        The ends (n, d), and JᵀJ (n, d, d) of the Jacobian J there, or one step before.
    """
    z = np.array(starts, dtype=float)
    n, d = z.shape
    rows = np.arange(n)
    current = residuals(z, rows)
    halves = _halves(current)
    curvatures = np.tile(np.eye(d), (n, 1, 1))
    slopes = np.zeros((n, d))
    damping = np.full(n, settings.first_damping)
    active = rows[np.isfinite(halves)]
    moved = active
    for _ in range(most_steps):
        if not len(active):
            break
        if len(moved):
            jacobians = _jacobians(
                residuals, z[moved], moved, current[moved], settings.difference_step
            )
            curvatures[moved] = np.einsum("nmi,nmj->nij", jacobians, jacobians)
            slopes[moved] = np.einsum("nmi,nm->ni", jacobians, current[moved])
        steps = _steps(curvatures[active], slopes[active], damping[active])
        lengths = np.sqrt(np.einsum("ni,ni->n", steps, steps))
        steps *= np.minimum(1.0, settings.longest_step / np.maximum(lengths, 1e-300))[:, None]
        tried = np.clip(z[active] + steps, -settings.farthest, settings.farthest)
        expected = -np.einsum("ni,ni->n", slopes[active], tried - z[active])
        new = residuals(tried, active)
        new_halves = _halves(new)
        down = new_halves < halves[active]
        damping[active] *= np.where(down, 1.0 / settings.damping_factor, settings.damping_factor)
        settled = (expected < settings.tolerance) | (damping[active] > settings.most_damping)
        moved = active[down]
        z[moved], current[moved], halves[moved] = tried[down], new[down], new_halves[down]
        moved, active = active[down & ~settled], active[~settled]
    return z, curvatures


def _halves(residuals: FloatArray) -> FloatArray:
    """Half the sum of squares (n,); infinite where a residual is not finite."""
    halves = 0.5 * np.einsum("nm,nm->n", residuals, residuals)
    return np.where(np.isfinite(halves), halves, np.inf)


def _jacobians(
    residuals: Residuals, z: FloatArray, rows: NDArray[np.intp], at_z: FloatArray, step: float
) -> FloatArray:
    """Jacobians (n, m, d) by forward differences, all in one batch; 0 where there are none."""
    n, d = z.shape
    ahead = z[:, None, :] + step * np.eye(d)
    values = residuals(ahead.reshape(-1, d), np.repeat(rows, d)).reshape(n, d, -1)
    differences = (values - at_z[:, None, :]) / step
    return np.where(np.isfinite(differences), differences, 0.0).transpose(0, 2, 1)


def _steps(curvatures: FloatArray, slopes: FloatArray, damping: FloatArray) -> FloatArray:
    """Damped Gauss-Newton steps (n, d)."""
    scale = np.einsum("nii->ni", curvatures) + np.finfo(float).tiny
    damped = curvatures + np.einsum("n,ni,ij->nij", damping, scale, np.eye(slopes.shape[1]))
    return -np.linalg.solve(damped, slopes[..., None])[..., 0]
