"""Posterior draws reweighted to a model class with something changed: its priors or likelihood.

The draws of a class have the density p(D|θ) p(θ) / Z. Under the changed class, each draw has the
weight p'(D|θ) p'(θ) / (p(D|θ) p(θ)), whose mean over the draws is Z'/Z, the ratio of the evidences.
The shape k of the weights' tail says whether they can be trusted (Vehtari, Simpson, Gelman, Yao and
Gabry 2024, Pareto smoothed importance sampling). From k = 1/2 on their variance is not finite, and
errors count what the tail holds beyond the largest weight drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.known_modes import draws_with_shapes
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.diagnostics import PARETO_K_LIMIT, pareto_tail
from bayes_ssi.inference.sampling.estimates import Estimate

# Where no weight is larger than this multiple of the mean, there is no tail to judge.
NO_TAIL = 3.0
# Draws stop at the bounds of the prior that they were sampled with. Beyond a bound, a posterior
# that falls off by its standard deviation has about half of what it has within one standard
# deviation of it: with this share there, one hundredth of the evidence, or 0.01 nats, is not seen.
SHARE_AT_BOUND = 0.02


@dataclass(frozen=True)
class ParameterSpread(Summary):
    """Summary of a parameter with the standard error of the mean."""

    mean_error: float


@dataclass(frozen=True, eq=False)
class Reweighted:
    """A posterior under a changed model class.

    Attributes:
        changed: that class.
        values: (m, n_parameters), its draws.
        weights: (m,), of the draws under the changed class; they add up to one.
        log_ratio: log evidence of the changed class less that of the class as sampled, in nats.
        pareto_k: shape of the weights' tail; -inf where they have none.
        problem: why the weights cannot be trusted; empty where they can.
    """

    posterior: Posterior
    changed: ModelClass
    values: FloatArray
    weights: FloatArray
    log_ratio: Estimate
    pareto_k: float
    problem: str

    @property
    def log_evidence(self) -> Estimate:
        """The log evidence of the changed class."""
        evidence = self.posterior.evidence
        return Estimate(
            evidence.log_evidence + self.log_ratio.log_evidence,
            math.hypot(evidence.error, self.log_ratio.error),
        )

    @cached_property
    def before(self) -> tuple[ParameterSpread, ...]:
        """The parameters under the class as sampled, by the same draws."""
        return spreads_of(self.posterior, self.values)

    @cached_property
    def parameters(self) -> tuple[ParameterSpread, ...]:
        """The parameters under the changed class."""
        return spreads(self.posterior, self.values, self.weights)


def reweighted(posterior: Posterior, known: ModelClass, changed: ModelClass) -> Reweighted:
    """The posterior of a class that differs from the sampled one in priors or likelihood.

    Args:
        known: that class, with modes known at draws, from
            :func:`~bayes_ssi.inference.posterior.known_modes.known_at_draws`.
        changed: ``known`` with something changed; its parameters have the same names.
    """
    draws = draws_with_shapes(len(posterior.values))
    values = posterior.values[draws]
    log_weights = changed.log_likelihood(values) - posterior.log_likelihoods.ravel()[draws]
    log_weights = log_weights + _log_prior_ratios(known, changed, values)
    top = float(log_weights.max())
    if not math.isfinite(top):
        nothing = np.full(len(values), 1.0 / len(values))
        no_estimate = Estimate(top, math.inf)
        problem = "no draw is possible in the changed class"
        return Reweighted(posterior, changed, values, nothing, no_estimate, math.inf, problem)
    ratios = np.exp(log_weights - top)
    mean, n = float(ratios.mean()), _n_independent(posterior, len(values))
    tail = pareto_tail(ratios)
    k, unseen = tail.k, tail.beyond_the_largest(n)
    if ratios.max() <= NO_TAIL * mean:
        k, unseen = -math.inf, 0.0
    error = math.hypot(float(ratios.std()) / math.sqrt(n), unseen) / mean
    log_ratio = Estimate(top + math.log(mean), error)
    weights = ratios / ratios.sum()
    problem = _problem(known, changed, values, weights, k, n)
    return Reweighted(posterior, changed, values, weights, log_ratio, k, problem)


def spreads_of(
    posterior: Posterior, values: FloatArray | None = None
) -> tuple[ParameterSpread, ...]:
    """Every parameter of a posterior by draws (m, d) of it, all if None."""
    draws = posterior.values if values is None else values
    return spreads(posterior, draws, np.full(len(draws), 1.0 / len(draws)))


def spreads(
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
        for end, (old, new) in enumerate(
            zip(before.prior.support, after.prior.support, strict=True)
        ):
            beyond = new < old if end == 0 else new > old
            if beyond and reaches_bound(x, old, end, weights):
                return (
                    f"the prior of {before.name!r} now reaches beyond {old:g}, where the posterior "
                    "had not died out and nothing was sampled"
                )
    return ""


def reaches_bound(x: FloatArray, bound: float, end: int, weights: FloatArray | None = None) -> bool:
    """Whether a posterior has not died out at a bound of its prior.

    Args:
        x: (m,), draws of the parameter.
        bound: may be infinite.
        weights: (m,), of the draws, which add up to one; equal if None.
    """
    w = np.full(len(x), 1.0 / len(x)) if weights is None else weights
    sd = math.sqrt(float((w * (x - (w * x).sum()) ** 2).sum()))
    near = x < bound + sd if end == 0 else x > bound - sd
    return float(w[near].sum()) > SHARE_AT_BOUND
