"""A finite-element model in a small fixed basis, for comparing many places of elements quickly.

An element on the model adds no vector to the basis, but what that lacks of the static answer
K_r⁻¹ v to its force, the residual flexibility: ρ = vᵀ K_r⁻¹ v - |Vᵀ v|² at its place, V being
orthonormal in K_r, and the displacements of the sensors likewise. The former is in series with the
element's spring,

    1/k' = 1/k + ρ,

the latter add to the mode shapes in proportion to the spring's force. Both are known for every
place (:mod:`~bayes_ssi.structures.finite_elements.projection`). Inertia of the residual is
neglected, its flexibility that of the prior medians, and flexibility between two elements left out,
so errors are not certified: this is for the choice of hypotheses, not for results.

Models with the same elements at different places, computed in one batch.

A search puts one kind of element on hundreds of places. Small batches, one for each place, take
longer than a large one of all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable, collect_parameters
from bayes_ssi.structures.affine_array import AffineArray
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.finite_elements.projection import BasisRow, Projection
from bayes_ssi.structures.modal import Modes, settle, solve_modes
from bayes_ssi.structures.motion import Motion, Place, motion_of
from bayes_ssi.structures.sensors import Sensor
from bayes_ssi.structures.structure import Structure


class _Term(NamedTuple):
    """A spring or mass c w wᵀ: w (N + p,) in all coordinates, and the row of its model part."""

    coefficient: Product
    vector: FloatArray
    row: BasisRow


class ElementVectors(NamedTuple):
    """The places of elements, for a batch of structures.

    Attributes:
        springs: (B, n_springs, N + p), elongations by all coordinates.
        flexibilities: (B, n_springs), ρ at their places.
        at_sensors: (B, n_springs, d + p), displacements under a unit force, as far as V lacks them.
        masses: (B, n_masses, N + p), motions of the masses by all coordinates.
    """

    springs: FloatArray
    flexibilities: FloatArray
    at_sensors: FloatArray
    masses: FloatArray

    @property
    def masses_are_diagonal(self) -> bool:
        """Whether every mass moves with a single coordinate."""
        return bool((np.count_nonzero(self.masses, axis=2) <= 1).all())


class ProjectedStructure(Structure):
    """A model in a small basis, with elements on it."""

    def __init__(self, main: Projection, elements: tuple[Element, ...] = ()) -> None:
        self.main, self.elements = main, elements
        own = (element.own_degree_of_freedom for element in elements)
        self._own = tuple(label for label in own if label is not None)
        self._springs = [
            self._term(s.stiffness, s.direction, e.label) for e in elements for s in e.springs()
        ]
        self._masses = [
            self._term(m.mass, m.direction, e.label) for e in elements for m in e.masses()
        ]
        if shift := main.free_body.shift:
            self._springs += [
                each._replace(coefficient=shift * each.coefficient) for each in self._masses
            ]

    def with_element(self, element: Element) -> ProjectedStructure:
        return ProjectedStructure(self.main, (*self.elements, element))

    def require_place(self, place: Place, label: str) -> None:
        for single, _ in motion_of(place):
            if single != 0 and single not in self._own:
                require_known(f"{label}: no place", [single], self.main.rows)

    def __getstate__(self) -> dict[str, Any]:
        """State without the places of the model on which it has no element.

        Those of a search are hundreds, and each of its hypotheses goes to another process.
        """
        springs = [spring.direction for each in self.elements for spring in each.springs()]
        masses = [mass.direction for each in self.elements for mass in each.masses()]
        acted_on = {place for direction in (*springs, *masses) for place, _ in direction}
        rows = {place: row for place, row in self.main.rows.items() if place in acted_on}
        return {**self.__dict__, "main": replace(self.main, rows=rows)}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        stiffness = [c for c, _ in self.main.stiffness] + [t.coefficient for t in self._springs]
        mass = [c for c, _ in self.main.mass] + [t.coefficient for t in self._masses]
        return collect_parameters(p for c in (*stiffness, *mass) for p in c.parameters)

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return (*self.main.sensors, *self._own)

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        return self.main.combined

    @property
    def appendages(self) -> tuple[str, ...]:
        return self._own

    @property
    def n_modes(self) -> int:
        return self.main.n_modes + len(self._own)

    def modes(self, values: FloatArray) -> Modes:
        return self.modes_with(values, self.vectors)

    def modes_with(self, values: FloatArray, vectors: ElementVectors) -> Modes:
        """The modes (B, ...) with the elements at other places, which may differ row by row.

        Args:
            values: (B, n_parameters).
        """
        springs = self._spring_table.evaluate(values)
        # In series with the residual flexibility at their places.
        springs = springs / (1.0 + springs * vectors.flexibilities)
        stiffness = self._stiffness.evaluate(values) + _sum_of_squares(springs, vectors.springs)
        masses, mass = self._mass_table.evaluate(values), self._mass.evaluate(values)
        if mass.ndim == 2 and vectors.masses_are_diagonal:
            mass = mass + np.einsum("bt,bti->bi", masses, vectors.masses**2)
        else:
            whole = mass[:, :, None] * np.eye(mass.shape[1]) if mass.ndim == 2 else mass
            mass = whole + _sum_of_squares(masses, vectors.masses)
        free = self.main.free_body
        modes = solve_modes(stiffness, mass, self.n_modes + free.number).repeated(len(values))
        # One product for each row of the batch, of one layout in memory, so that no other row
        # changes its last digit.
        in_basis = np.ascontiguousarray(modes.shapes)
        shapes = self._at_sensors @ in_basis
        for i in range(springs.shape[1]):
            elongations = vectors.springs[:, i : i + 1] @ in_basis
            shapes -= vectors.at_sensors[:, i, :, None] * (springs[:, i, None, None] * elongations)
        settle(modes.frequencies_hz, shapes)  # as for a reduced structure
        return free.elastic(Modes(modes.frequencies_hz, shapes))

    @cached_property
    def vectors(self) -> ElementVectors:
        """The elements where they are."""
        n, d = self.main.size + len(self._own), len(self.degrees_of_freedom)
        return ElementVectors(
            springs=np.array([[s.vector for s in self._springs]]).reshape(1, -1, n),
            flexibilities=np.array([[(s.row.flexibility**2).sum() for s in self._springs]]),
            at_sensors=np.array(
                [[np.append(s.row.at_sensors, np.zeros(len(self._own))) for s in self._springs]]
            ).reshape(1, -1, d),
            masses=np.array([[m.vector for m in self._masses]]).reshape(1, -1, n),
        )

    @cached_property
    def _spring_table(self) -> ProductTable:
        return ProductTable(tuple(each.coefficient for each in self._springs), self.parameters)

    @cached_property
    def _mass_table(self) -> ProductTable:
        return ProductTable(tuple(each.coefficient for each in self._masses), self.parameters)

    @cached_property
    def _stiffness(self) -> AffineArray:
        """Without the elements, (B, N + p, N + p)."""
        return self._padded(self.main.stiffness, 2)

    @cached_property
    def _mass(self) -> AffineArray:
        """Without the elements, (B, N + p, N + p); its diagonal alone where all else is zero."""
        return self._padded(self.main.mass, min(array.ndim for _, array in self.main.mass))

    def _padded(
        self, terms: Iterable[tuple[Product, FloatArray]], n_dimensions: int
    ) -> AffineArray:
        p = len(self._own)
        padded = ((coefficient, np.pad(array, (0, p))) for coefficient, array in terms)
        return AffineArray.of(padded, self.parameters, (self.main.size + p,) * n_dimensions)

    @cached_property
    def _at_sensors(self) -> FloatArray:
        """(d + p, N + p), of sensors and own degrees of freedom."""
        (d, n), p = self.main.at_sensors.shape, len(self._own)
        whole = np.zeros((d + p, n + p))
        whole[:d, :n], whole[d:, n:] = self.main.at_sensors, np.eye(p)
        return whole

    def _term(self, coefficient: Product, direction: Motion, label: str) -> _Term:
        self.require_place(direction, label)
        own = np.zeros(len(self._own))
        first = next(iter(self.main.rows.values()))
        row = first.times(0.0)
        for place, share in direction:
            if place in self._own:
                own[self._own.index(str(place))] += share
            elif place != 0:
                row = row.plus(self.main.rows[place].times(share))
        return _Term(coefficient, np.append(row.motion, own), row)


def _sum_of_squares(coefficients: FloatArray, vectors: FloatArray) -> FloatArray:
    """Σ c v vᵀ (B, n, n) for coefficients (B, k) and vectors (1 or B, k, n)."""
    total: FloatArray = np.einsum("bk,bki,bkj->bij", coefficients, vectors, vectors)
    return total


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
