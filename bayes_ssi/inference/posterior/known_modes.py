"""Model classes whose modes are known at posterior draws: what a stored posterior can answer.

With them, a likelihood under other settings is computed without solving for any mode.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import modes_with_shape
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.inference.posterior.model_at_draws import KEPT
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure


def draws_with_shapes(n_draws: int) -> NDArray[np.intp]:
    """The draws, of all chains in turn, at which a posterior keeps shapes at the sensors."""
    return evenly_spaced_indices(n_draws, KEPT.draws_with_shapes)


@dataclass(frozen=True, eq=False)
class KnownModes(Structure):
    """A structure with known modes at some parameter values; degrees of freedom are sensors."""

    inferred: tuple[Parameter, ...]  # the parameters, columns of ``values``
    sensor_names: tuple[str, ...]  # labels of the degrees of freedom
    values: FloatArray  # (B, n_parameters)
    known: Modes  # the modes at these values, shapes (B, n_sensors, n_modes) at the sensors

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.inferred

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return self.sensor_names

    @property
    def n_modes(self) -> int:
        return self.known.frequencies_hz.shape[1]

    def modes(self, values: FloatArray) -> Modes:
        """The modes at some of the known values; ValueError at any others."""
        try:
            rows = [self._row[value.tobytes()] for value in np.ascontiguousarray(values)]
        except KeyError:
            raise ValueError("modes are known at the stored draws only") from None
        return Modes(*(array[rows] for array in self.known))

    @cached_property
    def _row(self) -> dict[bytes, int]:
        return {row.tobytes(): i for i, row in enumerate(np.ascontiguousarray(self.values))}


def known_structures(
    posterior: Posterior, tests: Iterable[tuple[ModalData, Pairing, Sequence[Parameter]]]
) -> list[KnownModes]:
    """The structure of each configuration, known at draws whose shapes the posterior keeps.

    ``tests`` have data, pairing and the structure's parameters of each configuration.
    """
    if posterior.sensor_shapes is None:
        raise ValueError(f"posterior of {posterior.name!r}: keeps no mode shapes at its draws")
    draws, remaining = draws_with_shapes(len(posterior.values)), posterior.sensor_shapes
    known = []
    for (data, pairing, parameters), modes in zip(tests, posterior.configurations, strict=True):
        kept = modes_with_shape(data, pairing, modes.n_modes)
        n_sensors = len(data.sensors)
        components, remaining = np.split(remaining, [n_sensors * len(kept)], axis=1)
        shapes = np.full((len(draws), n_sensors, modes.n_modes), np.nan)
        shapes[:, :, kept] = components.reshape(len(draws), n_sensors, len(kept))
        _, frequencies = posterior.configuration(modes.name)
        at_draws = Modes(frequencies.reshape(-1, modes.n_modes)[draws], shapes)
        columns = [posterior.parameter_names.index(p.name) for p in parameters]
        values = posterior.values[draws][:, columns]
        known.append(KnownModes(tuple(parameters), data.sensors, values, at_draws))
    return known


def known_at_draws(model_class: ModelClass, posterior: Posterior) -> ModelClass:
    """The class with structures that know their modes at the draws at which shapes are kept."""
    tests = ((t.data, t.pairing, t.structure.parameters) for t in model_class.configurations)
    known = known_structures(posterior, tests)
    return model_class.with_structures(lambda _, i: known[i])
