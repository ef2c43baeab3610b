"""One basis for modes of equal frequency, which the rounding of a solver would choose.

A structure that is the same in two directions has pairs of modes of one frequency. Any two motions
in the plane of a pair are its modes, and which two a solver gives depends on its rounding. Here the
first is the one that moves some degree of freedom the farthest, and the others leave that at rest:
where nothing couples two directions, those are the motions in one direction and in the other.
"""

from __future__ import annotations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, place_of_largest

# Eigenvalues that differ by this share, or by so many units in the last place of the largest, are
# equal but for rounding.
EQUAL, UNITS = 1e-9, 8.0


def settle(ascending: FloatArray, shapes: FloatArray) -> None:
    """Replace shapes of equal eigenvalues, in place, by the one basis of what they span.

    Args:
        ascending: (B, m), eigenvalues or frequencies; NaN in rows without modes.
        shapes: (B, n, m), orthonormal in any mass, at all degrees of freedom or at some.
    """
    rounding = EQUAL * ascending[:, 1:] + UNITS * np.finfo(float).eps * ascending[:, -1:]
    equal = np.diff(ascending, axis=1) <= rounding
    rows = np.flatnonzero(equal.any(axis=1))
    if not len(rows):
        return
    patterns, which = np.unique(equal[rows], axis=0, return_inverse=True)
    for i, pattern in enumerate(patterns):
        for group in np.split(np.arange(ascending.shape[1]), np.flatnonzero(~pattern) + 1):
            at = np.ix_(rows[which.ravel() == i], np.arange(shapes.shape[1]), group)
            if len(group) > 1:
                shapes[at] = _one_basis(shapes[at])


def _one_basis(shapes: FloatArray) -> FloatArray:
    """Shapes (B, n, k), combined so that each moves some degree of freedom as no later one does."""
    left, combinations = shapes, np.zeros((len(shapes), shapes.shape[2], shapes.shape[2]))
    for k in range(shapes.shape[2]):
        farthest = place_of_largest((left * left).sum(axis=2))
        direction = left[np.arange(len(left)), farthest]
        length = np.sqrt((direction * direction).sum(axis=1, keepdims=True))
        direction = direction / np.where(length > 0.0, length, 1.0)  # nothing is left of few rows
        combinations[:, :, k] = direction
        left = left - (left * direction[:, None]).sum(axis=2)[:, :, None] * direction[:, None]
    return shapes @ combinations
