"""Structures that are solved for one set of parameter values at a time."""

from __future__ import annotations

from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.modal import Modes
from bayes_ssi.structures.structure import Structure

__all__ = ["OneByOne", "Solved"]

# Bytes of solutions that a structure keeps for a while.
KEPT_BYTES = 64_000_000

# Frequencies (n_modes,) in Hz and shapes (n_dof, n_modes) of one structure.
Solved = tuple[FloatArray, FloatArray]
_S = TypeVar("_S")


class OneByOne(Structure):
    """A structure whose rows of values are solved one after the other.

    Solutions, and errors, are kept for a while: a batch that failed in one row is asked for again
    in parts, and draws are asked for more than once.
    """

    @abstractmethod
    def solved(self, values: FloatArray) -> Solved:
        """Frequencies and shapes at one set of values (n_parameters,).

        Raises:
            Exception: whatever says that there are none; :meth:`modes` adds the values.
        """

    def modes(self, values: FloatArray) -> Modes:
        """As :meth:`Structure.modes`.

        Raises:
            ValueError: at a row there are no modes; the message gives its values, and why.
        """
        found = [self._remembered("modes", row, self.solved) for row in values]
        n, n_dof, n_modes = len(values), len(self.degrees_of_freedom), self.n_modes
        return Modes(
            np.array([frequencies for frequencies, _ in found]).reshape(n, n_modes),
            np.array([shapes for _, shapes in found]).reshape(n, n_dof, n_modes),
        )

    def at(self, values: FloatArray) -> str:
        """One set of values, for messages."""
        each = zip(self.parameters, values, strict=True)
        return ", ".join(f"{p.name} = {value:.6g}" for p, value in each) or "no parameters"

    def _remembered(self, what: str, row: FloatArray, solve: Callable[[FloatArray], _S]) -> _S:
        """What ``solve`` says of one row of values, now or when it was last asked.

        Raises:
            ValueError: whatever ``solve`` raised, and where.
        """
        kept: OrderedDict[tuple[str, bytes], Any] = self.__dict__.setdefault("_kept", OrderedDict())
        key = (what, np.ascontiguousarray(row).tobytes())
        if key in kept:
            kept.move_to_end(key)
            answer = kept[key]
        else:
            try:
                answer = solve(row)
            except Exception as error:  # noqa: BLE001 - whatever a user's function may raise
                told = " ".join(str(error).split())
                kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
                answer = f"at {self.at(row)}: {kind}{told}"
            kept[key] = answer
            size = 8 * (len(self.degrees_of_freedom) + 1) * self.n_modes + 1000
            while len(kept) * size > KEPT_BYTES:
                kept.popitem(last=False)
        if isinstance(answer, str):
            raise ValueError(answer)
        found: _S = answer
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Without what was kept: it is not sent to workers."""
        return {name: value for name, value in self.__dict__.items() if name != "_kept"}
