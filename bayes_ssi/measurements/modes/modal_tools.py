"""Modes in universal files: data sets 55, data at nodes of normal or complex modes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.universal_files import read_data_sets
from bayes_ssi.measurements.modes.modal_data import ModalData

DATA_OF_AXES = {"x": "r1", "y": "r2", "z": "r3"}
# The analysis types of data sets 55 that are modes.
ANALYSIS_TYPES = {2: "normal", 3: "complex", 7: "complex, second order"}


def read_modal_uff(path: Path, band_hz: Sequence[float]) -> ModalData:
    """Read the modes of a universal file.

    Returns:
        Modes labelled 1, 2, … in ascending order of frequency. A complex mode's frequency is
        |λ|/2π and its damping -Re λ/|λ|, λ being its eigenvalue in rad/s.
    """
    sets = read_data_sets(path, 55)
    sets = [s for s in sets if s["analysis_type"] in ANALYSIS_TYPES]
    if not sets:
        raise ValueError(f"{path}: no data set 55 with a normal or complex mode")
    modes = sorted((*_frequency_and_damping(s), i) for i, s in enumerate(sets))
    frequencies, dampings, order = (np.array(column) for column in zip(*modes, strict=True))
    named = moving_sensors(sets)
    components = [[_component(sets[i], *place) for i in order] for place in named.values()]
    try:
        return ModalData.from_arrays(
            frequencies,
            np.reshape(components, (len(named), len(sets))),
            band_hz,
            tuple(named),
            path.name,
            damping=np.where((dampings > 0.0) & (dampings < 1.0), dampings, np.nan),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _frequency_and_damping(one: Mapping[str, Any]) -> tuple[float, float]:
    if ANALYSIS_TYPES[one["analysis_type"]] == "normal":
        return float(one["freq"]), float(one.get("modal_damp_vis", 0.0))
    size = abs(one["eig"])
    return float(size / (2.0 * math.pi)), float(-np.real(one["eig"]) / size) if size else 0.0


def moving_sensors(sets: Iterable[Mapping[str, Any]]) -> dict[str, tuple[int, str]]:
    """All nodes and directions in which some mode moves."""
    moving = {
        (int(node), direction)
        for one in sets
        for direction, key in DATA_OF_AXES.items()
        for node in np.asarray(one["node_nums"])[np.asarray(one[key]) != 0]
    }
    return {f"{node} {direction}": (node, direction) for node, direction in sorted(moving)}


def _component(one: Mapping[str, Any], node: int, direction: str) -> complex:
    """The component of one mode; NaN where it was not measured."""
    at = np.flatnonzero(np.asarray(one["node_nums"]) == node)
    return one[DATA_OF_AXES[direction]][at[0]] if len(at) else np.nan
