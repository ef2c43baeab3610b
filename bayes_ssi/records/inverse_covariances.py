"""Inverses of the spectral matrices E = P N Pᵀ + D from matrices as small as N.

With D = diag(s) and the QR decomposition D^(-½) P = O R, where O has k orthonormal columns,

    E⁻¹ = D⁻¹ + U J Uᵀ,   U = D^(-½) O,   J = (I + R N Rᵀ)⁻¹ - I,   |E| = |D| |I + R N Rᵀ|,

so that many sensors cost little more than there are modes to see.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.spectra import Spectra


class InverseCovariances(NamedTuple):
    """E⁻¹ of n sensors at K frequencies.

    Attributes:
        precisions: (n,), the diagonal of D⁻¹.
        directions: (n, k), U.
        triangle: (k, M), R.
        small: (K, k, k), (I + R N Rᵀ)⁻¹.
        log_determinants: (K,), ln|E|.
    """

    precisions: FloatArray
    directions: FloatArray
    triangle: FloatArray
    small: ComplexArray
    log_determinants: FloatArray

    @classmethod
    def of(
        cls, shapes: FloatArray, log_noise: FloatArray, form: ComplexArray
    ) -> InverseCovariances:
        """For shapes P (n, M), ln s (n,) and N (K, M, M).

        Raises:
            LinAlgError: a matrix is not positive definite.
        """
        scale = np.exp(-0.5 * log_noise)[:, None]
        basis, triangle = np.linalg.qr(scale * shapes)
        inner = np.eye(len(triangle)) + triangle @ form @ triangle.T
        diagonals = np.linalg.cholesky(inner).diagonal(axis1=1, axis2=2).real
        log_determinants = log_noise.sum() + 2.0 * np.log(diagonals).sum(1)
        return cls(
            scale[:, 0] ** 2, scale * basis, triangle, np.linalg.inv(inner), log_determinants
        )

    @property
    def correction(self) -> ComplexArray:
        """J (K, k, k)."""
        return self.small - np.eye(self.small.shape[1])

    @property
    def full(self) -> ComplexArray:
        """E⁻¹ (K, n, n)."""
        inverse = self.directions @ self.correction @ self.directions.T
        diagonal = np.arange(len(self.precisions))
        inverse[:, diagonal, diagonal] += self.precisions
        return inverse

    @property
    def of_shapes(self) -> ComplexArray:
        """E⁻¹ P (K, n, M)."""
        return self.directions @ (self.small @ self.triangle)

    def times(self, rows: ComplexArray) -> ComplexArray:
        """X E⁻¹ for X (K, m, n)."""
        low = (rows @ self.directions) @ self.correction @ self.directions.T
        return rows * self.precisions + low

    def misfit(self, data: Spectra) -> float:
        """-ln p of the measured spectral matrices, without constants."""
        powers = data.matrices.diagonal(axis1=1, axis2=2).real @ self.precisions
        seen = self.directions.T @ data.matrices @ self.directions
        traces = powers + np.einsum("kij,kji->k", self.correction, seen).real
        return float((data.weights * (self.log_determinants + traces)).sum())

    def diagonals(self, data: Spectra) -> FloatArray:
        """Those of E⁻¹ - E⁻¹ S̄ E⁻¹ (K, n)."""
        directions, correction = self.directions, self.correction
        seen = directions.T @ data.matrices  # (K, k, n)
        powers = data.matrices.diagonal(axis1=1, axis2=2).real
        mixed = np.einsum("nk,xkn->xn", directions, correction @ seen).real
        within = correction - correction @ (seen @ directions) @ correction
        of_within = ((directions @ within).real * directions).sum(2)
        return self.precisions * (1.0 - self.precisions * powers - 2.0 * mixed) + of_within
