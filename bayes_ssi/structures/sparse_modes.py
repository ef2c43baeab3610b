"""The lowest modes of large sparse matrices: shift-invert Lanczos, and a count of what it found.

K is factorised as L D Lᵀ, with pivots from the diagonal, in an order that keeps the factors
sparse. The order is found once for a sparsity pattern and used for every factorisation, the part
of the symbolic work that SuperLU lets one keep. Lanczos iterations with K⁻¹ M (ARPACK) give the
lowest modes. They may overlook one, of a pair of equal frequencies above all, so they are counted:
by Sylvester's law of inertia K - σM has as many negative pivots as there are modes with
(2πf)² < σ.

M may be singular (rotations without inertia, for instance): such directions have no mode of their
own. K must be positive definite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.priors import FloatArray
from bayes_ssi.structures.matrix_files import Matrix

__all__ = [
    "DENSE_BELOW",
    "Factor",
    "NoModesError",
    "SparseModes",
    "count_below",
    "dense_modes",
    "fill_reducing_order",
    "frequencies_hz",
    "is_semidefinite",
    "lowest_modes",
]

# Smaller problems, and those of which a large part of the modes is asked for, are solved densely.
DENSE_BELOW = 150
DENSE_SHARE = 0.25
# Eigenvalues closer than this share of their size leave no room for a shift between them.
ROOM = 1e-6
ATTEMPTS = 4
# Of a solution with a factor without pivoting; a larger one says that its pivots mean nothing.
FACTOR_ERROR = 1e-6
# A mode whose 1/(2πf)² is this share of the first one's is none: M is singular.
SINGULAR = 1e-14
# Added to the diagonal, as a share of its largest entry, where a zero eigenvalue is allowed.
NUDGE = 1e-9


class NoModesError(ValueError):
    """The matrices have no modes, or not as many as are asked for."""


class SparseModes(NamedTuple):
    """Modes of one structure.

    Attributes:
        eigenvalues: (m,), (2πf)² ascending.
        vectors: (n, m), at unit modal mass.
    """

    eigenvalues: FloatArray
    vectors: FloatArray


class Factor:
    """K = L D Lᵀ for a matrix whose rows are in a good order already.

    Attributes:
        pivots: (n,), D.
    """

    def __init__(self, matrix: Matrix) -> None:
        """Factorise.

        Raises:
            NoModesError: the matrix is singular, or has no factor with pivots from the diagonal.
        """
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
        self.pivots: FloatArray = self._lu.U.diagonal()

    @property
    def n_negative(self) -> int:
        """How many eigenvalues are negative."""
        return int((self.pivots < 0.0).sum())

    def solve(self, right: FloatArray) -> FloatArray:
        """K⁻¹ times vectors (n,) or (n, k)."""
        found: FloatArray = self._lu.solve(np.ascontiguousarray(right))
        return found

    def root_times(self, right: FloatArray) -> FloatArray:
        """C times vectors (n, k), where K = C Cᵀ; of a positive definite matrix."""
        found: FloatArray = self._lu.L @ (np.sqrt(self.pivots)[:, None] * right)
        return found


def fill_reducing_order(matrix: Matrix) -> NDArray[np.intp]:
    """An order of the rows (n,) in which the factors of a positive definite matrix stay sparse.

    Raises:
        NoModesError: the matrix is singular.
    """
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
    return np.argsort(factor.perm_c)


def count_below(stiffness: Matrix, mass: Matrix, shift: float) -> int:
    """How many modes have (2πf)² < ``shift``, by the signs of the pivots of K - shift·M.

    Raises:
        NoModesError: K - shift·M cannot be factorised; the shift lies on a mode.
    """
    shifted = sp.csc_array(stiffness - shift * mass)
    factor = Factor(shifted)
    probe = np.cos(np.arange(1.0, stiffness.shape[0] + 1.0))
    answer = factor.solve(probe)
    scale = abs(shifted).sum(axis=1).max() * np.linalg.norm(answer) + np.linalg.norm(probe)
    if not np.linalg.norm(shifted @ answer - probe) <= FACTOR_ERROR * scale:
        raise NoModesError("K - shift·M is too close to singular")
    return factor.n_negative


def is_semidefinite(matrix: Matrix) -> bool:
    """Whether no eigenvalue is below zero, but for rounding."""
    largest = float(np.abs(matrix.diagonal()).max(initial=0.0))
    if largest == 0.0:
        return matrix.nnz == 0
    nudge = sp.diags_array(np.full(matrix.shape[0], NUDGE * largest))
    try:
        return Factor(sp.csc_array(matrix + nudge)).n_negative == 0
    except NoModesError:
        return False


def lowest_modes(stiffness: Matrix, mass: Matrix, n_modes: int) -> SparseModes:
    """The ``n_modes`` lowest modes, and perhaps a few more, counted.

    Args:
        stiffness: (n, n), positive definite, its rows in a good order (see
            :func:`fill_reducing_order`).
        mass: (n, n), positive semi-definite.
        n_modes: how many.

    Raises:
        NoModesError: K is not positive definite, M gives fewer modes, or the count and the modes
            found disagree however it is tried.
    """
    n = stiffness.shape[0]
    if n <= DENSE_BELOW or n_modes >= DENSE_SHARE * n:
        return dense_modes(stiffness.toarray(), mass.toarray(), n_modes)
    factor = Factor(stiffness)
    if factor.n_negative:
        raise NoModesError("the stiffness matrix is not positive definite")
    n_finite = int(np.count_nonzero(np.diff(mass.indptr)))
    told = "nothing was found"
    for attempt in range(ATTEMPTS):
        wanted = min(n_modes + 2 + 6 * attempt, n_finite, n - 2)
        found = _lanczos(stiffness, mass, factor, wanted, attempt)
        if wanted == n_finite:
            return found  # all there are
        last = _place_for_shift(found.eigenvalues, n_modes)
        if last is None:
            continue
        shift = float(found.eigenvalues[last - 1 : last + 1].mean())
        try:
            count = count_below(stiffness, mass, shift)
        except NoModesError:
            continue
        if count == last:
            return SparseModes(found.eigenvalues[:last], found.vectors[:, :last])
        told = f"Lanczos iterations found {last} modes where Sylvester's law counts {count}"
    raise NoModesError(f"the modes could not be made sure of: {told}")


def _place_for_shift(eigenvalues: FloatArray, n_modes: int) -> int | None:
    """How many of the modes to keep, at least ``n_modes``, with room for a shift above them."""
    room = np.diff(eigenvalues) / eigenvalues[1:]
    enough = [last for last in range(n_modes, len(eigenvalues)) if room[last - 1] > ROOM]
    return max(enough, key=lambda last: room[last - 1], default=None)


def _lanczos(
    stiffness: Matrix, mass: Matrix, factor: Factor, n_modes: int, attempt: int
) -> SparseModes:
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

    n = stiffness.shape[0]
    # A start of its own for every attempt, in the range of K⁻¹M, as a singular M demands.
    start = factor.solve(mass @ np.random.default_rng(attempt).standard_normal(n))
    try:
        values, vectors = eigsh(
            sp.csc_matrix(stiffness),
            k=n_modes,
            M=sp.csc_matrix(mass),
            sigma=0.0,
            which="LM",
            v0=start,
            ncv=min(n - 1, max(2 * n_modes + 1, 20)),
            OPinv=LinearOperator((n, n), matvec=factor.solve, dtype=float),
        )
    except ArpackError as error:
        raise NoModesError(f"Lanczos iterations did not converge: {error}") from None
    order = np.argsort(values)
    # One more step of inverse iteration: where M is singular, Lanczos vectors gather what no
    # mode has.
    vectors = factor.solve(mass @ vectors[:, order])
    inertia = np.einsum("nm,nm->m", vectors, mass @ vectors)
    energy = np.einsum("nm,nm->m", vectors, stiffness @ vectors)
    values = energy / inertia
    again = np.argsort(values)
    return SparseModes(values[again], (vectors / np.sqrt(inertia))[:, again])


def dense_modes(
    stiffness: FloatArray, mass: FloatArray, n_modes: int, at_most: int | None = None
) -> SparseModes:
    """The lowest ``n_modes`` modes of small matrices (n, n), and more where there are, if wanted.

    Raises:
        NoModesError: the stiffness is not positive definite, or there are fewer modes.
    """
    size = len(stiffness)
    first = max(size - (at_most or n_modes), 0)
    try:
        # The lowest modes are the greatest 1/λ of M φ = (1/λ) K φ; M may be singular.
        inverses, vectors = scipy.linalg.eigh(
            mass, stiffness, subset_by_index=[first, size - 1], check_finite=False
        )
    except (scipy.linalg.LinAlgError, ValueError):  # not definite; not finite
        raise NoModesError("the stiffness matrix is not positive definite") from None
    inverses, vectors = inverses[::-1], vectors[:, ::-1]
    found = int((inverses > SINGULAR * inverses[0]).sum())
    if found < n_modes:
        raise NoModesError(
            f"the mass matrix gives {found} modes, fewer than the {n_modes} asked for"
        )
    inverses, vectors = inverses[:found], vectors[:, :found]
    return SparseModes(1.0 / inverses, vectors / np.sqrt(inverses))


def frequencies_hz(eigenvalues: FloatArray) -> FloatArray:
    """f for (2πf)²."""
    found: FloatArray = np.sqrt(eigenvalues) / (2.0 * math.pi)
    return found
