"""Frequencies of the structure itself: those of its model, with the model's prediction errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.likelihood.joint_errors import ModeOfTest
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.results.predictions.bands import Prediction
from bayes_ssi.results.predictions.posterior_draws import (
    PREDICTION_SETTINGS,
    thinned_draws,
    thinned_rows,
)
from bayes_ssi.structures.structure import Structure


@checked
def predict_frequencies(
    posterior: Posterior,
    model_class: ModelClass,
    state: Structure | str,
    modes: Mapping[str, int],
    n_draws: int = PREDICTION_SETTINGS.n_draws,
    seed: int = 0,
) -> Prediction:
    """Frequencies of the structure itself, in a state that was not tested or in a tested one.

    Every draw is the frequency of the model at a posterior draw with a draw of the prediction
    error, given the errors of the identified modes: where errors are correlated, what the model
    missed in other tests, or in other modes, is expected again. Identification errors are not part
    of it.

    Args:
        posterior: posterior of the class.
        model_class: the class.
        state: the structure in a state that was not tested, its parameters among those of the
            class; or the name of a tested configuration, to predict further modes of it.
        modes: label of a mode → number of the model mode in this state, from 1. A label among those
            of the identified modes stands for the same mode.
        n_draws: number of draws.
        seed: seed of the draws of prediction errors.

    Returns:
        Frequencies in Hz, draws (n_draws, n_modes), in the order of ``modes``.

    Raises:
        ValueError: there is no draw to take, no such configuration or no such mode, a parameter of
            the structure is not one of the class, or the class is not the one that was sampled.
    """
    tests = [
        thinned_draws(posterior, model_class, n_draws, c.name) for c in model_class.configurations
    ]
    columns = [posterior.parameter_names.index(name) for name in model_class.parameter_names]
    rows = thinned_rows(len(posterior.values), n_draws)
    values = posterior.values[rows][:, columns]
    if isinstance(state, str):
        test = list(model_class.configurations).index(model_class.configuration(state))
        structure, model_hz = tests[test].structure, tests[test].frequencies_hz
    else:
        test, structure = len(tests), state
        own = values[:, _columns_of(state, model_class)]
        model_hz = replace(tests[0], structure=state, values=own).frequencies_hz
    for label, number in modes.items():
        if not 1 <= number <= structure.n_modes:
            raise ValueError(
                f"predict_frequencies: mode {label!r} is model mode {number!r}; the structure has "
                f"modes 1 to {structure.n_modes}"
            )
    further = [ModeOfTest(test, label, number) for label, number in modes.items()]
    tested_hz = [each.frequencies_hz for each in tests]
    residuals = _residuals(model_class, values, tested_hz, further, np.random.default_rng(seed))
    # A residual is f/f_e - 1, with f the model's frequency.
    return Prediction(model_hz[:, [mode.number - 1 for mode in further]] / (1.0 + residuals))


def _columns_of(structure: Structure, model_class: ModelClass) -> list[int]:
    names = model_class.parameter_names
    wanted = [parameter.name for parameter in structure.parameters]
    require_known(
        f"predict_frequencies: model class {model_class.name!r} has no parameter", wanted, names
    )
    return [names.index(name) for name in wanted]


def _residuals(
    model_class: ModelClass,
    values: FloatArray,
    tested_hz: list[FloatArray],
    further: list[ModeOfTest],
    rng: np.random.Generator,
) -> FloatArray:
    """Prediction errors (n_draws, n_modes) of further modes, given those of the paired modes."""
    errors = model_class.correlated_errors
    n_rows = max(1, PREDICTION_SETTINGS.array_size // (len(errors.modes) + len(further)) ** 2)
    parts = []
    for start in range(0, len(values), n_rows):
        part = slice(start, start + n_rows)
        means, covariance = errors.conditional(
            values[part], [each[part] for each in tested_hz], further
        )
        variances, axes = np.linalg.eigh(covariance)
        # Errors that the data determine have no variance left, up to rounding.
        spread = axes * np.sqrt(np.maximum(variances, 0.0))[..., None, :]
        normals = rng.standard_normal(means.shape)
        parts.append(means + (spread * normals[:, None, :]).sum(axis=2))
    return np.concatenate(parts)
