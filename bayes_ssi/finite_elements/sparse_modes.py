"""The lowest modes of large sparse matrices: shift-invert Lanczos, and a count of what it found.

Lanczos iterations with K⁻¹ M (ARPACK) give the lowest modes. They may overlook one, of a pair of
equal frequencies above all, so they are counted by the pivots of K - σM (see
:mod:`bayes_ssi.finite_elements.sparse_factors`).

M may be singular (rotations without inertia, for instance): such directions have no mode of their
own, and where only a few have inertia all modes follow from the flexibility of these. K must be
positive definite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.matrix_files import Matrix
from bayes_ssi.finite_elements.sparse_factors import (
    NOT_HELD,
    Factor,
    NoModesError,
    count_below,
    stiffness_factor,
)

__all__ = [
    "DENSE_BELOW",
    "SMALL",
    "SparseModes",
    "batch_of_modes",
    "dense_modes",
    "frequencies_hz",
    "lowest_modes",
    "require_held",
]

# Smaller problems, and those of which a large part of the modes is asked for, are solved densely.
DENSE_BELOW = 150
DENSE_SHARE = 0.25
# Matrices no larger than this are solved faster a batch at a time.
SMALL = 32
# Eigenvalues closer than this share of their size leave no room for a shift between them.
ROOM = 1e-6
ATTEMPTS = 4
# A mode whose 1/(2πf)² is this share of the first one's is none: M is singular.
SINGULAR = 1e-13
# Of the energy of the first mode over what it would be if nothing cancelled: less is rounding.
HELD = 1e-13


class SparseModes(NamedTuple):
    """Modes of one structure.

    Attributes:
        eigenvalues: (m,), (2πf)² ascending.
        vectors: (n, m), at unit modal mass.
    """

    eigenvalues: FloatArray
    vectors: FloatArray


def require_held(stiffness: Matrix | FloatArray, shape: FloatArray) -> None:
    """Refuse a first mode (n,) whose energy is rounding: a rigid body's.

    Raises:
        NoModesError: it is.
    """
    size = np.abs(shape)
    if not shape @ (stiffness @ shape) > HELD * (size @ (abs(stiffness) @ size)):
        raise NoModesError(NOT_HELD)


def lowest_modes(stiffness: Matrix, mass: Matrix, n_modes: int, extra: int = 0) -> SparseModes:
    """The ``n_modes`` lowest modes, and perhaps a few more, counted.

    Args:
        stiffness: (n, n), positive definite, its rows in a good order (see
            :func:`fill_reducing_order`).
        mass: (n, n), positive semi-definite.
        n_modes: how many.
        extra: how many more, where there are so many.

    Raises:
        NoModesError: K is not positive definite, M gives fewer modes, or the count and the modes
            found disagree however it is tried.
    """
    n = stiffness.shape[0]
    if n <= DENSE_BELOW or n_modes >= DENSE_SHARE * n:
        found = dense_modes(stiffness.toarray(), mass.toarray(), n_modes, n_modes + extra)
    else:
        factor = stiffness_factor(stiffness)
        with_mass = np.flatnonzero(np.diff(mass.indptr))
        if len(with_mass) <= DENSE_BELOW:
            loads = np.zeros((n, len(with_mass)))
            loads[with_mass, np.arange(len(with_mass))] = 1.0
            found = _modes_under(loads, mass, factor, n_modes, n_modes + extra)
        else:
            found = _counted(stiffness, mass, factor, n_modes, n_modes + extra)
    require_held(stiffness, found.vectors[:, 0])
    return found


def _counted(
    stiffness: Matrix, mass: Matrix, factor: Factor, n_modes: int, at_most: int
) -> SparseModes:
    """Modes by Lanczos iterations, counted."""
    n = stiffness.shape[0]
    told = "nothing was found"
    for attempt in range(ATTEMPTS):
        wanted = min(at_most + 2 + 6 * attempt, n - 2)
        try:
            found = _lanczos(stiffness, mass, factor, wanted, attempt)
        except NoModesError as error:
            told = str(error)
            break
        last = _place_for_shift(found.eigenvalues, at_most)
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
    # Iterations end early where M has hardly more modes than are asked for.
    normal = np.random.default_rng(ATTEMPTS).standard_normal((n, 2 * (at_most + 10)))
    loads = mass @ normal
    if _rank(loads.T @ factor.solve(loads)) < loads.shape[1]:
        return _modes_under(loads, mass, factor, n_modes, at_most)
    raise NoModesError(f"the modes could not be made sure of: {told}")


def _modes_under(
    loads: FloatArray, mass: Matrix, factor: Factor, n_modes: int, at_most: int
) -> SparseModes:
    """The lowest modes, where the inertia of any motion is a sum of ``loads`` (n, k).

    Modes are what such loads deflect the structure to, so Rayleigh and Ritz find all there are.

    Raises:
        NoModesError: these are fewer.
    """
    moved = factor.solve(loads)
    energies, directions = np.linalg.eigh(loads.T @ moved)
    kept = energies > SINGULAR * energies.max(initial=0.0)
    unit = moved @ (directions[:, kept] / np.sqrt(energies[kept]))
    inverses, mixed = np.linalg.eigh(unit.T @ (mass @ unit))
    inverses, mixed = inverses[::-1], mixed[:, ::-1]
    if len(inverses) and inverses[-1] < -SINGULAR * max(inverses[0], -inverses[-1]):
        raise NoModesError("the mass matrix is not positive semi-definite")
    found = int((inverses > SINGULAR * inverses.max(initial=0.0)).sum())
    if found < n_modes:
        raise _too_few(found, n_modes)
    found = min(found, at_most)
    inverses = inverses[:found]
    return SparseModes(1.0 / inverses, unit @ (mixed[:, :found] / np.sqrt(inverses)))


def _rank(gram: FloatArray) -> int:
    energies = np.linalg.eigvalsh(gram)
    return int((energies > SINGULAR * energies.max()).sum())


def _too_few(found: int, n_modes: int) -> NoModesError:
    return NoModesError(f"the mass matrix gives {found} modes, fewer than the {n_modes} asked for")


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
    if not inertia.min() > 0.0:
        raise NoModesError("the mass matrix is not positive semi-definite, or has too low a rank")
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
    if inverses[0] < 0.0:
        raise NoModesError("the mass matrix is not positive semi-definite")
    if found < n_modes:
        require_held(stiffness, vectors[:, 0])
        raise _too_few(found, n_modes)
    inverses, vectors = inverses[:found], vectors[:, :found]
    return SparseModes(1.0 / inverses, vectors / np.sqrt(inverses))


def batch_of_modes(
    stiffness: FloatArray, mass: FloatArray, n_modes: int
) -> tuple[FloatArray, FloatArray]:
    """The lowest ``n_modes`` modes of many small matrices (B, n, n).

    Returns:
        (2πf)² (B, n_modes), ascending, and vectors (B, n, n_modes) at unit modal mass; NaN in rows
        that have none. A row of the answer does not depend on the others, to the last digit.
    """
    b, n, _ = stiffness.shape
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(stiffness))
        transposed = inverse.transpose(0, 2, 1)
        inverses, vectors = np.linalg.eigh(inverse @ mass @ transposed)
    except np.linalg.LinAlgError:
        if b > 1:  # some of them have modes
            rows = [batch_of_modes(stiffness[[i]], mass[[i]], n_modes) for i in range(b)]
            return np.concatenate([each for each, _ in rows]), np.concatenate([y for _, y in rows])
        return np.full((1, n_modes), np.nan), np.full((1, n, n_modes), np.nan)
    lowest = slice(n - 1, n - 1 - n_modes if n_modes < n else None, -1)
    inverses, vectors = inverses[:, lowest], vectors[:, :, lowest]
    few = ~(inverses[:, -1] > SINGULAR * inverses[:, 0])
    inverses[few] = np.nan
    return 1.0 / inverses, transposed @ vectors / np.sqrt(inverses)[:, None]


def frequencies_hz(eigenvalues: FloatArray) -> FloatArray:
    """f for (2πf)²."""
    found: FloatArray = np.sqrt(eigenvalues) / (2.0 * math.pi)
    return found
