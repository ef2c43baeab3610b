"""Defaults of a response request: damping, place, and frequencies of transfer functions."""

from __future__ import annotations

import math

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.structures.response.modal_response import ground_influence
from bayes_ssi.structures.response.output import GROUND, Output, Quantity

# Transfer functions of a thousand draws at more frequencies would take minutes.
MOST_FREQUENCIES = 6000


def default_damping(data: ModalData) -> tuple[float, str]:
    """A damping ratio for all modes, and its source in words."""
    identified = [mode.damping for mode in data.modes if mode.damping]
    if identified:
        return float(np.median(identified)), "the median of the identified damping ratios"
    return 0.02, "assumed, since none was identified"


def default_output(predictions: Predictions, quantity: Quantity) -> Output:
    """The quantity at the top of the main structure; for drift, between the ground and the top.

    The top is the highest degree of freedom that moves along with the ground, the first of them
    where there are several.
    """
    structure = predictions.classes[0].structure
    heights, influence = structure.heights(), ground_influence(structure)
    places = predictions.main_places
    if influence is not None and influence.any():
        moving = {place for place, own in zip(structure.degrees_of_freedom, influence, strict=True)
                  if own}  # fmt: skip
        places = tuple(place for place in places if place in moving) or places
    top = max(places, key=lambda place: heights[place])
    return Output(quantity, ((GROUND, top),) if quantity == "drift" else (top,))


def default_frequencies(
    data: ModalData, lowest_damping: float, band_hz: tuple[float, float] | None = None
) -> FloatArray:
    """Equally spaced frequencies that resolve every peak of a band.

    At least 400, for smooth curves, and as many as the narrowest peak needs up to
    :data:`MOST_FREQUENCIES`.

    Args:
        data: the identified modes; their band if ``band_hz`` is None.
    """
    low, high = data.band_hz if band_hz is None else band_hz
    if not 0.0 <= low < high < math.inf:
        raise ValueError(
            f"band: must be two frequencies in Hz, the lower one first, got {low!r} and {high!r}"
        )
    lowest = max(low, min(mode.frequency_hz for mode in data.modes))
    # A peak extends ζf to either side; steps of an eighth of that meet its height within 0.2 %.
    needed = math.ceil((high - low) / (lowest_damping * lowest / 8.0)) + 1
    return np.linspace(low, high, min(max(needed, 400), MOST_FREQUENCIES))
