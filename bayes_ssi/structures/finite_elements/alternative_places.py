"""Models with the same elements at different places, computed in one batch.

A search puts one kind of element on hundreds of places. Small batches, one for each place, take
longer than a large one of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.finite_elements.projected_structure import (
    ElementVectors,
    ProjectedStructure,
)
from bayes_ssi.structures.modal import Modes


@dataclass(frozen=True, eq=False)
class AlternativePlaces:
    """P structures that differ in nothing but the places of their elements."""

    first: ProjectedStructure
    vectors: ElementVectors

    @classmethod
    def of(cls, structures: Sequence[ProjectedStructure]) -> Self:
        """Join the structures, which are of one model, with elements of the same kinds each."""
        each = [structure.vectors for structure in structures]
        joined = ElementVectors(*(np.concatenate(rows) for rows in zip(*each, strict=True)))
        return cls(structures[0], joined)

    def modes(self, values: FloatArray, which: NDArray[np.intp]) -> Modes:
        """The modes (B, ...) of structures ``which`` (B,), one for each row of values.

        Args:
            values: (B, n_parameters), columns in the order of each structure's own parameters.
            which: numbers of structures, from 0.
        """
        rows = ElementVectors(*(array[which] for array in self.vectors))
        return self.first.modes_with(values, rows)
