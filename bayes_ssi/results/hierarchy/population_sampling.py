"""Sampling the parameters of a population from the posteriors of the single tests.

At given parameters of a population, the likelihood of a test is that of its bumps times the mean
of r = likelihood/bumps over the distribution that bumps, prior and population give together. Its
posterior draws, at which r is known, are weighted to that distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.checks import failed_checks
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.estimates import EvidenceEstimate
from bayes_ssi.inference.sampling.resampling import systematic_indices
from bayes_ssi.inference.sampling.settings import IMPORTANCE, SamplingSettings, StepProgress
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.results.hierarchy.hierarchy_settings import SETTINGS
from bayes_ssi.results.hierarchy.likelihood_fit import Bumps, LikelihoodFit, fit_likelihood
from bayes_ssi.results.hierarchy.populations import Population, PopulationLikelihood
from bayes_ssi.results.hierarchy.single_tests import SingleTest


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


@dataclass(frozen=True, eq=False)
class SampledPopulation:
    """A population whose parameters were sampled.

    Attributes:
        log_evidence: in nats, of all tests together, and ``error``, its standard error.
        draws: (n_draws, n_parameters), posterior draws of the population's parameters.
    """

    population: Population
    log_evidence: float
    error: float
    coverage: Coverage
    draws: FloatArray
    failed_checks: tuple[str, ...]


def fit_tests(
    tests: Sequence[SingleTest], seed: int, progress: Callable[[float], None]
) -> list[LikelihoodFit]:
    """Bumps for the likelihood of every test; ``progress`` is called with the completed share."""
    fits = []
    for i, test in enumerate(tests):
        rng = np.random.default_rng([seed, i])
        fits.append(fit_likelihood(test.z, test.log_likelihoods, test.evidence.log_evidence, rng))
        progress((i + 1) / len(tests))
    return fits


def failed_fits(tests: Sequence[SingleTest], fits: Sequence[LikelihoodFit]) -> list[str]:
    """Tests whose draws, likelihoods and evidence do not go together, a sentence each."""
    failed = []
    for test, fit in zip(tests, fits, strict=True):
        everything = np.arange(test.z.shape[1])
        integral = float(logsumexp(fit.bumps.integrated_over(everything).constants))
        by_draws = integral - float(np.log(np.mean(np.exp(-fit.log_ratios))))
        estimate = EvidenceEstimate("draws", by_draws, fit.error, SETTINGS.evidence_tolerance)
        if not estimate.agrees_with(test.evidence):
            failed.append(
                f"test {test.name!r}: its log evidence is {test.evidence}, but the likelihoods at "
                f"its draws give {by_draws:.2f}: a few normal bumps do not describe its posterior"
            )
    return failed


@dataclass(frozen=True, eq=False)
class PopulationSampler:
    """Samples populations of one series of tests.

    Attributes:
        covariates: (n_tests,), standardised.
    """

    tests: Sequence[SingleTest]
    fits: Sequence[LikelihoodFit]
    columns: Sequence[int]
    covariates: FloatArray
    seed: int
    settings: SamplingSettings

    @cached_property
    def _bumps(self) -> tuple[list[Bumps], list[Bumps]]:
        """The best and the second best fits, functions of the population's coordinates."""
        others = np.setdiff1d(np.arange(len(self.tests[0].parameters)), self.columns)
        return (
            [fit.bumps.integrated_over(others) for fit in self.fits],
            [fit.second.integrated_over(others) for fit in self.fits],
        )

    def sample(self, population: Population, progress: StepProgress) -> SampledPopulation:
        """Posterior and evidence of one population, from all tests.

        Sampled with the bumps for likelihoods, then corrected by the draws of the tests.
        """
        index = [self.seed, population.varies, population.follows]
        likelihood, second = (
            PopulationLikelihood(population, bumps, self.covariates) for bumps in self._bumps
        )
        target = Target(likelihood.log_likelihood_at, len(population.parameters))
        seed = np.random.SeedSequence(index)
        result = sample_target(target, seed, self.settings, progress)
        failed = [*failed_checks(result)]
        rng = np.random.default_rng(index)
        importance, n_draws = result.importance, SETTINGS.population_draws
        chosen = rng.permutation(systematic_indices(importance.weights, n_draws, rng))
        values = population.values(importance.z[chosen])
        z = [test.z[:, self.columns] for test in self.tests]
        covered = coverage(likelihood, second, self.fits, z, values)
        log_weights = covered.corrections.sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        largest = float(weights.max() / weights.sum())
        if largest > IMPORTANCE.largest_weight:
            failed.append(
                "the draws of the tests change the posterior of the population so much that one of "
                f"{n_draws} draws carries {100 * largest:.0f} % of it"
            )
        correction = float(log_weights.max() + np.log(weights.mean()))
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n_draws))
        return SampledPopulation(
            population=population,
            log_evidence=result.evidence.log_evidence + correction,
            error=math.hypot(result.evidence.error, error, covered.error),
            coverage=covered,
            draws=values[rng.permutation(systematic_indices(weights, n_draws, rng))],
            failed_checks=tuple(failed),
        )
