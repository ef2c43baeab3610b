"""Importance samples: posterior draws with weights, whose mean is the evidence; in log space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.diagnostics import pareto_shape
from bayes_ssi.sampling.ensembles import Ensemble
from bayes_ssi.sampling.estimates import Estimate
from bayes_ssi.sampling.mixture import StudentMixture
from bayes_ssi.sampling.resampling import systematic_indices
from bayes_ssi.sampling.target import log_standard_normal

__all__ = ["ImportanceSample"]

# The variance within a stratum is estimated from at least this many draws.
LEAST_STRATUM = 20
# Posterior draws made of one importance sample: enough for quantiles, few enough to be stored.
MAX_RESAMPLED = 5000


@dataclass(frozen=True, eq=False)
class ImportanceSample:
    """Draws from a mixture, weighted to the posterior.

    Attributes:
        mixture: what the draws come from.
        z: (n, d), standard-normal coordinates.
        log_likelihoods: (n,).
        log_proposals: (n,), log density of the mixture.
        strata: (n,), the component that each draw came from; the prior's is the last.
    """

    mixture: StudentMixture
    z: FloatArray
    log_likelihoods: FloatArray
    log_proposals: FloatArray
    strata: NDArray[np.intp]

    @property
    def log_posteriors(self) -> FloatArray:
        """Likelihood times prior density, (n,)."""
        return self.log_likelihoods + log_standard_normal(self.z)

    @cached_property
    def log_weights(self) -> FloatArray:
        """log(likelihood · prior / proposal), (n,)."""
        return self.log_posteriors - self.log_proposals

    @cached_property
    def weights(self) -> FloatArray:
        """Weights (n,) that add up to one."""
        log_weights = self.log_weights
        return np.exp(log_weights - logsumexp(log_weights))

    @property
    def typical_draws(self) -> tuple[FloatArray, FloatArray]:
        """Draws with at least a tenth of the mean weight, (m, d), and their log posteriors (m,)."""
        typical = self.weights > 0.1 / len(self.z)
        return self.z[typical], self.log_posteriors[typical]

    @property
    def effective_sample_size(self) -> float:
        """1 / Σ w² of the normalised weights (Kish)."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def efficiency(self) -> float:
        """The effective sample size as a share of the draws."""
        return self.effective_sample_size / len(self.z)

    @property
    def pareto_k(self) -> float:
        """Shape of the generalised Pareto distribution of the largest weights.

        The mean of weights has a finite variance where it is below one half.
        """
        return pareto_shape(self.weights)

    @property
    def estimate(self) -> Estimate:
        """The log of the mean weight, its error by strata.

        Every component gives draws in proportion to its weight, so what varies is only the mean
        of each stratum: Var = Σ n_k var_k / n².
        """
        log_mean = float(logsumexp(self.log_weights)) - math.log(len(self.weights))
        return Estimate(log_mean, self._error_of_sum(self.weights))

    def _error_of_sum(self, terms: FloatArray) -> float:
        """Standard error of the sum of one term (n,) a draw, by strata."""
        counts = np.bincount(self.strata)
        # Strata with too few draws to know their variance count as one.
        strata = np.where(counts[self.strata] < LEAST_STRATUM, -1, self.strata)
        each = [terms[strata == k] for k in np.unique(strata)]
        return math.sqrt(sum(len(own) * own.var(ddof=1) for own in each if len(own) > 1))

    @property
    def log_likelihood_mean(self) -> float:
        """Posterior mean of the log-likelihood."""
        weights = self.weights
        return float(weights @ np.where(weights > 0, self.log_likelihoods, 0.0))

    def share_errors(self, groups: NDArray[np.intp], n_groups: int) -> FloatArray:
        """Standard errors (n_groups,) of the posterior's shares in ``groups`` (n,)."""
        weights = self.weights
        shares = np.bincount(groups, weights, minlength=n_groups)
        member = groups == np.arange(n_groups)[:, None]
        terms = weights * (member - shares[:, None])
        return np.array([self._error_of_sum(of_group) for of_group in terms])

    def split_in_two(self, rng: np.random.Generator) -> list[ImportanceSample]:
        """The draws in two equal parts, at random."""
        return [
            ImportanceSample(
                self.mixture,
                self.z[part],
                self.log_likelihoods[part],
                self.log_proposals[part],
                self.strata[part],
            )
            for part in np.array_split(rng.permutation(len(self.z)), 2)
        ]

    def resampled(self, rng: np.random.Generator) -> Ensemble:
        """As many equally weighted posterior draws as there are importance draws, shuffled.

        At most ``MAX_RESAMPLED``. Instead of an autocorrelation time the ensemble has the number
        of its draws over the effective sample size.
        """
        n = min(len(self.z), MAX_RESAMPLED)
        chosen = rng.permutation(systematic_indices(self.weights, n, rng))
        positions = self.z[chosen][:, None]
        time = max(1.0, n / self.effective_sample_size)
        return Ensemble(
            positions=positions,
            log_posteriors=self.log_posteriors[chosen][:, None],
            autocorrelation_times=np.full(positions.shape[-1], time),
            acceptance=len(np.unique(chosen)) / n,
        )
