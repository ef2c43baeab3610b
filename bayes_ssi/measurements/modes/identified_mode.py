"""One identified mode: its frequency and partial shape, checked and normalised."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.modal import scaled_shapes

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


def require_name(name: str, what: str) -> None:
    """Refuse a name that a file of modes could not hold."""
    if not isinstance(name, str) or not name.strip():
        raise ValueError(f"{what} must be text and not empty, got {name!r}")
    if name != name.strip() or not name.isprintable():
        raise ValueError(
            f"{what} may not begin or end with a space, or hold a line break or tab, got {name!r}"
        )


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
    if len(set(names)) < len(names):
        raise ValueError(f"{of}: two sensors are named {repeated(names)!r}")
    return names


def repeated(names: Iterable[str]) -> str | None:
    """The first name that occurs for a second time; None if none does."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _require_positive(number: float, where: str) -> None:
    if isinstance(number, bool) or not isinstance(number, (int, float, np.number)):
        raise ValueError(f"{where} must be a number, got {number!r}")
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{where} must be positive and finite, got {number!r}")


def checked_band(band_hz: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest frequency in Hz."""
    try:
        low, high = (float(bound) for bound in band_hz)
    except (TypeError, ValueError):
        raise ValueError(f"band_hz must be two frequencies in Hz, got {band_hz!r}") from None
    if not (0 <= low < high < math.inf):
        raise ValueError(f"band_hz must be 0 <= lowest < highest, got {low!r}, {high!r}")
    return low, high
