"""Stored records of model classes: for results, and to recognise a class again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from bayes_ssi.inference.likelihood.error_model import ErrorModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.description import described, in_words
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.prior import Prior


@dataclass(frozen=True)
class ParameterRecord:
    """An inferred parameter.

    Attributes:
        prior_quantiles: 5, 50 and 95 % quantiles of its prior.
    """

    name: str
    unit: str
    prior: Prior
    prior_quantiles: tuple[float, float, float]
    is_error: bool


@dataclass(frozen=True)
class ConfigurationRecord:
    """One configuration of a model class.

    Attributes:
        name: name of the configuration; empty where there is only one.
        definition: ``repr`` of the structure.
        degrees_of_freedom: degrees of freedom of the structure.
        pairing: label of an identified mode → number of the model mode; None where it is inferred.
        spurious: labels of the identified modes that are not paired; None where that is inferred.
        identification_errors: label → name of the error → its size, None where not given.
        covariance_digest: of the joint covariance of these errors; None where they are independent.
    """

    name: str
    structure: str
    definition: str
    parameters: tuple[str, ...]
    structure_lines: tuple[tuple[str, str], ...]
    degrees_of_freedom: tuple[str, ...]
    pairing: Mapping[str, int] | None
    spurious: tuple[str, ...] | None
    identification_errors: Mapping[str, Mapping[str, float | None]]
    covariance_digest: str | None
    data_digest: str


@dataclass(frozen=True)
class ClassRecord:
    """A model class; ``error_sizes`` describes its error model in words."""

    name: str
    description: str
    configurations: tuple[ConfigurationRecord, ...]
    error: ErrorModel
    error_sizes: Mapping[str, str]
    parameters: tuple[ParameterRecord, ...]
    detection_probability: float
    expected_spurious_modes: float
    data_digest: str


def class_record(model_class: ModelClass) -> ClassRecord:
    """The record of a model class."""
    return ClassRecord(
        name=model_class.name,
        description=model_class.description,
        configurations=tuple(map(_configuration, model_class.configurations)),
        error=model_class.error,
        error_sizes={
            each.name: in_words(getattr(model_class.error, each.name))
            for each in fields(model_class.error)
        },
        parameters=tuple(
            ParameterRecord(
                p.name,
                p.unit,
                p.prior,
                (p.prior.quantile(0.05), p.prior.quantile(0.5), p.prior.quantile(0.95)),
                is_error=p not in model_class.structural_parameters,
            )
            for p in model_class.parameters
        ),
        detection_probability=model_class.identification.detection_probability,
        expected_spurious_modes=model_class.identification.expected_spurious_modes,
        data_digest=model_class.data_digest,
    )


def _configuration(configuration: Configuration) -> ConfigurationRecord:
    structure, data, pairing = configuration.structure, configuration.data, configuration.pairing
    given = None if pairing == "any" else pairing
    return ConfigurationRecord(
        name=configuration.name,
        structure=type(structure).__name__,
        definition=repr(structure),
        parameters=tuple(parameter.name for parameter in structure.parameters),
        structure_lines=tuple(described(structure)),
        degrees_of_freedom=tuple(structure.degrees_of_freedom),
        pairing=given,
        spurious=None
        if given is None
        else tuple(label for label in data.labels if label not in given),
        identification_errors={
            mode.label: {"frequency_cov": mode.frequency_cov, "shape_sd": mode.shape_sd}
            for mode in data.modes
        },
        covariance_digest=data.covariance_digest,
        data_digest=data.digest,
    )
