"""The economical path: posterior and evidence from a few thousand evaluations.

For models that take long. Two short searches find the maxima; Laplace's approximation at each, as
a Student-t mixture, gives the importance draws, and components are added where the weights show
that it falls short (incremental mixture importance sampling, Raftery and Bao 2010). This is done
twice, independently: the second sample checks the first. Posterior draws are the importance draws,
resampled by their weights, so they cost nothing more.

There are no particles from the prior: a region that the few prior draws of the searches miss
stays unseen. Posteriors that are not a few plain regions need more components than there are, and
fail the checks of the importance weights.
"""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np

from bayes_ssi.sampling.bridge import bridge_sampling
from bayes_ssi.sampling.estimates import EvidenceEstimate
from bayes_ssi.sampling.importance import ImportanceSample, ImportanceSampler
from bayes_ssi.sampling.maxima import Maxima
from bayes_ssi.sampling.mixture import StudentMixture
from bayes_ssi.sampling.mixture_fitting import DRAWS_PER_DIMENSION, choose_mixture
from bayes_ssi.sampling.multistart import search_maxima
from bayes_ssi.sampling.regions import Regions, find_regions
from bayes_ssi.sampling.result import SamplingResult
from bayes_ssi.sampling.settings import SamplingSettings, StepProgress
from bayes_ssi.sampling.target import Target

# Draws per dimension in one batch, counting at least six dimensions; a search makes half of them.
BATCH_PER_DIMENSION = 50
# Effective sample size of each of the two samples; the two together pass the checks of the draws.
LEAST_INDEPENDENT = 250


def sample_economically(
    target: Target,
    seed: np.random.SeedSequence,
    settings: SamplingSettings,
    progress: StepProgress,
) -> SamplingResult:
    """Sample the posterior of ``target`` and estimate its evidence with few evaluations.

    Arguments and errors are as in :func:`~bayes_ssi.sampling.engine.sample_target`; the only
    setting used is ``log_evidence_error``.
    """
    *seeds, seed_of_searches = seed.spawn(3)
    batch = BATCH_PER_DIMENSION * max(6, target.n_dimensions)
    search = search_maxima(target, 2, seed_of_searches, n_draws=batch // 2, n_ascents=4)
    progress("searches", 1.0)
    samplers, samples = [], []
    # The second sample is a check: twice the error will do.
    for i, wanted_error in enumerate(settings.log_evidence_error * np.array([1.0, 2.0])):
        # The prior's draws show where Laplace's approximation falls short of the posterior.
        sampler = ImportanceSampler(
            target,
            np.random.default_rng(seeds[i]),
            batch,
            prior_share=0.15,
            least_efficiency=0.3,
            max_draws=10_000,  # a posterior that needs more is not for this path
        )
        samples.append(_sample(sampler, search.maxima, float(wanted_error)))
        samplers.append(sampler)
        progress("evidence", (i + 1) / 2)
    importance, second = samples
    ensembles = tuple(
        sample.resampled(sampler.rng) for sample, sampler in zip(samples, samplers, strict=True)
    )
    return SamplingResult(
        search=search,
        starts=(),
        maxima=search.maxima,
        ensembles=ensembles,
        importance=importance,
        evidence_checks=(
            bridge_sampling(ensembles[1], importance),
            EvidenceEstimate("second importance sample", *astuple(second.estimate)),
            search.maxima.laplace_estimate,
        ),
        regions=_regions(target, search.maxima, importance, batch // 2),
        wanted_error=settings.log_evidence_error,
        n_evaluations=target.n_evaluations,
    )


def _sample(sampler: ImportanceSampler, maxima: Maxima, wanted_error: float) -> ImportanceSample:
    """Importance draws until the error and the effective sample size are as wanted."""
    sample = sampler.refined(sampler.sample(maxima.as_mixture().widened()), np.inf)
    for _ in range(5):  # or until two estimates agree within two standard errors
        # Draws that a mixture was fitted to would weigh too little against it: new ones only.
        before = sample.estimate
        sample = sampler.refined(sampler.sample(_adapted(sample, sampler.rng)), np.inf)
        now = sample.estimate
        difference = abs(now.log_evidence - before.log_evidence)
        if difference < 2.0 * math.hypot(now.error, before.error):
            break
    sample = sampler.refined(sample, wanted_error)
    missing = LEAST_INDEPENDENT / sample.effective_sample_size
    if missing > 1.0 and len(sample.z) < sampler.max_draws:
        sample = sampler.extended(sample, missing)
    return sample


def _adapted(sample: ImportanceSample, rng: np.random.Generator) -> StudentMixture:
    """The components, weighted by their shares of the posterior, mixed with a new fit to the draws.

    The new fit uses one half of the draws and is judged by the other, if there are enough.
    """
    known = sample.mixture.reweighted(sample.z, sample.weights)
    n = int(sample.effective_sample_size) // 2
    if n < DRAWS_PER_DIMENSION * sample.z.shape[1]:
        return known
    fitted_to, held_out = (
        part.z[rng.choice(len(part.z), n, p=part.weights)] for part in sample.split_in_two(rng)
    )
    return known.mixed_with(choose_mixture(fitted_to, held_out, rng).widened(), 0.5)


def _regions(target: Target, maxima: Maxima, sample: ImportanceSample, max_draws: int) -> Regions:
    if len(maxima.z) == 1:  # nothing to separate, and nothing to evaluate for it
        return Regions(sample.z[:1], np.zeros(1, dtype=np.intp))
    return find_regions(target, *sample.typical_draws, max_draws)
