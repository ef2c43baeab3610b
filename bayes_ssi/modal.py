"""Natural frequencies and mode shapes: batched eigen-solution, and comparison of shapes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray

__all__ = ["ModalModel", "Modes", "inverse_cholesky", "mac", "modal_model", "solve_modes"]


class Modes(NamedTuple):
    """Modes for a batch of B parameter values, in ascending order of frequency.

    Attributes:
        frequencies_hz: (B, n_modes); NaN in a row whose structure is not positive definite.
        shapes: (B, n_dof, n_modes), normalised to unit modal mass.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray


class ModalModel(NamedTuple):
    """Modes, and the masses that a response needs beside them, for a batch of B values.

    Attributes:
        frequencies_hz: (B, n_modes).
        shapes: (B, n_dof, n_modes), at unit modal mass: φᵀ M φ = 1.
        participation: (B, n_modes), φᵀ M ι: how much of the ground's motion goes into a mode.
        influence: (n_dof,), ι: how every degree of freedom moves when the ground moves by 1 and
            nothing deforms.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    participation: FloatArray
    influence: FloatArray


def modal_model(
    modes: Modes, mass_times_shapes: FloatArray, influence: FloatArray | None = None
) -> ModalModel:
    """The modal model from modes in any scale and the product M φ.

    Asking for the product leaves open how M is kept: a diagonal, a sparse matrix, or inside
    another program.

    Args:
        modes: of B structures.
        mass_times_shapes: (B, n_dof, n_modes), M φ in the scale of ``modes.shapes``.
        influence: (n_dof,); ones if None, all degrees of freedom then being displacements in the
            direction of the ground motion.
    """
    frequencies_hz, shapes = modes
    if influence is None:
        influence = np.ones(shapes.shape[1])
    scale = 1.0 / np.sqrt(np.einsum("bdm,bdm->bm", shapes, mass_times_shapes))
    participation = np.einsum("d,bdm->bm", influence, mass_times_shapes) * scale
    return ModalModel(frequencies_hz, shapes * scale[:, None, :], participation, influence)


def solve_modes(stiffness: FloatArray, mass: FloatArray) -> Modes:
    """Solve K φ = (2πf)² M φ for a batch of structures.

    Args:
        stiffness: (B, n, n), symmetric.
        mass: the diagonal of M, (B, n) or (1, n), where all else is zero; or M itself, (B, n, n)
            or (1, n, n), symmetric.

    Returns:
        All n modes of each structure. A row is NaN where an entry is not finite, or M or K is
        not positive definite: such a structure has no natural frequencies.
    """
    if mass.ndim == 3:
        return _solve_with_full_mass(stiffness, mass)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = 1.0 / np.sqrt(mass)
        scaled = stiffness * (root[:, :, None] * root[:, None, :])
    eigenvalues, vectors = _eigh(scaled)
    return Modes(_frequencies_hz(eigenvalues), vectors * root[:, :, None])


def _solve_with_full_mass(stiffness: FloatArray, mass: FloatArray) -> Modes:
    """As :func:`solve_modes`, through M = L Lᵀ: L⁻¹ K L⁻ᵀ has the same eigenvalues."""
    inverse = inverse_cholesky(mass)
    with np.errstate(invalid="ignore", over="ignore"):
        # einsum adds in one order, whatever the size of the batch.
        half = np.einsum("bij,bjk->bik", inverse, stiffness)
        scaled = np.einsum("bij,bkj->bik", half, inverse)
    eigenvalues, vectors = _eigh(scaled)
    return Modes(_frequencies_hz(eigenvalues), np.einsum("bji,bjm->bim", inverse, vectors))


def inverse_cholesky(matrices: FloatArray) -> FloatArray:
    """L⁻¹ with A = L Lᵀ of a batch of symmetric matrices (B, n, n); NaN where A has no factor.

    Column by column for the whole batch at once: for small matrices, of which one that is not
    positive definite spoils no other.
    """
    n = matrices.shape[-1]
    lower = np.zeros(matrices.shape)
    inverse = np.zeros(matrices.shape)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for j in range(n):
            column = matrices[:, j:, j] - np.einsum("bik,bk->bi", lower[:, j:, :j], lower[:, j, :j])
            pivot = 1.0 / np.sqrt(column[:, 0])
            lower[:, j:, j] = column * pivot[:, None]
            inverse[:, j, j] = pivot
            earlier = np.einsum("bk,bki->bi", lower[:, j, :j], inverse[:, :j, :j])
            inverse[:, j, :j] = -pivot[:, None] * earlier
    return inverse


def _eigh(scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues and vectors; NaN where an entry is not finite."""
    try:
        return np.linalg.eigh(scaled)
    except np.linalg.LinAlgError:
        # One row that is not finite stops the whole batch; solve the others.
        solvable = np.isfinite(scaled).all(axis=(1, 2))
        scaled[~solvable] = np.eye(scaled.shape[-1])
        eigenvalues, vectors = np.linalg.eigh(scaled)
        eigenvalues[~solvable] = np.nan
        return eigenvalues, vectors


def _frequencies_hz(eigenvalues: FloatArray) -> FloatArray:
    """Of (2πf)², in ascending order; NaN in a row where one is not positive."""
    if not eigenvalues[:, 0].min(initial=np.inf) > 0.0:  # also true when a NaN is among them
        with np.errstate(invalid="ignore"):
            eigenvalues[~(eigenvalues[:, 0] > 0.0)] = np.nan
    return np.sqrt(eigenvalues) / (2.0 * math.pi)


def mac(shapes: FloatArray, others: FloatArray) -> FloatArray:
    """Modal assurance criterion of every shape with every other.

    Args:
        shapes: (n_sensors, m).
        others: (n_sensors, k).

    Returns:
        (m, k), between 0 and 1. Sensors at which either shape is NaN (not measured) are left out
        of that pair; a pair with nothing to compare is NaN.
    """
    a, b = shapes.T[:, None, :], others.T[None, :, :]
    common = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(common, a, 0.0), np.where(common, b, 0.0)
    with np.errstate(invalid="ignore"):
        return (a * b).sum(-1) ** 2 / ((a * a).sum(-1) * (b * b).sum(-1))
