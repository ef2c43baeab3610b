"""From a vibration record to identified modes whose claimed errors are checked."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

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
from bayes_ssi.measurements.records.explained_band import Explained, complex_shapes, resolution
from bayes_ssi.measurements.records.halves import growth_by_halves, skewed_clocks, with_halves
from bayes_ssi.measurements.records.late_clocks import SUSPECTED, Delay, OnTime, explained_on_time
from bayes_ssi.measurements.records.mode_candidates import (
    Candidates,
    Prominence,
    candidates,
    given_candidates,
)
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.record_checks import stationary_part
from bayes_ssi.measurements.records.spectra import BandHz, Resonances, Spectra, Transforms
from bayes_ssi.measurements.records.steady_amplitudes import steady_modes
from bayes_ssi.measurements.records.usable_motion import UsableMotion, usable_motion

# ζ f T, the record's length in times in which a mode decays by e^(2π): below this the width of
# a resonance is that of its few lines.
SHORTEST_DECAYS = 1.0
MOST_VARIATION = 8.0  # power of a window over the median; beyond, loads are not steady
SHOWN_WIDTH = 0.01  # of the blocks of the spectrum that is shown
FEWEST_DAMPINGS = 3  # with which one is compared
LEAST_DAMPING_OVER_USUAL = 0.2  # the median of the others', among which may be those of a damper:
LEAST_DAMPING = 0.005  # of structures, but for few
MOST_DAMPING_OVER_USUAL = 3.0
MOST_PHASE, LEAST_MOTION = 45.0, 0.1  # degrees, beyond which signs may be wrong; of the largest
MOST_SHAPE_SD = 0.5  # of a quoted unit shape, which leaves a MAC of 0.8 to be expected
ESTIMATED = ("frequency_hz", "frequency_cov", "damping", "damping_sd", "shape_sd")


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
        names = [each.name for each in fields(IdentificationSummary)]
        summary = IdentificationSummary(**columns(self, names))
        return ModalData(modes, self.band_hz, sensors, source, covariance, (summary,))

    def _line(self) -> str:
        failed = counted(len(self.failed_checks), "failed check")
        return f"{counted(len(self.modes), 'mode')} driven by {self.loads}, {failed}"

    def _rows(self) -> Iterable[dict[str, Any]]:
        return self.modal_data()._rows()


@checked
@threadpool_limits.wrap(limits=1, user_api="blas")  # of small matrices; more would only wait
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
            motion is. If None, one named ground or base that the others follow; "" for none.

    Raises:
        ValueError: the record does not cover the band, ground is no sensor or leaves too few, no
            sensor measured the motion, or no mode is identified.
    """
    band, at = record.checked_band(band_hz), tuple(at)
    motion = usable_motion(record, band, ground)
    mask, on_time, remarks, doubts = _search(motion, at)
    possible = on_time.possible
    halves = motion.halves(mask, on_time.delays_s)
    bands = with_halves(on_time.bands, halves, 0.5 * motion.record.duration_s)
    clear_hz = [peak.frequency_hz for peak in possible.peaks if peak.is_clear]
    skewed = skewed_clocks(halves, np.array(clear_hz))
    sensors, duration_s = motion.record.sensors, motion.record.duration_s
    channels = [i for i, name in enumerate(sensors) if name != motion.ground]
    kept, vague = modes_to_quote(bands, band, channels, bool(at))
    not_identified = peaks_without_mode(possible.peaks, bands, band, [hz for hz, _ in vague])
    if not kept:
        raise ValueError(
            f"no mode is identified from {band[0]:g} to {band[1]:g} Hz"
            + "".join(f"; the peak at {hz:.4g} Hz: {why}" for hz, why in not_identified)
            + "; give frequencies as at, or another band"
        )
    quoted, peaks, grown = quoted_modes(motion.record, band, kept, channels)
    complexity = np.hstack([each.complexity(inside, channels) for each, inside in kept]).T.tolist()
    dampings = np.array([mode.damping for mode in quoted.modes])
    decays = dampings * quoted.frequencies_hz * duration_s
    too_short = np.flatnonzero(decays < SHORTEST_DECAYS).tolist()
    worst = max((each for each in bands if each.is_wanted), key=lambda each: each.excess).fit
    loads = "one process" if worst.one_source else "independent loads"
    return ModalIdentification(
        record=MeasuredRecord(**columns(record, [each.name for each in fields(MeasuredRecord)])),
        band_hz=band,
        method=METHOD_NAMES[BAYESIAN_FFT],
        loads=f"the motion of sensor {motion.ground!r}" if motion.ground else loads,
        whiteness=worst.whiteness,
        allowed_whiteness=worst.allowed_whiteness,
        cycles_of_decay=float(decays.min()),
        modes=tuple(
            EstimatedMode(**columns(mode, ESTIMATED[:2]) | dict.fromkeys(ESTIMATED[2:]))
            if i in too_short
            else EstimatedMode(**columns(mode, ESTIMATED), mpc=mpc, mean_phase_deg=degrees)
            for i, (mode, (mpc, degrees)) in enumerate(zip(quoted.modes, complexity, strict=True))
        ),
        peaks=peaks,
        not_identified=not_identified,
        remarks=(
            *motion.remarks,
            *remarks,
            *_late(sensors, on_time, motion.ground),
            *(
                f"what is fitted at {hz:.4g} Hz with a damping of {100.0 * damping:.2g} % is not "
                "quoted as a mode: the record does not tell its shape"
                for hz, damping in vague
            ),
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
            *_clocks_at_fault(sensors, on_time, skewed),
            *(doubt for explained, _ in kept if (doubt := explained.doubt)),
            *(f"{peak}" for peak in peaks if peak.is_open),
            *_wandering_lines(quoted, kept, on_time.transforms),
            *broad_modes(quoted, peaks),
        ),
        quoted=quoted,
        bands=tuple(bands),
        candidates=possible,
        spectrum=on_time.transforms.spectra(*band, SHOWN_WIDTH),
        left_out=tuple(motion.left_out.items()),
        too_short=tuple(too_short),
        ground=motion.ground,
    )  # fmt: skip


def _search(
    motion: UsableMotion, at: Sequence[float]
) -> tuple[FloatArray | None, OnTime, list[str], list[str]]:
    """The mask (N,) of the part that is searched, the stationary one; its search, remarks, doubts.

    Without a mask where only strong motion shows modes.
    """
    # Where what drives the structure is measured, all of a record is used.
    samples, rate_hz = motion.record.samples, motion.record.rate_hz
    part = (None, [], 1.0) if motion.ground else stationary_part(samples, rate_hz, motion.reach_hz)
    mask, spans_s, varies = part
    search = _searched(motion, mask, at)
    remarks, doubts = list[str](), list[str]()
    if varies > MOST_VARIATION:
        doubts.append(
            f"the motion is up to {varies:.2g} times as strong as its median: modes may depend on "
            "amplitude, and loads are not stationary, as the spectral model takes them to be"
        )
    if not spans_s:
        return mask, search, remarks, doubts
    if not any(modes_inside(explained, motion.band_hz) for explained in search.bands):
        doubts.append(
            "only the strong motion shows modes: they are of the whole record, whose loads are not "
            "stationary, as the spectral model takes them to be"
        )
        return None, _searched(motion, None, at), remarks, doubts
    remarks += (
        f"from {start:.4g} to {end:.4g} s the motion is many times as strong as otherwise, and is "
        "left out"
        for start, end in spans_s
    )
    if not at:
        strong = candidates(motion.transforms(), *motion.searched_hz).peaks
        remarks += (
            f"strong motion, which is not used, has a clear peak at {hz:.4g} Hz, where no mode is"
            for hz, _ in peaks_without_mode(strong, search.bands, motion.band_hz)
        )
    return mask, search, remarks, doubts


def _searched(motion: UsableMotion, mask: FloatArray | None, at: Sequence[float]) -> OnTime:
    transforms, band = motion.transforms(mask), motion.band_hz
    possible = (
        given_candidates(transforms, band, at)
        if at
        else candidates(transforms, *motion.searched_hz)
    )
    return explained_on_time(transforms, possible, band, bool(at), bool(motion.ground))


def _late(sensors: Sequence[str], on_time: OnTime, ground: str) -> Iterable[str]:
    if on_time.removed:
        said = ", ".join(
            f"{sensors[i]!r} by {abs(delay):.2g} ± {deviation:.1g} s "
            f"({'late' if delay > 0.0 else 'early'})"
            for i, delay, deviation, _ in on_time.removed
        )
        yield (
            f"clocks differ from the others' by the phases of all modes, at sensor {said}; this is "
            "removed"
        )
    for i, *_, probability in on_time.doubtful:
        if probability <= SUSPECTED and sensors[i] != ground:
            yield f"phases at sensor {sensors[i]!r} are its own, as on a damper, or its clock's"


def _largest_phase(bands: Sequence[Explained], sensor: int) -> float:
    """In degrees from the line of the others, in modes in which it moves; half turns are none."""
    of_bands = [complex_shapes(each.fit)[1] for each in bands if each.fit.has_phases]
    if not of_bands:
        return 0.0
    shapes = np.concatenate(of_bands, axis=1)
    moves = np.abs(shapes[sensor]) > LEAST_MOTION * np.abs(shapes).max(axis=0)
    others = (np.delete(shapes, sensor, axis=0) ** 2).sum(axis=0)
    phases = 0.5 * np.abs(np.angle(shapes[sensor] ** 2 * others.conj(), deg=True))
    return float(phases[moves].max(initial=0.0))


def _clocks_at_fault(
    sensors: Sequence[str], on_time: OnTime, skewed: Sequence[Delay]
) -> Iterable[str]:
    for i, delay, _, probability in on_time.doubtful:
        if probability <= SUSPECTED:
            if (phase := _largest_phase(on_time.bands, i)) > MOST_PHASE:
                yield (
                    f"sensor {sensors[i]!r} is out of phase with the others by up to {phase:.0f} "
                    "degrees, more than by most dampers; its clock or a filter may be the reason, "
                    "and its components of shapes then wrong"
                )
            continue
        yield (
            f"sensor {sensors[i]!r} may be {abs(delay):.2g} s {'late' if delay > 0.0 else 'early'} "
            f"against the others (probability {probability:.2f}), which is not removed, and its "
            "components of shapes then wrong"
        )
    for i, more, *_ in skewed:
        yield (
            f"sensor {sensors[i]!r}: its clock runs at another rate; it is later by {more:.2g} s "
            "in the second half of the record than in the first, which is not removed"
        )


def modes_inside(explained: Explained, band: BandHz) -> list[int]:
    """Places of the modes that are in the search."""
    f = explained.fit.modes.frequencies_hz
    return np.flatnonzero((f >= band[0]) & (f <= band[1])).tolist()


def modes_to_quote(
    bands: Sequence[Explained], band: BandHz, channels: Sequence[int], are_given: bool
) -> tuple[list[tuple[Explained, list[int]]], list[tuple[float, float]]]:
    """Bands with places of their modes in the search; frequency and damping of those left out.

    Left out, if they are not given, are those whose unit shape at some channels has a standard
    deviation above :data:`MOST_SHAPE_SD`: loads or noise that are not white are fitted so, rather
    than a mode, which moves somewhere surely.
    """
    kept: list[tuple[Explained, list[int]]] = []
    left_out: list[tuple[float, float]] = []
    for explained in bands:
        inside = modes_inside(explained, band)
        m, n = len(inside), len(channels)
        variances = explained.estimates(inside, channels)[1].diagonal()[2 * m :].reshape(m, n)
        is_vague = (variances.sum(axis=1) > MOST_SHAPE_SD**2) & (not are_given)
        frequencies, dampings, _ = explained.fit.modes.at(np.compress(is_vague, inside))
        left_out += zip(frequencies.tolist(), dampings.tolist(), strict=True)
        if quoted := np.compress(~is_vague, inside).tolist():
            kept.append((explained, quoted))
    return kept, left_out


def _wandering_lines(
    quoted: ModalData, kept: list[tuple[Explained, list[int]]], transforms: Transforms
) -> Iterable[str]:
    """A sentence for each mode that may be a machine's line which wanders."""
    steady = ((steady_modes(transforms, band.modes), inside) for band, inside in kept)
    are_steady = [i in places for places, inside in steady for i in inside]
    dampings, sds = np.array([[mode.damping, mode.damping_sd] for mode in quoted.modes]).T
    for i, (mode, is_steady) in enumerate(zip(quoted.modes, are_steady, strict=True)):
        why = ["its amplitude is steadier than random loads leave a mode's"] * is_steady
        if len(dampings) >= FEWEST_DAMPINGS:
            usual = float(np.median(np.delete(dampings, i)))
            if dampings[i] + 2.0 * sds[i] < min(LEAST_DAMPING_OVER_USUAL * usual, LEAST_DAMPING):
                why.append(
                    f"its damping, {100.0 * dampings[i]:.2g} %, is far below the usual "
                    f"{100.0 * usual:.2g} %"
                )
        if why:
            yield (
                f"mode at {mode.frequency_hz:.4g} Hz: {', and '.join(why)}: is it a wandering line "
                "of a machine?"
            )


def broad_modes(quoted: ModalData, peaks: Sequence[Peak]) -> Iterable[str]:
    """A sentence for each mode alone at its peak that is so broad that it may be two."""
    dampings, sds = np.array([[mode.damping, mode.damping_sd] for mode in quoted.modes]).T
    for peak, i in ((each, *each.modes) for each in peaks if len(each.modes) == 1 < len(dampings)):
        usual = float(np.median(np.delete(dampings, i)))
        if dampings[i] - 2.0 * sds[i] > MOST_DAMPING_OVER_USUAL * usual:
            yield (
                f"mode at {peak.frequencies_hz[0]:.4g} Hz: its damping, {100.0 * dampings[i]:.2g} "
                f"%, is far above the usual {100.0 * usual:.2g} %: is it two modes, as a damper "
                f"makes? Closer than {peak.resolution_hz:.2g} Hz, they could not be told apart"
            )


def peaks_without_mode(
    peaks: Sequence[Prominence],
    bands: Sequence[Explained],
    band: BandHz,
    left_out_hz: Sequence[float] = (),
) -> tuple[tuple[float, str], ...]:
    """Clear peaks of the band that have no mode besides those left out, and why."""
    missing = []
    for peak in peaks:
        hz, width = peak.frequency_hz, peak.width_hz
        has_mode = any(
            abs(f - hz) < max(half, 0.5 * width) + width and f not in left_out_hz
            for modes in (explained.fit.modes for explained in bands)
            for f, half in zip(modes.frequencies_hz, modes.half_widths_hz, strict=True)
        )
        if peak.is_clear and band[0] <= hz <= band[1] and not has_mode:
            why = f"it stands out by {peak.prominence_db:.0f} dB, but the spectra around it are "
            missing.append((hz, f"{why}explained by no mode there"))
    return tuple(missing)


def quoted_modes(
    record: Record, band: BandHz, kept: list[tuple[Explained, list[int]]], channels: Sequence[int]
) -> tuple[ModalData, tuple[Peak, ...], list[str]]:
    """The modes of all bands in some channels, with their joint covariance, and their peaks.

    And a sentence for each error that grows because the halves of the record disagree.
    """
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
            if {*peak.modes}.intersection(modes_inside(explained, band)) - {*inside}:
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
