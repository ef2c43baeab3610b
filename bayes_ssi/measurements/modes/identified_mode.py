"""Identified modes, checked and normalised, and the joint covariance of their errors.

Rows and columns of a covariance are the logarithms of m frequencies, then the components of m unit
shapes at n sensors, mode by mode. A shape at unit length has no error along itself, and what was
not measured has none either: there the covariance is zero.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayes_ssi.foundations.argument_types import repeated
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_name
from bayes_ssi.structures.modal import ROUNDING, scaled_shapes

# Columns of a file of modes; no sensor may have one of these names.
RESERVED_NAMES = ("label", "frequency_hz", "frequency_cov", "shape_sd", "damping", "damping_sd")


@dataclass(frozen=True, eq=False)
class IdentifiedMode:
    """One identified mode.

    Attributes:
        label: name of the mode, unique in its data set.
        frequency_hz: natural frequency in Hz.
        shape: components at the sensors (n_sensors,), real or complex, in any scale; NaN where a
            sensor is missing. None where no shape was identified.
        frequency_cov: standard deviation of the identified frequency as a fraction of it.
        shape_sd: standard deviation of each component of the shape at unit length.
        damping: fraction of critical damping.
        damping_sd: standard deviation of ``damping``.

    Raises:
        ValueError: a number is out of range, or every component of the shape is zero.

    >>> bs.IdentifiedMode("1", 0.983, shape=[3.0, 4.0]).unit_shape
    array([0.6, 0.8])
    """

    label: str
    frequency_hz: float
    shape: NDArray[np.float64] | NDArray[np.complex128] | None = None
    frequency_cov: float | None = None
    shape_sd: float | None = None
    damping: float | None = None
    damping_sd: float | None = None

    def __post_init__(self) -> None:
        require_name(self.label, "mode label")
        if self.label.startswith("#"):
            raise ValueError(
                f"mode label may not begin with '#', which marks remarks in files of modes, "
                f"got {self.label!r}"
            )
        _require_positive(self.frequency_hz, self._where("frequency_hz"))
        for name in ("frequency_cov", "shape_sd", "damping_sd"):
            if (number := getattr(self, name)) is not None:
                _require_positive(number, self._where(name))
        if self.damping is not None and not 0 <= self.damping < 1:
            raise ValueError(
                f"{self._where('damping')} must be a fraction of critical damping in [0, 1), "
                f"got {self.damping!r}"
            )
        if self.damping_sd is not None and self.damping is None:
            raise ValueError(f"{self._where('damping_sd')} is given without damping")
        if self.shape is not None:
            object.__setattr__(self, "shape", self._checked_shape())

    def _where(self, field: str) -> str:
        return f"mode {self.label!r}: {field}"

    def _checked_shape(self) -> NDArray[np.float64] | NDArray[np.complex128] | None:
        try:
            shape = np.array(self.shape)
        except ValueError:  # rows of different lengths
            shape = np.array(None)
        if shape.ndim != 1 or shape.dtype.kind not in "iufc":
            raise ValueError(
                f"{self._where('shape')} must be a list of numbers, got {self.shape!r}"
            )
        shape = shape.astype(complex if shape.dtype.kind == "c" else float)
        if np.isinf(shape).any():
            raise ValueError(f"{self._where('shape')} must be finite, got {shape.tolist()!r}")
        measured = np.isfinite(shape)
        if not measured.any():
            return None
        largest = float(np.abs(shape[measured]).max())
        if largest == 0.0:
            raise ValueError(f"{self._where('shape')} is zero at every sensor")
        if not 1e-100 < largest < 1e100:  # whose squares are numbers
            raise ValueError(f"{self._where('shape')} must be in a usual scale, got {largest:g}")
        shape.setflags(write=False)
        return shape

    @cached_property
    def unit_shape(self) -> FloatArray | None:
        """The real shape (n_sensors,) at unit length over the measured sensors, NaN elsewhere.

        A complex shape is rotated to the phase at which its real part is longest.
        """
        if self.shape is None:
            return None
        real = _rotated(self.shape).real
        unit = real / np.sqrt(np.nansum(real**2))
        unit.setflags(write=False)
        return unit

    @cached_property
    def scaled_shape(self) -> FloatArray | None:
        """``unit_shape`` as it is shown, with its largest component at 1 or -1."""
        unit = self.unit_shape
        if unit is None:
            return None
        scaled = scaled_shapes(unit[None], unit[None])[0]
        scaled.setflags(write=False)
        return scaled

    @cached_property
    def phase_scatter_deg(self) -> float:
        """Spread of a complex shape's phases about one line in degrees; 0 for a real shape.

        The root mean square of the imaginary components after rotation relative to the length of
        the whole shape, as an angle: 0 for a shape on a line, 45 for one on a circle.
        """
        if self.shape is None or not np.iscomplexobj(self.shape):
            return 0.0
        rotated = _rotated(self.shape[np.isfinite(self.shape)])
        return math.degrees(math.asin(np.linalg.norm(rotated.imag) / np.linalg.norm(rotated)))

    @cached_property
    def n_measured(self) -> int:
        """Number of sensors at which the shape is known; 0 without a shape."""
        return 0 if self.shape is None else int(np.isfinite(self.shape).sum())

    @property
    def scored_shape(self) -> FloatArray | None:
        """``unit_shape`` if it carries information; a single component does not."""
        return self.unit_shape if self.n_measured >= 2 else None


def _rotated(shape: NDArray[Any]) -> NDArray[Any]:
    """The shape at the phase at which its real part is longest; real shapes are unchanged."""
    if not np.iscomplexobj(shape):
        return shape
    return shape * np.exp(-0.5j * np.angle(np.nansum(shape**2)))


def checked_sensors(sensors: Iterable[str], of: str) -> tuple[str, ...]:
    """The names of the sensors of a record or of modal data, which ``of`` calls it."""
    if isinstance(sensors, str):
        raise TypeError(f"{of}: sensors must be several names, got {sensors!r}")
    names = tuple(sensors)
    for name in names:
        require_name(name, f"{of}: sensor name")
        if name in RESERVED_NAMES:
            raise ValueError(
                f"{of}: a sensor may not be named {name!r}, a column of every file of modes"
            )
    if twice := repeated(names):
        raise ValueError(f"{of}: two sensors are named {twice[0]!r}")
    return names


def _require_positive(number: float, where: str) -> None:
    if isinstance(number, bool) or not isinstance(number, (int, float, np.number)):
        raise ValueError(f"{where} must be a number, got {number!r}")
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{where} must be positive and finite, got {number!r}")


def checked_band(band_hz: Sequence[float]) -> tuple[float, float]:
    try:
        low, high = (float(bound) for bound in band_hz)
    except (TypeError, ValueError):
        raise ValueError(f"band_hz must be two frequencies in Hz, got {band_hz!r}") from None
    if not (0 <= low < high < math.inf):
        raise ValueError(f"band_hz must be 0 <= lowest < highest, got {low!r}, {high!r}")
    return low, high


def with_joint_errors(
    modes: Sequence[IdentifiedMode], covariance: FloatArray, n_sensors: int
) -> tuple[tuple[IdentifiedMode, ...], FloatArray]:
    """The modes with the sizes of their errors, and their covariance, in their order, read-only."""
    matrix = np.array(covariance, dtype=float)
    m = len(modes)
    size = m * (1 + n_sensors)
    if matrix.shape != (size, size):
        raise ValueError(
            f"modal data: covariance must be ({size}, {size}) for {m} modes at {n_sensors} "
            f"sensors, got {matrix.shape}"
        )
    planes = tangent_planes(modes, n_sensors)
    counted = np.concatenate([np.ones(m, dtype=bool), planes.any(axis=2).ravel()])
    matrix[~counted] = 0.0
    matrix[:, ~counted] = 0.0
    if not np.isfinite(matrix).all():
        raise ValueError("modal data: covariance has entries that are not finite")
    # Entries may be rounded to single precision, which leaves eigenvalues as much below zero.
    rounding = 1e-6 * np.abs(matrix).max()
    if np.abs(matrix - matrix.T).max() > rounding:
        raise ValueError("modal data: covariance is not symmetric")
    matrix = 0.5 * (matrix + matrix.T)
    # Shapes have no errors along themselves. What is in their planes already stays as it is, to the
    # last digit.
    projection = block_diag(np.eye(m), *planes)
    projected = projection @ matrix @ projection
    if np.abs(projected - matrix).max() > ROUNDING * np.abs(matrix).max():
        matrix = 0.5 * (projected + projected.T)
    lowest = float(np.linalg.eigvalsh(matrix)[0])
    if lowest < -rounding:
        raise ValueError(
            f"modal data: covariance is not positive semi-definite: an eigenvalue is {lowest:.3g}"
        )
    variances = matrix.diagonal()
    traces = variances[m:].reshape(m, -1).sum(axis=1)
    sized = []
    for mode, variance, trace in zip(modes, variances[:m], traces, strict=True):
        sizes = {"frequency_cov": float(np.sqrt(variance))}
        if mode.scored_shape is not None:
            sizes["shape_sd"] = float(np.sqrt(trace / (mode.n_measured - 1)))
        for name, number in sizes.items():
            if number == 0.0:
                raise ValueError(
                    f"modal data: covariance: mode {mode.label!r} has no variance of its "
                    f"{name.partition('_')[0]}"
                )
            # Sizes of errors beside a covariance may be rounded to two digits.
            stated = getattr(mode, name)
            if stated is not None and abs(stated / number - 1.0) > 0.05:
                raise ValueError(
                    f"mode {mode.label!r}: {name} is {stated:g}, but the covariance gives "
                    f"{number:.3g}"
                )
        shape_sd = sizes.get("shape_sd", mode.shape_sd)
        sized.append(replace(mode, frequency_cov=sizes["frequency_cov"], shape_sd=shape_sd))
    matrix.setflags(write=False)
    return tuple(sized), matrix


def of_modes(covariance: FloatArray, places: Sequence[int], m: int, n: int) -> FloatArray:
    """The covariance of some of m modes at n sensors, in the order of ``places``."""
    rows = [*places, *(m + n * i + k for i in places for k in range(n))]
    array = np.asarray(covariance, dtype=float)
    if array.shape != (m + m * n, m + m * n):
        return array  # of no use, as is said where it is checked
    return array[np.ix_(rows, rows)]


def tangent_planes(modes: Sequence[IdentifiedMode], n_sensors: int) -> FloatArray:
    """Projections (m, n, n) onto the plane at right angles to each scored shape, else zero."""
    planes = np.zeros((len(modes), n_sensors, n_sensors))
    for plane, mode in zip(planes, modes, strict=True):
        if mode.scored_shape is not None:
            unit = np.nan_to_num(mode.scored_shape)
            plane[:] = np.diag(np.isfinite(mode.scored_shape).astype(float)) - np.outer(unit, unit)
    return planes
