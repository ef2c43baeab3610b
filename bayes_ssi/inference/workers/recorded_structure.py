"""A structure that takes long, solved once at each set of values and counted."""

from functools import partial
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.workers import Evaluated, Workers, evaluate
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure, SubstituteStructure


class RecordedStructure(SubstituteStructure):
    """Another structure, solved once at each set of values."""

    def __init__(
        self, structure: Structure, workers: Workers | None = None, cache: Cache | None = None
    ) -> None:
        self.structure = structure
        self.n_solved = 0
        self.failures: dict[bytes, str] = {}
        self._known: dict[bytes, FloatArray] = {}
        self._workers, self._cache = workers, cache
        self._number = cache.new_model() if cache else 0

    @property
    def substituted(self) -> Structure:
        return self.structure

    def modes(self, values: FloatArray) -> Modes:
        """The structure's modes; NaN in rows at which it fails."""
        keys = [row.tobytes() for row in np.ascontiguousarray(values)]
        # A row that is there twice is solved once.
        new = {key: row for key, row in zip(keys, values, strict=True) if key not in self._known}
        if new:
            points = np.array(list(new.values()))
            if self._cache is None:
                evaluated = self._evaluate(points)
            else:
                evaluated = self._cache.evaluated(self._number, points, self._evaluate)
            self.n_solved += len(points)
            self._known.update(zip(new, evaluated.values, strict=True))
            solved = list(new)
            self.failures.update({solved[i]: why for i, why in evaluated.failures.items()})
        if len(keys) == 1 and keys[0] in self.failures:
            raise ValueError(self.failures[keys[0]])
        n_dof, n_modes = len(self.degrees_of_freedom), self.n_modes
        rows = np.array([self._known[key] for key in keys]).reshape(-1, (1 + n_dof) * n_modes)
        return Modes(rows[:, :n_modes], rows[:, n_modes:].reshape(len(keys), n_dof, n_modes))

    def _evaluate(self, values: FloatArray) -> Evaluated:
        function = partial(_solutions, self.structure)
        n_columns = (1 + len(self.degrees_of_freedom)) * self.n_modes
        solve = self._workers.evaluate if self._workers else evaluate
        return solve(function, values, n_columns)

    def __getstate__(self) -> dict[str, Any]:
        """State without what belongs to this process."""
        return {**self.__dict__, "_workers": None, "_cache": None}


def _solutions(structure: Structure, values: FloatArray) -> FloatArray:
    """Frequencies and shapes (B, (1 + n_dof) n_modes) at ``values`` (B, n_parameters)."""
    frequencies_hz, shapes = structure.modes(values)
    modes = Modes(frequencies_hz, shapes).repeated(len(values))
    return np.hstack([modes.frequencies_hz, modes.shapes.reshape(len(values), -1)])
