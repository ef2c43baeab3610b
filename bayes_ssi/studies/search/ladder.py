"""The ladder of efforts: all hypotheses with little effort, and those that matter with more.

Hypotheses on finite-element models that can be computed together begin with a look, too many others
with a scan, a moderate number with a quick effort, and few with full effort. From each effort the
best go on to the next, until those left cannot matter. Sampling is the last: the answer is to rest
hardly on the others.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.search.approximate_evidence import Screened, ToScreen, screen_all
from bayes_ssi.studies.search.efforts import EFFORTS, Effort, Efforts
from bayes_ssi.studies.search.greatest_likelihood import looks_at

H = TypeVar("H", bound=Hashable)


class _Step(NamedTuple):
    """Which hypotheses go on to an effort, the highest first."""

    effort: Effort
    most: int  # number of these
    at_once: int | None = None  # so many go on between two judgements of those left; all if None
    least: float = -math.inf  # those lower than this stay, a log mass;
    share_left: float = 0.0  # and those that together have no more than this share of the others


def screen_best(
    hypotheses: Sequence[ToScreen],
    weights: Sequence[float],
    n_features: int,
    seed: int,
    run: Run,
    log_mass_of_fewer: float = -math.inf,
    efforts: Efforts = EFFORTS,
) -> list[Screened]:
    """Screen hypotheses with one number of features, the better ones with more effort.

    Args:
        weights: prior weights.
        seed: a result follows from it, the hypothesis's name, the effort, and the simpler one's
            result.
        log_mass_of_fewer: log of prior weights times evidences, summed over the hypotheses with
            fewer features.
    """
    n, log_weights = len(hypotheses), np.log(weights)
    if n_features <= 1 and n <= efforts.most_full:
        return screen_all(hypotheses, seed, run, efforts.full)

    def log_masses(results: Mapping[int, Screened]) -> FloatArray:
        return np.array([log_weights[i] + each.log_evidence for i, each in results.items()])

    def going_on(heights: FloatArray, step: _Step) -> dict[int, Screened]:
        """The results of those that go on, by number; ``heights`` (n,) are log masses so far."""
        order = np.argsort(-heights, kind="stable")
        left = np.logaddexp.accumulate(heights[order][::-1])[::-1]
        chosen = [int(i) for i in order[: step.most] if heights[i] >= step.least]
        results: dict[int, Screened] = {}
        while len(results) < len(chosen):
            if results and step.share_left:
                least = logsumexp(log_masses(results)) + math.log(step.share_left)
                if left[len(results)] < least:
                    break
            begin = len(results)
            some = chosen[begin : begin + (step.at_once or len(chosen))]
            screened = screen_all([hypotheses[i] for i in some], seed, run, step.effort)
            results.update(zip(some, screened, strict=True))
        return results

    most = n if n_features == 1 else efforts.most_several
    results: dict[int, Screened]
    if len(looks := looks_at(hypotheses, seed, run)) == n:
        bounds = log_weights + [looks[i].greatest for i in range(n)]
        results = going_on(
            bounds,
            _Step(efforts.quick, most, efforts.most_full, share_left=efforts.share_left_out),
        )
        gaps = [looks[i].greatest - each.log_evidence for i, each in results.items()]
        gap = float(np.median(gaps))
        names = [each.model_class.parameter_names for each in hypotheses]
        results = {i: looks[i].as_screened(names[i], gap) for i in range(n)} | results
    elif n > most:
        results = dict(enumerate(screen_all(hypotheses, seed, run, efforts.scan)))
        results |= going_on(log_masses(results), _Step(efforts.quick, most))
    else:
        results = dict(enumerate(screen_all(hypotheses, seed, run, efforts.quick)))
    of_all = np.logaddexp(log_mass_of_fewer, logsumexp(log_masses(results)))
    least = float(of_all) + math.log(efforts.share_for_full)
    results |= going_on(log_masses(results), _Step(efforts.full, efforts.most_full, least=least))
    return [results[i] for i in range(n)]


def unsampled_bounds(
    approximate: Mapping[H, Estimate], sampled: Mapping[H, float]
) -> dict[H, float]:
    """Upper bounds on the log masses of hypotheses that were not sampled.

    An approximation is at most its errors too low, or as much as the worst of those sampled.

    Args:
        approximate: log of prior weight times evidence, approximately, of all hypotheses.
    """
    excess = max((sampled[h] - approximate[h].log_evidence for h in sampled), default=0.0)
    bounds = {}
    for h, estimate in approximate.items():
        if h not in sampled:
            error = EFFORTS.errors_too_low * max(estimate.error, EFFORTS.least_error)
            bounds[h] = estimate.log_evidence + max(excess, error)
    return bounds


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
