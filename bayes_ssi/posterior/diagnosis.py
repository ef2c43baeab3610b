"""What would make a class that does not explain the data do so: hints at mistakes.

Mistakes are undone one at a time: two sensors exchanged, a sensor's sign, the unit of the
frequencies, the pairing. Each class that results is fitted in two steps. Its likelihood at points
where the model's modes are computed once, for all mistakes, selects the few that are worth an
ascent to the maximum of likelihood times prior. The gain is the rise of this maximum, in nats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.execution.workers import Workers
from bayes_ssi.identification.any_pairing import AnyPairing
from bayes_ssi.identification.inferred_pairing import infer_pairing
from bayes_ssi.modal import Modes
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.adequacy import LIMIT, Hint, adequacy
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.repairs import (
    Repair,
    common_factor,
    repair_of_pairing,
    repairs_of_frequencies,
    repairs_of_shapes,
    repairs_of_single_shapes,
)
from bayes_ssi.sampling.maxima import ascend
from bayes_ssi.sampling.resampling import evenly_spaced_indices
from bayes_ssi.sampling.target import Target, log_standard_normal

# Points at which all repairs are compared: of the posterior, which the mistake distorts, and of
# the prior, which it does not.
POSTERIOR_POINTS, PRIOR_POINTS = 16, 64
# The best of each kind of repair that are fitted.
FITTED = 3


def diagnose(
    model_class: ModelClass, posterior: Posterior, workers: Workers | None = None
) -> tuple[Hint, ...]:
    """Hints at mistakes without which the class would explain the data, the largest gain first.

    A hint must be a hundred times as probable as chance, among as many as were tried, the class
    without the mistake must be adequate, and no other hint may be a hundred times as probable.

    Args:
        model_class: a class that is not adequate.
        posterior: its posterior.
        workers: where the model is evaluated; in this process if None.
    """
    points = _points(model_class, posterior)
    modes = [likelihood.modes(own) for _, likelihood, own in model_class.parts(points.values)]
    kinds = [
        repairs_of_shapes(model_class),
        repairs_of_single_shapes(model_class),
        repairs_of_frequencies(model_class),
        list(repair_of_pairing(model_class)),
        list(common_factor(model_class)),
    ]
    best = _log_maximum(model_class, posterior)
    least_gain = math.log(sum(map(len, kinds)) / LIMIT)
    hints: list[Hint] = []
    for kind in kinds:
        if kind is kinds[-1] and hints:
            break  # a factor that is no unit needs a better reason
        scored = [(each, _log_posteriors(each, points, modes)) for each in kind]
        scored.sort(key=lambda item: -float(item[1].max()))
        for repair, log_posteriors in scored[:FITTED]:
            hint = _fitted(repair, points, int(log_posteriors.argmax()), best, workers)
            if hint.gain > least_gain and not hint.misfit.is_small:
                hints.append(hint)
    hints.sort(key=lambda hint: -hint.gain)
    return tuple(hint for hint in hints if hint.gain > hints[0].gain + math.log(LIMIT))


@dataclass(frozen=True, eq=False)
class _Points:
    """Where repairs are compared: coordinates (n, d) and values (n, d) of named parameters."""

    names: tuple[str, ...]
    z: FloatArray
    values: FloatArray

    def of(self, model_class: ModelClass) -> FloatArray:
        """The coordinates of another class's parameters; those that it alone has are zero."""
        return _renamed(self.z, self.names, model_class.parameter_names)


def _renamed(z: FloatArray, names: Sequence[str], wanted: Sequence[str]) -> FloatArray:
    columns = [z[:, names.index(name)] if name in names else np.zeros(len(z)) for name in wanted]
    return np.column_stack(columns)


def _points(model_class: ModelClass, posterior: Posterior) -> _Points:
    """The maximum of the posterior, some of its draws, the prior median and some prior draws."""
    chosen = evenly_spaced_indices(len(posterior.values), POSTERIOR_POINTS)
    of_posterior = np.concatenate([posterior.maxima[:1], posterior.values[chosen]])
    n = len(model_class.parameters)
    of_prior = np.random.default_rng(0).standard_normal((PRIOR_POINTS, n))
    z = np.concatenate([_coordinates(model_class, of_posterior), np.zeros((1, n)), of_prior])
    return _Points(model_class.parameter_names, z, model_class.values(z))


def _coordinates(model_class: ModelClass, values: FloatArray) -> FloatArray:
    return np.column_stack(
        [p.prior.to_normal(values[:, i]) for i, p in enumerate(model_class.parameters)]
    )


def _log_maximum(model_class: ModelClass, posterior: Posterior) -> float:
    z = _coordinates(model_class, posterior.maxima[:1])
    return float((model_class.log_likelihood_at(z) + log_standard_normal(z))[0])


def _log_posteriors(repair: Repair, points: _Points, modes: Sequence[Modes]) -> FloatArray:
    """Likelihood times prior (n,) at the points, from the model's modes there."""
    changed, z = repair.model_class, points.of(repair.model_class)
    total = log_standard_normal(z) + repair.log_scale
    parts = changed.parts(changed.values(z))
    for (_, likelihood, own), of_test in zip(parts, modes, strict=True):
        total += likelihood.log_density(own, likelihood.compared_modes(own, of_test))
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
    modes = [likelihood.compared_modes(own) for _, likelihood, own in changed.parts(values)]
    return Hint(
        repair.mistake or _other_pairing(repair, values),
        float(log_posteriors[0]) + repair.log_scale - best,
        adequacy(changed, values, modes, np.random.default_rng(0)).overall,
    )


def _other_pairing(repair: Repair, values: FloatArray) -> str:
    """How the best pairing at ``values`` (1, d) differs from the given ones, in words."""
    differences = []
    parts = repair.model_class.parts(values)
    for (test, likelihood, own), given in zip(parts, repair.given_pairings, strict=True):
        if isinstance(likelihood, AnyPairing) and given != "any":
            best = infer_pairing(likelihood, own).best
            differences += [
                f"mode {label_in(test.name, label)!r} seems to be "
                f"{_model_mode(best.get(label))}, not {_model_mode(given.get(label))}"
                for label in test.data.labels
                if best.get(label) != given.get(label)
            ]
    return "; ".join(differences)


def _model_mode(number: int | None) -> str:
    return "spurious" if number is None else f"model mode {number}"
