"""Which modes of several tests are the same, and their shapes joined at shared sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import mac_of_pairs

# Two estimates of a mode at the edge of a band, on either side of it, are hardly farther from it.
EDGE_SDS = 3.0
# Name of a test → its mode.
Group = dict[str, IdentifiedMode]


def matched_modes(tests: Mapping[str, ModalData], sensors: Sequence[str]) -> list[Group]:
    """Groups of modes that are the same, in ascending order of frequency.

    A mode of one more test belongs to a group where each is the nearest to the other, by the square
    of the difference of ln f and by 1 - MAC at the sensors that both have. Modes that lie outside
    of the band of the other's test, by more than their errors allow, are different.
    """
    groups: list[Group] = []
    for test, data in tests.items():
        shapes = {mode.label: scattered(mode, data, sensors) for mode in data.modes}
        distances = np.array(
            [
                [_distance(test, one, shapes[one.label], g, tests, sensors) for one in data.modes]
                for g in groups
            ]
        ).reshape(len(groups), len(data.modes))
        for j, mode in enumerate(data.modes):
            nearest = int(distances[:, j].argmin()) if groups and len(distances) else -1
            mutual = nearest >= 0 and int(distances[nearest].argmin()) == j
            if mutual and np.isfinite(distances[nearest, j]):
                groups[nearest][test] = mode
            else:
                groups.append({test: mode})
    return sorted(groups, key=mean_log_frequency)


def mean_log_frequency(group: Group) -> float:
    """The mean of ln f over the tests."""
    return float(np.mean([np.log(mode.frequency_hz) for mode in group.values()]))


def scattered(mode: IdentifiedMode, data: ModalData, sensors: Sequence[str]) -> FloatArray:
    """The unit shape (N,) at all sensors; NaN where not measured."""
    shape = np.full(len(sensors), np.nan)
    if mode.scored_shape is not None:
        shape[[sensors.index(sensor) for sensor in data.sensors]] = mode.scored_shape
    return shape


def joined_shape(
    group: Group, tests: Mapping[str, ModalData], sensors: Sequence[str]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """A first estimate of the shape (N,) at unit length, and which components were measured."""
    left = {name: scattered(mode, tests[name], sensors) for name, mode in group.items()}
    left = {name: shape for name, shape in left.items() if np.isfinite(shape).any()}
    if not left:
        return np.zeros(len(sensors)), np.zeros(len(sensors), dtype=bool)
    joined = left.pop(max(left, key=lambda name: int(np.isfinite(left[name]).sum())))
    while left:
        shared = {
            name: int((np.isfinite(joined) & np.isfinite(shape)).sum())
            for name, shape in left.items()
        }
        name = max(shared, key=lambda each: shared[each])
        if shared[name] == 0:
            raise ValueError(
                f"merging: {name} shares no sensor with the other tests in the mode at "
                f"{group[name].frequency_hz:.4g} Hz; setups are joined by reference sensors"
            )
        shape = left.pop(name)
        common = np.isfinite(joined) & np.isfinite(shape)
        product, length = joined[common] @ shape[common], shape[common] @ shape[common]
        scale = product / length if product and length else 1.0
        joined = np.where(np.isfinite(joined), joined, scale * shape)
    measured = np.isfinite(joined)
    joined = np.nan_to_num(joined)
    return joined / np.linalg.norm(joined), measured


def _may_be_in(mode: IdentifiedMode, test: ModalData) -> bool:
    """Whether a mode lies in a test's band, or so close to it that an estimate from there may."""
    error = EDGE_SDS * (mode.frequency_cov or 0.0)
    low, high = test.band_hz
    return low * (1.0 - error) <= mode.frequency_hz <= high * (1.0 + error)


def _distance(
    test: str,
    mode: IdentifiedMode,
    shape: FloatArray,
    group: Group,
    tests: Mapping[str, ModalData],
    sensors: Sequence[str],
) -> float:
    for name, member in group.items():
        if not (_may_be_in(mode, tests[name]) and _may_be_in(member, tests[test])):
            return np.inf
    apart = (np.log(mode.frequency_hz) - mean_log_frequency(group)) ** 2
    others = np.array([scattered(own, tests[name], sensors) for name, own in group.items()])
    alike = mac_of_pairs(np.broadcast_to(shape, others.shape), others)
    return float(apart + (1.0 - np.nanmean(alike) if np.isfinite(alike).any() else 0.0))
