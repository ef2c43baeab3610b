"""Model classes with a setting varied, by the posterior draws that there are.

The draws of a class have the density p(D|θ) p(θ) / Z. Under the varied class, each draw has the
weight p'(D|θ) p'(θ) / (p(D|θ) p(θ)), whose mean over the draws is Z'/Z, the ratio of the evidences.
The shape k of the weights' tail says whether they can be trusted (Vehtari, Simpson, Gelman, Yao and
Gabry 2024, Pareto smoothed importance sampling). From k = 1/2 on their variance is not finite, and
errors count what the tail holds beyond the largest weight drawn. Where they cannot be trusted, the
varied class can be sampled.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import pareto_k
from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior, draws_with_shapes
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.inference.sampling.importance import PARETO_K_LIMIT
from bayes_ssi.parameters.priors import Prior, Widened

# Weights of no more than this multiple of the mean have no tail to judge.
UNTAILED_WEIGHT = 3.0
# Of a posterior within its standard deviation of a bound, where it has half as much beyond: one
# hundredth of the evidence, or 0.01 nats, is not seen.
SHARE_AT_BOUND = 0.02

Variation = Callable[[ModelClass], ModelClass]


def with_missed(factor: float, candidate: ModelClass) -> ModelClass:
    """The class with ``factor`` times as many modes missed; detection is at most halved."""
    missed = 1.0 - candidate.identification.detection_probability
    detection = 1.0 - min(factor * missed, 0.5 * (1.0 + missed))
    changed = replace(candidate.identification, detection_probability=detection)
    return replace(candidate, identification=changed)


def with_spurious(factor: float, candidate: ModelClass) -> ModelClass:
    expected = factor * candidate.identification.expected_spurious_modes
    changed = replace(candidate.identification, expected_spurious_modes=expected)
    return replace(candidate, identification=changed)


def with_wider_priors(factor: float, names: Collection[str], candidate: ModelClass) -> ModelClass:
    """The class with wider priors of some parameters."""
    wider = {p.name: Widened(p.prior, factor) for p in candidate.parameters if p.name in names}
    return with_priors(wider, candidate)


def with_priors(priors: Mapping[str, Prior], candidate: ModelClass) -> ModelClass:
    """The class with other priors of those of the parameters that it has."""
    own = {name: prior for name, prior in priors.items() if name in candidate.parameter_names}
    return replace(candidate, priors={**candidate.priors, **own}) if own else candidate


@dataclass(frozen=True)
class ParameterSpread(Summary):
    mean_error: float


@dataclass(frozen=True, eq=False)
class Varied:
    """What a varied class is known by: draws of the class as sampled, or as sampled again."""

    posterior: Posterior  # whose draws these are
    changed: ModelClass  # the varied class
    values: FloatArray  # (m, n_parameters), draws
    weights: FloatArray  # (m,), of the draws under the varied class; they add up to one
    log_evidence: Estimate  # of the varied class, in nats
    log_ratio: Estimate  # the same less that of the class as sampled at first
    pareto_k: float  # shape of the weights' tail; -inf where they have none
    problem: str  # why this cannot be trusted; empty where it can

    @cached_property
    def parameters(self) -> tuple[ParameterSpread, ...]:
        return _spreads(self.posterior, self.values, self.weights)


def sampled_again(changed: ModelClass, before: Posterior, again: Posterior) -> Varied:
    """The answer of the varied class's own posterior, ``again``."""
    old, new, n = before.evidence, again.evidence, len(again.values)
    log_evidence, equal = Estimate(new.log_evidence, new.error), np.full(n, 1.0 / n)
    ratio = Estimate(new.log_evidence - old.log_evidence, math.hypot(old.error, new.error))
    problem = "; ".join(again.failed_checks)
    return Varied(again, changed, again.values, equal, log_evidence, ratio, -math.inf, problem)


def reweighted(posterior: Posterior, known: ModelClass, changed: ModelClass) -> Varied:
    """The posterior of a class that differs from the sampled one in priors or likelihood.

    ``known`` is the sampled class, with modes known at draws, and ``changed`` follows from it.
    """
    draws = draws_with_shapes(len(posterior.values))
    values = posterior.values[draws]
    evidence, n_draws = posterior.evidence, len(values)

    def answer(weights: FloatArray, log_ratio: Estimate, k: float, problem: str) -> Varied:
        error = math.hypot(evidence.error, log_ratio.error)
        log_evidence = Estimate(evidence.log_evidence + log_ratio.log_evidence, error)
        return Varied(posterior, changed, values, weights, log_evidence, log_ratio, k, problem)

    def no_answer(problem: str) -> Varied:
        equal = np.full(n_draws, 1.0 / n_draws)
        return answer(equal, Estimate(-math.inf, math.inf), math.inf, problem)

    if changed.parameter_names != known.parameter_names:
        return no_answer("the changed class has other parameters")
    log_weights = changed.log_likelihood(values) - posterior.log_likelihoods.ravel()[draws]
    log_weights = log_weights + _log_prior_ratios(known, changed, values)
    top = float(log_weights.max())
    if not math.isfinite(top):
        return no_answer("no draw is possible in the changed class")
    ratios = np.exp(log_weights - top)
    mean, n = float(ratios.mean()), _n_independent(posterior, n_draws)
    untailed = ratios.max() <= UNTAILED_WEIGHT * mean
    k = -math.inf if untailed else pareto_k(log_weights)
    # The mean of a power law beyond the largest weight w, which one in n exceeds, is w / (1 - k).
    unseen = float(ratios.max()) / (n * (1.0 - k)) if k < 1.0 else math.inf
    error = math.hypot(float(ratios.std()) / math.sqrt(n), unseen) / mean
    weights = ratios / ratios.sum()
    problem = _problem(known, changed, values, weights, k, n)
    return answer(weights, Estimate(top + math.log(mean), error), k, problem)


def spreads_as_sampled(posterior: Posterior) -> tuple[ParameterSpread, ...]:
    """The parameters of a posterior, by the draws that are reweighted."""
    values = posterior.values[draws_with_shapes(len(posterior.values))]
    return _spreads(posterior, values, np.full(len(values), 1.0 / len(values)))


def _spreads(
    posterior: Posterior, values: FloatArray, weights: FloatArray
) -> tuple[ParameterSpread, ...]:
    """Every parameter of a posterior by draws ``values`` (m, d) of it, weighted (m,)."""
    # Of m draws that depend on one another, n count.
    inflation = len(values) / _n_independent(posterior, len(values))
    rows = []
    for name, x in zip(posterior.parameter_names, values.T, strict=True):
        mean = float((weights * x).sum())
        error = math.sqrt(inflation * float((weights**2 * (x - mean) ** 2).sum()))
        rows.append(ParameterSpread.weighted(name, x, weights, mean_error=error))
    return tuple(rows)


def _n_independent(posterior: Posterior, m: int) -> float:
    """The number of independent draws that ``m`` evenly spaced ones of a posterior amount to."""
    return min(float(posterior.effective_sample_sizes.min()), float(m))


def _log_prior_ratios(known: ModelClass, changed: ModelClass, values: FloatArray) -> FloatArray:
    """Log of the new prior density over the old one, (m,), at ``values`` (m, d)."""
    total = np.zeros(len(values))
    for before, after, x in zip(known.parameters, changed.parameters, values.T, strict=True):
        if after.prior != before.prior:
            total += after.prior.log_density(x) - before.prior.log_density(x)
    return total


def _problem(
    known: ModelClass,
    changed: ModelClass,
    values: FloatArray,
    weights: FloatArray,
    k: float,
    n_independent: float,
) -> str:
    # Few draws allow less (Vehtari et al. 2024, section 3.2.4).
    limit = min(PARETO_K_LIMIT, 1.0 - 1.0 / math.log10(max(n_independent, 2.0)))
    if not k <= limit:
        return f"the draws do not cover the changed class: Pareto k is {k:.2f}, above {limit:.2g}"
    for before, after, x in zip(known.parameters, changed.parameters, values.T, strict=True):
        ends = zip(before.prior.support, after.prior.support, strict=True)
        for end, (old, new) in enumerate(ends):
            beyond = new < old if end == 0 else new > old
            if beyond and reaches_bound(x, old, end, weights):
                return (
                    f"the prior of {before.name!r} now reaches beyond {old:g}, where the posterior "
                    "had not died out and nothing was sampled"
                )
    return ""


def reaches_bound(x: FloatArray, bound: float, end: int, weights: FloatArray | None = None) -> bool:
    """Whether a posterior, of draws ``x`` (m,), has not died out at a bound of its prior.

    The bound may be infinite; ``weights`` (m,) add up to one, and are equal if None.
    """
    w = np.full(len(x), 1.0 / len(x)) if weights is None else weights
    sd = math.sqrt(float((w * (x - (w * x).sum()) ** 2).sum()))
    near = x < bound + sd if end == 0 else x > bound - sd
    return float(w[near].sum()) > SHARE_AT_BOUND
