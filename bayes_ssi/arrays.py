"""The types of the arrays that pass between modules."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating[Any, Any]]
# What selects along one axis.
Places = NDArray[np.intp] | slice
# Sizes that differ by this share are equal, where rounding should not choose between them.
EQUAL_SIZES = 1e-6


def as_slice(places: NDArray[np.intp]) -> Places:
    """The same places as a slice where they follow each other, which saves a copy."""
    first = int(places[0]) if len(places) else 0
    if np.array_equal(places, np.arange(first, first + len(places))):
        return slice(first, first + len(places))
    return places


def place_of_largest(sizes: FloatArray) -> NDArray[np.intp]:
    """The place (...) of the largest of ``sizes`` (..., n), the first of equal ones.

    Of (1, -1), as of any antisymmetric shape, rounding would say which one is larger.
    """
    least = (1.0 - EQUAL_SIZES) * sizes.max(axis=-1, keepdims=True)
    return np.asarray((sizes >= least).argmax(axis=-1), dtype=np.intp)
