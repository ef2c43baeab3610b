"""A reduced basis for K(θ) = Σ c_t K_t and M(θ) = Σ d_u M_u, and how wrong it is at any θ.

The modes of some parameter values span the basis V, orthonormal in the energy of a reference K_r
(that of the prior medians). Modes at other values are sought in that span: Vᵀ K V y = μ Vᵀ M V y,
a small problem whose matrices are sums of small ones (Rayleigh and Ritz).

Its error follows from the residual r = K u - μ M u of u = V y in the full model. With u at unit
energy, uᵀ K u = 1, and η² = rᵀ K⁻¹ r, some mode has |μ/λ - 1| ≤ η; and where all others are at a
relative distance of at least δ, |μ/λ - 1| ≤ η²/δ (Temple, Kato). Modes closer to one another than
``CLOSE`` count as one group, whose η² add up.

Shapes are wrong at the sensors in two ways. What no vector of the basis has of a mode is about
K⁻¹ r/(1 - μ/μ_m+1), of which the sensors see Eᵀ K⁻¹ r, here with K_r in place of K and divided by
α. And modes i and j are mixed with one another by about η_i η_j/|1 - μ_i/μ_j|. Both are estimates
of first order, not bounds.

rᵀ K⁻¹ r ≤ rᵀ K_r⁻¹ r / α where K - α K_r is positive semi-definite, as for the least ratio α of
coefficients c_t(θ)/c_t(θ_r) where all K_t are. The norm of K_r⁻¹ is that of a few random
combinations Sᵀr, S = K_r⁻¹ C Ω, with K_r = C Cᵀ and Ω normally distributed, whose mean square it
is; so the residual is known from small matrices too (Balabanov and Nouy 2019).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.finite_elements.sparse_factors import NoModesError, is_semidefinite, stiffness_factor
from bayes_ssi.finite_elements.sparse_modes import SparseModes, dense_modes

__all__ = ["Bounds", "Coefficients", "ReducedBasis", "Reference"]

# Random combinations in which residuals are measured, and what their mean square is multiplied
# by: it is below 1/1.5 of the norm once in 10 000 times.
SKETCH, SKETCH_MARGIN = 160, 1.5
# Modes whose (2πf)² differ by less than this share count as one group.
CLOSE = 0.02
# Modes that move the sensors less than this share of what the most visible one does, at unit modal
# mass, count as if they moved them so much: no test identifies them, and their shapes there are
# those of the mesh's small asymmetries.
VISIBLE = 0.05
# Full matrices' columns that are handled at a time.
COLUMNS = 32


@dataclass(frozen=True, eq=False)
class Coefficients:
    """c_t(θ) (T,) of the stiffness and d_u(θ) (U,) of the mass, at one θ."""

    stiffness: FloatArray
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class Bounds:
    """How far reduced modes may be from those of the full model.

    Attributes:
        frequency: (m,), as a fraction of the frequency.
        shape: (m,), at the sensors, of shapes that have unit length there.
    """

    frequency: FloatArray
    shape: FloatArray


class Reference:
    """What residuals and bases are measured by: the model at the reference values.

    Attributes:
        probes: (n, SKETCH + d), S and, for the d sensors, K_r⁻¹ E.
        sensors: rows of the sensors.
        coefficients: of the reference values.
        definite: whether every K_t is positive semi-definite.
    """

    def __init__(
        self,
        stiffness: AffineMatrix,
        mass: AffineMatrix,
        sensors: NDArray[np.intp],
        coefficients: Coefficients,
    ) -> None:
        """Factorise the stiffness at the reference.

        Raises:
            NoModesError: it is not positive definite.
        """
        self.stiffness, self.mass, self.coefficients = stiffness, mass, coefficients
        self.matrix = stiffness.at(coefficients.stiffness)
        factor = stiffness_factor(self.matrix)
        n = self.matrix.shape[0]
        normal = np.random.default_rng(0).standard_normal((n, SKETCH)) / np.sqrt(SKETCH)
        self.sensors = sensors
        self.probes = np.empty((n, SKETCH + len(sensors)))
        self.probes[:, :SKETCH] = factor.solve(factor.root_times(normal))
        for start in range(0, len(sensors), COLUMNS):
            columns = sensors[start : start + COLUMNS]
            unit = np.zeros((n, len(columns)))
            unit[columns, np.arange(len(columns))] = 1.0
            at = SKETCH + start
            self.probes[:, at : at + len(columns)] = factor.solve(unit)
        self.definite = all(is_semidefinite(each) for each in stiffness.matrices)


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """A basis of N vectors, and everything that small problems in it need.

    Attributes:
        vectors: V (n, N).
        stiffness: Vᵀ K_t V (T, N, N).
        mass: Vᵀ M_u V (U, N, N).
        residual_stiffness: K_t V (T, SKETCH + d, N) in the reference's probes.
        residual_mass: M_u V (U, SKETCH + d, N) in them.
        at_sensors: Eᵀ V (d, N).
    """

    vectors: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    residual_stiffness: FloatArray
    residual_mass: FloatArray
    at_sensors: FloatArray

    @classmethod
    def empty(cls, reference: Reference) -> ReducedBasis:
        n = reference.matrix.shape[0]
        n_k, n_m = len(reference.stiffness.matrices), len(reference.mass.matrices)
        return cls(
            np.zeros((n, 0)),
            np.zeros((n_k, 0, 0)),
            np.zeros((n_m, 0, 0)),
            np.zeros((n_k, reference.probes.shape[1], 0)),
            np.zeros((n_m, reference.probes.shape[1], 0)),
            np.zeros((len(reference.sensors), 0)),
        )

    @property
    def size(self) -> int:
        return int(self.vectors.shape[1])

    def grown(self, modes: SparseModes, negligible: float, reference: Reference) -> ReducedBasis:
        """The basis with what it lacks of some modes.

        Args:
            modes: of the full model.
            negligible: directions that add less than this to a mode, in energy, are left out.
            reference: as of the basis.
        """
        new = modes.vectors / np.sqrt(modes.eigenvalues)
        new = new / np.sqrt(np.einsum("nm,nm->m", new, reference.matrix @ new))
        for _ in range(2):  # once leaves rounding
            new = new - self.vectors @ (self.vectors.T @ (reference.matrix @ new))
        energies, directions = np.linalg.eigh(new.T @ (reference.matrix @ new))
        kept = energies > max(negligible, 1e-9) ** 2
        if not kept.any():
            return self
        new = new @ (directions[:, kept] / np.sqrt(energies[kept]))
        new = new - self.vectors @ (self.vectors.T @ (reference.matrix @ new))
        new = new @ np.linalg.inv(np.linalg.cholesky(new.T @ (reference.matrix @ new))).T
        every = np.hstack([self.vectors, new])
        stiffness, residual_stiffness = _extended(
            reference.stiffness, self.stiffness, self.residual_stiffness, new, every, reference
        )
        mass, residual_mass = _extended(
            reference.mass, self.mass, self.residual_mass, new, every, reference
        )
        return ReducedBasis(
            vectors=every,
            stiffness=stiffness,
            mass=mass,
            residual_stiffness=residual_stiffness,
            residual_mass=residual_mass,
            at_sensors=every[reference.sensors],
        )

    def bounds(self, at: Coefficients, n_modes: int, reference: Reference) -> Bounds:
        """How wrong the first ``n_modes`` reduced modes may be; infinite where nothing is known."""
        nothing = Bounds(np.full(n_modes, np.inf), np.full(n_modes, np.inf))
        if self.size == len(self.vectors):  # the basis is all of the space
            return Bounds(np.zeros(n_modes), np.zeros(n_modes))
        if self.size < n_modes:
            return nothing
        stiffness, mass = _sum(at.stiffness, self.stiffness), _sum(at.mass, self.mass)
        alpha = _least_ratio(at, stiffness, reference)
        if not alpha > 0.0:
            return nothing
        try:
            eigenvalues, y = dense_modes(stiffness, mass, n_modes, n_modes + 1)
        except NoModesError:
            return nothing
        y = y / np.sqrt(eigenvalues)  # at unit energy, not unit mass
        residuals = _sum(at.stiffness, self.residual_stiffness) @ y
        residuals -= (_sum(at.mass, self.residual_mass) @ y) * eigenvalues
        eta = np.linalg.norm(residuals[:SKETCH], axis=0) * math.sqrt(SKETCH_MARGIN / alpha)
        moved = np.linalg.norm(residuals[SKETCH:], axis=0) / alpha
        moves = np.linalg.norm(self.at_sensors @ y, axis=0)
        return Bounds(
            _frequency_bounds(eigenvalues, eta)[:n_modes],
            _shape_errors(eigenvalues, eta, moves, moved, n_modes),
        )


def _frequency_bounds(eigenvalues: FloatArray, eta: FloatArray) -> FloatArray:
    """Relative errors of frequencies (m,), from η (m,)."""
    apart = np.diff(eigenvalues) > CLOSE * eigenvalues[1:]
    group = np.concatenate([[0], np.cumsum(apart)])
    together = np.bincount(group, eta**2)
    # The others' own eigenvalues are known as well as their residuals say.
    lowest = eigenvalues * np.maximum(1.0 - eta, 0.0)
    below, above = np.full(len(together), np.inf), np.full(len(together), np.inf)
    edges = np.flatnonzero(apart)  # between mode i and mode i + 1
    with np.errstate(divide="ignore"):
        above[:-1] = 1.0 - eigenvalues[edges] / lowest[edges + 1]
        below[1:] = lowest[edges + 1] / eigenvalues[edges] - 1.0
    # Nothing is known of what lies above the last mode that was computed but that it is higher.
    above[-1] = CLOSE
    gap = np.minimum(below, above)
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = np.where(gap > 0.0, together / gap, np.inf)
    found: FloatArray = 0.5 * np.minimum(eta, squared[group])
    return found


def _shape_errors(
    eigenvalues: FloatArray, eta: FloatArray, moves: FloatArray, moved: FloatArray, n_modes: int
) -> FloatArray:
    """Errors (n_modes,) at the sensors of shapes of unit length there.

    Args:
        eigenvalues: (m,), those of the shapes and perhaps the next one.
        eta: (m,).
        moves: (m,), lengths at the sensors of the shapes at unit energy.
        moved: (m,), by how much the residuals, as static loads, move the sensors.
        n_modes: how many shapes.
    """
    own = slice(0, n_modes)
    beyond = eigenvalues[n_modes] if len(eigenvalues) > n_modes else np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        outside = moved[own] / (1.0 - eigenvalues[own] / beyond)
        distance = np.abs(1.0 - eigenvalues[own, None] / eigenvalues)
        mixed = np.minimum(eta[own, None] * eta / distance, 1.0)
    mixed[np.arange(n_modes), np.arange(n_modes)] = 0.0
    at_unit_mass = moves * np.sqrt(eigenvalues)
    hardly = VISIBLE * at_unit_mass.max() / np.sqrt(eigenvalues[own])
    found: FloatArray = (outside + mixed @ moves) / np.maximum(moves[own], hardly)
    return np.nan_to_num(found, nan=0.0, posinf=np.inf)  # without sensors there is no shape


def _least_ratio(at: Coefficients, stiffness: FloatArray, reference: Reference) -> float:
    """α with K - α K_r positive semi-definite."""
    if reference.definite:
        return float((at.stiffness / reference.coefficients.stiffness).min())
    # Without that, the ratio of energies in the basis is an estimate: K_r is the identity there.
    return float(np.linalg.eigvalsh(stiffness)[0])


def _sum(coefficients: FloatArray, matrices: FloatArray) -> FloatArray:
    found: FloatArray = np.tensordot(coefficients, matrices, axes=1)
    return found


def _extended(
    total: AffineMatrix,
    small: FloatArray,
    residuals: FloatArray,
    new: FloatArray,
    every: FloatArray,
    reference: Reference,
) -> tuple[FloatArray, FloatArray]:
    """Vᵀ A_t V, and A_t V in the probes, with new columns in V, of which the old ones are known."""
    before, size = small.shape[1], every.shape[1]
    grown = np.zeros((len(small), size, size))
    grown[:, :before, :before] = small
    probed = np.zeros((len(small), reference.probes.shape[1], size))
    probed[:, :, :before] = residuals
    for t, matrix in enumerate(total.matrices):
        for start in range(0, new.shape[1], COLUMNS):
            columns = slice(before + start, min(before + start + COLUMNS, size))
            product = matrix @ new[:, start : start + COLUMNS]
            grown[t, :, columns] = every.T @ product
            probed[t, :, columns] = reference.probes.T @ product
        grown[t, before:, :before] = grown[t, :before, before:].T
        grown[t, before:, before:] = 0.5 * (
            grown[t, before:, before:] + grown[t, before:, before:].T
        )
    return grown, probed
