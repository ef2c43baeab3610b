"""Stiffness and mass as sums of terms: matrices times products of parameters, and elements.

An element adds springs k w wᵀ and masses m w wᵀ, in one way whatever carries it: matrices or a
reduced basis. A motion w·x combines rows of the structure, which says what rows a place has, and
the elements' own degrees of freedom, whose rows follow.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable
from bayes_ssi.structures.elements import Contribution, Element
from bayes_ssi.structures.geometry import SinglePlace


@dataclass(frozen=True)
class AffineArray:
    """``Σ c_t(θ) A_t``: coefficients (products of parameters) times fixed arrays."""

    table: ProductTable
    arrays: FloatArray

    @classmethod
    def of(
        cls,
        terms: Iterable[tuple[Product, FloatArray]],
        parameters: tuple[Parameter, ...],
        shape: tuple[int, ...],
    ) -> "AffineArray":
        """Merge terms with the same powers of parameters: all fixed ones become one array."""
        merged: dict[tuple[tuple[Parameter, float], ...], FloatArray] = {}
        for coefficient, array in terms:
            total = merged.setdefault(coefficient.powers, np.zeros(shape))
            total += coefficient.scale * array
        merged = merged or {(): np.zeros(shape)}
        table = ProductTable(tuple(Product(1.0, powers) for powers in merged), parameters)
        arrays = np.array(list(merged.values()))
        arrays.setflags(write=False)
        return cls(table, arrays)

    def evaluate(self, values: FloatArray) -> FloatArray:
        """The sum, (B, *shape); (1, *shape) where nothing depends on the parameters."""
        if self._fixed is not None:
            return self._fixed
        if len(values) == 1:  # numpy would add in another order than in a batch
            return self.evaluate(np.repeat(values, 2, axis=0))[:1]
        entries, arrays = self._not_zero
        coefficients = self.table.evaluate(values)
        total = np.zeros((self.arrays[0].size, len(values)))
        with np.errstate(invalid="ignore"):  # inf · 0 of a value that is not finite
            # A matrix product would round a row differently in a batch of another size.
            total[entries] = np.einsum("bt,tk->kb", coefficients, arrays)
        # A matrix's entries are far apart, and those of the batch next to each other.
        shape = self.arrays.shape[1:]
        return total.reshape(*shape, -1).transpose(-1, *range(len(shape)))

    @cached_property
    def _fixed(self) -> FloatArray | None:
        """The sum, (1, *shape), where nothing depends on the parameters; None elsewhere."""
        if any(product.powers for product in self.table.products):
            return None
        return self.arrays.sum(axis=0, keepdims=True)

    @cached_property
    def _not_zero(self) -> tuple[NDArray[np.intp] | slice, FloatArray]:
        """Which entries of the sum are not always zero, and those of the arrays (T, n_entries)."""
        flat = self.arrays.reshape(len(self.arrays), -1)
        entries = np.flatnonzero(flat.any(axis=0))
        if len(entries) == flat.shape[1]:
            return slice(None), flat
        return entries, flat[:, entries]


# The rows of a place, and their shares, as pairs: none of the ground. Other places are refused with
# a message that begins with the element's label.
RowsOf = Callable[[SinglePlace, str], Iterable[tuple[int, float]]]


class AddedTerm(NamedTuple):
    """A spring or mass c w wᵀ."""

    coefficient: Product
    vector: dict[int, float]  # row → component of w
    on_ground: float = 0.0  # component by the motion of the ground

    @classmethod
    def of(cls, term: Contribution, rows_of: RowsOf, label: str) -> "AddedTerm":
        vector: dict[int, float] = {}
        for place, component in term.direction:
            for row, share in rows_of(place, label):
                vector[row] = vector.get(row, 0.0) + component * share
        moving = {row: component for row, component in vector.items() if component != 0.0}
        on_ground = sum(share for place, share in term.direction if place == 0)
        return cls(term.coefficient, moving, on_ground)


def coefficients_of(terms: Iterable[AddedTerm]) -> tuple[Product, ...]:
    return tuple(term.coefficient for term in terms)


@dataclass(frozen=True)
class CarriedElements:
    """Springs and masses on a structure of ``size`` rows."""

    # Of the elements' own degrees of freedom, which are rows ``size`` upwards.
    labels: tuple[str, ...]
    springs: tuple[AddedTerm, ...]
    masses: tuple[AddedTerm, ...]
    size: int

    @classmethod
    def of(
        cls,
        elements: Sequence[Element],
        rows_of: RowsOf,
        size: int,
        shift: float = 0.0,
        taken: Iterable[str] = (),
    ) -> "CarriedElements":
        """Find the rows of elements; ``shift`` is that of a free body, for the springs."""
        labels, taken = own_labels(elements), set(taken)
        for label in labels:
            if label in taken or labels.count(label) > 1:
                raise ValueError(
                    f"element {label!r}: the structure has a degree of freedom of that label "
                    "already; give the element a label of its own"
                )
        added = {label: size + i for i, label in enumerate(labels)}

        def rows(place: SinglePlace, label: str) -> Iterable[tuple[int, float]]:
            return [(added[str(place)], 1.0)] if place in added else rows_of(place, label)

        springs = [AddedTerm.of(term, rows, e.label) for e in elements for term in e.springs()]
        masses = [AddedTerm.of(term, rows, e.label) for e in elements for term in e.masses()]
        if shift:
            springs += [term._replace(coefficient=shift * term.coefficient) for term in masses]
        return cls(labels, tuple(springs), tuple(masses), size)

    @property
    def whole_size(self) -> int:
        """Number of rows with those of the elements' own degrees of freedom."""
        return self.size + len(self.labels)

    @property
    def acted_on(self) -> NDArray[np.intp]:
        """Rows (r,) of the structure at which elements act, in ascending order."""
        rows = {row for term in (*self.springs, *self.masses) for row in term.vector}
        return np.array(sorted(row for row in rows if row < self.size), dtype=np.intp)

    def ordered(self, rows: NDArray[np.intp]) -> "CarriedElements":
        """The same elements where row i of the structure has become ``rows[i]``."""
        whole = [*rows.tolist(), *range(self.size, self.whole_size)]

        def moved(terms: Iterable[AddedTerm]) -> tuple[AddedTerm, ...]:
            return tuple(
                t._replace(vector={whole[i]: c for i, c in t.vector.items()}) for t in terms
            )

        return CarriedElements(self.labels, moved(self.springs), moved(self.masses), self.size)

    def components(self, terms: Sequence[AddedTerm]) -> tuple[FloatArray, FloatArray]:
        """Of motions: by the rows acted on (n, r), and by own degrees of freedom (n, p)."""
        rows = [*self.acted_on.tolist(), *range(self.size, self.whole_size)]
        components = np.array([[term.vector.get(row, 0.0) for row in rows] for term in terms])
        whole = components.reshape(len(terms), len(rows))
        return whole[:, : len(self.acted_on)], whole[:, len(self.acted_on) :]

    @property
    def own_springs(self) -> tuple[AddedTerm, ...]:
        """The spring by which each own degree of freedom hangs on what was there before it."""
        last = [max(term.vector, default=0) for term in self.springs]
        return tuple(self.springs[last.index(self.size + i)] for i in range(len(self.labels)))

    def influence(self, influence: FloatArray) -> FloatArray:
        """Displacements (whole_size,) when the ground moves by 1, from those (size,) without them.

        Own springs do not deform: one that ends on the ground moves as its others do, or by 1.
        """
        whole = np.append(influence, np.zeros(len(self.labels)))
        for row, (_, vector, on_ground) in enumerate(self.own_springs, self.size):
            moved = sum(c * whole[other] for other, c in vector.items() if other != row)
            other_ends = -(vector[row] + on_ground)
            ground = moved / other_ends if other_ends else 1.0
            whole[row] = -(moved + on_ground * ground) / vector[row]
        return whole


def own_labels(elements: Iterable[Element]) -> tuple[str, ...]:
    """Labels of the degrees of freedom that elements add."""
    own = (element.own_degree_of_freedom for element in elements)
    return tuple(label for label in own if label is not None)
