"""What is quoted of explained bands: modes with their joint errors, peaks, and what is doubtful."""

from collections.abc import Iterable, Sequence

import numpy as np

from bayes_ssi.foundations.arrays import joined
from bayes_ssi.measurements.modes.identification_summary import Peak
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.explained_band import Explained, resolution
from bayes_ssi.measurements.records.halves import growth_by_halves
from bayes_ssi.measurements.records.mode_candidates import Prominence
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.spectra import Resonances

FEWEST_DAMPINGS = 3  # with which one is compared
LEAST_DAMPING_OVER_USUAL = 0.2  # the median of the others'
MOST_SHAPE_SD = 0.5  # of a quoted unit shape, which leaves a MAC of 0.8 to be expected


def modes_inside(explained: Explained, band: tuple[float, float]) -> list[int]:
    """Places of the modes that are in the search."""
    f = explained.fit.modes.frequencies_hz
    return np.flatnonzero((f >= band[0]) & (f <= band[1])).tolist()


def modes_to_quote(
    bands: Sequence[Explained],
    band: tuple[float, float],
    channels: Sequence[int],
    are_given: bool,
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
        vague = [
            i
            for i, total in zip(inside, variances.sum(axis=1), strict=True)
            if total > MOST_SHAPE_SD**2 and not are_given
        ]
        frequencies, dampings, _ = explained.fit.modes.at(vague)
        left_out += zip(frequencies.tolist(), dampings.tolist(), strict=True)
        if quoted := [i for i in inside if i not in vague]:
            kept.append((explained, quoted))
    return kept, left_out


def too_little_damping(quoted: ModalData) -> Iterable[str]:
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


def peaks_without_mode(
    peaks: Sequence[Prominence],
    bands: Sequence[Explained],
    band: tuple[float, float],
    left_out_hz: Sequence[float] = (),
) -> tuple[tuple[float, str], ...]:
    """Clear peaks of the band that have no mode besides those left out, and why."""
    modes = [explained.fit.modes for explained in bands]
    f = np.concatenate([np.empty(0), *(of_band.frequencies_hz for of_band in modes)])
    half = np.concatenate([np.empty(0), *(of_band.half_widths_hz for of_band in modes)])
    is_one = ~np.isin(f, left_out_hz)
    f, half = f[is_one], half[is_one]
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


def quoted_modes(
    record: Record,
    band: tuple[float, float],
    kept: list[tuple[Explained, list[int]]],
    channels: Sequence[int],
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
