"""Errors of one mode's shape in several tests, turned into one plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_groups import ErrorGroups, ModeOfTest, grouped
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.structures.modal import Modes


@dataclass(frozen=True, eq=False)
class ShapeErrors:
    """Errors of the shapes that several tests measured at the same sensors."""

    likelihoods: tuple[ModalLikelihood, ...]

    @cached_property
    def _modes(self) -> list[tuple[ModeOfTest, frozenset[str]]]:
        """The paired modes whose shape is scored, test by test, and the sensors that saw them."""
        modes = []
        for test, likelihood in enumerate(self.likelihoods):
            pairs, sensors = likelihood.pairs, np.array(likelihood.data.sensors)
            for pair, measured in zip(pairs.with_shape, pairs.measured.T, strict=True):
                mode = ModeOfTest(test, pairs.modes[pair].label, int(pairs.model_modes[pair]) + 1)
                modes.append((mode, frozenset(sensors[measured == 1.0].tolist())))
        return modes

    @cached_property
    def labels(self) -> list[str]:
        """The label of each group."""
        return [self._modes[own[0]][0].label for own in self._positions]

    @cached_property
    def _positions(self) -> list[list[int]]:
        return grouped((mode.label, sensors) for mode, sensors in self._modes)

    @cached_property
    def groups(self) -> ErrorGroups | None:
        """The groups of shapes with one label and the same sensors; None if there are none."""
        if not self._positions:
            return None
        return ErrorGroups.of(
            self._positions,
            [mode for mode, _ in self._modes],
            np.concatenate([likelihood.pairs.shape_var for likelihood in self.likelihoods]),
            by_label=True,
            dimensions=[len(self._modes[own[0]][1]) - 1 for own in self._positions],
        )

    @cached_property
    def _columns(self) -> list[NDArray[np.intp]]:
        """The columns of each test's sensors among the sensors of all."""
        known: dict[str, int] = {}
        return [
            np.array([known.setdefault(s, len(known)) for s in own.data.sensors], dtype=np.intp)
            for own in self.likelihoods
        ]

    def errors(self, groups: ErrorGroups, modes: Sequence[Modes]) -> FloatArray:
        """Errors (B, G, n, n_sensors) in the plane at the mean of a group's model shapes.

        Each is turned there from its own plane by the rotation that turns its model shape into the
        mean one.
        """
        n_sensors = 1 + max(int(own.max(initial=-1)) for own in self._columns)
        parts: list[tuple[FloatArray, FloatArray]] = []
        for likelihood, of_test, columns in zip(
            self.likelihoods, modes, self._columns, strict=True
        ):
            seen = likelihood.shapes_at_sensors(of_test)
            both = []
            for array in likelihood.pairs.shape_errors(seen):
                everywhere = np.zeros((len(array), array.shape[2], n_sensors))
                everywhere[:, :, columns] = array.transpose(0, 2, 1)
                both.append(everywhere)
            parts.append((both[0], both[1]))
        shapes, errors = (
            groups.of_members(np.concatenate(arrays, axis=1)) for arrays in zip(*parts, strict=True)
        )
        sign = np.where((shapes * shapes[:, :, :1]).sum(axis=3, keepdims=True) < 0.0, -1.0, 1.0)
        shapes, errors = shapes * sign, errors * sign
        mean = shapes.sum(axis=2, keepdims=True)
        length = np.sqrt((mean * mean).sum(axis=3, keepdims=True))
        mean /= np.where(length == 0.0, 1.0, length)  # no sensor sees the mode in any test
        along = (errors * mean).sum(axis=3, keepdims=True)
        cosine = (shapes * mean).sum(axis=3, keepdims=True)
        turned: FloatArray = errors - along / (1.0 + cosine) * (shapes + mean)
        return turned
