"""Identified modes of other programs: pyOMA2's results, and universal files.

In universal files modes are data sets 55, data at nodes of normal or complex modes; pyOMA2 is at
https://github.com/dagghe/pyOMA2.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
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


@checked
def modal_data_from_pyoma2(
    result: Any,
    *,
    band_hz: Sequence[float],
    sensors: Sequence[str] | None = None,
    source: str = "",
) -> ModalData:
    """The modes selected from the result of a pyOMA2 algorithm.

    Args:
        result: ``algorithm.result`` after ``mpe``: ``Fn`` (m,) in Hz and ``Phi`` (channels, m),
            complex; ``Xi`` (m,), damping as a fraction, and ``Fn_std`` (m,), the standard
            deviation of ``Fn`` in Hz, where the algorithm gave them.
        band_hz: lowest and highest frequency of the search, in Hz.
        sensors: names of the channels, as the structure names its degrees of freedom;
            ``channel 1``, ``channel 2``, … if None.
        source: where the data come from.

    Returns:
        Modes labelled 1, 2, … in ascending order.

    Raises:
        TypeError: it is not such a result.
        ValueError: no modes were selected, names and channels differ in number, or a mode lies
            outside the band.
    """
    if not (hasattr(result, "Fn") and hasattr(result, "Phi")):
        raise TypeError(
            "modal_data_from_pyoma2: result must be an algorithm's result with Fn and Phi, got "
            f"{type(result).__name__}"
        )
    if result.Fn is None or result.Phi is None:
        raise ValueError(
            "modal_data_from_pyoma2: no modes were selected; call mpe of the algorithm first"
        )
    frequencies = np.atleast_1d(np.asarray(result.Fn, dtype=float)).ravel()
    shapes = np.asarray(result.Phi)
    if shapes.ndim != 2 or shapes.shape[1] != len(frequencies):
        raise ValueError(
            f"modal_data_from_pyoma2: Phi must be (channels, {len(frequencies)}), "
            f"one column for each of Fn, got shape {shapes.shape}"
        )
    n_channels = len(shapes)
    names = [f"channel {i}" for i in range(1, n_channels + 1)] if sensors is None else list(sensors)
    if len(names) != n_channels:
        raise ValueError(
            f"modal_data_from_pyoma2: {len(names)} sensors for {n_channels} channels of Phi"
        )
    damping = _column(result, "Xi", len(frequencies))
    spread = _column(result, "Fn_std", len(frequencies))
    order = np.argsort(frequencies, kind="stable")
    return ModalData.from_arrays(
        frequencies[order],
        shapes[:, order],
        band_hz,
        names,
        source,
        # An algorithm that did not estimate it leaves zero or NaN.
        frequency_cov=np.where(spread > 0.0, spread / frequencies, np.nan)[order],
        damping=np.where((damping >= 0.0) & (damping < 1.0), damping, np.nan)[order],
    )


def _column(result: Any, name: str, n: int) -> FloatArray:
    """One number for each mode (n,), NaN where the result has none."""
    values = getattr(result, name, None)
    return np.full(n, np.nan) if values is None else np.reshape(values, n).astype(float)
