"""The types of the arrays that pass between modules."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating[Any, Any]]
# What selects along one axis.
Places = NDArray[np.intp] | slice


def as_slice(places: NDArray[np.intp]) -> Places:
    """The same places as a slice where they follow each other, which saves a copy."""
    first = int(places[0]) if len(places) else 0
    if np.array_equal(places, np.arange(first, first + len(places))):
        return slice(first, first + len(places))
    return places
