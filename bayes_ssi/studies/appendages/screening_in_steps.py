"""Screening of many hypotheses: all with little effort, and the best ones with more.

On a finite-element model, a first look at all of them bounds their evidences. In the order of the
bounds they are screened quickly, until those left cannot matter whatever their evidences are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.appendages.first_look import FirstLook, first_looks
from bayes_ssi.studies.appendages.screening import (
    FULL,
    QUICK,
    SCAN,
    Effort,
    Screened,
    ToScreen,
    screen_all,
)

# So many hypotheses of at most one appendage are screened in full, in half a minute. Of more, and
# of those with several appendages, only those that have three thousandths of what all have: the
# error of quick screening, a few tenths of a nat, in any of the others changes no probability by
# more than a thousandth.
MOST_IN_FULL, SHARE_FOR_FULL = 30, 3e-3
# Pairs of appendages that are screened quickly, in a minute; of more, the best by a first look, or
# by a scan.
MOST_PAIRS = 300
# All that a first look leaves out together have no more than this share of what the others have.
LEFT_OUT = 1e-3


def screen_best(
    hypotheses: Sequence[ToScreen],
    weights: Sequence[float],
    n_appendages: int,
    seed: int,
    run: Run,
    log_mass_of_fewer: float = -math.inf,
) -> list[Screened]:
    """Screen hypotheses with one number of appendages, the better ones with more effort.

    Args:
        seed: a result follows from it, the hypothesis's name, the effort, and the simpler one's
            result.
        log_mass_of_fewer: log of prior weights times evidences, summed over the hypotheses with
            fewer appendages.
    """
    n = len(hypotheses)
    if n_appendages <= 1 and n <= MOST_IN_FULL:
        return screen_all(hypotheses, seed, run, FULL)
    log_weights = np.log(weights)
    most = n if n_appendages == 1 else MOST_PAIRS
    results: list[Screened]
    if len(looks := first_looks(hypotheses, seed, run)) == n:
        results = _within_reach(hypotheses, log_weights, looks, most, seed, run)
    elif n > most:
        results = screen_all(hypotheses, seed, run, SCAN)
        _screen_again(results, hypotheses, log_weights, (QUICK, most, -math.inf), seed, run)
    else:
        results = screen_all(hypotheses, seed, run, QUICK)
    of_all = np.logaddexp(
        log_mass_of_fewer, logsumexp(log_weights + [each.log_evidence for each in results])
    )
    in_full = (FULL, MOST_IN_FULL, float(of_all) + math.log(SHARE_FOR_FULL))
    _screen_again(results, hypotheses, log_weights, in_full, seed, run)
    return results


def _within_reach(
    hypotheses: Sequence[ToScreen],
    log_weights: np.ndarray,
    looks: Mapping[int, FirstLook],
    most: int,
    seed: int,
    run: Run,
) -> list[Screened]:
    """Screen quickly, at most so many, those that can matter by the first look at all."""
    bounds = log_weights + [looks[i].greatest for i in range(len(hypotheses))]
    order = np.argsort(-bounds, kind="stable")
    bounds_of_rest = np.logaddexp.accumulate(bounds[order][::-1])[::-1]
    quick: dict[int, Screened] = {}
    while len(quick) < min(most, len(order)):
        if quick:
            known = logsumexp([log_weights[i] + each.log_evidence for i, each in quick.items()])
            if bounds_of_rest[len(quick)] < known + math.log(LEFT_OUT):
                break
        chosen = [int(i) for i in order[len(quick) : min(len(quick) + MOST_IN_FULL, most)]]
        screened = screen_all([hypotheses[i] for i in chosen], seed, run, QUICK)
        quick.update(zip(chosen, screened, strict=True))
    gap = float(np.median([looks[i].greatest - each.log_evidence for i, each in quick.items()]))
    return [
        quick[i] if i in quick else looks[i].as_screened(each.model_class.parameter_names, gap)
        for i, each in enumerate(hypotheses)
    ]


def _screen_again(
    results: list[Screened],
    hypotheses: Sequence[ToScreen],
    log_weights: np.ndarray,
    step: tuple[Effort, int, float],
    seed: int,
    run: Run,
) -> None:
    """Replace the best of ``results``, at most so many and of so large a log mass, by new ones."""
    effort, most, least = step
    log_masses = log_weights + [each.log_evidence for each in results]
    best = [int(i) for i in np.argsort(-log_masses, kind="stable")[:most] if log_masses[i] >= least]
    again = screen_all([hypotheses[i] for i in best], seed, run, effort)
    for i, screened in zip(best, again, strict=True):
        results[i] = screened
