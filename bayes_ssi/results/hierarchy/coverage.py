"""What the stored draws say of the bumps that stand for the likelihoods of the tests.

At given parameters of a population, the likelihood of a test is that of its bumps times the mean
of r = likelihood/bumps over the distribution that bumps, prior and population give together. Its
posterior draws, at which r is known, are weighted to that distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.results.hierarchy.likelihood_fit import LikelihoodFit
from bayes_ssi.results.hierarchy.populations import PopulationLikelihood


@dataclass(frozen=True, eq=False)
class Coverage:
    """Corrections of the log-likelihoods of the tests, at S points of a population's parameters.

    Attributes:
        corrections: (S, n_tests), log of the mean of r, to be added to the log-likelihoods.
        errors: (S, n_tests), their standard errors.
        effective_sample_sizes: (S, n_tests), of the weighted draws.
    """

    corrections: FloatArray
    errors: FloatArray
    effective_sample_sizes: FloatArray

    @property
    def error(self) -> float:
        """Standard error of the sum over the tests, averaged over the points."""
        return float(np.sqrt(np.mean(np.sum(self.errors**2, axis=1))))


def coverage(
    likelihood: PopulationLikelihood,
    second: PopulationLikelihood,
    fits: Sequence[LikelihoodFit],
    z: Sequence[FloatArray],
    values: FloatArray,
) -> Coverage:
    """How far the draws of the tests confirm the bumps.

    Args:
        second: the same by the second best fits.
        z: of each test, the (n, k) coordinates of its draws that the population describes.
        values: (S, n_parameters), of the population.
    """
    means, slopes, spreads = likelihood.population.split(values)
    # Where the draws are few, what two fits differ by is what is unknown.
    differences = second.of_tests(values) - likelihood.of_tests(values)
    columns = []
    for i, (fit, draws) in enumerate(zip(fits, z, strict=True)):
        log_weights = _log_densities(draws, means + slopes * likelihood.covariates[i], spreads)
        log_weights += 0.5 * np.einsum("nk,nk->n", draws, draws) - fit.log_ratios
        weights = np.exp(log_weights - logsumexp(log_weights, axis=1, keepdims=True))
        ratios = np.exp(fit.log_ratios)
        sizes = 1.0 / np.einsum("sn,sn->s", weights, weights)
        squares = (ratios - 1.0) ** 2
        # The weighted draws alone would underestimate it where they are few.
        variances = np.maximum(weights @ squares, squares.mean()) + differences[:, i] ** 2
        columns.append((np.log(weights @ ratios), np.sqrt(variances / sizes), sizes))
    corrections, errors, sizes_of_all = (
        np.stack(each, axis=1) for each in zip(*columns, strict=True)
    )
    return Coverage(corrections, errors, sizes_of_all)


def _log_densities(draws: FloatArray, centres: FloatArray, spreads: FloatArray) -> FloatArray:
    """Log density (S, n) of a population at draws (n, k), up to a constant of each of S points.

    A population much narrower than the posterior would leave no draw any weight: it is widened by
    the posterior's covariance times the squared bandwidth of a kernel estimate (Scott 1992).
    """
    n, k = draws.shape
    bandwidth = n ** (-1.0 / (k + 4))
    kernel = bandwidth**2 * np.atleast_2d(np.cov(draws, rowvar=False))
    covariances = kernel + np.eye(k) * spreads[:, None] ** 2
    roots = np.linalg.inv(np.linalg.cholesky(covariances))
    away = np.einsum("sij,nj->sni", roots, draws) - np.einsum("sij,sj->si", roots, centres)[:, None]
    return -0.5 * np.einsum("sni,sni->sn", away, away)
