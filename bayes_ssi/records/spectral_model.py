"""The spectral matrices that modes cause, and their misfit to measured ones.

For modes with real shapes P (n, M) at unit length and modal forces of spectral density S = L L*,

    E_k = P N_k Pᵀ + diag(s),    N_k = exp(c₁ x + c₂ x²) diag(h) S diag(h)*,
    h_i = (2πi f)^(-q) / (1 - β² - 2i ζ_i β),  β = f_i / f,  x = ln(f / f_m),

for accelerations (q = 0) and their q-th integrals (Au 2017, Operational Modal Analysis). A
quasi-static column has h = (2πi f)^(-q): the ground's own motion in absolute accelerations. The
spectra of all loads have one colour, a parabola c of logarithms: if coloured loads are taken to be
white, the tails of resonances are wrong, and their neighbours move to make up for them. The s are
noise of each sensor. The misfit is

    -ln p = Σ_k w_k [ln|E_k| + tr(E_k⁻¹ S̄_k)].

Shapes move in the planes that touch the spheres of unit shapes at the present ones, so that
derivatives are taken at the planes' origins, and a step returns to the spheres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.inverse_covariances import InverseCovariances
from bayes_ssi.records.spectra import Spectra


@dataclass(frozen=True, eq=False)
class SpectralModel:
    """Modes, their forces, and noise.

    Attributes:
        log_frequencies: (m,), ln f_i, f_i in Hz.
        log_dampings: (m,), ln ζ_i.
        shapes: (n, M), real at unit length; M is m, or m + 1 with a quasi-static column.
        forces: (M, r), L, zero above a real diagonal; r is M, or less for fewer sources.
        log_noise: (n,), ln s.
        colour: c, (2,); (0,) for white loads.
        middle_hz: f_m.
    """

    log_frequencies: FloatArray
    log_dampings: FloatArray
    shapes: FloatArray
    forces: ComplexArray
    log_noise: FloatArray
    colour: FloatArray
    middle_hz: float

    @property
    def n_modes(self) -> int:
        """m, without the quasi-static column."""
        return len(self.log_frequencies)

    @cached_property
    def planes(self) -> FloatArray:
        """(M, n, n-1): an orthonormal basis of the plane at each shape."""
        n, n_columns = self.shapes.shape
        # The complement of a unit vector, by the reflection that turns it into an axis.
        planes = np.empty((n_columns, n, n - 1))
        for plane, shape in zip(planes, self.shapes.T, strict=True):
            q, _ = np.linalg.qr(np.column_stack([shape, np.eye(n)]))
            plane[:] = q[:, 1:]
        return planes

    @cached_property
    def layout(self) -> Layout:
        """Where each part is in a vector of coordinates."""
        n_columns, n_sources = self.forces.shape
        return Layout.of(self.n_modes, len(self.shapes), n_columns, n_sources, len(self.colour))

    def moved(self, step: FloatArray) -> SpectralModel:
        """The model after a step in its coordinates (:attr:`layout`)."""
        at = self.layout
        shapes = self.shapes + np.einsum(
            "jct,jt->cj", self.planes, step[at.shapes].reshape(len(self.planes), -1)
        )
        forces = self.forces.copy()
        n_columns, n_sources = forces.shape
        forces[np.diag_indices(n_sources)] += step[at.diagonal]
        rows, columns = np.tril_indices(n_columns, -1, n_sources)
        forces[rows, columns] += step[at.real] + 1j * step[at.imaginary]
        return replace(
            self,
            log_frequencies=self.log_frequencies + step[at.log_frequencies],
            log_dampings=self.log_dampings + step[at.log_dampings],
            shapes=shapes / np.sqrt((shapes**2).sum(0)),
            forces=forces,
            log_noise=self.log_noise + step[at.log_noise],
            colour=self.colour + step[at.colour],
        )


class Layout(NamedTuple):
    """Slices of a vector of coordinates."""

    log_frequencies: slice
    log_dampings: slice
    diagonal: slice
    real: slice
    imaginary: slice
    shapes: slice
    log_noise: slice
    colour: slice

    @classmethod
    def of(cls, n_modes: int, n: int, n_columns: int, n_sources: int, n_colour: int) -> Layout:
        """For m modes, n sensors, M columns, r sources, and loads of a colour or none."""
        pairs = n_columns * n_sources - n_sources * (n_sources + 1) // 2
        sizes = (n_modes, n_modes, n_sources, pairs, pairs, n_columns * (n - 1), n, n_colour)
        ends = np.cumsum(sizes).tolist()
        return cls(*(slice(end - size, end) for end, size in zip(ends, sizes, strict=True)))

    @property
    def n_coordinates(self) -> int:
        """Length of the vector."""
        return int(self.colour.stop)

    @property
    def n_of_forms(self) -> int:
        """Coordinates of the matrices N: frequencies, dampings and forces, which come first."""
        return int(self.imaginary.stop)


def covariances(model: SpectralModel, frequencies_hz: FloatArray, q: int) -> ComplexArray:
    """E (K, n, n) at frequencies (K,)."""
    covariance = model.shapes @ _form(model, frequencies_hz, q) @ model.shapes.T
    diagonal = np.arange(len(model.shapes))
    covariance[:, diagonal, diagonal] += np.exp(model.log_noise)
    return covariance


def transfer(model: SpectralModel, frequencies_hz: FloatArray, q: int) -> ComplexArray:
    """h (K, M) at frequencies (K,), times the square root of the loads' colour."""
    return transfer_and_slopes(model, frequencies_hz, q)[0]


def powers(model: SpectralModel, frequencies_hz: FloatArray) -> FloatArray:
    """x and x² (K, 2), or nothing (K, 0) for white loads."""
    x = np.log(frequencies_hz / model.middle_hz)
    return np.stack([x, x**2], axis=1)[:, : len(model.colour)]


def misfit(model: SpectralModel, data: Spectra, q: int) -> float:
    """-ln p without constants; infinite where a matrix is not positive definite."""
    form = _form(model, data.frequencies_hz, q)
    try:
        return InverseCovariances.of(model.shapes, model.log_noise, form).misfit(data)
    except np.linalg.LinAlgError:
        return np.inf


def _form(model: SpectralModel, frequencies_hz: FloatArray, q: int) -> ComplexArray:
    """N (K, M, M)"""
    driven = transfer(model, frequencies_hz, q)[:, :, None] * model.forces
    return driven @ driven.conj().swapaxes(1, 2)


def transfer_and_slopes(
    model: SpectralModel, frequencies_hz: FloatArray, q: int
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """:func:`transfer` (K, M), and its derivatives in ln f and ln ζ (K, m)."""
    coloured = np.exp(0.5 * powers(model, frequencies_hz) @ model.colour)
    integrals = ((2j * np.pi * frequencies_hz) ** -q * coloured)[:, None]
    beta = np.exp(model.log_frequencies) / frequencies_hz[:, None]
    damping = np.exp(model.log_dampings)
    h = 1.0 / (1.0 - beta**2 - 2j * damping * beta)
    by_frequency = h**2 * (2.0 * beta**2 + 2j * damping * beta) * integrals
    by_damping = h**2 * (2j * damping * beta) * integrals
    if model.shapes.shape[1] > model.n_modes:
        h = np.concatenate([h, np.ones((len(h), 1))], axis=1)
    return h * integrals, by_frequency, by_damping
