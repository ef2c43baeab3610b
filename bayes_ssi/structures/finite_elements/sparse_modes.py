"""The lowest modes of large sparse matrices: shift-invert Lanczos iterations, and a count.

K is factorised as L D Lᵀ, with pivots from the diagonal, in an order that keeps the factors sparse.
The order is computed once for a sparsity pattern and used for every factorisation. Lanczos
iterations with K⁻¹ M (ARPACK) give the lowest modes. They may miss one, above all of a pair of
equal frequencies, so modes are counted: by Sylvester's law of inertia K - σM has as many negative
pivots as there are modes with (2πf)² < σ.

M may be singular (rotations without inertia, for instance): such directions have no mode of their
own, and where only a few have inertia all modes follow from their flexibility. K must be positive
definite.
"""

import math
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures import modal
from bayes_ssi.structures.finite_elements.model_arguments import FILE_ROUNDING, Matrix
from bayes_ssi.structures.modal import Eigenpairs, NoModesError

DENSE_UP_TO = 150  # smaller problems are solved faster as dense ones
# Modes are counted below a shift that differs from every (2πf)² by this share, and with a factor
# that solves equations this accurately: closer to singularity, signs of pivots are unreliable.
COUNT_GAP = 1e-6
# By which a free model can be solved, in units of the mean of diagonal stiffness over mass.
FREE_SHIFT = 1e-8
RIGID_SQUARE = 1e-4  # a rigid-body mode's (2πf)² is a smaller share of the next one's
# Steps of inverse iteration, after which a motion of a held model has strain energy, a thousand
# times what rounding makes of a rigid one.
STEPS_TO_LOWEST, CERTAIN = 6, 1e3


class Factor:
    """K = L D Lᵀ for a matrix with rows already in a good order."""

    def __init__(self, matrix: Matrix, problem: str = "the matrix is singular") -> None:
        """Factorise; NoModesError if singular, or if no pivot on the diagonal serves."""
        self._lu = _superlu(matrix, problem)
        if not np.array_equal(self._lu.perm_r, np.arange(matrix.shape[0])):
            raise NoModesError(problem)

    @cached_property
    def pivots(self) -> FloatArray:
        """D (n,); from then on the factor keeps copies of L and D Lᵀ, larger than itself."""
        return self._lu.U.diagonal()

    @property
    def n_negative(self) -> int:
        """Number of negative eigenvalues."""
        return int((self.pivots < 0.0).sum())

    def require_positive_definite(self) -> None:
        """Check the factor of a stiffness matrix; NoModesError if it has a negative eigenvalue."""
        if self.n_negative:
            raise NoModesError("the stiffness matrix is not positive definite")

    def solve(self, right: FloatArray) -> FloatArray:
        """K⁻¹ times vectors (n,) or (n, k)."""
        return self._lu.solve(np.ascontiguousarray(right))

    def root_times(self, right: FloatArray) -> FloatArray:
        """C times vectors (n, k), where K = C Cᵀ is positive definite."""
        return self._lu.L @ (np.sqrt(self.pivots)[:, None] * right)


def _superlu(matrix: Matrix, problem: str) -> Any:
    from scipy.sparse.linalg import splu

    columns, options = sp.csc_matrix(matrix), {"SymmetricMode": True}
    try:
        return splu(columns, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)
    except RuntimeError:  # exactly singular
        raise NoModesError(problem) from None


def count_below(stiffness: Matrix, mass: Matrix, shift: float) -> int:
    """Number of modes with (2πf)² < ``shift``, by the signs of the pivots of K - shift·M."""
    shifted = sp.csc_array(stiffness - shift * mass)
    factor = Factor(shifted)
    right = np.cos(np.arange(1.0, stiffness.shape[0] + 1.0))
    solution = factor.solve(right)
    scale = abs(shifted).sum(axis=1).max() * np.linalg.norm(solution) + np.linalg.norm(right)
    if not np.linalg.norm(shifted @ solution - right) <= COUNT_GAP * scale:
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


def lowest_modes(stiffness: Matrix, mass: Matrix, n_modes: int, extra: int = 0) -> Eigenpairs:
    """The ``n_modes`` lowest modes, and perhaps a few more, verified by a count.

    K is positive definite, its rows in an order that keeps factors sparse; M is semi-definite.
    """
    n = stiffness.shape[0]
    # With many modes, Lanczos vectors (twice as many) would span half of the space.
    if n <= DENSE_UP_TO or 4 * n_modes >= n:
        return modal.lowest_eigenpairs(stiffness.toarray(), mass.toarray(), n_modes, extra)
    with_mass = np.flatnonzero(np.diff(mass.indptr))
    if len(with_mass) <= DENSE_UP_TO:
        loads = np.zeros((n, len(with_mass)))
        loads[with_mass, np.arange(len(with_mass))] = 1.0
        factor = Factor(stiffness, modal.NOT_SUPPORTED)
        modes = _modes_under(loads, mass, factor, n_modes, n_modes + extra)
    else:
        modes = _counted(stiffness, mass, n_modes, n_modes + extra)
    modal.require_supported(stiffness, modes.vectors[:, 0])
    return modes


def rigid_body_modes(stiffness: Matrix, mass: Matrix) -> modal.FreeBody:
    """The rigid-body modes of a model, none where it is held.

    A motion is rigid where its strain energy is no more than rounding the entries of K to nine
    digits makes of it, and where its frequency is less than a hundredth of the next.
    """
    inertia = mass.diagonal()
    with_mass = inertia > 0.0
    mean_square = stiffness.diagonal()[with_mass].sum() / inertia[with_mass].sum()
    shift = FREE_SHIFT * mean_square
    shifted = sp.csc_array(stiffness + shift * mass)
    try:
        factor = Factor(shifted)
        lowest = np.random.default_rng(0).standard_normal((len(inertia), 1))
        for _ in range(STEPS_TO_LOWEST):
            lowest = factor.solve(mass @ (lowest / np.linalg.norm(lowest)))
        if _strain(stiffness, lowest)[0] > CERTAIN:
            return modal.FreeBody()
        del factor  # before there is another one
        # One more than the six that a body in space may have.
        modes = lowest_modes(shifted, mass, 1, extra=6)
    except NoModesError:
        return modal.FreeBody()  # whatever is wrong is said where its modes are computed
    squares = modes.eigenvalues - shift
    without_strain = np.logical_and.accumulate(_strain(stiffness, modes.vectors) <= 1.0)
    steps = squares[:-1] < RIGID_SQUARE * squares[1:]
    numbers = np.flatnonzero(without_strain[:-1] & steps) + 1
    if not len(numbers):
        return modal.FreeBody()
    number = int(numbers[-1])
    # Of the order of the lowest frequency above, so that its digits are kept.
    return modal.FreeBody(number, 0.5 * float(squares[number]))


def _strain(stiffness: Matrix, shapes: FloatArray) -> FloatArray:
    """Strain energy (m,) of shapes (n, m), over what rounding K to nine digits may make of it."""
    energy, parts = np.einsum("nm,nm->m", shapes, stiffness @ shapes), shapes**2
    # The standard deviation of Σ φ_i φ_j ΔK_ij, whose terms are equal two by two.
    nine_digits = 5e-10 / math.sqrt(3.0)  # standard deviation of the rounding, over an entry
    rounding = nine_digits * np.sqrt(2.0 * np.einsum("nm,nm->m", parts, stiffness**2 @ parts))
    return np.asarray(np.abs(energy) / (4.0 * rounding))


def _counted(stiffness: Matrix, mass: Matrix, n_modes: int, at_most: int) -> Eigenpairs:
    """Modes by Lanczos iterations, verified by a count, which also shows K positive definite.

    The factors of iterations and of the count are never in memory together.
    """
    n = stiffness.shape[0]
    problem = "there is no gap between eigenvalues"
    for attempt in range(4):  # each with another start vector and more modes
        factor = Factor(stiffness, modal.NOT_SUPPORTED)
        if attempt:
            factor.require_positive_definite()
        n_computed = min(at_most + 2 + 6 * attempt, n - 2)
        try:
            modes = _lanczos(stiffness, mass, factor, n_computed, attempt)
        except NoModesError as error:
            problem = str(error)
            break
        del factor
        last = _last_before_a_gap(modes.eigenvalues, at_most)
        if last is None:
            continue
        shift = float(modes.eigenvalues[last - 1 : last + 1].mean())
        try:
            count = count_below(stiffness, mass, shift)
        except NoModesError:
            continue
        if count == last:
            # The count includes negative eigenvalues of K: with positive ones alone it has none.
            if not modes.eigenvalues[0] > 0.0:
                Factor(stiffness, modal.NOT_SUPPORTED).require_positive_definite()
            modal.settle(modes.eigenvalues[None, :last], modes.vectors[None, :, :last])
            return Eigenpairs(modes.eigenvalues[:last], modes.vectors[:, :last])
        problem = f"Lanczos iterations gave {last} modes where Sylvester's law counts {count}"
    # Iterations stop early where M has hardly more modes than are asked for.
    normal = np.random.default_rng(n).standard_normal((n, 2 * (at_most + 10)))
    loads, factor = mass @ normal, Factor(stiffness, modal.NOT_SUPPORTED)
    energies = np.linalg.eigvalsh(loads.T @ factor.solve(loads))
    if energies.min() <= modal.ROUNDING * energies.max():
        return _modes_under(loads, mass, factor, n_modes, at_most)
    raise NoModesError(f"the modes could not be verified: {problem}")


def _modes_under(
    loads: FloatArray, mass: Matrix, factor: Factor, n_modes: int, at_most: int
) -> Eigenpairs:
    """The lowest modes, where the inertia of any motion is a sum of ``loads`` (n, k).

    Modes are deflections under such loads, so the Rayleigh-Ritz method gives all of them.
    """
    factor.require_positive_definite()
    moved = factor.solve(loads)
    energies, directions = np.linalg.eigh(loads.T @ moved)
    kept = energies > modal.ROUNDING * energies.max(initial=0.0)
    unit = moved @ (directions[:, kept] / np.sqrt(energies[kept]))
    inverses, mixed = np.linalg.eigh(unit.T @ (mass @ unit))
    inverses, mixed = inverses[::-1], mixed[:, ::-1]
    if len(inverses) and inverses[-1] < -modal.ROUNDING * max(inverses[0], -inverses[-1]):
        raise NoModesError("the mass matrix is not positive semi-definite")
    return modal.eigenpairs_of_inverses(inverses, unit @ mixed, n_modes, at_most)


def _last_before_a_gap(eigenvalues: FloatArray, n_modes: int) -> int | None:
    """Number of modes to keep, ``n_modes`` or more: those below the widest gap."""
    gaps = np.diff(eigenvalues) / eigenvalues[1:]
    candidates = [n for n in range(n_modes, len(eigenvalues)) if gaps[n - 1] > COUNT_GAP]
    return max(candidates, key=lambda n: gaps[n - 1], default=None)


def _lanczos(
    stiffness: Matrix, mass: Matrix, factor: Factor, n_modes: int, attempt: int
) -> Eigenpairs:
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

    n = stiffness.shape[0]
    # In the range of K⁻¹M, as a singular M demands.
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
    # One more step of inverse iteration: where M is singular, Lanczos vectors accumulate
    # components in its null space, which no mode has.
    vectors = factor.solve(mass @ vectors[:, order])
    inertia = np.einsum("nm,nm->m", vectors, mass @ vectors)
    if not inertia.min() > 0.0:
        raise NoModesError("the mass matrix is not positive semi-definite, or has too low a rank")
    energy = np.einsum("nm,nm->m", vectors, stiffness @ vectors)
    values = energy / inertia
    again = np.argsort(values)
    return Eigenpairs(values[again], (vectors / np.sqrt(inertia))[:, again])
