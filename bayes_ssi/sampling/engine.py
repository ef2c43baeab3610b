"""From a log-likelihood to draws of its posterior and its evidence, in five steps.

1. Independent searches find the maxima of the posterior; two independent tempered starts carry
   particles from the prior to the regions around them.
2. A Student-t mixture is fitted to the particles.
3. Two independent emcee ensembles sample the posterior, with proposals from that mixture; where
   they move slowly they begin again with a mixture fitted to their own draws. Where they move
   slowly all the same, importance draws (4.) take their place, if they are worth enough.
4. Mixture importance sampling, from a mixture fitted to the ensembles' draws, gives the evidence
   and the share of the posterior in each region; bridge sampling with the draws of an ensemble
   checks it.
5. Everything that should agree is compared; what does not is a warning in the result.

Where evaluations are dear, :mod:`bayes_ssi.sampling.economical` does without the particles and
ensembles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.bridge import bridge_sampling
from bayes_ssi.sampling.diagnostics import PARETO_K_LIMIT
from bayes_ssi.sampling.economical import sample_economically
from bayes_ssi.sampling.ensembles import Ensemble, Proposal, Walkers, first_walkers, run_ensemble
from bayes_ssi.sampling.importance import (
    ImportanceSample,
    extended,
    first_draws,
    halves,
    refined,
    resampled,
)
from bayes_ssi.sampling.maxima import Maxima, find_maxima
from bayes_ssi.sampling.mixture import StudentMixture, choose_mixture
from bayes_ssi.sampling.multistart import discover
from bayes_ssi.sampling.regions import Regions, find_regions
from bayes_ssi.sampling.result import SamplingResult
from bayes_ssi.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.sampling.target import Target
from bayes_ssi.sampling.tempering import TemperedStart, tempered_estimate, tempered_start

__all__ = ["sample_target"]

N_ENSEMBLES = 2
WALKERS = 32
ENDS_TO_CLIMB_FROM = 32
# Ensembles with a longer autocorrelation time begin again with a better mixture.
SLOW, MAX_REFITS = 12.0, 4
# They do so no more when importance draws are good enough and a new fit raises the share that
# they are worth by less than this factor.
WORTH_REFITTING = 1.2
# Importance draws from a mixture must be worth this share of as many posterior draws; else the
# mixture is fitted anew, to the draws of the ensembles.
EFFICIENT = 0.25
# Shares of the moves that a poor and a good mixture proposes.
LEAST_MOVES, MOST_MOVES = 0.7, 0.95
# Where importance draws are worth at least this share of as many posterior draws, ensembles that
# mix slowly stop after a few steps; posterior draws are then made of the importance draws, if all
# of these are worth enough.
SUFFICIENT_SHARE, FEW_STEPS, SUFFICIENT = 0.05, 1000, 2000.0
COMPONENTS = (1, 2, 3, 4, 6, 8, 12, 16)
DRAWS_FOR_FITTING = 3000
# Weight of the maxima's own components in the mixtures: a region that the particles lost is
# proposed all the same.
MAXIMA_SHARE = 0.1
# Factor and weight of a wider copy of a mixture: no walker is then stuck, and no importance draw
# heavy, just beyond what the mixture was fitted to.
WIDER = (2.0, 0.1)
# Wanted standard error of the regions' shares, relative to that of the log evidence.
SHARE_ERROR = 0.3
# Importance draws count as part of a region when their weight is at least this share of the mean.
TYPICAL_WEIGHT = 0.1


def sample_target(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings | None = None,
    progress: StepProgress | None = None,
) -> SamplingResult:
    """Sample the posterior of ``target`` and estimate its evidence.

    Args:
        target: log-likelihood over coordinates whose prior is N(0, I).
        seed: everything random follows from it.
        settings: how precisely.
        progress: told what is under way.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior.
    """
    settings = settings or SamplingSettings()
    # The matrices are small: threads inside BLAS would only wait for one another.
    with threadpool_limits(limits=1, user_api="blas"):
        sample = sample_economically if settings.economical else _sample
        return sample(target, seed, settings, progress)


def _sample(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings,
    progress: StepProgress | None,
) -> SamplingResult:
    seeds = seed.spawn(2 * N_ENSEMBLES + 2)
    rng = np.random.default_rng(seeds[-1])
    discovery = discover(
        target, settings.searches, seeds[-2], _reporter(progress, "searches", 0, 1)
    )
    n_particles = settings.n_particles(target.n_dimensions)
    starts = []
    for i in range(N_ENSEMBLES):
        report = _reporter(progress, "tempered start", i, N_ENSEMBLES)
        starts.append(tempered_start(target, n_particles, discovery.maxima, seeds[i], report))
    # Particles may have ended in regions that no search found: climb from there, too.
    ends = [rng.choice(start.positions, ENDS_TO_CLIMB_FROM) for start in starts]
    maxima = find_maxima(target, np.concatenate([discovery.maxima.z, *ends]))
    walkers = [first_walkers(start, max(WALKERS, 4 * target.n_dimensions), rng) for start in starts]
    ensembles, trial = _run_ensembles(
        target,
        walkers,
        starts,
        maxima,
        settings,
        seeds[N_ENSEMBLES : 2 * N_ENSEMBLES],
        rng,
        progress,
    )
    importance = refined(target, trial, settings.log_evidence_error, rng)
    regions = _regions(target, importance)
    importance = _with_sure_shares(target, importance, regions, settings.log_evidence_error, rng)
    instead: tuple[Ensemble, ...] = ()
    stopped = settings.max_steps > FEW_STEPS and not all(one.is_long_enough for one in ensembles)
    if stopped and _suffices(importance):
        instead = tuple(resampled(half, rng) for half in halves(importance, rng))
    if progress is not None:
        progress("evidence", 1.0)
    return SamplingResult(
        discovery=discovery,
        starts=tuple(starts),
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
        resampled=instead,
    )


def _run_ensembles(
    target: Target,
    walkers: list[Walkers],
    starts: Sequence[TemperedStart],
    maxima: Maxima,
    settings: SamplingSettings,
    seeds: Sequence[np.random.SeedSequence],
    rng: np.random.Generator,
    progress: StepProgress | None,
) -> tuple[list[Ensemble], ImportanceSample]:
    """Independent ensembles, and first importance draws from a mixture that suits the posterior.

    The mixture, which proposes the ensembles' moves, is fitted to the particles first. Where
    walkers move slowly with it they are stopped, and begin again from where they are with a
    mixture that is fitted to their draws.
    """
    mixture = _fitted(starts[0].positions, starts[1].positions, maxima, rng)
    trial = first_draws(target, mixture, rng)
    of_attempts = [seed.spawn(MAX_REFITS + 1) for seed in seeds]
    settled = False
    for attempt in range(MAX_REFITS + 1):
        settled = settled or attempt == MAX_REFITS
        slowest = math.inf if settled else SLOW
        # Importance draws that are worth many make long chains needless.
        worth = trial.effective_share >= SUFFICIENT_SHARE
        most = min(settings.max_steps, FEW_STEPS) if worth else settings.max_steps
        proposal = _proposal(mixture, trial)
        ensembles: list[Ensemble] = []
        for i, own in enumerate(walkers):
            report = _reporter(progress, "ensembles", i, N_ENSEMBLES)
            one = run_ensemble(
                target, own, proposal, most, of_attempts[i][attempt], report, slowest
            )
            ensembles.append(one)
        if settled or all(one.autocorrelation_times.max() <= slowest for one in ensembles):
            break
        walkers = [one.walkers for one in ensembles]
        before = trial.effective_share
        mixture, trial = _refitted(target, ensembles, maxima, mixture, trial, rng)
        # A posterior that mixtures hardly fit, well enough for importance draws all the same.
        settled = worth and trial.effective_share < WORTH_REFITTING * before
    if trial.effective_share < EFFICIENT:
        mixture, trial = _refitted(target, ensembles, maxima, mixture, trial, rng)
    return ensembles, trial


def _proposal(mixture: StudentMixture, trial: ImportanceSample) -> Proposal:
    """The mixture as the ensembles' proposal, after first importance draws from it."""
    # Draws that lost a region leave its component too little weight; a few importance draws
    # give every component its share.
    reweighted = mixture.reweighted(trial.z, trial.weights).with_prior_component(MAXIMA_SHARE)
    # The better the mixture, the less is left for other moves to do.
    return Proposal(reweighted, min(LEAST_MOVES + trial.effective_share, MOST_MOVES))


def _refitted(
    target: Target,
    ensembles: Sequence[Ensemble],
    maxima: Maxima,
    mixture: StudentMixture,
    trial: ImportanceSample,
    rng: np.random.Generator,
) -> tuple[StudentMixture, ImportanceSample]:
    """A mixture fitted to the ensembles' draws, or the one before if they are likelier in it.

    Not the one whose importance draws are worth more: draws do not show a region that their
    mixture lacks, those of the ensembles do.
    """
    fitted = _fitted(ensembles[0].draws, ensembles[1].draws, maxima, rng)
    held_out = _thinned(ensembles[1].draws, rng)
    if mixture.log_pdf(held_out).mean() >= fitted.log_pdf(held_out).mean():
        return mixture, trial
    return fitted, first_draws(target, fitted, rng)


def _suffices(sample: ImportanceSample) -> bool:
    """Whether importance draws can take the place of chains."""
    return sample.pareto_k <= PARETO_K_LIMIT and sample.effective_sample_size >= SUFFICIENT


def _fitted(
    draws: FloatArray, held_out: FloatArray, maxima: Maxima, rng: np.random.Generator
) -> StudentMixture:
    """A mixture fitted to draws, and the maxima."""
    found = choose_mixture(_thinned(draws, rng), _thinned(held_out, rng), COMPONENTS, rng)
    return found.mixed_with(maxima.as_mixture(), MAXIMA_SHARE).widened(*WIDER)


def _with_sure_shares(
    target: Target,
    sample: ImportanceSample,
    regions: Regions,
    wanted_error: float,
    rng: np.random.Generator,
) -> ImportanceSample:
    """The sample with as many more draws as the regions' shares ask for."""
    if regions.n_regions == 1:
        return sample
    errors = sample.share_errors(regions.assign(sample.z), regions.n_regions)
    factor = float(errors.max() / (SHARE_ERROR * wanted_error)) ** 2
    if factor <= 1.0:
        return sample
    # More draws can show a heavier tail.
    return refined(target, extended(target, sample, factor, rng), wanted_error, rng)


def _reporter(
    progress: StepProgress | None, step: str, index: int, count: int
) -> Callable[[float], None] | None:
    """Progress of one of ``count`` parts as progress of the whole step."""
    if progress is None:
        return None
    return lambda done: progress(step, (index + done) / count)


def _thinned(draws: FloatArray, rng: np.random.Generator) -> FloatArray:
    if len(draws) <= DRAWS_FOR_FITTING:
        return draws
    return draws[rng.choice(len(draws), DRAWS_FOR_FITTING, replace=False)]


def _regions(target: Target, sample: ImportanceSample) -> Regions:
    weights: NDArray[np.float64] = sample.weights
    typical = weights > TYPICAL_WEIGHT / len(weights)
    log_posteriors = sample.log_weights + sample.log_proposals
    return find_regions(target, sample.z[typical], log_posteriors[typical])
