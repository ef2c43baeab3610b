"""Screening of many hypotheses: all with little effort, and the best ones with more."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.appendages.screening import (
    FULL,
    QUICK,
    SCAN,
    Effort,
    Screened,
    ToScreen,
    screen_all,
)
from bayes_ssi.execution.run import Run

# So many hypotheses are screened in full, in half a minute. Of more, only those that have three
# thousandths of what all have: the error of quick screening, a few tenths of a nat, in any of the
# others changes no probability by more than a thousandth.
MOST_IN_FULL, SHARE_FOR_FULL = 30, 3e-3
# Pairs of appendages that are screened quickly, in two minutes; of more, the best by a scan.
MOST_PAIRS = 300


def screen_best(
    hypotheses: Sequence[ToScreen],
    weights: Sequence[float],
    n_appendages: int,
    seed: int,
    run: Run,
) -> list[Screened]:
    """Screen hypotheses with one number of appendages, the better ones with more effort.

    Args:
        hypotheses: what is screened.
        weights: their prior weights.
        n_appendages: the number of appendages of each.
        seed: a result follows from it, the hypothesis's name, the effort, and the simpler one's
            result.
        run: workers and progress.

    Raises:
        ValueError: the likelihood of a hypothesis is zero at every draw from its prior.
    """
    n = len(hypotheses)
    if n <= MOST_IN_FULL:
        return screen_all(hypotheses, seed, run, FULL)
    log_weights = np.log(weights)
    results: list[Screened]
    if n_appendages > 1 and n > MOST_PAIRS:
        results = screen_all(hypotheses, seed, run, SCAN)
        _screen_again(results, hypotheses, log_weights, (QUICK, MOST_PAIRS, 0.0), seed, run)
    else:
        results = screen_all(hypotheses, seed, run, QUICK)
    in_full = (FULL, MOST_IN_FULL, SHARE_FOR_FULL)
    _screen_again(results, hypotheses, log_weights, in_full, seed, run)
    return results


def _screen_again(
    results: list[Screened],
    hypotheses: Sequence[ToScreen],
    log_weights: np.ndarray,
    step: tuple[Effort, int, float],
    seed: int,
    run: Run,
) -> None:
    """Replace the best of ``results``, at most so many and of so large a share, by new ones."""
    effort, most, least_share = step
    log_masses = log_weights + [each.log_evidence for each in results]
    least = float(logsumexp(log_masses)) + (math.log(least_share) if least_share else -math.inf)
    best = [int(i) for i in np.argsort(-log_masses, kind="stable")[:most] if log_masses[i] >= least]
    again = screen_all([hypotheses[i] for i in best], seed, run, effort)
    for i, screened in zip(best, again, strict=True):
        results[i] = screened
