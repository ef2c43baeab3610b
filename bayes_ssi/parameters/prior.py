"""The base class of prior distributions, and the checks of their numbers."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from bayes_ssi.foundations.arrays import FloatArray


class Prior(ABC):
    """A proper distribution of one parameter.

    Subclasses give the map from a standard-normal coordinate to a value, its inverse and the
    density; all else follows from these.
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
    def log_density(self, value: ArrayLike) -> FloatArray:
        """Log density at ``value`` (any shape), per unit of the parameter; -inf outside it."""

    @property
    def support(self) -> tuple[float, float]:
        """The lower and the upper bound of the values, which may be infinite."""
        low, high = self.from_normal(np.array([-np.inf, np.inf])).tolist()
        return low, high

    def widened(self, factor: float) -> "Prior":
        """This prior, ``factor`` times as wide in standard-normal coordinates.

        The median and the support stay; every other quantile moves to where this prior has it
        at ``factor`` times the standard-normal coordinate. A factor below one narrows.

        Raises:
            ValueError: ``factor`` is not positive and finite.
        """
        return Widened(self, factor)

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


@dataclass(frozen=True)
class Widened(Prior):
    """Another prior, widened in standard-normal coordinates."""

    prior: Prior
    factor: float  # multiplies its standard-normal coordinates; below one, the prior is narrowed

    def __post_init__(self) -> None:
        if not isinstance(self.prior, Prior):
            raise TypeError(f"Widened: prior must be a prior distribution, got {self.prior!r}")
        require_positive(self, factor=self.factor)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.prior.from_normal(self.factor * np.asarray(z, dtype=float))

    def to_normal(self, value: ArrayLike) -> FloatArray:
        return self.prior.to_normal(value) / self.factor

    def log_density(self, value: ArrayLike) -> FloatArray:
        z = self.prior.to_normal(value)
        # With φ the standard normal density, the prior's is φ(z) dz/dx, and this one's
        # φ(z/factor) / factor · dz/dx. Outside the support both are zero.
        with np.errstate(invalid="ignore"):
            ratio = 0.5 * (z * z - (z / self.factor) ** 2) - math.log(self.factor)
        inside = self.prior.log_density(value)
        return np.where(
            np.isneginf(inside), -np.inf, inside + np.where(np.isnan(ratio), 0.0, ratio)
        )


def log_standard_normal_density(z: ArrayLike) -> FloatArray:
    """log φ(z) of one standard normal coordinate, elementwise."""
    z = np.asarray(z, dtype=float)
    return -0.5 * (z * z + math.log(2.0 * math.pi))


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
