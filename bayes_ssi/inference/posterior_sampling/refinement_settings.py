"""How accurate approximate structures are made where the posterior lies."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RefinementSettings:
    """How accurate approximate structures are made where the posterior lies.

    Attributes:
        error_share: largest error of the approximation, as a share of the data's and the model's
            own errors: added in quadrature, a tenth widens them by half a per cent.
        largest_correction: largest correction of the log evidence that these draws can support.
    """

    error_share: float = 0.1
    error_quantile: float = 0.05
    n_certified: int = 200
    n_searched: int = 1000
    n_climbs: int = 16
    n_confirmed: int = 16
    most_confirmed: int = 64
    most_searches: int = 50
    most_rounds: int = 4
    largest_correction: float = 0.3
