"""The joint covariance of the identification errors of several modes.

Rows and columns are the logarithms of m frequencies, then the components of m unit shapes at n
sensors, mode by mode. A shape at unit length has no error along itself, and what was not measured
has none either: there the covariance is zero.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.structures.modal import SOLVER


def checked_covariance(
    covariance: FloatArray, modes: Sequence[IdentifiedMode], n_sensors: int
) -> FloatArray:
    """The covariance of these modes, in their order, read-only."""
    matrix = np.array(covariance, dtype=float)
    size = len(modes) * (1 + n_sensors)
    if matrix.shape != (size, size):
        raise ValueError(
            f"modal data: covariance must be ({size}, {size}) for {len(modes)} modes at "
            f"{n_sensors} sensors, got {matrix.shape}"
        )
    planes = tangent_planes(modes, n_sensors)
    counted = np.concatenate([np.ones(len(modes), dtype=bool), planes.any(axis=2).ravel()])
    matrix[~counted] = 0.0
    matrix[:, ~counted] = 0.0
    if not np.isfinite(matrix).all():
        raise ValueError("modal data: covariance has entries that are not finite")
    # Entries may be rounded to single precision, which leaves eigenvalues as much below zero.
    rounding = 1e-6 * np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > rounding:
        raise ValueError("modal data: covariance is not symmetric")
    matrix = _in_planes(0.5 * (matrix + matrix.T), planes)
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest < -rounding:
        raise ValueError(
            f"modal data: covariance is not positive semi-definite: an eigenvalue is {lowest:.3g}"
        )
    for mode, (frequency, shape) in zip(modes, _sizes(matrix, modes), strict=True):
        if frequency == 0.0 or shape == 0.0:
            what = "frequency" if frequency == 0.0 else "shape"
            raise ValueError(
                f"modal data: covariance: mode {mode.label!r} has no variance of its {what}"
            )
    matrix.setflags(write=False)
    return matrix


def with_sizes(
    modes: Sequence[IdentifiedMode], covariance: FloatArray
) -> tuple[IdentifiedMode, ...]:
    """The modes with the sizes of their errors from their covariance."""
    return tuple(
        replace(
            mode,
            frequency_cov=_agreed(mode, "frequency_cov", frequency),
            shape_sd=_agreed(mode, "shape_sd", shape),
        )
        for mode, (frequency, shape) in zip(modes, _sizes(covariance, modes), strict=True)
    )


def of_modes(covariance: FloatArray, places: Sequence[int], m: int, n: int) -> FloatArray:
    """The covariance of some of m modes at n sensors, in the order of ``places``."""
    rows = [*places, *(m + n * i + k for i in places for k in range(n))]
    array = np.asarray(covariance, dtype=float)
    if array.shape != (m + m * n, m + m * n):
        return array  # of no use, as is said where it is checked
    taken: FloatArray = array[np.ix_(rows, rows)]
    return taken


def tangent_planes(modes: Sequence[IdentifiedMode], n_sensors: int) -> FloatArray:
    """Projections (m, n, n) onto the plane at right angles to each scored shape, else zero."""
    planes = np.zeros((len(modes), n_sensors, n_sensors))
    for plane, mode in zip(planes, modes, strict=True):
        if mode.scored_shape is not None:
            unit = np.nan_to_num(mode.scored_shape)
            plane[:] = np.diag(np.isfinite(mode.scored_shape).astype(float)) - np.outer(unit, unit)
    return planes


def _in_planes(covariance: FloatArray, planes: FloatArray) -> FloatArray:
    """The covariance without errors of shapes along themselves."""
    projection = block_diag(np.eye(len(planes)), *planes)
    projected = projection @ covariance @ projection
    # What is in the planes already stays as it is, to the last digit.
    change = np.abs(projected - covariance).max()
    kept = change <= SOLVER.rounding * np.abs(covariance).max()
    return covariance if kept else 0.5 * (projected + projected.T)


def _sizes(
    covariance: FloatArray, modes: Sequence[IdentifiedMode]
) -> list[tuple[float, float | None]]:
    """Standard deviations of each frequency and of the components of each scored shape."""
    m = len(modes)
    variances = covariance.diagonal()
    traces = variances[m:].reshape(m, -1).sum(axis=1)
    return [
        (
            float(np.sqrt(variance)),
            None if mode.scored_shape is None else float(np.sqrt(trace / (mode.n_measured - 1))),
        )
        for mode, variance, trace in zip(modes, variances, traces, strict=False)
    ]


def _agreed(mode: IdentifiedMode, name: str, size: float | None) -> float | None:
    stated = getattr(mode, name)
    # Sizes of errors beside a covariance may be rounded to two digits.
    if size is not None and stated is not None and abs(stated / size - 1.0) > 0.05:
        raise ValueError(
            f"mode {mode.label!r}: {name} is {stated:g}, but the covariance gives {size:.3g}"
        )
    return stated if size is None else size
