"""From a vibration record to identified modes whose claimed errors are checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.band_search import explain
from bayes_ssi.measurements.records.delays import delays
from bayes_ssi.measurements.records.explained_band import Explained, resolution
from bayes_ssi.measurements.records.identification_result import (
    ModalIdentification,
    SingularValues,
    measured_record,
)
from bayes_ssi.measurements.records.local_fit import DAMPING
from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.machine_lines import machine_lines, without_lines
from bayes_ssi.measurements.records.modal_estimates import ModalEstimates, with_positive_largest
from bayes_ssi.measurements.records.mode_candidates import Candidates, Peak, Prominence, candidates
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.spectra import Spectra, Transforms, transforms_of
from bayes_ssi.measurements.records.stationarity import EVERYTHING, stationary_part

METHOD = "Bayesian FFT"
# The search reaches beyond the band by this factor, for the modes next to it.
BEYOND = 1.6
# ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of a
# resonance is that of its few lines.
SHORTEST = 1.0
# Power of a window over the median beyond which a record is not stationary, though not cut.
MOST_VARIATION = 8.0
# Relative width of the blocks of the spectrum that is shown.
SPECTRUM_WIDTH = 0.01
# Sensors follow the ground where the median coherence, in blocks of this relative width, is above.
FOLLOWED, FOLLOWED_WIDTH = 0.5, 0.05
# Delays are sought again where shapes still have phases, so often at most.
MOST_DELAYS = 3
# Lines of the record below which nothing is looked for.
FEWEST_LINES = 20


@checked
def identify(
    record: Record, band_hz: Sequence[float], *, at: Sequence[float] = (), ground: str | None = None
) -> ModalIdentification:
    """Identify the modes of a band, with the joint uncertainty of frequencies and shapes.

    Candidates are the poles that orders of a subspace identification agree on, and the peaks of the
    first singular value. Around each peak or group of close ones the Bayesian FFT keeps those that
    the evidence asks for, and compares one mode, one whose sensors have phases, and two.

    Args:
        record: the record of one setup.
        band_hz: lowest and highest frequency of the search.
        at: frequencies of the modes, in Hz, in place of the candidates; all are then kept.
        ground: the sensor that measures the motion of the base, if that drives the structure; modes
            are then those of the amplification at the other sensors, however strong or long the
            motion is. If None, a sensor that is named ground or base, where the others mostly
            follow it; "" for none.

    Raises:
        ValueError: the record does not cover the band, ground is no sensor or leaves too few, or no
            mode is identified.
    """
    band = record.checked_band(band_hz)
    remarks: list[str] = []
    lowest = max(band[0] / BEYOND, min(band[0], FEWEST_LINES / record.duration_s))
    highest = min(band[1] * BEYOND, max(band[1], 0.98 * record.nyquist_hz))
    reach = (0.75 * lowest, min(1.3 * highest, record.nyquist_hz))
    doubts: list[str] = []
    still = _undisturbed(record, reach, band, remarks)
    if ground is None:
        ground = _driving_sensor(still, band, remarks)
    driven_by = _place_of(record, ground)
    part = stationary_part(still, reach) if driven_by is None else EVERYTHING
    if part.varies > MOST_VARIATION:
        doubts.append(
            f"the motion is up to {part.varies:.2g} times as strong as its median: modes may "
            "depend on amplitude, and loads are not stationary, as the spectral model takes them "
            "to be"
        )
    search = _Search(band, (lowest, highest), tuple(at), driven_by)
    found, bands, late, spectrum = search.of(transforms_of(still, reach, part.mask))
    if part.spans_s and not any(map(search.has_modes, bands)):
        doubts.append(
            "only the strong motion shows modes: they are of the whole record, whose loads are not "
            "stationary, as the spectral model takes them to be"
        )
        found, bands, late, spectrum = search.of(transforms_of(still, reach))
    else:
        remarks += [
            f"from {start:.4g} to {end:.4g} s the motion is many times as strong as otherwise, and "
            "is left out"
            for start, end in part.spans_s
        ]
    remarks += [
        f"sensor {name!r}: {abs(own):.2g} s {'late' if own > 0.0 else 'early'} against the "
        "others, by the phases of the modes; this is removed"
        for name, own in zip(record.sensors, late, strict=True)
        if abs(own) > 0.05 * np.abs(late).max()
    ]
    result = _result(record, band, found, bands, spectrum, remarks, doubts)
    if driven_by is None:
        return result
    return replace(result, quoted=result.quoted.without_sensor(driven_by), ground=ground)


class _Search(NamedTuple):
    """What is looked for: in which band, among candidates of a range or at given frequencies."""

    band: tuple[float, float]
    candidates_from: tuple[float, float]
    at: tuple[float, ...]
    driven_by: int | None

    def of(self, transforms: Transforms) -> tuple[Candidates, list[Explained], FloatArray, Spectra]:
        """Candidates, bands, delays of the sensors, and the spectrum, on time."""
        if self.driven_by is not None:
            transforms = transforms.relative_to(self.driven_by)
        if self.at:
            found = _given(transforms, self.band, self.at)
        else:
            found = candidates(transforms, *self.candidates_from)
        how = {"fixed": bool(self.at), "is_driven": self.driven_by is not None}
        bands = explain(transforms, found, self.band, **how)
        n_sensors = len(transforms.values)
        late = np.zeros(n_sensors)
        for _ in range(MOST_DELAYS):
            more = delays(bands, n_sensors)
            if more is None:
                break
            on_time, turned = transforms.turned(late + more), found.turned(late + more)
            again = explain(on_time, turned, self.band, **how)
            if _nats_of_phases(again) >= _nats_of_phases(bands):
                break
            bands, late = again, late + more
        return found, bands, late, transforms.spectra(*self.band, SPECTRUM_WIDTH)

    def has_modes(self, band: Explained) -> bool:
        """Whether a mode of a band is in the search."""
        f = band.fit.modes.frequencies_hz
        return bool(((f >= self.band[0]) & (f <= self.band[1])).any())


def _driving_sensor(record: Record, band: tuple[float, float], remarks: list[str]) -> str:
    """The sensor that is named as ground, if the others mostly follow it; empty if none."""
    named = [name for name in record.sensors if name.casefold() in ("ground", "base")]
    if len(named) != 1 or len(record.sensors) < 3:
        return ""
    place = record.sensors.index(named[0])
    matrices = transforms_of(record, band).spectra(*band, FOLLOWED_WIDTH).matrices
    powers = np.einsum("kii->ki", matrices).real.clip(np.finfo(float).tiny)
    coherences = np.abs(matrices[:, place]) ** 2 / powers / powers[:, [place]]
    followed = float(np.median(np.delete(coherences, place, axis=1)))
    if followed > FOLLOWED:
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


def _place_of(record: Record, ground: str) -> int | None:
    """Of the sensor that measures the motion of the base; None if there is none."""
    if not ground:
        return None
    others = [name for name in record.sensors if name != ground]
    if len(others) == len(record.sensors):
        raise ValueError(
            f"ground: no sensor {ground!r}; the record's sensors are {', '.join(record.sensors)}"
        )
    if len(others) < 2:
        raise ValueError(
            f"ground: {ground!r} leaves the sensor {others[0]!r} alone; shapes need two or more"
        )
    return record.sensors.index(ground)


def _undisturbed(
    record: Record, reach: tuple[float, float], band: tuple[float, float], remarks: list[str]
) -> Record:
    """The record without lines of machines."""
    lines = machine_lines(record.samples, record.rate_hz)
    lines = lines[(lines > reach[0]) & (lines < reach[1])]
    if not len(lines):
        return record
    samples = without_lines(record.samples, record.rate_hz, lines)
    samples.setflags(write=False)
    for f in np.sort(lines[(lines >= band[0]) & (lines <= band[1])]):
        remarks.append(
            f"a line at {f:.4g} Hz, as of a machine, is taken out; a mode so narrow would have "
            "decayed less than once over the record"
        )
    return replace(record, samples=samples)


def _nats_of_phases(bands: list[Explained]) -> float:
    """Nats by which phases explain the bands that have them."""
    wanted = [band for band in bands if band.is_wanted and band.fit.has_phases and band.peaks]
    return float(sum(max(0.0, band.peaks[0][1].phases) for band in wanted))


def _given(transforms: Transforms, band: tuple[float, float], at: Sequence[float]) -> Candidates:
    """Candidates at given frequencies, with the directions of most motion there as shapes."""
    low, high = band
    frequencies = np.sort(np.array(at, dtype=float))
    if frequencies[0] <= low or frequencies[-1] >= high:
        raise ValueError(f"at: frequencies must be within {low:g} to {high:g} Hz, got {list(at)}")
    n, n_lines = len(transforms.values), int((high - low) / transforms.line_hz)
    n_unknowns = len(frequencies) * (3 * n + 1)
    if n * n_lines < n_unknowns:
        raise ValueError(
            f"the band has {n_lines} lines of {n} sensors, fewer than the {n_unknowns} unknowns of "
            f"{len(frequencies)} modes; give fewer modes, or a wider band or a longer record"
        )
    shapes = np.empty((len(transforms.values), len(frequencies)), dtype=complex)
    for i, f in enumerate(frequencies):
        half = max(DAMPING * f, 2.0 * transforms.line_hz)
        data = transforms.spectra(f - half, f + 2.0 * half, DAMPING)
        # Frequencies given closer than a bandwidth share a peak, and take one direction each.
        sharing = int((np.abs(np.log(frequencies[:i] / f)) < 2.0 * DAMPING).sum())
        directions = np.linalg.eigh(data.matrices[0].real)[1]
        shapes[:, i] = directions[:, -1 - min(sharing, directions.shape[1] - 1)]
    peaks = tuple(Prominence(float(f), 0.0, 0.0, True) for f in frequencies)
    dampings = np.full(len(frequencies), DAMPING / 1.5)
    modes = Resonances(frequencies, dampings, shapes)
    return Candidates(peaks, modes, modes.at([]), np.empty(0), np.empty((2, 0)))


def _result(
    record: Record,
    band: tuple[float, float],
    found: Candidates,
    bands: list[Explained],
    spectrum: Spectra,
    remarks: list[str],
    doubts: list[str],
) -> ModalIdentification:
    low, high = band
    kept: list[tuple[Explained, list[int]]] = []
    for each in bands:
        f = each.fit.modes.frequencies_hz
        inside = np.flatnonzero((f >= low) & (f <= high)).tolist()
        if inside:
            kept.append((each, inside))
    not_identified = _not_identified(found, bands, band)
    if not kept:
        raise ValueError(
            f"no mode is identified from {low:g} to {high:g} Hz"
            + "".join(f"; the peak at {hz:.4g} Hz: {why}" for hz, why in not_identified)
            + "; give frequencies as at, or another band"
        )
    quoted, peaks = _quoted(record, band, kept)
    doubts = doubts + [text for each, _ in kept if (text := each.doubt)]
    lengths = quoted.dampings * quoted.frequencies_hz * record.duration_s
    too_short = tuple(np.flatnonzero(lengths < SHORTEST).tolist())
    remarks = remarks + [
        _short(float(quoted.frequencies_hz[i]), float(lengths[i])) for i in too_short
    ]
    return ModalIdentification(
        measured_record(record), quoted, tuple(bands), found,
        SingularValues(
            spectrum.frequencies_hz,
            np.asarray(np.linalg.eigvalsh(spectrum.matrices)[:, ::-1], dtype=np.float64),
        ),
        peaks, not_identified, too_short, tuple(remarks), tuple(doubts),
    )  # fmt: skip


def _not_identified(
    found: Candidates, bands: list[Explained], band: tuple[float, float]
) -> tuple[tuple[float, str], ...]:
    """Clear peaks of the band that have no mode, and why."""
    f = np.concatenate([np.empty(0), *(each.fit.modes.frequencies_hz for each in bands)])
    half = np.concatenate([np.empty(0), *(each.fit.modes.half_widths_hz for each in bands)])
    missing = []
    for peak in found.peaks:
        if not (peak.is_clear and band[0] <= peak.frequency_hz <= band[1]):
            continue
        near = np.abs(f - peak.frequency_hz) < np.maximum(half, 0.5 * peak.width_hz) + peak.width_hz
        if not near.any():
            missing.append(
                (peak.frequency_hz, f"it stands out by {peak.prominence_db:.0f} dB, but the "
                 "spectra around it are explained by no mode there")
            )  # fmt: skip
    return tuple(missing)


def _quoted(
    record: Record, band: tuple[float, float], kept: list[tuple[Explained, list[int]]]
) -> tuple[ModalEstimates, tuple[Peak, ...]]:
    """The modes of all bands with their joint covariance, and their peaks."""
    n = len(record.sensors)
    frequencies: list[float] = []
    dampings: list[float] = []
    shapes: list[FloatArray] = []
    blocks: list[FloatArray] = []
    peaks = []
    for each, inside in kept:
        own = each.estimates(inside)
        first = len(frequencies)
        frequencies += own.frequencies_hz.tolist()
        dampings += own.dampings.tolist()
        shapes += list(own.shapes.T)
        blocks.append(own.covariance)
        for places, odds in each.peaks:
            members = [inside.index(i) for i in places if i in inside]
            if not members:
                continue
            resolved = resolution(each.fit, places[0])
            width = 2.0 * float(each.fit.modes.half_widths_hz[places[0]])
            _, phases, two = odds.probabilities
            known = each.doubt is None
            peaks.append(
                Peak(
                    tuple(float(own.frequencies_hz[i]) for i in members),
                    tuple(first + i for i in members),
                    two if known else None, phases if known else None,
                    resolved * width, resolved,
                )
            )  # fmt: skip
    m = len(frequencies)
    size = m * (2 + n)
    covariance = np.zeros((size, size))
    at = 0
    for block in blocks:
        k = len(block) // (2 + n)
        own = np.r_[at : at + k, m + at : m + at + k, 2 * m + n * at : 2 * m + n * (at + k)]
        covariance[np.ix_(own, own)] = block
        at += k
    signed, signs = with_positive_largest(np.array(shapes).T)
    turns = np.r_[np.ones(2 * m), np.repeat(signs, n)]
    return (
        ModalEstimates(
            METHOD, band, record.sensors, np.array(frequencies), np.array(dampings), signed,
            covariance * turns * turns[:, None],
        ),
        tuple(peaks),
    )  # fmt: skip


def _short(frequency_hz: float, length: float) -> str:
    return (
        f"mode at {frequency_hz:.4g} Hz: no wider than a line of the record (ζ f T = "
        f"{length:.2g}); "
        "nothing is claimed of its damping and shape, for which the record is too short, or it is "
        "a machine's harmonic"
    )
