"""A reduced basis that carries elements, made from one for the model without them.

An element acts on the model by forces at its places. What the basis lacks for that is the static
answer K_r⁻¹ v to each of them, and the elements' own degrees of freedom. Of these the elongation
s = v·x of an element's spring is a coordinate of its own: in the model's displacements u and in s,
the stiffness is that of the model without elements and, apart from it, the spring's, so that the
norm of residuals is that of the model without elements, and s leaves no residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Product
from bayes_ssi.structures.finite_elements.elements_on_rows import ElementsOnRows, Vector
from bayes_ssi.structures.finite_elements.reduced_basis import ReducedBasis, Reference, SmallProblem
from bayes_ssi.structures.modal import ROUNDING


@dataclass(frozen=True, eq=False)
class CarryingBasis(SmallProblem):
    """A basis of the model without elements, static answers, and elongations of own springs.

    Attributes:
        statics: (n, k), the part of the static answers that lies outside that basis.
        elongations: how the elements' own degrees of freedom follow from elongations.
    """

    main: ReducedBasis
    statics: FloatArray
    elongations: _Elongations

    @classmethod
    def of(
        cls, main: ReducedBasis, carried: ElementsOnRows, negligible: float, reference: Reference
    ) -> CarryingBasis:
        """The basis that carries some elements."""
        elongations = _Elongations.of(carried)
        of_springs, of_masses = map(elongations.directions, (carried.springs, carried.masses))
        loads = np.vstack([of_springs[0], of_masses[0]])
        loads = loads[np.abs(loads).max(axis=1, initial=0.0) > 0.0]
        forces = np.zeros((len(main.vectors), len(loads)))
        forces[elongations.rows] = loads.T
        wide = main.spanning(reference.factor.solve(forces), negligible, reference)
        n_own, rows = len(carried.labels), elongations.rows
        k, residual_k = _terms(carried.springs, of_springs, wide, reference, rows)
        m, residual_m = _terms(carried.masses, of_masses, wide, reference, rows)
        own = np.hstack([-elongations.follow @ wide.vectors[rows], elongations.inverse])
        return cls(
            np.concatenate([_widened(wide.stiffness, n_own, n_own), k]),
            np.concatenate([_widened(wide.mass, n_own, n_own), m]),
            np.concatenate([_widened(wide.residual_stiffness, 0, n_own), residual_k]),
            np.concatenate([_widened(wide.residual_mass, 0, n_own), residual_m]),
            np.vstack([_widened(wide.at_sensors[None], 0, n_own)[0], own]),
            main,
            wide.vectors[:, main.size :],
            elongations,
        )

    @property
    def main_size(self) -> int:
        return self.main.size + self.statics.shape[1]

    @property
    def is_whole(self) -> bool:
        return self.main_size == len(self.statics)

    def loads(self, forces: FloatArray) -> FloatArray:
        n = len(self.statics)
        on_main, on_own = forces[:n].copy(), forces[n:]
        on_main[self.elongations.rows] -= self.elongations.follow.T @ on_own
        return np.concatenate(
            [
                self.main.vectors.T @ on_main,
                self.statics.T @ on_main,
                self.elongations.inverse.T @ on_own,
            ]
        )


@dataclass(frozen=True, eq=False)
class _Elongations:
    """Own degrees of freedom q = B⁻¹ (s - A u), of elongations s = A u + B q.

    Attributes:
        rows: (r,), degrees of freedom of the model at which elements act; A has these columns.
        follow: B⁻¹ A (p, r).
        inverse: B⁻¹ (p, p).
    """

    rows: NDArray[np.intp]
    follow: FloatArray
    inverse: FloatArray
    size: int

    @classmethod
    def of(cls, carried: ElementsOnRows) -> _Elongations:
        vectors = [vector for _, vector in (*carried.springs, *carried.masses)]
        acted_on = sorted({row for vector in vectors for row in vector if row < carried.size})
        rows, n_own = np.array(acted_on, dtype=np.intp), len(carried.labels)
        own = [carried.springs[i][1] for i in carried.own_springs()]
        a, b = _split(own, rows, carried.size, n_own)
        inverse = np.linalg.inv(b).astype(np.float64)
        return cls(rows, inverse @ a, inverse, carried.size)

    def directions(
        self, terms: tuple[tuple[Product, Vector], ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Components of directions by u (n_terms, r) and by s (n_terms, p)."""
        vectors = [vector for _, vector in terms]
        by_u, by_q = _split(vectors, self.rows, self.size, len(self.inverse))
        remaining = by_u - by_q @ self.follow
        # An own spring is an elongation, and moves nothing else but for rounding.
        remaining[np.abs(remaining) <= ROUNDING * np.abs(by_q @ self.follow)] = 0.0
        return remaining, by_q @ self.inverse


def _split(
    vectors: list[Vector], rows: NDArray[np.intp], size: int, n_own: int
) -> tuple[FloatArray, FloatArray]:
    """Components of vectors at ``rows`` of the model (n, r), and at own rows (n, p)."""
    whole = np.array([[v.get(int(row), 0.0) for row in rows] for v in vectors])
    own = np.array([[v.get(size + i, 0.0) for i in range(n_own)] for v in vectors])
    return whole.reshape(len(vectors), len(rows)), own.reshape(len(vectors), n_own)


def _terms(
    terms: tuple[tuple[Product, Vector], ...],
    directions: tuple[FloatArray, FloatArray],
    wide: ReducedBasis,
    reference: Reference,
    rows: NDArray[np.intp],
) -> tuple[FloatArray, FloatArray]:
    """Matrices of terms c v vᵀ in the coordinates, (n, N, N), and of residuals (n, sketch, N)."""
    by_u, by_s = directions
    scales = np.array([coefficient.scale for coefficient, _ in terms]).reshape(-1, 1, 1)
    small = np.hstack([by_u @ wide.vectors[rows], by_s])
    sketched = by_u @ reference.sketch[rows]
    return (
        scales * small[:, :, None] * small[:, None, :],
        scales * sketched[:, :, None] * small[:, None, :],
    )


def _widened(matrices: FloatArray, n_rows: int, n_columns: int) -> FloatArray:
    """Matrices (T, N, M) with further rows and columns of zeros."""
    return np.pad(matrices, ((0, 0), (0, n_rows), (0, n_columns)))
