"""From a vibration record to identified modes whose claimed errors are checked."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.foundations.displayed import InWords, columns, counted
from bayes_ssi.measurements.modes.identification_summary import (
    BAYESIAN_FFT,
    METHOD_NAMES,
    EstimatedMode,
    IdentificationSummary,
    MeasuredRecord,
    Peak,
)
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.band_search import explain
from bayes_ssi.measurements.records.explained_band import (
    Explained,
    complex_shapes,
    resolution,
)
from bayes_ssi.measurements.records.halves import growth_by_halves, skewed_clocks, with_halves
from bayes_ssi.measurements.records.late_clocks import Delay, delays_of
from bayes_ssi.measurements.records.mode_candidates import Candidates, Prominence, candidates
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.record_checks import (
    Stationary,
    faults_of,
    filled_samples,
    machine_lines,
    mask_around,
    stationary_part,
    without_lines,
)
from bayes_ssi.measurements.records.spectra import (
    DAMPING,
    Resonances,
    Spectra,
    Transforms,
    transforms_of,
)

SEARCH_FACTOR = 1.6  # by which the search goes beyond its band, for the modes next to it
FEWEST_LINES = 20  # (1 / duration) below which nothing is looked for
# ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of
# a resonance is that of its few lines.
SHORTEST_DECAYS = 1.0
BRIDGED_PERIODS = 0.25  # of the highest frequency, which a straight line replaces
MOST_BRIDGED = 0.01  # of the instants
LEAST_USED = 0.3  # of a record with gaps
MOST_VARIATION = 8.0  # power of a window over the median; beyond, loads are not steady
FEWEST_DAMPINGS = 3  # with which one is compared
LEAST_DAMPING_OVER_USUAL = 0.2  # the median of the others'
SHOWN_WIDTH = 0.01  # of the blocks of the spectrum that is shown
GROUND_COHERENCE = 0.5  # median; above it, sensors follow the ground
GROUND_WIDTH = 0.05  # of the blocks in which coherence with the ground is judged
MOST_SHAPE_SD = 0.5  # of a quoted unit shape, which leaves a MAC of 0.8 to be expected
MOST_DELAY_SEARCHES = 3  # delays are sought again where shapes still have phases


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ModalIdentification(InWords, IdentificationSummary):
    """The modes identified from a record, and what they were identified in.

    Attributes:
        quoted: the modes to use, at the sensors that measured, with all that was estimated of them.
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

        Modes that the record is too short for have their frequency alone, and sensors that are left
        out have no components.

        Args:
            source: where they come from.
        """
        sensors = tuple(name for name in self.record.sensors if name != self.ground)
        measured = [sensors.index(name) for name in self.quoted.sensors]
        m, n = len(self.quoted.modes), len(sensors)
        shapes = np.full((m, n), np.nan)
        shapes[:, measured] = self.quoted.unit_shapes.T
        modes = tuple(
            IdentifiedMode(mode.label, mode.frequency_hz, frequency_cov=mode.frequency_cov)
            if i in self.too_short
            else replace(mode, shape=shapes[i])
            for i, mode in enumerate(self.quoted.modes)
        )
        of_measured = np.r_[:m, (m + n * np.arange(m)[:, None] + measured).ravel()]
        covariance = np.zeros((m * (1 + n), m * (1 + n)))
        covariance[np.ix_(of_measured, of_measured)] = self.quoted.covariance
        values = {each.name: getattr(self, each.name) for each in fields(IdentificationSummary)}
        return ModalData(
            modes, self.band_hz, sensors, source, covariance, (IdentificationSummary(**values),)
        )

    def _line(self) -> str:
        failed = counted(len(self.failed_checks), "failed check")
        return f"{counted(len(self.modes), 'mode')} driven by {self.loads}, {failed}"

    def _rows(self) -> Iterable[dict[str, Any]]:
        return self.modal_data()._rows()


FIELDS = ("frequency_hz", "frequency_cov", "damping", "damping_sd", "shape_sd")
COMPLEXITY = ("mpc", "mean_phase_deg")
UNKNOWN = dict.fromkeys(FIELDS[2:])  # of modes that a record is too short for


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
        ValueError: the record does not cover the band, ground is no sensor or leaves too few, no
            sensor measured the motion, or no mode is identified.
    """
    band, at = record.checked_band(band_hz), tuple(at)
    remarks: list[str] = []
    doubts: list[str] = []
    whole = record
    record, left_out = _as_measured(record, band, ground)
    lowest = max(band[0] / SEARCH_FACTOR, min(band[0], FEWEST_LINES / record.duration_s))
    highest = min(band[1] * SEARCH_FACTOR, max(band[1], 0.98 * record.nyquist_hz))
    reach = (0.75 * lowest, min(1.3 * highest, record.nyquist_hz))
    still = _undisturbed(record, reach, band, remarks)
    if ground is None:
        ground = _driving_sensor(still, band, remarks)
    driven_by = _place_of(record, ground)
    pieces = _pieces(still, reach[0], band[1])
    part = Stationary()  # where what drives the structure is measured, all of a record is used
    if driven_by is None:
        part = stationary_part(still.samples, still.rate_hz, reach)
    if part.varies > MOST_VARIATION:
        doubts.append(
            f"the motion is up to {part.varies:.2g} times as strong as its median: modes may "
            "depend on amplitude, and loads are not stationary, as the spectral model takes them "
            "to be"
        )

    def lines(mask: FloatArray | None, instants: slice = slice(None)) -> Transforms:
        """Of some instants, without what the mask leaves out."""
        if pieces is not None:
            mask = pieces if mask is None else pieces * mask
        part_of = replace(still, samples=still.samples[:, instants], gaps=())
        transforms = transforms_of(part_of, reach, None if mask is None else mask[instants])
        return transforms if driven_by is None else transforms.relative_to(driven_by)

    def searched(
        transforms: Transforms,
    ) -> tuple[Candidates, list[Explained], list[Delay], Transforms]:
        found = _given(transforms, band, at) if at else candidates(transforms, lowest, highest)
        return found, *_on_time(transforms, found, band, bool(at), driven_by is not None)

    mask, loud = part.mask, lines(None)
    found, bands, late, on_time = searched(loud if mask is None else lines(mask))
    if part.spans_s and not any(_inside(explained, band) for explained in bands):
        doubts.append(
            "only the strong motion shows modes: they are of the whole record, whose loads are not "
            "stationary, as the spectral model takes them to be"
        )
        mask = None
        found, bands, late, on_time = searched(loud)
    else:
        remarks += [
            f"from {start:.4g} to {end:.4g} s the motion is many times as strong as otherwise, and "
            "is left out"
            for start, end in part.spans_s
        ]
    if mask is not None and not at:
        only_loud = _not_identified(candidates(loud, lowest, highest).peaks, bands, band)
        remarks += [
            f"strong motion, which is not used, has a clear peak at {hz:.4g} Hz, where no mode is"
            for hz, _ in only_loud
        ]
    doubts += [
        f"sensor {record.sensors[each.sensor]!r} may be {abs(each.seconds):.2g} s "
        f"{'late' if each.seconds > 0.0 else 'early'} against the others (probability "
        f"{each.probability:.2f}), which is not removed, and its components of shapes then wrong"
        for each in late
        if not each.is_sure
    ]
    late = [each for each in late if each.is_sure]
    seconds = np.zeros(len(record.sensors))
    for each in late:
        seconds[each.sensor] = each.seconds
    middle = still.n_samples // 2
    halves = [lines(mask, half).turned(seconds) for half in (slice(middle), slice(middle, None))]
    bands = with_halves(bands, halves, middle / still.rate_hz)
    clear = np.array([peak.frequency_hz for peak in found.peaks if peak.is_clear])
    doubts += [
        f"sensor {record.sensors[i]!r}: its clock runs at another rate; it is later by {more:.2g} "
        "s in the second half of the record than in the first, which is not removed"
        for i, more, *_ in skewed_clocks(halves, clear)
    ]
    if late:
        said = ", ".join(
            f"{record.sensors[i]!r} by {abs(delay):.2g} ± {deviation:.1g} s "
            f"({'late' if delay > 0.0 else 'early'})"
            for i, delay, deviation, _ in sorted(late)
        )
        remarks.append(
            f"clocks differ from the others' by the phases of all modes, at sensor {said}; this is "
            "removed"
        )
    spectrum = on_time.spectra(*band, SHOWN_WIDTH)
    result = _result(record, band, found, bands, spectrum, remarks, doubts, ground, bool(at))
    measured = replace(result.record, sensors=whole.sensors, duration_s=whole.duration_s)
    return replace(result, record=measured, left_out=tuple(left_out.items()))


def _as_measured(
    record: Record, band: tuple[float, float], ground: str | None
) -> tuple[Record, dict[str, str]]:
    """The sensors that measured, with gaps where they did not; the others, and why."""
    from scipy.ndimage import binary_dilation

    _place_of(record, ground or "")
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


def _on_time(
    transforms: Transforms,
    found: Candidates,
    band: tuple[float, float],
    fixed: bool,
    is_driven: bool,
) -> tuple[list[Explained], list[Delay], Transforms]:
    """Bands, sensors that are late by the phases of all modes, and the lines without delays.

    Delays that are not sure are not removed.
    """
    late: dict[int, Delay] = {}
    suspected: list[Delay] = []
    seconds = np.zeros(len(transforms.values))
    on_time = transforms
    bands = explain(transforms, found, band, fixed, is_driven)
    for _ in range(MOST_DELAY_SEARCHES):
        of_bands = [complex_shapes(each.fit) for each in bands if each.is_wanted]
        if not of_bands:
            break
        frequencies, shapes, covariances = zip(*of_bands, strict=True)
        seen = delays_of(
            np.concatenate(shapes, axis=1),
            np.concatenate(covariances),
            np.concatenate(frequencies),
        )
        suspected = [each for each in seen if not each.is_sure]
        if len(suspected) == len(seen):
            break
        for each in (each for each in seen if each.is_sure):
            seconds[each.sensor] += each.seconds
            late[each.sensor] = each._replace(seconds=float(seconds[each.sensor]))
        on_time = transforms.turned(seconds)
        bands = explain(on_time, found.turned(seconds), band, fixed, is_driven)
    return bands, [*late.values(), *suspected], on_time


def _inside(explained: Explained, band: tuple[float, float]) -> list[int]:
    """Places of the modes that are in the search."""
    f = explained.fit.modes.frequencies_hz
    return np.flatnonzero((f >= band[0]) & (f <= band[1])).tolist()


def _without_shape(explained: Explained, inside: list[int], channels: list[int]) -> list[int]:
    """Places of modes whose unit shape has a standard deviation above :data:`MOST_SHAPE_SD`.

    Loads or noise that are not white are fitted so, rather than a mode: it moves nowhere surely.
    """
    m, n = len(inside), len(channels)
    variances = explained.estimates(inside, channels)[1].diagonal()[2 * m :].reshape(m, n)
    return [
        i
        for i, total in zip(inside, variances.sum(axis=1), strict=True)
        if total > MOST_SHAPE_SD**2
    ]


def _driving_sensor(record: Record, band: tuple[float, float], remarks: list[str]) -> str:
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


def _place_of(record: Record, ground: str) -> int | None:
    """Of the sensor that measures the motion of the base; None if there is none."""
    if not ground:
        return None
    others = [name for name in record.sensors if name != ground]
    if len(others) == len(record.sensors):
        raise ValueError(
            f"ground: no sensor {ground!r}; the record's sensors are {', '.join(record.sensors)}"
        )
    if not others:
        raise ValueError(f"ground: {ground!r} is the record's only sensor")
    return record.sensors.index(ground)


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


def _undisturbed(
    record: Record, reach: tuple[float, float], band: tuple[float, float], remarks: list[str]
) -> Record:
    """The record without lines of machines."""
    lines = machine_lines(record.samples, record.rate_hz)
    lines = lines[(lines > reach[0]) & (lines < reach[1])]
    if not len(lines):
        return record
    samples = without_lines(record.samples, record.rate_hz, lines, record.is_measured)
    samples.setflags(write=False)
    for f in np.sort(lines[(lines >= band[0]) & (lines <= band[1])]):
        remarks.append(
            f"a line at {f:.4g} Hz, as of a machine, is taken out; a mode so narrow would have "
            "decayed less than once over the record"
        )
    return replace(record, samples=samples)


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
    ground: str = "",
    is_given: bool = False,
) -> ModalIdentification:
    channels = [i for i, name in enumerate(record.sensors) if name != ground]
    kept = []
    for explained in bands:
        inside = _inside(explained, band)
        vague = [] if is_given else _without_shape(explained, inside, channels)
        remarks += [
            f"what is fitted at {explained.modes.frequencies_hz[i]:.4g} Hz with a damping of "
            f"{100.0 * explained.modes.dampings[i]:.2g} % is not quoted as a mode: the record does "
            "not tell its shape"
            for i in vague
        ]
        if inside := [i for i in inside if i not in vague]:
            kept.append((explained, inside))
    not_identified = _not_identified(found.peaks, bands, band)
    if not kept:
        raise ValueError(
            f"no mode is identified from {band[0]:g} to {band[1]:g} Hz"
            + "".join(f"; the peak at {hz:.4g} Hz: {why}" for hz, why in not_identified)
            + "; give frequencies as at, or another band"
        )
    quoted, peaks, grown = _quoted(record, band, kept, ground)
    by_band = [explained.complexity(inside, channels) for explained, inside in kept]
    complexity = np.concatenate(by_band, axis=1).T.tolist()
    dampings = np.array([mode.damping for mode in quoted.modes])
    decays = dampings * quoted.frequencies_hz * record.duration_s
    too_short = np.flatnonzero(decays < SHORTEST_DECAYS).tolist()
    worst = max((each for each in bands if each.is_wanted), key=lambda each: each.excess).fit
    loads = "one process" if worst.one_source else "independent loads"
    return ModalIdentification(
        record=MeasuredRecord(
            record.source, record.sensors, record.duration_s, record.rate_hz, record.quantity,
            record.unit,
        ),
        band_hz=band,
        method=METHOD_NAMES[BAYESIAN_FFT],
        loads=f"the motion of sensor {ground!r}" if ground else loads,
        whiteness=worst.whiteness,
        allowed_whiteness=worst.allowed_whiteness,
        cycles_of_decay=float(decays.min()),
        modes=tuple(
            EstimatedMode(
                **columns(mode, FIELDS)
                | (UNKNOWN if i in too_short else dict(zip(COMPLEXITY, each, strict=True)))
            )
            for i, (mode, each) in enumerate(zip(quoted.modes, complexity, strict=True))
        ),
        peaks=peaks,
        not_identified=not_identified,
        remarks=(
            *remarks,
            *grown,
            *(
                f"mode at {quoted.frequencies_hz[i]:.4g} Hz: no wider than a line of the record "
                f"(ζ f T = {decays[i]:.2g}); nothing is claimed of its damping and shape, for "
                "which the record is too short, or it is a machine's harmonic"
                for i in too_short
            ),
        ),
        doubts=(
            *doubts,
            *(doubt for explained, _ in kept if (doubt := explained.doubt)),
            *(f"{peak}" for peak in peaks if peak.is_open),
            *_too_little_damping(quoted),
        ),
        quoted=quoted,
        bands=tuple(bands),
        candidates=found,
        spectrum=spectrum,
        too_short=tuple(too_short),
        ground=ground,
    )  # fmt: skip


def _too_little_damping(quoted: ModalData) -> Iterable[str]:
    """A sentence for each mode that may be a machine's line which wanders."""
    if len(quoted.modes) < FEWEST_DAMPINGS:
        return
    dampings, sds = (
        np.array([getattr(mode, name) for mode in quoted.modes])
        for name in ("damping", "damping_sd")
    )
    for i, mode in enumerate(quoted.modes):
        usual = float(np.median(np.delete(dampings, i)))
        if dampings[i] + 2.0 * sds[i] < LEAST_DAMPING_OVER_USUAL * usual:
            yield (
                f"mode at {mode.frequency_hz:.4g} Hz: its damping, {100.0 * dampings[i]:.2g} %, is "
                f"far below the usual {100.0 * usual:.2g} %: is it a wandering line of a machine?"
            )


def _not_identified(
    peaks: Sequence[Prominence], bands: list[Explained], band: tuple[float, float]
) -> tuple[tuple[float, str], ...]:
    """Clear peaks of the band that have no mode, and why."""
    modes = [explained.fit.modes for explained in bands]
    f = np.concatenate([np.empty(0), *(of_band.frequencies_hz for of_band in modes)])
    half = np.concatenate([np.empty(0), *(of_band.half_widths_hz for of_band in modes)])
    missing = []
    for peak in peaks:
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
    record: Record,
    band: tuple[float, float],
    kept: list[tuple[Explained, list[int]]],
    ground: str,
) -> tuple[ModalData, tuple[Peak, ...], list[str]]:
    """The modes of all bands, without the ground, with their joint covariance, and their peaks.

    And a sentence for each error that grows because the halves of the record disagree.
    """
    channels = [i for i, name in enumerate(record.sensors) if name != ground]
    n, m = len(channels), sum(len(inside) for _, inside in kept)
    covariance = np.zeros((m * (2 + n), m * (2 + n)))
    parts: list[Resonances] = []
    peaks, grown = [], []
    first = 0
    for explained, inside in kept:
        modes, of_band = explained.estimates(inside, channels)
        parts.append(modes)
        end = first + modes.n_modes
        rows = np.r_[first:end, m + first : m + end, 2 * m + n * first : 2 * m + n * end]
        growth = growth_by_halves(explained, inside, channels, of_band)
        factors = np.concatenate([growth[:2].ravel(), np.repeat(growth[2], n)])
        covariance[np.ix_(rows, rows)] = factors[:, None] * of_band * factors
        grown += [
            f"mode at {f:.4g} Hz: the halves of the record differ in {what} by more than their "
            f"errors; its error is {factor:.2g} times as large as otherwise"
            for what, row in zip(("frequency", "damping", "shape"), growth, strict=True)
            for f, factor in zip(modes.frequencies_hz, row, strict=True)
            if factor > 1.0
        ]
        for peak in explained.peaks:
            members = [inside.index(i) for i in peak.modes if i in inside]
            if not members:
                continue
            resolved = resolution(explained.fit, peak.modes[0])
            width = 2.0 * float(explained.fit.modes.half_widths_hz[peak.modes[0]])
            phases, two = peak.probabilities if explained.doubt is None else (None, None)
            if {*peak.modes}.intersection(_inside(explained, band)) - {*inside}:
                two = None  # one of them is no mode
            frequencies = tuple(float(modes.frequencies_hz[i]) for i in members)
            places = tuple(first + i for i in members)
            peaks.append(Peak(frequencies, places, two, phases, resolved * width, resolved))
        first = end
    frequencies_hz, dampings, shapes = joined(parts, axis=-1)
    of_data = np.r_[:m, 2 * m : len(covariance)]  # not the dampings
    data = ModalData.from_arrays(
        frequencies_hz,
        shapes,
        band,
        tuple(record.sensors[i] for i in channels),
        covariance=covariance[np.ix_(of_data, of_data)],
        damping=dampings,
        damping_sd=dampings * np.sqrt(covariance.diagonal()[m : 2 * m]),
    )
    return data, tuple(peaks), grown
