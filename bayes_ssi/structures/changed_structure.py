"""Another structure changed: some of its parameters are no longer what they were, or a mode more.

The further mode is of a motion that its model does not have.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter, collect_parameters
from bayes_ssi.structures.modal import ModalModel, Modes
from bayes_ssi.structures.structure import Accuracy, Requirement, Structure, SubstituteStructure


@dataclass(frozen=True)
class Loss:
    """What a parameter loses: it is ``1 - amount · loss`` times what it was."""

    of: str  # name of the parameter
    loss: Parameter  # a share; a gain where it is negative
    amount: float = 1.0  # how much of that share, such as degrees where it is a share per degree


@dataclass(frozen=True, eq=False)
class ChangedStructure(SubstituteStructure):
    """Another structure, whose parameters have lost a share of what they were.

    Its parameters are those of the other structure, the losses, then the falls. How modes are
    computed, and how accurately, is left to the other structure, at the parameters that result.
    """

    structure: Structure
    losses: tuple[Loss, ...]
    # Number of a mode, from 1 → the share by which its frequency is lower, whatever the cause.
    falls: Mapping[int, Parameter] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("is_cheap", "is_solved_by_rows", "is_approximate"):
            object.__setattr__(self, name, getattr(self.structure, name))

    @property
    def substituted(self) -> Structure:
        return self.structure

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        losses = (each.loss for each in self.losses)
        return collect_parameters((*self.structure.parameters, *losses, *self.falls.values()))

    def left(self, values: FloatArray) -> FloatArray:
        """The other structure's parameters (B, n) at ``values`` (B, n_parameters) of this one."""
        column = {parameter.name: i for i, parameter in enumerate(self.parameters)}
        own: FloatArray = values[:, : len(self.structure.parameters)].copy()
        for each in self.losses:
            own[:, column[each.of]] *= 1.0 - each.amount * values[:, column[each.loss.name]]
        return own

    def modes(self, values: FloatArray) -> Modes:
        frequencies_hz, shapes = self.structure.modes(self.left(values))
        return Modes(self._fallen(frequencies_hz, values), shapes)

    def modal_model(self, values: FloatArray) -> ModalModel:
        model = self.structure.modal_model(self.left(values))
        return model._replace(frequencies_hz=self._fallen(model.frequencies_hz, values))

    def _fallen(self, frequencies_hz: FloatArray, values: FloatArray) -> FloatArray:
        left = np.ones_like(frequencies_hz)
        left[:, [n - 1 for n in self.falls]] -= values[:, values.shape[1] - len(self.falls) :]
        return frequencies_hz * left

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        return self.structure.labelled_modes(self.left(values[None])[0])

    @property
    def exact(self) -> Structure:
        return self._on(self.structure.exact)

    def confirming(self, values: FloatArray) -> Structure:
        return self._on(self.structure.confirming(self.left(values)))

    @property
    def performance_hint(self) -> str:
        return self.structure.performance_hint

    def accurate_at(self, required: Requirement) -> Self:
        required = required._replace(values=self.left(required.values))
        return self._on(self.structure.accurate_at(required))

    def accuracy(self, values: FloatArray, n_modes: int | None = None) -> Accuracy:
        return self.structure.accuracy(self.left(values), n_modes)

    def compact(self, values: FloatArray) -> Self:
        return self._on(self.structure.compact(self.left(values)))

    def _on(self, structure: Structure) -> Self:
        """The same losses on another structure; itself where that is the one it has."""
        return self if structure is self.structure else replace(self, structure=structure)


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
