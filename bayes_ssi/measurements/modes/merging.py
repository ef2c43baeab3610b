"""Modes of several setups, or of several records of one setup, merged to one set.

Their frequencies and shapes are merged by weighted least squares with their covariances
(:mod:`~bayes_ssi.measurements.modes.weighted_shapes`), and the scatter between tests is compared
with the errors that they claim. Bands may differ, as where one record was identified band by band;
then a mode that two of them have counts once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.weighted_shapes import Merged, PartOfTest, weighted_least_squares
from bayes_ssi.structures.modal import mac_of_pairs

# Two estimates of a mode at the edge of a band, on either side of it, are hardly farther from
# it than this, in standard deviations.
EDGE_SDS = 3.0
DISAGREEMENT_P = 0.01  # tests that agree are said to disagree one time in a hundred
# About the width of a peak where the damping is 1 %, within which its frequency is read off a
# spectrum: a mode so close to one that was not identified is that mode.
PEAK_WIDTH = 0.02

# Name of a test → its mode.
Group = dict[str, IdentifiedMode]


@dataclass(frozen=True)
class Scatter:
    """How far the tests are apart in one quantity, and how far their errors let them be."""

    ratio: float  # root of chi-square over its degrees of freedom: scatter over claimed errors
    p_value: float


@dataclass(frozen=True)
class MergedMode:
    """One merged mode."""

    labels: Mapping[str, str]  # name of a test → the mode's label there
    frequency: Scatter | None  # scatter of the frequencies; None where one test has the mode
    shape: Scatter | None  # scatter of the shapes at shared sensors; None where they cannot differ


@dataclass(frozen=True, eq=False)
class MergedModes:
    """Modes of several tests as one."""

    data: ModalData
    modes: tuple[MergedMode, ...]
    # Modes that tests lack in whose band they are, and modes that two bands of one record have, a
    # sentence each.
    remarks: tuple[str, ...]
    # Quantities in which the tests differ by more than their errors, a sentence each: the structure
    # changed in between, an error is too small, or two modes are not one.
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
    return _Merging(tests).merged_modes()


class _Merging:
    """Tests that are merged, at the sensors of all."""

    def __init__(self, tests: Mapping[str, ModalData]) -> None:
        self.tests = tests
        self.band_hz = _joined_band(tests)
        self.sensors = tuple(dict.fromkeys(s for data in tests.values() for s in data.sensors))
        for name, data in tests.items():
            for mode in data.modes:
                needed = ["frequency_cov"] + ["shape_sd"] * (mode.scored_shape is not None)
                if lacking := [size for size in needed if getattr(mode, size) is None]:
                    raise ValueError(
                        f"{name}: mode {mode.label!r} has no {lacking[0]}; modes are merged by the "
                        "weight of their errors"
                    )

    def merged_modes(self) -> MergedModes:
        groups = self._matched_modes()
        independent = [self._independent(group) for group in groups]
        merged = self._merged(independent)
        modes, joined = [], []
        remarks: list[str] = []
        for label, group, kept, log_f, shape in zip(
            _labels(groups), groups, independent, merged.log_frequencies, merged.shapes, strict=True
        ):
            labels = {name: mode.label for name, mode in group.items()}
            logs = np.log([mode.frequency_hz for mode in group.values()])
            weights = np.array([mode.frequency_cov for mode in group.values()], dtype=float) ** -2.0
            squares = weights @ (logs - weights @ logs / weights.sum()) ** 2
            of_frequencies, of_shapes = _scatter(squares, len(group) - 1), None
            if any(mode.scored_shape is not None for mode in group.values()):
                by_shapes = self._merged([group], frequencies=False)
                of_shapes = _scatter(by_shapes.squares, by_shapes.degrees_of_freedom)
            modes.append(MergedMode(labels, of_frequencies, of_shapes))
            remarks += self._remarks(label, float(np.exp(log_f)), group, kept)
            _, measured = self._joined_shape(kept)
            damping, damping_sd = _damping(list(kept.values()))
            joined.append(
                IdentifiedMode(
                    label,
                    float(np.exp(log_f)),
                    np.where(measured, shape, np.nan),
                    damping=damping,
                    damping_sd=damping_sd,
                )
            )
        failed = tuple(_failed(modes, joined))
        data = ModalData(
            tuple(joined),
            self.band_hz,
            self.sensors,
            "merged from " + ", ".join(self.tests),
            merged.covariance,
            tuple(self._identifications(modes, joined)),
            (*failed, *(check for test in self.tests.values() for check in test.failed_checks)),
        )
        return MergedModes(data, tuple(modes), tuple(remarks), failed)

    def _matched_modes(self) -> list[Group]:
        """Groups of modes that are the same, in ascending order of frequency.

        A mode of one more test belongs to a group where each is the nearest to the other, by the
        square of the difference of ln f and by 1 - MAC at the sensors that both have. Modes that
        lie outside of the band of the other's test, by more than their errors allow, are different.
        """
        groups: list[Group] = []
        for test, data in self.tests.items():
            distances = np.array(
                [[self._distance(test, mode, group) for mode in data.modes] for group in groups]
            ).reshape(len(groups), len(data.modes))
            for j, mode in enumerate(data.modes):
                nearest = int(distances[:, j].argmin()) if len(distances) else -1
                mutual = nearest >= 0 and int(distances[nearest].argmin()) == j
                if mutual and np.isfinite(distances[nearest, j]):
                    groups[nearest][test] = mode
                else:
                    groups.append({test: mode})
        return sorted(groups, key=_mean_log_frequency)

    def _distance(self, test: str, mode: IdentifiedMode, group: Group) -> float:
        for name, member in group.items():
            if not (_may_be_in(mode, self.tests[name]) and _may_be_in(member, self.tests[test])):
                return np.inf
        apart = (np.log(mode.frequency_hz) - _mean_log_frequency(group)) ** 2
        others = np.array([self._shape(name, member) for name, member in group.items()])
        alike = mac_of_pairs(np.broadcast_to(self._shape(test, mode), others.shape), others)
        return float(apart + (1.0 - np.nanmean(alike) if np.isfinite(alike).any() else 0.0))

    def _shape(self, test: str, mode: IdentifiedMode) -> FloatArray:
        """The unit shape (N,) at all sensors; NaN where not measured."""
        shape = np.full(len(self.sensors), np.nan)
        if mode.scored_shape is not None:
            places = [self.sensors.index(sensor) for sensor in self.tests[test].sensors]
            shape[places] = mode.scored_shape
        return shape

    def _independent(self, group: Group) -> Group:
        """The group with one mode of each record: that from the band whose edges are farthest."""
        hz = float(np.exp(_mean_log_frequency(group)))
        bands = ((name, self.tests[name].band_hz) for name in group)
        from_edges = {name: min(hz - low, high - hz) for name, (low, high) in bands}
        kept: list[str] = []
        for name in sorted(group, key=from_edges.__getitem__, reverse=True):
            if not any(_are_of_one_record(self.tests[name], self.tests[other]) for other in kept):
                kept.append(name)
        return {name: mode for name, mode in group.items() if name in kept}

    def _joined_shape(self, group: Group) -> tuple[FloatArray, NDArray[np.bool_]]:
        """A first estimate of the shape (N,) at unit length, and which components were measured."""
        left = {name: self._shape(name, mode) for name, mode in group.items()}
        left = {name: shape for name, shape in left.items() if np.isfinite(shape).any()}
        if not left:
            return np.zeros(len(self.sensors)), np.zeros(len(self.sensors), dtype=bool)
        joined = left.pop(max(left, key=lambda name: int(np.isfinite(left[name]).sum())))
        while left:
            shared = {
                name: np.isfinite(joined) & np.isfinite(shape) for name, shape in left.items()
            }
            name = max(shared, key=lambda test: int(shared[test].sum()))
            common, shape = shared[name], left.pop(name)
            if not common.any():
                raise ValueError(
                    f"merging: {name} shares no sensor with the other tests in the mode at "
                    f"{group[name].frequency_hz:.4g} Hz; setups are joined by reference sensors"
                )
            product, length = joined[common] @ shape[common], shape[common] @ shape[common]
            scale = product / length if product and length else 1.0
            joined = np.where(np.isfinite(joined), joined, scale * shape)
        measured = np.isfinite(joined)
        joined = np.nan_to_num(joined)
        return joined / np.linalg.norm(joined), measured

    def _merged(self, groups: Sequence[Group], *, frequencies: bool = True) -> Merged:
        """Groups of modes by weighted least squares, of shapes, and of frequencies, too."""
        parts = []
        for name, data in self.tests.items():
            places = {g[name].label: i for i, g in enumerate(groups) if name in g}
            if places:
                parts.append(PartOfTest(name, data, places, self.sensors, frequencies))
        first = [self._joined_shape(group) for group in groups]
        logs = np.array([_mean_log_frequency(group) for group in groups])
        shapes, measured = (np.array(part) for part in zip(*first, strict=True))
        return weighted_least_squares(parts, logs, shapes, measured)

    def _identifications(
        self, modes: Sequence[MergedMode], joined: Sequence[IdentifiedMode]
    ) -> Iterator[IdentificationSummary]:
        """Those of all tests; what one did not identify and another did is identified."""
        for name, data in self.tests.items():
            identified_hz = [
                mode.frequency_hz
                for row, mode in zip(modes, joined, strict=True)
                if name not in row.labels
            ]
            for summary in data.identifications:
                missing = tuple(
                    (hz, reason)
                    for hz, reason in summary.not_identified
                    if not any(abs(hz / other - 1.0) < PEAK_WIDTH for other in identified_hz)
                )
                yield replace(summary, not_identified=missing)

    def _remarks(self, label: str, hz: float, group: Group, kept: Group) -> Iterator[str]:
        """Which tests lack a mode in their band, and which are left out as of the same record."""
        bands = {name: data.band_hz for name, data in self.tests.items() if name not in group}
        if lacking := [name for name, (low, high) in bands.items() if low <= hz <= high]:
            yield f"mode {label!r}: not in {', '.join(lacking)}"
        if left_out := [name for name in group if name not in kept]:
            yield (
                f"mode {label!r}: from {', '.join(kept)} alone; {', '.join(left_out)} is of the "
                "same record, in a band whose edge is nearer"
            )


def _scatter(squares: float, n: int) -> Scatter | None:
    """Of a sum of squares with n degrees of freedom; None where nothing was measured twice."""
    return Scatter(float(np.sqrt(squares / n)), float(chdtrc(n, squares))) if n else None


def _joined_band(tests: Mapping[str, ModalData]) -> tuple[float, float]:
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


def _mean_log_frequency(group: Group) -> float:
    return float(np.mean([np.log(mode.frequency_hz) for mode in group.values()]))


def _may_be_in(mode: IdentifiedMode, test: ModalData) -> bool:
    """Whether a mode lies in a test's band, or so close to it that an estimate from there may."""
    error = EDGE_SDS * (mode.frequency_cov or 0.0)
    low, high = test.band_hz
    return low * (1.0 - error) <= mode.frequency_hz <= high * (1.0 + error)


def _are_of_one_record(one: ModalData, other: ModalData) -> bool:
    """Whether two tests are of one record in two bands; in one band, names merely repeat."""
    records = [
        {
            (summary.record.source, summary.record.duration_s, summary.record.rate_hz)
            for summary in data.identifications
            if summary.record.source
        }
        for data in (one, other)
    ]
    return one.band_hz != other.band_hz and not records[0].isdisjoint(records[1])


def _labels(groups: Sequence[Group]) -> list[str]:
    """The labels of the tests where all agree, otherwise 1, 2, …"""
    of_groups = [{mode.label for mode in group.values()} for group in groups]
    labels = [min(names) for names in of_groups]
    agree = all(len(names) == 1 for names in of_groups) and len(set(labels)) == len(labels)
    return labels if agree else [str(i) for i in range(1, len(groups) + 1)]


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


def _failed(modes: Sequence[MergedMode], joined: Sequence[IdentifiedMode]) -> Iterator[str]:
    """Scatter that chance would give in one of a hundred merges of so many quantities."""
    scatters = [
        (mode, what, scatter)
        for row, mode in zip(modes, joined, strict=True)
        for what, scatter in (("frequencies", row.frequency), ("shapes", row.shape))
        if scatter is not None
    ]
    for mode, what, scatter in scatters:
        if scatter.p_value < DISAGREEMENT_P / len(scatters):
            yield (
                f"mode {mode.label!r} at {mode.frequency_hz:.4g} Hz: the tests' {what} scatter by "
                f"{scatter.ratio:.1f} times their errors (p = {scatter.p_value:.1g})"
            )
