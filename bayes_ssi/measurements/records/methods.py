"""Modes of one record by each of several methods, side by side.

All but the Bayesian FFT look near modes that are given, as a user who compares them would. A method
more is a module with a function like theirs, and a line in each of the tables here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from bayes_ssi.foundations.choices import require_one_of

if TYPE_CHECKING:  # commands show the names in their help, before anything heavy is imported
    from bayes_ssi.measurements.modes.modal_data import ModalData
    from bayes_ssi.measurements.records.record import Record
    from bayes_ssi.measurements.records.resonances import Resonances

# What the command line calls each method, and how it is called in tables.
BAYESIAN_FFT = "bayesian-fft"
NAMES: Mapping[str, str] = {
    BAYESIAN_FFT: "Bayesian FFT",
    "next-era": "NExT-ERA",
    "ssi-cov": "SSI-cov",
    "fdd": "FDD",
    "tfie": "TFIE",
}


def _others() -> Mapping[str, Callable[[Record, tuple[float, float], Resonances], ModalData]]:
    from bayes_ssi.measurements.records.next_era import next_era
    from bayes_ssi.measurements.records.peak_methods import fdd, tfie
    from bayes_ssi.measurements.records.ssi_cov import ssi_cov

    return {"next-era": next_era, "ssi-cov": ssi_cov, "fdd": fdd, "tfie": tfie}


def modes_by(method: str, record: Record, identified: ModalData) -> ModalData:
    """The modes of a record by one method, near those that are identified."""
    if method == BAYESIAN_FFT:
        return identified
    require_one_of("method", method, NAMES)
    import numpy as np

    from bayes_ssi.measurements.records.resonances import Resonances

    dampings = np.array([mode.damping for mode in identified.modes])
    near = Resonances(identified.frequencies_hz, dampings, identified.unit_shapes)
    at_sensors = record.selected(identified.sensors)
    return _others()[method](at_sensors, identified.band_hz, near)


def compared(record: Record, identified: ModalData) -> dict[str, ModalData | str]:
    """The modes by every method, or why a method does not give them."""
    modes: dict[str, ModalData | str] = {}
    for method in NAMES:
        try:
            modes[method] = modes_by(method, record, identified)
        except ValueError as error:
            modes[method] = str(error)
    return modes
