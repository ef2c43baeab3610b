"""Identified modes from pyOMA2 (https://github.com/dagghe/pyOMA2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode, checked_band
from bayes_ssi.measurements.modes.modal_data import ModalData


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
    modes = tuple(
        IdentifiedMode(
            label=str(number),
            frequency_hz=float(frequencies[i]),
            shape=shapes[:, i],
            # An algorithm that did not estimate it leaves zero or NaN.
            frequency_cov=float(spread[i] / frequencies[i]) if spread[i] > 0.0 else None,
            damping=float(damping[i]) if 0.0 <= damping[i] < 1.0 else None,
        )
        for number, i in enumerate(order, start=1)
    )
    return ModalData(modes, checked_band(band_hz), sensors=tuple(names), source=source)


def _column(result: Any, name: str, n: int) -> np.ndarray:
    """One number for each mode, NaN where the result has none."""
    values = getattr(result, name, None)
    if values is None:
        return np.full(n, np.nan)
    column = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    if len(column) != n:
        raise ValueError(
            f"modal_data_from_pyoma2: {name} holds {len(column)} numbers, expected {n}"
        )
    return column
