"""Modes of several setups, or of several records of one setup, merged to one set.

Their frequencies and shapes are merged by weighted least squares with their covariances
(:mod:`~bayes_ssi.measurements.modes.weighted_shapes`), and the scatter between tests is compared
with the errors that they claim. Bands may differ, as where one record was identified band by band;
then a mode that two of them have counts once.

Bands of several tests as one, in which no mode of a record counts twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.measurements.modes.identification_record import IdentificationRecord
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.matched_modes import (
    Group,
    joined_shape,
    matched_modes,
    mean_log_frequency,
)
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.weighted_shapes import Merged, PartOfTest, weighted_least_squares


def joined_band(tests: Mapping[str, ModalData]) -> tuple[float, float]:
    """From the lowest to the highest frequency (Hz) of all bands."""
    first, *others = sorted(tests, key=lambda name: tests[name].band_hz)
    low, high = tests[first].band_hz
    for name in others:
        begin, end = tests[name].band_hz
        if begin > high:
            raise ValueError(
                f"merging: no modes were sought from {high:g} to {begin:g} Hz, below the band of "
                f"{name}; merge bands that touch or overlap"
            )
        high = max(high, end)
    return low, high


def independent_modes(group: Group, tests: Mapping[str, ModalData]) -> Group:
    """The group with one mode of each record: that from the band whose edges are farthest."""
    hz = float(np.exp(mean_log_frequency(group)))

    def from_edges(name: str) -> float:
        low, high = tests[name].band_hz
        return min(hz - low, high - hz)

    kept: list[str] = []
    for name in sorted(group, key=from_edges, reverse=True):
        if not any(_are_of_one_record(tests[name], tests[other]) for other in kept):
            kept.append(name)
    return {name: mode for name, mode in group.items() if name in kept}


def _are_of_one_record(one: ModalData, other: ModalData) -> bool:
    """Whether two tests are of one record in two bands; in one band, names merely repeat."""
    records = [
        {
            (each.record.source, each.record.duration_s, each.record.rate_hz)
            for each in data.identifications
            if each.record.source
        }
        for data in (one, other)
    ]
    return one.band_hz != other.band_hz and not records[0].isdisjoint(records[1])


# Tests that agree are said to disagree one time in a hundred.
LIMIT = 0.01
# About the width of a peak where the damping is 1 %, within which its frequency is read off a
# spectrum: a mode so close to one that was not identified is that mode.
PEAK_WIDTH = 0.02


@dataclass(frozen=True)
class Scatter:
    """How far the tests are apart in one quantity, and how far their errors let them be.

    Attributes:
        ratio: root of chi-square over its degrees of freedom: scatter over claimed errors.
    """

    ratio: float
    p_value: float


@dataclass(frozen=True)
class MergedMode:
    """One merged mode.

    Attributes:
        frequency: scatter of the frequencies; None where one test has the mode.
        shape: scatter of the shapes at shared sensors; None where they cannot differ.
    """

    label: str
    labels: Mapping[str, str]
    frequency: Scatter | None
    shape: Scatter | None


@dataclass(frozen=True, eq=False)
class MergedModes:
    """Modes of several tests as one.

    Attributes:
        remarks: modes that tests lack in whose band they are, and modes that two bands of one
            record have, a sentence each.
        failed_checks: quantities in which the tests differ by more than their errors, a sentence
            each: the structure changed in between, an error is too small, or two modes are not one.
    """

    data: ModalData
    modes: tuple[MergedMode, ...]
    remarks: tuple[str, ...]
    failed_checks: tuple[str, ...]


@checked
def merge_modal_data(tests: Mapping[str, ModalData]) -> MergedModes:
    """Merge modes of setups that share reference sensors, of several records, or of several bands.

    Sensors of one name are the same. Modes of two tests are the same where each is the nearest to
    the other, by frequency and by shape, and in the band of both. Dampings are averaged by the
    weights of their errors. The bands are joined; where they overlap and are of one record (its
    name, duration and rate), errors are not independent, and a mode is taken from the band whose
    edges are farther from it.

    Args:
        tests: name → modes; each with the sizes of its errors, or with their joint covariance.

    Raises:
        ValueError: there are fewer than two tests, there is a gap between their bands, a mode has
            no errors, or a test shares no sensor with the others.
    """
    if len(tests) < 2:
        raise ValueError(f"merging: give two tests or more, got {len(tests)}")
    band_hz = joined_band(tests)
    sensors = tuple(dict.fromkeys(sensor for data in tests.values() for sensor in data.sensors))
    groups = matched_modes(tests, sensors)
    independent = [independent_modes(group, tests) for group in groups]
    merged = _merged(independent, tests, sensors)
    labels = _labels(groups)
    modes = tuple(
        MergedMode(
            label,
            {name: mode.label for name, mode in group.items()},
            _scatter(group, tests, sensors, shapes=False),
            _scatter(group, tests, sensors, frequencies=False),
        )
        for label, group in zip(labels, groups, strict=True)
    )
    joined = tuple(_identified_modes(merged, independent, labels, tests, sensors))
    failed = tuple(_failed(modes, joined))
    data = ModalData(
        joined,
        band_hz,
        sensors,
        "merged from " + ", ".join(tests),
        merged.covariance,
        tuple(_identifications(modes, joined, tests)),
        (*failed, *(check for each in tests.values() for check in each.failed_checks)),
    )
    remarks = tuple(_remarks(modes, joined, independent, tests))
    return MergedModes(data, modes, remarks, failed)


def _merged(
    groups: Sequence[Group],
    tests: Mapping[str, ModalData],
    sensors: Sequence[str],
    *,
    frequencies: bool = True,
    shapes: bool = True,
) -> Merged:
    """Some groups of modes by weighted least squares, with frequencies or shapes, or with both."""
    places = {
        name: {group[name].label: i for i, group in enumerate(groups) if name in group}
        for name in tests
    }
    parts = [
        PartOfTest.of(name, tests[name], own, sensors, frequencies=frequencies, shapes=shapes)
        for name, own in places.items()
        if own
    ]
    first = [joined_shape(group, tests, sensors) for group in groups]
    measured = np.array([each for _, each in first]) & shapes
    logs = np.array([mean_log_frequency(group) for group in groups])
    estimates = np.where(measured, [shape for shape, _ in first], 0.0)
    return weighted_least_squares(parts, logs, estimates, measured)


def _scatter(
    group: Group,
    tests: Mapping[str, ModalData],
    sensors: Sequence[str],
    *,
    frequencies: bool = True,
    shapes: bool = True,
) -> Scatter | None:
    """The scatter of a mode's frequencies or shapes; None where nothing was measured twice."""
    if not frequencies and all(mode.scored_shape is None for mode in group.values()):
        return None
    merged = _merged([group], tests, sensors, frequencies=frequencies, shapes=shapes)
    n, squares = merged.degrees_of_freedom, merged.squares
    return Scatter(float(np.sqrt(squares / n)), float(chdtrc(n, squares))) if n else None


def _labels(groups: Sequence[Group]) -> list[str]:
    """The labels of the tests where all agree, otherwise 1, 2, …"""
    each = [{mode.label for mode in group.values()} for group in groups]
    labels = [min(own) for own in each]
    agree = all(len(own) == 1 for own in each) and len(set(labels)) == len(labels)
    return labels if agree else [str(i) for i in range(1, len(groups) + 1)]


def _identified_modes(
    merged: Merged,
    groups: Sequence[Group],
    labels: Sequence[str],
    tests: Mapping[str, ModalData],
    sensors: tuple[str, ...],
) -> Iterator[IdentifiedMode]:
    for label, log_f, shape, group in zip(
        labels, merged.log_frequencies, merged.shapes, groups, strict=True
    ):
        _, measured = joined_shape(group, tests, sensors)
        damping, damping_sd = _damping(list(group.values()))
        yield IdentifiedMode(
            label,
            float(np.exp(log_f)),
            np.where(measured, shape, np.nan) if measured.any() else None,
            damping=damping,
            damping_sd=damping_sd,
        )


def _identifications(
    modes: Sequence[MergedMode], joined: Sequence[IdentifiedMode], tests: Mapping[str, ModalData]
) -> Iterator[IdentificationRecord]:
    """Those of all tests; what one did not identify and another did is identified."""
    for name, data in tests.items():
        found = [
            each.frequency_hz
            for row, each in zip(modes, joined, strict=True)
            if name not in row.labels
        ]
        for each in data.identifications:
            missing = tuple(
                (hz, reason)
                for hz, reason in each.not_identified
                if not any(abs(hz / other - 1.0) < PEAK_WIDTH for other in found)
            )
            yield replace(each, not_identified=missing)


def _damping(modes: Sequence[IdentifiedMode]) -> tuple[float | None, float | None]:
    """The mean damping and its standard deviation, weighted where every test states errors."""
    known = [mode for mode in modes if mode.damping is not None]
    if not known:
        return None, None
    dampings = np.array([mode.damping for mode in known], dtype=float)
    sds = [mode.damping_sd for mode in known if mode.damping_sd is not None]
    if len(sds) < len(known):
        return float(dampings.mean()), None
    weights = 1.0 / np.square(sds)
    return float(weights @ dampings / weights.sum()), float(1.0 / np.sqrt(weights.sum()))


def _remarks(
    modes: Sequence[MergedMode],
    joined: Sequence[IdentifiedMode],
    independent: Sequence[Group],
    tests: Mapping[str, ModalData],
) -> Iterator[str]:
    """Which tests lack a mode in their band, and which are left out as of the same record."""
    for row, mode, group in zip(modes, joined, independent, strict=True):
        lacking = [
            name
            for name, data in tests.items()
            if name not in row.labels and data.band_hz[0] <= mode.frequency_hz <= data.band_hz[1]
        ]
        if lacking:
            yield f"mode {row.label!r}: not in {', '.join(lacking)}"
        if left_out := [name for name in row.labels if name not in group]:
            yield (
                f"mode {row.label!r}: from {', '.join(group)} alone; {', '.join(left_out)} is of "
                "the same record, in a band whose edge is nearer"
            )


def _failed(modes: Sequence[MergedMode], joined: Sequence[IdentifiedMode]) -> Iterator[str]:
    """Scatter that chance would give in one of a hundred merges of so many quantities."""
    each = [
        (mode, what, scatter)
        for row, mode in zip(modes, joined, strict=True)
        for what, scatter in (("frequencies", row.frequency), ("shapes", row.shape))
        if scatter is not None
    ]
    for mode, what, scatter in each:
        if scatter.p_value < LIMIT / len(each):
            yield (
                f"mode {mode.label!r} at {mode.frequency_hz:.4g} Hz: the tests' {what} scatter by "
                f"{scatter.ratio:.1f} times their errors (p = {scatter.p_value:.1g})"
            )
