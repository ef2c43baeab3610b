"""Structures that are solved at one set of parameter values at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections import OrderedDict
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.error_places import with_place
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure

# Memory for recent solutions: enough for hundreds of draws at a thousand sensors.
CACHE_BYTES = 64_000_000


class PointwiseStructure(Structure):
    """A structure that is solved at one row of values at a time.

    Recent solutions and errors are cached: a batch that failed in one row is evaluated again in
    parts, and the modes of stored draws are computed more than once.
    """

    is_solved_by_rows = True

    @abstractmethod
    def solved_at(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Frequencies (n_modes,) and shapes (n_dof, n_modes) at ``values`` (n_parameters,).

        Further results of the same solution may follow.

        Raises:
            Exception: there are no modes; :meth:`solution` adds the values to the message.
        """

    def modes(self, values: FloatArray) -> Modes:
        """See :meth:`Structure.modes`.

        Raises:
            ValueError: a row has no modes; the message gives its values, and why.
        """
        solutions = [self.solution(row) for row in values]
        n, n_dof, n_modes = len(values), len(self.degrees_of_freedom), self.n_modes
        return Modes(
            np.array([frequencies for frequencies, *_ in solutions]).reshape(n, n_modes),
            np.array([shapes for _, shapes, *_ in solutions]).reshape(n, n_dof, n_modes),
        )

    def solution(self, row: FloatArray) -> tuple[FloatArray, ...]:
        """:meth:`solved_at` for one row of values, cached.

        Raises:
            ValueError: :meth:`solved_at` raised; its message is completed by the values.
        """
        cache: OrderedDict[bytes, tuple[FloatArray, ...] | str]
        cache = self.__dict__.setdefault("_cache", OrderedDict())
        key = np.ascontiguousarray(row).tobytes()
        answer = cache.pop(key, None)
        if answer is None:
            try:
                answer = self.solved_at(row)
            except Exception as error:  # noqa: BLE001 - whatever a user's function may raise
                reason = with_place(error)
                if isinstance(error, ValueError):  # as the type of the answer says already
                    reason = reason.removeprefix(f"{type(error).__name__}: ")
                answer = f"at {self._named(row)}: {reason}"
        cache[key] = answer
        size = 8 * (len(self.degrees_of_freedom) + 1) * self.n_modes + 1000
        while len(cache) * size > CACHE_BYTES:
            cache.popitem(last=False)
        if isinstance(answer, str):
            raise ValueError(answer)
        return answer

    def _named(self, row: FloatArray) -> str:
        """One row of values with the parameters' names."""
        each = zip(self.parameters, row, strict=True)
        return ", ".join(f"{p.name} = {value:.6g}" for p, value in each) or "no parameters"

    def __getstate__(self) -> dict[str, Any]:
        """State without the cache, which need not be sent to workers."""
        state = super().__getstate__()
        assert isinstance(state, dict)
        return {name: value for name, value in state.items() if name != "_cache"}
