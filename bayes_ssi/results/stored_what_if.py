"""What a result says under changed settings.

Model classes of a stored result without its study: their modes are known at stored draws.
"""

from dataclasses import replace

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.likelihood.error_model import IdentificationModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.inference.posterior.posterior import known_structures
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.results.stored_result import AnyResult, StoredResult, as_stored
from bayes_ssi.studies.ranking.changed_settings import (
    ChangedSettings,
    WhatIf,
    with_changed_settings,
)


def recorded_class(stored: StoredResult, name: str) -> ModelClass:
    """A model class, its modes known at the draws at which its posterior keeps shapes."""
    posterior, record = stored.posterior(name), stored.record.model_class(name)
    # A parameter of an error may also be one of a structure: the same object ties them.
    own = {p.name: Parameter(p.name, p.prior, p.unit) for p in record.parameters}
    own.update({p.name: p for p in record.error.parameters})
    tests: list[tuple[ModalData, Pairing, list[Parameter]]] = []
    for each in record.configurations:
        pairing: Pairing = "any" if each.pairing is None else each.pairing
        tests.append((stored.tests[each.name], pairing, [own[name] for name in each.parameters]))
    known = zip(record.configurations, known_structures(posterior, tests), tests, strict=True)
    modes = IdentificationModel(record.detection_probability, record.expected_spurious_modes)
    return ModelClass(
        name,
        error=record.error,
        configurations=[
            Configuration(each.name, structure, data, pairing=pairing)
            for each, structure, (data, pairing, _) in known
        ],
        identification=modes,
        description=record.description,
        priors={p.name: p.prior for p in record.parameters},
    )


@checked
def what_if(result: AnyResult, settings: ChangedSettings) -> WhatIf:
    """The ranking and the parameters of a result under changed settings, in seconds.

    The posterior draws are reweighted: nothing is sampled, and a stored result needs no study file.
    Each class has a Pareto k, which says whether its draws cover the change; beyond 0.7 nothing is
    said of the class, which must be sampled again.

    Args:
        result: a ranking, a stored result, or the path of its directory.
        settings: what is changed.

    Raises:
        ValueError: the result is damaged, or a setting is of none of its classes or not usable.
    """
    stored = as_stored(result)
    weights = stored.record.prior_weights
    known = {each.name: recorded_class(stored, each.name) for each in stored.posteriors}
    answer = with_changed_settings(stored.posteriors, known, weights, settings)
    return replace(answer, failed_data_checks=stored.comparison.failed_data_checks)
