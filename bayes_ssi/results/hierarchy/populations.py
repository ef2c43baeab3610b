"""Populations from which the parameters of the tests come, and their posteriors.

The coordinates z of a test's parameters, in which their priors are N(0, I), are normally
distributed about a mean, which may follow a covariate: z_i ~ N(mean + slope·x_i, diag(spread²)).
With spread zero and without slope they are the same in all tests.

At given parameters of a population, the likelihood of a test is that of its fit times the mean of
r = likelihood/fit over the distribution that fit, prior and population give together. Its
posterior draws, at which r is known, are weighted to that distribution.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray, systematic_indices
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.importance import LARGEST_WEIGHT
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.parameters.parameters import Parameter, values_at
from bayes_ssi.parameters.priors import HalfNormal, Normal, Prior
from bayes_ssi.results.hierarchy.likelihood_fit import (
    LikelihoodFit,
    log_integrals,
    mapped,
    standard_form,
)

# Of a population's parameters, at which the draws of the tests are asked, and which are kept:
# enough for 90 % intervals.
POPULATION_DRAWS = 500
# Most numbers in an array of a batch, so that it stays in the processor's cache.
BATCH_SIZE = 200_000


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

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Means, slopes and spreads, each (B, k), from ``values`` (B, n_parameters)."""
        k = len(self.names)
        zeros = np.zeros((len(values), k))
        slopes = values[:, k : 2 * k] if self.follows else zeros
        return values[:, :k], slopes, values[:, -k:] if self.varies else zeros


def log_likelihoods(
    population: Population,
    components: Sequence[FloatArray],
    covariates: FloatArray,
    values: FloatArray,
) -> FloatArray:
    """The log-likelihood of every test (B, n_tests), each given by the forms of its components.

    Args:
        covariates: (n_tests,), standardised; zero where there are none.
        values: (B, n_parameters), of the population.
    """
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():  # quantiles, where a prior's probability rounds to one
        logs = np.full((len(values), len(components)), -np.inf)
        logs[finite] = log_likelihoods(population, components, covariates, values[finite])
        return logs
    joined = np.concatenate(components)
    rows = max(1, BATCH_SIZE // joined.size)
    if len(values) > rows:
        parts = (values[i : i + rows] for i in range(0, len(values), rows))
        return np.concatenate(
            [log_likelihoods(population, components, covariates, part) for part in parts]
        )
    counts = np.array([len(forms) for forms in components])
    first = np.cumsum(counts) - counts
    means, slopes, spreads = population.split(values)
    centres = means[:, None] + slopes[:, None] * np.repeat(covariates, counts)[:, None]
    if population.varies:
        # With z = centre + spread·e and e ~ N(0, I), the expectation is a normal integral over e.
        forms = mapped(joined, centres, spreads[:, None])
        of_components = log_integrals(forms + standard_form(means.shape[1]))
    else:
        sloped = np.einsum("bti,tij->btj", centres, joined[:, :-1]) + joined[:, -1]
        squares = np.einsum("btj,btj->bt", sloped[..., :-1], centres) + sloped[..., -1]
        of_components = -0.5 * squares
    return np.logaddexp.reduceat(of_components, first, axis=1)


def corrections(
    population: Population,
    fits: Sequence[LikelihoodFit],
    covariates: FloatArray,
    values: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """What the draws of the tests add to log-likelihoods at S points, and errors, (S, n_tests).

    Logarithms of the mean of r and their standard errors; arguments as of :func:`log_likelihoods`.
    """
    means, slopes, spreads = population.split(values)
    # Where the draws are few, what two fits differ by is what is unknown.
    of_best, of_second = (
        log_likelihoods(population, components, covariates, values)
        for components in ([fit.components for fit in fits], [fit.second for fit in fits])
    )
    columns = []
    for fit, covariate, differences in zip(fits, covariates, (of_second - of_best).T, strict=True):
        log_weights = _log_densities(fit.z, means + slopes * covariate, spreads)
        log_weights += 0.5 * np.einsum("nk,nk->n", fit.z, fit.z) - fit.log_ratios
        weights = np.exp(log_weights - logsumexp(log_weights, axis=1, keepdims=True))
        ratios = np.exp(fit.log_ratios)
        squares = (ratios - 1.0) ** 2
        # The weighted draws alone would underestimate it where they are few.
        variances = np.maximum(weights @ squares, squares.mean()) + differences**2
        errors = np.sqrt(variances * np.einsum("sn,sn->s", weights, weights))
        columns.append((np.log(weights @ ratios), errors))
    logs, errors = (np.stack(each, axis=1) for each in zip(*columns, strict=True))
    return logs, errors


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
class RankedPopulation:
    """One row of the ranking of populations."""

    population: Population
    log_evidence: float  # in nats, of all tests together
    error: float  # standard error of the log evidence
    draws_error: float  # the part of it that the draws of the tests leave
    # (n_draws, n_parameters), of the posterior of the population's parameters, in standard-normal
    # coordinates of the parameters of the model class.
    draws: FloatArray
    failed_checks: tuple[str, ...]  # a sentence each
    probability: float = 1.0  # among the populations compared, with equal prior weights
    log_bayes_factor: float = 0.0  # log evidence less that of the best one
    log_bayes_factor_error: float = 0.0
    against: str = "best"  # the evidence against it, in words

    @property
    def name(self) -> str:
        return self.population.name


def sample_population(
    population: Population,
    fits: Sequence[LikelihoodFit],
    covariates: FloatArray,
    seed: int,
    settings: SamplingSettings,
    progress: StepProgress,
) -> RankedPopulation:
    """Posterior and evidence of one population, from all tests, as if it were the only one.

    Sampled with the components for likelihoods, then corrected by the draws of the tests. The
    ``fits`` are functions of the parameters that it describes; ``covariates`` (n_tests,) are
    standardised.
    """
    components = [fit.components for fit in fits]

    def log_likelihood(u: FloatArray) -> FloatArray:
        values = values_at(population.parameters, u)
        return log_likelihoods(population, components, covariates, values).sum(axis=1)

    index, n_draws = [seed, population.varies, population.follows], POPULATION_DRAWS
    target = Target(log_likelihood, len(population.parameters))
    result = sample_target(target, np.random.SeedSequence(index), settings, progress)
    failed, rng = [*result.failed_checks], np.random.default_rng(index)
    chosen = rng.permutation(systematic_indices(result.importance.weights, n_draws, rng))
    values = values_at(population.parameters, result.importance.z[chosen])
    logs, errors = corrections(population, fits, covariates, values)
    log_weights = logs.sum(axis=1)
    weights = np.exp(log_weights - log_weights.max())
    largest = float(weights.max() / weights.sum())
    if largest > LARGEST_WEIGHT:
        failed.append(
            "the draws of the tests change the posterior of the population so much that one of "
            f"{n_draws} draws carries {100 * largest:.0f} % of it"
        )
    error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n_draws))
    # Of the sum over the tests, averaged over the points.
    draws_error = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    log_evidence = result.evidence.log_evidence + float(log_weights.max() + np.log(weights.mean()))
    error = math.hypot(result.evidence.error, error, draws_error)
    draws = values[rng.permutation(systematic_indices(weights, n_draws, rng))]
    return RankedPopulation(population, log_evidence, error, draws_error, draws, tuple(failed))
