"""How modes were identified from a vibration record: what a report says of it."""

from dataclasses import dataclass

# What the command line calls each method, and how it is called in tables.
BAYESIAN_FFT = "bayesian-fft"
METHOD_NAMES = {BAYESIAN_FFT: "Bayesian FFT", "next-era": "NExT-ERA", "fdd": "FDD", "tfie": "TFIE"}
SURE_PROBABILITY = 0.95  # that leaves no doubt, in words


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
    # Of the shape with phases: its modal phase collinearity, 1 for a real mode, and the mean angle
    # of its components, by their sizes, to the line of the real shape.
    mpc: float | None = None
    mean_phase_deg: float | None = None


@dataclass(frozen=True)
class Peak:
    """A peak of the spectra, and how many modes it holds.

    Probabilities are those of two modes rather than one, and of one mode whose sensors have phases,
    rather than one or two with real shapes; None where the spectra around it do not support a
    comparison. That of two modes is None, too, where none are fitted that differ from one.
    """

    frequencies_hz: tuple[float, ...]
    modes: tuple[int, ...]  # their places among those identified, from 0
    probability_of_two: float | None
    probability_of_phases: float | None
    resolution_hz: float
    resolution: float  # in half-power bandwidths

    @property
    def is_open(self) -> bool:
        """Whether the record cannot tell one mode from two."""
        p = self.probability_of_two
        return p is not None and 1.0 - SURE_PROBABILITY <= p <= SURE_PROBABILITY

    def __str__(self) -> str:
        at = " and ".join(f"{f:.4g}" for f in self.frequencies_hz)
        p, phases = self.probability_of_two, self.probability_of_phases
        if phases is None:
            return f"peak at {at} Hz: the spectra around it are not explained"
        what = (
            "no two modes are fitted" if p is None else f"two modes with a probability {_chance(p)}"
        )
        text = f"peak at {at} Hz: {what}"
        if phases > 0.5:
            text += f", one mode whose sensors have phases with {_chance(phases)}"
        if self.is_open:
            return f"{text}: the record cannot tell"
        if p is not None and p > SURE_PROBABILITY:
            return text
        closer = f"{self.resolution_hz:.2g} Hz ({self.resolution:.2g} bandwidths)"
        return f"{text}; modes of one shape closer than about {closer} could not be told apart"


def _chance(p: float) -> str:
    return "above 0.999" if p > 0.999 else "below 0.001" if p < 0.001 else f"{p:.3f}"


@dataclass(frozen=True, kw_only=True)
class IdentificationSummary:
    """An identification of modes from one record.

    Attributes:
        record: the record without its samples.
        band_hz: lowest and highest frequency of the search.
        method: how the modes were identified.
        loads: what drives the modes, by the evidence, or the ground whose motion is measured.
        whiteness: chi-square of the whitened spectra over its degrees of freedom, in the band of
            the spectrum where it exceeds most what is allowed.
        allowed_whiteness: and what is allowed there.
        cycles_of_decay: ζ f T, least of all modes, T the duration.
        modes: that were identified.
        peaks: of the spectra, with the probability that each holds two modes.
        not_identified: frequency (Hz) of each mode that the record shows clearly, but that is not
            among those identified, and why.
        remarks: what to know of the result, a sentence each.
        doubts: why the claimed errors may be wrong, a sentence each.
        left_out: sensors that did not measure their motion, and why; shapes have none there.
        figures: paths of pictures of the identification.
    """

    record: MeasuredRecord
    band_hz: tuple[float, float]
    method: str
    loads: str
    whiteness: float
    allowed_whiteness: float
    cycles_of_decay: float
    modes: tuple[EstimatedMode, ...]
    peaks: tuple[Peak, ...]
    not_identified: tuple[tuple[float, str], ...]
    remarks: tuple[str, ...]
    doubts: tuple[str, ...]
    left_out: tuple[tuple[str, str], ...] = ()
    figures: tuple[str, ...] = ()

    @property
    def is_explained(self) -> bool:
        """Whether the modes explain the spectra."""
        return self.whiteness <= self.allowed_whiteness

    @property
    def said_of_sensors(self) -> tuple[str, ...]:
        """Which sensors are left out of the shapes, a sentence each."""
        return tuple(f"sensor {name!r} is left out of shapes: {why}" for name, why in self.left_out)

    @property
    def failed_checks(self) -> tuple[str, ...]:
        """Doubts, and what modes that are not identified do to rankings; empty if all is well."""
        return (
            *self.doubts,
            *(
                f"the record shows a mode at {hz:.4g} Hz that is not identified ({reason}): a "
                "model class that has it counts as missing it, and its probability is too low"
                for hz, reason in self.not_identified
            ),
        )
