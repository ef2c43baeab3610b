"""Frequencies and shapes of several tests, merged by weighted least squares.

A mode has one frequency and one shape at the sensors of all tests. A test saw a part of the shape,
at its own sensors and at unit length. Unknown are the logarithms of frequencies, and shapes but for
their lengths; Gauss and Newton's steps, weighted by the inverse covariance of each test, move them
to the least sum of squares, the shortest of all such steps, which leave lengths as they are.
Sensors that two tests share join the parts of a shape, each with the weight that its error gives
it.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.identified_mode import tangent_planes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import ROUNDING


class PartOfTest:
    """What one test says of shapes of some of the merged modes, and of their frequencies.

    ``places`` are those of modes, by label, among the merged ones; N ``sensors`` are of all tests.
    """

    def __init__(
        self, name: str, data: ModalData, places: Mapping[str, int], sensors: Sequence[str],
        frequencies: bool,
    ) -> None:  # fmt: skip
        m, n = len(data.modes), len(data.sensors)
        chosen = [(i, mode) for i, mode in enumerate(data.modes) if mode.label in places]
        with_shape = [(i, mode) for i, mode in chosen if mode.scored_shape is not None]
        kept = chosen if frequencies else []
        covariance = data.covariance
        if covariance is None:
            of_frequencies = np.diag([(mode.frequency_cov or 0.0) ** 2 for mode in data.modes])
            sizes = np.array([(mode.shape_sd or 0.0) ** 2 for mode in data.modes])
            of_shapes = sizes[:, None, None] * tangent_planes(data.modes, n)
            covariance = block_diag(of_frequencies, *of_shapes)
        rows = [i for i, _ in kept] + [m + n * i + k for i, _ in with_shape for k in range(n)]
        variances, directions = np.linalg.eigh(covariance[np.ix_(rows, rows)])
        # A shape at unit length has no error along itself.
        rank = len(kept) + sum(mode.n_measured - 1 for _, mode in with_shape)
        variances, directions = variances[len(rows) - rank :], directions[:, len(rows) - rank :]
        if rank and not variances[0] > ROUNDING * variances[-1]:
            raise ValueError(
                f"{name}: the covariance of its modes is singular, so that they have no weights; "
                "use each mode's own errors"
            )
        # Errors of frequencies, then of shapes, as independent ones of size one.
        self.whitening = (directions / np.sqrt(variances)).T
        self.log_frequencies = np.log([mode.frequency_hz for _, mode in kept])
        self.frequency_places = [places[mode.label] for _, mode in kept]
        self.unit_shapes = [np.array(mode.unit_shape, dtype=float) for _, mode in with_shape]
        self.shape_places = [places[mode.label] for _, mode in with_shape]
        self.columns = np.array([sensors.index(sensor) for sensor in data.sensors], dtype=int)

    def residuals(
        self, log_frequencies: FloatArray, shapes: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (k,), and their derivatives (k, m + m N) by those merged.

        Of m merged modes these are the logarithms of frequencies, and then shapes (m, N).
        """
        m, n, places = *shapes.shape, self.frequency_places
        residuals = [self.log_frequencies - log_frequencies[places]]
        slopes = [np.eye(m, m + m * n)[places]]
        for unit, j in zip(self.unit_shapes, self.shape_places, strict=True):
            measured = np.isfinite(unit)
            seen = np.where(measured, shapes[j, self.columns], 0.0)
            length = np.linalg.norm(seen)
            sign = 1.0 if seen @ np.nan_to_num(unit) >= 0.0 else -1.0
            direction = sign * seen / length
            residuals.append(np.nan_to_num(unit) - direction)
            of_shape = np.zeros((len(unit), m + m * n))
            moved = np.diag(measured.astype(float)) - np.outer(direction, direction)
            of_shape[:, m + n * j + self.columns] = sign * moved / length
            slopes.append(of_shape)
        return self.whitening @ np.concatenate(residuals), self.whitening @ np.concatenate(slopes)


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
    n_unknowns = int((measured.sum(axis=1) - 1).clip(0).sum())
    n_unknowns += m if any(part.frequency_places for part in parts) else 0
    for _ in range(50):
        of_parts = (part.residuals(log_frequencies, shapes) for part in parts)
        residuals, slopes = map(np.concatenate, zip(*of_parts, strict=True))
        left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
        if (sizes > max(slopes.shape) * np.finfo(float).eps * sizes[0]).sum() < n_unknowns:
            raise ValueError(
                "merging: sensors that the tests share do not move in a mode, so that the parts of "
                "its shape cannot be joined"
            )
        inverse = right[:n_unknowns].T / sizes[:n_unknowns]
        fitted = left[:, :n_unknowns].T @ residuals
        step = inverse @ fitted
        log_frequencies = log_frequencies + step[:m]
        shapes = shapes + step[m:].reshape(shapes.shape)
        lengths = np.linalg.norm(shapes, axis=1, keepdims=True)
        shapes = shapes / np.where(lengths > 0.0, lengths, 1.0)
        # In standard deviations, by the slopes: so little changes nothing that is shown.
        if np.linalg.norm(fitted) < 1e-6:
            break
    else:
        raise ValueError("merging: the tests' modes are too different to be those of one structure")
    return Merged(
        log_frequencies,
        shapes,
        inverse @ inverse.T,
        float(residuals @ residuals),
        len(residuals) - n_unknowns,
    )
