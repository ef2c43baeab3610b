"""What an identification of modes from a record gives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.explained_band import Explained
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.spectra import Spectra


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ModalIdentification(Displayed, IdentificationSummary):
    """The modes identified from a record, and what they were identified in.

    Attributes:
        quoted: the modes to use, with all that was estimated of them.
        bands: the parts of the spectrum that were explained, also beyond the band of the search.
        candidates: from which the explanation began.
        spectrum: of the band, for figures; over the power of the ground where that is measured.
        too_short: places of the quoted modes that the record is too short for: nothing is claimed
            of their damping and shape.
        ground: the sensor whose motion drives all, and over which the spectra are; "" if none.
    """

    quoted: ModalData
    bands: tuple[Explained, ...]
    candidates: Candidates
    spectrum: Spectra
    too_short: tuple[int, ...]
    ground: str

    def modal_data(self, source: str = "") -> ModalData:
        """The quoted modes as data of model classes, with a record of their identification.

        Modes that the record is too short for have their frequency alone.

        Args:
            source: where they come from.
        """
        modes = tuple(
            IdentifiedMode(mode.label, mode.frequency_hz, frequency_cov=mode.frequency_cov)
            if i in self.too_short
            else mode
            for i, mode in enumerate(self.quoted.modes)
        )
        values = {each.name: getattr(self, each.name) for each in fields(IdentificationSummary)}
        identifications = (IdentificationSummary(**values),)
        return replace(self.quoted, modes=modes, source=source, identifications=identifications)

    def _line(self) -> str:
        failed = counted(len(self.failed_checks), "failed check")
        return f"{counted(len(self.modes), 'mode')} driven by {self.loads}, {failed}"

    def _rows(self) -> Iterable[dict[str, Any]]:
        return self.modal_data()._rows()
