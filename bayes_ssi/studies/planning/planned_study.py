"""From a study to the classes, candidates and aim of a plan, with what is wrong with them said."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import listed_choices, require_known
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import located, require_distinct
from bayes_ssi.studies.planning.layout_values import (
    LayoutSums,
    Quantities,
    Sensors,
    SimulatedPlan,
    Worth,
    class_worth,
    quantity_worth,
)
from bayes_ssi.studies.planning.plan_record import CLASS, PARAMETERS
from bayes_ssi.studies.planning.plan_settings import PLANNING
from bayes_ssi.studies.planning.planned_class import PlannedClass, PlannedTest, terms_of
from bayes_ssi.studies.ranking.study import Study

# Parameter values (B, n_parameters) of a structure → what it predicts, (B,) or (B, q).
Quantity = Callable[[Structure, FloatArray], FloatArray]


class KnownClass(NamedTuple):
    """A class before the planned test; its posterior if there was an earlier one."""

    model_class: ModelClass
    probability: float
    posterior: Posterior | None


def known_classes(study: Study, after: Any) -> list[KnownClass]:
    """The classes with their probabilities; those that hardly any has are left out."""
    for each in study.model_classes:
        if each.error.is_correlated:
            raise ValueError(
                f"plan: model class {each.name!r} has correlated prediction errors, which need a "
                "pairing; that of a planned test is not known before it"
            )
    if after is None:
        study = study.with_any_pairing()
        weights = study.prior_weights or dict.fromkeys(study.names, 1.0)
        total = sum(weights.values())
        return [KnownClass(c, weights[c.name] / total, None) for c in study.model_classes]
    classes = {each.name: each for each in study.model_classes}
    posteriors: Mapping[str, Posterior] = {each.name: each for each in after.posteriors}
    require_known("plan: the study has no model class", posteriors, classes)
    for name, posterior in posteriors.items():
        if posterior.data_digest != classes[name].data_digest:
            raise ValueError(f"plan: the result of model class {name!r} is one of other data")
    rows = [r for r in after.comparison.classes if r.probability >= PLANNING.least_probability]
    total = sum(row.probability for row in rows)
    return [KnownClass(classes[r.name], r.probability / total, posteriors[r.name]) for r in rows]


def planned_classes(
    known: Sequence[KnownClass], name: str, candidates: Sequence[Candidate | str] | None
) -> tuple[PlannedClass, ...]:
    """The classes in one configuration, with all candidates on their structures."""
    tests = [each.model_class.configuration(name or None) for each in known]
    test = PlannedTest.like(tests[0].data)
    structures = [each.structure for each in tests]
    if candidates is None:
        candidates = _default_candidates(structures, tests[0].data.sensors)
    places = [Candidate(each, each) if isinstance(each, str) else each for each in candidates]
    require_distinct(places)
    if ends := [place.name for place in places if place.to is not None]:
        raise ValueError(f"candidate {ends[0]!r}: a sensor has one place, not two")
    for structure, each in zip(structures, known, strict=True):
        structure.sensor_matrix(
            terms_of(places)[0], f"model class {each.model_class.name!r}: candidate"
        )
    places = [located(place, structures[0]) for place in places]
    planned = [
        PlannedClass(c.model_class, structure, tuple(places), test, c.probability, c.posterior)
        for c, structure in zip(known, structures, strict=True)
    ]
    return tuple(map(_made_accurate, planned))


def _made_accurate(planned: PlannedClass) -> PlannedClass:
    """With an approximate structure accurate enough where it will be used."""
    if not planned.structure.is_approximate:
        return planned
    z = planned.draw(PLANNING.n_for_accuracy, np.random.default_rng(0))
    errors = PLANNING.error_share * np.sqrt(np.median(planned.error_variances(z), axis=0))
    values = planned.values(z[:, : planned.n_structural])
    return replace(planned, structure=planned.structure.accurate_at(values, *errors.tolist()))


def _default_candidates(structures: Sequence[Structure], measured: Sequence[str]) -> list[str]:
    """Labels that all classes have: of sensors where a structure defines them, else of all."""
    labels: dict[str, None] = {}
    for structure in structures:
        own = [sensor.label for sensor in structure.sensors]
        own = [*own, *structure.appendages] if own else list(structure.degrees_of_freedom)
        labels.update(dict.fromkeys(own))
    if len(labels) > PLANNING.most_default_candidates:
        labels = dict.fromkeys(measured)
    return [label for label in labels if all(_has(each, label) for each in structures)]


def _has(structure: Structure, label: str) -> bool:
    try:
        structure.sensor_matrix([label])
    except ValueError:
        return False
    return True


def checked_sensors(
    names: Sequence[str], n_sensors: int, fixed: Sequence[str], excluded: Sequence[str]
) -> tuple[Sensors, Sensors]:
    """Candidates in every layout, and those that may be."""
    for what, given in (("fixed", fixed), ("excluded", excluded)):
        require_known(f"plan: {what}: no candidate", given, names)
    if both := sorted(set(fixed) & set(excluded)):
        raise ValueError(f"plan: candidate {both[0]!r} is both fixed and excluded")
    always = tuple(i for i, name in enumerate(names) if name in fixed)
    free = tuple(i for i, name in enumerate(names) if name not in fixed and name not in excluded)
    if not max(1, len(always)) <= n_sensors <= len(always) + len(free):
        raise ValueError(
            f"plan: a layout of {n_sensors} sensors cannot be had: {len(always)} are fixed and "
            f"{len(free)} more may be chosen, {listed_choices([names[i] for i in free])}"
        )
    return always, free


def check_aim(classes: Sequence[PlannedClass], aim: str | Quantity) -> None:
    """Refuse an aim that these classes do not have."""
    if aim == CLASS and len(classes) < 2:
        raise ValueError(
            f"plan: the aim 'class' needs two model classes or more, and {classes[0].name!r} is "
            "alone: classes that differ in their pairing only are one before a test, and "
            "improbable ones are left out after one; choose another aim, such as 'parameters'"
        )
    if isinstance(aim, str) and aim != CLASS:
        names = {p.name for planned in classes for p in planned.parameters[: planned.n_structural]}
        require_known("plan: no aim", [aim], (CLASS, PARAMETERS, *sorted(names)))


def worth_of(plan: SimulatedPlan, aim: str | Quantity) -> Callable[[LayoutSums], Worth]:
    """What layouts are worth for an aim."""
    if aim == CLASS:
        return lambda sums: class_worth(plan, sums)
    quantities = [
        _quantities(planned, own.z[plan.true_class == c], aim)
        for c, (planned, own) in enumerate(zip(plan.classes, plan.draws, strict=True))
    ]
    return lambda sums: quantity_worth(plan, quantities, sums)


def _quantities(planned: PlannedClass, z: FloatArray, aim: str | Quantity) -> Quantities:
    """What the aim is about, at the draws of a class about its own tests, and before the test."""
    d = planned.n_structural
    before = planned.draw(PLANNING.n_for_moments, np.random.default_rng(0))
    if isinstance(aim, str):
        own = [p.name for p in planned.parameters[:d]]
        columns = list(range(d)) if aim == PARAMETERS else [i for i in range(d) if own[i] == aim]
        if not columns:
            return None
        at, earlier = z[..., columns], before[:, columns]
    else:

        def predicted(rows: FloatArray) -> FloatArray:
            answer = aim(planned.structure, planned.values(rows[:, :d]))
            return np.asarray(answer, dtype=float).reshape(len(rows), -1)

        at = predicted(z.reshape(-1, z.shape[-1])).reshape(*z.shape[:2], -1)
        earlier = predicted(before)
    return at, np.cov(earlier, rowvar=False).reshape(at.shape[-1], at.shape[-1])
