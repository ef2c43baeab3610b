"""The paired modes of a model class before and after updating, small enough to be stored whole.

Tables, drawings and reports of a stored result are made from these records: they need neither
the study nor its structures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.identification.likelihood import ModalLikelihood
from bayes_ssi.identification.paired_modes import PairedModes
from bayes_ssi.model_class.configuration import Configuration
from bayes_ssi.sampling.resampling import evenly_spaced_indices
from bayes_ssi.structures.structure import Structure

__all__ = ["LEVEL", "UpdatedMode", "UpdatedModes", "updated_modes"]

LEVEL = 0.95
# Enough draws for the quantiles that a plot shows, at a small part of the sampling's cost.
MOST_DRAWS = 200
# The shapes of a structure with more degrees of freedom are kept at its sensors only.
MOST_PLACES = 100

Interval = tuple[float, float, float]


@dataclass(frozen=True)
class UpdatedMode:
    """One paired mode, at the prior medians and over the posterior.

    Intervals are the lower end, the median and the upper end of the central 95 %.

    Attributes:
        label: of the identified mode.
        model_mode: number of the model mode, from 1.
        before_hz: frequency at the prior medians.
        after_hz: interval of the frequency.
        mac_before: with the identified shape, at the prior medians; None where none is scored.
        mac_after: interval of the same; None where none is scored.
        shape_before: components at the places, at the prior medians.
        shape_after: interval of each component, (low, median, high) of (n_places,) each.

    Shapes have their largest component on the main structure at 1, and the identified shape's sign.
    """

    label: str
    model_mode: int
    before_hz: float
    after_hz: Interval
    mac_before: float | None
    mac_after: Interval | None
    shape_before: tuple[float, ...]
    shape_after: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class UpdatedModes:
    """The paired modes of one configuration of a model class.

    Attributes:
        places: degrees of freedom at which shapes are given.
        place_heights: of each, where a drawing puts it, in storeys above the ground.
        appendages: the places that are no part of the main structure.
        has_floors: whether the places are floors above one another that move sideways; if not,
            heights only keep them apart.
        modes: the paired ones, in the order of the data.
    """

    places: tuple[str, ...]
    place_heights: tuple[float, ...]
    appendages: tuple[str, ...]
    has_floors: bool
    modes: tuple[UpdatedMode, ...]

    def heights(self) -> dict[str, float]:
        """Place → height, as of a structure."""
        return dict(zip(self.places, self.place_heights, strict=True))


def updated_modes(
    configuration: Configuration,
    likelihood: ModalLikelihood,
    pairing: Mapping[str, int],
    values: FloatArray,
    medians: FloatArray,
) -> UpdatedModes:
    """The paired modes of a configuration before and after updating.

    Args:
        configuration: the test.
        likelihood: of its modes.
        pairing: label of an identified mode → number of the model mode, from 1.
        values: (n, n_parameters), equally weighted posterior draws of the configuration's
            parameters; some of them, evenly spread, serve.
        medians: (1, n_parameters), the prior medians of the same parameters.
    """
    structure, data = configuration.structure, configuration.data
    labels = [label for label in data.labels if label in pairing]
    pairs = PairedModes.of(data, [(label, pairing[label]) for label in labels])
    at = np.concatenate([medians, values[evenly_spaced_indices(len(values), MOST_DRAWS)]])
    modes = likelihood.modes(at)
    seen = likelihood.shapes_at_sensors(modes)
    scored = (1.0 - pairs.shape_distances(seen)) ** 2
    macs = dict(zip(pairs.with_shape.tolist(), scored.T, strict=True))
    rows = _drawn_rows(structure, data.sensors)
    main = [row for row in rows if structure.degrees_of_freedom[row] not in structure.appendages]
    records = []
    for i, label in enumerate(labels):
        number = pairing[label]
        drawn, of_main = (modes.shapes[:, which, number - 1] for which in (rows, main))
        signs = _signs(data.mode(label).unit_shape, seen[:, :, number - 1], drawn)
        shapes = _scaled(drawn * signs[:, None], of_main)
        frequencies, own = modes.frequencies_hz[:, number - 1], macs.get(i)
        low, median, high = (tuple(part.tolist()) for part in _interval(shapes[1:]))
        records.append(
            UpdatedMode(
                label=label,
                model_mode=number,
                before_hz=float(frequencies[0]),
                after_hz=_numbers(frequencies[1:]),
                mac_before=None if own is None else float(own[0]),
                mac_after=None if own is None else _numbers(own[1:]),
                shape_before=tuple(shapes[0].tolist()),
                shape_after=(low, median, high),
            )
        )
    heights = structure.heights()
    places = [structure.degrees_of_freedom[row] for row in rows]
    return UpdatedModes(
        tuple(places),
        tuple(float(heights[place]) for place in places),
        tuple(place for place in places if place in structure.appendages),
        type(structure).heights is not Structure.heights,
        tuple(records),
    )


def _drawn_rows(structure: Structure, sensors: tuple[str, ...]) -> list[int]:
    """The degrees of freedom whose components are kept, as rows of a shape."""
    labels = structure.degrees_of_freedom
    if len(labels) <= MOST_PLACES:
        return list(range(len(labels)))
    row = {label: i for i, label in enumerate(labels)}
    return [row[sensor] for sensor in sensors if sensor in row]


def _signs(identified: FloatArray | None, seen: FloatArray, shapes: FloatArray) -> FloatArray:
    """The sign (B,) that turns each shape to the identified one, or to the first of them."""
    if identified is None:
        products = shapes @ shapes[0]
        turned = float(shapes[0][np.abs(shapes[0]).argmax()]) if shapes.size else 1.0
        products = products * np.sign(turned)
    else:
        products = seen @ np.nan_to_num(np.asarray(identified))
    return np.where(products < 0.0, -1.0, 1.0)


def _scaled(shapes: FloatArray, of_main: FloatArray) -> FloatArray:
    """Shapes (B, n) with the largest component of the main structure (B, m) at 1."""
    if not of_main.shape[1]:
        return shapes
    largest = np.abs(of_main).max(axis=1, keepdims=True)
    return shapes / np.where(largest == 0.0, 1.0, largest)


def _interval(draws: FloatArray) -> NDArray[np.float64]:
    return np.quantile(draws, [0.5 * (1.0 - LEVEL), 0.5, 0.5 * (1.0 + LEVEL)], axis=0)


def _numbers(draws: FloatArray) -> Interval:
    low, median, high = _interval(draws).tolist()
    return low, median, high
