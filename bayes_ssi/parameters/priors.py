"""Prior distributions: what all have, the families, and their notation as text."""

import math
import re
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf, erfcinv, erfinv, log_ndtr, ndtr, ndtri, ndtri_exp

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
    """Another prior, widened in standard-normal coordinates.

    The median and the support stay; every other quantile moves to where the prior has it at
    ``factor`` times the standard-normal coordinate.

    Raises:
        ValueError: ``factor`` is not positive and finite.
    """

    prior: Prior
    factor: float  # multiplies its standard-normal coordinates; below one, the prior is narrowed

    def __post_init__(self) -> None:
        if not isinstance(self.prior, Prior):
            raise TypeError(f"Widened: prior must be a prior distribution, got {self.prior!r}")
        _require_positive(self, factor=self.factor)

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
        own = self.prior.log_density(value)
        return np.where(np.isneginf(own), own, own + np.where(np.isnan(ratio), 0.0, ratio))


def log_standard_normal_density(z: ArrayLike) -> FloatArray:
    """log φ(z) of one standard normal coordinate, elementwise."""
    z = np.asarray(z, dtype=float)
    return -0.5 * (z * z + math.log(2.0 * math.pi))


def _require_finite(prior: Prior, **numbers: float) -> None:
    for name, number in numbers.items():
        if not isinstance(number, (int, float, np.number)) or not math.isfinite(number):
            raise ValueError(
                f"{type(prior).__name__}: {name} must be a finite number, got {number!r}"
            )


def _require_positive(prior: Prior, **numbers: float) -> None:
    _require_finite(prior, **numbers)
    for name, number in numbers.items():
        if number <= 0:
            raise ValueError(f"{type(prior).__name__}: {name} must be positive, got {number!r}")


def _require_ordered(prior: Prior, lower: float, upper: float) -> None:
    if not lower < upper:
        raise ValueError(
            f"{type(prior).__name__}: lower must be less than upper, "
            f"got lower={lower!r}, upper={upper!r}"
        )


@dataclass(frozen=True)
class Normal(Prior):
    """Normal distribution.

    Attributes:
        mean: in the parameter's unit.
        sd: standard deviation, in the parameter's unit.

    Raises:
        ValueError: a number is not finite, or one that must be positive is not.

    >>> round(bs.Normal(mean=10.0, sd=2.0).quantile(0.95), 2)
    13.29
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _require_finite(self, mean=self.mean)
        _require_positive(self, sd=self.sd)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.mean + self.sd * np.asarray(z, dtype=float)

    def to_normal(self, value: ArrayLike) -> FloatArray:
        return (np.asarray(value, dtype=float) - self.mean) / self.sd

    def log_density(self, value: ArrayLike) -> FloatArray:
        return log_standard_normal_density(self.to_normal(value)) - math.log(self.sd)


@dataclass(frozen=True)
class LogNormal(Prior):
    """Lognormal distribution; its logarithm's standard deviation is ``sqrt(ln(1 + cov²))``.

    Attributes:
        median: in the parameter's unit.
        cov: coefficient of variation, a fraction.

    Raises:
        ValueError: a number is not finite, or one that must be positive is not.

    >>> bs.LogNormal(median=2.0, cov=0.3).quantile(0.5)
    2.0
    """

    median: float
    cov: float

    def __post_init__(self) -> None:
        _require_positive(self, median=self.median, cov=self.cov)

    @property
    def log_sd(self) -> float:
        """Standard deviation of the parameter's natural logarithm."""
        return math.sqrt(math.log1p(self.cov * self.cov))

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return self.median * np.exp(self.log_sd * np.asarray(z, dtype=float))

    def to_normal(self, value: ArrayLike) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(np.asarray(value, dtype=float) / self.median) / self.log_sd

    def log_density(self, value: ArrayLike) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            log_value = np.log(np.asarray(value, dtype=float))
            normal = log_standard_normal_density((log_value - math.log(self.median)) / self.log_sd)
            return _inside(log_value > -np.inf, normal - math.log(self.log_sd) - log_value)


@dataclass(frozen=True)
class Uniform(Prior):
    """Uniform distribution between two bounds.

    Attributes:
        lower: the lower bound, in the parameter's unit.
        upper: the upper bound, in the parameter's unit.

    Raises:
        ValueError: a bound is not finite, or ``lower`` is not below ``upper``.

    >>> bs.Uniform(2.0, 4.0).quantile(0.75)
    3.5
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        _require_finite(self, lower=self.lower, upper=self.upper)
        _require_ordered(self, self.lower, self.upper)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        # Φ(z) rounds to 1 beyond z = 8, so the far half is measured from the upper bound.
        z = np.asarray(z, dtype=float)
        width = self.upper - self.lower
        return np.where(z < 0, self.lower + width * ndtr(z), self.upper - width * ndtr(-z))

    def to_normal(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        width = self.upper - self.lower
        below, above = (value - self.lower) / width, (self.upper - value) / width
        return np.where(below < above, ndtri(below), -ndtri(above))

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        inside = (self.lower <= value) & (value <= self.upper)
        return _inside(inside, -math.log(self.upper - self.lower))


@dataclass(frozen=True)
class LogUniform(Prior):
    """Uniform in the logarithm between two bounds.

    Attributes:
        lower: the lower bound, positive, in the parameter's unit.
        upper: the upper bound, in the parameter's unit.

    Raises:
        ValueError: a bound is not positive and finite, or ``lower`` is not below ``upper``.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        _require_positive(self, lower=self.lower, upper=self.upper)
        _require_ordered(self, self.lower, self.upper)

    @property
    def _exponent(self) -> Uniform:
        return Uniform(math.log(self.lower), math.log(self.upper))

    def from_normal(self, z: ArrayLike) -> FloatArray:
        # The exponential of a logarithm can round to just outside the bounds.
        return np.clip(np.exp(self._exponent.from_normal(z)), self.lower, self.upper)

    def to_normal(self, value: ArrayLike) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._exponent.to_normal(np.log(np.asarray(value, dtype=float)))

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        inside = (self.lower <= value) & (value <= self.upper)
        log_value = np.log(np.where(inside, value, self.lower))
        return _inside(inside, -log_value - math.log(math.log(self.upper / self.lower)))


@dataclass(frozen=True)
class NearOne(Prior):
    """One minus a log-uniform distance: for a correlation that may be near one in any degree.

    Attributes:
        least: the smallest distance from one; the largest is 1.

    Raises:
        ValueError: ``least`` is not positive, or not below 1.
    """

    least: float

    def __post_init__(self) -> None:
        _require_positive(self, least=self.least)
        _require_ordered(self, self.least, 1.0)

    @property
    def _distance(self) -> LogUniform:
        return LogUniform(self.least, 1.0)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        return 1.0 - self._distance.from_normal(-np.asarray(z, dtype=float))

    def to_normal(self, value: ArrayLike) -> FloatArray:
        return -self._distance.to_normal(1.0 - np.asarray(value, dtype=float))

    def log_density(self, value: ArrayLike) -> FloatArray:
        return self._distance.log_density(1.0 - np.asarray(value, dtype=float))


@dataclass(frozen=True)
class TruncatedNormal(Prior):
    """Normal distribution, cut to [lower, upper].

    Attributes:
        mean: of the normal before it is cut, in the parameter's unit.
        sd: standard deviation of the normal before it is cut, in the parameter's unit.
        lower: the lower bound, in the parameter's unit; may be minus infinity.
        upper: the upper bound, in the parameter's unit; may be infinity.

    Raises:
        ValueError: a number is not usable, ``lower`` is not below ``upper``, or the bounds hold
            no probability larger than the smallest float.
    """

    mean: float
    sd: float
    lower: float = 0.0
    upper: float = math.inf

    def __post_init__(self) -> None:
        _require_finite(self, mean=self.mean)
        _require_positive(self, sd=self.sd)
        if math.isnan(self.lower) or math.isnan(self.upper):
            raise ValueError(f"TruncatedNormal: bounds must be numbers, got {self!r}")
        _require_ordered(self, self.lower, self.upper)
        if self._log_mass < -690:  # exp(-690) is the smallest probability a float holds
            raise ValueError(
                f"TruncatedNormal: [{self.lower!r}, {self.upper!r}] holds no probability of a "
                f"normal with mean {self.mean!r} and sd {self.sd!r}"
            )

    @property
    def _bounds(self) -> tuple[float, float]:
        return (self.lower - self.mean) / self.sd, (self.upper - self.mean) / self.sd

    @property
    def _log_mass(self) -> float:
        """log P(lower < normal < upper), from the tail in which it is accurate."""
        a, b = self._bounds
        if a > 0:
            a, b = -b, -a
        return float(_log_difference(log_ndtr(b), log_ndtr(a)))

    def from_normal(self, z: ArrayLike) -> FloatArray:
        # Φ(x) = Φ(a) Φ(-z) + Φ(b) Φ(z): a sum of positive terms, so accurate in the lower
        # tail; its mirror image is accurate in the upper one. Take the smaller of the two.
        z = np.asarray(z, dtype=float)
        a, b = self._bounds
        log_below = np.logaddexp(log_ndtr(a) + log_ndtr(-z), log_ndtr(b) + log_ndtr(z))
        log_above = np.logaddexp(log_ndtr(-a) + log_ndtr(-z), log_ndtr(-b) + log_ndtr(z))
        x = np.where(log_below < log_above, ndtri_exp(log_below), -ndtri_exp(log_above))
        return np.clip(self.mean + self.sd * x, self.lower, self.upper)

    def to_normal(self, value: ArrayLike) -> FloatArray:
        x = (np.asarray(value, dtype=float) - self.mean) / self.sd
        a, b = self._bounds
        if a > 0:  # both bounds in the upper tail: work in its mirror image
            x, (a, b), sign = -x, (-b, -a), -1.0
        else:
            sign = 1.0
        log_below = _log_difference(log_ndtr(x), log_ndtr(a)) - self._log_mass
        log_above = _log_difference(log_ndtr(b), log_ndtr(x)) - self._log_mass
        return sign * np.where(log_below < log_above, ndtri_exp(log_below), -ndtri_exp(log_above))

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        normal = log_standard_normal_density((value - self.mean) / self.sd)
        inside = (self.lower <= value) & (value <= self.upper)
        return _inside(inside, normal - math.log(self.sd) - self._log_mass)


@dataclass(frozen=True)
class HalfNormal(Prior):
    """The absolute value of a normal with mean zero.

    Attributes:
        scale: standard deviation of that normal, in the parameter's unit.

    Raises:
        ValueError: a number is not finite, or one that must be positive is not.
    """

    scale: float

    def __post_init__(self) -> None:
        _require_positive(self, scale=self.scale)

    def from_normal(self, z: ArrayLike) -> FloatArray:
        z = np.asarray(z, dtype=float)
        # erfinv is accurate near 0, erfcinv near infinity.
        near, far = erfinv(ndtr(np.minimum(z, 0.0))), erfcinv(ndtr(-np.maximum(z, 0.0)))
        return self.scale * math.sqrt(2.0) * np.where(z < 0, near, far)

    def to_normal(self, value: ArrayLike) -> FloatArray:
        x = np.asarray(value, dtype=float) / self.scale
        with np.errstate(divide="ignore", invalid="ignore"):
            log_above = log_ndtr(-x) + math.log(2.0)
            log_below = np.log(erf(x / math.sqrt(2.0)))
        return np.where(log_below < log_above, ndtri_exp(log_below), -ndtri_exp(log_above))

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        normal = log_standard_normal_density(value / self.scale)
        return _inside(value >= 0.0, normal - math.log(0.5 * self.scale))


def _inside(inside: NDArray[np.bool_], log_density: ArrayLike) -> FloatArray:
    """The log density inside the support, -inf elsewhere."""
    return np.where(inside, log_density, -np.inf)


def _log_difference(log_a: ArrayLike, log_b: ArrayLike) -> FloatArray:
    """log(exp(log_a) - exp(log_b)) for log_a >= log_b."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(log_a + np.log(-np.expm1(np.subtract(log_b, log_a))))


FAMILIES = {
    kind.__name__: kind
    for kind in (Normal, LogNormal, Uniform, LogUniform, NearOne, TruncatedNormal, HalfNormal)
}


def prior_from_text(text: str) -> Prior:
    """The prior that a text names, its numbers in the order of a study or by their names."""
    problem = ValueError(
        f"prior {text!r}: must be a distribution with its numbers, such as 'LogNormal(1, 0.5)'; "
        f"choose from {', '.join(FAMILIES)}"
    )
    call = re.fullmatch(r"\s*(\w+)\s*\(([^()]*)\)\s*", text)
    if call is None or call[1] not in FAMILIES:
        raise problem
    given = [each.rpartition("=") for each in call[2].split(",") if each.strip()]
    try:
        numbers = [float(number) for name, _, number in given if not name]
        named = {name.strip(): float(number) for name, _, number in given if name}
    except ValueError:
        raise problem from None
    try:
        prior: Prior = FAMILIES[call[1]](*numbers, **named)
    except TypeError:
        raise problem from None
    return prior
