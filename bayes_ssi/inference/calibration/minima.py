"""Distinct minima, and the fit that stands for parameters which the data do not determine."""

from __future__ import annotations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.calibration.least_squares import EXACTLY_ZERO, CalibrationProblem

# Minima within a hundredth of a prior standard deviation are the same one.
SAME = 1e-2
# Misfits are computed to about this: exact fits differ by less.
EQUALLY_GOOD = 1e-7
# The nearest fit is reached in two or three rounds where the fit is smooth at all.
MOST_ROUNDS = 20


def distinct_minima(
    problem: CalibrationProblem, ends: list[FloatArray]
) -> tuple[list[FloatArray], int]:
    """Distinct minima, the best first, and the directions undetermined at the best one."""
    misfits = problem.misfit(np.array(ends)).tolist()
    # Exact fits differ only by rounding: they are equally good, and the nearest one comes first; of
    # two that mirror one another, the one of smaller coordinates.
    near = [round(float(np.linalg.norm(end)), 6) for end in ends]
    places = [np.round(end, 6).tolist() for end in ends]
    order = sorted(range(len(ends)), key=lambda i: (round(misfits[i], 7), near[i], places[i]))
    kept: list[int] = []
    for i in order:
        if all(np.abs(ends[i] - ends[j]).max() > SAME for j in kept):
            kept.append(i)
    best = ends[kept[0]]
    undetermined = (
        0 if problem.with_prior else len(best) - _determined(problem, best, True).shape[1]
    )
    if undetermined:
        # The equally good points form a surface; the nearest of them represents it.
        kept = [kept[0], *(i for i in kept if misfits[i] >= misfits[kept[0]] + EQUALLY_GOOD)]
        nearest = nearest_fit(problem, best, exactly=True)
        if (
            nearest is not None
            and problem.misfit(nearest[None])[0] < misfits[kept[0]] + EQUALLY_GOOD
        ):
            best = nearest
    return [best, *(ends[i] for i in kept[1:])], undetermined


def nearest_fit(problem: CalibrationProblem, start: FloatArray, exactly: bool) -> FloatArray | None:
    """The fit whose undetermined directions are at the prior median.

    None where every direction is determined, or no fit is reached.

    For residuals linear in the standard-normal coordinates this is the least-squares solution of
    smallest norm, by the truncated singular value decomposition.

    Args:
        start: (d,), near the fit.
        exactly: whether only directions count as undetermined that change nothing at all, rather
            than less than the standard errors.
    """
    z = start
    for _ in range(MOST_ROUNDS):
        basis = _determined(problem, z, exactly)
        if basis.shape[1] == len(z):
            return None
        if not basis.size:
            return np.zeros(len(z))
        found = problem.descend(z, basis)
        if found is None:
            return None
        z, last = found, z
        if np.abs(z - last).max() < SAME**2:
            break
    return z


def _determined(problem: CalibrationProblem, z: FloatArray, exactly: bool) -> FloatArray:
    """Orthonormal basis (d, r) of the directions that are determined at one point."""
    _, sizes, rows = np.linalg.svd(problem.sensitivities(z), full_matrices=False)
    basis: FloatArray = rows[sizes > (EXACTLY_ZERO * sizes.max() if exactly else 1.0)].T
    return basis
