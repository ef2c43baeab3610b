"""Posterior draws of one model class, together with the structure that they are of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.approximate_structure import ApproximateStructure
from bayes_ssi.modal import Modes
from bayes_ssi.model_class.configuration import Configuration
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.structures.structure import Structure

__all__ = ["DRAWS", "ClassDraws", "class_draws", "configuration_of"]

DRAWS = 1000
# Numbers that one batch of draws may hold: a large structure is asked for a few draws at once.
BATCH_NUMBERS = 20_000_000
# Frequencies at stored draws that another machine, or a refined solver, gives again.
SAME_FREQUENCY = 1e-6
# How accurate an approximate structure is made at the draws: of frequencies, and of shapes.
ACCURATE = 1e-4, 0.01
# Stored draws at which a structure is asked whether it is still the one that was sampled.
CHECKED_DRAWS = 8


@dataclass(frozen=True, eq=False)
class ClassDraws:
    """Draws of the parameters of one model class's structure.

    Attributes:
        name: of the model class.
        structure: its structure, in one configuration.
        pairing: label of an identified mode → number of the model mode, from 1.
        values: (n_draws, n_parameters) of the structure.
        at_sensors: reduces modes to shapes at the sensors, (B, n_sensors, n_modes).
    """

    name: str
    structure: Structure
    pairing: Mapping[str, int]
    values: FloatArray
    at_sensors: Callable[[Modes], FloatArray]

    @cached_property
    def frequencies_hz(self) -> FloatArray:
        """(n_draws, n_modes)."""
        return np.concatenate(
            [Modes(*self.structure.modes(values)).frequencies_hz for values in self.batches()]
        )

    def shapes(self, number: int, places: Sequence[str]) -> FloatArray:
        """The shape of a model mode at some places, (n_draws, n_places), in the structure's scale.

        Raises:
            ValueError: a place is no degree of freedom or sensor of the structure.
        """
        matrix = self.structure.sensor_matrix(places, "place")
        return np.concatenate(
            [
                matrix.apply(Modes(*self.structure.modes(values)).shapes[:, :, number - 1])
                for values in self.batches()
            ]
        )

    def shapes_at_sensors(self, number: int) -> FloatArray:
        """The shape of a model mode as the sensors see it, (n_draws, n_sensors)."""
        return np.concatenate(
            [
                self.at_sensors(Modes(*self.structure.modes(values)))[:, :, number - 1]
                for values in self.batches()
            ]
        )

    def batches(self, numbers_per_draw: int = 0) -> Iterator[FloatArray]:
        """The draws in parts that a computation can hold in memory."""
        size = len(self.structure.degrees_of_freedom) * self.structure.n_modes
        rows = max(1, BATCH_NUMBERS // max(size, numbers_per_draw))
        for start in range(0, len(self.values), rows):
            yield self.values[start : start + rows]


def class_draws(
    posterior: Posterior,
    model_class: ModelClass,
    n_draws: int = DRAWS,
    configuration: str | None = None,
) -> ClassDraws:
    """Draws of a posterior, thinned evenly to ``n_draws``, with the class's structure.

    Args:
        posterior: the draws, perhaps read from a file.
        model_class: the class that they are of.
        n_draws: how many.
        configuration: whose structure and pairing; not needed where there is one.

    Raises:
        ValueError: there is no draw to take, no such configuration, several and none is named, or
            the class is not the one that was sampled: it has other configurations or parameters,
            or other frequencies at the stored draws.
    """
    if n_draws < 1:
        raise ValueError(f"predictions: the number of draws must be at least 1, got {n_draws!r}")
    test = configuration_of(model_class, configuration)
    structure = test.structure
    names = [parameter.name for parameter in structure.parameters]
    changed = f"model class {posterior.name!r} is not the one that was sampled"
    missing = [name for name in names if name not in posterior.parameter_names]
    if missing:
        raise ValueError(
            f"{changed}: its structure has a parameter {missing[0]!r}, the stored ones are "
            f"{', '.join(map(repr, posterior.parameter_names))}"
        )
    columns = [posterior.parameter_names.index(name) for name in names]
    at = np.arange(n_draws) * len(posterior.values) // n_draws
    values = posterior.values[at][:, columns]

    if test.name not in posterior.configuration_names:
        raise ValueError(
            f"{changed}: it has a configuration {test.name!r}, the stored ones are "
            f"{', '.join(map(repr, posterior.configuration_names))}"
        )
    modes, frequencies_hz = posterior.configuration(test.name)
    stored = frequencies_hz.reshape(len(posterior.values), -1)[at[:CHECKED_DRAWS]]
    test.check_structure()
    # Sampling made an approximate structure accurate at its draws, and so is it made here.
    same = SAME_FREQUENCY
    if isinstance(structure, ApproximateStructure):
        structure = structure.accurate_at(values, *ACCURATE)
        same = ACCURATE[0]
    found = structure.modes(values[:CHECKED_DRAWS]).frequencies_hz
    if found.shape != stored.shape or not np.allclose(found, stored, rtol=same, atol=0):
        raise ValueError(
            f"{changed}: at a stored draw its structure has the frequencies "
            f"{_listed(found[0])} Hz, stored are {_listed(stored[0])} Hz"
        )
    likelihood = test.likelihood(model_class.error, model_class.identification)
    at_sensors = likelihood.shapes_at_sensors
    return ClassDraws(posterior.name, structure, modes.pairing, values, at_sensors)


def configuration_of(model_class: ModelClass, name: str | None) -> Configuration:
    """The configuration of a model class that has a name, or its only one if None.

    Raises:
        ValueError: there is none of that name, or there are several and none is named.
    """
    known = model_class.configurations
    found = [each for each in known if name is None or each.name == name]
    if len(found) == 1:
        return found[0]
    owner = f"model class {model_class.name!r}"
    names = ", ".join(map(repr, model_class.configuration_names))
    if name is None:
        raise ValueError(f"{owner} has {len(known)} configurations; choose one of {names}")
    if names == "''":
        raise ValueError(f"{owner} has one configuration, without a name; got {name!r}")
    raise ValueError(f"{owner} has no configuration {name!r}; choose from {names}")


def _listed(frequencies: FloatArray) -> str:
    shown = ", ".join(f"{frequency:.4g}" for frequency in frequencies[:6])
    return shown + (", ..." if len(frequencies) > 6 else "")
