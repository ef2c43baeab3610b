"""How modes were identified from a vibration record: what a report says of it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MeasuredRecord:
    """A vibration record, without its samples."""

    source: str  # its files; empty where it was made in Python
    sensors: tuple[str, ...]
    duration_s: float
    rate_hz: float  # samples per second
    quantity: str  # ``"acceleration"``, ``"velocity"`` or ``"displacement"``
    unit: str


@dataclass(frozen=True)
class EstimatedMode:
    """One mode with the standard deviations that are claimed; None where nothing is claimed."""

    frequency_hz: float
    frequency_cov: float
    damping: float | None  # fraction of critical damping
    damping_sd: float | None
    shape_sd: float | None  # standard deviation of a component across the unit shape


@dataclass(frozen=True)
class EstimatedPeak:
    """A peak of the spectra, and how many modes it holds."""

    modes: tuple[int, ...]  # places of its modes among those identified, from 0
    # That it holds two modes rather than one; None where the spectra around it do not support a
    # comparison.
    probability_of_two: float | None
    resolution_hz: float
    # That it is one mode whose sensors have phases, rather than one or two with real shapes; None
    # where that was not asked.
    probability_of_phases: float | None = None


@dataclass(frozen=True)
class IdentificationSummary:
    """An identification of modes from one record."""

    record: MeasuredRecord
    band_hz: tuple[float, float]
    method: str
    loads: str
    is_explained: bool
    # Chi-square of the whitened spectra over its degrees of freedom, where it is largest.
    whiteness: float
    allowed_whiteness: float
    cycles_of_decay: float
    modes: tuple[EstimatedMode, ...]
    peaks: tuple[EstimatedPeak, ...]
    remarks: tuple[str, ...]
    failed_checks: tuple[str, ...]
    figures: tuple[str, ...] = ()
    # Frequency (Hz) of each mode that the record shows, but that is not among those identified, and
    # why.
    not_identified: tuple[tuple[float, str], ...] = ()

    @property
    def all_failed_checks(self) -> tuple[str, ...]:
        """Failed checks, and what the modes that are not identified do to rankings."""
        return (
            *self.failed_checks,
            *(
                f"the record shows a mode at {hz:.4g} Hz that is not identified ({reason}): a "
                "model class that has it counts as missing it, and its probability is too low"
                for hz, reason in self.not_identified
            ),
        )
