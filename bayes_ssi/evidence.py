"""The evidence p(data | model class): mixture importance sampling, and what checks it.

* Importance sampling from a Student-t mixture fitted to the draws is the quoted value.
* Bridge sampling (Meng and Wong 1996) and the tempered start's own estimate are the checks.
* Laplace's approximation, summed over maxima, is a quick look.

All is in log space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.mixture import StudentMixture
from bayes_ssi.priors import FloatArray
from bayes_ssi.production import Ensemble, autocorrelation_times
from bayes_ssi.target import Target, log_standard_normal
from bayes_ssi.tempering import TemperedStart

__all__ = [
    "Estimate",
    "ImportanceSample",
    "bridge_sampling",
    "importance_sampling",
    "tempered_estimate",
]

PRIOR_SHARE = 0.02
FIRST_BATCH = 3000
LEAST_STRATUM = 20
MAX_DRAWS = 200_000


@dataclass(frozen=True)
class Estimate:
    """A log evidence with its standard error, in nats."""

    log_evidence: float
    error: float


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
    def estimate(self) -> Estimate:
        """The log of the mean weight, its error by strata.

        Every component gives draws in proportion to its weight, so what varies is only the mean
        of each stratum: Var = Σ n_k var_k / n².
        """
        weights = self.weights
        counts = np.bincount(self.strata)
        # A handful of draws say nothing of their stratum's variance: these strata count as one.
        strata = np.where(counts[self.strata] < LEAST_STRATUM, -1, self.strata)
        each = [weights[strata == k] for k in np.unique(strata)]
        variance = sum(len(own) * own.var(ddof=1) for own in each if len(own) > 1)
        log_mean = float(logsumexp(self.log_weights)) - math.log(len(weights))
        return Estimate(log_mean, float(np.sqrt(variance)))

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
        return np.sqrt(((weights * (member - shares[:, None])) ** 2).sum(1))


def importance_sampling(
    target: Target, mixture: StudentMixture, wanted_error: float, rng: np.random.Generator
) -> ImportanceSample:
    """Draw from ``mixture`` until the log evidence's error is ``wanted_error``.

    The number of draws is set from the error of a first batch, which is kept.
    """
    mixture = mixture.defended(PRIOR_SHARE)
    sample = _draw(target, mixture, FIRST_BATCH, rng)
    while sample.estimate.error > wanted_error and len(sample.z) < MAX_DRAWS:
        needed = len(sample.z) * (sample.estimate.error / wanted_error) ** 2
        more = int(min(1.1 * needed, 4.0 * len(sample.z), MAX_DRAWS)) - len(sample.z)
        sample = _concatenated(sample, _draw(target, mixture, max(more, FIRST_BATCH), rng))
    return sample


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


def _concatenated(a: ImportanceSample, b: ImportanceSample) -> ImportanceSample:
    return ImportanceSample(
        a.mixture,
        np.concatenate([a.z, b.z]),
        np.concatenate([a.log_likelihoods, b.log_likelihoods]),
        np.concatenate([a.log_proposals, b.log_proposals]),
        np.concatenate([a.strata, b.strata]),
    )


def bridge_sampling(ensemble: Ensemble, sample: ImportanceSample) -> Estimate:
    """Bridge sampling between the posterior draws of an ensemble and those from a mixture.

    The optimal bridge of Meng and Wong (1996); error after Frühwirth-Schnatter (2004), with the
    chain's autocorrelation.

    Args:
        ensemble: posterior draws.
        sample: draws from a mixture fitted without ``ensemble``; their likelihoods serve a
            second time.
    """
    log_proposals = sample.mixture.log_pdf(ensemble.draws)
    posterior = ensemble.log_posteriors - log_proposals.reshape(ensemble.log_posteriors.shape)
    proposal = sample.log_weights
    n_posterior = posterior.size / float(ensemble.autocorrelation_times.max())
    log_s1 = math.log(n_posterior / (n_posterior + proposal.size))
    log_s2 = math.log(proposal.size / (n_posterior + proposal.size))
    log_evidence = sample.estimate.log_evidence
    for _ in range(200):
        from_proposal = proposal - np.logaddexp(log_s1 + proposal, log_s2 + log_evidence)
        from_posterior = -np.logaddexp(log_s1 + posterior, log_s2 + log_evidence)
        updated = float(
            logsumexp(from_proposal)
            - math.log(proposal.size)
            - logsumexp(from_posterior)
            + math.log(posterior.size)
        )
        settled = abs(updated - log_evidence) < 1e-9
        log_evidence = updated
        if settled:
            break
    f1, f2 = (
        np.exp(from_proposal - from_proposal.max()),
        np.exp(from_posterior - from_posterior.max()),
    )
    time = float(autocorrelation_times(f2[..., None])[0])
    relative_variance = f1.var() / (f1.mean() ** 2 * f1.size) + time * f2.var() / (
        f2.mean() ** 2 * f2.size
    )
    return Estimate(log_evidence, float(np.sqrt(relative_variance)))


def tempered_estimate(starts: Sequence[TemperedStart]) -> Estimate:
    """The tempered starts' evidence, averaged, with the larger of its two errors.

    One error follows from the weights of every stage and leaves out what the stages share; the
    other is the scatter of the starts.
    """
    each = np.array([start.log_evidence for start in starts])
    log_evidence = float(logsumexp(each)) - math.log(len(each))
    by_weights = math.sqrt(sum(s.log_evidence_error**2 for s in starts)) / len(starts)
    by_scatter = float(each.std(ddof=1)) / math.sqrt(len(each)) if len(each) > 1 else 0.0
    return Estimate(log_evidence, max(by_weights, by_scatter))
