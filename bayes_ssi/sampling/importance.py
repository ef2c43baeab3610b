"""Mixture importance sampling: the quoted evidence p(data | model class), in log space."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.diagnostics import PARETO_K_LIMIT, pareto_shape
from bayes_ssi.sampling.ensembles import Ensemble
from bayes_ssi.sampling.estimates import Estimate
from bayes_ssi.sampling.mixture import StudentMixture
from bayes_ssi.sampling.target import Target, log_standard_normal

__all__ = [
    "ImportanceSample",
    "extended",
    "first_draws",
    "halves",
    "refined",
    "resampled",
]

PRIOR_SHARE = 0.02
FIRST_BATCH = 3000
LEAST_STRATUM = 20
MAX_DRAWS = 200_000
# Equally weighted draws that are made of one importance sample.
MAX_RESAMPLED = 5000
# No draw should carry more of the evidence than this.
LARGEST_WEIGHT = 0.02
MAX_ADDED_COMPONENTS = 12
# Share of the draws whose spread gives an added component its shape.
NEIGHBOURHOOD = 0.05


@dataclass(frozen=True, eq=False)
class ImportanceSample:
    """Draws from a mixture, weighted to the posterior.

    Attributes:
        mixture: what the draws come from.
        z: (n, d), standard-normal coordinates.
        log_likelihoods: (n,).
        log_proposals: (n,), log density of the mixture.
        strata: (n,), which component each draw came from.
    """

    mixture: StudentMixture
    z: FloatArray
    log_likelihoods: FloatArray
    log_proposals: FloatArray
    strata: NDArray[np.intp]

    @cached_property
    def log_weights(self) -> FloatArray:
        """log(likelihood · prior / proposal), (n,)."""
        return self.log_likelihoods + log_standard_normal(self.z) - self.log_proposals

    @cached_property
    def weights(self) -> FloatArray:
        """Weights (n,) that add up to one."""
        log_weights = self.log_weights
        return np.exp(log_weights - logsumexp(log_weights))

    @property
    def effective_sample_size(self) -> float:
        """1 / Σ w² of the normalised weights."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def effective_share(self) -> float:
        """The effective sample size as a share of the draws."""
        return self.effective_sample_size / len(self.z)

    @property
    def pareto_k(self) -> float:
        """Shape of the generalised Pareto distribution of the largest weights.

        The mean of weights has a finite variance where it is below one half; beyond 0.7 neither
        the mean nor its error can be trusted (Vehtari et al. 2024).
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
        # A handful of draws say nothing of their stratum's variance: these strata count as one.
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


def first_draws(
    target: Target,
    mixture: StudentMixture,
    rng: np.random.Generator,
    batch: int = FIRST_BATCH,
    prior_share: float = PRIOR_SHARE,
) -> ImportanceSample:
    """``batch`` draws from ``mixture``, to which the defensive prior component is added."""
    return _draw(target, mixture.with_prior_component(prior_share), batch, rng)


def refined(
    target: Target,
    sample: ImportanceSample,
    wanted_error: float,
    rng: np.random.Generator,
    batch: int = FIRST_BATCH,
    least_share: float = 0.0,
    max_draws: int = MAX_DRAWS,
) -> ImportanceSample:
    """``sample`` and more draws, until the log evidence's error is ``wanted_error``.

    The number of draws is set from the error of those that there are. Where the weights have a
    heavy tail, one of them is heavy by itself, or the effective sample size is a smaller share
    than ``least_share``, components are added at the heaviest draws first (incremental mixture
    importance sampling, Raftery and Bao 2010). At least ``batch`` draws are made at once, and a
    sixth of them from a new component.
    """
    added = 0
    while True:
        poor = (
            sample.pareto_k > PARETO_K_LIMIT
            or sample.weights.max() > LARGEST_WEIGHT
            or sample.effective_share < least_share
        )
        if poor and added < MAX_ADDED_COMPONENTS:
            sample = _with_component(target, sample, batch // 6, rng)
            added += 1
            continue
        if not sample.estimate.error > wanted_error or len(sample.z) >= max_draws:
            return sample
        wanted = (sample.estimate.error / wanted_error) ** 2
        factor = min(wanted, max_draws / len(sample.z))
        sample = extended(target, sample, factor, rng, batch)


def extended(
    target: Target,
    sample: ImportanceSample,
    factor: float,
    rng: np.random.Generator,
    batch: int = FIRST_BATCH,
) -> ImportanceSample:
    """``sample`` with about ``factor`` times as many draws, at most four times."""
    n = len(sample.z)
    more = int(min(1.1 * factor * n, 4.0 * n, MAX_DRAWS)) - n
    return _concatenated(sample, _draw(target, sample.mixture, max(more, batch), rng))


def _draw(
    target: Target, mixture: StudentMixture, n: int, rng: np.random.Generator
) -> ImportanceSample:
    expected = n * mixture.all_weights
    counts = np.floor(expected).astype(np.intp)
    # The fractions left over are drawn systematically: every count is within one of its mean.
    ladder = np.arange(n - counts.sum()) + rng.random()
    counts += np.bincount(
        np.searchsorted(np.cumsum(expected - counts), ladder).clip(max=len(counts) - 1),
        minlength=len(counts),
    )
    z = mixture.draw(counts, rng)
    strata = np.repeat(np.arange(len(counts)), counts)
    return ImportanceSample(mixture, z, target.log_likelihood(z), mixture.log_pdf(z), strata)


def _with_component(
    target: Target, sample: ImportanceSample, least: int, rng: np.random.Generator
) -> ImportanceSample:
    """The sample with one more component, and draws from it, where its heaviest draw is.

    All draws are weighted anew against the larger mixture, in which every component counts by
    the draws that it gave.
    """
    old, n = sample.mixture, len(sample.z)
    centre = sample.z[sample.weights.argmax()]
    weights = 0.5 * (sample.weights + 1.0 / n)
    spread = np.sqrt(np.maximum(sample.weights @ (sample.z - centre) ** 2, 1e-300))
    distances = (((sample.z - centre) / spread) ** 2).sum(1)
    near = np.argsort(distances)[: max(int(NEIGHBOURHOOD * n), 2 * sample.z.shape[1] + 1)]
    away = sample.z[near] - centre
    covariance = (away * weights[near, None]).T @ away / weights[near].sum()
    floor = 1e-6 * max(float(np.trace(covariance)) / len(centre), 1e-300)
    component = StudentMixture(
        np.ones(1),
        centre[None],
        np.linalg.cholesky(covariance + floor * np.eye(len(centre)))[None],
        np.full(1, 5.0),
    )
    more = max(least, n // 6)
    mixture = old.mixed_with(component, more / (n + more))
    mixture = replace(mixture, prior_share=old.prior_share * n / (n + more))
    drawn = component.draw(np.array([more, 0]), rng)
    z = np.concatenate([sample.z, drawn])
    # Strata are numbered as the components are, the defensive one last.
    last = old.n_components
    strata = np.where(sample.strata == last, last + 1, sample.strata)
    return ImportanceSample(
        mixture,
        z,
        np.concatenate([sample.log_likelihoods, target.log_likelihood(drawn)]),
        mixture.log_pdf(z),
        np.concatenate([strata, np.full(more, last)]),
    )


def _concatenated(a: ImportanceSample, b: ImportanceSample) -> ImportanceSample:
    return ImportanceSample(
        a.mixture,
        np.concatenate([a.z, b.z]),
        np.concatenate([a.log_likelihoods, b.log_likelihoods]),
        np.concatenate([a.log_proposals, b.log_proposals]),
        np.concatenate([a.strata, b.strata]),
    )


def resampled(sample: ImportanceSample, rng: np.random.Generator) -> Ensemble:
    """As many equally weighted posterior draws as there are importance draws, in random order.

    At most ``MAX_RESAMPLED``. What takes the place of an autocorrelation time is how many of them
    are worth one independent draw.
    """
    n = min(len(sample.z), MAX_RESAMPLED)
    cumulative = np.cumsum(sample.weights)
    ladder = (np.arange(n) + rng.random()) / n
    chosen = rng.permutation(np.searchsorted(cumulative / cumulative[-1], ladder))
    positions = sample.z[chosen][:, None]
    log_posteriors: FloatArray = sample.log_likelihoods + log_standard_normal(sample.z)
    return Ensemble(
        positions=positions,
        log_posteriors=log_posteriors[chosen][:, None],
        autocorrelation_times=np.full(
            positions.shape[-1], max(1.0, n / sample.effective_sample_size)
        ),
        acceptance=len(np.unique(chosen)) / n,
    )


def halves(sample: ImportanceSample, rng: np.random.Generator) -> list[ImportanceSample]:
    """The sample's draws in two halves, at random."""
    parts = np.array_split(rng.permutation(len(sample.z)), 2)
    return [
        ImportanceSample(
            sample.mixture,
            sample.z[part],
            sample.log_likelihoods[part],
            sample.log_proposals[part],
            sample.strata[part],
        )
        for part in parts
    ]
