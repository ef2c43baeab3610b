"""The types of the arrays that pass between modules."""

import hashlib
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complexfloating[Any, Any]]
# What selects along one axis.
Places = IntArray | slice
# A named tuple of arrays.
Arrays = TypeVar("Arrays", bound=tuple[Any, ...])
# Sizes that differ by this share are equal, where rounding should not choose between them.
EQUAL_SIZES = 1e-6


def joined(parts: Sequence[Arrays], axis: int = 0) -> Arrays:
    """Named tuples of arrays as one, every array joined along an axis."""
    return type(parts[0])(*(np.concatenate(arrays, axis) for arrays in zip(*parts, strict=True)))


def row_sums(terms: FloatArray) -> FloatArray:
    """The sum over the second axis of (B, m) or (B, m, …), the same for a row in any batch.

    numpy adds in an order that depends on the memory layout, which a batch of one may change; here
    one term is added after the other, to all rows at once.
    """
    if not terms.shape[1]:
        return np.zeros((len(terms), *terms.shape[2:]))
    total = np.copy(terms[:, 0])
    for j in range(1, terms.shape[1]):
        total += terms[:, j]
    return total


def folded(terms: FloatArray) -> FloatArray:
    """The sum over the first axis of (n, …), the same for an element in any array; n is at least 1.

    As :func:`row_sums`, with few operations where n is large: one half is added to the other.
    """
    while (n := len(terms)) > 1:
        half = n // 2
        first, terms = terms, terms[:half] + terms[half : 2 * half]
        if n % 2:
            terms[0] += first[-1]
    return terms[0]


def place_of_largest(sizes: FloatArray) -> NDArray[np.intp]:
    """The place (...) of the largest of ``sizes`` (..., n), the first of equal ones.

    Of (1, -1), as of any antisymmetric shape, rounding would say which one is larger.
    """
    least = (1.0 - EQUAL_SIZES) * sizes.max(axis=-1, keepdims=True)
    return np.asarray((sizes >= least).argmax(axis=-1), dtype=np.intp)


def steady_digest(numbers: FloatArray, *places: NDArray[Any]) -> str:
    """A digest of numbers (n,) at places, (n,) along each axis, that rounding hardly ever changes.

    It is one of sums with several weights, to nine digits of the numbers' root sum of squares.
    """
    size = float(np.sqrt(np.square(numbers).sum()))
    phases = sum(np.sqrt(axis + 2.0) * (place + 1.0) for axis, place in enumerate(places))
    sums = [float((np.cos(k * phases) * numbers).sum()) / (size or 1.0) for k in (1.0, 2.3, 3.7)]
    text = " ".join([f"{size:.9g}", *(f"{each:.9f}" for each in sums)]).replace("-0.000000000", "0")
    return hashlib.sha256(text.encode()).hexdigest()[:16]


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
