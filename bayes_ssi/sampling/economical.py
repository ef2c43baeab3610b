"""The economical path: posterior and evidence from a few thousand evaluations.

For models that take long. Two short searches find the maxima; Laplace's approximation at each, as
a Student-t mixture, is what importance draws come from, and components are added where the weights
say that it falls short (incremental mixture importance sampling, Raftery and Bao 2010). This is
done twice, independently of one another: the second checks the first. Posterior draws are the
importance draws, resampled by their weights, so they cost nothing more.

There are no particles that come from the prior: a region that the few prior draws of the searches
do not lead to goes unseen. Posteriors that are not a few plain regions need more components than
there are, and fail the checks of the importance weights.
"""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np

from bayes_ssi.sampling.bridge import bridge_sampling
from bayes_ssi.sampling.ensembles import Ensemble
from bayes_ssi.sampling.estimates import EvidenceEstimate
from bayes_ssi.sampling.importance import (
    ImportanceSample,
    extended,
    first_draws,
    refined,
    resampled,
)
from bayes_ssi.sampling.maxima import Maxima
from bayes_ssi.sampling.mixture import StudentMixture, choose_mixture
from bayes_ssi.sampling.multistart import Effort, discover
from bayes_ssi.sampling.regions import Regions, find_regions
from bayes_ssi.sampling.result import SamplingResult
from bayes_ssi.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.sampling.target import Target

__all__ = ["sample_economically"]

SEARCHES = 2
DRAWS_PER_DIMENSION, LEAST_DRAWS = 30, 100
ASCENTS = 4
# Laplace's approximation with tails, and a wider copy of it.
DOF = 5.0
WIDER = (2.5, 0.3)
# Where Laplace's approximation falls short of the posterior, draws from the prior tell.
PRIOR_SHARE = 0.15
# Draws at once, of which a sixth go to each component that is added; components are added until
# draws are worth this share of as many from the posterior.
BATCH_PER_DIMENSION, LEAST_BATCH = 50, 300
# A mixture fitted to the draws gives new ones, until these agree with the last within so many
# standard errors.
COMPONENTS = (1, 2, 3, 4, 6)
MOST_FITS, AGREES, FITTED_SHARE = 5, 2.0, 0.5
LEAST_SHARE = 0.3
# No more draws than this: where they do not suffice this path is not the right one.
MAX_DRAWS = 10_000
# Errors of the two log evidences, relative to the wanted one: the second is a check.
ERRORS = (1.0, 2.0)
# The draws of each sample are worth at least so many independent ones.
LEAST_INDEPENDENT = (400, 250)
DRAWS_FOR_REGIONS = 150


def sample_economically(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings,
    progress: StepProgress | None = None,
) -> SamplingResult:
    """Sample the posterior of ``target`` and estimate its evidence with few evaluations.

    Arguments and errors as those of :func:`~bayes_ssi.sampling.engine.sample_target`; of the
    settings, ``log_evidence_error`` counts.
    """
    seeds = seed.spawn(len(ERRORS) + 1)
    effort = Effort(max(LEAST_DRAWS, DRAWS_PER_DIMENSION * target.n_dimensions), ASCENTS)
    discovery = discover(target, SEARCHES, seeds[-1], None, effort)
    _tell(progress, "searches", 1.0)
    samples, ensembles = [], []
    for i, (factor, least) in enumerate(zip(ERRORS, LEAST_INDEPENDENT, strict=True)):
        rng = np.random.default_rng(seeds[i])
        sample, draws = _sampled(
            target, discovery.maxima, factor * settings.log_evidence_error, least, rng
        )
        samples.append(sample)
        ensembles.append(draws)
        _tell(progress, "evidence", (i + 1) / len(ERRORS))
    importance, second = samples
    return SamplingResult(
        discovery=discovery,
        starts=(),
        maxima=discovery.maxima,
        ensembles=tuple(ensembles),
        importance=importance,
        evidence_checks=(
            bridge_sampling(ensembles[1], importance),
            EvidenceEstimate("second importance sample", *astuple(second.estimate)),
            discovery.maxima.laplace_estimate,
        ),
        regions=_regions(target, discovery.maxima, importance),
        wanted_error=settings.log_evidence_error,
        n_evaluations=target.n_evaluations,
    )


def _sampled(
    target: Target, maxima: Maxima, wanted_error: float, least: int, rng: np.random.Generator
) -> tuple[ImportanceSample, Ensemble]:
    """Importance draws until the error is as wanted, worth ``least`` at least; resampled too."""
    batch = max(LEAST_BATCH, BATCH_PER_DIMENSION * target.n_dimensions)
    mixture = maxima.as_mixture(dof=DOF).widened(*WIDER)
    sample = first_draws(target, mixture, rng, batch, PRIOR_SHARE)
    sample = refined(target, sample, np.inf, rng, batch, LEAST_SHARE, MAX_DRAWS)
    for _ in range(MOST_FITS):
        # Draws that a mixture was fitted to would weigh too little against it: new ones only.
        before = sample.estimate
        sample = first_draws(target, _adapted(sample, rng), rng, batch, PRIOR_SHARE)
        sample = refined(target, sample, np.inf, rng, batch, LEAST_SHARE, MAX_DRAWS)
        now = sample.estimate
        apart = abs(now.log_evidence - before.log_evidence)
        if apart < AGREES * math.hypot(now.error, before.error):
            break
    sample = refined(target, sample, wanted_error, rng, batch, LEAST_SHARE, MAX_DRAWS)
    missing = least / sample.effective_sample_size
    if missing > 1.0 and len(sample.z) < MAX_DRAWS:
        sample = extended(target, sample, min(missing, MAX_DRAWS / len(sample.z)), rng, batch // 4)
    return sample, resampled(sample, rng)


def _adapted(sample: ImportanceSample, rng: np.random.Generator) -> StudentMixture:
    """The mixture's components by what they are worth, and others fitted to the draws.

    Fitted to one half of the draws, and judged by the other, as far as these are worth enough.
    """
    known = sample.mixture.reweighted(sample.z, sample.weights)
    worth = int(sample.effective_sample_size)
    if worth < DRAWS_PER_DIMENSION * sample.z.shape[1]:
        return known
    halves = np.array_split(rng.permutation(len(sample.z)), 2)
    fitted_to, held_out = (
        sample.z[rng.choice(half, worth // 2, p=sample.weights[half] / sample.weights[half].sum())]
        for half in halves
    )
    fitted = choose_mixture(fitted_to, held_out, COMPONENTS, rng).widened(*WIDER)
    return known.mixed_with(fitted, FITTED_SHARE)


def _regions(target: Target, maxima: Maxima, sample: ImportanceSample) -> Regions:
    if len(maxima.z) == 1:  # nothing to tell apart, and nothing to evaluate for it
        return Regions(sample.z[:1], np.zeros(1, dtype=np.intp))
    log_posteriors = sample.log_weights + sample.log_proposals
    typical = sample.weights > 0.1 / len(sample.z)
    return find_regions(
        target, sample.z[typical], log_posteriors[typical], max_draws=DRAWS_FOR_REGIONS
    )


def _tell(progress: StepProgress | None, step: str, done: float) -> None:
    if progress is not None:
        progress(step, done)
