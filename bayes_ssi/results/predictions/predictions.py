"""Predictions with their uncertainty, from posterior draws of one model class or of several.

Nothing is sampled here. Draws of a posterior, thinned evenly, go through the structure; those of
several classes are joined in the proportions of the classes' probabilities, so that every draw of
a prediction has the same weight and its quantiles are those of the average over classes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.bands import Band, Prediction
from bayes_ssi.results.predictions.posterior_draws import (
    PREDICTION_SETTINGS,
    PosteriorDraws,
    thinned_draws,
)
from bayes_ssi.structures.modal import scaled_shapes, shape_signs
from bayes_ssi.structures.response.ground_motion import GroundMotion
from bayes_ssi.structures.response.modal_response import (
    peak_responses,
    time_histories,
    transfer_functions,
)
from bayes_ssi.structures.response.output import Damping, Output
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.ranking.comparison import Comparison

# Name of predictions that are averaged over model classes.
AVERAGE = "average"


def predict_class(
    posterior: Posterior,
    model_class: ModelClass,
    n_draws: int = PREDICTION_SETTINGS.n_draws,
    configuration: str | None = None,
) -> Predictions:
    """Predictions of one model class; arguments and errors are as in :func:`thinned_draws`."""
    draws = thinned_draws(posterior, model_class, n_draws, configuration)
    return Predictions(posterior.name, (draws,))


def predict_average(
    comparison: Comparison,
    posteriors: Sequence[Posterior],
    model_classes: Mapping[str, ModelClass],
    n_draws: int = PREDICTION_SETTINGS.n_draws,
    configuration: str | None = None,
) -> Predictions:
    """Predictions averaged over model classes by their probabilities.

    A class gets its share of the draws, rounded; one whose share rounds to nothing gets none.
    """
    by_name = {posterior.name: posterior for posterior in posteriors}
    counts = _shares([row.probability for row in comparison.classes], n_draws)
    classes = tuple(
        thinned_draws(by_name[row.name], model_classes[row.name], count, configuration)
        for row, count in zip(comparison.classes, counts, strict=True)
        if count
    )
    return Predictions(AVERAGE, classes)


def _shares(probabilities: Sequence[float], total: int) -> list[int]:
    """Whole numbers proportional to probabilities, rounded by the largest remainder."""
    exact = total * np.array(probabilities) / sum(probabilities)
    counts = np.floor(exact).astype(int)
    order = np.argsort(counts - exact, kind="stable")
    counts[order[: total - counts.sum()]] += 1
    return [int(count) for count in counts]


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

    def frequencies_before_hz(self, mode: str | int) -> Prediction:
        """The frequency of a mode at the prior medians of each draw's class, draws (n,).

        Arguments and errors are as in :meth:`frequencies_hz`.
        """
        parts = []
        for each, number in self._classes_with(mode):
            before = each.structure.modes(each.structure.prior_medians()).frequencies_hz
            parts.append(np.full(len(each.values), before[0, number - 1]))
        return self._joined(parts)

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
    """Frequencies of all identified modes that a prediction explains."""
    for label in _explained(data, predictions):
        after = predictions.frequencies_hz(label)
        before = float(predictions.frequencies_before_hz(label).band().median)
        identified = data.mode(label).frequency_hz
        yield PredictedMode(label, identified, before, after.band(level), after.share)


def predicted_shapes(
    data: ModalData, predictions: Predictions, level: float
) -> Iterator[tuple[str, Band]]:
    """The same modes with the bands of their shapes at :func:`shown_places`."""
    places = shown_places(predictions, data)
    for label in _explained(data, predictions):
        yield label, predictions.shapes(label, places).band(level)


def shown_places(predictions: Predictions, data: ModalData) -> tuple[str, ...]:
    """The main structure's places to show: all, or, where they are many, those with sensors."""
    places, most = predictions.main_places, PREDICTION_SETTINGS.most_places
    if len(places) <= most:
        return places
    return tuple(place for place in places if place in data.sensors) or places[:most]


def _explained(data: ModalData, predictions: Predictions) -> list[str]:
    explained = {label for draws in predictions.classes for label in draws.pairing}
    return [label for label in data.labels if label in explained]
