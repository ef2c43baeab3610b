"""From a log-likelihood to draws of its posterior and its evidence.

1. Independent searches (``multistart``) find the maxima of the posterior (``maxima``).
2. Importance draws (``importance``) from Laplace's approximation around them, bent along thin
   ridges, with components added where they miss something, give a mixture close to the posterior
   (``mixture``), where the target knows its problem, its searches agree, and enough draws matter.
   Else two independent compressions of the prior (``compression``) carry particles to the regions
   around the maxima and to others, and the mixture is fitted to the particles.
3. Mixture importance sampling gives the evidence and the share of the posterior in each region
   (``regions``).
4. Two independent emcee ensembles (``ensembles``) sample the posterior; the importance
   draws are their proposals (``proposals``), so that both share their evaluations. Where the
   mixture is poor, ensembles come before the importance draws, and show where it should be.
5. Everything that should agree is compared (``result``): bridge sampling with the draws of an
   ensemble, the compressions, the searches, the regions. Disagreement without particles begins
   again with them (2.); with them, it is a warning in the result.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cached_property, partial

import numpy as np
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import BoolArray, FloatArray
from bayes_ssi.inference.sampling.compression import (
    Compression,
    compress_prior,
    compression_estimate,
)
from bayes_ssi.inference.sampling.diagnostics import EvidenceEstimate
from bayes_ssi.inference.sampling.ensembles import (
    Ensemble,
    Walkers,
    run_ensembles,
    thinned_ensembles,
)
from bayes_ssi.inference.sampling.importance import (
    PARETO_K_LIMIT,
    SHARE_ERROR,
    ImportanceSample,
    ImportanceSampler,
    ScoredDraws,
    bridge_sampling,
    joined_samples,
)
from bayes_ssi.inference.sampling.maxima import Maxima, along_ridges, reached
from bayes_ssi.inference.sampling.mixture import DRAWS_PER_DIMENSION, StudentMixture, choose_mixture
from bayes_ssi.inference.sampling.multistart import MultistartSearch, search_maxima
from bayes_ssi.inference.sampling.proposals import Independence, drawn_anew
from bayes_ssi.inference.sampling.regions import VALLEY_DEPTH, Regions, find_regions
from bayes_ssi.inference.sampling.result import SamplingResult
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.inference.sampling.target import Target

# Walkers of one ensemble; the two per dimension that emcee's moves need if that is more. Of
# longer chains, not of more, R-hat falls.
WALKERS = 16
# Of the ensembles' steps, proposed from the mixture; the better it is, the less is left to others.
LEAST_SHARE, MOST_SHARE = 0.7, 0.95
# Most refits of the mixture; they end earlier where a refit raises the efficiency of importance
# draws by less than this factor.
MOST_REFITS = 6
LEAST_IMPROVEMENT = 1.2
MOST_TOO_FEW = 3  # times that components are added and too few draws matter to fit a mixture
# Below this efficiency importance draws are poor: chains are run to their full length, and the
# mixture is finally fitted to their draws.
LEAST_EFFICIENCY = 0.1
# Below this one, a refit makes chains shorter.
GOOD_EFFICIENCY = 0.4
# A fit of a mixture takes as long as some ten thousand evaluations of a small structure: it
# pays only where more batches of importance draws than this would be needed without it.
MOST_BATCHES = 8


def sample_target(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings | None = None,
    progress: StepProgress = lambda _step, _done: None,
) -> SamplingResult:
    """Sample the posterior of ``target`` and estimate its evidence.

    Args:
        target: log-likelihood over coordinates whose prior is N(0, I).
    """
    settings = settings or SamplingSettings()
    # The matrices are small: threads inside BLAS would only wait for one another.
    with threadpool_limits(limits=1, user_api="blas"):
        seeds = seed.spawn(6)
        rng = np.random.default_rng(seeds[5])
        result = _Sampling(target, settings, seeds, rng, progress).result()
        progress("evidence", 1.0)
        return result


@dataclass(frozen=True)
class _Sampling:
    """What the steps of one run share."""

    target: Target
    settings: SamplingSettings
    # Six; of the compressions, the ensembles, the searches and ``rng``.
    seeds: Sequence[np.random.SeedSequence]
    rng: np.random.Generator
    progress: StepProgress

    @cached_property
    def sampler(self) -> ImportanceSampler:
        return ImportanceSampler(self.target, self.rng)

    @property
    def n_walkers(self) -> int:
        return max(WALKERS, 2 * self.target.n_dimensions)

    @cached_property
    def search(self) -> MultistartSearch:
        progress = partial(self.progress, "searches")
        return search_maxima(self.target, self.settings.searches, self.seeds[4], progress)

    @cached_property
    def ridges(self) -> StudentMixture | None:
        return along_ridges(self.target, self.search.maxima, self.rng)

    def result(self) -> SamplingResult:
        result = None
        if self.target.suggest_starts is not None and self.search.converged:
            result = self._from_maxima()
        if result is None or result.failed_checks:
            result = self._from_particles()
        return result

    def _from_maxima(self) -> SamplingResult | None:
        """The result without particles; None where Laplace's approximation does not suffice."""
        around_maxima = self.search.maxima.as_mixture()
        first = self.sampler.sample(around_maxima.widened())
        if not self._serves(first):
            bent = self.ridges and self.sampler.sample(self.ridges.widened())
            if self.ridges and bent and bent.efficiency > first.efficiency:
                around_maxima, first = self.ridges, bent
        enough = DRAWS_PER_DIMENSION * self.target.n_dimensions
        best, fitted_from, n_too_few = first, None, 0
        # Where these miss a part, components are added at the heaviest draws.
        for _ in range(MOST_REFITS):
            if not self._serves(best):
                best = self.sampler.refined(best, math.inf)
            if best.efficiency < GOOD_EFFICIENCY and len(best.z) < 4 * self.sampler.batch:
                best = self.sampler.extended(best, 4.0)  # more draws that matter give a better fit
            halves = best.split(2, self.rng)
            if min(half.effective_sample_size for half in halves) < enough:
                if (n_too_few := n_too_few + 1) == MOST_TOO_FEW:
                    break
                continue
            fitted_from = fitted_from or best
            draws, held_out = (half.resampled(self.rng).positions for half in halves)
            trial = self._fitted(around_maxima, draws, held_out)
            gain = trial.efficiency / best.efficiency
            if gain * LEAST_IMPROVEMENT > 1.0:
                best = trial
            in_vain = gain < LEAST_IMPROVEMENT
            if self._serves(best) and (in_vain or not self._should_refit(best)):
                break
        if fitted_from is None or best.effective_sample_size < 2 * enough:
            return None
        check = EvidenceEstimate("importance draws around maxima", *astuple(fitted_from.estimate))
        starts = [half.resampled(self.rng) for half in best.split(2, self.rng)]
        walkers = [Walkers(*(values[: self.n_walkers] for values in start)) for start in starts]
        return self._sampled(around_maxima, best, walkers, [check])

    def _from_particles(self) -> SamplingResult:
        """The result with compressions of the prior."""
        compressions = compress_prior(
            self.target,
            self.settings.n_particles(self.target.n_dimensions),
            self.search.maxima,
            self.seeds[0:2],
            partial(self.progress, "compression of the prior"),
        )
        around_maxima = self.ridges or self.search.maxima.as_mixture()
        return self._sampled(
            around_maxima,
            self._fitted(around_maxima, *(one.draws for one in compressions)),
            [one.walkers(self.n_walkers, self.rng) for one in compressions],
            [compression_estimate(compressions)],
            compressions,
        )

    def _sampled(
        self,
        around_maxima: StudentMixture,
        trial: ImportanceSample,
        walkers: Sequence[Walkers],
        checks: Sequence[EvidenceEstimate],
        compressions: tuple[Compression, ...] = (),
    ) -> SamplingResult:
        """Ensembles and importance draws.

        Where importance draws serve, they come first, and the ensembles' proposals are taken from
        them. Else the ensembles come first, and show where importance draws should go.
        """
        rngs = [np.random.default_rng(seed) for seed in self.seeds[2:4]]
        run = partial(
            run_ensembles, self.target, walkers, settings=self.settings, rngs=rngs,
            progress=partial(self.progress, "ensembles"),
        )  # fmt: skip
        if self._serves(trial):
            first, regions = self._importance(trial, compressions)
            halves, added = first.split(2, self.rng), [first]
            share = min(LEAST_SHARE + first.efficiency, MOST_SHARE)
            propose = partial(self.sampler.as_proposals, share=share, added=added)
            ensembles, statistics = run(proposals=[propose(half) for half in halves])
            importance, unused = joined_samples(added), halves[0]
            if self._is_doubted(importance, ensembles):
                importance, regions = self._importance(importance, (*ensembles, *compressions))
                unused = importance
        else:
            ensembles, statistics = run(proposals=self._proposals(trial, rngs))
            trial = self._refitted(around_maxima, ensembles, trial)
            importance, regions = self._importance(trial, (*ensembles, *compressions))
            unused = importance
        bridge = bridge_sampling(ensembles[1], unused)
        quoted, chains = thinned_ensembles(self.target, ensembles, statistics, self.settings)
        return SamplingResult(
            search=self.search,
            compressions=compressions,
            ensembles=ensembles,
            quoted=quoted,
            chains=chains,
            importance=importance,
            evidence_checks=(bridge, *checks, self.search.maxima.laplace_estimate),
            regions=regions,
            maxima_of_regions=self._maxima_of(regions, importance, self.search.maxima),
            settings=self.settings,
            n_evaluations=self.target.n_evaluations,
            is_flat=self.target.is_flat,
        )

    def _fitted(
        self, around_maxima: StudentMixture, draws: FloatArray, held_out: FloatArray
    ) -> ImportanceSample:
        """Importance draws from a mixture fitted to ``draws`` and judged by ``held_out``."""
        return self.sampler.sample(self._mixture(around_maxima, draws, self._thinned(held_out)))

    def _refitted(
        self, around_maxima: StudentMixture, ensembles: Sequence[Ensemble], trial: ImportanceSample
    ) -> ImportanceSample:
        """A trial of a mixture fitted to two ensembles; ``trial`` if that suits their draws better.

        Importance draws do not decide: they do not show a region that their mixture lacks.
        """
        draws, held_out = (ensemble.draws for ensemble in ensembles)
        held_out = self._thinned(held_out)
        mixture = self._mixture(around_maxima, draws, held_out)
        mixture = mixture.with_prior_component(self.sampler.prior_share)
        if trial.mixture.log_pdf(held_out).mean() >= mixture.log_pdf(held_out).mean():
            return trial
        return self.sampler.sample(mixture)

    def _mixture(
        self, around_maxima: StudentMixture, draws: FloatArray, held_out: FloatArray
    ) -> StudentMixture:
        """One fitted to draws, and components around the maxima, for regions that these lost.

        These may follow a ridge, or many small regions, better than what draws are enough to fit.
        """
        mixture = choose_mixture(self._thinned(draws), held_out, self.rng).mixed_with(around_maxima)
        return mixture.reweighted(held_out, np.ones(len(held_out))).widened()

    def _thinned(self, draws: FloatArray) -> FloatArray:
        """As many of the draws as a batch of importance draws has, at random."""
        n = self.sampler.batch
        return draws if len(draws) <= n else self.rng.choice(draws, n, replace=False)

    def _proposals(
        self, trial: ImportanceSample, rngs: Sequence[np.random.Generator]
    ) -> list[Independence]:
        """The mixture of ``trial``, each component with its share, as the ensembles' proposal.

        Draws that lost a region leave its component too little weight.
        """
        mixture = trial.mixture.reweighted(trial.z, trial.weights).with_prior_component()
        share = min(LEAST_SHARE + trial.efficiency, MOST_SHARE)
        return [drawn_anew(mixture, share, self.target.log_density, rng) for rng in rngs]

    def _is_doubted(self, sample: ImportanceSample, ensembles: Sequence[Ensemble]) -> bool:
        """Whether chains went where no importance draw is, or the weights have a heavy tail.

        Of the chains' draws, about as many weigh more than the heaviest importance draw by chance
        as that carries of the evidence.
        """
        allowed = SHARE_ERROR * self.settings.log_evidence_error
        missed = sample.share_beyond(ensembles) > max(allowed, float(sample.weights.max()))
        return missed or sample.pareto_k > PARETO_K_LIMIT

    def _serves(self, sample: ImportanceSample) -> bool:
        """Whether importance draws can take the place of long chains.

        A heavy tail of few weights is left to components that are added there.
        """
        return sample.efficiency >= LEAST_EFFICIENCY

    def _should_refit(self, sample: ImportanceSample) -> bool:
        """Whether a refit may pay: importance draws are poor, or so many more are needed."""
        needed = len(sample.z) * (sample.estimate.error / self.settings.log_evidence_error) ** 2
        enough = MOST_BATCHES * self.sampler.batch
        return sample.efficiency < GOOD_EFFICIENCY or needed - len(sample.z) > enough

    def _importance(
        self, trial: ImportanceSample, others: Sequence[ScoredDraws]
    ) -> tuple[ImportanceSample, Regions]:
        """Importance draws that give evidence and regions' shares as precisely as wanted."""
        wanted_error = self.settings.log_evidence_error
        sample = self.sampler.beyond_ends(trial, wanted_error)
        sample = self.sampler.renewed(sample, self.sampler.batch)
        sample = self.sampler.refined(sample, wanted_error, others)
        draws, log_posteriors = sample.typical_draws
        regions = find_regions(self.target, draws, log_posteriors, sample.mixture.chart(draws))
        if regions.n_regions == 1:
            return sample, regions
        errors = sample.share_errors(regions.assign(sample.z), regions.n_regions)
        factor = float(errors.max() / (SHARE_ERROR * wanted_error)) ** 2
        if factor > 1.0:
            # More draws can show a heavier tail.
            sample = self.sampler.extended(sample, factor)
            sample = self.sampler.refined(sample, wanted_error, others)
        return sample, regions

    def _maxima_of(self, regions: Regions, sample: ImportanceSample, maxima: Maxima) -> BoolArray:
        """Whether maxima are in regions or at their tops, (n_regions, m).

        Searches count as one what is hardly apart, such as the two edges of a narrow stripe.
        """
        numbers = np.arange(regions.n_regions)[:, None]
        inside = regions.assign(maxima.z) == numbers
        if regions.n_regions == 1:
            return inside
        in_region = regions.assign(sample.z) == numbers
        tops = np.where(in_region, sample.log_posteriors, -math.inf).argmax(axis=1)
        heights = sample.log_posteriors[tops]
        # One that is much higher is another maximum, however near.
        alike = heights < maxima.log_posteriors[:, None] + VALLEY_DEPTH
        at_top = reached(self.target, maxima, sample.z[tops], heights) & alike
        return inside | at_top.T
