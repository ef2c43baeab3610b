"""Elements on a model that is given by its matrices: their springs and masses by rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Product
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.motion import Motion, SinglePlace

# A displacement v·x by the nonzero components of v: row → component.
Vector = dict[int, float]


@dataclass(frozen=True)
class ElementsOnRows:
    """Springs k v vᵀ and masses m v vᵀ on a model of ``size`` degrees of freedom.

    Attributes:
        labels: of the degrees of freedom that elements add, which are rows ``size`` upwards.
        size: number of degrees of freedom of the model without them.
    """

    labels: tuple[str, ...]
    springs: tuple[tuple[Product, Vector], ...]
    masses: tuple[tuple[Product, Vector], ...]
    size: int

    @classmethod
    def of(
        cls,
        elements: Sequence[Element],
        row_of: Callable[[SinglePlace, str], int | None],
        size: int,
    ) -> ElementsOnRows:
        """Find the rows of elements.

        Args:
            row_of: the row of a place of the model, None for the ground; refuses others with a
                message that begins with the element's label.
            size: number of degrees of freedom of the model.
        """
        own = [e.own_degree_of_freedom for e in elements if e.own_degree_of_freedom is not None]
        added = {label: size + i for i, label in enumerate(own)}

        def vector(motion: Motion, label: str) -> Vector:
            total: Vector = {}
            for place, component in motion:
                row = added[str(place)] if place in added else row_of(place, label)
                if row is not None:
                    total[row] = total.get(row, 0.0) + component
            return {row: component for row, component in total.items() if component != 0.0}

        springs = [
            (s.stiffness, vector(s.direction, e.label)) for e in elements for s in e.springs()
        ]
        masses = [(m.mass, vector(m.direction, e.label)) for e in elements for m in e.masses()]
        return cls(tuple(own), tuple(springs), tuple(masses), size)

    def ordered(self, rows: NDArray[np.intp]) -> ElementsOnRows:
        """The same elements where row i of the model and theirs has become ``rows[i]``."""
        springs, masses = (
            tuple((c, {int(rows[i]): v for i, v in vector.items()}) for c, vector in of_kind)
            for of_kind in (self.springs, self.masses)
        )
        return replace(self, springs=springs, masses=masses)

    def own_springs(self) -> list[int]:
        """The spring by which each degree of freedom of their own hangs on the others."""
        last = [max(vector, default=0) for _, vector in self.springs]
        return [last.index(self.size + i) for i in range(len(self.labels))]

    def influence(self, influence: FloatArray) -> FloatArray:
        """Displacements (size + own,) when the ground moves by 1; appendages do not deform.

        ``influence`` (size,) is that of the model without elements.
        """
        whole = np.append(influence, np.zeros(len(self.labels)))
        for row, spring in enumerate(self.own_springs(), self.size):
            _, vector = self.springs[spring]
            moved = sum(component * whole[other] for other, component in vector.items())
            whole[row] = -moved / vector[row]
        return whole
