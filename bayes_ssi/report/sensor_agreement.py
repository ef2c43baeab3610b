"""Which modes the sensors tell apart (AutoMAC), and at which sensors a model is at odds (COMAC)."""

from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import listed
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.posterior.model_at_draws import ConfigurationModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import comac, mac

# Two shapes with a larger MAC are taken for one; below it, motions at a sensor do not agree.
ALIKE = 0.9


def auto_mac(data: ModalData) -> dict[str, Any] | None:
    """MACs of identified shapes with one another, and what they say; None of fewer than two."""
    labels = [mode.label for mode in data.modes if mode.unit_shape is not None]
    if len(labels) < 2:
        return None
    shapes = data.unit_shapes[:, [data.labels.index(label) for label in labels]]
    matrix = mac(shapes, shapes)
    pairs = zip(*np.triu_indices(len(labels), 1), strict=True)
    known = [(matrix[i, k], f"{labels[i]} and {labels[k]} (MAC {matrix[i, k]:.2f})")
             for i, k in pairs if np.isfinite(matrix[i, k])]  # fmt: skip
    sentence = "No two modes were measured at a common sensor."
    if known:
        sentence = f"These sensors tell all modes apart: the most alike are {max(known)[1]}."
    if alike := [f"modes {pair}" for value, pair in sorted(known, reverse=True) if value > ALIKE]:
        sentence = f"These sensors cannot tell apart {listed(alike)}: their frequencies must."
    return {"labels": labels, "matrix": matrix, "sentence": sentence}


def co_mac(data: ModalData, modes: ConfigurationModes, shapes: FloatArray) -> dict[str, Any] | None:
    """COMACs of sensors over the paired modes, the lowest first, with 90 % intervals, in rows.

    And what they say; None of fewer than two modes, or where the model has no shapes at the
    sensors. ``shapes`` are the model's at draws, (n_draws, n_sensors, n_modes).
    """
    paired = [i for i, mode in enumerate(data.modes)
              if mode.label in modes.pairing and mode.unit_shape is not None]  # fmt: skip
    if len(paired) < 2:
        return None
    measured = data.unit_shapes[:, paired]
    model = shapes[:, :, [modes.pairing[data.labels[i]] - 1 for i in paired]]
    model = np.where(np.isfinite(measured), model, 0.0)
    model = model / np.linalg.norm(model, axis=1, keepdims=True)
    of_sensors = np.quantile(comac(model, measured), LEVELS, axis=0).T
    known = (row for row in zip(data.sensors, of_sensors, strict=True) if np.isfinite(row[1]).all())
    rows = sorted(known, key=lambda row: float(row[1][1]))
    if not rows:
        return None
    (lowest, (_, smallest, _)), *_ = rows
    sentence = f"No sensor is at odds with the model: the smallest is {smallest:.3f}, at {lowest}."
    if at_odds := [f"{name} ({row[1]:.2f})" for name, row in rows if row[1] < ALIKE]:
        sentence = f"Model and measurement are at odds at {listed(at_odds)}."
    return {"rows": rows, "sentence": sentence}
