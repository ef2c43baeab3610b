"""Nearest neighbours among draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray

__all__ = ["NEIGHBOURS", "nearest_neighbours"]

# Of each draw: enough to connect draws of one region, in a few dimensions, into one network.
NEIGHBOURS = 8


def nearest_neighbours(points: FloatArray) -> NDArray[np.intp]:
    """The nearest of ``points`` (n, d) to each, (n, k), itself the first."""
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS + 1, len(points))
    _, nearest = cKDTree(points).query(points, k=k)
    return np.reshape(nearest, (len(points), -1)).astype(np.intp)
