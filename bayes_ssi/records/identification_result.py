"""What an identification of modes from a record gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.data.identification_record import (
    EstimatedMode,
    EstimatedPeak,
    IdentificationRecord,
    MeasuredRecord,
)
from bayes_ssi.data.identified_mode import IdentifiedMode
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.records.bayesian_fft import BandFit
from bayes_ssi.records.modal_estimates import ModalEstimates
from bayes_ssi.records.peaks import Peak
from bayes_ssi.records.record import Record


class Rejected(NamedTuple):
    """A candidate that is no mode of the result.

    Attributes:
        frequency_hz: where it was.
        reason: why it was not accepted.
    """

    frequency_hz: float
    reason: str


@dataclass(frozen=True, eq=False)
class ModalIdentification:
    """The modes identified from a record by two methods, and which of them are quoted.

    Attributes:
        record: the record without its samples.
        quoted: the modes to use: those of the Bayesian FFT where its spectral model explains the
            record, otherwise those of NExT-ERA.
        bayesian: modes by Bayesian FFT.
        era: modes by NExT-ERA with jackknife errors; None where it could not identify them.
        fit: the Bayesian FFT's spectral model, its evidence and whiteness.
        peaks: of the spectra, with the probability that each holds two modes.
        rejected: candidates that were not accepted.
        too_short: places of the quoted modes that the record is too short for: nothing is claimed
            of their damping and shape.
        remarks: what to know of the result, a sentence each.
        failed_checks: why the claimed errors may be wrong, a sentence each; empty if all is well.
    """

    record: MeasuredRecord
    quoted: ModalEstimates
    bayesian: ModalEstimates
    era: ModalEstimates | None
    fit: BandFit
    peaks: tuple[Peak, ...]
    rejected: tuple[Rejected, ...]
    too_short: tuple[int, ...]
    remarks: tuple[str, ...]
    failed_checks: tuple[str, ...]

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
        return replace(data, identifications=(self._record_of(data.modes),))

    def _record_of(self, modes: tuple[IdentifiedMode, ...]) -> IdentificationRecord:
        quoted, fit = self.quoted, self.fit
        apart: list[float | None] = [None] * quoted.n_modes
        if self.era is not None:
            apart = np.maximum(*self.bayesian.distances(self.era)).tolist()
        last = np.cumsum([len(peak.frequencies_hz) for peak in self.peaks]).tolist()
        return IdentificationRecord(
            record=self.record,
            band_hz=quoted.band_hz,
            method=quoted.method,
            loads=str(fit.loads),
            is_explained=fit.is_white,
            whiteness=fit.whiteness,
            allowed_whiteness=fit.allowed_whiteness,
            cycles_of_decay=float((quoted.dampings * quoted.frequencies_hz).min())
            * self.record.duration_s,
            modes=tuple(
                EstimatedMode(
                    mode.frequency_hz, float(cov), mode.damping, mode.damping_sd, mode.shape_sd, sds
                )
                for mode, cov, sds in zip(modes, quoted.frequency_covs, apart, strict=True)
            ),
            peaks=tuple(
                EstimatedPeak(
                    tuple(range(end - len(peak.frequencies_hz), end)),
                    peak.probability_of_two,
                    peak.resolution_hz,
                )
                for peak, end in zip(self.peaks, last, strict=True)
            ),
            rejected=tuple((each.frequency_hz, each.reason) for each in self.rejected),
            remarks=self.remarks,
            failed_checks=self.failed_checks,
        )


def measured_record(record: Record) -> MeasuredRecord:
    """A record without its samples."""
    return MeasuredRecord(
        record.source, record.sensors, record.duration_s, record.rate_hz, record.quantity,
        record.unit,
    )  # fmt: skip
