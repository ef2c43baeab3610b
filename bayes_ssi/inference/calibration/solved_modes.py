"""The modes of a model class at a batch of points, some of which may have none."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.modal import Modes


class SolvedModes:
    """Modes of every configuration; counts the points at which they are solved."""

    def __init__(self, model_class: ModelClass, workers: Workers | None = None) -> None:
        self.model_class = model_class
        self.n_evaluations = 0
        # The others are solved faster here than sent.
        slow = any(test.structure.is_solved_by_rows for test in model_class.configurations)
        self._workers = workers if slow else None

    def at(self, z: FloatArray) -> list[Modes]:
        """Modes of each configuration at ``z`` (B, n_parameters); NaN where there are none."""
        self.n_evaluations += len(z)
        solve: Callable[[FloatArray], list[Modes]] = partial(_solved, self.model_class)
        if self._workers is None or not len(z):
            return solve(z)
        parts = np.array_split(z, min(len(z), self._workers.n_parts))
        solved = self._workers.call_each(solve, parts)
        return [
            Modes(*(np.concatenate(arrays) for arrays in zip(*of_test, strict=True)))
            for of_test in zip(*solved, strict=True)
        ]


def _solved(model_class: ModelClass, z: FloatArray) -> list[Modes]:
    parts = model_class.parts(model_class.values(z))
    return [_modes(likelihood, own) for _, likelihood, own in parts]


def _modes(likelihood: ModalLikelihood, own: FloatArray) -> Modes:
    """Modes at ``own`` (B, n); a batch that raises is halved, down to the rows at fault."""
    structure = likelihood.structure
    try:
        return likelihood.modes(own).repeated(len(own))
    except Exception:  # noqa: BLE001 - whatever a user's model may raise
        if len(own) == 1:
            n_dof, n_modes = len(structure.degrees_of_freedom), structure.n_modes
            return Modes(np.full((1, n_modes), np.nan), np.full((1, n_dof, n_modes), np.nan))
    middle = len(own) // 2
    halves = _modes(likelihood, own[:middle]), _modes(likelihood, own[middle:])
    return Modes(*(np.concatenate(arrays) for arrays in zip(*halves, strict=True)))
