"""The motion that modes are identified from: of the sensors and instants that measured it.

Sensors that did not measure the motion at their places are left out, lines of machines are taken
out, and long gaps and times of strong motion are masked. Where a sensor measured what drives the
structure, the motion is relative to its level.
"""

from dataclasses import dataclass, replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.record_checks import (
    faults_of,
    filled_samples,
    machine_lines,
    mask_around,
    without_lines,
)
from bayes_ssi.measurements.records.spectra import BandHz, Transforms, transforms_of

SEARCH_FACTOR = 1.6  # by which the search goes beyond its band, for the modes next to it
FEWEST_LINES = 20  # (1 / duration) below which nothing is looked for
BRIDGED_PERIODS = 0.25  # of the highest frequency, which a straight line replaces
MOST_BRIDGED = 0.01  # of the instants
LEAST_USED = 0.3  # of a record with gaps
REST = 0.25  # of the record, before one whose ground was measured
GROUND_COHERENCE = 0.5  # median; above it, sensors follow the ground
GROUND_WIDTH = 0.05  # of the blocks in which coherence with the ground is judged


@dataclass(frozen=True, eq=False)
class UsableMotion:
    """What is left of a record, and what is said of the rest."""

    record: Record  # of the sensors that measured, without lines of machines
    band_hz: BandHz
    searched_hz: BandHz  # with what is next to the band
    reach_hz: BandHz  # of the lines that the search needs
    ground: str  # the sensor that measured what drives the structure; "" if none
    pieces: FloatArray | None  # (N,), factors of the samples, 0 in gaps
    left_out: dict[str, str]  # sensors, and why
    remarks: list[str]

    def transforms(
        self, mask: FloatArray | None = None, instants: slice = slice(None)
    ) -> Transforms:
        """Lines of some instants, without what a mask (N,) leaves out."""
        if self.pieces is not None:
            mask = self.pieces if mask is None else self.pieces * mask
        part = replace(self.record, samples=self.record.samples[:, instants], gaps=())
        n_before = int(REST * part.n_samples) if self.ground and not instants.start else 0
        mask = None if mask is None else mask[instants]
        transforms = transforms_of(part, self.reach_hz, mask, n_before)
        if not self.ground:
            return transforms
        return transforms.relative_to(self.record.sensors.index(self.ground))

    def halves(self, mask: FloatArray | None, delays_s: FloatArray) -> list[Transforms]:
        """Lines of both halves of the instants, of sensors no longer late by ``delays_s`` (n,)."""
        middle = self.record.n_samples // 2
        parts = (slice(middle), slice(middle, None))
        return [self.transforms(mask, part).turned(delays_s) for part in parts]


def usable_motion(record: Record, band_hz: BandHz, ground: str | None) -> UsableMotion:
    """What modes of a band are identified from; raises what :func:`identify` does."""
    record, left_out = _as_measured(record, band_hz, ground)
    low, high = band_hz
    lowest = max(low / SEARCH_FACTOR, min(low, FEWEST_LINES / record.duration_s))
    highest = min(high * SEARCH_FACTOR, max(high, 0.98 * record.nyquist_hz))
    reach = (0.75 * lowest, min(1.3 * highest, record.nyquist_hz))
    lines = machine_lines(record.samples, record.rate_hz)
    lines = lines[(lines > reach[0]) & (lines < reach[1])]
    remarks = [
        f"a line at {f:.4g} Hz, as of a machine, is taken out; a mode so narrow would have "
        "decayed less than once over the record"
        for f in np.sort(lines[(lines >= low) & (lines <= high)])
    ]
    samples = without_lines(record.samples, record.rate_hz, lines, record.is_measured)
    samples.setflags(write=False)
    record = replace(record, samples=samples)
    if ground is None:
        ground = _driving_sensor(record, band_hz, remarks)
    _require_ground(record, ground)
    pieces = _pieces(record, reach[0], high)
    return UsableMotion(
        record, band_hz, (lowest, highest), reach, ground, pieces, left_out, remarks
    )


def _as_measured(record: Record, band: BandHz, ground: str | None) -> tuple[Record, dict[str, str]]:
    """The sensors that measured, with gaps where they did not; the others, and why."""
    from scipy.ndimage import binary_dilation

    _require_ground(record, ground or "")
    # The straight lines in gaps begin and end at samples that were measured.
    filled = filled_samples(record.samples) & ~binary_dilation(~record.is_measured)
    faults = faults_of(record.samples, record.rate_hz, record.sensors, filled, band)
    sound = [i for i, name in enumerate(record.sensors) if name not in faults]
    if not sound or ground in faults:
        of = faults if ground not in faults else {ground: faults[ground]}
        said = "; ".join(f"sensor {name!r}: {why}" for name, why in of.items())
        raise ValueError(f"record: no sensor measured what modes are identified from; {said}")
    if faults:
        record = record.selected([record.sensors[i] for i in sound])
    if (is_filled := filled[sound].any(0)).any():
        samples = np.where(is_filled | ~record.is_measured, np.nan, record.samples)
        record = replace(record, samples=samples, gaps=())
    return record, faults


def _driving_sensor(record: Record, band: BandHz, remarks: list[str]) -> str:
    """The sensor that is named as ground, if the others mostly follow it; empty if none."""
    named = [name for name in record.sensors if name.casefold() in ("ground", "base")]
    if len(named) != 1 or len(record.sensors) < 3:
        return ""
    place = record.sensors.index(named[0])
    matrices = transforms_of(record, band).spectra(*band, GROUND_WIDTH).matrices
    powers = np.einsum("kii->ki", matrices).real.clip(np.finfo(float).tiny)
    coherences = np.abs(matrices[:, place]) ** 2 / powers / powers[:, [place]]
    followed = float(np.median(np.delete(coherences, place, axis=1)))
    if followed > GROUND_COHERENCE:
        remarks.append(
            f"sensor {named[0]!r} is taken for the motion of the base, which the others follow "
            f"(coherence {followed:.2f}); give another as ground, or none"
        )
        return named[0]
    remarks.append(
        f"sensor {named[0]!r} is taken for one like the others, which do not follow it (coherence "
        f"{followed:.2f}); give it as ground if it drives the structure"
    )
    return ""


def _require_ground(record: Record, ground: str) -> None:
    others = [name for name in record.sensors if name != ground]
    if ground and len(others) == len(record.sensors):
        raise ValueError(
            f"ground: no sensor {ground!r}; the record's sensors are {', '.join(record.sensors)}"
        )
    if not others:
        raise ValueError(f"ground: {ground!r} is the record's only sensor")


def _pieces(record: Record, low_hz: float, high_hz: float) -> FloatArray | None:
    """Factors (N,) of the samples, from which the pieces between gaps are identified together.

    None where no gap is longer than a straight line of few samples replaces.
    """
    longest = BRIDGED_PERIODS * record.rate_hz / high_hz
    is_out = np.zeros(record.n_samples, dtype=bool)
    for first, end in record.gaps:
        is_out[first:end] = end - first + 1 > longest
    bridged = ~record.is_measured & ~is_out
    if bridged.mean() > MOST_BRIDGED:
        is_out |= bridged
    if not is_out.any():
        return None
    mask = mask_around(is_out, record.rate_hz, low_hz)
    if (share := float((mask**2).mean())) < LEAST_USED:
        raise ValueError(
            f"record: {len(record.gaps)} gaps leave pieces so short that {share:.0%} of the record "
            "can be used; take a span with fewer, or a band that begins higher"
        )
    return mask
