"""What a prior distribution answers, and the checks of its numbers."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from bayes_ssi.arrays import FloatArray

__all__ = [
    "Prior",
    "require_finite",
    "require_ordered",
    "require_positive",
]


class Prior(ABC):
    """A proper distribution of one parameter.

    Subclasses give the map from a standard-normal coordinate to a value and back; the rest
    follows from it.
    """

    # Where a stored record names the family.
    record_tag = "distribution"

    @abstractmethod
    def from_normal(self, z: ArrayLike) -> FloatArray:
        """Values at standard-normal coordinates ``z`` (any shape)."""

    @abstractmethod
    def to_normal(self, value: ArrayLike) -> FloatArray:
        """Standard-normal coordinates of ``value`` (any shape); the inverse of ``from_normal``."""

    @abstractmethod
    def log_pdf(self, value: ArrayLike) -> FloatArray:
        """Natural logarithm of the normalised density; ``-inf`` outside the support."""

    @abstractmethod
    def widened(self, factor: float) -> Self:
        """The same distribution with ``factor`` times the width about its middle.

        That is the standard deviation (of a lognormal, of the logarithm), or the distance between
        the bounds (of a log-uniform, of their logarithms). A lower bound of a uniform that is not
        negative stays so: at most half of it is given up.
        """

    def quantile(self, probability: float) -> float:
        """The value below which the parameter lies with ``probability``."""
        return float(self.from_normal(ndtri(probability)))

    def probability_below(self, value: float) -> float:
        """P(parameter <= ``value``)."""
        low, high = self.from_normal(np.array([-40.0, 40.0]))
        if value <= low:
            return 0.0
        if value >= high:
            return 1.0
        return float(ndtr(self.to_normal(value)))


def require_finite(prior: Prior, **numbers: float) -> None:
    for name, number in numbers.items():
        if not isinstance(number, (int, float, np.number)) or not math.isfinite(number):
            raise ValueError(
                f"{type(prior).__name__}: {name} must be a finite number, got {number!r}"
            )


def require_positive(prior: Prior, **numbers: float) -> None:
    require_finite(prior, **numbers)
    for name, number in numbers.items():
        if number <= 0:
            raise ValueError(f"{type(prior).__name__}: {name} must be positive, got {number!r}")


def require_ordered(prior: Prior, lower: float, upper: float) -> None:
    if not lower < upper:
        raise ValueError(
            f"{type(prior).__name__}: lower must be less than upper, "
            f"got lower={lower!r}, upper={upper!r}"
        )
