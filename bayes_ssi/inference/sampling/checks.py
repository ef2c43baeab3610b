"""Checks of a sampled posterior: estimates that should agree.

A check is one function in ``CHECKS`` that yields a sentence for each thing that fails. No check
can reveal a region that every part of the sampling missed; the agreement of independent searches
is the best evidence that there is none.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bayes_ssi.inference.sampling.diagnostics import (
    LENGTH_IN_AUTOCORRELATION_TIMES,
    PARETO_K_LIMIT,
)
from bayes_ssi.inference.sampling.result import SamplingResult
from bayes_ssi.inference.sampling.target import FARTHEST

# Vehtari et al. (2021) ask for both.
R_HAT_LIMIT, LEAST_EFFECTIVE_SAMPLE_SIZE = 1.01, 400
# The wanted error counts as reached up to this multiple of it.
REACHED = 1.5
# Importance draws may miss a share of the posterior up to this multiple of the evidence's error:
# the evidence is too low by that share, and two standard errors are no surprise.
MOST_MISSED = 2.0
# A region with less of the posterior than this need not be found by every part of the sampling.
SMALL_SHARE = 0.02


def failed_checks(sampled: SamplingResult) -> list[str]:
    """Disagreements within a result, a sentence each; empty when all is well."""
    return [message for check in CHECKS for message in check(sampled)]


def _chain_lengths(sampled: SamplingResult) -> Iterator[str]:
    for ensemble in sampled.draws:
        if not ensemble.is_long_enough:
            yield (
                f"a chain of {ensemble.n_steps} steps is shorter than "
                f"{LENGTH_IN_AUTOCORRELATION_TIMES} autocorrelation times of "
                f"{ensemble.autocorrelation_times.max():.0f} steps"
            )


def _effective_sample_size(sampled: SamplingResult) -> Iterator[str]:
    smallest = float(sampled.effective_sample_sizes.min())
    if smallest < LEAST_EFFECTIVE_SAMPLE_SIZE:
        yield (
            f"effective sample size {smallest:.0f}, at least {LEAST_EFFECTIVE_SAMPLE_SIZE} needed"
        )


def _r_hat(sampled: SamplingResult) -> Iterator[str]:
    # Between a few hundred independent draws R-hat exceeds 1 by chance.
    limit = max(R_HAT_LIMIT, 1.0 + 10.0 / float(sampled.effective_sample_sizes.min()))
    if not sampled.r_hat <= limit:
        yield f"the ensembles differ: R-hat between them is {sampled.r_hat:.3f}, above {limit:.3g}"


def _evidence_error(sampled: SamplingResult) -> Iterator[str]:
    # It is at least the largest share of the evidence that one importance draw carries.
    error = sampled.evidence.error
    if error > REACHED * sampled.wanted_error:
        yield (
            f"the standard error of the log evidence is {error:.3f} after "
            f"{len(sampled.importance.z)} importance draws; {sampled.wanted_error:g} was wanted"
        )


def _importance_weights(sampled: SamplingResult) -> Iterator[str]:
    tail = sampled.importance.pareto_k
    if not tail <= PARETO_K_LIMIT:
        yield (
            f"a few importance draws may carry the evidence: Pareto k is {tail:.2f}, above "
            f"{PARETO_K_LIMIT}"
        )


def _missed_share(sampled: SamplingResult) -> Iterator[str]:
    missed = sampled.importance.share_beyond((*sampled.ensembles, *sampled.compressions))
    if missed > MOST_MISSED * sampled.evidence.error:
        yield (
            f"the importance draws may miss {100 * missed:.1f} % of the posterior: draws of the "
            "chains or particles weigh more than the heaviest of them"
        )


def _evidence_estimates(sampled: SamplingResult) -> Iterator[str]:
    quoted = sampled.evidence
    for other in sampled.evidence_checks:
        if not other.agrees_with(quoted):
            yield (
                f"importance sampling and {other.name} disagree on the log evidence: {quoted} and "
                f"{other}"
            )


def _regions(sampled: SamplingResult) -> Iterator[str]:
    """Regions that a part of the sampling missed."""
    regions, shares = sampled.regions, sampled.region_shares
    if regions.n_regions == 1:
        return
    shares_of_compressions = [regions.shares(each.positions) for each in sampled.compressions]
    shares_of_chains = regions.shares(np.concatenate([e.draws for e in sampled.draws]))
    n_searches = sampled.searches_of_regions
    for region in np.flatnonzero(shares > SMALL_SHARE):
        name = f"a region with {100 * shares[region]:.1f} % of the posterior"
        if n_searches[region] < 2:
            yield (
                f"{name} was found by {n_searches[region]} of {sampled.search.n_searches} "
                "independent searches; there may be others"
            )
        missed = sum(each[region] == 0 for each in shares_of_compressions)
        if missed:
            yield (
                f"{name} was missed by {missed} of {len(shares_of_compressions)} compressions of "
                "the prior; there may be others"
            )
        if shares_of_chains[region] == 0:
            yield f"{name} was never visited by the chains"


def _reach(sampled: SamplingResult) -> Iterator[str]:
    """A posterior so far from the prior that coordinates may have cut it off."""
    z = sampled.importance.z
    share = float(sampled.importance.weights @ (np.abs(z).max(axis=1) > FARTHEST - 1.0))
    if share > SMALL_SHARE:
        yield (
            f"{100 * share:.0f} % of the posterior is {FARTHEST - 1.0:g} prior standard deviations "
            "or more from the prior's median, where what is farther is left out: does a prior "
            "contradict the data?"
        )


def _searches(sampled: SamplingResult) -> Iterator[str]:
    """Maxima that only one search found, where there are no particles as a second check."""
    if not (sampled.compressions or sampled.search.converged):
        yield (
            f"{sampled.search.n_searches} independent searches found different maxima; there may "
            "be others"
        )


CHECKS = (
    _chain_lengths,
    _effective_sample_size,
    _r_hat,
    _evidence_error,
    _importance_weights,
    _missed_share,
    _evidence_estimates,
    _regions,
    _reach,
    _searches,
)
