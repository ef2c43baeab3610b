"""Sampling the parameters of a population from the posteriors of the single tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.checks import failed_checks
from bayes_ssi.inference.sampling.diagnostics import LARGEST_WEIGHT
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.estimates import EvidenceEstimate
from bayes_ssi.inference.sampling.resampling import systematic_indices
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.results.hierarchy.coverage import Coverage, coverage
from bayes_ssi.results.hierarchy.likelihood_fit import Bumps, LikelihoodFit, fit_likelihood
from bayes_ssi.results.hierarchy.populations import Population, PopulationLikelihood
from bayes_ssi.results.hierarchy.single_tests import SingleTest

# Posterior draws of a population's parameters at which the draws of the tests are asked, and which
# are kept: enough for 90 % intervals.
KEPT = 500
# The stored evidence of a test and that of its bumps may differ by this much, in nats: so far may
# full solutions have corrected the evidence of an approximate structure.
EVIDENCE_TOLERANCE = 0.5


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
        estimate = EvidenceEstimate("draws", by_draws, fit.error, EVIDENCE_TOLERANCE)
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
        failed = failed_checks(result)
        rng = np.random.default_rng(index)
        importance = result.importance
        chosen = rng.permutation(systematic_indices(importance.weights, KEPT, rng))
        values = population.values(importance.z[chosen])
        z = [test.z[:, self.columns] for test in self.tests]
        covered = coverage(likelihood, second, self.fits, z, values)
        log_weights = covered.corrections.sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        correction = float(log_weights.max() + np.log(weights.mean()))
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(KEPT))
        return SampledPopulation(
            population=population,
            log_evidence=result.evidence.log_evidence + correction,
            error=math.hypot(result.evidence.error, error, covered.error),
            coverage=covered,
            draws=values[rng.permutation(systematic_indices(weights, KEPT, rng))],
            failed_checks=(*failed, *_failed_correction(weights)),
        )


def _failed_correction(weights: FloatArray) -> list[str]:
    largest = float(weights.max() / weights.sum())
    if largest <= LARGEST_WEIGHT:
        return []
    return [
        "the draws of the tests change the posterior of the population so much that one of "
        f"{KEPT} draws carries {100 * largest:.0f} % of it"
    ]
