"""Checks of a sampled posterior: what should agree, and what the result leans on.

A check that fails is a sentence for the reader of the result. None of them can see a region that
no part of the sampling ever met; that searches independent of one another agree is the best that
can be had.
"""

from __future__ import annotations

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.sampling.diagnostics import (
    LARGEST_WEIGHT,
    LENGTH_IN_AUTOCORRELATION_TIMES,
    PARETO_K_LIMIT,
)
from bayes_ssi.sampling.result import SamplingResult

__all__ = ["failed_checks", "failed_edge_checks"]

R_HAT_LIMIT, R_HAT_SCATTER = 1.01, 10.0
LEAST_EFFECTIVE_SAMPLES = 400
# An error this many times the wanted one is not what was wanted.
REACHED = 1.5
# A region with less of the posterior than this need not be found by every part of the sampling.
SMALL_SHARE = 0.02
# Independent searches that must have found a region.
SEARCHES_WANTED = 2
# The prior's edge is what lies beyond this many standard deviations in standard-normal
# coordinates, one prior draw in a thousand on either side.
EDGE = 3.09
# This much of the posterior may lie at an edge, of the prior or of the band.
EDGE_SHARE = 0.5
# Draws by which the share at the band's edge is judged.
DRAWS_AT_EDGE = 1000


def failed_checks(sampled: SamplingResult) -> list[str]:
    """What should agree in a result and does not, a sentence each; empty when all is well."""
    return [
        *_check_chains(sampled),
        *_check_evidence(sampled),
        *_check_regions(sampled),
        *_check_searches(sampled),
    ]


def failed_edge_checks(
    model_class: ModelClass, z: FloatArray, frequencies_hz: FloatArray
) -> list[str]:
    """What the posterior leans on that is not data: the edge of a prior, or of the band.

    Args:
        model_class: what was sampled.
        z: draws from its posterior (n, d).
        frequencies_hz: of the model at the draws (n, n_modes), of all configurations in turn.
    """
    failed = []
    for column, parameter in enumerate(model_class.parameters):
        for side, beyond in (("lower", z[:, column] < -EDGE), ("upper", z[:, column] > EDGE)):
            if beyond.mean() > EDGE_SHARE:
                failed.append(
                    f"parameter {parameter.name!r}: {100 * beyond.mean():.0f} % of the posterior "
                    f"lies at the {side} edge of its prior, {parameter.prior!r}, where only one "
                    "in a thousand prior draws lies"
                )
    some = np.linspace(0, len(z) - 1, min(len(z), DRAWS_AT_EDGE)).astype(np.intp)
    different, first, times = np.unique(z[some], axis=0, return_index=True, return_counts=True)
    left = frequencies_hz[some[first]]
    for configuration, likelihood, values in model_class.parts(model_class.values(different)):
        low, high = configuration.data.band_hz
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        n_modes = configuration.structure.n_modes
        own, left = left[:, :n_modes], left[:, n_modes:]
        shares = times @ likelihood.at_band_edge(values, own) / len(some)
        for mode, share in enumerate(shares, start=1):
            if share > EDGE_SHARE:
                failed.append(
                    f"{where}model mode {mode} is paired with nothing and lies at the edge of the "
                    f"band {low:g} to {high:g} Hz in {100 * share:.0f} % of the posterior: "
                    "whether it counts as missed depends on where the band ends"
                )
    return failed


def _check_chains(sampled: SamplingResult) -> list[str]:
    failed = []
    wanted = LENGTH_IN_AUTOCORRELATION_TIMES
    for ensemble in sampled.draws:
        if not ensemble.is_long_enough:
            failed.append(
                f"a chain of {ensemble.n_steps} steps is shorter than {wanted} autocorrelation "
                f"times of {ensemble.autocorrelation_times.max():.0f} steps"
            )
    fewest = float(sampled.effective_sample_sizes.min())
    if fewest < LEAST_EFFECTIVE_SAMPLES:
        failed.append(
            f"the draws are worth only {fewest:.0f} independent ones, fewer than "
            f"{LEAST_EFFECTIVE_SAMPLES}"
        )
    largest = sampled.r_hat
    # Between a few hundred independent draws R-hat exceeds 1 by chance.
    limit = max(R_HAT_LIMIT, 1.0 + R_HAT_SCATTER / fewest)
    if not largest <= limit:
        failed.append(f"the ensembles differ: R-hat is {largest:.3f}, above {limit:.3g}")
    return failed


def _check_evidence(sampled: SamplingResult) -> list[str]:
    failed = []
    quoted = sampled.evidence
    if quoted.error > REACHED * sampled.wanted_error:
        failed.append(
            f"the log evidence's error is {quoted.error:.3f}, after {len(sampled.importance.z)} "
            f"importance draws; {sampled.wanted_error:g} was wanted"
        )
    weight = float(sampled.importance.weights.max())
    if weight > LARGEST_WEIGHT:
        failed.append(f"one importance draw carries {100 * weight:.0f} % of the evidence")
    tail = sampled.importance.pareto_k
    if not tail <= PARETO_K_LIMIT:
        failed.append(
            f"a few importance draws may carry the evidence: Pareto k is {tail:.2f}, above "
            f"{PARETO_K_LIMIT}"
        )
    failed += [
        f"importance sampling and {check.name} disagree on the log evidence: {quoted} and {check}"
        for check in sampled.evidence_checks
        if not check.agrees_with(quoted)
    ]
    return failed


def _check_searches(sampled: SamplingResult) -> list[str]:
    """Maxima that one search found alone; where particles look for regions, too, these decide."""
    if sampled.starts or sampled.search.converged:
        return []
    n = sampled.search.n_searches
    return [f"{n} independent searches found different maxima; there may be others"]


def _check_regions(sampled: SamplingResult) -> list[str]:
    """Regions that a part of the sampling did not see."""
    failed: list[str] = []
    regions, shares = sampled.regions, sampled.region_shares
    if regions.n_regions == 1:
        return failed
    of_starts = [regions.shares(start.positions) for start in sampled.starts]
    of_chains = regions.shares(np.concatenate([e.draws for e in sampled.draws]))
    n_searches = sampled.searches_of_regions
    for region in np.flatnonzero(shares > SMALL_SHARE):
        name = f"a region with {100 * shares[region]:.1f} % of the posterior"
        if n_searches[region] < SEARCHES_WANTED:
            failed.append(
                f"{name} was found by {n_searches[region]} of {sampled.search.n_searches} "
                "independent searches; there may be others"
            )
        missed = sum(start[region] == 0 for start in of_starts)
        if missed:
            failed.append(
                f"{name} was missed by {missed} of {len(of_starts)} tempered starts; there may be "
                "others"
            )
        if of_chains[region] == 0:
            failed.append(f"{name} was never visited by the chains")
    return failed
