"""Selection of draws by their weights, or evenly."""

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray


def systematic_indices(weights: FloatArray, n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """``n`` sorted indices into ``weights``, each occurring within one of its expected number.

    One uniform draw serves all of them (systematic resampling), which adds the least variance.
    """
    cumulative = np.cumsum(weights)
    points = (np.arange(n) + rng.random()) / max(n, 1)
    return np.searchsorted(cumulative[:-1], points * cumulative[-1], side="right")


def evenly_spaced_indices(n: int, most: int) -> NDArray[np.intp]:
    """At most ``most`` of the indices of ``n`` draws, the first and the last among them."""
    return np.linspace(0, n - 1, min(n, most)).astype(np.intp)
