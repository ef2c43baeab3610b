"""What an identification of modes from a record gives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.measurements.modes.identification_summary import (
    EstimatedMode,
    EstimatedPeak,
    IdentificationSummary,
    MeasuredRecord,
)
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.explained_band import Explained
from bayes_ssi.measurements.records.identification_settings import IDENTIFICATION
from bayes_ssi.measurements.records.modal_estimates import ModalEstimates
from bayes_ssi.measurements.records.mode_candidates import Candidates


class Peak(NamedTuple):
    """A peak of the spectra, and how many modes it holds."""

    frequencies_hz: tuple[float, ...]
    modes: tuple[int, ...]  # their places among those quoted, from 0
    # That it holds two modes rather than one, with real shapes or with phases, each explanation
    # equally probable before; None where the spectra around it are explained by none.
    probability_of_two: float | None
    probability_of_phases: float | None
    resolution_hz: float
    resolution: float

    def __str__(self) -> str:
        at = " and ".join(f"{f:.4g}" for f in self.frequencies_hz)
        p, phases = self.probability_of_two, self.probability_of_phases
        if p is None or phases is None:
            return f"peak at {at} Hz: the spectra around it are not explained"
        text = f"peak at {at} Hz: two modes with a probability {_chance(p)}"
        if phases > 0.5:
            text += f", one mode whose sensors have phases with {_chance(phases)}"
        if p > IDENTIFICATION.sure_probability:
            return text
        closer = f"{self.resolution_hz:.2g} Hz ({self.resolution:.2g} bandwidths)"
        if p < 1.0 - IDENTIFICATION.sure_probability:
            return f"{text}; modes closer than about {closer} could not be told apart"
        return f"{text}: the record cannot tell"


def _chance(p: float) -> str:
    return "above 0.999" if p > 0.999 else "below 0.001" if p < 0.001 else f"{p:.3f}"


class SingularValues(NamedTuple):
    """Of the spectral matrices of all channels, in unit² / Hz of accelerations.

    Where the ground's motion is measured, they are over its power.
    """

    frequencies_hz: FloatArray  # (K,)
    values: FloatArray  # (K, n), descending


@dataclass(frozen=True, eq=False, repr=False)
class ModalIdentification(Displayed):
    """The modes identified from a record.

    Attributes:
        record: the record without its samples.
        quoted: the modes to use.
        bands: the parts of the spectrum that were explained, also beyond the band of the search.
        candidates: from which the explanation began.
        spectrum: of the band, for figures.
        peaks: of the spectra, with the probability that each holds two modes.
        not_identified: frequency (Hz) of each mode that the record shows clearly, but that is not
            among those quoted, and why.
        too_short: places of the quoted modes that the record is too short for: nothing is claimed
            of their damping and shape.
        remarks: what to know of the result, a sentence each.
        doubts: why the claimed errors may be wrong, a sentence each.
        ground: the sensor whose motion drives all, and over which the spectra are; "" if none.
    """

    record: MeasuredRecord
    quoted: ModalEstimates
    bands: tuple[Explained, ...]
    candidates: Candidates
    spectrum: SingularValues
    peaks: tuple[Peak, ...]
    not_identified: tuple[tuple[float, str], ...]
    too_short: tuple[int, ...]
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    ground: str = ""

    @property
    def failed_checks(self) -> tuple[str, ...]:
        """Doubts, and modes that are not identified; empty if all is well."""
        return (
            *self.doubts,
            *(f"the peak at {hz:.4g} Hz is not identified: {why}"
              for hz, why in self.not_identified),
        )  # fmt: skip

    @property
    def worst(self) -> Explained:
        """The band of the search whose spectra are explained worst."""
        inside = [band for band in self.bands if band.is_wanted]
        return max(inside, key=lambda band: band.excess)

    @property
    def loads(self) -> str:
        """What drives the modes, by the evidence, or the ground whose motion is measured."""
        if self.ground:
            return f"the motion of sensor {self.ground!r}"
        return "one process" if self.worst.fit.one_source else "independent loads"

    def modal_data(self, source: str = "") -> ModalData:
        """The quoted modes as data of model classes, with a record of their identification.

        Modes that the record is too short for have their frequency alone.

        Args:
            source: where they come from.
        """
        data = self.quoted.modal_data(source)
        if self.too_short:
            modes = tuple(
                IdentifiedMode(mode.label, mode.frequency_hz, frequency_cov=mode.frequency_cov)
                if i in self.too_short
                else mode
                for i, mode in enumerate(data.modes)
            )
            data = replace(data, modes=modes)
        return replace(data, identifications=(self._summary(data.modes),))

    def _summary(self, modes: tuple[IdentifiedMode, ...]) -> IdentificationSummary:
        quoted, worst = self.quoted, self.worst.fit
        return IdentificationSummary(
            record=self.record,
            band_hz=quoted.band_hz,
            method=quoted.method,
            loads=self.loads,
            is_explained=worst.whiteness <= worst.allowed_whiteness,
            whiteness=worst.whiteness,
            allowed_whiteness=worst.allowed_whiteness,
            cycles_of_decay=float((quoted.dampings * quoted.frequencies_hz).min())
            * self.record.duration_s,
            modes=tuple(
                EstimatedMode(
                    mode.frequency_hz, float(cov), mode.damping, mode.damping_sd, mode.shape_sd
                )
                for mode, cov in zip(modes, quoted.frequency_covs, strict=True)
            ),
            peaks=tuple(
                EstimatedPeak(
                    peak.modes, peak.probability_of_two, peak.resolution_hz,
                    peak.probability_of_phases,
                )
                for peak in self.peaks
            ),
            remarks=self.remarks,
            failed_checks=self.doubts,
            not_identified=self.not_identified,
        )  # fmt: skip

    def _line(self) -> str:
        failed = counted(len(self.failed_checks), "failed check")
        return f"{counted(self.quoted.n_modes, 'mode')} driven by {self.loads}, {failed}"

    def _rows(self) -> Iterable[dict[str, Any]]:
        return self.modal_data()._rows()
