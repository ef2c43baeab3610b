"""Predictions of the identified modes, as tables and files list them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.results.predictions.predictions import Predictions

# More degrees of freedom than can be read in a table are shown at the sensors alone.
MOST_PLACES = 60


class PredictedMode(NamedTuple):
    """The frequency of an identified mode."""

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
        before = float(predictions.frequencies_before_hz(label).quantile(0.5))
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
    places = predictions.main_places
    if len(places) <= MOST_PLACES:
        return places
    return tuple(place for place in places if place in data.sensors) or places[:MOST_PLACES]


def _explained(data: ModalData, predictions: Predictions) -> list[str]:
    explained = {label for each in predictions.classes for label in each.pairing}
    return [label for label in data.labels if label in explained]
