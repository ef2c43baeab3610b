"""What is predicted where nobody says: damping, place, and frequencies of transfer functions."""

from __future__ import annotations

import math

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.predictions.predicted_modes import main_places
from bayes_ssi.predictions.predictions import Predictions
from bayes_ssi.response.modal_response import ground_influence
from bayes_ssi.response.output import GROUND, Output, Quantity

__all__ = ["MOST_FREQUENCIES", "default_damping", "default_frequencies", "default_output"]

DAMPING = 0.02
# At a step of this share of half the narrowest peak's width, a peak is met within 0.2 %.
STEP = 1.0 / 8.0
FEWEST_FREQUENCIES, MOST_FREQUENCIES = 400, 6000


def default_damping(data: ModalData) -> tuple[float, str]:
    """A damping ratio for all modes, and where it is from."""
    identified = [mode.damping for mode in data.modes if mode.damping]
    if identified:
        return float(np.median(identified)), "the median of the identified damping ratios"
    return DAMPING, "assumed, since none was identified"


def default_output(predictions: Predictions, quantity: Quantity) -> Output:
    """The quantity at the top of the main structure; of drift, from the ground to there.

    The top is the highest degree of freedom of those that move along with the ground, the first
    one where there are several.
    """
    structure = predictions.classes[0].structure
    heights, influence = structure.heights(), ground_influence(structure)
    places = main_places(predictions)
    if influence is not None and influence.any():
        moving = {place for place, own in zip(structure.degrees_of_freedom, influence, strict=True)
                  if own}  # fmt: skip
        places = tuple(place for place in places if place in moving) or places
    top = max(places, key=lambda place: heights[place])
    return Output(quantity, ((GROUND, top),) if quantity == "drift" else (top,))


def default_frequencies(
    data: ModalData, lowest_damping: float, band_hz: tuple[float, float] | None = None
) -> FloatArray:
    """Frequencies that meet every peak of a band, the one of the data if None.

    As many as the narrowest peak asks for, but :data:`MOST_FREQUENCIES` at most.

    Raises:
        ValueError: the band's limits make no sense.
    """
    low, high = data.band_hz if band_hz is None else band_hz
    if not 0.0 <= low < high < math.inf:
        raise ValueError(
            f"band: must be two frequencies in Hz, the lower one first, got {low!r} and {high!r}"
        )
    lowest = max(low, min(mode.frequency_hz for mode in data.modes))
    wanted = math.ceil((high - low) / (STEP * lowest_damping * lowest)) + 1
    return np.linspace(low, high, min(max(wanted, FEWEST_FREQUENCIES), MOST_FREQUENCIES))
