"""A structure after a change: some of its parameters are no longer what they were."""

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
        return collect_parameters(
            (*self.structure.parameters, *(e.loss for e in self.losses), *self.falls.values())
        )

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
