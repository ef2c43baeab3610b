"""Structures made of springs and point masses, with any number of elements on them.

Stiffness and mass are sums of fixed matrices times products of parameters,
``K(θ) = Σ c_t(θ) K_t``, assembled for a whole batch at once.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayes_ssi.modal import ModalModel, Modes, modal_model, solve_modes
from bayes_ssi.parameters import Parameter, Product, ProductTable, collect_parameters
from bayes_ssi.priors import FloatArray
from bayes_ssi.structures.base import Structure
from bayes_ssi.structures.elements import Element, Place, PointMass, Spring

__all__ = ["LumpedStructure"]


@dataclass(frozen=True)
class _Sum:
    """``Σ c_t(θ) A_t``: coefficients (products of parameters) times fixed arrays."""

    table: ProductTable
    arrays: FloatArray

    @classmethod
    def of(
        cls,
        terms: Iterable[tuple[Product, FloatArray]],
        parameters: tuple[Parameter, ...],
        shape: tuple[int, ...],
    ) -> _Sum:
        """Add up the terms that share their parameters: all fixed ones become one array."""
        merged: dict[tuple[tuple[Parameter, float], ...], FloatArray] = {}
        for coefficient, array in terms:
            total = merged.setdefault(coefficient.powers, np.zeros(shape))
            total += coefficient.scale * array
        table = ProductTable(tuple(Product(1.0, powers) for powers in merged), parameters)
        arrays = np.array(list(merged.values()))
        arrays.setflags(write=False)
        return cls(table, arrays)

    @cached_property
    def _flat(self) -> FloatArray:
        return self.arrays.reshape(len(self.arrays), -1)

    @property
    def is_fixed(self) -> bool:
        return not any(product.powers for product in self.table.products)

    def evaluate(self, values: FloatArray) -> FloatArray:
        """(B, *shape); (1, *shape) where nothing depends on the parameters."""
        shape = self.arrays.shape[1:]
        if self.is_fixed:
            return self.arrays.sum(axis=0, keepdims=True)
        coefficients = self.table.evaluate(values)
        with np.errstate(invalid="ignore"):  # inf · 0 of a value that is not finite
            # Not a matrix product: BLAS rounds a row differently in a batch of another size, and a
            # batch may be evaluated in parts.
            return np.einsum("bt,tk->bk", coefficients, self._flat).reshape(-1, *shape)


@dataclass(frozen=True)
class LumpedStructure(Structure):
    """A main structure of springs and point masses, and the elements on it."""

    elements: tuple[Element, ...] = field(default=(), kw_only=True)

    @abstractmethod
    def main_degrees_of_freedom(self) -> Sequence[str]:
        """Labels of the main structure's degrees of freedom; place ``i`` is the i-th from 1."""

    @abstractmethod
    def main_springs(self) -> Sequence[Spring]:
        """Springs of the main structure."""

    @abstractmethod
    def main_masses(self) -> Sequence[PointMass]:
        """Masses of the main structure."""

    def with_element(self, element: Element) -> Self:
        """This structure with one more element on it.

        Raises:
            ValueError: the element's place is not on the structure, or its label is taken.
        """
        return replace(self, elements=(*self.elements, element))

    def __post_init__(self) -> None:
        labels = Counter(self.degrees_of_freedom)
        repeated = [label for label, count in labels.items() if count > 1]
        if repeated:
            raise ValueError(
                f"element {repeated[0]!r}: the structure has a degree of freedom of that label "
                "already; give the element a label of its own"
            )
        for element in self.elements:
            for spring in element.springs():
                for place, _ in spring.direction:
                    self._index(place, element.label)
            for mass in element.masses():
                self._index(mass.place, element.label)

    @cached_property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        own = (element.own_degree_of_freedom for element in self.elements)
        return (*self.main_degrees_of_freedom(), *(label for label in own if label is not None))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        coefficients = [spring.stiffness for spring in self._springs]
        coefficients += [mass.mass for mass in self._masses]
        return collect_parameters(p for c in coefficients for p in c.parameters)

    @property
    def n_modes(self) -> int:
        return len(self.degrees_of_freedom)

    def modes(self, values: FloatArray) -> Modes:
        frequencies, shapes = solve_modes(*self.matrices(values))
        if len(frequencies) != len(values):  # no parameter in K or M: one solution serves all
            frequencies = np.broadcast_to(frequencies, (len(values), self.n_modes))
            shapes = np.broadcast_to(shapes, (len(values), *shapes.shape[1:]))
        return Modes(frequencies, shapes)

    @property
    def appendages(self) -> tuple[str, ...]:
        return self.degrees_of_freedom[len(self.main_degrees_of_freedom()) :]

    def heights(self) -> dict[str, float]:
        """As :meth:`Structure.heights`; an appendage is drawn amid the places that it hangs on."""
        found = {label: float(i) for i, label in enumerate(self.main_degrees_of_freedom(), 1)}
        for element in self.elements:
            own = element.own_degree_of_freedom
            if own is None:
                continue
            places = [place for spring in element.springs() for place, _ in spring.direction]
            rows = [self._index(place) for place in places if place != own]
            top = float(len(self.main_degrees_of_freedom()))
            at = [
                0.0 if row is None else found.get(self.degrees_of_freedom[row], top) for row in rows
            ]
            found[own] = sum(at) / len(at)
            if found[own] in at:  # it stands on one place: a little above that
                found[own] += 0.35
        return found

    def modal_model(self, values: FloatArray) -> ModalModel:
        """As :meth:`Structure.modal_model`; every degree of freedom moves along with the ground."""
        modes = self.modes(values)
        return modal_model(modes, self._mass.evaluate(values)[:, :, None] * modes.shapes)

    def matrices(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stiffness (B, n, n) and the diagonal of the mass matrix (B, n) for ``values``.

        An array that depends on no parameter has a first dimension of 1.
        """
        return self._stiffness.evaluate(values), self._mass.evaluate(values)

    @cached_property
    def _springs(self) -> list[Spring]:
        return [*self.main_springs(), *(s for element in self.elements for s in element.springs())]

    @cached_property
    def _masses(self) -> list[PointMass]:
        return [*self.main_masses(), *(m for element in self.elements for m in element.masses())]

    @cached_property
    def _stiffness(self) -> _Sum:
        n = len(self.degrees_of_freedom)
        terms = []
        for spring in self._springs:
            direction = np.zeros(n)
            for place, component in spring.direction:
                index = self._index(place)
                if index is not None:
                    direction[index] += component
            terms.append((spring.stiffness, np.outer(direction, direction)))
        return _Sum.of(terms, self.parameters, (n, n))

    @cached_property
    def _mass(self) -> _Sum:
        n = len(self.degrees_of_freedom)
        terms = []
        for mass in self._masses:
            index = self._index(mass.place)
            if index is not None:
                terms.append((mass.mass, np.eye(n)[index]))
        return _Sum.of(terms, self.parameters, (n,))

    def _index(self, place: Place, label: str = "element") -> int | None:
        """The degree of freedom at a place; None for the ground, which does not move."""
        if place == 0:
            return None
        if isinstance(place, int) and 1 <= place <= len(self.main_degrees_of_freedom()):
            return place - 1
        if place in self.degrees_of_freedom:
            return self.degrees_of_freedom.index(str(place))
        raise ValueError(
            f"{label}: the structure has no place {place!r}; choose a floor from 1 to "
            f"{len(self.main_degrees_of_freedom())}, or 0 for the ground"
        )
