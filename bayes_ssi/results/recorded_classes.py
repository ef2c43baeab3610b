"""Model classes of a stored result without its study: their modes are known at stored draws."""

from __future__ import annotations

from bayes_ssi.inference.likelihood.error_model import IdentificationModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.known_modes import KnownTest, known_structure
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.results.load import StoredResult


def recorded_class(stored: StoredResult, name: str) -> ModelClass:
    """A model class, its modes known at the draws at which its posterior keeps shapes."""
    posterior, record = stored.posterior(name), stored.record.model_class(name)
    # A parameter of an error may also be one of a structure: the same object ties them.
    own = {p.name: Parameter(p.name, p.prior, p.unit) for p in record.parameters}
    own.update({p.name: p for p in record.error.parameters})
    tests = [
        KnownTest(
            each.name,
            stored.tests[each.name],
            "any" if each.pairing is None else each.pairing,
            tuple(own[parameter] for parameter in each.parameters),
        )
        for each in record.configurations
    ]
    return ModelClass(
        name,
        error=record.error,
        configurations=[
            Configuration(
                test.name,
                known_structure(posterior, tests, test.name),
                test.data,
                pairing=test.pairing,
            )
            for test in tests
        ],
        identification=IdentificationModel(
            record.detection_probability, record.expected_spurious_modes
        ),
        description=record.description,
        priors={p.name: p.prior for p in record.parameters},
    )
