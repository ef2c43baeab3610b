"""Systematic resampling: one uniform draw serves all, which adds the least variance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray

__all__ = ["systematic_indices"]


def systematic_indices(weights: FloatArray, n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """``n`` sorted indices of ``weights``: how often each occurs is within one of its mean."""
    cumulative = np.cumsum(weights)
    points = (np.arange(n) + rng.random()) / max(n, 1)
    return np.searchsorted(cumulative[:-1], points * cumulative[-1], side="right")
