"""A finite-element model in a small fixed basis, for comparing many places of elements quickly.

A reduced basis is accurate over the prior. Where a posterior lies, far fewer vectors describe the
modes: those combinations of the basis that the modes at some draws consist of. An element on the
model adds no vector to them, but what they lack of the static answer K_r⁻¹ v to its force, the
residual flexibility: ρ = vᵀ K_r⁻¹ v - |Vᵀ v|² at its place, V being orthonormal in K_r, and the
displacements of the sensors likewise. The former is in series with the element's spring,

    1/k' = 1/k + ρ,

the latter add to the mode shapes in proportion to the spring's force. Both are known place by place
without solving an equation: the sketch S of the reduced model's error has S Sᵀ ≈ K_r⁻¹, to about a
tenth, and K_r⁻¹ E is known for the sensors. Inertia of the residual is neglected, its flexibility
that of the prior medians, and flexibility between two elements left out, so errors are not
certified: this is for the choice of hypotheses, not for results.

A search puts one kind of element on hundreds of places. Small batches, one for each place, take
longer than a large one of all.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable, parameters_of
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.finite_elements.assembled_structure import AssembledStructure
from bayes_ssi.structures.finite_elements.reduced_basis import SKETCH_SIZE, ReducedBasis, Reference
from bayes_ssi.structures.geometry import Sensor, SinglePlace
from bayes_ssi.structures.matrix_terms import AffineArray, CarriedElements, coefficients_of
from bayes_ssi.structures.modal import FreeBody, Modes, settle, solve_modes
from bayes_ssi.structures.structure import CarryingStructure, Structure


class ElementVectors(NamedTuple):
    """The places of elements, for a batch of structures."""

    springs: FloatArray  # (B, n_springs, N + p), elongations by all coordinates
    flexibilities: FloatArray  # (B, n_springs), ρ at their places
    # (B, n_springs, d + p), displacements under a unit force, as far as V lacks them.
    at_sensors: FloatArray
    masses: FloatArray  # (B, n_masses, N + p), motions of the masses by all coordinates


@dataclass(frozen=True, eq=False)
class ProjectedStructure(CarryingStructure):
    """The model in a basis of N vectors, its answers to forces at some places, and elements there.

    Attributes:
        stiffness, mass: coefficients and matrices (N, N), term by term; of the mass only the
            diagonals (N,) where all terms are diagonal.
    """

    stiffness: tuple[tuple[Product, FloatArray], ...]
    mass: tuple[tuple[Product, FloatArray], ...]
    at_sensors: FloatArray  # (d, N), motions of the measured degrees of freedom
    places: tuple[SinglePlace, ...]  # P single places on which elements may be put
    motions: FloatArray  # (P, N), their rows of V
    # (P, sketch_size), rows of what the basis lacks of S, whose squares are ρ.
    flexibilities: FloatArray
    # (P, d), displacements of the sensors under a unit force, as far as V lacks them.
    moved_sensors: FloatArray
    measured: tuple[str, ...]
    n_main_modes: int
    free_body: FreeBody  # by whose shift the stiffness is raised
    sensors: Sequence[Sensor] = ()
    elements: tuple[Element, ...] = ()

    @classmethod
    def of(
        cls,
        basis: ReducedBasis,
        full: AssembledStructure,
        places: Iterable[SinglePlace],
        reference: Reference,
    ) -> Self:
        """The model without elements, in coordinates of unit mass where the mass is known."""
        vectors, system = basis.vectors, full.system
        # What the basis lacks of K_r⁻¹ times forces; the vectors are orthonormal in K_r.
        lacking = vectors.T @ (reference.matrix @ reference.sketch)
        moving = {place: row for place in places for row, _ in full.rows_of(place, "place")}
        at = system.rows[list(moving.values())]
        motions = vectors[at]
        flexibilities, moved = np.split(
            reference.sketch[at] - motions @ lacking, [SKETCH_SIZE], axis=1
        )
        stiffness = tuple(zip(system.stiffness.products, basis.stiffness.matrices, strict=True))
        mass = tuple(zip(system.mass.products, basis.mass.matrices, strict=True))
        at_sensors = basis.at_sensors
        if not any(coefficient.powers for coefficient, _ in mass):
            # Then only the elements' masses change it, and modes take a third less time.
            squares, axes = np.linalg.eigh(sum(c.scale * matrix for c, matrix in mass))
            change = axes / np.sqrt(squares)
            stiffness = tuple((c, change.T @ matrix @ change) for c, matrix in stiffness)
            mass = ((Product(1.0, ()), np.ones(len(squares))),)
            at_sensors, motions = at_sensors @ change, motions @ change
        return cls(
            stiffness,
            mass,
            at_sensors,
            tuple(moving),
            motions,
            flexibilities,
            moved,
            full.degrees_of_freedom,
            full.n_modes,
            system.free_body,
            full.sensors,
        )

    def with_element(self, element: Element) -> Self:
        whole = replace(self, elements=(*self.elements, element))
        _ = whole._carried  # refuses elements on other places
        return whole

    @cached_property
    def _carried(self) -> CarriedElements:
        size, shift = len(self.places), self.free_body.shift
        return CarriedElements.of(self.elements, self.rows_of, size, shift)

    def rows_of(self, place: SinglePlace, label: str) -> list[tuple[int, float]]:
        if place == 0:
            return []
        require_known(f"{label}: no place", [place], self.places)
        return [(self.places.index(place), 1.0)]

    def __getstate__(self) -> dict[str, Any]:
        """Without places that bear no element: each of a search's hypotheses goes to a process."""
        kept = self._carried.acted_on
        state = {field.name: getattr(self, field.name) for field in fields(self)}
        state["places"] = tuple(self.places[row] for row in kept.tolist())
        for name in ("motions", "flexibilities", "moved_sensors"):
            state[name] = state[name][kept]
        return state

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        springs, masses = map(coefficients_of, (self._carried.springs, self._carried.masses))
        of_stiffness, of_mass = ([c for c, _ in terms] for terms in (self.stiffness, self.mass))
        return parameters_of([*of_stiffness, *springs, *of_mass, *masses])

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return (*self.measured, *self.appendages)

    @property
    def n_modes(self) -> int:
        return self.n_main_modes + len(self.appendages)

    def modes(self, values: FloatArray) -> Modes:
        return self.modes_with(values, self.vectors)

    def modes_with(self, values: FloatArray, vectors: ElementVectors) -> Modes:
        """The modes (B, ...) with the elements at other places, which may differ row by row."""
        springs, masses = (table.evaluate(values) for table in self._tables)
        stiffness, mass = (matrix.evaluate(values) for matrix in self._main_matrices)
        # In series with the residual flexibility at their places.
        springs = springs / (1.0 + springs * vectors.flexibilities)
        stiffness = stiffness + _sum_of_squares(springs, vectors.springs)
        # Where every mass moves with a single coordinate, the mass stays diagonal.
        if mass.ndim == 2 and (np.count_nonzero(vectors.masses, axis=2) <= 1).all():
            mass = mass + np.einsum("bt,bti->bi", masses, vectors.masses**2)
        else:
            whole = mass[:, :, None] * np.eye(mass.shape[1]) if mass.ndim == 2 else mass
            mass = whole + _sum_of_squares(masses, vectors.masses)
        free = self.free_body
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
        """The elements where they are, (1, ...)."""
        rows = self._carried.acted_on
        by_places, own = self._carried.components(self._carried.springs)
        moved = by_places @ self.moved_sensors[rows]
        masses, masses_own = self._carried.components(self._carried.masses)
        return ElementVectors(
            springs=np.hstack([by_places @ self.motions[rows], own])[None],
            flexibilities=((by_places @ self.flexibilities[rows]) ** 2).sum(axis=1)[None],
            at_sensors=np.hstack([moved, 0.0 * own])[None],
            masses=np.hstack([masses @ self.motions[rows], masses_own])[None],
        )

    @cached_property
    def _tables(self) -> tuple[ProductTable, ProductTable]:
        springs, masses = map(coefficients_of, (self._carried.springs, self._carried.masses))
        return ProductTable(springs, self.parameters), ProductTable(masses, self.parameters)

    @cached_property
    def _main_matrices(self) -> tuple[AffineArray, AffineArray]:
        """Without the elements, (B, N + p, N + p); of a mass perhaps the diagonal alone."""
        p = len(self.appendages)

        def padded(terms: Sequence[tuple[Product, FloatArray]]) -> AffineArray:
            arrays = [(coefficient, np.pad(array, (0, p))) for coefficient, array in terms]
            return AffineArray.of(arrays, self.parameters, arrays[0][1].shape)

        return padded(self.stiffness), padded(self.mass)

    @cached_property
    def _at_sensors(self) -> FloatArray:
        """(d + p, N + p), of sensors and own degrees of freedom."""
        return scipy.linalg.block_diag(self.at_sensors, np.eye(len(self.appendages)))


def _sum_of_squares(coefficients: FloatArray, vectors: FloatArray) -> FloatArray:
    """Σ c v vᵀ (B, n, n) for coefficients (B, k) and vectors (1 or B, k, n)."""
    return np.einsum("bk,bki,bkj->bij", coefficients, vectors, vectors)


def modes_at_places(
    structures: Sequence[Structure],
) -> Callable[[FloatArray, NDArray[np.intp]], Modes]:
    """The modes (B, ...) of structures ``which`` (B,) at values (B, n_parameters), row by row.

    The structures are projected ones of one model that have :func:`all_but_places` in common;
    values are in the order of each one's own parameters.
    """
    projected = [each for each in structures if isinstance(each, ProjectedStructure)]
    vectors = joined([each.vectors for each in projected])

    def modes(values: FloatArray, which: NDArray[np.intp]) -> Modes:
        rows = ElementVectors(*(array[which] for array in vectors))
        return projected[0].modes_with(values, rows)

    return modes


def all_but_places(structure: Structure) -> Hashable:
    """What structures have in common that :func:`modes_at_places` joins; None of another kind."""
    if not isinstance(structure, ProjectedStructure):
        return None
    carried, number = structure._carried, structure.parameters.index
    added = tuple(
        (product.scale, tuple((number(p), power) for p, power in product.powers))
        for terms in (carried.springs, carried.masses)
        for product in coefficients_of(terms)
    )
    kinds = tuple(map(type, structure.elements))
    return id(structure.stiffness), id(structure.mass), kinds, added
