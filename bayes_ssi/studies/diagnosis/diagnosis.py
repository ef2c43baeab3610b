"""Mistakes in the data or in the pairing without which a class would explain them: hints.

Mistakes are undone one at a time: two sensors exchanged, a sensor's sign, the unit of the
frequencies, the pairing. Each class that results is fitted in two steps. Its likelihood at points
where the model's modes are computed once, for all mistakes, selects the few that are fitted by an
ascent to the maximum of likelihood times prior. The gain is the rise of this maximum, in nats.

Where structures are approximate, they are fitted to, and fits that gain are solved exactly. The
errors of data with a joint covariance count as independent here: what is a mistake stands out from
them by far.

Inferred error sizes can absorb a mistake, which the p-values of the class then hardly show; the
gain does. The density of data without a mistake is a density of the data themselves. If the class
is right, its ratio to the class's own density is 1 on average, so that, of n mistakes, one gains
ln(100 n) with a probability of one in a hundred at most (Markov's inequality); maxima stand here
for densities averaged over the prior.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.criticism.adequacy import Hint, adequacy
from bayes_ssi.inference.criticism.misfit import CRITICISM
from bayes_ssi.inference.model_class.configuration import Configuration, label_in
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    is_approximate,
    with_exact_structures,
)
from bayes_ssi.inference.posterior_sampling.sample import emulated_again
from bayes_ssi.inference.sampling.maxima import ascend
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.inference.sampling.target import Target, log_standard_normal
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.modal import Modes
from bayes_ssi.studies.diagnosis.repairs import (
    Repair,
    common_factor,
    repair_of_pairing,
    repairs_of_frequencies,
    repairs_of_shapes,
    repairs_of_single_shapes,
)

# Points at which all repairs are compared: of the posterior, which the mistake distorts, and of
# the prior, which it does not.
POSTERIOR_POINTS, PRIOR_POINTS = 16, 64
# The best of each kind of repair that are fitted.
FITTED = 3


def diagnose(
    model_class: ModelClass, posterior: Posterior, workers: Workers | None = None
) -> tuple[Hint, ...]:
    """Hints at mistakes without which the class would explain the data, the largest gain first.

    The gain of a hint must be one that a right class gives less than one time in a hundred, the
    class without the mistake must be adequate, and no other hint may be a hundred times as
    probable.

    Args:
        workers: where the model is evaluated; in this process if None.
    """
    if posterior.emulators:
        model_class, workers = emulated_again(model_class, posterior), None
    given, model_class = model_class, model_class.with_independent_errors()
    points = _points(model_class, posterior, workers)
    best = _log_maximum(model_class, posterior, climbs=model_class is not given)
    kinds = [
        repairs_of_shapes(model_class),
        repairs_of_single_shapes(model_class),
        repairs_of_frequencies(model_class),
        list(repair_of_pairing(model_class)),
    ]
    least_gain = math.log(sum(map(len, kinds)) / CRITICISM.limit)

    def convincing(repairs: Sequence[Repair]) -> list[Hint]:
        scored = [(each, _log_posteriors(each, points)) for each in repairs]
        scored.sort(key=lambda item: -float(item[1].max()))
        hints = [
            _fitted(repair, points, int(log_posteriors.argmax()), best, workers)
            for repair, log_posteriors in scored[:FITTED]
        ]
        return [each for each in hints if each.gain > least_gain and not each.misfit.is_small]

    hints = [hint for kind in kinds for hint in convincing(kind)]
    if not hints and posterior.adequacy and posterior.adequacy.overall.is_small:
        hints = convincing(list(common_factor(model_class)))
    hints.sort(key=lambda hint: -hint.gain)
    return tuple(hint for hint in hints if hint.gain > hints[0].gain + math.log(CRITICISM.limit))


@dataclass(frozen=True, eq=False)
class _Points:
    """Where repairs are compared: coordinates (n, d) of named parameters, and the modes there."""

    names: tuple[str, ...]
    z: FloatArray
    modes: list[Modes]
    # Configuration of the class → log density (n,) of its data.
    log_densities: Mapping[Configuration, FloatArray]

    @classmethod
    def at(cls, model_class: ModelClass, z: FloatArray, modes: list[Modes]) -> _Points:
        """Points at coordinates ``z`` of a class, with its ``modes`` there."""
        parts = zip(model_class.parts(model_class.values(z)), modes, strict=True)
        densities = {
            test: likelihood.log_density(own, likelihood.compared_modes(own, of_test))
            for (test, likelihood, own), of_test in parts
        }
        return cls(model_class.parameter_names, z, modes, densities)

    def of(self, model_class: ModelClass) -> FloatArray:
        """The coordinates of another class's parameters; those that it alone has are zero."""
        return np.column_stack(
            [
                self.z[:, self.names.index(name)] if name in self.names else np.zeros(len(self.z))
                for name in model_class.parameter_names
            ]
        )


def _points(model_class: ModelClass, posterior: Posterior, workers: Workers | None) -> _Points:
    """The maximum of the posterior, some of its draws, the prior median and some prior draws."""
    chosen = evenly_spaced_indices(len(posterior.values), POSTERIOR_POINTS)
    of_posterior = np.concatenate([posterior.maxima[:1], posterior.values[chosen]])
    n = len(model_class.parameters)
    of_prior = np.random.default_rng(0).standard_normal((PRIOR_POINTS, n))
    z = np.concatenate([_coordinates(model_class, of_posterior), np.zeros((1, n)), of_prior])
    values = model_class.values(z)
    if workers is None:
        return _Points.at(model_class, z, model_class.modes_or_nan(values))
    parts = np.array_split(np.arange(len(z)), min(workers.n_parts, len(z)))
    known = workers.try_each(model_class.modes_or_nan, [values[part] for part in parts])
    kept = np.concatenate([parts[i] for i in sorted(known)])
    of_tests = zip(*(known[i] for i in sorted(known)), strict=True)
    return _Points.at(model_class, z[kept], [joined(of_test) for of_test in of_tests])


def _coordinates(model_class: ModelClass, values: FloatArray) -> FloatArray:
    return np.column_stack(
        [p.prior.to_normal(values[:, i]) for i, p in enumerate(model_class.parameters)]
    )


def _log_maximum(model_class: ModelClass, posterior: Posterior, climbs: bool) -> float:
    """The maximum of likelihood times prior; ``climbs`` where it is not that of the posterior."""
    z = _coordinates(model_class, posterior.maxima[:1])
    if climbs:
        target = Target(model_class.log_likelihood_at, z.shape[1])
        return float(ascend(target, z, np.eye(z.shape[1])[None])[1][0])
    return float((model_class.log_likelihood_at(z) + log_standard_normal(z))[0])


def _log_posteriors(repair: Repair, points: _Points) -> FloatArray:
    """Likelihood times prior (n,) at the points."""
    # Changed data leave the parameters as they are; another pairing may have other errors.
    of_class = repair.model_class if repair.given_pairings else repair.original
    z = points.of(of_class)
    total = log_standard_normal(z) + repair.log_scale
    parts = of_class.parts(of_class.values(z))
    for test, (_, _, own), modes in zip(repair.configurations, parts, points.modes, strict=True):
        if test in points.log_densities:
            total += points.log_densities[test]
        else:
            likelihood = test.likelihood(of_class.error, of_class.identification)
            total += likelihood.log_density(own, likelihood.compared_modes(own, modes))
    return np.where(np.isnan(total), -np.inf, total)


def _fitted(
    repair: Repair, points: _Points, start: int, best: float, workers: Workers | None
) -> Hint:
    """The hint that a repair gives once its class is fitted from one of the points."""
    changed = repair.model_class
    z = points.of(changed)[[start]]
    target = Target(changed.log_likelihood_at, z.shape[1], workers)
    z, log_posteriors = ascend(target, z, np.eye(z.shape[1])[None])
    values = changed.values(z)
    gain = float(log_posteriors[0]) + repair.log_scale - best
    # The approximation may be coarse there; without any gain it is no hint in either case.
    if gain > 0.0 and is_approximate(changed):
        changed = with_exact_structures(changed)
        exact = changed.log_likelihood(values) + log_standard_normal(z)
        gain += float((exact - log_posteriors)[0])
    modes = [likelihood.compared_modes(own) for _, likelihood, own in changed.parts(values)]
    return Hint(
        repair.mistake or _other_pairing(repair, values),
        gain,
        adequacy(changed, values, modes, np.random.default_rng(0)).overall,
    )


def _other_pairing(repair: Repair, values: FloatArray) -> str:
    """How the best pairing at ``values`` (1, d) differs from the given ones, in words."""
    differences = []
    parts = repair.model_class.parts(values)
    for (test, likelihood, own), given in zip(parts, repair.given_pairings, strict=True):
        inferred = likelihood.inferred_pairing(own)
        if inferred is not None and given != "any":
            best = inferred.best
            differences += [
                f"mode {label_in(test.name, label)!r} seems to be "
                f"{_model_mode(best.get(label))}, not {_model_mode(given.get(label))}"
                for label in test.data.labels
                if best.get(label) != given.get(label)
            ]
    return "; ".join(differences)


def _model_mode(number: int | None) -> str:
    return "spurious" if number is None else f"model mode {number}"
