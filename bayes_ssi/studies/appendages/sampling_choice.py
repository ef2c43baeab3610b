"""Which hypotheses of a search are sampled, so that the answer hardly rests on the others."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.inference.sampling.estimates import Estimate

H = TypeVar("H", bound=Hashable)
# An approximate log evidence is taken to be at most this many standard errors too low, or as much
# too low as the worst of those that were sampled. Some hundred draws show no smaller errors.
STANDARD_ERRORS, LEAST_ERROR = 3.0, 0.05


def unsampled_bounds(
    approximate: Mapping[H, Estimate], sampled: Mapping[H, float]
) -> dict[H, float]:
    """Upper bounds on the log masses of hypotheses that were not sampled.

    Args:
        approximate: log of prior weight times evidence, approximately, of all hypotheses.
    """
    excess = max((sampled[h] - approximate[h].log_evidence for h in sampled), default=0.0)
    return {
        h: estimate.log_evidence + max(excess, STANDARD_ERRORS * max(estimate.error, LEAST_ERROR))
        for h, estimate in approximate.items()
        if h not in sampled
    }


def most_probability_unsampled(
    approximate: Mapping[H, Estimate], sampled: Mapping[H, float]
) -> float:
    """An upper bound on the probability of all hypotheses together that were not sampled."""
    bounds = list(unsampled_bounds(approximate, sampled).values())
    if not bounds:
        return 0.0
    return float(np.exp(logsumexp(bounds) - logsumexp([*bounds, *sampled.values()])))


def to_sample(
    approximate: Mapping[H, Estimate],
    sampled: Mapping[H, float],
    most_unsampled: float,
    most: int | None = None,
) -> Sequence[H]:
    """The hypotheses to sample next; none where sampling those left would change too little.

    Those with the lowest bounds are left out, as long as their bounds exceed what they have
    approximately by less than the permitted share of what all hypotheses have. The most probable
    one is sampled.

    Args:
        approximate: as in :func:`unsampled_bounds`, and ``sampled``.
        most: largest number of hypotheses that are sampled, if limited. Then only such are as have
            more than the permitted probability each: where it rests on many, sampling a few of
            them decides nothing.
    """
    bounds = unsampled_bounds(approximate, sampled)
    total = logsumexp([sampled.get(h, each.log_evidence) for h, each in approximate.items()])
    left_over = 0.0
    chosen = dict.fromkeys(h for h in approximate if h in bounds)
    by_bound = sorted(bounds, key=lambda h: bounds[h])
    for h in by_bound if sampled else by_bound[:-1]:
        left_over += math.exp(bounds[h] - total) - math.exp(approximate[h].log_evidence - total)
        if left_over >= most_unsampled:
            break
        del chosen[h]
    if most is None:
        return list(chosen)
    by_probability = sorted(chosen, key=lambda h: -bounds[h])
    alone = [h for h in by_probability if math.exp(bounds[h] - total) > most_unsampled]
    if not sampled:
        alone = alone or by_probability[:1]
    return alone[: max(most - len(sampled), 0)]
