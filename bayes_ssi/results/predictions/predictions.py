"""Predictions with their uncertainty, from posterior draws of one model class or of several.

Nothing is sampled here. Draws of a posterior, thinned evenly, go through the structure; those of
several classes are joined in the proportions of the classes' probabilities, so that every draw of
a prediction has the same weight and its quantiles are those of the average over classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.likelihood.joint_errors import ModeOfTest
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.posterior_draws import (
    PREDICTION_SETTINGS,
    Band,
    PosteriorDraws,
    Prediction,
    thinned_draws,
    thinned_rows,
)
from bayes_ssi.structures.modal import scaled_shapes, shape_signs
from bayes_ssi.structures.response.ground_motion import GroundMotion
from bayes_ssi.structures.response.modal_response import (
    Damping,
    Output,
    peak_responses,
    time_histories,
    transfer_functions,
)
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions of one model class, or of several in the proportions of their probabilities.

    Attributes:
        name: name for titles.
        classes: the draws of each class.
    """

    name: str
    classes: tuple[PosteriorDraws, ...]

    @property
    def n_draws(self) -> int:
        return sum(len(each.values) for each in self.classes)

    def frequencies_hz(self, mode: str | int) -> Prediction:
        """The frequency of a mode in Hz, draws (n,).

        Args:
            mode: label of an identified mode; or, where there is one class only, number of a
                model mode, from 1.

        Raises:
            ValueError: there is no such mode.
        """
        return self._joined(
            [each.frequencies_hz[:, number - 1] for each, number in self._classes_with(mode)]
        )

    def shapes(self, mode: str | int, places: Sequence[str]) -> Prediction:
        """The shape of a mode at some degrees of freedom or sensors, draws (n, n_places).

        Each draw is scaled by :func:`~bayes_ssi.structures.modal.scaled_shapes`, and all are turned
        to the identified shape, if ``mode`` has one.

        Args:
            mode: as for :meth:`frequencies_hz`.
            places: labels of degrees of freedom or sensors.

        Raises:
            ValueError: there is no such mode, or a class has no such place.
        """
        wanted = places, self.main_places, self.classes[0].data.sensors
        labels = [label for some in wanted for label in some]
        parts = []
        for each, number in self._classes_with(mode):
            with _named(each):
                parts.append(each.shapes(number, labels))
        joined = self._joined(parts)
        ends = np.cumsum([len(some) for some in wanted])[:2]
        shapes, main, at_sensors = np.split(joined.draws, ends, axis=1)
        signs = shape_signs(main, at_sensors, self._identified_shape(mode))
        return Prediction(scaled_shapes(shapes, main) * signs[:, None], joined.share)

    @property
    def main_places(self) -> tuple[str, ...]:
        """Degrees of freedom of the main structure that all classes have."""
        first, *others = (each.main_places for each in self.classes)
        return tuple(place for place in first if all(place in other for other in others))

    def transfer_functions(
        self,
        frequencies_hz: FloatArray,
        output: Output,
        damping: Damping,
        *,
        force_at: str | None = None,
    ) -> Prediction:
        """Amplitudes of transfer functions, draws (n, n_places, n_frequencies).

        Arguments, units and errors are as in
        :func:`~bayes_ssi.structures.response.modal_response.transfer_functions`; messages name the
        class.
        """

        return self._responses(
            lambda structure, values: np.abs(
                transfer_functions(
                    structure, values, frequencies_hz, output, damping, force_at=force_at
                )
            ),
            size_per_mode=4 * np.size(frequencies_hz),  # complex numbers and their products
        )

    def time_histories(self, motion: GroundMotion, output: Output, damping: Damping) -> Prediction:
        """Time histories, draws (n, n_places, n_samples).

        Arguments, units and errors are as in
        :func:`~bayes_ssi.structures.response.modal_response.time_histories`.
        """
        return self._responses(
            lambda structure, values: time_histories(structure, values, motion, output, damping)
        )

    def peak_responses(self, motion: GroundMotion, output: Output, damping: Damping) -> Prediction:
        """Largest amplitudes of time histories, draws (n, n_places).

        Arguments, units and errors are as in
        :func:`~bayes_ssi.structures.response.modal_response.peak_responses`.
        """
        return self._responses(
            lambda structure, values: peak_responses(structure, values, motion, output, damping)
        )

    def _responses(
        self,
        compute: Callable[[Structure, FloatArray], FloatArray],
        size_per_mode: int = 0,
    ) -> Prediction:
        parts = []
        for each in self.classes:
            with _named(each):
                function = partial(compute, each.structure)
                parts.append(each.evaluate(function, size_per_mode * each.structure.n_modes))
        return self._joined(parts)

    def _joined(self, parts: list[FloatArray]) -> Prediction:
        draws = np.concatenate(parts)
        return Prediction(draws, len(draws) / self.n_draws)

    def _identified_shape(self, mode: str | int) -> FloatArray | None:
        """The identified shape (n_sensors,) of a mode; None where there is none."""
        own = self.classes[0]
        for identified in own.data.modes:
            if mode in (identified.label, own.pairing.get(identified.label)):
                return identified.unit_shape
        return None

    def _classes_with(self, mode: str | int) -> list[tuple[PosteriorDraws, int]]:
        """The classes that have a mode, with its number."""
        if isinstance(mode, str):
            explained = [
                (each, each.pairing[mode]) for each in self.classes if mode in each.pairing
            ]
            known = dict.fromkeys(label for each in self.classes for label in each.pairing)
            what = f"{self.name}: no model mode is paired with an identified mode"
            require_known(what, [mode], known)
            return explained
        if len(self.classes) > 1:
            raise ValueError(
                f"{self.name}: mode {mode!r} differs between the model classes; give the "
                "label of an identified mode"
            )
        n_modes = self.classes[0].structure.n_modes
        if not 1 <= mode <= n_modes:
            raise ValueError(f"{self.name}: no mode {mode!r}; choose from 1 to {n_modes}")
        return [(self.classes[0], mode)]


@contextmanager
def _named(each: PosteriorDraws) -> Iterator[None]:
    """Prefix error messages with the name of the model class."""
    try:
        yield
    except np.linalg.LinAlgError:  # a ValueError, but not of the input
        raise
    except (ValueError, TypeError) as error:
        raise type(error)(f"model class {each.name!r}: {error}") from None


class PredictedMode(NamedTuple):
    """The frequency of an identified mode, and the share of the draws that predict it."""

    label: str
    identified_hz: float
    before_hz: float
    after_hz: Band
    share: float


def predicted_modes(
    data: ModalData, predictions: Predictions, level: float
) -> Iterator[PredictedMode]:
    """Frequencies of all identified modes that a prediction explains.

    Before updating, they are those at the prior medians of each draw's class, in the median.
    """
    for mode in data.modes:
        before = [
            np.full(
                len(each.values),
                each.structure.modes(each.structure.prior_medians()).frequencies_hz[0, number - 1],
            )
            for each in predictions.classes
            if (number := each.pairing.get(mode.label)) is not None
        ]
        if before:
            after = predictions.frequencies_hz(mode.label)
            median = float(Prediction(np.concatenate(before)).band().median)
            yield PredictedMode(
                mode.label, mode.frequency_hz, median, after.band(level), after.share
            )


def shown_places(predictions: Predictions, data: ModalData) -> tuple[str, ...]:
    """The main structure's places to show: all, or, where they are many, those with sensors."""
    places, most = predictions.main_places, PREDICTION_SETTINGS.most_places
    if len(places) <= most:
        return places
    return tuple(place for place in places if place in data.sensors) or places[:most]


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
        test, structure, known = len(tests), state, model_class.parameter_names
        wanted = [parameter.name for parameter in state.parameters]
        what = f"predict_frequencies: model class {model_class.name!r} has no parameter"
        require_known(what, wanted, known)
        own = values[:, [known.index(name) for name in wanted]]
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
