"""What a posterior says datum by datum: log-likelihoods, and data as the model would give them.

Packages that compare or criticise models ask for these: leave-one-out cross-validation for the
first, posterior predictive checks for the second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.likelihood.likelihood import ComparedModes
from bayes_ssi.inference.model_class.configuration import label_in, modes_with_shape
from bayes_ssi.inference.model_class.model_class import ModelClass


class AtDraws(NamedTuple):
    """The model at B draws; columns run through all configurations in turn."""

    frequencies_hz: FloatArray  # (B, n_modes), model frequencies
    log_likelihoods: FloatArray  # (B, n_data), log-likelihood of each datum
    # (B, n_identified), standard deviation of each identified frequency about the model's.
    frequency_sds_hz: FloatArray
    # (B, n_shape_pairs), 1 - |φ_e·φ| of the pairs whose shape is scored.
    shape_distances: FloatArray
    # (B, n_pairs_and_sensors), of pairs where errors of shapes are correlated, as in
    # :class:`~bayes_ssi.inference.likelihood.likelihood.ComparedModes`.
    unit_shapes: FloatArray
    # (B, n_components), shapes at the sensors of the modes that the likelihood compares: sensor by
    # sensor, and mode by mode.
    sensor_shapes: FloatArray


@dataclass(frozen=True, eq=False)
class DatumTerms:
    """A posterior datum by datum; labels of several configurations begin with their names."""

    # Names of the data: each identified mode, and the absence of others; or together the modes
    # whose errors are correlated, and all modes of a test whose pairing was inferred.
    data: tuple[str, ...]
    log_likelihoods: FloatArray  # (n_chains, n_steps, n_data); they add up to the log-likelihood
    identified: tuple[str, ...]
    # (n_chains, n_steps, n_identified), identified frequencies drawn from the class: the paired
    # model frequency with its error, or, for a mode that it calls spurious, anything in the band.
    # An inferred pairing is the most probable one.
    predicted_hz: FloatArray


def at_draws(model_class: ModelClass, values: FloatArray) -> AtDraws:
    """The model at ``values`` (B, n_parameters), its modes computed once."""
    parts, of_tests = [], []
    for test, likelihood, columns in model_class.parts(values):
        modes = likelihood.modes(columns)
        compared = likelihood.compared_modes(columns, modes)
        compared_shapes = modes_with_shape(test.data, test.pairing, test.structure.n_modes)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, compared_shapes]
        of_tests.append(compared)
        parts.append(
            AtDraws(
                modes.frequencies_hz,
                likelihood.log_likelihoods(columns, compared),
                likelihood.frequency_sds_hz(columns),
                compared.shape_distances,
                compared.unit_shapes,
                shapes.reshape(len(values), -1),
            )
        )
    model = joined(parts, axis=1)
    groups = _joint_columns(model_class)
    if not groups:
        return model
    terms = model.log_likelihoods
    ratios = model_class.correlated_errors.log_ratios(values, of_tests)
    for group, ratio in zip(groups, ratios.T, strict=True):
        terms[:, group[0]] = terms[:, group].sum(axis=1) + ratio
    return model._replace(log_likelihoods=np.delete(terms, _joined_to_others(groups), axis=1))


def _joint_columns(model_class: ModelClass) -> list[list[int]]:
    """The columns of separate terms, all tests in turn, that correlated errors join."""
    errors = model_class.correlated_errors
    first = np.cumsum([0, *(len(own.datum_names) for own in model_class.likelihoods)])
    columns = [
        int(first[mode.test]) + model_class.likelihoods[mode.test].data.labels.index(mode.label)
        for mode in errors.modes
    ]
    return [[columns[position] for position in group] for group in errors.groups]


def _joined_to_others(groups: list[list[int]]) -> list[int]:
    """The columns whose terms are part of the first column of their group."""
    return [column for group in groups for column in group[1:]]


def compared_modes(model_class: ModelClass, model: AtDraws) -> list[ComparedModes]:
    """The model's modes at the draws, configuration by configuration."""
    sizes = [
        (
            likelihood.structure.n_modes,
            len(likelihood.pairs.with_shape),
            likelihood.pairs.unit_shapes.size if likelihood.needs_unit_shapes else 0,
        )
        for likelihood in model_class.likelihoods
    ]
    ends = np.cumsum(sizes, axis=0)[:-1].T
    arrays = (model.frequencies_hz, model.shape_distances, model.unit_shapes)
    of_tests = (np.split(array, end, axis=1) for array, end in zip(arrays, ends, strict=True))
    return [ComparedModes(*of_test) for of_test in zip(*of_tests, strict=True)]


def datum_terms(
    model_class: ModelClass,
    values: FloatArray,
    model: AtDraws,
    pairings: Sequence[Mapping[str, int]],
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> DatumTerms:
    """The posterior of a class, datum by datum.

    Args:
        values: (n, n_parameters), all draws, chain after chain.
        shape: (n_chains, n_steps).
    """
    identified: list[str] = []
    centres, normals = [], []
    first = 0
    for configuration, pairing in zip(model_class.configurations, pairings, strict=True):
        for label in configuration.data.labels:
            identified.append(label_in(configuration.name, label))
            if label in pairing:
                centres.append(model.frequencies_hz[:, first + pairing[label] - 1])
                normals.append(rng.standard_normal(len(values)))
            else:
                centres.append(rng.uniform(*configuration.data.band_hz, len(values)))
                normals.append(np.zeros(len(values)))
        first += configuration.structure.n_modes
    numbers = np.stack(normals, axis=-1)
    errors = model_class.correlated_errors
    if errors.groups:
        paired = numbers[:, errors.identified]
        numbers[:, errors.identified] = errors.correlated_normals(paired, values)
    predicted = np.stack(centres, axis=-1) + model.frequency_sds_hz * numbers
    return DatumTerms(
        tuple(_datum_names(model_class)),
        model.log_likelihoods.reshape(*shape, -1),
        tuple(identified),
        predicted.reshape(*shape, -1),
    )


def _datum_names(model_class: ModelClass) -> list[str]:
    """Names of the columns of log-likelihoods; a joint one has the names of all its data."""
    names = [
        label_in(configuration.name, name)
        for configuration, likelihood in zip(
            model_class.configurations, model_class.likelihoods, strict=True
        )
        for name in likelihood.datum_names
    ]
    groups = _joint_columns(model_class)
    for group in groups:
        names[group[0]] = " and ".join(names[column] for column in group)
    others = _joined_to_others(groups)
    return [name for column, name in enumerate(names) if column not in others]
