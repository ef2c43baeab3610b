"""What if a prior, an error size or another setting were different? Answered from stored draws.

All posteriors are reweighted to the changed settings, and ranked again. Where the draws of a class
do not cover the change, nothing is said of it: it must be sampled again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.criticism.adequacy import N_DRAWS, Adequacy, PValue, adequacy
from bayes_ssi.inference.criticism.misfit_in_words import inadequacy_in_words
from bayes_ssi.inference.model_class.configuration import choose_configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.sampling.resampling import systematic_indices
from bayes_ssi.measurements.modes.identified_mode import checked_band
from bayes_ssi.parameters.parameters import as_product
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.studies.ranking.comparison import can_matter, checked_weights, class_probabilities
from bayes_ssi.studies.ranking.reweighting import ParameterSpread, Reweighted
from bayes_ssi.studies.ranking.variations import Variation, with_bands, with_priors

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
        bands_hz: name of a configuration → lowest and highest frequency of the search; the name
            is empty where there is one configuration.
        prior_weights: name of a model class → its new prior weight.

    Raises:
        ValueError: nothing is changed, or a band is not 0 <= lowest < highest.
        TypeError: a prior is not a prior distribution.
    """

    priors: Mapping[str, Prior] = field(default_factory=dict)
    frequency_cov: float | None = None
    shape_sd: float | None = None
    detection_probability: float | None = None
    expected_spurious_modes: float | None = None
    bands_hz: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    prior_weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if all(getattr(self, each.name) in (None, {}) for each in fields(self)):
            raise ValueError(
                "nothing is changed; give a prior, an error size, a detection probability, an "
                "expected number of spurious modes, a band or a prior weight"
            )
        for name, prior in self.priors.items():
            if not isinstance(prior, Prior):
                raise TypeError(f"prior of {name!r}: must be a prior distribution, got {prior!r}")
        bands = {name: checked_band(band) for name, band in self.bands_hz.items()}
        object.__setattr__(self, "bands_hz", bands)

    def applied_to(self, model_class: ModelClass) -> ModelClass:
        """The class with these settings, as far as they concern it; the same if they do not.

        Raises:
            ValueError: a number is not usable, or a mode lies outside its new band.
        """
        model_class = with_priors(self.priors, with_bands(self.bands_hz, model_class))
        changes: dict[str, Any] = {}
        if sizes := {name: value for name, value in self._given(ERROR_SIZES).items()
                     if is_fixed(model_class, name)}:  # fmt: skip
            changes["error"] = replace(model_class.error, **sizes)
        if given := self._given(IDENTIFICATION):
            changes["identification"] = replace(model_class.identification, **given)
        return replace(model_class, **changes) if changes else model_class

    def _given(self, names: Sequence[str]) -> dict[str, float]:
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    def check(self, model_classes: Sequence[ModelClass]) -> None:
        """Refuse a setting that none of the classes has.

        Raises:
            ValueError: there is no such parameter, configuration or class, or an error size is
                inferred in every class.
        """
        known = dict.fromkeys(name for each in model_classes for name in each.parameter_names)
        require_known("prior: no parameter", self.priors, known)
        for name in self._given(ERROR_SIZES):
            if not any(is_fixed(each, name) for each in model_classes):
                size = getattr(model_classes[0].error, name)
                inferred = ", ".join(repr(p.name) for p in as_product(size).parameters)
                raise ValueError(
                    f"{name}: it is inferred in every model class; change the prior of {inferred}"
                )
        tests = dict.fromkeys(model_classes[0].configuration_names)
        for name in self.bands_hz:
            choose_configuration(tests, name, "the result")


def is_fixed(model_class: ModelClass, error_size: str) -> bool:
    """Whether an error size is a number, rather than inferred."""
    return not as_product(getattr(model_class.error, error_size)).parameters


@dataclass(frozen=True)
class ParameterChange:
    """A parameter before and after; ``after`` is None where the draws do not say."""

    before: ParameterSpread
    after: ParameterSpread | None


@dataclass(frozen=True)
class ChangedClass:
    """A model class before and after.

    Attributes:
        log_evidence_before: in nats.
        log_evidence_after: None where the draws do not say.
        probability_after: None where the draws of any class do not say, and it may matter.
        pareto_k: shape of the weights' tail; -inf where they have none.
        problem: why the draws do not say; empty where they do.
        misfit_before: how far the data are from the class; None where that is not known.
        misfit_after: None also where the draws do not say.
        unexplained: what of the data the class does not explain after the change, in words; empty
            where it explains them, or where that is not known.
    """

    name: str
    log_evidence_before: Estimate
    log_evidence_after: Estimate | None
    probability_before: float
    probability_after: float | None
    pareto_k: float
    problem: str
    misfit_before: PValue | None
    misfit_after: PValue | None
    unexplained: str
    parameters: tuple[ParameterChange, ...]


@dataclass(frozen=True)
class WhatIf:
    """A ranking before and after a change of settings."""

    changes: tuple[str, ...]
    classes: tuple[ChangedClass, ...]
    failed_data_checks: tuple[str, ...] = ()

    @property
    def best_before(self) -> ChangedClass:
        return self.classes[0]

    @property
    def best_after(self) -> ChangedClass | None:
        """The most probable class after the change; None where the draws do not say."""
        known = [(each.probability_after, each) for each in self.classes]
        if any(probability is None for probability, _ in known):
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
    """Rank model classes again, with other settings, by reweighting their draws.

    Args:
        prior_weights: name → prior weight before; equal if None.
    """
    names = [posterior.name for posterior in posteriors]
    settings.check([known[name] for name in names])
    before = checked_weights(names, prior_weights)
    after = checked_weights(names, {**before, **settings.prior_weights})
    by_name = {posterior.name: posterior for posterior in posteriors}
    answers = Variation("", settings.applied_to).reweighted(by_name, known)
    shares = class_probabilities({p.name: p.evidence.log_evidence for p in posteriors}, before)
    new_shares: Mapping[str, float | None] = dict.fromkeys(names)
    log_evidences = {n: answer.log_evidence.log_evidence for n, answer in answers.items()}
    estimated = class_probabilities(log_evidences, after)
    unsaid = [name for name in names if answers[name].problem]
    # Of a class that neither was probable nor becomes so, the draws need not cover the change.
    if not any(can_matter(shares[name]) or can_matter(estimated[name]) for name in unsaid):
        new_shares = estimated
    rows = [_changed_class(answers[name], shares[name], new_shares[name]) for name in names]
    rows.sort(key=lambda row: -row.probability_before)
    return WhatIf(tuple(_phrases(settings, known, before)), tuple(rows))


def _changed_class(
    answer: Reweighted, probability_before: float, probability_after: float | None
) -> ChangedClass:
    evidence, fit = answer.posterior.evidence, answer.posterior.adequacy
    trusted = not answer.problem
    fit_after = _adequacy(answer) if trusted and fit else None
    if fit and fit_after:  # a mistake in the data is there whatever the settings
        fit_after = replace(fit_after, hints=fit.hints)
    after = answer.parameters if trusted else [None] * len(answer.before)
    return ChangedClass(
        name=answer.posterior.name,
        log_evidence_before=Estimate(evidence.log_evidence, evidence.error),
        log_evidence_after=answer.log_evidence if trusted else None,
        probability_before=probability_before,
        probability_after=probability_after,
        pareto_k=answer.pareto_k,
        problem=answer.problem,
        misfit_before=fit.overall if fit else None,
        misfit_after=fit_after.overall if fit_after else None,
        unexplained=(
            inadequacy_in_words(fit_after) if fit_after and not fit_after.is_adequate else ""
        ),
        parameters=tuple(
            ParameterChange(old, new) for old, new in zip(answer.before, after, strict=True)
        ),
    )


def _adequacy(answer: Reweighted) -> Adequacy:
    """The adequacy of the changed class, from draws resampled by their weights."""
    changed = answer.changed
    rng = np.random.default_rng(0)
    values = answer.values[systematic_indices(answer.weights, N_DRAWS, rng)]
    modes = [each.compared_modes(own) for _, each, own in changed.parts(values)]
    return adequacy(changed, values, modes, rng)


def _phrases(
    settings: ChangedSettings, known: Mapping[str, ModelClass], weights: Mapping[str, float]
) -> list[str]:
    """What is changed: from what, to what, and in which classes if not in all."""
    phrases = []

    def say(what: str, before: Mapping[str, object], after: object) -> None:
        old = list(dict.fromkeys(map(_text, before.values())))
        where = "" if len(before) == len(known) else f" in {', '.join(map(repr, before))}"
        phrases.append(f"{what}: {' or '.join(old)} → {_text(after)}{where}")

    for name, prior in settings.priors.items():
        own = {c.name: p.prior for c in known.values() for p in c.parameters if p.name == name}
        say(f"prior of {name!r}", own, prior)
    for name, value in settings._given(ERROR_SIZES).items():
        sizes = {c.name: as_product(getattr(c.error, name)).scale for c in known.values()
                 if is_fixed(c, name)}  # fmt: skip
        say(name, sizes, value)
    for name, value in settings._given(IDENTIFICATION).items():
        say(name, {c.name: getattr(c.identification, name) for c in known.values()}, value)
    for test, band in settings.bands_hz.items():
        what = f"band_hz of configuration {test!r}" if test else "band_hz"
        say(what, {c.name: c.configuration(test).data.band_hz for c in known.values()}, band)
    for name, weight in settings.prior_weights.items():
        phrases.append(f"prior weight of {name!r}: {weights[name]:g} → {weight:g}")
    return phrases


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return " to ".join(f"{bound:g}" for bound in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
