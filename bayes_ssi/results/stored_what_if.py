"""What a result says under changed settings.

Model classes of a stored result without its study: their modes are known at stored draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.likelihood.error_model import IdentificationModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.inference.posterior.known_modes import known_at_draws, known_structures
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.results.stored_result import StoredResult, load_result
from bayes_ssi.studies.ranking.changed_settings import (
    ChangedSettings,
    WhatIf,
    with_changed_settings,
)
from bayes_ssi.studies.ranking.sensitivity import Sensitivity, sensitivity
from bayes_ssi.studies.ranking.study import Ranking


def recorded_class(stored: StoredResult, name: str) -> ModelClass:
    """A model class, its modes known at the draws at which its posterior keeps shapes."""
    posterior, record = stored.posterior(name), stored.record.model_class(name)
    # A parameter of an error may also be one of a structure: the same object ties them.
    own = {p.name: Parameter(p.name, p.prior, p.unit) for p in record.parameters}
    own.update({p.name: p for p in record.error.parameters})
    tests: list[tuple[ModalData, Pairing, list[Parameter]]] = [
        (
            stored.tests[each.name],
            "any" if each.pairing is None else each.pairing,
            [own[parameter] for parameter in each.parameters],
        )
        for each in record.configurations
    ]
    structures = known_structures(posterior, tests)
    return ModelClass(
        name,
        error=record.error,
        configurations=[
            Configuration(each.name, structure, data, pairing=pairing)
            for each, structure, (data, pairing, _) in zip(
                record.configurations, structures, tests, strict=True
            )
        ],
        identification=IdentificationModel(
            record.detection_probability, record.expected_spurious_modes
        ),
        description=record.description,
        priors={p.name: p.prior for p in record.parameters},
    )


@checked
def what_if(result: Ranking | StoredResult | str | Path, settings: ChangedSettings) -> WhatIf:
    """The ranking and the parameters of a result under changed settings, in seconds.

    The posterior draws are reweighted: nothing is sampled, no mode is solved for, and a stored
    result needs no study file. Each class has a Pareto k, which says whether its draws cover the
    change; beyond 0.7 nothing is said of the class, which must be sampled again.

    Args:
        result: a ranking, a stored result, or the path of its directory.
        settings: what is changed.

    Raises:
        ValueError: the result is damaged, or a setting is of none of its classes or not usable.
    """
    result = load_result(result) if isinstance(result, (str, Path)) else result
    answer = with_changed_settings(result.posteriors, *_known(result), settings)
    return replace(answer, failed_data_checks=result.comparison.failed_data_checks)


def every_setting(result: Ranking | StoredResult) -> Sensitivity:
    """The ranking with every setting halved and doubled, in seconds.

    Raises:
        ValueError: a posterior keeps no mode shapes at its draws.
    """
    return sensitivity(result.posteriors, *_known(result))


def _known(
    result: Ranking | StoredResult,
) -> tuple[dict[str, ModelClass], Mapping[str, float] | None]:
    """Model classes whose modes are known at their draws, and their prior weights."""
    if isinstance(result, StoredResult):
        known = {p.name: recorded_class(result, p.name) for p in result.posteriors}
        return known, result.record.prior_weights
    classes = {each.name: each for each in result.study.model_classes}
    known = {p.name: known_at_draws(classes[p.name], p) for p in result.posteriors}
    return known, result.study.prior_weights
