"""Derivatives of the misfit of spectral matrices in the coordinates of their model."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.inverse_covariances import InverseCovariances
from bayes_ssi.records.spectra import Spectra
from bayes_ssi.records.spectral_model import (
    SpectralModel,
    powers,
    transfer,
    transfer_and_slopes,
)


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


def gradient(model: SpectralModel, data: Spectra, q: int) -> FloatArray:
    """(p,)"""
    form, slopes = _form_and_slopes(model, data, q)
    inverse = InverseCovariances.of(model.shapes, model.log_noise, form)
    return _gradient(model, data, form, slopes, inverse)


def derivatives(model: SpectralModel, data: Spectra, q: int) -> Derivatives:
    """Misfit, gradient and Fisher information."""
    form, slopes = _form_and_slopes(model, data, q)
    inverse = InverseCovariances.of(model.shapes, model.log_noise, form)
    return Derivatives(
        inverse.misfit(data),
        _gradient(model, data, form, slopes, inverse),
        _information(model, data, form, slopes, inverse),
        _bending(_slope_in_density(model, data, q, inverse), model),
    )


class _Slopes(NamedTuple):
    """Derivatives of N in ln f, ln ζ and the entries of L: dN_a = e_i g* + g e_i*, i the row of a.

    Each of them changes one row of diag(h) L, and so no more than one row and column of N. Those in
    the colour are x N and x² N.

    Attributes:
        rows: (a,)
        vectors: (K, a, M), g.
    """

    rows: NDArray[np.intp]
    vectors: ComplexArray


def _form_and_slopes(model: SpectralModel, data: Spectra, q: int) -> tuple[ComplexArray, _Slopes]:
    """N (K, M, M), and its derivatives."""
    h, by_frequency, by_damping = transfer_and_slopes(model, data.frequencies_hz, q)
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
    inverse: InverseCovariances,
) -> FloatArray:
    at, shapes = model.layout, model.shapes
    by_modes = _difference_by_modes(data, inverse)
    total = np.empty(at.n_coordinates)
    on_modes = by_modes @ shapes
    rows, vectors = slopes
    total[: at.n_of_forms] = 2.0 * (on_modes[:, rows] * vectors).real.sum((0, 2))
    by_entry = 2.0 * np.einsum("kij,kjc->ci", form, by_modes, optimize=True).real
    total[at.shapes] = np.einsum("ci,ict->it", by_entry, model.planes).ravel()
    noise = np.exp(model.log_noise)
    total[at.log_noise] = noise * (data.weights @ inverse.diagonals(data))
    of_form = np.einsum("kij,kji->k", on_modes, form).real
    total[at.colour] = of_form @ powers(model, data.frequencies_hz)
    return total


def _information(
    model: SpectralModel,
    data: Spectra,
    form: ComplexArray,
    slopes: _Slopes,
    inverse: InverseCovariances,
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
    a_k, y = inverse.full, inverse.of_shapes
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
    entries += np.einsum("kcd,kji->cidj", w * a_k, nvn, optimize=True).real
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

    of_noise = np.einsum("kcd,kcd->cd", w * a_k, a_k.conj(), optimize=True).real
    information[at.log_noise, at.log_noise] = of_noise * noise * noise[:, None]
    with_shapes = 2.0 * np.einsum("kdc,kdi->dci", w * a_k, f.conj(), optimize=True).real
    with_shapes = noise[:, None] * with_shapes.reshape(n, -1) @ planes
    information[at.log_noise, at.shapes] = with_shapes
    information[at.shapes, at.log_noise] = with_shapes.T
    with_forms = 2.0 * np.einsum("kda,kad->da", w * y[:, :, rows], in_space.conj()).real
    with_forms *= noise[:, None]
    information[at.log_noise, :n_forms] = with_forms
    information[:n_forms, at.log_noise] = with_forms.T

    if not len(model.colour):
        return information
    coloured = data.weights[:, None] * powers(model, data.frequencies_hz)
    by_colour = np.zeros((len(model.colour), at.n_coordinates))
    of_nvn = np.einsum("kij,kji->k", v, nvn).real
    by_colour[:, at.colour] = coloured.T @ (of_nvn[:, None] * powers(model, data.frequencies_hz))
    vn_rows = nv.conj().swapaxes(1, 2)[:, rows]
    by_colour[:, :n_forms] = coloured.T @ (2.0 * (vn_rows * x).real.sum(2))
    in_shapes = np.einsum("kij,kcj->kci", nvn, y.conj()).real.reshape(len(y), -1)
    by_colour[:, at.shapes] = 2.0 * coloured.T @ in_shapes @ planes
    by_colour[:, at.log_noise] = coloured.T @ (noise * (f * y.conj()).real.sum(2))
    information[at.colour], information[:, at.colour] = by_colour, by_colour.T
    return information


def _difference_by_modes(data: Spectra, inverse: InverseCovariances) -> ComplexArray:
    """w Pᵀ (E⁻¹ - E⁻¹ S̄ E⁻¹) (K, M, n)."""
    divided = inverse.of_shapes.conj().swapaxes(1, 2)
    return data.weights[:, None, None] * (divided - inverse.times(divided @ data.matrices))


def _slope_in_density(
    model: SpectralModel, data: Spectra, q: int, inverse: InverseCovariances
) -> ComplexArray:
    """G (M, M), Hermitian: the misfit changes by tr(G dS)."""
    h = transfer(model, data.frequencies_hz, q)
    on_modes = _difference_by_modes(data, inverse) @ model.shapes
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
        form = _form_and_slopes(wider, data, q)[0]
        inverse = InverseCovariances.of(wider.shapes, wider.log_noise, form)
        in_density = float(_slope_in_density(wider, data, q, inverse)[m, m].real)
        h = transfer(wider, data.frequencies_hz, q)[:, m]
        motion = np.abs(h) ** 2 * np.einsum("i,kij,j->k", shape, inverse.full, shape).real
        gain += 0.5 * min(0.0, in_density) ** 2 / float((data.weights * motion**2).sum())
    return gain
