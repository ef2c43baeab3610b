"""Error model and identification model: how identified modes differ from model modes."""

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import (
    Parameter,
    Product,
    Value,
    as_product,
    fraction_product,
    positive_product,
)
from bayes_ssi.parameters.priors import LogNormal

# Sizes of errors that are not given.
FREQUENCY_COV = Parameter("frequency_cov", LogNormal(median=0.01, cov=1.0))
SHAPE_SD = Parameter("shape_sd", LogNormal(median=0.05, cov=1.0))


@dataclass(frozen=True)
class ErrorModel:
    """Prediction errors of a model, of one size for all modes.

    They are added in quadrature to each mode's own identification errors, where the data give
    them. By default both sizes are inferred, and errors are independent. Errors that one model
    repeats are correlated, as :mod:`~bayes_ssi.inference.likelihood.correlated_errors` defines.

    Attributes:
        frequency_cov: standard deviation of the frequency error as a fraction of the frequency
            (half the coefficient of variation of f²).
        shape_sd: standard deviation of each component of the shape at unit length.
        between_tests: correlation of the errors of one mode in different tests, of its frequency
            and of its shape. A mode has the same label in all tests.
        between_modes: correlation of the frequency errors of successive modes of the model;
            its power ``|i - j|`` between modes i and j.

    Raises:
        ValueError: a size can be zero or negative, or a correlation can be outside [0, 1).
        TypeError: a value is neither a number nor a Parameter.

    >>> round(bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05).shape_weight, 3)
    0.2
    """

    frequency_cov: Value = FREQUENCY_COV
    shape_sd: Value = SHAPE_SD
    between_tests: Value = 0.0
    between_modes: Value = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency_cov", "shape_sd"):
            positive_product(getattr(self, name), f"ErrorModel: {name}")
        for name in ("between_tests", "between_modes"):
            fraction_product(getattr(self, name), f"ErrorModel: {name}")

    @property
    def correlations(self) -> tuple[Product, Product]:
        """``between_tests`` and ``between_modes``."""
        return as_product(self.between_tests), as_product(self.between_modes)

    @cached_property
    def repeats_between_tests(self) -> bool:
        """Whether ``between_tests`` is not fixed at zero."""
        return as_product(self.between_tests).scale != 0.0

    @cached_property
    def repeats_between_modes(self) -> bool:
        """Whether ``between_modes`` is not fixed at zero."""
        return as_product(self.between_modes).scale != 0.0

    @property
    def is_correlated(self) -> bool:
        """Whether any correlation is not fixed at zero."""
        return self.repeats_between_tests or self.repeats_between_modes

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The inferred parameters of the errors' sizes and correlations."""
        products = (as_product(getattr(self, each.name)) for each in fields(self))
        return tuple(parameter for product in products for parameter in product.parameters)

    @property
    def shape_weight(self) -> float:
        """λ = σ_f/σ_φ, the weight at which the paper's objective is this likelihood's exponent."""
        return as_product(self.frequency_cov).median / as_product(self.shape_sd).median


@dataclass(frozen=True)
class IdentificationModel:
    """Detection of model modes in the band, and spurious modes.

    Attributes:
        detection_probability: p_D, the probability that a model mode in the band is identified.
        expected_spurious_modes: ν, the expected number of identified modes in the band that
            belong to no model mode.

    Raises:
        ValueError: p_D is not strictly between 0 and 1, or ν is not positive and finite.
    """

    detection_probability: float = 0.95
    expected_spurious_modes: float = 0.1

    def __post_init__(self) -> None:
        if not 0.0 < self.detection_probability < 1.0:
            raise ValueError(
                "IdentificationModel: detection_probability must lie strictly between 0 and 1, "
                f"got {self.detection_probability!r}"
            )
        if not 0.0 < self.expected_spurious_modes < math.inf:
            raise ValueError(
                "IdentificationModel: expected_spurious_modes must be positive and finite, "
                f"got {self.expected_spurious_modes!r}"
            )

    def log_missed(
        self, frequencies_hz: FloatArray, variances: FloatArray, band_hz: tuple[float, float]
    ) -> FloatArray:
        """log(1 - p_D P_in), (B, m): log probability that model modes are not identified.

        Args:
            frequencies_hz: (B, m), of the model modes.
            variances: (B, 1), squared errors of identified frequencies, as fractions.
            band_hz: limits of the band in which modes are identified.
        """
        low, high = band_hz
        sd = np.sqrt(variances) * frequencies_hz
        inside = ndtr((high - frequencies_hz) / sd) - ndtr((low - frequencies_hz) / sd)
        return np.log1p(-self.detection_probability * inside)
