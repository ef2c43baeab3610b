"""Bands of several tests as one, in which no mode of a record counts twice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_ssi.measurements.modes.matched_modes import Group, mean_log_frequency
from bayes_ssi.measurements.modes.modal_data import ModalData


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
