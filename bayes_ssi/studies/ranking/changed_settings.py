"""What if a prior, an error size or another setting were different? Answered from stored draws.

All posteriors are reweighted to the changed settings, and ranked again. Where the draws of a class
do not cover the change, nothing is said of it: it must be sampled again.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import systematic_indices
from bayes_ssi.inference.criticism.adequacy import Adequacy, PValue, adequacy, inadequacy_in_words
from bayes_ssi.inference.criticism.misfit import N_DRAWS
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.parameters.parameters import as_product
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.studies.ranking import variations
from bayes_ssi.studies.ranking.comparison import can_matter, checked_weights, class_probabilities
from bayes_ssi.studies.ranking.variations import ParameterSpread, Varied

ERROR_SIZES = ("frequency_cov", "shape_sd")
IDENTIFICATION = ("detection_probability", "expected_spurious_modes")


@dataclass(frozen=True)
class ChangedSettings:
    """Settings of a study that are changed; what is not given stays as it is.

    Attributes:
        priors: name of a parameter → its new prior, in every class that infers it.
        frequency_cov: prediction error of frequencies, in every class in which it is a number;
            where it is inferred, change its prior.
        shape_sd: prediction error of shapes, likewise.
        detection_probability: probability that a mode in the band is identified.
        expected_spurious_modes: expected number of spurious modes in the band.
        prior_weights: name of a model class → its new prior weight.

    Raises:
        ValueError: nothing is changed.
        TypeError: a prior is not a prior distribution.
    """

    priors: Mapping[str, Prior] = field(default_factory=dict)
    frequency_cov: float | None = None
    shape_sd: float | None = None
    detection_probability: float | None = None
    expected_spurious_modes: float | None = None
    prior_weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if all(getattr(self, each.name) in (None, {}) for each in fields(self)):
            raise ValueError(
                "nothing is changed; give a prior, an error size, a detection probability, an "
                "expected number of spurious modes or a prior weight"
            )
        for name, prior in self.priors.items():
            if not isinstance(prior, Prior):
                raise TypeError(f"prior of {name!r}: must be a prior distribution, got {prior!r}")

    def applied_to(self, model_class: ModelClass) -> ModelClass:
        """The class with these settings, as far as they concern it; the same if they do not.

        Raises:
            ValueError: a number is not usable.
        """
        model_class = variations.with_priors(self.priors, model_class)
        own = _numbers(model_class)
        given = {name: value for name, value in self._numbers.items() if name in own}
        changes: dict[str, Any] = {}
        for part, names in (("error", ERROR_SIZES), ("identification", IDENTIFICATION)):
            if numbers := {name: given[name] for name in names if name in given}:
                changes[part] = replace(getattr(model_class, part), **numbers)
        return replace(model_class, **changes) if changes else model_class

    @property
    def _numbers(self) -> dict[str, float]:
        """Those of the error sizes and probabilities that are given, by name."""
        numbers = {name: getattr(self, name) for name in (*ERROR_SIZES, *IDENTIFICATION)}
        return {name: number for name, number in numbers.items() if number is not None}

    def check(self, model_classes: Sequence[ModelClass]) -> None:
        """Refuse a setting that none of the classes has.

        Raises:
            ValueError: there is no such parameter or class, or an error size is inferred in every
                class.
        """
        known = dict.fromkeys(name for each in model_classes for name in each.parameter_names)
        require_known("prior: no parameter", self.priors, known)
        if self.shape_sd is not None and not any(each.has_shapes for each in model_classes):
            raise ValueError("shape_sd: no shape was identified")
        for name in self._numbers:
            if not any(name in _numbers(model_class) for model_class in model_classes):
                size = getattr(model_classes[0].error, name)
                inferred = ", ".join(repr(p.name) for p in as_product(size).parameters)
                raise ValueError(
                    f"{name}: it is inferred in every model class; change the prior of {inferred}"
                )


def _numbers(model_class: ModelClass) -> dict[str, float]:
    """The error sizes of a class that are not inferred, and its probabilities, by name."""
    sizes = {name: as_product(getattr(model_class.error, name)) for name in ERROR_SIZES}
    fixed = {name: size.scale for name, size in sizes.items() if not size.parameters}
    return fixed | {name: getattr(model_class.identification, name) for name in IDENTIFICATION}


def _in_words(
    settings: ChangedSettings,
    model_classes: Collection[ModelClass],
    prior_weights: Mapping[str, float],
) -> Iterator[str]:
    """What is changed: from what, to what, and in which classes if not in all."""
    known = {
        each.name: _settings_in_words({p.name: p.prior for p in each.parameters}, _numbers(each))
        for each in model_classes
    }
    changed = _settings_in_words(settings.priors, settings._numbers)
    for what, after in changed.items():
        before = {name: words[what] for name, words in known.items() if what in words}
        only = "" if len(before) == len(known) else f" in {', '.join(map(repr, before))}"
        yield f"{what}: {' or '.join(dict.fromkeys(before.values()))} → {after}{only}"
    for name, weight in settings.prior_weights.items():
        yield f"prior weight of {name!r}: {prior_weights[name]:g} → {weight:g}"


def _settings_in_words(priors: Mapping[str, Prior], numbers: Mapping[str, float]) -> dict[str, str]:
    """What a setting is called → its value."""
    words = {f"prior of {name!r}": str(prior) for name, prior in priors.items()}
    return words | {name: f"{number:g}" for name, number in numbers.items()}


@dataclass(frozen=True)
class ParameterChange:
    before: ParameterSpread
    after: ParameterSpread | None  # None where the draws do not say


@dataclass(frozen=True)
class ChangedClass:
    """A model class before and after; what comes after is None where the draws do not say."""

    name: str
    log_evidence_before: Estimate  # in nats
    log_evidence_after: Estimate | None
    probability_before: float
    # None, too, where the draws of another class do not say, and it may matter.
    probability_after: float | None
    pareto_k: float  # shape of the weights' tail; -inf where they have none
    problem: str  # why the draws do not say; empty where they do
    # How far the data are from the class; None where that is not known.
    misfit_before: PValue | None
    misfit_after: PValue | None
    # What of the data the class does not explain after the change, in words; empty where it
    # explains them, or where that is not known.
    unexplained: str
    parameters: tuple[ParameterChange, ...]


@dataclass(frozen=True)
class WhatIf:
    changes: tuple[str, ...]
    classes: tuple[ChangedClass, ...]
    failed_data_checks: tuple[str, ...] = ()

    @property
    def best_before(self) -> ChangedClass:
        return self.classes[0]

    @property
    def best_after(self) -> ChangedClass | None:
        """The most probable class after the change; None where the draws do not say."""
        if any(row.probability_after is None for row in self.classes):
            return None
        return max(self.classes, key=lambda each: each.probability_after or 0.0)

    @property
    def problems(self) -> tuple[str, ...]:
        """Classes whose draws do not say, though it matters, a sentence each."""
        return self._unsaid if self.best_after is None else ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Classes whose draws do not say, but that are too improbable to matter."""
        return () if self.best_after is None else self._unsaid

    @property
    def _unsaid(self) -> tuple[str, ...]:
        return tuple(f"{each.name!r}: {each.problem}" for each in self.classes if each.problem)

    @property
    def misfit(self) -> str:
        """What the best class after the change does not explain, with its name; or empty."""
        best = self.best_after
        return f"{best.name!r}: {best.unexplained}" if best and best.unexplained else ""


def with_changed_settings(
    posteriors: Sequence[Posterior],
    known: Mapping[str, ModelClass],
    prior_weights: Mapping[str, float] | None,
    settings: ChangedSettings,
) -> WhatIf:
    """Rank model classes again, with other settings, by reweighting their draws."""
    by_name = {posterior.name: posterior for posterior in posteriors}
    names = list(by_name)
    settings.check([known[name] for name in names])
    before = checked_weights(names, prior_weights)
    after = checked_weights(names, {**before, **settings.prior_weights})
    answers = {
        name: variations.reweighted(posterior, known[name], settings.applied_to(known[name]))
        for name, posterior in by_name.items()
    }
    shares = class_probabilities({p.name: p.evidence.log_evidence for p in posteriors}, before)
    log_evidences = {name: each.log_evidence.log_evidence for name, each in answers.items()}
    estimated = class_probabilities(log_evidences, after)
    unsaid = [name for name in names if answers[name].problem]
    # Of a class that neither was probable nor becomes so, the draws need not cover the change.
    is_known = not any(can_matter(shares[name]) or can_matter(estimated[name]) for name in unsaid)
    known_after: Mapping[str, float | None] = estimated if is_known else dict.fromkeys(names)
    rows = [_changed_class(by_name[n], answers[n], shares[n], known_after[n]) for n in names]
    rows.sort(key=lambda row: -row.probability_before)
    return WhatIf(tuple(_in_words(settings, known.values(), before)), tuple(rows))


def _changed_class(
    posterior: Posterior, answer: Varied, probability_before: float, probability_after: float | None
) -> ChangedClass:
    evidence, fit = posterior.evidence, posterior.adequacy
    trusted = not answer.problem
    # A mistake in the data is there whatever the settings.
    fit_after = replace(_adequacy(answer), hints=fit.hints) if trusted and fit else None
    before = variations.spreads_as_sampled(posterior)
    after = answer.parameters if trusted else [None] * len(before)
    return ChangedClass(
        name=posterior.name,
        log_evidence_before=Estimate(evidence.log_evidence, evidence.error),
        log_evidence_after=answer.log_evidence if trusted else None,
        probability_before=probability_before,
        probability_after=probability_after,
        pareto_k=answer.pareto_k,
        problem=answer.problem,
        misfit_before=fit.overall if fit else None,
        misfit_after=fit_after.overall if fit_after else None,
        unexplained=(
            inadequacy_in_words(fit_after, posterior.pairing_is_given)
            if fit_after and not fit_after.is_adequate
            else ""
        ),
        parameters=tuple(map(ParameterChange, before, after)),
    )


def _adequacy(answer: Varied) -> Adequacy:
    """The adequacy of the changed class, from draws resampled by their weights."""
    changed = answer.changed
    rng = np.random.default_rng(0)
    values = answer.values[systematic_indices(answer.weights, N_DRAWS, rng)]
    modes = [each.compared_modes(own) for _, each, own in changed.parts(values)]
    return adequacy(changed, values, modes, rng)
