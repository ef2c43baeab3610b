"""What a posterior says datum by datum: log-likelihoods, and data as the model would give them.

Packages that compare or criticise models ask for these: leave-one-out cross-validation for the
first, posterior predictive checks for the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, Places, joined
from bayes_ssi.inference.likelihood.likelihood import ComparedModes
from bayes_ssi.inference.model_class.configuration import label_in, modes_with_shape
from bayes_ssi.inference.model_class.model_class import ModelClass


class AtDraws(NamedTuple):
    """The model at B draws; columns run through all configurations in turn."""

    modes: tuple[ComparedModes, ...]  # of each configuration
    log_likelihoods: FloatArray  # (B, n_data), log-likelihood of each datum
    # (B, n_components), shapes at the sensors of the modes that the likelihood compares: sensor by
    # sensor, and mode by mode.
    sensor_shapes: FloatArray

    @property
    def frequencies_hz(self) -> FloatArray:
        """Model frequencies (B, n_modes)."""
        return np.concatenate([of_test.frequencies_hz for of_test in self.modes], axis=1)

    def rows(self, which: Places) -> AtDraws:
        """The model at some of the draws."""
        modes = tuple(of_test.rows(which) for of_test in self.modes)
        return AtDraws(modes, self.log_likelihoods[which], self.sensor_shapes[which])

    @classmethod
    def joined(cls, parts: Sequence[AtDraws]) -> AtDraws:
        """The model at the draws of all parts."""
        modes, *arrays = zip(*parts, strict=True)
        of_tests = tuple(map(joined, zip(*modes, strict=True)))
        return cls(of_tests, *map(np.concatenate, arrays))


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
    of_tests, log_likelihoods, sensor_shapes = [], [], []
    for test, likelihood, columns in model_class.parts(values):
        modes = likelihood.modes(columns)
        of_tests.append(likelihood.compared_modes(columns, modes))
        log_likelihoods.append(likelihood.log_likelihoods(columns, of_tests[-1]))
        compared_shapes = modes_with_shape(test.data, test.pairing, test.structure.n_modes)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, compared_shapes]
        sensor_shapes.append(shapes.reshape(len(values), -1))
    terms = np.concatenate(log_likelihoods, axis=1)
    groups = _joint_columns(model_class)
    if groups:
        ratios = model_class.correlated_errors.log_ratios(values, of_tests)
        for group, ratio in zip(groups, ratios.T, strict=True):
            terms[:, group[0]] = terms[:, group].sum(axis=1) + ratio
        terms = np.delete(terms, _joined_to_others(groups), axis=1)
    return AtDraws(tuple(of_tests), terms, np.concatenate(sensor_shapes, axis=1))


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
    sds = []
    parts = zip(model_class.parts(values), model.modes, pairings, strict=True)
    for (configuration, likelihood, columns), modes, pairing in parts:
        own = np.array([mode.frequency_cov or 0.0 for mode in configuration.data.modes])
        variances = likelihood.prediction_var(columns)[:, :1] + own**2
        sds.append(np.sqrt(variances) * configuration.data.frequencies_hz)
        for label in configuration.data.labels:
            identified.append(label_in(configuration.name, label))
            if label in pairing:
                centres.append(modes.frequencies_hz[:, pairing[label] - 1])
                normals.append(rng.standard_normal(len(values)))
            else:
                centres.append(rng.uniform(*configuration.data.band_hz, len(values)))
                normals.append(np.zeros(len(values)))
    numbers = np.stack(normals, axis=-1)
    errors = model_class.correlated_errors
    if errors.groups:
        paired = numbers[:, errors.identified]
        numbers[:, errors.identified] = errors.correlated_normals(paired, values)
    predicted = np.stack(centres, axis=-1) + np.concatenate(sds, axis=1) * numbers
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
