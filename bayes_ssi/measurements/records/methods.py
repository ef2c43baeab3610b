"""Modes of one record by each of several methods, side by side.

All but the Bayesian FFT look near modes that are given, as a user who compares them would.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_one_of
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.modal_estimates import ModalEstimates, Poles
from bayes_ssi.measurements.records.next_era import correlations, next_era
from bayes_ssi.measurements.records.peak_methods import Peaks, fdd, tfie
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.ssi_cov import ssi_cov


class MethodModes(NamedTuple):
    """m modes by one method; None for what the method does not give.

    Attributes:
        frequencies_hz: (m,).
        shapes: (n, m), real, at unit length.
        frequency_covs: (m,), standard deviations over the frequencies.
        dampings: (m,).
        damping_sds: (m,).
        shape_sds: (m,).
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    frequency_covs: FloatArray | None = None
    dampings: FloatArray | None = None
    damping_sds: FloatArray | None = None
    shape_sds: FloatArray | None = None

    def modal_data(
        self, band_hz: tuple[float, float], sensors: tuple[str, ...], source: str = ""
    ) -> ModalData:
        """The modes as data of model classes, with the errors that the method claims."""

        def of(values: FloatArray | None, i: int) -> float | None:
            return None if values is None else float(values[i])

        modes = tuple(
            IdentifiedMode(
                str(i + 1), float(f), self.shapes[:, i], of(self.frequency_covs, i),
                of(self.shape_sds, i), of(self.dampings, i), of(self.damping_sds, i),
            )
            for i, f in enumerate(self.frequencies_hz)
        )  # fmt: skip
        return ModalData(modes, band_hz, sensors, source)


def of_estimates(estimates: ModalEstimates) -> MethodModes:
    """Modes with all that is claimed of them, but for correlations."""
    return MethodModes(
        estimates.frequencies_hz, estimates.shapes, estimates.frequency_covs, estimates.dampings,
        estimates.damping_sds, estimates.shape_sds,
    )  # fmt: skip


def _next_era(record: Record, band_hz: tuple[float, float], near: Poles) -> MethodModes:
    return of_estimates(next_era(correlations(record, band_hz), near, record.sensors))


def _ssi_cov(record: Record, band_hz: tuple[float, float], near: Poles) -> MethodModes:
    modes = ssi_cov(record, band_hz, near)
    frequencies, dampings, shapes = modes.poles
    return MethodModes(
        frequencies, shapes, modes.frequency_sds / frequencies, dampings, modes.damping_sds
    )


def _of_peaks(
    method: Callable[[Record, tuple[float, float], list[float]], Peaks],
) -> Callable[[Record, tuple[float, float], Poles], MethodModes]:
    def modes(record: Record, band_hz: tuple[float, float], near: Poles) -> MethodModes:
        return MethodModes(*method(record, band_hz, near.frequencies_hz.tolist()))

    return modes


# What the command line calls each method, and how it is called in tables.
BAYESIAN_FFT = "bayesian-fft"
NAMES: Mapping[str, str] = {
    BAYESIAN_FFT: "Bayesian FFT",
    "next-era": "NExT-ERA",
    "ssi-cov": "SSI-cov",
    "fdd": "FDD",
    "tfie": "TFIE",
}
_OTHERS: Mapping[str, Callable[[Record, tuple[float, float], Poles], MethodModes]] = {
    "next-era": _next_era,
    "ssi-cov": _ssi_cov,
    "fdd": _of_peaks(fdd),
    "tfie": _of_peaks(tfie),
}


def modes_by(method: str, record: Record, identified: ModalEstimates) -> MethodModes:
    """The modes of a record by one method, near those that are identified."""
    if method == BAYESIAN_FFT:
        return of_estimates(identified)
    require_one_of("method", method, NAMES)
    own = record.selected(identified.sensors)
    return _OTHERS[method](own, identified.band_hz, identified.poles)


def compared(record: Record, identified: ModalEstimates) -> dict[str, MethodModes | str]:
    """The modes by every method, or why a method does not give them."""
    modes: dict[str, MethodModes | str] = {}
    for method in NAMES:
        try:
            modes[method] = modes_by(method, record, identified)
        except ValueError as error:
            modes[method] = str(error)
    return modes
