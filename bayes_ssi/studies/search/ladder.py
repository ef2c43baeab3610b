"""The ladder of efforts: all hypotheses with little effort, and those that matter with more.

:mod:`~bayes_ssi.studies.search.approximate_evidence` has the table of efforts. From each
the best go on to the next, until those left cannot matter.

A look shows the greatest likelihood, which no evidence exceeds: a hypothesis whose greatest
likelihood is far below the evidence of another needs no more. It is climbed to from a scan of the
new feature's parameters over their priors, the others as in the posterior without it, in common
batches: a sixth of the time of a quick effort.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior_sampling.sample import seed_of
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.inference.sampling.maxima import first_ascent
from bayes_ssi.inference.sampling.mixture import HEAVY_TAILS, StudentMixture
from bayes_ssi.inference.sampling.regions import local_maxima
from bayes_ssi.inference.sampling.target import Target, log_standard_normal
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.finite_elements.projected_structure import all_but_places
from bayes_ssi.studies.search.approximate_evidence import (
    FULL,
    LOOK,
    MOST_FULL,
    QUICK,
    WANTED_ERROR,
    Effort,
    Screened,
    ToScreen,
    scan_draws,
    screen_all,
    together,
    with_more_draws,
)

LEAST_RISE_OF_LOOK = 0.1  # nats of the last step of a look: a bound to a tenth of a nat is enough
MOST_SEVERAL = 300  # hypotheses with several features that go on from a look
SHARE_LEFT_OUT = 1e-3  # of what the others have, for all together that a look leaves out
SHARE_FOR_DRAWS = 1e-4  # many with so little matter together, and draws cost little
# The error of a quick effort in less than this changes no probability by more than a thousandth.
SHARE_FOR_FULL = 3e-3
# An approximate log evidence is too low by so many standard errors at most.
ERRORS_TOO_LOW = 3.0
LEAST_ERROR = 0.05  # some hundred draws show no smaller ones


def looks_at(hypotheses: Sequence[ToScreen], seed: int, run: Run) -> dict[int, Screened]:
    """Look at those hypotheses that can be computed together, by number.

    The greatest log-likelihood, which the evidence may reach, takes the log evidence's place.

    Others are not on finite-element models in a small basis, or of likelihood zero in all draws.
    """
    some = [
        i
        for i, (model_class, simpler) in enumerate(hypotheses)
        if simpler
        and None not in (all_but_places(each.structure) for each in model_class.configurations)
    ]
    step = f"a look at {len(some)}"
    looks = together(partial(_look, seed=seed), [hypotheses[i] for i in some], run, step)
    return {i: look for i, look in zip(some, looks, strict=True) if look is not None}


def _look(hypothesis: ToScreen, target: Target, seed: int) -> Screened | None:
    """A look at one hypothesis; None where it shows nothing."""
    model_class, simpler = hypothesis
    assert simpler is not None
    rng = np.random.default_rng(seed_of(f"first look at {model_class.name}", seed))
    z = scan_draws(model_class, simpler, LOOK.n_draws, rng)
    log_likelihoods = target.log_likelihood(z)
    possible = np.isfinite(log_likelihoods)
    if not possible.any():
        return None
    starts = local_maxima(z[possible], log_likelihoods[possible])[: LOOK.n_ascents]
    z, log_posteriors = first_ascent(target, starts, LEAST_RISE_OF_LOOK)
    order = np.argsort(-log_posteriors, kind="stable")
    z, log_posteriors = z[order], log_posteriors[order]
    unit, tails = np.eye(z.shape[1])[None], np.array([HEAVY_TAILS])
    return Screened(
        parameter_names=model_class.parameter_names,
        log_evidence=float((log_posteriors - log_standard_normal(z)).max()),
        error=0.0,
        laplace=math.nan,
        n_evaluations=target.n_evaluations,
        maxima=z,
        z=z,
        weights=softmax(log_posteriors),
        mixture=StudentMixture(np.ones(1), z[:1], unit, tails),
    )


H = TypeVar("H", bound=Hashable)


def screen_best(
    hypotheses: Sequence[ToScreen],
    weights: Sequence[float],
    n_features: int,
    seed: int,
    run: Run,
    log_mass_of_fewer: float = -math.inf,
    quick: Effort = QUICK,
    most_full: int = MOST_FULL,
) -> list[Screened]:
    """Screen hypotheses with one number of features, the better ones with more effort.

    A result follows from the seed, the hypothesis's name, the effort, and the simpler one's result.

    Args:
        weights: prior weights.
        log_mass_of_fewer: log of the sum of weights times evidences of those with fewer features.
        quick: the quick effort.
        most_full: number of hypotheses that begin with the full effort, or go on to it.
    """
    n, log_weights = len(hypotheses), np.log(weights)
    if n_features <= 1 and n <= most_full:
        return screen_all(hypotheses, seed, run, FULL)

    def log_masses(results: Mapping[int, Screened]) -> FloatArray:
        return np.array([log_weights[i] + each.log_evidence for i, each in results.items()])

    def going_on(
        heights: FloatArray, effort: Effort, most: int, at_once: int = n, least: float = -math.inf
    ) -> dict[int, Screened]:
        """The results of the highest at least as high as ``least``, by number.

        Where they go on a few at once, those left that cannot matter are not screened.
        """
        order = np.argsort(-heights, kind="stable")
        left = np.logaddexp.accumulate(heights[order][::-1])[::-1]
        chosen = [int(i) for i in order[:most] if heights[i] >= least]
        results: dict[int, Screened] = {}
        while len(results) < len(chosen):
            if results:
                others = logsumexp(log_masses(results)) + math.log(SHARE_LEFT_OUT)
                if left[len(results)] < others:
                    break
            begin = len(results)
            some = chosen[begin : begin + at_once]
            screened = screen_all([hypotheses[i] for i in some], seed, run, effort)
            results.update(zip(some, screened, strict=True))
        return results

    results: dict[int, Screened]
    if looks := looks_at(hypotheses, seed, run):
        bounds = log_weights + [looks[i].log_evidence if i in looks else math.inf for i in range(n)]
        most = n if n_features == 1 else MOST_SEVERAL
        results = going_on(bounds, quick, most, max(most_full, 1))
        gaps = [
            looks[i].log_evidence - each.log_evidence for i, each in results.items() if i in looks
        ]
        gap = float(np.median(gaps)) if gaps else 0.0
        error = gap / ERRORS_TOO_LOW
        results = {
            i: replace(look, log_evidence=look.log_evidence - gap, error=error)
            for i, look in looks.items()
        } | results
    else:
        results = dict(enumerate(screen_all(hypotheses, seed, run, quick)))
    of_all = float(np.logaddexp(log_mass_of_fewer, logsumexp(log_masses(results))))
    least = of_all + math.log(SHARE_FOR_DRAWS)
    rough = [
        i
        for i, mass in zip(results, log_masses(results), strict=True)
        if mass >= least
        and results[i].error > WANTED_ERROR
        and not math.isnan(results[i].laplace)  # no look
    ]
    items = [(hypotheses[i][0], results[i]) for i in rough]
    drawn = with_more_draws(items, seed, run)
    results |= zip(rough, drawn, strict=True)
    least = of_all + math.log(SHARE_FOR_FULL)
    results |= going_on(log_masses(results), FULL, most_full, least=least)
    return [results[i] for i in range(n)]


def unsampled_bounds(
    approximate: Mapping[H, Estimate], sampled: Mapping[H, float]
) -> dict[H, float]:
    """Upper bounds on the log masses of hypotheses that were not sampled.

    An approximation, of which there is one for each hypothesis, is at most its errors too low, or
    as much as the worst of those sampled.
    """
    excess = max((sampled[h] - approximate[h].log_evidence for h in sampled), default=0.0)
    bounds = {}
    for h, estimate in approximate.items():
        if h not in sampled:
            error = ERRORS_TOO_LOW * max(estimate.error, LEAST_ERROR)
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
    one is sampled. If ``most`` limits their number, only such are as have more than the permitted
    probability each: where it rests on many, sampling a few of them decides nothing.
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
