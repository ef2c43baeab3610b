"""What is sampled: a log-likelihood over standard-normal coordinates, evaluated in batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bayes_ssi.priors import FloatArray

__all__ = ["Target", "log_standard_normal"]


def log_standard_normal(z: FloatArray) -> FloatArray:
    """log N(z; 0, I), (B,), for ``z`` (B, d)."""
    return -0.5 * np.einsum("bd,bd->b", z, z) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)


@dataclass
class Target:
    """A log-likelihood over coordinates whose prior is N(0, I); counts its evaluations.

    Attributes:
        function: (B, d) coordinates → (B,) log-likelihoods.
        n_dimensions: d.
        n_evaluations: points evaluated so far.
        n_failed: of these, how many gave NaN; they count as likelihood zero.
    """

    function: Callable[[FloatArray], FloatArray]
    n_dimensions: int
    n_evaluations: int = field(default=0, init=False)
    n_failed: int = field(default=0, init=False)

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        """The log-likelihood (B,); -inf where the function gave NaN.

        Raises:
            ValueError: the function returned the wrong shape, or infinite likelihood.
        """
        if not len(z):
            return np.empty(0)
        values = np.asarray(self.function(z), dtype=float)
        if values.shape != (len(z),):
            raise ValueError(
                f"log-likelihood: expected one value for each of {len(z)} points, "
                f"got shape {values.shape}"
            )
        self.n_evaluations += len(z)
        failed = np.isnan(values)
        if failed.any():
            self.n_failed += int(failed.sum())
            values = np.where(failed, -np.inf, values)
        if np.isposinf(values).any():
            where = np.array2string(z[np.isposinf(values)][0], precision=3)
            raise ValueError(
                f"the log-likelihood is +inf at coordinates {where}: did an error size go to zero "
                "where the data are fitted exactly? Give it a prior that keeps away from zero, "
                "such as LogNormal"
            )
        return values

    def log_posterior(self, z: FloatArray) -> FloatArray:
        """log-likelihood + log prior density, (B,): the posterior up to the evidence."""
        return self.log_likelihood(z) + log_standard_normal(z)
