"""From a log-likelihood to draws of its posterior and its evidence.

1. Independent searches find the maxima of the posterior.
2. Importance draws from Laplace's approximation around them give a mixture close to the posterior,
   where the target knows its problem, its searches agree, and the draws are good. Else two
   independent compressions of the prior carry particles to the regions around the maxima and to
   others, from which further ascents begin, and the mixture is fitted to the particles.
3. Two independent emcee ensembles sample the posterior, with proposals from that mixture. Where
   importance draws from it serve as posterior draws, short ones check where these do not go.
4. Mixture importance sampling gives the evidence and the share of the posterior in each region.
5. Everything that should agree is compared: bridge sampling with the draws of an ensemble, the
   compressions, the searches, the regions. Disagreement without particles begins again with them
   (2.); with them, it is a warning in the result.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.bridge import bridge_sampling
from bayes_ssi.inference.sampling.chains import (
    LEAST_EFFICIENCY,
    MAX_REFITS,
    WORTH_REFITTING,
    are_cut_short,
    is_worth_refitting,
    run_ensembles,
    serves,
)
from bayes_ssi.inference.sampling.checks import failed_checks
from bayes_ssi.inference.sampling.compression import (
    Compression,
    compress_prior,
    compression_estimate,
)
from bayes_ssi.inference.sampling.diagnostics import PARETO_K_LIMIT
from bayes_ssi.inference.sampling.ensembles import Ensemble, Walkers
from bayes_ssi.inference.sampling.estimates import EvidenceEstimate
from bayes_ssi.inference.sampling.importance import ImportanceSample, ImportanceSampler, ScoredDraws
from bayes_ssi.inference.sampling.maxima import Maxima, find_maxima
from bayes_ssi.inference.sampling.mixture_fitting import DRAWS_PER_DIMENSION
from bayes_ssi.inference.sampling.multistart import MultistartSearch, search_maxima
from bayes_ssi.inference.sampling.proposals import ProposalFitting
from bayes_ssi.inference.sampling.regions import Regions, find_regions, local_maxima
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.inference.sampling.result import SamplingResult
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress, part
from bayes_ssi.inference.sampling.target import Target

# Walkers of one ensemble; four per dimension if that is more (emcee's moves need two).
WALKERS = 32
# Effective sample size with which importance draws can replace those of the ensembles.
SUFFICIENT = 2000
# Wanted standard error of the regions' shares, relative to that of the log evidence.
SHARE_ERROR = 0.3
# Most particles from which further ascents begin, and of how many they are the local maxima: the
# time to find neighbours in many dimensions rises with the square of that.
MAX_CLIMBERS, MAX_COMPARED = 32, 4000


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
        return _Sampling(target, settings, seeds, rng, progress).result()


@dataclass(frozen=True)
class _Sampling:
    """One run: what its steps share.

    Attributes:
        seeds: six; of the compressions, the ensembles, the searches and ``rng``.
    """

    target: Target
    settings: SamplingSettings
    seeds: Sequence[np.random.SeedSequence]
    rng: np.random.Generator
    progress: StepProgress

    @cached_property
    def sampler(self) -> ImportanceSampler:
        return ImportanceSampler(self.target, self.rng)

    @property
    def n_walkers(self) -> int:
        return max(WALKERS, 4 * self.target.n_dimensions)

    def result(self) -> SamplingResult:
        search = search_maxima(
            self.target,
            self.settings.searches,
            self.seeds[4],
            part(self.progress, "searches"),
        )
        result = None
        if self.target.suggest_starts is not None and search.converged:
            result = self._from_maxima(search)
        if result is None or failed_checks(result):
            result = self._from_particles(search)
        self.progress("evidence", 1.0)
        return result

    def _from_maxima(self, search: MultistartSearch) -> SamplingResult | None:
        """The result without particles; None where Laplace's approximation does not suffice.

        Mixtures are fitted to the importance draws until these serve, and are few enough.
        """
        fitting = ProposalFitting(self.sampler, search.maxima)
        first = self.sampler.sample(search.maxima.as_mixture().widened())
        enough = DRAWS_PER_DIMENSION * self.target.n_dimensions
        if first.effective_sample_size < enough:
            first = self.sampler.extended(first, 4.0)
        if first.effective_sample_size < enough:
            # Where it misses a part, more draws show ever heavier ones instead of more that matter,
            # and components added to it may end where it does.
            return None
        best = first
        for _ in range(MAX_REFITS):
            if not serves(best):  # more draws that matter give a better fit
                best = self.sampler.extended(self.sampler.refined(best, math.inf), 4.0)
            halves = best.split_in_two(self.rng)
            if min(half.effective_sample_size for half in halves) < enough:
                return None
            starts = [half.resampled(self.rng) for half in halves]
            trial = fitting.fitted(starts[0].draws, starts[1].draws)
            gain = trial.efficiency / best.efficiency
            if gain * WORTH_REFITTING > 1.0:
                best = trial
            in_vain = gain < WORTH_REFITTING
            if serves(best) and (in_vain or not is_worth_refitting(best, self.settings, fitting)):
                break
        # Twice as many walkers make half as many steps for a check of equal size.
        n = 2 * self.n_walkers
        walkers = [Walkers(each.draws[:n], each.log_posteriors[:n, 0]) for each in starts]
        check = EvidenceEstimate("importance draws around maxima", *astuple(first.estimate))
        return self._sampled(search, fitting, best, walkers, [check])

    def _from_particles(self, search: MultistartSearch) -> SamplingResult:
        """The result with compressions of the prior."""
        compressions = compress_prior(
            self.target,
            self.settings.n_particles(self.target.n_dimensions),
            search.maxima,
            self.seeds[0:2],
            part(self.progress, "compression of the prior"),
        )
        # Particles may have passed through regions that no search found: climb from there, too.
        climbers = np.concatenate([_climbers(each, search.maxima) for each in compressions])
        maxima = find_maxima(self.target, climbers, search.maxima)
        fitting = ProposalFitting(self.sampler, maxima)
        return self._sampled(
            search,
            fitting,
            fitting.fitted(*(each.positions for each in compressions)),
            [each.walkers(self.n_walkers, self.rng) for each in compressions],
            [compression_estimate(compressions)],
            compressions,
        )

    def _sampled(
        self,
        search: MultistartSearch,
        fitting: ProposalFitting,
        trial: ImportanceSample,
        walkers: Sequence[Walkers],
        checks: Sequence[EvidenceEstimate],
        compressions: tuple[Compression, ...] = (),
    ) -> SamplingResult:
        """Ensembles and importance draws."""
        ensembles, trial = run_ensembles(
            self.target,
            walkers,
            fitting,
            trial,
            self.settings,
            self.seeds[2:4],
            self.progress,
            compressions,
        )
        importance, regions = self._importance(trial, (*ensembles, *compressions))
        resampled: tuple[Ensemble, ...] = ()
        if are_cut_short(ensembles, self.settings):
            importance = _with_enough_draws(self.sampler, importance)
            size = importance.effective_sample_size
            if importance.pareto_k <= PARETO_K_LIMIT and size >= SUFFICIENT:
                halves = importance.split_in_two(self.rng)
                resampled = tuple(half.resampled(self.rng) for half in halves)
        return SamplingResult(
            search=search,
            compressions=compressions,
            maxima=fitting.maxima,
            ensembles=tuple(ensembles),
            importance=importance,
            evidence_checks=(
                bridge_sampling(ensembles[1], importance),
                *checks,
                fitting.maxima.laplace_estimate,
            ),
            regions=regions,
            wanted_error=self.settings.log_evidence_error,
            n_evaluations=self.target.n_evaluations,
            resampled=resampled,
        )

    def _importance(
        self, trial: ImportanceSample, others: Sequence[ScoredDraws]
    ) -> tuple[ImportanceSample, Regions]:
        """Importance draws that give evidence and regions' shares as precisely as wanted."""
        wanted_error = self.settings.log_evidence_error
        sample = self.sampler.beyond_ends(trial, wanted_error)
        sample = self.sampler.renewed(sample, self.sampler.batch)
        sample = self.sampler.refined(sample, wanted_error, others)
        regions = find_regions(self.target, *sample.typical_draws)
        if regions.n_regions == 1:
            return sample, regions
        errors = sample.share_errors(regions.assign(sample.z), regions.n_regions)
        factor = float(errors.max() / (SHARE_ERROR * wanted_error)) ** 2
        if factor > 1.0:
            # More draws can show a heavier tail.
            sample = self.sampler.extended(sample, factor)
            sample = self.sampler.refined(sample, wanted_error, others)
        return sample, regions


def _climbers(compression: Compression, maxima: Maxima) -> FloatArray:
    """Particles (m, d) higher than all their neighbours on all levels, but at no known maximum."""
    among = evenly_spaced_indices(len(compression.passed), MAX_COMPARED)
    highest = local_maxima(compression.passed[among], compression.log_likelihoods_passed[among])
    return highest[~maxima.are_at(highest).any(axis=0)][:MAX_CLIMBERS]


def _with_enough_draws(sampler: ImportanceSampler, sample: ImportanceSample) -> ImportanceSample:
    """The sample, extended to replace chains that were cut short, if it is efficient enough."""
    while (
        sample.efficiency >= LEAST_EFFICIENCY
        and sample.effective_sample_size < SUFFICIENT
        and len(sample.z) < sampler.max_draws
    ):
        sample = sampler.extended(sample, SUFFICIENT / sample.effective_sample_size)
    return sample
