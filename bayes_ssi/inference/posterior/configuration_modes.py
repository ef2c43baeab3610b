"""The model's modes in each configuration: their pairing, before and after updating.

Tables, drawings and reports of a stored result are made from these records: they need neither
the study nor its structures.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.structures.modal import Modes, scaled_shapes, shape_signs
from bayes_ssi.structures.response.modal_response import ground_influence
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True)
class KeptSettings:
    """What a posterior keeps of the model's modes."""

    level: float = 0.95  # of intervals
    draws: int = 200  # for intervals: enough for a plot, at a small part of the sampling's cost
    places: int = 100  # with more degrees of freedom, shapes are kept at the sensors only
    # At which shapes at the sensors are kept: enough for means and evidences under changed settings
    # to a few hundredths of a standard deviation and of a nat.
    draws_with_shapes: int = 4000


KEPT = KeptSettings()

Interval = tuple[float, float, float]


@dataclass(frozen=True)
class UpdatedMode:
    """One paired mode, at the prior medians and over the posterior.

    Where the pairing was inferred, every draw has its own, as the order of model modes may change;
    draws that leave the mode out are left out. Intervals are the lower end, the median and the
    upper end of the central 95 %.

    Shapes are scaled by :func:`~bayes_ssi.structures.modal.scaled_shapes` and turned to the
    identified ones.
    """

    label: str
    model_mode: int  # number of the model mode, from 1, in the most probable pairing
    before_hz: float
    after_hz: Interval
    # MAC with the identified shape, at the prior medians; None where none is scored.
    mac_before: float | None
    mac_after: Interval | None  # interval of the MAC; None where none is scored
    shape_before: tuple[float, ...]
    # Interval of each component, (low, median, high) of (n_places,) each.
    shape_after: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class UpdatedModes:
    """The paired modes of one configuration of a model class."""

    places: tuple[str, ...]  # degrees of freedom at which shapes are given
    place_heights: tuple[float, ...]
    appendages: tuple[str, ...]
    # Whether the places are floors above one another that move sideways; if not, heights only keep
    # them apart.
    has_floors: bool
    modes: tuple[UpdatedMode, ...]

    def heights(self) -> dict[str, float]:
        """Place → height in a drawing, in storeys above the ground."""
        return dict(zip(self.places, self.place_heights, strict=True))


@dataclass(frozen=True)
class ConfigurationModes:
    """The model's modes in one configuration, and their pairing with the identified modes."""

    name: str  # name of the configuration; empty where there is only one and it has no name
    n_modes: int
    # Label of an identified mode → number of the model mode, from 1; where it was inferred, the
    # most probable one.
    pairing: Mapping[str, int]
    # Probabilities of pairings; None where the pairing was given.
    inferred_pairing: InferredPairing | None
    updated: UpdatedModes


def configuration_modes(
    model_class: ModelClass, values: FloatArray
) -> tuple[ConfigurationModes, ...]:
    """The modes of a class at the posterior draws ``values`` (n, n_parameters)."""
    records = []
    # The prior medians are the first row, ahead of the draws.
    at = np.concatenate([model_class.values(np.zeros((1, values.shape[1]))), values])
    chosen = np.concatenate([[0], 1 + evenly_spaced_indices(len(values), KEPT.draws)])
    for configuration, likelihood, columns in model_class.parts(at):
        inferred = likelihood.inferred_pairing(columns[1:])
        pairing = dict(inferred.best if inferred else likelihood.pairing)
        n_modes = configuration.structure.n_modes
        updated = _updated_modes(configuration, likelihood, pairing, columns[chosen])
        records.append(ConfigurationModes(configuration.name, n_modes, pairing, inferred, updated))
    return tuple(records)


def _updated_modes(
    configuration: Configuration,
    likelihood: ModalLikelihood,
    pairing: Mapping[str, int],
    at: FloatArray,
) -> UpdatedModes:
    """The paired modes at the prior medians, the first row of ``at``, and at draws, the others."""
    structure, data = configuration.structure, configuration.data
    modes = likelihood.modes(at)
    seen = likelihood.shapes_at_sensors(modes)
    all_places, places = structure.degrees_of_freedom, structure.degrees_of_freedom
    if len(all_places) > KEPT.places:
        places = tuple(sensor for sensor in data.sensors if sensor in all_places)
    shown = [all_places.index(place) for place in places]
    main = [i for i, place in enumerate(all_places) if place not in structure.appendages]
    records = []
    for label, (rows, numbers) in _paired_modes(likelihood, pairing, at, modes).items():
        whole, at_sensors = modes.shapes[rows, :, numbers], seen[rows, :, numbers]
        identified = data.mode(label).unit_shape
        signs = shape_signs(whole[:, main], at_sensors, identified)
        shapes = scaled_shapes(whole[:, shown] * signs[:, None], whole[:, main])
        frequencies = modes.frequencies_hz[rows, numbers]
        pair = PairedModes.of(data, [(label, 1)])
        macs = (1.0 - pair.shape_distances(at_sensors[:, :, None])) ** 2
        low, median, high = map(tuple, _interval(shapes[1:]))
        records.append(
            UpdatedMode(
                label=label,
                model_mode=pairing[label],
                before_hz=float(frequencies[0]),
                after_hz=_interval(frequencies[1:]),
                mac_before=float(macs[0, 0]) if macs.size else None,
                mac_after=_interval(macs[1:, 0]) if macs.size else None,
                shape_before=tuple(shapes[0].tolist()),
                shape_after=(low, median, high),
            )
        )
    heights = structure.heights()
    return UpdatedModes(
        places,
        tuple(float(heights[place]) for place in places),
        tuple(place for place in places if place in structure.appendages),
        moves_sideways(structure),
        tuple(records),
    )


def _paired_modes(
    likelihood: ModalLikelihood, pairing: Mapping[str, int], at: FloatArray, modes: Modes
) -> dict[str, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Label of a paired mode → rows of ``at``, and the model mode that it is in each, from 0.

    The order of model modes may change from draw to draw, and the pairing with it: where it was
    inferred, every draw has its own, by its probability. Draws that leave the mode out are left
    out; the prior medians, the first row, never are.
    """
    compared = likelihood.compared_modes(at, modes)
    pairs = likelihood.sampled_pairs(at, compared, np.random.default_rng(0))
    chosen = np.append(likelihood.pairs.model_modes, -1)[pairs]
    paired = {}
    for label, numbers in zip(likelihood.data.labels, chosen.T, strict=True):
        if label not in pairing:
            continue
        if numbers[0] < 0:
            numbers[0] = pairing[label] - 1
        rows = np.flatnonzero(numbers >= 0)
        if len(rows) == 1:  # the few draws taken here all leave it out
            paired[label] = np.arange(len(at)), np.full(len(at), pairing[label] - 1)
        else:
            paired[label] = rows, numbers[rows]
    return paired


def moves_sideways(structure: Structure) -> bool:
    """Whether its degrees of freedom are floors that all move in the direction of the ground."""
    if type(structure).heights is Structure.heights:
        return False
    influence = ground_influence(structure)
    return influence is not None and bool((influence == 1.0).all())


def _interval(draws: FloatArray) -> Any:
    """The ends of the interval and the median between them, of draws (n,) or of each column."""
    ends = 0.5 * (1.0 - KEPT.level), 0.5 * (1.0 + KEPT.level)
    return tuple(np.quantile(draws, [ends[0], 0.5, ends[1]], axis=0).tolist())
