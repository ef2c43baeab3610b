"""Mixture importance sampling, with components added where the mixture falls short."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayes_ssi.sampling.diagnostics import LARGEST_WEIGHT, PARETO_K_LIMIT
from bayes_ssi.sampling.importance import ImportanceSample
from bayes_ssi.sampling.mixture import HEAVY_TAILS, StudentMixture
from bayes_ssi.sampling.resampling import systematic_indices
from bayes_ssi.sampling.target import Target

__all__ = ["ImportanceSampler"]

MAX_ADDED_COMPONENTS = 12
# Share of the draws, those nearest to the heaviest one, whose spread gives a component its shape.
NEIGHBOURHOOD = 0.05


@dataclass(frozen=True)
class ImportanceSampler:
    """Draws importance samples of one target.

    Attributes:
        target: whose likelihood weights the draws.
        rng: everything random follows from it.
        batch: draws made at once, of which a sixth go to a component that is added.
        prior_share: weight of the prior N(0, I) in every mixture. It bounds the importance
            weights, and shows what the other components miss; nearly all of its draws are lost.
        least_efficiency: components are added until the effective sample size is this share of
            the draws.
        max_draws: of one sample.
    """

    target: Target
    rng: np.random.Generator
    batch: int = 3000
    prior_share: float = 0.02
    least_efficiency: float = 0.0
    max_draws: int = 200_000

    def sample(self, mixture: StudentMixture) -> ImportanceSample:
        """A batch of draws from ``mixture``, to which the prior component is added."""
        return self._draw(mixture.with_prior_component(self.prior_share), self.batch)

    def refined(self, sample: ImportanceSample, wanted_error: float) -> ImportanceSample:
        """``sample`` and more draws, until the log evidence's error is ``wanted_error``.

        The number of draws follows from the error of those that there are. Where the weights have
        a heavy tail, a single one is heavy, or the efficiency is too low, components are first
        added at the heaviest draws (incremental mixture importance sampling, Raftery and Bao
        2010).
        """
        left_to_add = MAX_ADDED_COMPONENTS
        while True:
            if left_to_add and self._is_poor(sample):
                sample = self._with_component(sample)
                left_to_add -= 1
            elif sample.estimate.error > wanted_error and len(sample.z) < self.max_draws:
                sample = self.extended(sample, (sample.estimate.error / wanted_error) ** 2)
            else:
                return sample

    def extended(self, sample: ImportanceSample, factor: float) -> ImportanceSample:
        """``sample`` with about ``factor`` times as many draws, at most four times."""
        n = len(sample.z)
        wanted = int(min(1.1 * factor * n, 4.0 * n, self.max_draws))
        more = self._draw(sample.mixture, max(wanted - n, self.batch))
        return ImportanceSample(
            sample.mixture,
            np.concatenate([sample.z, more.z]),
            np.concatenate([sample.log_likelihoods, more.log_likelihoods]),
            np.concatenate([sample.log_proposals, more.log_proposals]),
            np.concatenate([sample.strata, more.strata]),
        )

    def _is_poor(self, sample: ImportanceSample) -> bool:
        return (
            sample.pareto_k > PARETO_K_LIMIT
            or sample.weights.max() > LARGEST_WEIGHT
            or sample.efficiency < self.least_efficiency
        )

    def _draw(self, mixture: StudentMixture, n: int) -> ImportanceSample:
        """``n`` draws, of every component in proportion to its weight."""
        expected = n * mixture.all_weights
        counts = np.floor(expected).astype(np.intp)
        left_over = systematic_indices(expected - counts, n - int(counts.sum()), self.rng)
        counts += np.bincount(left_over, minlength=len(counts))
        z = mixture.draw(counts, self.rng)
        strata = np.repeat(np.arange(len(counts)), counts)
        return ImportanceSample(
            mixture, z, self.target.log_likelihood(z), mixture.log_pdf(z), strata
        )

    def _with_component(self, sample: ImportanceSample) -> ImportanceSample:
        """The sample with one more component, and draws from it, at its heaviest draw.

        All draws are weighted anew against the larger mixture, in which every component counts by
        the draws that it gave.
        """
        n = len(sample.z)
        more = max(self.batch, n) // 6
        component = _around_heaviest_draw(sample)
        mixture = sample.mixture.mixed_with(component, more / (n + more))
        mixture = replace(mixture, prior_share=sample.mixture.prior_share * n / (n + more))
        drawn = component.draw(np.array([more, 0]), self.rng)
        z = np.concatenate([sample.z, drawn])
        last = sample.mixture.n_components
        # Strata are numbered as the components are, the prior last.
        strata = np.where(sample.strata == last, last + 1, sample.strata)
        return ImportanceSample(
            mixture,
            z,
            np.concatenate([sample.log_likelihoods, self.target.log_likelihood(drawn)]),
            mixture.log_pdf(z),
            np.concatenate([strata, np.full(more, last)]),
        )


def _around_heaviest_draw(sample: ImportanceSample) -> StudentMixture:
    """One component with the spread of the heaviest draw's neighbours."""
    n, d = sample.z.shape
    centre = sample.z[sample.weights.argmax()]
    weights = 0.5 * (sample.weights + 1.0 / n)
    spread = np.sqrt(np.maximum(sample.weights @ (sample.z - centre) ** 2, 1e-300))
    distances = (((sample.z - centre) / spread) ** 2).sum(1)
    near = np.argsort(distances)[: max(int(NEIGHBOURHOOD * n), 2 * d + 1)]
    away = sample.z[near] - centre
    covariance = (away * weights[near, None]).T @ away / weights[near].sum()
    floor = 1e-6 * max(float(np.trace(covariance)) / d, 1e-300)
    cholesky = np.linalg.cholesky(covariance + floor * np.eye(d))
    return StudentMixture(np.ones(1), centre[None], cholesky[None], np.full(1, HEAVY_TAILS))
