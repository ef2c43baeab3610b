"""How accurate approximate structures are made where the posterior lies."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RefinementSettings:
    """How accurate approximate structures are made where the posterior lies.

    Attributes:
        error_share: largest error of the approximation, as a share of the data's and the model's
            own errors: added in quadrature, a tenth widens them by half a per cent.
        error_quantile: quantile of the own errors over the draws that counts as their size.
        n_certified: draws at which errors are certified.
        n_searched: prior draws of the quick search that precedes sampling.
        n_climbs: number of local searches, which start from the best of these draws.
        n_confirmed: least number of draws at which full solutions correct the evidence.
        most_confirmed: largest number.
        most_searches: largest number of quick searches.
        most_rounds: largest number of rounds of sampling and refining.
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
