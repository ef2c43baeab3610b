"""Frequencies and shapes of several tests, merged by weighted least squares.

A mode has one frequency and one shape at the sensors of all tests. A test saw a part of the shape,
at its own sensors and at unit length. Unknown are the logarithms of frequencies, and shapes in the
planes that touch the sphere of unit shapes at the present ones; Gauss and Newton's steps, weighted
by the inverse covariance of each test, move them to the least sum of squares. Sensors that two
tests share join the parts of a shape, each with the weight that its error gives it.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData


class PartOfTest:
    """What one test says of shapes of some of the merged modes, and of their frequencies.

    ``places`` are those of modes, by label, among the merged ones; N ``sensors`` are of all tests.
    """

    def __init__(
        self, name: str, data: ModalData, places: Mapping[str, int], sensors: Sequence[str],
        frequencies: bool,
    ) -> None:  # fmt: skip
        chosen = [mode for mode in data.modes if mode.label in places]
        with_shape = [mode for mode in chosen if mode.scored_shape is not None]
        m, n = len(data.modes), len(data.sensors)
        covariance = data.covariance
        if covariance is None:
            of_frequencies = [mode.frequency_cov or 0.0 for mode in data.modes]
            of_shapes = np.repeat([mode.shape_sd or 0.0 for mode in data.modes], n)
            covariance = np.diag(np.concatenate([of_frequencies, of_shapes]) ** 2)
        units = [np.array(mode.unit_shape, dtype=float) for mode in with_shape]
        self.unit_shapes = [np.nan_to_num(shape) for shape in units]  # (n,) each
        self.measured = [np.isfinite(shape) for shape in units]
        # Directions (n, d - 1) at right angles to each shape.
        self.bases = list(map(_plane, self.unit_shapes, self.measured))
        kept = chosen if frequencies else []
        planes = {mode.label: plane for mode, plane in zip(with_shape, self.bases, strict=True)}
        basis = block_diag(
            np.eye(m)[:, [data.labels.index(mode.label) for mode in kept]],
            *(planes.get(label, np.zeros((n, 0))) for label in data.labels),
        )
        try:
            root = np.linalg.cholesky(basis.T @ covariance @ basis)
        except np.linalg.LinAlgError:
            raise ValueError(
                f"{name}: the covariance of its modes is singular, so that they have no weights; "
                "use each mode's own errors"
            ) from None
        # Errors of frequencies, then of shapes in their planes, as independent ones of size one.
        self.whitening = np.linalg.inv(root)
        self.log_frequencies = np.log([mode.frequency_hz for mode in kept])
        self.frequency_places = [places[mode.label] for mode in kept]
        self.shape_places = [places[mode.label] for mode in with_shape]
        self.columns = [sensors.index(sensor) for sensor in data.sensors]

    def residuals(
        self, log_frequencies: FloatArray, shapes: FloatArray, planes: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (k,), and their derivatives (k, unknowns) with respect to the merged.

        The shape (N,) of each of the m merged modes may move in the directions (N, K_j) of a plane.
        """
        first = np.cumsum([len(log_frequencies), *(plane.shape[1] for plane in planes)])
        places = self.frequency_places
        residuals = [self.log_frequencies - log_frequencies[places]]
        slopes = np.zeros((len(places), first[-1]))
        slopes[range(len(places)), places] = 1.0
        parts = [slopes]
        for unit, measured, j, basis in zip(
            self.unit_shapes, self.measured, self.shape_places, self.bases, strict=True
        ):
            seen = np.where(measured, shapes[j, self.columns], 0.0)
            length = np.linalg.norm(seen)
            sign = 1.0 if seen @ unit >= 0.0 else -1.0
            direction = sign * seen / length
            residuals.append(-basis.T @ direction)
            moved = sign * planes[j][self.columns] * measured[:, None] / length
            moved = moved - np.outer(direction, direction @ moved)
            slopes = np.zeros((basis.shape[1], first[-1]))
            slopes[:, first[j] : first[j + 1]] = basis.T @ moved
            parts.append(slopes)
        return self.whitening @ np.concatenate(residuals), self.whitening @ np.concatenate(parts)


class Merged(NamedTuple):
    """m merged modes at N sensors."""

    log_frequencies: FloatArray  # (m,)
    shapes: FloatArray  # (m, N), at unit length; zero where no test measured
    covariance: FloatArray  # (m + m N, m + m N), of the logarithms of frequencies, then of shapes
    squares: float
    degrees_of_freedom: int


def weighted_least_squares(
    parts: Sequence[PartOfTest],
    log_frequencies: FloatArray,
    shapes: FloatArray,
    measured: NDArray[np.bool_],
) -> Merged:
    """The merged modes, from first estimates of log frequencies (m,) and unit shapes (m, N).

    Without frequencies in the parts they remain, with no variance; components that no test
    measured, as ``measured`` (m, N) says, are zero.
    """
    m = len(shapes)
    counted = m if any(part.frequency_places for part in parts) else 0
    for _ in range(50):
        planes = list(map(_plane, shapes, measured))
        of_parts = [part.residuals(log_frequencies, shapes, planes) for part in parts]
        residuals = np.concatenate([of_part for of_part, _ in of_parts])
        slopes = np.concatenate([of_part for _, of_part in of_parts])[:, m - counted :]
        if np.linalg.matrix_rank(slopes) < slopes.shape[1]:
            raise ValueError(
                "merging: sensors that the tests share do not move in a mode, so that the parts of "
                "its shape cannot be joined"
            )
        step, *_ = np.linalg.lstsq(slopes, residuals)
        log_frequencies = log_frequencies + np.append(step[:counted], np.zeros(m - counted))
        first = counted
        moved = []
        for shape, plane in zip(shapes, planes, strict=True):
            end = first + plane.shape[1]
            turned = shape + plane @ step[first:end]
            moved.append(turned / np.linalg.norm(turned) if turned.any() else turned)
            first = end
        shapes = np.array(moved)
        # In standard deviations, by the slopes: so little changes nothing that is shown.
        if np.linalg.norm(slopes @ step) < 1e-6:
            break
    else:
        raise ValueError("merging: the tests' modes are too different to be those of one structure")
    spread = np.linalg.inv(slopes.T @ slopes)
    embedding = block_diag(np.eye(m)[:, m - counted :], *planes)
    return Merged(
        log_frequencies,
        shapes,
        embedding @ spread @ embedding.T,
        float(residuals @ residuals),
        len(residuals) - slopes.shape[1],
    )


def _plane(shape: FloatArray, measured: NDArray[np.bool_]) -> FloatArray:
    """Directions (N, K) at right angles to a shape, among its measured components."""
    places = np.flatnonzero(measured)
    plane = np.zeros((len(shape), max(len(places) - 1, 0)))
    if len(places):
        plane[places] = np.linalg.svd(shape[places][None])[2][1:].T
    return plane
