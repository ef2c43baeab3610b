"""Populations from which the parameters of the tests come, and their posteriors.

The coordinates z of a test's parameters, in which their priors are N(0, I), are normally
distributed about a mean, which may follow a covariate: z_i ~ N(mean + slope·x_i, diag(spread²)).
With spread zero and without slope they are the same in all tests.

At given parameters of a population, the likelihood of a test is that of its fit times the mean of
r = likelihood/fit over the distribution that fit, prior and population give together. Its
posterior draws, at which r is known, are weighted to that distribution.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray, systematic_indices
from bayes_ssi.inference.criticism.adequacy import Adequacy
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.inference.sampling.diagnostics import Estimate, EvidenceEstimate
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.importance import LARGEST_WEIGHT
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.parameters.parameters import Parameter, values_at
from bayes_ssi.parameters.priors import HalfNormal, Normal, Prior
from bayes_ssi.results.hierarchy.likelihood_fit import GaussianSum, LikelihoodFit, fit_likelihood

# Of a population's parameters, at which the draws of the tests are asked, and which are kept:
# enough for 90 % intervals.
POPULATION_DRAWS = 500
# By which the stored evidence of a test and that of its fit may differ, in nats: so far may
# full solutions have corrected that of an approximate structure.
EVIDENCE_TOLERANCE = 0.5
# Most numbers in an array of a batch, so that it stays in the processor's cache.
BATCH_SIZE = 200_000


@dataclass(frozen=True, eq=False)
class SingleTest:
    """The posterior of one model class in one test."""

    name: str
    parameters: tuple[ParameterRecord, ...]  # of the model class, the columns of ``z``
    z: FloatArray  # (n, d), nearly independent posterior draws in standard-normal coordinates
    log_likelihoods: FloatArray  # (n,)
    evidence: Estimate  # log evidence of the class
    data_digest: str
    definitions: tuple[str, ...]
    failed_checks: tuple[str, ...]
    adequacy: Adequacy | None = None

    def columns(self, names: Sequence[str]) -> list[int]:
        own = [parameter.name for parameter in self.parameters]
        return [own.index(name) for name in names]


@dataclass(frozen=True)
class PopulationPriors:
    """Priors of what describes a population, in standard-normal coordinates of the parameters.

    The mean is N(0, 1), so that the population's centre has the model class's own prior.

    Attributes:
        spread: standard deviation from test to test, in standard deviations of the class's prior.
        slope: change of the mean by one standard deviation of the covariate.
    """

    spread: Prior = field(default_factory=partial(HalfNormal, 0.5))
    slope: Prior = field(default_factory=partial(Normal, 0.0, 0.5))


@dataclass(frozen=True)
class Population:
    """One hypothesis about how the parameters of the tests are related."""

    name: str  # in words
    names: tuple[str, ...]  # the k parameters of the model class that it describes
    varies: bool  # whether they vary from test to test
    follows: bool  # whether their mean follows the covariate
    priors: PopulationPriors

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Means, then slopes and spreads where there are any, of all k parameters."""
        kinds: list[tuple[str, Prior]] = [("mean", Normal(0.0, 1.0))]
        kinds += [("slope", self.priors.slope)] if self.follows else []
        kinds += [("spread", self.priors.spread)] if self.varies else []
        return tuple(
            Parameter(f"{kind} of {n}", prior) for kind, prior in kinds for n in self.names
        )

    def values(self, u: FloatArray) -> FloatArray:
        """Values (B, n_parameters) of the parameters at standard-normal coordinates ``u``."""
        return values_at(self.parameters, u)

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Means, slopes and spreads, each (B, k), from ``values`` (B, n_parameters)."""
        k = len(self.names)
        zeros = np.zeros((len(values), k))
        slopes = values[:, k : 2 * k] if self.follows else zeros
        return values[:, :k], slopes, values[:, -k:] if self.varies else zeros


@dataclass(frozen=True, eq=False)
class PopulationLikelihood:
    """The likelihood of all tests, each given by its fit, at parameters of a population."""

    population: Population
    components: Sequence[GaussianSum]
    covariates: FloatArray  # (n_tests,), standardised; zero where there are none

    def log_likelihood_at(self, u: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at standard-normal coordinates of the population's parameters."""
        return self.of_tests(self.population.values(u)).sum(axis=1)

    def of_tests(self, values: FloatArray) -> FloatArray:
        """The log-likelihood of every test (B, n_tests) at ``values`` (B, n_parameters)."""
        rows = max(1, BATCH_SIZE // self._joined.roots.size)
        parts = [self._of_tests(values[i : i + rows]) for i in range(0, len(values), rows)]
        return np.concatenate(parts)

    def _of_tests(self, values: FloatArray) -> FloatArray:
        """As :meth:`of_tests`.

        With z = mean + spread·e and e ~ N(0, I), the exponent of a component is quadratic in e, and
        its expectation is a normal integral.
        """
        joined = self._joined
        means, slopes, spreads = self.population.split(values)
        covariates = np.repeat(self.covariates, self._counts)
        means = means[:, None] + slopes[:, None] * covariates[:, None]
        rooted = np.einsum("tij,btj->bti", joined.roots, means)
        log_parts = joined.constants + np.einsum("tj,btj->bt", joined.slopes, means)
        log_parts -= 0.5 * np.einsum("bti,bti->bt", rooted, rooted)
        if self.population.varies:
            linear = joined.slopes - np.einsum("tij,bti->btj", joined.roots, rooted)
            linear *= spreads[:, None]
            scales = spreads[:, :, None] * spreads[:, None]
            matrices = joined.precisions * scales[:, None] + np.eye(spreads.shape[1])
            choleskys: FloatArray = np.linalg.cholesky(matrices).astype(float, copy=False)
            solved = _forward_substituted(choleskys, linear)
            log_parts += 0.5 * np.einsum("bti,bti->bt", solved, solved)
            log_parts -= np.log(np.diagonal(choleskys, axis1=2, axis2=3)).sum(axis=-1)
        first = np.cumsum(self._counts) - self._counts
        return np.logaddexp.reduceat(log_parts, first, axis=1)

    @cached_property
    def _joined(self) -> GaussianSum:
        """The components of all tests in turn, and :attr:`_counts`, how many each test has."""
        return GaussianSum(*map(np.concatenate, zip(*self.components, strict=True)))

    @cached_property
    def _counts(self) -> NDArray[np.intp]:
        return np.array([len(components.constants) for components in self.components])


def _forward_substituted(lower: FloatArray, right: FloatArray) -> FloatArray:
    """x (..., k) with lower·x = right, (..., k, k); of few rows a tenth of a solver's time."""
    solved = np.empty_like(right)
    for i in range(right.shape[-1]):
        known = (lower[..., i, :i] * solved[..., :i]).sum(axis=-1)
        solved[..., i] = (right[..., i] - known) / lower[..., i, i]
    return solved


@dataclass(frozen=True, eq=False)
class Coverage:
    """Corrections of the log-likelihoods of the tests, at S points of a population's parameters."""

    # (S, n_tests), log of the mean of r, to be added to the log-likelihoods.
    corrections: FloatArray
    errors: FloatArray  # (S, n_tests), their standard errors
    effective_sample_sizes: FloatArray  # (S, n_tests), of the weighted draws

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
    """How far the draws of the tests confirm the components.

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
    population: Population
    log_evidence: float  # in nats, of all tests together, and ``error``, its standard error
    error: float
    coverage: Coverage
    draws: FloatArray  # (n_draws, n_parameters), posterior draws of the population's parameters
    failed_checks: tuple[str, ...]


def fit_tests(
    tests: Sequence[SingleTest], seed: int, progress: Callable[[float], None]
) -> list[LikelihoodFit]:
    """Fits to the likelihood of every test; ``progress`` is called with the completed share."""
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
        integral = float(logsumexp(fit.components.integrated_over(everything).constants))
        by_draws = integral - float(np.log(np.mean(np.exp(-fit.log_ratios))))
        estimate = EvidenceEstimate("draws", by_draws, fit.error, EVIDENCE_TOLERANCE)
        if not estimate.agrees_with(test.evidence):
            failed.append(
                f"test {test.name!r}: its log evidence is {test.evidence}, but the likelihoods at "
                f"its draws give {by_draws:.2f}: a few Gaussians do not describe its posterior"
            )
    return failed


@dataclass(frozen=True, eq=False)
class PopulationSampler:
    tests: Sequence[SingleTest]
    fits: Sequence[LikelihoodFit]
    columns: Sequence[int]
    covariates: FloatArray  # (n_tests,), standardised
    seed: int
    settings: SamplingSettings

    @cached_property
    def _components(self) -> tuple[list[GaussianSum], list[GaussianSum]]:
        """The best and the second best fits, functions of the population's coordinates."""
        others = np.setdiff1d(np.arange(len(self.tests[0].parameters)), self.columns)
        return (
            [fit.components.integrated_over(others) for fit in self.fits],
            [fit.second.integrated_over(others) for fit in self.fits],
        )

    def sample(self, population: Population, progress: StepProgress) -> SampledPopulation:
        """Posterior and evidence of one population, from all tests.

        Sampled with the components for likelihoods, then corrected by the draws of the tests.
        """
        index = [self.seed, population.varies, population.follows]
        likelihood, second = (
            PopulationLikelihood(population, components, self.covariates)
            for components in self._components
        )
        target = Target(likelihood.log_likelihood_at, len(population.parameters))
        seed = np.random.SeedSequence(index)
        result = sample_target(target, seed, self.settings, progress)
        failed = [*result.failed_checks]
        rng = np.random.default_rng(index)
        importance, n_draws = result.importance, POPULATION_DRAWS
        chosen = rng.permutation(systematic_indices(importance.weights, n_draws, rng))
        values = population.values(importance.z[chosen])
        z = [test.z[:, self.columns] for test in self.tests]
        covered = coverage(likelihood, second, self.fits, z, values)
        log_weights = covered.corrections.sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        largest = float(weights.max() / weights.sum())
        if largest > LARGEST_WEIGHT:
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
