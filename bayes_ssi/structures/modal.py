"""Natural frequencies and mode shapes: batched eigen-solution, and comparison of shapes.

One basis for modes of equal frequency, which the rounding of a solver would choose.

A structure that is the same in two directions has pairs of modes of one frequency. Any two motions
in the plane of a pair are its modes, and which two a solver gives depends on its rounding. Here the
first is the one that moves some degree of freedom the farthest, and the others leave that at rest:
where nothing couples two directions, those are the motions in one direction and in the other.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from bayes_ssi.foundations.arrays import FloatArray, place_of_largest

# Eigenvalues that differ by this share, or by so many units in the last place of the largest,
# are equal but for rounding.
EQUAL_WITHIN = 1e-9
EQUAL_UNITS = 8.0
# A number smaller than this share of the largest one that it was computed from may be rounding:
# some hundred units in the last place.
ROUNDING = 1e-13
# Solved at once, eigenvalues are wrong by rounding of the largest of their matrix: by a
# millionth at most where they are this share of it, or more.
RESOLVED_ABOVE = 1e-9
# A sensor does not see what moves it by less than this share of the largest motion of any
# sensor in any mode, at unit modal mass: that is rounding, of which no shape consists.
UNSEEN_BELOW = 1e-8
BATCHED_UP_TO = 40  # larger matrices are solved faster one at a time, for their lowest modes only


def settle(ascending: FloatArray, shapes: FloatArray) -> None:
    """Replace shapes of equal eigenvalues, in place, by the one basis of what they span.

    Args:
        ascending: (B, m), eigenvalues or frequencies; NaN in rows without modes.
        shapes: (B, n, m), orthonormal in any mass, at all degrees of freedom or at some.
    """
    units = EQUAL_UNITS * np.finfo(float).eps
    rounding = EQUAL_WITHIN * ascending[:, 1:] + units * ascending[:, -1:]
    equal = np.diff(ascending, axis=1) <= rounding
    if not equal.any():
        return
    steps = np.diff(np.pad(equal, ((0, 0), (1, 1))).astype(int), axis=1)
    rows, first = np.nonzero(steps > 0)  # of groups of equal ones
    sizes = np.nonzero(steps < 0)[1] - first + 1
    for size in np.unique(sizes):
        some = np.flatnonzero(sizes == size)[:, None, None]
        at = rows[some], np.arange(shapes.shape[1])[:, None], first[some] + np.arange(size)
        shapes[at] = _one_basis(shapes[at])


def _one_basis(shapes: FloatArray) -> FloatArray:
    """Shapes (B, n, k), combined so that each moves some degree of freedom as no later one does."""
    left, combinations = shapes, np.zeros((len(shapes), shapes.shape[2], shapes.shape[2]))
    for k in range(shapes.shape[2]):
        farthest = place_of_largest((left * left).sum(axis=2))
        direction = left[np.arange(len(left)), farthest]
        length = np.sqrt((direction * direction).sum(axis=1, keepdims=True))
        direction = direction / np.where(length > 0.0, length, 1.0)  # nothing is left of few rows
        combinations[:, :, k] = direction
        left = left - (left * direction[:, None]).sum(axis=2)[:, :, None] * direction[:, None]
    return shapes @ combinations


# The scale of every mode shape that is shown, in words; :func:`scaled_shapes` gives it.
SHAPE_SCALE = "scaled to a largest component of 1 on the main structure"
NOT_SUPPORTED = (
    "the stiffness matrix is singular; is the structure supported, and no part of it loose?"
)


class NoModesError(ValueError):
    """A structure has no modes, or fewer than requested."""


class FreeBody(NamedTuple):
    """Rigid-body modes of a structure that nothing holds, left out of its modes.

    Solvers take K + shift·M in place of K, which is positive definite and has the same shapes.
    """

    number: int = 0  # of rigid-body modes, which are the lowest
    shift: float = 0.0  # in (rad/s)², by which all (2πf)² are raised; zero where there are none

    def elastic(self, raised: "Modes") -> "Modes":
        """The modes above the rigid-body ones, at their own frequencies."""
        if not self.number:
            return raised
        frequencies, shapes = (each[..., self.number :] for each in raised)
        squares = (2.0 * math.pi * frequencies) ** 2
        return Modes(frequencies_hz(np.maximum(squares - self.shift, 0.0)), shapes)


class Eigenpairs(NamedTuple):
    eigenvalues: FloatArray  # (m,), (2πf)² ascending
    vectors: FloatArray  # (n, m), at unit modal mass


class Modes(NamedTuple):
    """Modes for a batch of B parameter values, in ascending order of frequency.

    Attributes:
        frequencies_hz: (B, n_modes); NaN in a row whose structure has no such modes.
        shapes: (B, n_dof, n_modes), a mode in each column of ``shapes[b]``; normalised to unit
            modal mass.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray

    def repeated(self, n_rows: int) -> "Modes":
        """These modes for ``n_rows`` rows, also where a structure without parameters gave one."""
        if len(self.frequencies_hz) == n_rows:
            return self
        return Modes(*(np.broadcast_to(each, (n_rows, *each.shape[1:])) for each in self))


class ModalModel(NamedTuple):
    """Modes, and what else a response needs of the masses, for a batch of B values."""

    frequencies_hz: FloatArray  # (B, n_modes)
    shapes: FloatArray  # (B, n_dof, n_modes), at unit modal mass: φᵀ M φ = 1
    participation: FloatArray  # (B, n_modes), φᵀ M ι, participation factors
    # (n_dof,), ι: displacement of every degree of freedom when the ground moves by 1 and nothing
    # deforms.
    influence: FloatArray


def modal_model(
    modes: Modes, mass_times_shapes: FloatArray, influence: FloatArray | None = None
) -> ModalModel:
    """The modal model from modes in any scale and the product M φ.

    Only the product is needed, so M may be stored in any way: as a diagonal, a sparse matrix, or
    inside another program.

    Args:
        mass_times_shapes: (B, n_dof, n_modes), M φ in the scale of ``modes.shapes``.
        influence: (n_dof,); ones if None, as where all move in the direction of the ground motion.
    """
    frequencies_hz = modes.frequencies_hz
    # How a sum is ordered depends on the layout in memory, which may depend on the batch's size.
    shapes, mass_times_shapes = map(np.ascontiguousarray, (modes.shapes, mass_times_shapes))
    if influence is None:
        influence = np.ones(shapes.shape[1])
    scale = 1.0 / np.sqrt(np.einsum("bdm,bdm->bm", shapes, mass_times_shapes))
    participation = np.einsum("d,bdm->bm", influence, mass_times_shapes) * scale
    return ModalModel(frequencies_hz, shapes * scale[:, None, :], participation, influence)


def solve_modes(stiffness: FloatArray, mass: FloatArray, n_modes: int | None = None) -> Modes:
    """Solve K φ = (2πf)² M φ for a batch of dense structures: all modes, or the lowest.

    With M = L Lᵀ the matrix L⁻¹ K L⁻ᵀ has the same eigenvalues, and a batch of matrices is solved
    at once. Large ones of which few modes are wanted, and those for which that is not accurate (M
    is singular, or K nearly), are solved one at a time by :func:`lowest_eigenpairs`. A row of the
    answer does not depend on the other rows, to the last digit. It is NaN where an entry is not
    finite, K is not positive definite, or M gives fewer modes.

    Args:
        stiffness: (B, n, n) or (1, n, n), symmetric.
        mass: the same, or its diagonal, (B, n) or (1, n), where all else is zero.
    """
    n = stiffness.shape[-1]
    n_modes = n_modes or n
    if n <= BATCHED_UP_TO or (n_modes == n and mass.ndim == 2):
        eigenvalues, vectors = _scaled_by_mass(stiffness, mass)
        settle(eigenvalues, vectors)
        accurate = eigenvalues[:, 0] > RESOLVED_ABOVE * eigenvalues[:, -1]
        eigenvalues, vectors = eigenvalues[:, :n_modes], vectors[:, :, :n_modes]
    else:
        n_rows = max(len(stiffness), len(mass))
        eigenvalues, vectors = np.empty((n_rows, n_modes)), np.empty((n_rows, n, n_modes))
        accurate = np.zeros(n_rows, dtype=bool)
    for row in np.flatnonzero(~accurate):
        k, m = stiffness[row % len(stiffness)], mass[row % len(mass)]
        try:
            pairs = lowest_eigenpairs(k, np.diag(m) if m.ndim == 1 else m, n_modes)
        except NoModesError:
            eigenvalues[row], vectors[row] = np.nan, np.nan
        else:
            eigenvalues[row], vectors[row] = pairs
    return Modes(frequencies_hz(eigenvalues), vectors)


def _scaled_by_mass(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2πf)² (B, n) ascending, and shapes (B, n, n); NaN where M is not positive definite."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if mass.ndim == 2:
            root = 1.0 / np.sqrt(mass)
            scale = root[:, :, None] * root[:, None, :]
            # In place where it can be, and not kept: fresh memory costs more than the product.
            out = scale if len(scale) > 1 else None
            eigenvalues, vectors = _eigh(np.multiply(stiffness, scale, out=out))
            shapes = np.asfortranarray(vectors)  # the rows of the batch next to each other
            shapes *= root[:, :, None]
            return eigenvalues, shapes
        # Products of stacked matrices, each of which is computed on its own.
        inverse = inverse_cholesky(mass)
        transposed = inverse.transpose(0, 2, 1)
        eigenvalues, vectors = _eigh(inverse @ np.ascontiguousarray(stiffness) @ transposed)
        return eigenvalues, np.asfortranarray(transposed @ vectors)


def lowest_eigenpairs(
    stiffness: FloatArray, mass: FloatArray, n_modes: int, extra: int = 0
) -> Eigenpairs:
    """The lowest modes of one dense structure, of matrices (n, n).

    They are the greatest 1/(2πf)² of M φ = (2πf)⁻² K φ, so M may be singular.
    """
    n, wanted = len(stiffness), n_modes + extra
    try:
        # With the others of equal frequency, if there are no more than three.
        inverses, vectors = scipy.linalg.eigh(
            mass, stiffness, subset_by_index=[max(n - wanted - 2, 0), n - 1]
        )
    except scipy.linalg.LinAlgError:
        raise NoModesError("the stiffness matrix is not positive definite") from None
    except ValueError:
        raise NoModesError("a matrix has entries that are not finite") from None
    inverses, vectors = inverses[::-1], vectors[:, ::-1]
    require_supported(stiffness, vectors[:, 0])
    if inverses[0] < 0.0 or mass.diagonal().min() < 0.0:
        raise NoModesError("the mass matrix is not positive semi-definite")
    return eigenpairs_of_inverses(inverses, vectors, n_modes, wanted)


def eigenpairs_of_inverses(
    inverses: FloatArray, vectors: FloatArray, n_modes: int, at_most: int
) -> Eigenpairs:
    """The lowest modes, from (2πf)⁻² (k,) descending and shapes (n, k) with φᵀ K φ = 1."""
    n_available = int((inverses > ROUNDING * inverses.max(initial=0.0)).sum())
    if n_available < n_modes:
        raise NoModesError(
            f"the mass matrix gives {n_available} modes, fewer than the {n_modes} asked for"
        )
    inverses, vectors = inverses[:n_available], vectors[:, :n_available]
    eigenvalues, vectors = 1.0 / inverses, vectors / np.sqrt(inverses)
    settle(eigenvalues[None], vectors[None])
    return Eigenpairs(eigenvalues[:at_most], vectors[:, :at_most])


def require_supported(stiffness: Any, shape: FloatArray) -> None:
    """Raise NoModesError where the first mode (n,) has no strain energy: a rigid-body mode."""
    size = np.abs(shape)
    if not shape @ (stiffness @ shape) > ROUNDING * (size @ (abs(stiffness) @ size)):
        raise NoModesError(NOT_SUPPORTED)


def inverse_cholesky(matrices: FloatArray) -> FloatArray:
    """L⁻¹ with A = L Lᵀ of a batch of symmetric matrices (B, n, n); NaN where A has no factor.

    By elimination, which turns the rows of [A I] into those of [Lᵀ L⁻¹], for the whole batch at
    once: suits small matrices, and one that is not positive definite does not affect the others.
    """
    n = matrices.shape[-1]
    rows = np.zeros((n, 2 * n, len(matrices)))
    rows[:, :n] = matrices.transpose(1, 2, 0)
    rows[range(n), range(n, 2 * n)] = 1.0
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for j in range(n):
            end = n + j + 1  # beyond it, L⁻¹ is zero
            row = rows[j, j:end]
            row *= 1.0 / np.sqrt(row[0])
            rows[j + 1 :, j + 1 : end] -= row[1 : n - j, None] * row[1:]
    return np.ascontiguousarray(rows[:, n:].transpose(2, 0, 1))


def _eigh(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues and vectors of symmetric matrices; NaN where an entry is not finite."""
    try:
        return np.linalg.eigh(matrices)
    except np.linalg.LinAlgError:
        # One matrix that is not finite stops the whole batch; solve the others.
        solvable = np.isfinite(matrices).all(axis=(1, 2))
        matrices[~solvable] = np.eye(matrices.shape[-1])
        eigenvalues, vectors = np.linalg.eigh(matrices)
        eigenvalues[~solvable] = np.nan
        return eigenvalues, vectors


def frequencies_hz(eigenvalues: FloatArray) -> FloatArray:
    """f for (2πf)²."""
    return np.sqrt(eigenvalues) / (2.0 * math.pi)


def scaled_shapes(shapes: FloatArray, main: FloatArray) -> FloatArray:
    """Shapes (B, n) in the scale of all tables, figures and files: the largest component is 1.

    That is the largest of the main structure, in absolute value: an appendage in resonance moves
    many times as far, and would reduce the structure's own shape to nothing.

    Args:
        main: (B, m), components on the main structure, all of them or the measured ones; NaN does
            not count. Where there is none, the scale is kept.
    """
    size = np.fmax.reduce(np.abs(main), axis=1, initial=0.0, keepdims=True)
    return shapes / np.where(size == 0.0, 1.0, size)


def seen_shapes(shapes: FloatArray) -> FloatArray:
    """Shapes at sensors (B, n_sensors, n_modes), at unit modal mass, without what is rounding.

    A mode in y moves sensors in x by rounding errors, or not at all: here it does not.
    """
    sizes = np.abs(shapes)
    unseen = sizes < UNSEEN_BELOW * sizes.max(axis=(1, 2), keepdims=True, initial=0.0)
    return np.where(unseen, 0.0, shapes) if unseen.any() else shapes


def shape_signs(
    main: FloatArray, at_sensors: FloatArray, identified: FloatArray | None
) -> FloatArray:
    """The sign (B,) that turns each shape to the identified one.

    Without an identified shape, shapes that are alike turn the same way, the largest component
    positive. Where the order of two modes differs from row to row, as for bending in x and in y at
    nearly one frequency, those of either mode are alike, and each is turned with its own kind.

    Args:
        main: (B, m), components on the main structure.
        at_sensors: (B, n_sensors), components of the same shapes at the sensors.
        identified: (n_sensors,), NaN where not measured; None where no shape was identified.
    """
    if identified is not None:
        products = at_sensors @ np.nan_to_num(identified)
    elif not main.shape[1]:  # frequencies alone
        return np.ones(len(main))
    else:
        kinds = np.linalg.svd(np.nan_to_num(main), full_matrices=False)[2]
        components = kinds[np.arange(len(kinds)), place_of_largest(np.abs(kinds))]
        of_kinds = main @ (kinds * np.sign(components)[:, None]).T
        products = of_kinds[np.arange(len(main)), place_of_largest(np.abs(of_kinds))]
    return np.where(products < 0.0, -1.0, 1.0)


def mac(shapes: FloatArray, others: FloatArray) -> FloatArray:
    """Modal assurance criterion (m, k) of shapes (n_sensors, m) with others (n_sensors, k).

    Sensors at which either shape is NaN (not measured) are left out of that pair; a pair with
    nothing to compare is NaN.
    """
    return mac_of_pairs(shapes.T[:, None, :], others.T[None, :, :])


def comac(shapes: FloatArray, others: FloatArray) -> FloatArray:
    """Coordinate MAC (..., n_sensors) of shapes (..., n_sensors, m) paired with others.

    (Σ |φ ψ|)² / (Σ φ² Σ ψ²) over the modes (Lieven and Ewins 1988), all of unit length.
    """
    return mac_of_pairs(np.abs(shapes), np.abs(others))


def mac_of_pairs(a: FloatArray, b: FloatArray) -> FloatArray:
    """The same of shapes (..., n_sensors) one by one, leading dimensions broadcast."""
    common = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(common, a, 0.0), np.where(common, b, 0.0)
    with np.errstate(invalid="ignore"):
        return (a * b).sum(-1) ** 2 / ((a * a).sum(-1) * (b * b).sum(-1))
