"""Factors of sparse symmetric matrices, and the signs of their pivots.

K is factorised as L D Lᵀ, with pivots from the diagonal, in an order that keeps the factors sparse.
The order is computed once for a sparsity pattern and used for every factorisation. By Sylvester's
law of inertia K - σM has as many negative pivots as there are modes with (2πf)² < σ.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.finite_elements.matrix_files import FILE_ROUNDING, Matrix
from bayes_ssi.structures.modal import NOT_SUPPORTED, NoModesError

# Modes are counted below a shift that differs from every (2πf)² by this share, and with a factor
# that solves equations this accurately: closer to singularity, signs of pivots are unreliable.
RELATIVE_GAP = 1e-6


class Factor:
    """K = L D Lᵀ for a matrix with rows already in a good order."""

    def __init__(self, matrix: Matrix) -> None:
        """Factorise; NoModesError if singular, or if no pivot on the diagonal serves."""
        from scipy.sparse.linalg import splu

        try:
            self._lu = splu(
                sp.csc_matrix(matrix),
                permc_spec="NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError:  # exactly singular
            raise NoModesError("the matrix is singular") from None
        if not np.array_equal(self._lu.perm_r, np.arange(matrix.shape[0])):
            raise NoModesError("the matrix has a pivot of zero")

    @cached_property
    def pivots(self) -> FloatArray:
        """D (n,); from then on the factor keeps copies of L and D Lᵀ, larger than itself."""
        diagonal: FloatArray = self._lu.U.diagonal()
        return diagonal

    @property
    def n_negative(self) -> int:
        """Number of negative eigenvalues."""
        return int((self.pivots < 0.0).sum())

    def solve(self, right: FloatArray) -> FloatArray:
        """K⁻¹ times vectors (n,) or (n, k)."""
        solution: FloatArray = self._lu.solve(np.ascontiguousarray(right))
        return solution

    def root_times(self, right: FloatArray) -> FloatArray:
        """C times vectors (n, k), where K = C Cᵀ is positive definite."""
        product: FloatArray = self._lu.L @ (np.sqrt(self.pivots)[:, None] * right)
        return product


def stiffness_factor(stiffness: Matrix) -> Factor:
    """The factor of a stiffness matrix; NoModesError if it is singular."""
    try:
        return Factor(stiffness)
    except NoModesError:
        raise NoModesError(NOT_SUPPORTED) from None


def require_positive_definite(factor: Factor) -> None:
    """Check the factor of a stiffness matrix; NoModesError if it has a negative eigenvalue."""
    if factor.n_negative:
        raise NoModesError("the stiffness matrix is not positive definite")


def fill_reducing_order(matrix: Matrix) -> NDArray[np.intp]:
    """An order of the rows (n,) in which the factors of a positive definite matrix stay sparse.

    Of two, the one with fewer entries of factors: by minimum degree, which suits most structures,
    and by the reverse Cuthill-McKee algorithm, whose narrow band suits slender ones.
    """
    from scipy.sparse.csgraph import reverse_cuthill_mckee
    from scipy.sparse.linalg import splu

    try:
        factor = splu(
            sp.csc_matrix(matrix),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        raise NoModesError("the matrix is singular") from None
    banded = reverse_cuthill_mckee(sp.csr_matrix(matrix), symmetric_mode=True).astype(np.intp)
    if 2 * _envelope(matrix, banded) <= factor.nnz:
        return banded
    return np.argsort(factor.perm_c)


def _envelope(matrix: Matrix, order: NDArray[np.intp]) -> int:
    """Number of entries from the first one to the diagonal, over all rows in an ``order``.

    A factor L has entries nowhere else (George and Liu 1981, section 4.2).
    """
    place = np.argsort(order)
    first = np.minimum.reduceat(place[matrix.indices], matrix.indptr[:-1])
    return int((place - first + 1).sum())


def count_below(stiffness: Matrix, mass: Matrix, shift: float) -> int:
    """Number of modes with (2πf)² < ``shift``, by the signs of the pivots of K - shift·M."""
    shifted = sp.csc_array(stiffness - shift * mass)
    factor = Factor(shifted)
    right = np.cos(np.arange(1.0, stiffness.shape[0] + 1.0))
    solution = factor.solve(right)
    scale = abs(shifted).sum(axis=1).max() * np.linalg.norm(solution) + np.linalg.norm(right)
    if not np.linalg.norm(shifted @ solution - right) <= RELATIVE_GAP * scale:
        raise NoModesError("K - shift·M is too close to singular")
    return factor.n_negative


def is_semidefinite(matrix: Matrix) -> bool:
    """Whether no eigenvalue is negative but for rounding."""
    largest = float(np.abs(matrix.diagonal()).max(initial=0.0))
    if largest == 0.0:
        return matrix.nnz == 0
    shift = sp.diags_array(np.full(matrix.shape[0], FILE_ROUNDING * largest))
    try:
        return Factor(sp.csc_array(matrix + shift)).n_negative == 0
    except NoModesError:
        return False
