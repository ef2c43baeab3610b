"""The contents of a report, from stored records only: numbers and names for the template."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.criticism.misfit import INADEQUATE_SDS
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.model_at_draws import ConfigurationModes
from bayes_ssi.inference.posterior.posterior import Posterior, check_names
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary, Peak
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.modal_identification import SHORTEST_DECAYS
from bayes_ssi.plots.moving_shapes import asset, box, saved_scenes
from bayes_ssi.plots.record_plots import CAPTIONS
from bayes_ssi.report.report_figures import LIMITS, EmbeddedFigure, embedded_file
from bayes_ssi.report.tables import search_tables
from bayes_ssi.report.tables.layout import number
from bayes_ssi.report.tables.plan_tables import layout_rows
from bayes_ssi.report.tables.ranking_tables import explains, pairing_notes, region_notes
from bayes_ssi.results.answer import answer
from bayes_ssi.results.plan_answer import plan_answer
from bayes_ssi.results.stored_result import StoredResult
from bayes_ssi.results.stored_what_if import recorded_class
from bayes_ssi.results.wording import listed
from bayes_ssi.structures.modal import comac, mac
from bayes_ssi.studies.appendages.appendage_search import SearchRecord
from bayes_ssi.studies.planning.plan_record import Plan
from bayes_ssi.studies.ranking.comparison import RankedClass, probability_text
from bayes_ssi.studies.ranking.study import averaged_parameters

MISSING = "-"
# Endings of a column's name in a CSV file, and other columns that hold numbers.
UNITS = {"_hz": "Hz", "_s": "s"}
NUMBERS = ("low", "median", "high", "share")
# Two shapes with a larger MAC are taken for one; below it, motions at a sensor do not agree.
ALIKE = 0.9


def interval(three: Sequence[Any] | None, digits: int = 4) -> str:
    """Median and ends of (low, median, high)."""
    if three is None:
        return MISSING
    low, median, high = (number(value, f".{digits}g") for value in three)
    return f"{median} ({low} to {high})"


def percent(fraction: Any, digits: int = 3) -> str:
    return MISSING if fraction is None else f"{number(100.0 * float(fraction), f'.{digits}g')} %"


def error_percent(model: Any, identified: float) -> str:
    """The relative error of a frequency, with its sign."""
    if model is None or not math.isfinite(float(model)):
        return MISSING
    error = round(100.0 * (float(model) / identified - 1.0), 1)
    return f"{error:+.1f} %" if error else "0.0 %"


def settings(given: SamplingSettings) -> str:
    """Settings in a line, without those that leave a choice to the sampling."""
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key.replace('_', ' ')} {words[value] if isinstance(value, bool) else value}"
        for key, value in asdict(given).items()
        if value is not None
    )


def heading(name: str) -> str:
    """The heading of a CSV file's column in a table."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')} ({unit})"
    return name.replace("_", " ")


def of_numbers(name: str) -> bool:
    return name in NUMBERS or any(name.endswith(ending) for ending in UNITS)


FORMATS: tuple[Callable[..., Any], ...] = (
    number, interval, percent, error_percent, settings, heading, explains
)  # fmt: skip
FILTERS = {form.__name__: form for form in FORMATS}
FILTERS |= {"probability": probability_text, "names": listed}


def page_content(
    stored: StoredResult,
    predictions: Mapping[str, Any],
    figures: Mapping[str, Sequence[EmbeddedFigure]],
    plan: Plan | None = None,
) -> dict[str, Any]:
    record, comparison = stored.record, stored.comparison
    appendages = stored.search if isinstance(stored.search, SearchRecord) else None
    ranked = list(zip(comparison.classes, stored.ranked_posteriors, strict=True))
    classes = [_class(row, posterior, stored) for row, posterior in ranked[: LIMITS.classes]]
    return {
        "record": record,
        "comparison": comparison,
        "answer": answer(stored),
        # A search has a table of its own.
        "averages": averaged_parameters(stored.posteriors, comparison) if not stored.search else (),
        "limit_sds": INADEQUATE_SDS,
        "tests": stored.tests,
        "auto_macs": {name: auto_mac(data) for name, data in stored.tests.items()},
        "several": len(stored.tests) > 1,
        "identifications": list(_identifications(stored.tests, classes)),
        "shortest": SHORTEST_DECAYS,
        "classes": classes,
        "n_more": max(0, len(ranked) - LIMITS.classes),
        "checks": ranked,
        "check_names": check_names(stored.posteriors),
        "search": stored.search,
        "of_appendages": appendages is not None,
        "places": stored.search.places_by_probability if stored.search else (),
        "mass_scales": search_tables.mass_scales(appendages) if appendages else (),
        "baseline_notes": search_tables.baseline_notes(appendages) if appendages else (),
        "unseen": search_tables.unseen_note(stored.search) if stored.search else "",
        "unsampled": search_tables.unsampled_notes(stored.search) if stored.search else (),
        "predictions": predictions,
        "plan": [plan_answer(plan), layout_rows(plan)] if plan else None,
        "figures": figures,
        "moving": {name: box(scenes) for name, scenes in saved_scenes(stored.directory).items()},
        "moving_style": asset("css"),
        "moving_script": asset("js"),
        "limits": LIMITS,
        # As far as the record says.
        "command": record.command
        or f"bayes-ssi rank {record.study_file} --seed {record.seed} "
        f"--error {record.settings.log_evidence_error:g}",
        "sampled_seconds": sum(posterior.seconds for posterior in stored.posteriors),
    }


def _class(row: RankedClass, posterior: Posterior, stored: StoredResult) -> dict[str, Any]:
    record = stored.record.model_class(row.name)
    comacs = {}
    if posterior.sensor_shapes is not None:
        tests = recorded_class(stored, row.name).configurations
        for test, modes in zip(tests, posterior.configurations, strict=True):
            known: Any = test.structure
            comacs[modes.name] = co_mac(test.data, modes, known.known.shapes)
    configurations = []
    for modes, recorded in zip(posterior.configurations, record.configurations, strict=True):
        content = _of_configuration(modes, stored.tests[modes.name], posterior)
        by_name = groupby(recorded.structure_lines, key=itemgetter(0))
        lines = [(name, [text for _, text in group]) for name, group in by_name]
        configurations.append({**content, "comac": comacs.get(modes.name), "structure": lines})
    summaries = zip(posterior.summary, posterior.prior_quantiles, record.parameters, strict=True)
    return {
        "row": row,
        "record": record,
        "parameters": list(summaries),
        "configurations": configurations,
        "pairings": pairing_notes(posterior),
        "regions": region_notes(posterior),
    }


def _of_configuration(
    modes: ConfigurationModes, data: ModalData, posterior: Posterior
) -> dict[str, Any]:
    _, frequencies_hz = posterior.configuration(modes.name)
    label_of = {number: label for label, number in modes.pairing.items()}
    medians = np.median(frequencies_hz.reshape(-1, modes.n_modes), axis=0)
    low, high = data.band_hz
    updated = {mode.label: mode for mode in modes.updated.modes}
    of_modes = posterior.adequacy.modes if posterior.adequacy else ()
    misfits = {mode.label: mode.misfit.sds for mode in of_modes}
    return {
        "name": modes.name,
        "inferred": modes.inferred_pairing is not None,
        "shares": modes.inferred_pairing.of_modes if modes.inferred_pairing else None,
        "explained": [label for label in data.labels if label in modes.pairing],
        "spurious": [label for label in data.labels if label not in modes.pairing],
        "not_identified": [
            {"number": number, "hz": float(median)}
            for number, median in enumerate(medians, 1)
            if number not in label_of and math.isfinite(median) and low <= median <= high
        ],
        "modes": [
            {
                "label": mode.label,
                "identified_hz": mode.frequency_hz,
                "model_mode": modes.pairing.get(mode.label),
                "updated": updated.get(mode.label),
                "misfit_sds": misfits.get(label_in(modes.name, mode.label)),
            }
            for mode in data.modes
        ],
        "has_updated": bool(updated),
        "has_misfit": bool(misfits),
        "has_mac": any(mode.mac_after is not None for mode in updated.values()),
    }


def _identifications(
    tests: Mapping[str, ModalData], classes: Sequence[Mapping[str, Any]]
) -> Iterator[dict[str, Any]]:
    """How modes were identified from records, and what classes make of their peaks."""
    shown = classes[: LIMITS.classes_in_frequencies]
    for name, data in tests.items():
        own = [part for each in shown for part in each["configurations"] if part["name"] == name]
        for record in data.identifications:
            labels = _labels(record, data)
            peaks = []
            for peak in record.peaks:
                explained = ["; ".join(_explained(peak, record, labels, part)) for part in own]
                peaks.append({"peak": peak, "explained": explained})
            yield {
                "test": name,
                "of": record,
                "labels": labels,
                "class_names": [each["row"].name for each in shown],
                "has_phases": any(peak.probability_of_phases is not None for peak in record.peaks),
                "peaks": peaks,
                "figures": list(_figures(record)),
            }


def _labels(record: IdentificationSummary, data: ModalData) -> list[str | None]:
    """The label of each identified mode in the data; None where it was left out of them.

    Modes may have been renamed or merged: two are the same where each is nearest to the other.
    """
    own = np.array([mode.frequency_hz for mode in record.modes])
    apart = np.abs(np.log(own[:, None] / data.frequencies_hz))
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    return [data.labels[k] if back[k] == i else None for i, k in enumerate(nearest)]


def _explained(
    peak: Peak,
    record: IdentificationSummary,
    labels: Sequence[str | None],
    configuration: Mapping[str, Any],
) -> Iterator[str]:
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


def _figures(record: IdentificationSummary) -> Iterator[EmbeddedFigure]:
    """Those of its figures that are still there."""
    for path in filter(Path.is_file, map(Path, record.figures)):
        # A result numbers the figures by their records.
        name = path.stem.lstrip("0123456789_")
        yield embedded_file(path, CAPTIONS.get(name, name.replace("_", " ")))


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
