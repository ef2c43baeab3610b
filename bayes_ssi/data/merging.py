"""Modes of several setups, or of several records of one setup, merged to one set.

Their frequencies and shapes are merged by weighted least squares with their covariances
(:mod:`~bayes_ssi.data.weighted_shapes`), and the scatter between tests is compared with the errors
that they claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from bayes_ssi.argument_types import checked
from bayes_ssi.data.identified_mode import IdentifiedMode
from bayes_ssi.data.matched_modes import Group, joined_shape, matched_modes, mean_log_frequency
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.data.weighted_shapes import Merged, PartOfTest, weighted_least_squares

# Tests that agree are said to disagree one time in a hundred.
LIMIT = 0.01


@dataclass(frozen=True)
class Scatter:
    """How far the tests are apart in one quantity, and how far their errors let them be.

    Attributes:
        ratio: root of chi-square over its degrees of freedom: scatter over claimed errors.
        p_value: the probability of as much scatter or more by the claimed errors alone.
    """

    ratio: float
    p_value: float


@dataclass(frozen=True)
class MergedMode:
    """One merged mode.

    Attributes:
        label: in the merged data.
        labels: name of each test that has the mode → its label there.
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
        data: the merged modes, with their joint covariance.
        modes: what was merged to each of them.
        remarks: modes that some tests lack, a sentence each.
        failed_checks: quantities in which the tests differ by more than their errors, a sentence
            each: the structure changed in between, an error is too small, or two modes are not one.
    """

    data: ModalData
    modes: tuple[MergedMode, ...]
    remarks: tuple[str, ...]
    failed_checks: tuple[str, ...]


@checked
def merge_modal_data(tests: Mapping[str, ModalData]) -> MergedModes:
    """Merge the modes of several setups that share reference sensors, or of several records.

    Sensors of one name are the same. Modes of two tests are the same where each is the nearest to
    the other, by frequency and by shape. Dampings are averaged by the weights of their errors.

    Args:
        tests: name → modes; each with the sizes of its errors, or with their joint covariance.

    Raises:
        ValueError: there are fewer than two tests, their bands differ, a mode has no errors, or a
            test shares no sensor with the others.
    """
    if len(tests) < 2:
        raise ValueError(f"merging: give two tests or more, got {len(tests)}")
    _check_bands(tests)
    sensors = tuple(dict.fromkeys(sensor for data in tests.values() for sensor in data.sensors))
    groups = matched_modes(tests, sensors)
    merged = _merged(groups, tests, sensors)
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
    data = _modal_data(merged, groups, labels, tests, sensors)
    return MergedModes(data, modes, tuple(_lacking(modes, tests)), tuple(_failed(modes, data)))


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


def _check_bands(tests: Mapping[str, ModalData]) -> None:
    (first, reference), *others = tests.items()
    for name, data in others:
        if data.band_hz != reference.band_hz:
            bands = ["{:g} to {:g} Hz".format(*each.band_hz) for each in (data, reference)]
            raise ValueError(
                f"merging: the band of {name} is {bands[0]}, that of {first} {bands[1]}; identify "
                "all in one band, so that a mode that one lacks is not outside its band"
            )


def _labels(groups: Sequence[Group]) -> list[str]:
    """The labels of the tests where all agree, otherwise 1, 2, …"""
    each = [{mode.label for mode in group.values()} for group in groups]
    labels = [min(own) for own in each]
    agree = all(len(own) == 1 for own in each) and len(set(labels)) == len(labels)
    return labels if agree else [str(i) for i in range(1, len(groups) + 1)]


def _modal_data(
    merged: Merged,
    groups: Sequence[Group],
    labels: Sequence[str],
    tests: Mapping[str, ModalData],
    sensors: tuple[str, ...],
) -> ModalData:
    modes = []
    for label, log_f, shape, group in zip(
        labels, merged.log_frequencies, merged.shapes, groups, strict=True
    ):
        _, measured = joined_shape(group, tests, sensors)
        damping, damping_sd = _damping(list(group.values()))
        modes.append(
            IdentifiedMode(
                label,
                float(np.exp(log_f)),
                np.where(measured, shape, np.nan) if measured.any() else None,
                damping=damping,
                damping_sd=damping_sd,
            )
        )
    band = next(iter(tests.values())).band_hz
    source = "merged from " + ", ".join(tests)
    identifications = tuple(each for data in tests.values() for each in data.identifications)
    return ModalData(tuple(modes), band, sensors, source, merged.covariance, identifications)


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


def _lacking(modes: Sequence[MergedMode], tests: Mapping[str, ModalData]) -> Iterator[str]:
    for mode in modes:
        if lacking := [name for name in tests if name not in mode.labels]:
            yield f"mode {mode.label!r}: not in {', '.join(lacking)}"


def _failed(modes: Sequence[MergedMode], data: ModalData) -> Iterator[str]:
    """Scatter that chance would give in one of a hundred merges of so many quantities."""
    each = [
        (mode, what, scatter)
        for mode in modes
        for what, scatter in (("frequencies", mode.frequency), ("shapes", mode.shape))
        if scatter is not None
    ]
    for mode, what, scatter in each:
        if scatter.p_value < LIMIT / len(each):
            yield (
                f"mode {mode.label!r} at {data.mode(mode.label).frequency_hz:.4g} Hz: the tests' "
                f"{what} scatter by {scatter.ratio:.1f} times their errors "
                f"(p = {scatter.p_value:.1g})"
            )
