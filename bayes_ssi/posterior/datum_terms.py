"""What a posterior says datum by datum: log-likelihoods, and data as the model would give them.

Packages that compare or criticise models ask for these: leave-one-out cross-validation for the
first, posterior predictive checks for the second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.model_class.configuration import label_in, modes_with_shape
from bayes_ssi.model_class.model_class import ModelClass


class AtDraws(NamedTuple):
    """The model at B draws; columns run through all configurations in turn.

    Attributes:
        frequencies_hz: (B, n_modes), model frequencies.
        log_likelihoods: (B, n_data), log-likelihood of each datum.
        frequency_sds_hz: (B, n_identified), standard deviation of each identified frequency about
            the model's.
        shape_distances: (B, n_shape_pairs), 1 - |φ_e·φ| of the pairs whose shape is scored.
        sensor_shapes: (B, n_components), shapes at the sensors of the modes that the likelihood
            compares: sensor by sensor, and mode by mode.
    """

    frequencies_hz: FloatArray
    log_likelihoods: FloatArray
    frequency_sds_hz: FloatArray
    shape_distances: FloatArray
    sensor_shapes: FloatArray


@dataclass(frozen=True, eq=False)
class DatumTerms:
    """A posterior datum by datum; labels of several configurations begin with their names.

    Attributes:
        data: names of the data: each identified mode, and the absence of others; or all modes
            of a test together, where their pairing was inferred.
        log_likelihoods: (n_chains, n_steps, n_data); they add up to the log-likelihood.
        identified: labels of the identified modes.
        predicted_hz: (n_chains, n_steps, n_identified), identified frequencies drawn from the
            class: the paired model frequency with its error, or, for a mode that it calls
            spurious, anything in the band. An inferred pairing is the most probable one.
    """

    data: tuple[str, ...]
    log_likelihoods: FloatArray
    identified: tuple[str, ...]
    predicted_hz: FloatArray


def at_draws(model_class: ModelClass, values: FloatArray) -> AtDraws:
    """The model at ``values`` (B, n_parameters), its modes computed once."""
    parts = []
    for test, likelihood, columns in model_class.parts(values):
        modes = likelihood.modes(columns)
        compared = likelihood.compared_modes(columns, modes)
        compared_shapes = modes_with_shape(test.data, test.pairing, test.structure.n_modes)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, compared_shapes]
        parts.append(
            AtDraws(
                modes.frequencies_hz,
                likelihood.log_likelihoods(columns, compared),
                likelihood.frequency_sds_hz(columns),
                compared.shape_distances,
                shapes.reshape(len(values), -1),
            )
        )
    return AtDraws(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))


def datum_terms(
    model_class: ModelClass,
    model: AtDraws,
    pairings: Sequence[Mapping[str, int]],
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> DatumTerms:
    """The posterior of a class, datum by datum.

    Args:
        model_class: the class.
        model: the model at all draws, chain after chain.
        pairings: pairing of each configuration.
        shape: (n_chains, n_steps).
        rng: draws the errors of predicted frequencies.
    """
    data: list[str] = []
    identified: list[str] = []
    predicted: list[FloatArray] = []
    first = 0
    for configuration, likelihood, pairing in zip(
        model_class.configurations, model_class.likelihoods, pairings, strict=True
    ):
        data += [label_in(configuration.name, name) for name in likelihood.datum_names]
        for label in configuration.data.labels:
            sds = model.frequency_sds_hz[:, len(identified)]
            identified.append(label_in(configuration.name, label))
            if label in pairing:
                frequencies = model.frequencies_hz[:, first + pairing[label] - 1]
                predicted.append(frequencies + sds * rng.standard_normal(len(sds)))
            else:
                predicted.append(rng.uniform(*configuration.data.band_hz, len(sds)))
        first += configuration.structure.n_modes
    return DatumTerms(
        tuple(data),
        model.log_likelihoods.reshape(*shape, -1),
        tuple(identified),
        np.stack(predicted, axis=-1).reshape(*shape, -1),
    )
