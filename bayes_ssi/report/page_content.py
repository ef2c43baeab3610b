"""What a report says, from stored records only: numbers and names for the template."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from typing import Any

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.model_class.class_record import ClassRecord, ConfigurationRecord
from bayes_ssi.posterior.configuration_modes import ConfigurationModes
from bayes_ssi.posterior.posterior import Posterior, check_names
from bayes_ssi.predictions.saved_predictions import SavedPredictions
from bayes_ssi.ranking.comparison import Comparison, RankedClass
from bayes_ssi.report.embedded_figure import EmbeddedFigure
from bayes_ssi.report.report_figures import ReportFigures
from bayes_ssi.results.load import StoredResult
from bayes_ssi.results.result_record import ResultRecord
from bayes_ssi.tables import pairing_notes, region_notes

__all__ = ["page_content"]


@dataclass(frozen=True)
class _StoredClass:
    """What is stored of one model class: its posterior, its record, its row of the ranking."""

    posterior: Posterior
    record: ClassRecord
    row: RankedClass


def page_content(
    stored: StoredResult,
    predictions: SavedPredictions | None,
    figures: ReportFigures,
    most_listed: int,
) -> dict[str, Any]:
    """The variables of the template.

    Args:
        stored: the ranking.
        predictions: those saved with it.
        figures: of the report.
        most_listed: model classes that are described in full, the best first.
    """
    record, comparison = stored.record, stored.comparison
    ranked = [
        _StoredClass(stored.posterior(row.name), record.model_class(row.name), row)
        for row in comparison.classes
    ]
    methods = check_names(stored.posteriors)
    return {
        "title": record.study,
        "question": record.description,
        "record": record,
        "rows": [_ranked(each, comparison, record) for each in ranked],
        "best": comparison.best,
        "runner_up": comparison.classes[1] if len(comparison.classes) > 1 else None,
        "alike": comparison.not_distinguishable,
        "failed": comparison.failed_checks,
        "scale": comparison.scale,
        "tests": [_test(name, data, figures.tests[name]) for name, data in stored.tests.items()],
        "several": len(stored.tests) > 1,
        "classes": [
            # A hypothesis of a search carries the description of the class that it was built on.
            _class(each, stored, figures, described=stored.search is None)
            for each in ranked[:most_listed]
        ],
        "n_more": max(0, len(ranked) - most_listed),
        "checks": [_checks(each, methods) for each in ranked],
        "check_names": methods,
        "search": stored.search,
        "sensitivity": stored.sensitivity,
        "turning": stored.sensitivity.turning if stored.sensitivity else (),
        "predictions": predictions,
        "figures": figures,
        "command": record.command or _command(record),
        "sampled_seconds": sum(each.posterior.seconds for each in ranked),
    }


def _ranked(each: _StoredClass, comparison: Comparison, record: ResultRecord) -> dict[str, Any]:
    row = each.row
    weights = record.prior_weights or {}
    total = sum(weights.values()) or len(comparison.classes)
    return {
        **asdict(row),
        "description": each.record.description,
        "prior_probability": weights.get(row.name, 1.0) / total,
        "best": row is comparison.best,
    }


def _test(name: str, data: ModalData, figures: list[EmbeddedFigure]) -> dict[str, Any]:
    return {
        "name": name,
        "source": data.source,
        "band_hz": data.band_hz,
        "sensors": data.sensors,
        "digest": data.digest,
        # Where no shape was measured at all, that is said once.
        "warnings": data.warnings() if data.sensors else [],
        "modes": [
            {
                "label": mode.label,
                "hz": mode.frequency_hz,
                "cov": mode.frequency_cov,
                "damping": mode.damping,
                "shape": None
                if mode.unit_shape is None
                else [float(component) for component in np.asarray(mode.unit_shape)],
            }
            for mode in data.modes
        ],
        "figures": figures,
    }


def _class(
    each: _StoredClass, stored: StoredResult, figures: ReportFigures, *, described: bool
) -> dict[str, Any]:
    posterior, record = each.posterior, each.record
    records = {configuration.name: configuration for configuration in record.configurations}
    return {
        "name": each.row.name,
        "row": each.row,
        "description": record.description if described else "",
        "error_sizes": record.error_sizes,
        "detection_probability": record.detection_probability,
        "expected_spurious_modes": record.expected_spurious_modes,
        "parameters": _parameters(posterior, record),
        "configurations": [
            {
                **_configuration(modes, stored.tests[modes.name], posterior),
                "structure": _structure(records[modes.name], record.configurations[0]),
            }
            for modes in posterior.configurations
        ],
        "pairings": _nested(pairing_notes(posterior)),
        "regions": _nested(region_notes(posterior)),
        "figures": figures.classes.get(each.row.name, []),
        "failed_checks": each.row.failed_checks,
    }


def _parameters(posterior: Posterior, record: ClassRecord) -> list[dict[str, Any]]:
    parameters = {each.name: each for each in record.parameters}
    return [
        {
            **asdict(row),
            "unit": parameters[row.name].unit,
            "prior": parameters[row.name].prior,
            "before": parameters[row.name].prior_quantiles,
            "after": (row.quantile_05, row.median, row.quantile_95),
        }
        for row in posterior.summary
    ]


def _nested(notes: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Notes by their headings, which are not indented."""
    found: list[tuple[str, list[str]]] = []
    for note in notes:
        if note.startswith(" "):
            found[-1][1].append(note.strip())
        else:
            found.append((note, []))
    return found


def _structure(record: ConfigurationRecord, first: ConfigurationRecord) -> dict[str, Any]:
    """A structure line by line; where it is much like the first configuration's, what differs."""
    lines, known = record.structure_lines, first.structure_lines
    alike = list((Counter(lines) & Counter(known)).elements())
    if record is first or 2 * len(alike) < len(lines):
        return {"as_in": None, "lines": _grouped(lines), "without": []}
    return {
        "as_in": first.name,
        "lines": _grouped(_less(lines, alike)),
        "without": _grouped(_less(known, alike)),
    }


def _less(
    lines: Sequence[tuple[str, str]], others: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    left, found = Counter(others), []
    for line in lines:
        if left[line]:
            left[line] -= 1
        else:
            found.append(line)
    return found


def _grouped(lines: Sequence[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    """Name and texts of lines that follow one another under one name."""
    return [
        (name, [text for _, text in group]) for name, group in groupby(lines, key=lambda x: x[0])
    ]


def _configuration(
    modes: ConfigurationModes, data: ModalData, posterior: Posterior
) -> dict[str, Any]:
    _, frequencies_hz = posterior.configuration(modes.name)
    label_of = {number: label for label, number in modes.pairing.items()}
    medians = np.median(frequencies_hz.reshape(-1, modes.n_modes), axis=0)
    low, high = data.band_hz
    updated = {mode.label: mode for mode in modes.updated.modes} if modes.updated else {}
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
            }
            for mode in data.modes
        ],
        "has_updated": bool(updated),
        "has_mac": any(mode.mac_after is not None for mode in updated.values()),
    }


def _checks(each: _StoredClass, methods: Sequence[str]) -> dict[str, Any]:
    posterior = each.posterior
    evidence = posterior.evidence
    return {
        "name": each.row.name,
        "failed": each.row.failed_checks,
        "remarks": posterior.remarks,
        "r_hat": posterior.r_hat,
        "effective_samples": float(posterior.effective_sample_sizes.min()),
        "chain_lengths": posterior.draws.shape[1] / posterior.autocorrelation_time
        if posterior.autocorrelation_time > 0
        else math.nan,
        "acceptance": posterior.acceptance,
        "quoted": evidence.log_evidence,
        "error": evidence.error,
        "estimates": [evidence.check(name) for name in methods],
        "pareto_k": evidence.pareto_k,
        "importance_samples": evidence.effective_sample_size,
        "n_regions": len(posterior.regions),
        "n_evaluations": posterior.n_evaluations,
        "seconds": posterior.seconds,
    }


def _command(record: ResultRecord) -> str:
    """The command that gives a result again, as far as its record says."""
    error = record.settings.log_evidence_error
    return f"bayes-ssi rank {record.study_file} --seed {record.seed} --error {error:g}"
