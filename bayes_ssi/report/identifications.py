"""How modes were identified from vibration records, and what classes make of their peaks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.measurements.modes.identification_record import EstimatedPeak, IdentificationRecord
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.record_plots import CAPTIONS
from bayes_ssi.report.embedded_figure import LIMITS, EmbeddedFigure, embedded_file


def identifications(
    tests: Mapping[str, ModalData], classes: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """The identifications of all tests, for the template."""
    shown = classes[: LIMITS.classes_in_frequencies]
    return [
        {
            "test": name,
            "of": each,
            "labels": (labels := _labels(each, data)),
            "class_names": [own["row"].name for own in shown],
            "has_phases": any(peak.probability_of_phases is not None for peak in each.peaks),
            "peaks": [
                {
                    "peak": peak,
                    "explained": [
                        "; ".join(_explained(peak, each, labels, _configuration(own, name)))
                        for own in shown
                    ],
                }
                for peak in each.peaks
            ],
            "figures": list(_figures(each)),
        }
        for name, data in tests.items()
        for each in data.identifications
    ]


def _labels(record: IdentificationRecord, data: ModalData) -> list[str | None]:
    """The label of each identified mode in the data; None where it was left out of them.

    Modes may have been renamed or merged since: two are the same where each is the nearest to the
    other.
    """
    own = np.array([mode.frequency_hz for mode in record.modes])
    apart = np.abs(np.log(own[:, None] / data.frequencies_hz))
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    return [data.labels[k] if back[k] == i else None for i, k in enumerate(nearest)]


def _configuration(of_class: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    return next(each for each in of_class["configurations"] if each["name"] == name)


def _explained(
    peak: EstimatedPeak,
    record: IdentificationRecord,
    labels: Sequence[str | None],
    configuration: Mapping[str, Any],
) -> Iterator[str]:
    """What the modes at a peak are in a model class."""
    model_modes = {mode["label"]: mode["model_mode"] for mode in configuration["modes"]}
    for i in peak.modes:
        label = labels[i]
        if label is None:
            yield f"{record.modes[i].frequency_hz:.4g} Hz left out"
        elif model_modes[label] is None:
            yield f"{label} spurious"
        else:
            yield f"{label} → mode {model_modes[label]}"
    for mode in configuration["not_identified"]:
        nearest = min(abs(mode["hz"] - record.modes[i].frequency_hz) for i in peak.modes)
        if nearest < peak.resolution_hz:
            yield f"mode {mode['number']} ({mode['hz']:.4g} Hz) missed"


def _figures(record: IdentificationRecord) -> Iterator[EmbeddedFigure]:
    """Those of its figures that are still there."""
    for path in filter(Path.is_file, map(Path, record.figures)):
        # A result numbers the figures by their records.
        name = path.stem.lstrip("0123456789_")
        yield embedded_file(path, CAPTIONS.get(name, name.replace("_", " ")))
