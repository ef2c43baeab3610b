"""Stored records of model classes: for results, and to recognise a class again."""

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from bayes_ssi.inference.likelihood.error_model import ErrorModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.parameters import Parameter, Product
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.structures.structure import Structure

MOST_CHARACTERS = 300  # length of a few lines of a report; longer fields are cut
# Of an element, because they change nothing.
LEFT_OUT = [("stiffness_factor", 1.0), ("in_model", 0.0)]


def described(structure: Structure) -> list[tuple[str, str]]:
    """Names and texts: what a structure is, and its fields with their numbers and parameters.

    The first line is the structure's name and the first paragraph of its docstring. A structure
    that is not a dataclass is described by its own ``description`` and degrees of freedom.
    """
    lines, elements = [(_words(type(structure).__name__), _first_paragraph(structure))], []
    if is_dataclass(structure):
        values = {each.name: getattr(structure, each.name) for each in fields(structure)}
    else:
        values = {**structure.description(), "degrees of freedom": structure.degrees_of_freedom}
    for name, value in values.items():
        if isinstance(value, (tuple, list)) and value and all(map(_has_fields, value)):
            elements += [(_words(type(item).__name__), _items(item)) for item in value]
        elif text := _cut(in_words(value)):
            lines.append((name.replace("_", " "), text))
    return lines + elements


def _has_fields(value: Any) -> bool:
    return is_dataclass(value) and not isinstance(value, (Parameter, Product))


def _items(item: Any) -> str:
    """The fields of an element, its label first."""
    values = {field.name: getattr(item, field.name) for field in fields(item)}
    parts = [str(values.pop("label"))] if values.get("label") else []
    parts += [
        name.replace("_", " ")
        + (" = " if isinstance(value, (float, Parameter, Product)) else " ")
        + in_words(value)
        for name, value in values.items()
        if (name, value) not in LEFT_OUT
    ]
    return _cut("; ".join(parts))


def in_words(value: Any) -> str:
    """A number, parameter, product, object with fields, or collection of these, for reports."""
    if isinstance(value, Parameter):
        return value.name
    if isinstance(value, Product):
        return repr(value).removeprefix("1 * ").replace(" * ", " · ")
    if _has_fields(value):
        return f"{_words(type(value).__name__)}: {_items(value)}"
    if getattr(value, "shape", ()):  # dense or sparse
        return f"{type(value).__name__} of {' by '.join(map(str, value.shape))}"
    if callable(value):  # its text would contain an address in memory
        return str(getattr(value, "__qualname__", type(value).__name__))
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {in_words(item)}" for key, item in value.items())
    if isinstance(value, (tuple, list)):
        flat = not any(isinstance(item, (tuple, list)) for item in value)
        inner = ", ".join(in_words(item) if flat else f"({in_words(item)})" for item in value)
        same = len(value) > 3 and all(in_words(item) == in_words(value[0]) for item in value[1:])
        return f"{len(value)} times {in_words(value[0])}" if same else inner
    return "" if value is None else str(value)


def _cut(text: str) -> str:
    return text if len(text) <= MOST_CHARACTERS else text[: MOST_CHARACTERS - 3] + "..."


def _words(name: str) -> str:
    """ShearBuilding3D → shear building 3D."""
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z][a-z]+|[a-z]+|[0-9A-Z]+", name)
    return " ".join(part.lower() if part[1:].islower() else part for part in parts)


def _first_paragraph(structure: Structure) -> str:
    text = (inspect.getdoc(type(structure)) or "").strip().split("\n\n")[0]
    # The docstring that a dataclass generates describes nothing.
    own = "" if text.startswith(f"{type(structure).__name__}(") else text
    without_roles = re.sub(r":\w+:`~?([^`]*)`", r"\1", own)
    return " ".join(without_roles.replace("``", "").split())


@dataclass(frozen=True)
class ParameterRecord:
    """An inferred parameter."""

    name: str
    unit: str
    prior: Prior
    is_error: bool


@dataclass(frozen=True)
class ConfigurationRecord:
    """One configuration of a model class."""

    name: str  # name of the configuration; empty where there is only one
    structure: str
    definition: str  # ``repr`` of the structure
    parameters: tuple[str, ...]
    structure_lines: tuple[tuple[str, str], ...]
    degrees_of_freedom: tuple[str, ...]  # degrees of freedom of the structure
    # Label of an identified mode → number of the model mode; None where it is inferred.
    pairing: Mapping[str, int] | None
    # Labels of the identified modes that are not paired; None where that is inferred.
    spurious: tuple[str, ...] | None
    # Label → name of the error → its size, None where not given.
    identification_errors: Mapping[str, Mapping[str, float | None]]
    # Of the joint covariance of these errors; None where they are independent.
    covariance_digest: str | None
    data_digest: str


@dataclass(frozen=True)
class ClassRecord:
    """A model class; ``error_sizes`` describes its error model in words, as far as it is used."""

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
            if model_class.has_shapes or each.name != "shape_sd"
        },
        parameters=tuple(
            ParameterRecord(p.name, p.unit, p.prior, p not in model_class.structural_parameters)
            for p in model_class.parameters
        ),
        detection_probability=model_class.identification.detection_probability,
        expected_spurious_modes=model_class.identification.expected_spurious_modes,
        data_digest=model_class.data_digest,
    )


def _configuration(configuration: Configuration) -> ConfigurationRecord:
    structure, data, pairing = configuration.structure, configuration.data, configuration.pairing
    given = None if pairing == "any" else pairing
    spurious = None if given is None else tuple(x for x in data.labels if x not in given)
    return ConfigurationRecord(
        name=configuration.name,
        structure=type(structure).__name__,
        definition=repr(structure),
        parameters=tuple(parameter.name for parameter in structure.parameters),
        structure_lines=tuple(described(structure)),
        degrees_of_freedom=tuple(structure.degrees_of_freedom),
        pairing=given,
        spurious=spurious,
        identification_errors={
            mode.label: {"frequency_cov": mode.frequency_cov, "shape_sd": mode.shape_sd}
            for mode in data.modes
        },
        covariance_digest=data.covariance_digest,
        data_digest=data.digest,
    )
