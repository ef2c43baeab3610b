"""What model classes are, as plain records: for results on disk, and to tell classes apart."""

from __future__ import annotations

from typing import Any

from bayes_ssi.codec import to_record
from bayes_ssi.model_class.configuration import Configuration
from bayes_ssi.model_class.description import described, in_words
from bayes_ssi.model_class.model_class import ModelClass

__all__ = ["class_record"]


def class_record(model_class: ModelClass) -> dict[str, Any]:
    """What a class is, for a JSON record; of one configuration without a name, its own keys."""
    tests = [{"name": c.name, **_configuration(c)} for c in model_class.configurations]
    own: dict[str, Any] = {"configurations": tests}
    if model_class.configuration_names == ("",):
        own = _configuration(model_class.configurations[0])
    return {
        "name": model_class.name,
        "description": model_class.description,
        **own,
        "error": repr(model_class.error),
        "error_sizes": {
            "frequency_cov": in_words(model_class.error.frequency_cov),
            "shape_sd": in_words(model_class.error.shape_sd),
        },
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "prior": to_record(p.prior),
                "prior_quantiles": [p.prior.quantile(share) for share in (0.05, 0.5, 0.95)],
            }
            for p in model_class.parameters
        ],
        "detection_probability": model_class.identification.detection_probability,
        "expected_spurious_modes": model_class.identification.expected_spurious_modes,
        "data_digest": model_class.data_digest,
    }


def _configuration(configuration: Configuration) -> dict[str, Any]:
    structure, data, pairing = configuration.structure, configuration.data, configuration.pairing
    given = None if pairing == "any" else pairing
    return {
        "structure": type(structure).__name__,
        "definition": repr(structure),
        "structure_lines": [list(line) for line in described(structure)],
        "degrees_of_freedom": list(structure.degrees_of_freedom),
        "pairing": "any" if given is None else dict(given),
        "spurious": None
        if given is None
        else [label for label in data.labels if label not in given],
        "identification_errors": {
            mode.label: {"frequency_cov": mode.frequency_cov, "shape_sd": mode.shape_sd}
            for mode in data.modes
        },
        "data_digest": data.digest,
    }
