"""A structure and one mode more, of a motion that its model does not have."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.changed_structure import ChangedStructure, Loss
from bayes_ssi.structures.modal import ModalModel, Modes

SHAPES_DIFFER = 0.05  # sd of a component of the unit shape from that of the mode it resembles


@dataclass(frozen=True, eq=False)
class FurtherMode(ChangedStructure):
    """Another structure and a mode more, the last, which changes none of its modes.

    The structure is plane, say, and twists; or it stands on soil, or beside a neighbour. Where the
    sensors are, the shape is that of mode ``like`` (from 0), but for ``SHAPES_DIFFER``.
    """

    losses: tuple[Loss, ...] = field(default=(), init=False)
    falls: Mapping[int, Parameter] = field(default_factory=dict, init=False)
    frequency: Parameter
    like: int

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.structure.parameters, self.frequency)

    @property
    def n_modes(self) -> int:
        return self.structure.n_modes + 1

    @property
    def shape_variances(self) -> Mapping[int, float]:
        return {**self.structure.shape_variances, self.structure.n_modes: SHAPES_DIFFER**2}

    def modes(self, values: FloatArray) -> Modes:
        return self._with_one_more(super().modes(values), values)

    def modal_model(self, values: FloatArray) -> ModalModel:
        """As that of the other structure: the ground's motion does not drive the last mode."""
        own = super().modal_model(values)
        frequencies, shapes = self._with_one_more(Modes(*own[:2]), values)
        return ModalModel(frequencies, shapes, np.pad(own.participation, ((0, 0), (0, 1))), own[3])

    def _with_one_more(self, modes: Modes, values: FloatArray) -> Modes:
        modes = modes.repeated(len(values))
        frequencies = np.column_stack([modes.frequencies_hz, values[:, -1]])
        like = modes.shapes[:, :, [self.like]]
        return Modes(frequencies, np.concatenate([modes.shapes, like], axis=2))

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        labels, frequencies, shapes = super().labelled_modes(values)
        return labels, np.append(frequencies, values[-1]), np.c_[shapes, shapes[:, self.like]]
