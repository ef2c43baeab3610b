"""Prior distributions: proper, and written as transformations of a standard normal.

Sampling takes place in standard-normal coordinates ``z`` with
``value = F⁻¹(Φ(z))``, where ``F`` is the prior's distribution function. In these
coordinates every prior is N(0, I) and no sample can leave the prior's support.
"""

from bayes_ssi.priors.families import (
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from bayes_ssi.priors.prior import Prior

__all__ = [
    "HalfNormal",
    "LogNormal",
    "LogUniform",
    "Normal",
    "Prior",
    "TruncatedNormal",
    "Uniform",
]
