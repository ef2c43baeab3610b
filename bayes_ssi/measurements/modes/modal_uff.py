"""Identified modes from universal files: data sets 55, data at nodes of normal or complex modes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.universal_files import read_data_sets
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode, checked_band
from bayes_ssi.measurements.modes.modal_data import ModalData

DIRECTIONS = {"x": "r1", "y": "r2", "z": "r3"}
# The analysis types of data sets 55 that are modes.
NORMAL, COMPLEX, COMPLEX_SECOND_ORDER = 2, 3, 7


def read_modal_uff(
    path: Path,
    *,
    band_hz: Sequence[float],
    sensors: Mapping[str, tuple[int, str]] | None = None,
) -> ModalData:
    """Read the modes of a universal file.

    Arguments are as in :func:`bayes_ssi.measurements.modes.modal_files.read_modal_data`.

    Returns:
        Modes labelled 1, 2, … in ascending order of frequency. A complex mode's frequency is
        |λ|/2π and its damping -Re λ/|λ|, λ being its eigenvalue in rad/s.
    """
    sets = read_data_sets(path, 55)
    sets = [s for s in sets if s["analysis_type"] in (NORMAL, COMPLEX, COMPLEX_SECOND_ORDER)]
    if not sets:
        raise ValueError(f"{path}: no data set 55 with a normal or complex mode")
    modes = sorted((_frequency_and_damping(s), i) for i, s in enumerate(sets))
    named = dict(sensors) if sensors is not None else moving_sensors(sets)
    try:
        return ModalData(
            tuple(
                IdentifiedMode(
                    str(number),
                    frequency,
                    np.array([_component(sets[i], name, at) for name, at in named.items()]),
                    damping=damping if 0.0 < damping < 1.0 else None,
                )
                for number, ((frequency, damping), i) in enumerate(modes, start=1)
            ),
            checked_band(band_hz),
            sensors=tuple(named),
            source=path.name,
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _frequency_and_damping(one: Mapping[str, Any]) -> tuple[float, float]:
    if one["analysis_type"] == NORMAL:
        return float(one["freq"]), float(one.get("modal_damp_vis", 0.0))
    size = abs(one["eig"])
    return float(size / (2.0 * math.pi)), float(-np.real(one["eig"]) / size) if size else 0.0


def moving_sensors(sets: Iterable[Mapping[str, Any]]) -> dict[str, tuple[int, str]]:
    """All nodes and directions in which some mode moves."""
    moving = {
        (int(node), direction)
        for one in sets
        for direction, key in DIRECTIONS.items()
        for node in np.asarray(one["node_nums"])[np.asarray(one[key]) != 0]
    }
    return {f"{node} {direction}": (node, direction) for node, direction in sorted(moving)}


def _component(one: Mapping[str, Any], name: str, place: tuple[int, str]) -> complex:
    """The component of one mode that a sensor measures."""
    if len(place) != 2:
        raise ValueError(f"sensor {name!r}: must be a node and a direction, got {place!r}")
    node, direction = place
    axis = str(direction).removeprefix("-")
    if axis not in DIRECTIONS:
        raise ValueError(
            f"sensor {name!r}: direction must be x, y or z, perhaps with a minus sign, got "
            f"{direction!r}"
        )
    at = np.flatnonzero(np.asarray(one["node_nums"]) == node)
    if not len(at):
        nodes = ", ".join(str(int(n)) for n in list(one["node_nums"])[:10])
        raise ValueError(f"sensor {name!r}: no node {node}; nodes are {nodes}, ...")
    value = one[DIRECTIONS[axis]][at[0]]
    return -value if str(direction).startswith("-") else value
