"""Mean, standard deviation and quantiles of the draws of a quantity."""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray

# Of a median and the central 90 %.
LEVEL = 0.9  # probability of every interval that is shown
LEVELS = (0.05, 0.5, 0.95)
Quantiles = tuple[float, float, float]


@dataclass(frozen=True)
class Summary:
    """Mean, standard deviation, median and central 90 % of a named quantity."""

    name: str
    mean: float
    sd: float
    quantile_05: float
    median: float
    quantile_95: float

    @classmethod
    def weighted(cls, name: str, values: FloatArray, weights: FloatArray, **further: Any) -> Self:
        """The summary of draws ``values`` (n,) whose ``weights`` (n,) add up to one."""
        mean = float((weights * values).sum())
        sd = math.sqrt(float((weights * (values - mean) ** 2).sum()))
        return cls(name, mean, sd, *weighted_quantiles(values, weights), **further)


def weighted_quantiles(values: FloatArray, weights: FloatArray) -> Quantiles:
    """The 5, 50 and 95 % quantiles of weighted ``values`` (n,).

    The smallest value that this share of the weights does not exceed. Where the weights up to a
    value add up to just 5 %, as they may in equal draws, the sum's rounding must not choose.
    """
    order = np.argsort(values)
    ends = np.cumsum(weights[order])
    rounding = len(values) * np.finfo(float).eps
    places = np.searchsorted(ends, np.multiply(LEVELS, ends[-1] * (1.0 - rounding)))
    low, median, high = values[order[places]]
    return float(low), float(median), float(high)
