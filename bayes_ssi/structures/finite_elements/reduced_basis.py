"""A reduced basis for K(θ) = Σ c_t K_t and M(θ) = Σ d_u M_u, with its error at any θ.

The modes of some parameter values span the basis V, orthonormal in the energy of a reference K_r
(that of the prior medians). Modes at other values are approximated in that span by the
Rayleigh-Ritz method: Vᵀ K V y = μ Vᵀ M V y, a small problem whose matrices are sums of small ones.

Its error follows from the residual r = K u - μ M u of u = V y in the full model. With u at unit
energy, uᵀ K u = 1, and η² = rᵀ K⁻¹ r, some mode has |μ/λ - 1| ≤ η; and where all others are at a
relative distance of at least δ, |μ/λ - 1| ≤ η²/δ (Temple, Kato). Modes closer to one another than
a share (``group_within``) count as one group, whose η² add up.

Shapes at the sensors have two errors. The part of a mode outside the basis is about
K⁻¹ r/(1 - μ/μ_m+1), which the sensors measure as Eᵀ K⁻¹ r, here with K_r for K and divided by α.
And modes i and j are mixed with one another by about η_i η_j/|1 - μ_i/μ_j|. Both are estimates of
first order, not bounds.

rᵀ K⁻¹ r ≤ rᵀ K_r⁻¹ r / α where K - α K_r is positive semi-definite, as for the least ratio α of
coefficients c_t(θ)/c_t(θ_r) where all K_t are. The norm of r in K_r⁻¹ is estimated by a sketch, a
few random combinations Sᵀr with S = K_r⁻¹ C Ω, K_r = C Cᵀ and Ω normally distributed: its square
is their mean square, so that small matrices give it too (Balabanov and Nouy 2019).

An element acts on the model by forces at its places. What a basis lacks for that is the static
answer K_r⁻¹ v to each of them, and the elements' own degrees of freedom. Of these the elongation
s = v·x of an element's spring is a coordinate of its own: in the model's displacements u and in s,
the stiffness is that of the model without elements and, apart from it, the spring's, so that the
norm of residuals is that of the model without elements, and s leaves no residual.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures import modal
from bayes_ssi.structures.finite_elements.matrix_system import Coefficients, System
from bayes_ssi.structures.finite_elements.model_arguments import Matrix
from bayes_ssi.structures.finite_elements.sparse_modes import Factor, is_semidefinite
from bayes_ssi.structures.matrix_terms import AddedTerm, CarriedElements
from bayes_ssi.structures.modal import Eigenpairs

SKETCH_SIZE = 160  # random combinations in the sketch of a residual
# Factor on their mean square: the square of the norm is larger in 4 of 10 000 cases (χ² with as
# many degrees of freedom).
SKETCH_MARGIN = 1.5
# Combinations that are solved for at a time (a divisor of their number), to take little memory.
SKETCH_BLOCK = 16
# Eigenvalues that differ by less than this share count as one group: hardly more than the
# distance of frequencies (half as large) that a test resolves.
GROUP_WITHIN = 0.02
# Modes that move the sensors by less than this share of the most visible mode, at unit modal
# mass, count as if they moved them by as much: no test identifies them, and their shapes there
# follow from small asymmetries of the mesh.
LEAST_VISIBLE = 0.05


class Bounds(NamedTuple):
    """Largest errors of reduced modes."""

    frequency: FloatArray  # (m,), as a fraction of the frequency
    shape: FloatArray  # (m,), at the sensors, of shapes that have unit length there


class Reference:
    """The model at the reference values, which defines the norms of residuals and bases.

    Attributes:
        sketch: (n, sketch_size + d), S and, for the d sensors, K_r⁻¹ E.
    """

    def __init__(
        self, system: System, sensor_rows: NDArray[np.intp], coefficients: Coefficients
    ) -> None:
        self.stiffness, self.mass, self.sensors = system.stiffness, system.mass, sensor_rows
        self.n_terms = len(self.stiffness.matrices), len(self.mass.matrices)
        self.coefficients = coefficients
        self.matrix = self.stiffness.at(coefficients.stiffness)
        # Not kept: with its pivots it is large.
        factor = Factor(self.matrix, modal.NOT_SUPPORTED)
        factor.require_positive_definite()
        n, n_random = self.matrix.shape[0], SKETCH_SIZE
        self.sketch = sketch = np.zeros((n, n_random + len(self.sensors)))
        sketch[self.sensors, n_random + np.arange(len(self.sensors))] = 1.0
        sketch[:, :n_random] = np.random.default_rng(0).standard_normal((n, n_random))
        sketch[:, :n_random] /= np.sqrt(n_random)
        for first in range(0, sketch.shape[1], SKETCH_BLOCK):
            part = sketch[:, first : first + SKETCH_BLOCK]
            part[:] = factor.solve(factor.root_times(part) if first < n_random else part)
        del factor
        self.definite = all(is_semidefinite(each) for each in self.stiffness.matrices)

    @cached_property
    def factor(self) -> Factor:
        """Of the stiffness, which solves K_r x = f."""
        return Factor(self.matrix, modal.NOT_SUPPORTED)


_REFERENCES: dict[bytes, Reference] = {}


def reference_of(
    system: System, sensor_rows: NDArray[np.intp], coefficients: Coefficients
) -> Reference:
    """The reference, made once in a process for all copies of a model that are sent to it."""
    matrices = (*system.stiffness.matrices, *system.mass.matrices)
    arrays = [array for each in matrices for array in (each.data, each.indices, each.indptr)]
    content = blake2b()
    for array in (*arrays, sensor_rows, *coefficients):
        content.update(array.tobytes())
    key = content.digest()
    if key not in _REFERENCES:
        if len(_REFERENCES) == 2:  # a class seldom has more large models
            del _REFERENCES[next(iter(_REFERENCES))]
        _REFERENCES[key] = Reference(system, sensor_rows, coefficients)
    return _REFERENCES[key]


class Elongations:
    """Elements' own degrees of freedom q = B⁻¹ (s - A u), of elongations s = A u + B q."""

    def __init__(self, carried: CarriedElements) -> None:
        # (r,), degrees of freedom of the model at which elements act; A has these columns.
        self.rows = carried.acted_on
        a, b = carried.components(carried.own_springs)
        self.inverse = np.linalg.inv(b).astype(np.float64)  # B⁻¹ (p, p)
        self.follow = self.inverse @ a  # B⁻¹ A (p, r)

    def directions(self, carried: CarriedElements, terms: Sequence[AddedTerm]) -> list[FloatArray]:
        """Components of directions by u (n_terms, r) and by s (n_terms, p)."""
        by_u, by_q = carried.components(terms)
        remaining = by_u - by_q @ self.follow
        # An own spring is an elongation, and moves nothing else but for rounding.
        remaining[np.abs(remaining) <= modal.ROUNDING * np.abs(by_q @ self.follow)] = 0.0
        return [remaining, by_q @ self.inverse]


class TermsInBasis(NamedTuple):
    """The terms of the stiffness, or those of the mass, in N coordinates."""

    matrices: FloatArray  # (T, N, N)
    residuals: FloatArray  # (T, sketch_size + d, N), the reference's sketch of each term times them

    def first(self, n_terms: int, n: int) -> "TermsInBasis":
        return TermsInBasis(self.matrices[:n_terms, :n, :n], self.residuals[:n_terms, :, :n])

    def spanning(
        self, given: Sequence[Matrix], vectors: FloatArray, n_new: int, sketch: FloatArray
    ) -> "TermsInBasis":
        """The terms ``given`` in the basis whose last vectors (n, N) are new."""
        n_before = vectors.shape[1] - n_new
        by_new = np.array([matrix @ vectors[:, n_before:] for matrix in given])
        columns = vectors.T @ by_new
        rows = np.hstack([self.matrices, columns[:, :n_before].transpose(0, 2, 1)])
        whole = np.dstack([rows, columns])
        residuals = np.dstack([self.residuals, sketch.T @ by_new])
        return TermsInBasis(0.5 * (whole + whole.transpose(0, 2, 1)), residuals)


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """A basis of the model's displacements, and the matrices of small problems in it.

    With elements, its N coordinates are those of vectors without them, of static answers to the
    elements' forces, and elongations.
    """

    stiffness: TermsInBasis
    mass: TermsInBasis
    at_sensors: FloatArray  # (d, N), motions of the sensors
    vectors: FloatArray  # (n, N), or fewer columns by those elongations
    n_before: int | None = None  # number of vectors without elements; None where there are none
    elongations: Elongations | None = None

    @classmethod
    def empty(cls, reference: Reference) -> "ReducedBasis":
        n, n_sketch = reference.sketch.shape
        stiffness, mass = (
            TermsInBasis(np.zeros((n_terms, 0, 0)), np.zeros((n_terms, n_sketch, 0)))
            for n_terms in reference.n_terms
        )
        return cls(stiffness, mass, np.zeros((len(reference.sensors), 0)), np.zeros((n, 0)))

    @property
    def size(self) -> int:
        return int(self.stiffness.matrices.shape[1])

    def without_elements(self, reference: Reference) -> "ReducedBasis":
        if self.n_before is None:
            return self
        n, (n_k, n_m) = self.n_before, reference.n_terms
        return ReducedBasis(
            self.stiffness.first(n_k, n),
            self.mass.first(n_m, n),
            self.at_sensors[: len(reference.sensors), :n],
            self.vectors[:, :n],
        )

    def carrying(
        self, carried: CarriedElements, negligible: float, reference: Reference
    ) -> "ReducedBasis":
        """The basis that carries some elements, from one without any."""
        if not carried.springs and not carried.masses:
            return self
        elongations = Elongations(carried)
        rows, p = elongations.rows, len(carried.labels)
        springs, masses = (
            elongations.directions(carried, terms) for terms in (carried.springs, carried.masses)
        )
        loads = np.vstack([springs[0], masses[0]])
        loads = loads[np.abs(loads).max(axis=1, initial=0.0) > 0.0]
        forces = np.zeros((len(self.vectors), len(loads)))
        forces[rows] = loads.T
        wide = self.spanning(reference.factor.solve(forces), negligible, reference)

        def with_terms(
            main: TermsInBasis, terms: Sequence[AddedTerm], by_u: FloatArray, by_s: FloatArray
        ) -> TermsInBasis:
            """Those of the model, and terms c w wᵀ."""
            scales = np.array([term.coefficient.scale for term in terms]).reshape(-1, 1, 1)
            small = np.hstack([by_u @ wide.vectors[rows], by_s])
            matrices = scales * small[:, :, None] * small[:, None, :]
            residuals = scales * (by_u @ reference.sketch[rows])[:, :, None] * small[:, None, :]
            return TermsInBasis(
                np.concatenate([np.pad(main.matrices, ((0, 0), (0, p), (0, p))), matrices]),
                np.concatenate([np.pad(main.residuals, ((0, 0), (0, 0), (0, p))), residuals]),
            )

        own = np.hstack([-elongations.follow @ wide.vectors[rows], elongations.inverse])
        return ReducedBasis(
            with_terms(wide.stiffness, carried.springs, *springs),
            with_terms(wide.mass, carried.masses, *masses),
            np.vstack([np.pad(wide.at_sensors, ((0, 0), (0, p))), own]),
            wide.vectors,
            self.size,
            elongations,
        )

    def loads(self, forces: FloatArray) -> FloatArray:
        """The forces (N,) on the coordinates, of forces on all degrees of freedom."""
        if self.elongations is None:
            return self.vectors.T @ forces
        on_main, on_own = np.split(forces, [len(self.vectors)])
        on_main = on_main.copy()
        on_main[self.elongations.rows] -= self.elongations.follow.T @ on_own
        return np.concatenate([self.vectors.T @ on_main, self.elongations.inverse.T @ on_own])

    def combined(self, directions: FloatArray) -> "ReducedBasis":
        """A basis of some combinations of these vectors, orthonormal columns (N, n)."""
        stiffness, mass = (
            TermsInBasis(directions.T @ terms.matrices @ directions, terms.residuals @ directions)
            for terms in (self.stiffness, self.mass)
        )
        at_sensors, vectors = self.at_sensors @ directions, self.vectors @ directions
        return ReducedBasis(stiffness, mass, at_sensors, vectors)

    def enriched(
        self, modes: Eigenpairs, negligible: float, reference: Reference
    ) -> "ReducedBasis":
        """The basis extended by the parts of some modes of the full model that lie outside it.

        Directions that add less than ``negligible`` to a mode, in energy, are left out. Of a model
        with elements only the motion of the model itself counts.
        """
        new = modes.vectors[: len(self.vectors)] / np.sqrt(modes.eigenvalues)
        energies = np.einsum("nm,nm->m", new, reference.matrix @ new)
        return self.spanning(new[:, energies > negligible**2], negligible, reference)

    def spanning(self, new: FloatArray, negligible: float, reference: Reference) -> "ReducedBasis":
        """The basis extended by vectors (n, k), but for what is ``negligible`` in energy."""
        new = new / np.sqrt(np.einsum("nm,nm->m", new, reference.matrix @ new))
        for _ in range(2):  # once leaves rounding errors
            new = new - self.vectors @ (self.vectors.T @ (reference.matrix @ new))
        energies, directions = np.linalg.eigh(new.T @ (reference.matrix @ new))
        kept = energies > max(negligible**2, modal.ROUNDING)
        if not kept.any():
            return self
        new = new @ (directions[:, kept] / np.sqrt(energies[kept]))
        new = new - self.vectors @ (self.vectors.T @ (reference.matrix @ new))
        new = new @ np.linalg.inv(np.linalg.cholesky(new.T @ (reference.matrix @ new))).T
        vectors, n_new, sketch = np.hstack([self.vectors, new]), new.shape[1], reference.sketch
        return ReducedBasis(
            self.stiffness.spanning(reference.stiffness.matrices, vectors, n_new, sketch),
            self.mass.spanning(reference.mass.matrices, vectors, n_new, sketch),
            vectors[reference.sensors],
            vectors,
        )

    def corrections(
        self, at: Coefficients, n_modes: int, negligible: float, reference: Reference
    ) -> FloatArray:
        """K_r⁻¹ r (n, k) for residuals r of the lowest modes at unit energy, which they lack.

        One step of Davidson's method, with no other factor than that of the reference. Forces of
        elements count as answered by the static solutions that the basis has of them.
        """
        squares, y = modal.lowest_eigenpairs(*self._matrices(at), n_modes, extra=1)
        u = self.vectors @ (y[: self.vectors.shape[1]] / np.sqrt(squares))
        residuals = np.zeros_like(u)
        for c, matrix in zip(at.stiffness, reference.stiffness.matrices, strict=False):
            residuals += c * (matrix @ u)
        for d, matrix in zip(at.mass, reference.mass.matrices, strict=False):
            residuals -= d * (matrix @ u) * squares
        lacking = reference.factor.solve(residuals)
        energies = np.einsum("nm,nm->m", residuals, lacking)
        return lacking[:, energies > negligible**2]

    def bounds(self, at: Coefficients, n_modes: int, reference: Reference) -> Bounds:
        """Bounds on errors of the first ``n_modes`` reduced modes; infinite where unknown."""
        unknown = Bounds(np.full(n_modes, np.inf), np.full(n_modes, np.inf))
        n, n_vectors = self.vectors.shape
        if n_vectors == n:
            return Bounds(np.zeros(n_modes), np.zeros(n_modes))
        if self.size < n_modes:
            return unknown
        alpha = self._least_ratio(at, reference)
        if not alpha > 0.0:
            return unknown
        try:
            eigenvalues, y = modal.lowest_eigenpairs(*self._matrices(at), n_modes, extra=1)
        except modal.NoModesError:
            return unknown
        y = y / np.sqrt(eigenvalues)  # at unit energy, not unit mass
        residuals = _sum(at.stiffness, self.stiffness.residuals) @ y
        residuals -= (_sum(at.mass, self.mass.residuals) @ y) * eigenvalues
        random, at_sensors = np.split(residuals, [SKETCH_SIZE])
        eta = np.linalg.norm(random, axis=0) * math.sqrt(SKETCH_MARGIN / alpha)
        moved = np.linalg.norm(at_sensors, axis=0) / alpha
        moves = np.linalg.norm(self.at_sensors[: len(reference.sensors)] @ y, axis=0)
        return Bounds(
            _frequency_bounds(eigenvalues, eta)[:n_modes],
            _shape_errors(eigenvalues, eta, moves, moved, n_modes),
        )

    def _matrices(self, at: Coefficients) -> tuple[FloatArray, FloatArray]:
        return _sum(at.stiffness, self.stiffness.matrices), _sum(at.mass, self.mass.matrices)

    def _least_ratio(self, at: Coefficients, reference: Reference) -> float:
        """α with K - α K_r positive semi-definite, for the model without elements."""
        of_main = at.stiffness[: reference.n_terms[0]]
        if reference.definite:
            return float((of_main / reference.coefficients.stiffness).min())
        # Otherwise the ratio of energies in the basis, where K_r is the identity, is an estimate.
        whole = _sum(of_main, self.stiffness.matrices[: len(of_main)])
        main = slice(self.vectors.shape[1])
        return float(np.linalg.eigvalsh(whole[main, main])[0])


def _frequency_bounds(eigenvalues: FloatArray, eta: FloatArray) -> FloatArray:
    """Relative errors of frequencies (m,), from η (m,)."""
    apart = np.diff(eigenvalues) > GROUP_WITHIN * eigenvalues[1:]
    group = np.concatenate([[0], np.cumsum(apart)])
    together = np.bincount(group, eta**2)
    # The eigenvalues of the other groups are uncertain by their own residuals.
    lowest = eigenvalues * np.maximum(1.0 - eta, 0.0)
    below, above = np.full(len(together), np.inf), np.full(len(together), np.inf)
    edges = np.flatnonzero(apart)  # between mode i and mode i + 1
    with np.errstate(divide="ignore"):
        above[:-1] = 1.0 - eigenvalues[edges] / lowest[edges + 1]
        below[1:] = lowest[edges + 1] / eigenvalues[edges] - 1.0
    # Modes above the last computed one are only known to be higher.
    above[-1] = GROUP_WITHIN
    gap = np.minimum(below, above)
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = np.where(gap > 0.0, together / gap, np.inf)
    return 0.5 * np.minimum(eta, squared[group])


def _shape_errors(
    eigenvalues: FloatArray, eta: FloatArray, moves: FloatArray, moved: FloatArray, n_modes: int
) -> FloatArray:
    """Errors (n_modes,) at the sensors of shapes of unit length there.

    For m modes, perhaps one more than shapes: ``moves`` (m,) are lengths of the shapes at the
    sensors at unit energy, ``moved`` (m,) the displacements there under the residuals as loads.
    """
    own = slice(0, n_modes)
    beyond = eigenvalues[n_modes] if len(eigenvalues) > n_modes else np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        outside = moved[own] / (1.0 - eigenvalues[own] / beyond)
        distance = np.abs(1.0 - eigenvalues[own, None] / eigenvalues)
        mixed = np.minimum(eta[own, None] * eta / distance, 1.0)
    mixed[np.arange(n_modes), np.arange(n_modes)] = 0.0
    at_unit_mass = moves * np.sqrt(eigenvalues)
    visible = LEAST_VISIBLE * at_unit_mass.max() / np.sqrt(eigenvalues[own])
    with np.errstate(invalid="ignore"):
        errors: FloatArray = (outside + mixed @ moves) / np.maximum(moves[own], visible)
    return np.nan_to_num(errors, nan=0.0, posinf=np.inf)  # without sensors there is no shape


def _sum(coefficients: FloatArray, matrices: FloatArray) -> FloatArray:
    return np.tensordot(coefficients, matrices, axes=1)
