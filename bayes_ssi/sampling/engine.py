"""From a log-likelihood to draws of its posterior and its evidence, in five steps.

1. Independent searches find the maxima of the posterior; two independent tempered starts carry
   particles from the prior to the regions around them.
2. A Student-t mixture is fitted to the particles.
3. Two independent emcee ensembles sample the posterior, with proposals from that mixture; where
   they mix slowly they begin again with a mixture fitted to their own draws. Where they still mix
   slowly, importance draws (4.) replace theirs, if the effective sample size is large enough.
4. Mixture importance sampling gives the evidence and the share of the posterior in each region;
   bridge sampling with the draws of an ensemble checks it.
5. Everything that should agree is compared; disagreement is a warning in the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from bayes_ssi.sampling.bridge import bridge_sampling
from bayes_ssi.sampling.diagnostics import LENGTH_IN_AUTOCORRELATION_TIMES, PARETO_K_LIMIT
from bayes_ssi.sampling.ensembles import Ensemble, Walkers, run_ensemble
from bayes_ssi.sampling.importance import ImportanceSample, ImportanceSampler
from bayes_ssi.sampling.maxima import find_maxima
from bayes_ssi.sampling.multistart import search_maxima
from bayes_ssi.sampling.proposals import ProposalFitting
from bayes_ssi.sampling.regions import Regions, find_regions
from bayes_ssi.sampling.result import SamplingResult
from bayes_ssi.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.sampling.target import Target
from bayes_ssi.sampling.tempering import tempered_estimate, tempered_start

# Walkers of one ensemble; four per dimension if that is more (emcee's moves need two).
WALKERS = 32
# Longer chains are not worth their cost where importance draws serve as well. An ensemble that
# needs more steps mixes slowly, and starts again with a better mixture.
FEW_STEPS = 1000
SLOW = FEW_STEPS / LENGTH_IN_AUTOCORRELATION_TIMES
# Most refits of the mixture; they end earlier where importance draws are good enough and a refit
# raises their efficiency by less than this factor.
MAX_REFITS, WORTH_REFITTING = 4, 1.2
# Below this efficiency importance draws are poor: chains are run to their full length, and the
# mixture is finally fitted to their draws.
LEAST_EFFICIENCY = 0.1
# Effective sample size with which importance draws can replace those of the ensembles.
SUFFICIENT = 2000
# Wanted standard error of the regions' shares, relative to that of the log evidence.
SHARE_ERROR = 0.3


def sample_target(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings | None = None,
    progress: StepProgress = lambda _step, _done: None,
) -> SamplingResult:
    """Sample the posterior of ``target`` and estimate its evidence.

    Args:
        target: log-likelihood over coordinates whose prior is N(0, I).
        seed: everything random follows from it.
        settings: how precisely to sample.
        progress: called with the name of a step and the completed share of it.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior.
    """
    settings = settings or SamplingSettings()
    # The matrices are small: threads inside BLAS would only wait for one another.
    with threadpool_limits(limits=1, user_api="blas"):
        return _sample(target, seed, settings, progress)


def _sample(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings,
    progress: StepProgress,
) -> SamplingResult:
    seeds = seed.spawn(6)
    rng = np.random.default_rng(seeds[5])
    search = search_maxima(target, settings.searches, seeds[4], _part(progress, "searches"))
    n_particles = settings.n_particles(target.n_dimensions)
    starts = tuple(
        tempered_start(
            target, n_particles, search.maxima, seeds[i], _part(progress, "tempered start", i, 2)
        )
        for i in range(2)
    )
    n_walkers = max(WALKERS, 4 * target.n_dimensions)
    walkers = [start.walkers(n_walkers, rng) for start in starts]
    # Particles may have ended in regions that no search found: climb from there, too.
    ends = [positions[:WALKERS] for positions, _ in walkers]
    maxima = find_maxima(target, np.concatenate([search.maxima.z, *ends]))
    sampler = ImportanceSampler(target, rng)
    fitting = ProposalFitting(sampler, maxima)
    trial = fitting.fitted(starts[0].positions, starts[1].positions)
    ensembles, trial = _run_ensembles(
        target, walkers, fitting, trial, settings, seeds[2:4], progress
    )
    importance = sampler.refined(trial, settings.log_evidence_error)
    regions = find_regions(target, *importance.typical_draws)
    importance = _with_precise_shares(sampler, importance, regions, settings.log_evidence_error)
    resampled: tuple[Ensemble, ...] = ()
    if settings.max_steps > FEW_STEPS and not all(each.is_long_enough for each in ensembles):
        importance = _with_enough_draws(sampler, importance)
        size = importance.effective_sample_size
        if importance.pareto_k <= PARETO_K_LIMIT and size >= SUFFICIENT:
            resampled = tuple(part.resampled(rng) for part in importance.split_in_two(rng))
    progress("evidence", 1.0)
    return SamplingResult(
        search=search,
        starts=starts,
        maxima=maxima,
        ensembles=tuple(ensembles),
        importance=importance,
        evidence_checks=(
            bridge_sampling(ensembles[1], importance),
            tempered_estimate(starts),
            maxima.laplace_estimate,
        ),
        regions=regions,
        wanted_error=settings.log_evidence_error,
        n_evaluations=target.n_evaluations,
        resampled=resampled,
    )


def _run_ensembles(
    target: Target,
    walkers: Sequence[Walkers],
    fitting: ProposalFitting,
    trial: ImportanceSample,
    settings: SamplingSettings,
    seeds: Sequence[np.random.SeedSequence],
    progress: StepProgress,
) -> tuple[list[Ensemble], ImportanceSample]:
    """Independent ensembles, and importance draws from a mixture that suits the posterior.

    The mixture of ``trial`` proposes the ensembles' moves. Walkers that mix slowly with it are
    stopped, and continue from their positions with a mixture fitted to their draws; so do walkers
    that went where importance draws from the mixture do not.
    """
    seeds_of_attempts = zip(*(seed.spawn(MAX_REFITS + 1) for seed in seeds), strict=True)
    settled = False
    for attempt, attempt_seeds in enumerate(seeds_of_attempts):
        settled = settled or attempt == MAX_REFITS
        slowest = math.inf if settled else SLOW
        efficient = trial.efficiency >= LEAST_EFFICIENCY
        longest = min(settings.max_steps, FEW_STEPS) if efficient else settings.max_steps
        proposal = fitting.proposal(trial)
        ensembles = [
            run_ensemble(
                target, start, proposal, longest, seed, _part(progress, "ensembles", i, 2), slowest
            )
            for i, (start, seed) in enumerate(zip(walkers, attempt_seeds, strict=True))
        ]
        fast = all(each.autocorrelation_times.max() <= slowest for each in ensembles)
        if settled or (fast and trial.share_beyond(ensembles) <= settings.log_evidence_error):
            break
        walkers = [each.walkers for each in ensembles]
        before = trial.efficiency
        trial = fitting.refitted(ensembles, trial)
        # Mixtures hardly fit this posterior, but well enough for importance draws.
        settled = efficient and trial.efficiency < WORTH_REFITTING * before
    if trial.efficiency < LEAST_EFFICIENCY:
        trial = fitting.refitted(ensembles, trial)
    return ensembles, trial


def _with_enough_draws(sampler: ImportanceSampler, sample: ImportanceSample) -> ImportanceSample:
    """The sample, extended to replace chains that were cut short, if it is efficient enough."""
    while (
        sample.efficiency >= LEAST_EFFICIENCY
        and sample.effective_sample_size < SUFFICIENT
        and len(sample.z) < sampler.max_draws
    ):
        sample = sampler.extended(sample, SUFFICIENT / sample.effective_sample_size)
    return sample


def _with_precise_shares(
    sampler: ImportanceSampler, sample: ImportanceSample, regions: Regions, wanted_error: float
) -> ImportanceSample:
    """The sample, extended until the regions' shares are precise enough."""
    if regions.n_regions == 1:
        return sample
    errors = sample.share_errors(regions.assign(sample.z), regions.n_regions)
    factor = float(errors.max() / (SHARE_ERROR * wanted_error)) ** 2
    if factor <= 1.0:
        return sample
    # More draws can show a heavier tail.
    return sampler.refined(sampler.extended(sample, factor), wanted_error)


def _part(
    progress: StepProgress, step: str, index: int = 0, count: int = 1
) -> Callable[[float], None]:
    """Progress of one of ``count`` parts as progress of the whole step."""
    return lambda done: progress(step, (index + done) / count)
