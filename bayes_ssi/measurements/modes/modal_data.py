"""Identified modes: frequencies and partial mode shapes of one test, in one frequency band."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.argument_types import repeated, require, require_known
from bayes_ssi.foundations.arrays import FloatArray, steady_digest
from bayes_ssi.foundations.displayed import Displayed, columns, counted
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import (
    IdentifiedMode,
    checked_band,
    checked_sensors,
    of_modes,
    with_joint_errors,
)
from bayes_ssi.structures.modal import mac_of_pairs
from bayes_ssi.structures.response import HEAVY_DAMPING, heavy_damping_warning


@dataclass(frozen=True, eq=False, repr=False)
class ModalData(Displayed):
    """The modes identified in one test of one structure, and the band of the search.

    Include every mode identified in the band, even those that a model does not explain.

    Attributes:
        modes: in ascending order of frequency (unsorted ones are sorted).
        band_hz: lowest and highest frequency of the search, in Hz.
        sensors: names of the sensors, the components of every shape.
        source: where the data come from.
        covariance: joint covariance of the identification errors, (m + m n, m + m n) for m modes
            at n sensors: of the logarithms of all frequencies, then of the components of all unit
            shapes, mode by mode, in the order in which ``modes`` are given. Components that were
            not measured do not count. It gives every mode its ``frequency_cov``, and its
            ``shape_sd`` as √(trace / (d - 1)) of its d measured components. None where errors of
            these sizes are independent.
        identifications: how the modes were identified from records; empty where not known.
        failed_checks: why these modes may be wrong, besides those of their identifications, as
            where the setups that they are merged from disagree; a sentence each.

    Raises:
        ValueError: labels repeat, a mode lies outside the band, a shape does not have one
            component per sensor, the band is empty, or the covariance is not one of these modes.

    >>> second, first = bs.IdentifiedMode("2", 2.6), bs.IdentifiedMode("1", 0.98)
    >>> bs.ModalData((second, first), band_hz=(0.0, 4.0)).labels
    ('1', '2')
    """

    modes: tuple[IdentifiedMode, ...]
    band_hz: tuple[float, float]
    sensors: tuple[str, ...] = ()
    source: str = ""
    covariance: FloatArray | None = None
    identifications: tuple[IdentificationSummary, ...] = ()
    failed_checks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        low, high = checked_band(self.band_hz)
        object.__setattr__(self, "band_hz", (low, high))
        object.__setattr__(self, "sensors", checked_sensors(self.sensors, "modal data"))
        require(self.modes, tuple[IdentifiedMode, ...], "modal data: modes")
        order = sorted(range(len(self.modes)), key=lambda i: self.modes[i].frequency_hz)
        ordered = tuple(self.modes[i] for i in order)
        object.__setattr__(self, "modes", ordered)
        if not ordered:
            raise ValueError("modal data: no identified mode")
        if twice := repeated(self.labels):
            raise ValueError(f"modal data: two modes have the label {twice[0]!r}")
        for mode in ordered:
            if not low <= mode.frequency_hz <= high:
                raise ValueError(
                    f"mode {mode.label!r}: frequency_hz {mode.frequency_hz!r} lies outside the "
                    f"band {low!r} to {high!r} Hz"
                )
            if mode.shape is not None and len(mode.shape) != len(self.sensors):
                raise ValueError(
                    f"mode {mode.label!r}: shape has {len(mode.shape)} components for "
                    f"{len(self.sensors)} sensors"
                )
        if self.covariance is not None:
            matrix = of_modes(self.covariance, order, len(order), len(self.sensors))
            ordered, covariance = with_joint_errors(ordered, matrix, len(self.sensors))
            object.__setattr__(self, "covariance", covariance)
            object.__setattr__(self, "modes", ordered)

    @classmethod
    def from_arrays(
        cls, frequencies_hz: ArrayLike, shapes: ArrayLike, band_hz: Sequence[float],
        sensors: Sequence[str], source: str = "", *, covariance: FloatArray | None = None,
        **columns: ArrayLike,
    ) -> "ModalData":  # fmt: skip
        """Modes labelled 1, 2, … in the order of the arrays.

        Args:
            frequencies_hz: (m,).
            shapes: (n, m), of n sensors.
            band_hz: lowest and highest frequency of the search, in Hz.
            sensors: their names.
            source: where the data come from.
            covariance: as of the attribute.
            columns: other fields of :class:`IdentifiedMode`, (m,) each or one number for all;
                NaN where not known.

        Raises:
            ValueError: lengths do not match, or a mode or the band is not usable.
        """
        frequencies = np.asarray(frequencies_hz, dtype=float)
        numbers = {name: np.asarray(column, dtype=float) for name, column in columns.items()}
        for name, column in numbers.items():
            if column.shape not in ((), frequencies.shape):
                raise ValueError(
                    f"ModalData: {name} must be one number or {len(frequencies)}, one for each "
                    f"mode, got shape {column.shape}"
                )
            numbers[name] = np.broadcast_to(column, frequencies.shape)
        modes = tuple(
            IdentifiedMode(
                str(i + 1),
                float(hz),
                shape,
                **{name: float(n[i]) for name, n in numbers.items() if not np.isnan(n[i])},
            )
            for i, (hz, shape) in enumerate(zip(frequencies, np.asarray(shapes).T, strict=True))
        )
        return cls(modes, checked_band(band_hz), tuple(sensors), source, covariance)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the modes, in ascending order of frequency."""
        return tuple(mode.label for mode in self.modes)

    @property
    def frequencies_hz(self) -> FloatArray:
        """(n_modes,)"""
        return np.array([mode.frequency_hz for mode in self.modes])

    @property
    def unit_shapes(self) -> FloatArray:
        """Shapes (n_sensors, n_modes), each at unit length; NaN where not measured."""
        missing = np.full(len(self.sensors), np.nan)
        shapes = [missing if m.unit_shape is None else m.unit_shape for m in self.modes]
        return np.array(shapes).reshape(len(self.modes), len(self.sensors)).T

    def mode(self, label: str) -> IdentifiedMode:
        """The mode of that label.

        Raises:
            ValueError: there is no such mode.
        """
        by_label = {mode.label: mode for mode in self.modes}
        require_known("no identified mode", [label], by_label)
        return by_label[label]

    def without_shapes(self) -> "ModalData":
        """The same modes with their frequencies only."""
        modes = tuple(replace(m, shape=None, shape_sd=None) for m in self.modes)
        m = len(modes)
        covariance = None if self.covariance is None else self.covariance[:m, :m]
        return replace(self, modes=modes, sensors=(), covariance=covariance)

    def without_covariance(self) -> "ModalData":
        """The same modes, each with errors of its own: ``frequency_cov`` and ``shape_sd``."""
        return replace(self, covariance=None)

    @property
    def all_failed_checks(self) -> tuple[str, ...]:
        """Failed checks, also of the identifications, which every result from these modes says."""
        return (
            *self.failed_checks,
            *(
                f"identified from {summary.record.source or 'a record'}: {check}"
                for summary in self.identifications
                for check in summary.failed_checks
            ),
        )

    @cached_property
    def digest(self) -> str:
        """Digest of the frequencies, scored shapes and band whose density an evidence is.

        Evidences are comparable only where their digests agree.
        """
        scored = [
            (f"{mode.frequency_hz:.12g}", self._scored_components(mode)) for mode in self.modes
        ]
        text = json.dumps([scored, [f"{bound:.12g}" for bound in self.band_hz]])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def full_digest(self) -> str:
        """Digest of all that a run from the data depends on, with labels and sizes of errors."""
        errors = [(mode.label, mode.frequency_cov, mode.shape_sd) for mode in self.modes]
        text = json.dumps([self.digest, self.sensors, errors, self.covariance_digest])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def covariance_digest(self) -> str | None:
        """Digest of the joint covariance of the identification errors; None where there is none."""
        if self.covariance is None:
            return None
        # It is projected on the planes of the shapes, where rounding depends on the processor.
        return steady_digest(self.covariance.ravel(), np.arange(self.covariance.size))

    def _scored_components(self, mode: IdentifiedMode) -> list[tuple[str, int]]:
        """Sensors and components of a scored shape, the same for a shape and its negative."""
        if mode.scored_shape is None:
            return []
        # Whole numbers of 1e-9, so that rounding and negative zeros make no difference.
        components = [
            (sensor, round(1e9 * component))
            for sensor, component in sorted(zip(self.sensors, mode.scored_shape, strict=True))
            if np.isfinite(component)
        ]
        negative = next(component for _, component in components if component) < 0
        return [(sensor, -component if negative else component) for sensor, component in components]

    def warnings(self) -> list[str]:
        """What an analyst should know about these data before using them, a sentence each."""
        warnings = list(self.all_failed_checks)
        warnings += [text for each in self.identifications for text in each.said_of_sensors]
        left_out = [name for each in self.identifications for name, _ in each.left_out]
        for mode in self.modes:
            name = f"mode {mode.label!r}"
            if mode.shape is None:
                warnings.append(f"{name}: no shape; only its frequency is used")
            elif mode.n_measured == 1:
                warnings.append(f"{name}: shape at one sensor only; only its frequency is used")
            elif missing := [
                sensor
                for sensor, component in zip(self.sensors, mode.shape, strict=True)
                if not (np.isfinite(component) or sensor in left_out)
            ]:
                warnings.append(f"{name}: shape not measured at {', '.join(missing)}")
            # Shapes of lightly damped structures are nearly real; this far from one line, weighted
            # by amplitude, a real shape is a poor summary.
            if mode.phase_scatter_deg > 10.0:
                warnings.append(
                    f"{name}: phases scatter by {mode.phase_scatter_deg:.0f} degrees about one "
                    "line; a real shape is a poor approximation"
                )
            # No useful identification is this uncertain; percentages are above it.
            if mode.frequency_cov is not None and mode.frequency_cov > 0.2:
                warnings.append(
                    f"{name}: frequency_cov is {mode.frequency_cov:g}, a fraction; "
                    "is it a percentage, or in Hz?"
                )
            if mode.damping is not None and mode.damping > HEAVY_DAMPING:
                warnings.append(f"{name}: {heavy_damping_warning(mode.damping)}")
        for low, high in pairwise(self.modes):
            if low.frequency_hz == high.frequency_hz:
                warnings.append(f"modes {low.label!r} and {high.label!r}: the same frequency")
        for low, high, criterion in self.alike:
            gap = high.frequency_hz / low.frequency_hz - 1.0
            warnings.append(
                f"modes {low.label!r} and {high.label!r}: {100 * gap:.0f} % apart with similar "
                f"shapes (MAC {criterion:.2f}), as when an appendage in resonance splits a mode"
            )
        return warnings

    @property
    def alike(self) -> list[tuple[IdentifiedMode, IdentifiedMode, float]]:
        """Neighbouring modes that look like one that is split, and the MAC of their shapes."""
        shapes = self.unit_shapes.T
        criteria = mac_of_pairs(shapes[:-1], shapes[1:])
        gaps = self.frequencies_hz[1:] / self.frequencies_hz[:-1] - 1.0
        # At one sensor all shapes are alike; the MAC of a mode without a shape is not a number.
        measured = np.isfinite(shapes[:-1] * shapes[1:]).sum(axis=1)
        alike = (gaps > 0.0) & (gaps < 0.2) & (criteria > 0.8) & (measured >= 2)
        return [
            (self.modes[i], self.modes[i + 1], float(criteria[i])) for i in np.flatnonzero(alike)
        ]

    def _line(self) -> str:
        low, high = self.band_hz
        modes, sensors = counted(len(self.modes), "mode"), counted(len(self.sensors), "sensor")
        return f"{modes} identified from {low:g} to {high:g} Hz, {sensors}"

    def _rows(self) -> list[dict[str, Any]]:
        rows = []
        for mode in self.modes:
            row = columns(mode, ("label", "frequency_hz", "frequency_cov", "damping", "shape_sd"))
            shape = [None] * len(self.sensors) if mode.shape is None else mode.shape.tolist()
            rows.append(row | dict(zip(self.sensors, shape, strict=True)))
        return rows
