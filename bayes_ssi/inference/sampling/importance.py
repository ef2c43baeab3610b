"""Mixture importance sampling: weighted posterior draws, whose mean weight is the evidence.

Bridge sampling, which checks it, joins those draws with others from the posterior.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray, IntArray, systematic_indices
from bayes_ssi.foundations.arviz_functions import mcse_mean, pareto_k
from bayes_ssi.inference.sampling.compression import Compression
from bayes_ssi.inference.sampling.diagnostics import Estimate, EvidenceEstimate
from bayes_ssi.inference.sampling.ensembles import ChainStatistics, Ensemble, Walkers
from bayes_ssi.inference.sampling.mixture import HEAVY_TAILS, StudentMixture
from bayes_ssi.inference.sampling.proposals import Drawn, Independence
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

# With a heavier tail of the weights, the error of the estimate cannot be trusted (Vehtari et
# al. 2024).
PARETO_K_LIMIT = 0.7
# Largest share of the evidence that one draw should carry: it alone would move the log evidence
# by twice the default wanted error.
LARGEST_WEIGHT = 0.02
# Components are added where others show that a share of the posterior is missing which is this
# multiple of the wanted error: what chains and particles show of a ridge's end is less than it has.
LEAST_MISSING = 0.1
# Each component adds a sixth to the draws, all of them together a factor of six. One that shows
# what lies beyond the end of a ridge, mostly nothing, adds a thirtieth.
MOST_ADDED = 12
ADDED_DRAWS = 1 / 6
ADDED_DRAWS_AT_AN_END = 1 / 30
# Most posterior draws resampled from one sample, to which mixtures are fitted.
MOST_RESAMPLED = 5000
# Wanted standard error of the regions' shares, relative to that of the log evidence.
SHARE_ERROR = 0.3

# Their draws (n, d), and the log of likelihood times prior density of each.
ScoredDraws = Ensemble | Compression


@dataclass(frozen=True, eq=False)
class ImportanceSample:
    """Draws from a mixture, weighted to the posterior."""

    mixture: StudentMixture
    z: FloatArray  # (n, d), standard-normal coordinates
    log_likelihoods: FloatArray  # (n,)
    log_proposals: FloatArray  # (n,), log density of the mixture
    strata: IntArray  # (n,), the component that each draw came from; the prior's is the last

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
        """Normalised weights, (n,)."""
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

    @cached_property
    def pareto_k(self) -> float:
        """Shape of the generalised Pareto distribution of the largest weights, by arviz.

        Below one half, the mean of the weights has a finite variance.
        """
        return pareto_k(self.log_weights)

    @property
    def estimate(self) -> Estimate:
        """The log of the mean weight, its error by strata.

        Every component gives draws in proportion to its weight, so only the mean of each stratum
        varies: Var = Σ n_k var_k / n².
        """
        log_mean = float(logsumexp(self.log_weights)) - math.log(len(self.weights))
        return Estimate(log_mean, self._error_of_sum(self.weights))

    def _error_of_sum(self, terms: FloatArray) -> float:
        """Standard error of a sum with one term (n,) per draw, by strata."""
        counts = np.bincount(self.strata)
        # Strata of fewer than 20 draws, too few to know their variance, count as one.
        strata = np.where(counts[self.strata] < 20, -1, self.strata)
        parts = [terms[strata == k] for k in np.unique(strata)]
        return math.sqrt(sum(len(part) * part.var(ddof=1) for part in parts if len(part) > 1))

    @property
    def log_likelihood_mean(self) -> float:
        return float(self.weights @ np.where(self.weights > 0, self.log_likelihoods, 0.0))

    def share_errors(self, groups: IntArray, n_groups: int) -> FloatArray:
        """Standard errors (n_groups,) of the posterior's shares in ``groups`` (n,)."""
        weights = self.weights
        shares = np.bincount(groups, weights, minlength=n_groups)
        member = groups == np.arange(n_groups)[:, None]
        terms = weights * (member - shares[:, None])
        return np.array([self._error_of_sum(group_terms) for group_terms in terms])

    def share_beyond(self, others: Sequence[ScoredDraws]) -> float:
        """The largest share of other posterior draws that weigh more than any of these draws.

        What such draws stand for, as the end of a ridge or a far tail, is missing in the evidence.
        Of importance draws whose weights have a finite variance, hardly any share is.
        """
        log_pdf = self.mixture.log_pdf
        return self._share_beyond([o.log_posteriors.ravel() - log_pdf(o.draws) for o in others])

    def _share_beyond(self, log_weights: Sequence[FloatArray]) -> float:
        # Chains begin at importance draws: one of both weighs the same but for rounding.
        heaviest = self.log_weights.max() + 1e-6
        return max((float(np.mean(of_other > heaviest)) for of_other in log_weights), default=0.0)

    def split(self, n: int, rng: np.random.Generator) -> "list[ImportanceSample]":
        """The draws in ``n`` equal parts, in random order."""
        parts, arrays = np.array_split(rng.permutation(len(self.z)), n), self.arrays.items()
        return [replace(self, **{name: each[part] for name, each in arrays}) for part in parts]

    @property
    def arrays(self) -> dict[str, Any]:
        """Name → what there is of every draw: all fields but the mixture."""
        return {each.name: getattr(self, each.name) for each in fields(self)[1:]}

    def resampled(self, rng: np.random.Generator) -> Walkers:
        """As many equally weighted posterior draws as there are importance draws, shuffled.

        A few thousand at most.
        """
        n = min(len(self.z), MOST_RESAMPLED)
        chosen = rng.permutation(systematic_indices(self.weights, n, rng))
        return Walkers(self.z[chosen], self.log_posteriors[chosen])

    @property
    def _drawn(self) -> Drawn:
        return Drawn(self.z, self.log_posteriors, self.log_likelihoods, self.log_proposals)


@dataclass(frozen=True)
class ImportanceSampler:
    """Draws importance samples of one target."""

    target: Target
    rng: np.random.Generator
    batch: int = 3000
    # Weight of the prior N(0, I) in every mixture. It bounds the importance weights and shows what
    # the other components miss, but wastes nearly all of its draws.
    prior_share: float = 0.02
    # Components are added until the effective sample size is this share of the draws.
    least_efficiency: float = 0.0
    max_draws: int = 200_000

    def sample(self, mixture: StudentMixture) -> ImportanceSample:
        """A batch of draws from ``mixture``, to which the prior component is added."""
        return self._draw(mixture.with_prior_component(self.prior_share), self.batch)

    def refined(
        self, sample: ImportanceSample, wanted_error: float, others: Sequence[ScoredDraws] = ()
    ) -> ImportanceSample:
        """``sample`` and more draws, until the log evidence's error is ``wanted_error``.

        Where the weights have a heavy tail, a single one is heavy, or the efficiency is too low,
        components are first added at the heaviest draws (incremental mixture importance sampling,
        Raftery and Bao 2010), or at the heaviest of ``others`` where these weigh more: a walker or
        particle that stays where no importance draw goes may be stuck, or stand for a part of the
        posterior, which the draws from such a component decide. Then all draws are new.
        """
        least_missing = LEAST_MISSING * wanted_error
        left_to_add = MOST_ADDED
        draws = [other.draws for other in others]
        heights = [other.log_posteriors.ravel() for other in others]
        while True:
            n_before, left_before = len(sample.z), left_to_add
            log_pdfs = [sample.mixture.log_pdf(z) for z in draws] if left_to_add else []
            while left_to_add:
                log_weights = [h - log_pdf for h, log_pdf in zip(heights, log_pdfs, strict=True)]
                if (
                    sample.pareto_k > PARETO_K_LIMIT
                    or sample.weights.max() > LARGEST_WEIGHT
                    or sample.efficiency < self.least_efficiency
                ):
                    centre = sample.z[sample.weights.argmax()]
                elif sample._share_beyond(log_weights) > least_missing:
                    centre = np.concatenate(draws)[np.concatenate(log_weights).argmax()]
                else:
                    break
                sample = self._with_component(sample, centre)
                log_pdfs = list(map(sample.mixture.log_pdf_with_last, draws, log_pdfs))
                left_to_add -= 1
            if left_to_add < left_before:
                sample = self.renewed(sample, n_before)
            elif sample.estimate.error > wanted_error and len(sample.z) < self.max_draws:
                sample = self.extended(sample, (sample.estimate.error / wanted_error) ** 2)
            else:
                return sample

    def beyond_ends(self, sample: ImportanceSample, wanted_error: float) -> ImportanceSample:
        """``sample`` with components at both ends of the posterior's longest axis.

        What a mixture does not propose, as the end of a thin curved ridge beyond the draws that it
        was fitted to, its own draws cannot show. Components are added at the outermost draws, and
        at those from them, until what lies beyond is negligible.
        """
        for sign in (1.0, -1.0):
            for _ in range(MOST_ADDED // 2):
                mean = sample.weights @ sample.z
                away = (sample.z - mean) * np.sqrt(sample.weights)[:, None]
                axis = np.linalg.eigh(away.T @ away)[1][:, -1]
                axis = sign * axis * np.sign(axis[np.abs(axis).argmax()])
                typical, _ = sample.typical_draws
                end = typical[(typical @ axis).argmax()]
                sample = self._with_component(sample, end, ADDED_DRAWS_AT_AN_END)
                beyond = sample.weights @ (sample.z @ axis > end @ axis)
                if beyond < LEAST_MISSING * wanted_error:
                    break
        return sample

    def renewed(self, sample: ImportanceSample, n: int) -> ImportanceSample:
        """``n`` new draws from the mixture of ``sample``, half of it by posterior shares.

        A component that is added at a draw, with the spread of those near it, is denser at them
        than at others, and takes most of their weight: the draws to which a mixture owes components
        make the evidence too low, the more so the more dimensions there are.
        """
        mixture = sample.mixture
        by_share = mixture.reweighted(sample.z, sample.weights)
        by_share = by_share.with_prior_component(mixture.prior_share)
        weights = 0.5 * (mixture.weights + by_share.weights)
        return self._draw(replace(mixture, weights=weights), n)

    def as_proposals(
        self, sample: ImportanceSample, share: float, added: list[ImportanceSample]
    ) -> Independence:
        """The draws as independence proposals of an ensemble, which makes ``share`` of its steps.

        What it proposes beyond these is drawn from the same mixture, and ``added`` to the list.
        """

        def draw(n: int) -> Drawn:
            added.append(self._draw(sample.mixture, n))
            return added[-1].split(1, self.rng)[0]._drawn

        return Independence(sample.mixture, share, draw, sample._drawn)

    def extended(self, sample: ImportanceSample, factor: float) -> ImportanceSample:
        """``sample`` with about ``factor`` times as many draws, at most four times."""
        n = len(sample.z)
        wanted = int(min(1.1 * factor * n, 4.0 * n, self.max_draws))
        return joined_samples([sample, self._draw(sample.mixture, max(wanted - n, self.batch))])

    def _draw(self, mixture: StudentMixture, n: int) -> ImportanceSample:
        """``n`` draws, of every component in proportion to its weight."""
        expected = n * mixture.all_weights
        counts = np.floor(expected).astype(np.intp)
        left_over = systematic_indices(expected - counts, n - int(counts.sum()), self.rng)
        counts += np.bincount(left_over, minlength=len(counts))
        z = mixture.draw(counts, self.rng)
        strata, values = np.repeat(np.arange(len(counts)), counts), self.target.log_likelihood(z)
        return ImportanceSample(mixture, z, values, mixture.log_pdf(z), strata)

    def _with_component(
        self, sample: ImportanceSample, centre: FloatArray, added: float = ADDED_DRAWS
    ) -> ImportanceSample:
        """The sample with one more component, and draws from it, at ``centre`` (d,).

        All draws are reweighted by the larger mixture, in which every component has the share of
        the draws that it gave.
        """
        n = len(sample.z)
        more = round(added * max(self.batch, n))
        component = _around(centre, sample)
        mixture = sample.mixture.mixed_with(component, more / (n + more))
        mixture = replace(mixture, prior_share=sample.mixture.prior_share * n / (n + more))
        drawn = component.draw(np.array([more, 0]), self.rng)
        before = mixture.log_pdf_with_last(sample.z, sample.log_proposals)
        last = sample.mixture.n_components
        # Strata are numbered as the components are, the prior last.
        strata = np.where(sample.strata == last, last + 1, sample.strata)
        return ImportanceSample(
            mixture,
            np.concatenate([sample.z, drawn]),
            np.concatenate([sample.log_likelihoods, self.target.log_likelihood(drawn)]),
            np.concatenate([before, mixture.log_pdf(drawn)]),
            np.concatenate([strata, np.full(more, last)]),
        )


def joined_samples(samples: Sequence[ImportanceSample]) -> ImportanceSample:
    """Draws of one mixture as one sample."""
    parts = zip(*(sample.arrays.values() for sample in samples), strict=True)
    return ImportanceSample(samples[0].mixture, *map(np.concatenate, parts))


def _around(centre: FloatArray, sample: ImportanceSample) -> StudentMixture:
    """One component at ``centre`` (d,) with the spread of the draws near it."""
    n, d = sample.z.shape
    weights = 0.5 * (sample.weights + 1.0 / n)
    spread = np.sqrt(np.maximum(sample.weights @ (sample.z - centre) ** 2, 1e-300))
    distances = (((sample.z - centre) / spread) ** 2).sum(1)
    near = np.argsort(distances)[: max(int(0.05 * n), 2 * d + 1)]
    away = sample.z[near] - centre
    covariance = (away * weights[near, None]).T @ away / weights[near].sum()
    floor = 1e-6 * max(float(np.trace(covariance)) / d, 1e-300)
    cholesky = np.linalg.cholesky(covariance + floor * np.eye(d))
    return StudentMixture(np.ones(1), centre[None], cholesky[None], np.full(1, HEAVY_TAILS))


def bridge_sampling(ensemble: Ensemble, sample: ImportanceSample) -> EvidenceEstimate:
    """Bridge sampling between the draws of an ensemble and importance draws that it did not use.

    The optimal bridge of Meng and Wong (1996); error after Frühwirth-Schnatter (2004), with the
    chains' effective sample size.
    """
    chains = ensemble.chains
    log_proposals = sample.mixture.log_pdf(chains.reshape(-1, chains.shape[-1]))
    posterior = ensemble.log_posteriors.T - log_proposals.reshape(chains.shape[:2])
    proposal = sample.log_weights
    n_posterior = posterior.size / ChainStatistics(chains).slowness
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
    f1, f2 = (np.exp(terms - terms.max()) for terms in (from_proposal, from_posterior))
    variance = f1.var() / (f1.mean() ** 2 * f1.size)
    variance += (float(mcse_mean(f2[..., None])[0]) / f2.mean()) ** 2
    return EvidenceEstimate("bridge sampling", log_evidence, float(np.sqrt(variance)))
