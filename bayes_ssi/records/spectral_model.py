"""The spectral matrices that modes cause, their misfit to measured ones, and its derivatives.

For modes with real shapes P (n, M) at unit length and modal forces of spectral density S = L L*,

    E_k = P N_k Pᵀ + diag(s),    N_k = diag(h) S diag(h)*,
    h_i = (2πi f)^(-q) / (1 - β² - 2i ζ_i β),  β = f_i / f,

for accelerations (q = 0) and their q-th integrals (Au 2017, Operational Modal Analysis). A
quasi-static column has h = (2πi f)^(-q): the ground's own motion in absolute accelerations. The s
are noise of each sensor. The misfit is

    -ln p = Σ_k w_k [ln|E_k| + tr(E_k⁻¹ S̄_k)].

Shapes move in the planes that touch the spheres of unit shapes at the present ones, so that
derivatives are taken at the planes' origins, and a step returns to the spheres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import ComplexArray, FloatArray
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
    """

    log_frequencies: FloatArray
    log_dampings: FloatArray
    shapes: FloatArray
    forces: ComplexArray
    log_noise: FloatArray

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
        return Layout.of(self.n_modes, len(self.shapes), *self.forces.shape)

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

    @classmethod
    def of(cls, n_modes: int, n: int, n_columns: int, n_sources: int) -> Layout:
        """For m modes, n sensors, M columns and r sources."""
        pairs = n_columns * n_sources - n_sources * (n_sources + 1) // 2
        sizes = (n_modes, n_modes, n_sources, pairs, pairs, n_columns * (n - 1), n)
        ends = np.cumsum(sizes).tolist()
        return cls(*(slice(end - size, end) for end, size in zip(ends, sizes, strict=True)))

    @property
    def n_coordinates(self) -> int:
        """Length of the vector."""
        return int(self.log_noise.stop)

    @property
    def n_of_forms(self) -> int:
        """Coordinates of the matrices N: frequencies, dampings and forces, which come first."""
        return int(self.imaginary.stop)


class Derivatives(NamedTuple):
    """Misfit, and its derivatives in the coordinates of the model.

    Attributes:
        misfit: -ln p without constants.
        gradient: (p,).
        information: (p, p), Fisher information.
        bending: (p, p), positive semidefinite: what the curvature has beyond it because S is
            quadratic in L, where a column of L vanishes.
    """

    misfit: float
    gradient: FloatArray
    information: FloatArray
    bending: FloatArray


def covariances(model: SpectralModel, frequencies_hz: FloatArray, q: int) -> ComplexArray:
    """E (K, n, n) at frequencies (K,)."""
    return _covariances(model, _form(model, _transfer(model, frequencies_hz, q)[0]))


def transfer(model: SpectralModel, frequencies_hz: FloatArray, q: int) -> ComplexArray:
    """h (K, M) at frequencies (K,)."""
    return _transfer(model, frequencies_hz, q)[0]


def misfit(model: SpectralModel, data: Spectra, q: int) -> float:
    """-ln p without constants; infinite where a matrix is not positive definite."""
    try:
        return _misfit(covariances(model, data.frequencies_hz, q), data)[0]
    except np.linalg.LinAlgError:
        return np.inf


def gradient(model: SpectralModel, data: Spectra, q: int) -> FloatArray:
    """(p,)"""
    form, slopes = _form_and_slopes(model, data, q)
    inverse = _misfit(_covariances(model, form), data)[1]
    return _gradient(model, data, form, slopes, inverse)


def derivatives(model: SpectralModel, data: Spectra, q: int) -> Derivatives:
    """Misfit, gradient and Fisher information."""
    form, slopes = _form_and_slopes(model, data, q)
    value, inverse = _misfit(_covariances(model, form), data)
    return Derivatives(
        value,
        _gradient(model, data, form, slopes, inverse),
        _information(model, data, form, slopes, inverse),
        _bending(_slope_in_density(model, data, q, inverse), model),
    )


def _covariances(model: SpectralModel, form: ComplexArray) -> ComplexArray:
    covariance = model.shapes @ form @ model.shapes.T
    diagonal = np.arange(len(model.shapes))
    covariance[:, diagonal, diagonal] += np.exp(model.log_noise)
    return covariance


def _misfit(covariance: ComplexArray, data: Spectra) -> tuple[float, ComplexArray]:
    """Misfit and inverses (K, n, n)."""
    log_determinants = 2.0 * np.log(
        np.linalg.cholesky(covariance).diagonal(axis1=1, axis2=2).real
    ).sum(1)
    inverse: ComplexArray = np.linalg.inv(covariance)
    traces = np.einsum("kij,kji->k", inverse, data.matrices).real
    return float((data.weights * (log_determinants + traces)).sum()), inverse


def _transfer(
    model: SpectralModel, frequencies_hz: FloatArray, q: int
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """h (K, M), and its derivatives in ln f and ln ζ (K, m)."""
    integrals = ((2j * np.pi * frequencies_hz) ** -q)[:, None]
    beta = np.exp(model.log_frequencies) / frequencies_hz[:, None]
    damping = np.exp(model.log_dampings)
    h = 1.0 / (1.0 - beta**2 - 2j * damping * beta)
    by_frequency = h**2 * (2.0 * beta**2 + 2j * damping * beta) * integrals
    by_damping = h**2 * (2j * damping * beta) * integrals
    if model.shapes.shape[1] > model.n_modes:
        h = np.concatenate([h, np.ones((len(h), 1))], axis=1)
    return h * integrals, by_frequency, by_damping


def _form(model: SpectralModel, h: ComplexArray) -> ComplexArray:
    """N (K, M, M)"""
    driven = h[:, :, None] * model.forces
    return driven @ driven.conj().swapaxes(1, 2)


class _Slopes(NamedTuple):
    """Derivatives of N in ln f, ln ζ and the entries of L: dN_a = e_i g* + g e_i*, i the row of a.

    Each of them changes one row of diag(h) L, and so no more than one row and column of N.

    Attributes:
        rows: (a,)
        vectors: (K, a, M), g.
    """

    rows: NDArray[np.intp]
    vectors: ComplexArray


def _form_and_slopes(model: SpectralModel, data: Spectra, q: int) -> tuple[ComplexArray, _Slopes]:
    """N (K, M, M), and its derivatives."""
    h, by_frequency, by_damping = _transfer(model, data.frequencies_hz, q)
    force, modes = model.forces, np.arange(model.n_modes)
    driven = h[:, :, None] * force
    rows, columns, units = _entries(force)
    all_rows = np.concatenate([modes, modes, rows])
    # Changes of that row, (K, a), and the columns of diag(h) L with which they make N.
    changes = np.concatenate([by_frequency, by_damping, h[:, rows] * units], axis=1)
    with_all = (driven @ force[modes].conj().T).swapaxes(1, 2)
    partners = np.concatenate([with_all, with_all, driven[:, :, columns].swapaxes(1, 2)], axis=1)
    return driven @ driven.conj().swapaxes(1, 2), _Slopes(
        all_rows, changes.conj()[:, :, None] * partners
    )


def _entries(forces: ComplexArray) -> tuple[NDArray[np.intp], NDArray[np.intp], ComplexArray]:
    """Row, column and unit (1 or i) of the coordinates of L, in the order of the layout."""
    n_columns, n_sources = forces.shape
    diagonal = np.arange(n_sources)
    rows, columns = np.tril_indices(n_columns, -1, n_sources)
    units = np.ones(n_sources + 2 * len(rows), dtype=complex)
    units[n_sources + len(rows) :] = 1j
    return (
        np.concatenate([diagonal, rows, rows]),
        np.concatenate([diagonal, columns, columns]),
        units,
    )


def _gradient(
    model: SpectralModel,
    data: Spectra,
    form: ComplexArray,
    slopes: _Slopes,
    inverse: ComplexArray,
) -> FloatArray:
    at, shapes = model.layout, model.shapes
    difference = data.weights[:, None, None] * (inverse - inverse @ data.matrices @ inverse)
    total = np.empty(at.n_coordinates)
    on_modes = shapes.T @ difference @ shapes
    rows, vectors = slopes
    total[: at.n_of_forms] = 2.0 * (on_modes[:, rows] * vectors).real.sum((0, 2))
    by_entry = 2.0 * np.einsum("kij,kjc->ci", form, shapes.T @ difference, optimize=True).real
    total[at.shapes] = np.einsum("ci,ict->it", by_entry, model.planes).ravel()
    noise = np.exp(model.log_noise)
    total[at.log_noise] = noise * difference.diagonal(axis1=1, axis2=2).real.sum(0)
    return total


def _information(
    model: SpectralModel,
    data: Spectra,
    form: ComplexArray,
    slopes: _Slopes,
    inverse: ComplexArray,
) -> FloatArray:
    """Σ_k w_k Re tr(E⁻¹ ∂_a E E⁻¹ ∂_b E), from matrices of the size of N where that serves.

    With A = E⁻¹, Y = A P, V = Pᵀ Y, F = Y N and x_a = V g_a, a coordinate a of N (row i) and one
    b (row j) have 2 Re((x_a)_j (x_b)_i + V_ij g_b* x_a). The terms of the entries (c, i), (d, j)
    of P are 2 Re(F_di F_cj + A_cd (N V N)_ji), that of an entry and dN 2 Re(N V dN Y*)_ic, and
    those of noise follow from Y dN Y* and A_dc F_di*.
    """
    at, shapes, n_columns = model.layout, model.shapes, model.shapes.shape[1]
    n, n_forms = len(shapes), at.n_of_forms
    noise, w = np.exp(model.log_noise), data.weights[:, None, None]
    rows, vectors = slopes
    y = inverse @ shapes
    v = shapes.T @ y
    f = y @ form
    nv = form @ v
    nvn = nv @ form
    information = np.zeros((at.n_coordinates,) * 2)

    # Sums over lines of all products come first, since they are products of matrices.
    a = np.arange(n_forms)
    x = vectors @ v.swapaxes(1, 2)
    crossed = np.einsum("kaj,kbi->ajbi", w * x, x, optimize=True)[
        a[:, None], rows, a, rows[:, None]
    ]
    products = x @ vectors.conj().swapaxes(1, 2)
    products *= (w * v)[:, rows[:, None], rows]
    information[:n_forms, :n_forms] = 2.0 * (crossed.real + products.real.sum(0))

    entries = np.einsum("kdi,kcj->cidj", w * f, f, optimize=True).real
    entries += np.einsum("kcd,kji->cidj", w * inverse, nvn, optimize=True).real
    blocks = np.zeros((n, n_columns, n_columns, n - 1))
    for i, plane in enumerate(model.planes):
        blocks[:, i, i] = plane
    planes = blocks.reshape(n * n_columns, -1)
    information[at.shapes, at.shapes] = 2.0 * planes.T @ entries.reshape(n * n_columns, -1) @ planes

    in_space = vectors @ y.swapaxes(1, 2)  # Y g
    by_row = np.einsum("kij,kac->cija", w * nv, in_space.conj(), optimize=True)
    by_column = np.einsum("kai,kcj->cija", x @ form.swapaxes(1, 2), w * y.conj(), optimize=True)
    mixed = (by_row + by_column)[:, :, rows, a].real
    mixed = 2.0 * planes.T @ mixed.reshape(n * n_columns, n_forms)
    information[at.shapes, :n_forms], information[:n_forms, at.shapes] = mixed, mixed.T

    of_noise = np.einsum("kcd,kcd->cd", w * inverse, inverse.conj(), optimize=True).real
    information[at.log_noise, at.log_noise] = of_noise * noise * noise[:, None]
    with_shapes = 2.0 * np.einsum("kdc,kdi->dci", w * inverse, f.conj(), optimize=True).real
    with_shapes = noise[:, None] * with_shapes.reshape(n, -1) @ planes
    information[at.log_noise, at.shapes] = with_shapes
    information[at.shapes, at.log_noise] = with_shapes.T
    with_forms = 2.0 * np.einsum("kda,kad->da", w * y[:, :, rows], in_space.conj()).real
    with_forms *= noise[:, None]
    information[at.log_noise, :n_forms] = with_forms
    information[:n_forms, at.log_noise] = with_forms.T
    return information


def _slope_in_density(
    model: SpectralModel, data: Spectra, q: int, inverse: ComplexArray
) -> ComplexArray:
    """G (M, M), Hermitian: the misfit changes by tr(G dS)."""
    h, _, _ = _transfer(model, data.frequencies_hz, q)
    difference = data.weights[:, None, None] * (inverse - inverse @ data.matrices @ inverse)
    on_modes = model.shapes.T @ difference @ model.shapes
    slope: ComplexArray = np.einsum("ki,kij,kj->ij", h.conj(), on_modes, h, optimize=True)
    return slope


def _bending(slope: ComplexArray, model: SpectralModel) -> FloatArray:
    """The second derivatives of tr(G L L*), G the misfit's slope in S, where it pushes S down.

    Information alone vanishes with a column of L, and steps would grow as it does.
    """
    at = model.layout
    values, vectors = np.linalg.eigh(slope)
    slope = (vectors * np.maximum(values, 0.0)) @ vectors.conj().T
    i, j, units = _entries(model.forces)
    of_forces = (units.conj()[:, None] * slope[i[:, None], i] * units).real
    bending = np.zeros((at.n_coordinates,) * 2)
    own = slice(at.diagonal.start, at.imaginary.stop)
    bending[own, own] = 2.0 * of_forces * (j[:, None] == j)
    return bending


def gain_of_mode(
    model: SpectralModel, data: Spectra, q: int, mode: tuple[float, float, FloatArray]
) -> float:
    """About how many nats the misfit falls by when a mode is added, from derivatives alone.

    Args:
        model: without the mode.
        data: spectral matrices.
        q: how often accelerations were integrated.
        mode: its frequency in Hz, damping and shape (n,).
    """
    frequency, damping, shape = mode
    m, n_sources = model.n_modes, model.forces.shape[1]
    wider = replace(
        model,
        log_frequencies=np.append(model.log_frequencies, np.log(frequency)),
        log_dampings=np.append(model.log_dampings, np.log(damping)),
        shapes=np.insert(model.shapes, m, shape, axis=1),
        forces=np.insert(model.forces, m, 0.0, axis=0),
    )
    # By forces that go with those of other modes, to first order in the new row of L, while the
    # rest of the model follows; the new mode's frequency, damping and shape have no effect yet.
    exact, rows = derivatives(wider, data, q), _entries(wider.forces)[0]
    at = wider.layout
    own = at.diagonal.start + np.flatnonzero(rows == m)
    n_free = len(shape) - 1
    idle = [at.log_frequencies.start + m, at.log_dampings.start + m]
    idle += range(at.shapes.start + m * n_free, at.shapes.start + (m + 1) * n_free)
    rest = np.setdiff1d(np.arange(at.n_coordinates), [*own, *idle])
    follow = np.linalg.lstsq(
        exact.information[np.ix_(rest, rest)], exact.information[np.ix_(rest, own)], rcond=None
    )[0]
    slope = exact.gradient[own] - follow.T @ exact.gradient[rest]
    information = exact.information[np.ix_(own, own)] - exact.information[own][:, rest] @ follow
    gain = 0.5 * float(slope @ np.linalg.lstsq(information, slope, rcond=None)[0])
    # and by forces of its own, to first order in their density.
    if n_sources == len(model.forces):
        inverse = _misfit(covariances(wider, data.frequencies_hz, q), data)[1]
        in_density = float(_slope_in_density(wider, data, q, inverse)[m, m].real)
        h = _transfer(wider, data.frequencies_hz, q)[0][:, m]
        motion = np.abs(h) ** 2 * np.einsum("i,kij,j->k", shape, inverse, shape).real
        gain += 0.5 * min(0.0, in_density) ** 2 / float((data.weights * motion**2).sum())
    return gain
