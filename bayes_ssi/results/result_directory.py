"""A ranking on disk: written once, whole, and read back without sampling again.

A result directory holds ``result.json`` (study, inputs, versions, seed, settings and everything
but the draws), ``data.csv`` (the identified modes; where there are several configurations, a
file for each in ``data/``), ``comparison.json`` and ``comparison.csv``, and ``posteriors/*.nc``
(draws of each class, which arviz opens).
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi import new_directory
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.identification.inferred_pairing import InferredPairing, PairingShare
from bayes_ssi.model_class.configuration import label_in, only_one
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.ranking.comparison import Comparison, RankedClass
from bayes_ssi.ranking.study import Ranking, Study
from bayes_ssi.results.arviz_store import Further, StoredDraws, load_draws, save_draws
from bayes_ssi.sampling.evidence import Estimate
from bayes_ssi.updating.configuration_modes import ConfigurationModes
from bayes_ssi.updating.posterior import Evidence, Posterior, Region
from bayes_ssi.updating.updated_modes import UpdatedModes
from bayes_ssi.versions import versions

__all__ = [
    "StoredResult",
    "load_result",
    "plain_record",
    "require_new",
    "save_result",
    "write_json",
]

FORMAT = 5
# The file that every result directory holds.
MARKER = "result.json"
PRIOR_DRAWS = 1000


@dataclass(frozen=True, eq=False)
class StoredResult:
    """What a result directory holds.

    Attributes:
        directory: where it is.
        record: ``result.json``.
        tests: name of a configuration → the modes identified in it.
        posteriors: in the study's order.
        comparison: the ranking.
    """

    directory: Path
    record: Mapping[str, Any]
    tests: Mapping[str, ModalData]
    posteriors: tuple[Posterior, ...]
    comparison: Comparison

    @property
    def data(self) -> ModalData:
        """The identified modes of a result with one configuration; ValueError otherwise."""
        return only_one(list(self.tests.values()), str(self.directory), list(self.tests))

    @property
    def ranked_posteriors(self) -> tuple[Posterior, ...]:
        """The posteriors in the order of the ranking, the best first."""
        return tuple(self.posterior(row.name) for row in self.comparison.classes)

    def posterior(self, name: str) -> Posterior:
        """The posterior of one class.

        Raises:
            ValueError: no class has that name.
        """
        for posterior in self.posteriors:
            if posterior.name == name:
                return posterior
        raise ValueError(
            f"{self.directory}: no model class {name!r}; "
            f"choose from {', '.join(repr(p.name) for p in self.posteriors)}"
        )


def require_new(directory: str | Path, *, overwrite: bool = False) -> None:
    """As :func:`bayes_ssi.new_directory.require_new`, for a result directory."""
    new_directory.require_new(directory, marker=MARKER, overwrite=overwrite)


def save_result(
    ranking: Ranking,
    directory: str | Path,
    *,
    study_file: str = "",
    overwrite: bool = False,
    accept_failed_checks: bool = False,
    command: str = "",
    extra: Mapping[str, Any] | None = None,
) -> StoredResult:
    """Write a ranking to a new directory; nothing is left there if writing fails.

    Args:
        ranking: the result.
        directory: where to.
        study_file: the file that defines the study, for the record.
        overwrite: replace a result that exists.
        accept_failed_checks: put on record that failed checks were accepted.
        command: that gives the result again, for the record.
        extra: name of a further JSON file → its record.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds something other
            than a result.
    """
    with new_directory.new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        (partial / "posteriors").mkdir()
        tests = _save_tests(ranking.study, partial)
        files = _file_names([p.name for p in ranking.posteriors])
        classes = {candidate.name: candidate for candidate in ranking.study.model_classes}
        for posterior in ranking.posteriors:
            stored = StoredDraws(
                posterior.parameter_names,
                posterior.draws,
                posterior.log_likelihoods,
                posterior.frequencies_hz,
                _mode_labels(posterior),
                _further(posterior, classes[posterior.name]),
            )
            save_draws(partial / "posteriors" / files[posterior.name], stored)
        record = {**_record(ranking, files, study_file), "data": tests}
        record |= {"failed_checks_accepted": accept_failed_checks, "command": command}
        write_json(partial / MARKER, record)
        write_json(partial / "comparison.json", asdict(ranking.comparison))
        for name, further in (extra or {}).items():
            write_json(partial / name, further)
        _write_comparison_csv(partial / "comparison.csv", ranking.comparison)
    return load_result(directory)


def load_result(directory: str | Path) -> StoredResult:
    """Read a result directory.

    Raises:
        ValueError: it does not exist, is incomplete or damaged, or another version's.
    """
    directory = Path(directory)
    record = _read_json(directory / MARKER)
    if record.get("format") != FORMAT:
        raise ValueError(
            f"{directory}: a result of format {record.get('format')!r}, "
            f"this version reads format {FORMAT}; run the study again"
        )
    try:
        posteriors = tuple(_posterior(directory, entry) for entry in record["posteriors"])
        comparison = _comparison(_read_json(directory / "comparison.json"))
        tests = {
            test["configuration"]: ModalData.load(directory / test["file"])
            for test in record["data"]
        }
    except OSError as error:
        told = f"{error.filename}: {error.strerror}"
        raise ValueError(f"{directory}: incomplete or damaged result: {told}") from error
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{directory}: incomplete or damaged result: {error!r}") from error
    return StoredResult(directory, record, tests, posteriors, comparison)


def _save_tests(study: Study, directory: Path) -> list[dict[str, str]]:
    """Write the identified modes of every configuration, and say where they are."""
    configurations = study.model_classes[0].configurations
    files = {"": "data.csv"}
    if [configuration.name for configuration in configurations] != [""]:
        (directory / "data").mkdir()
        names = _file_names([configuration.name for configuration in configurations], "csv")
        files = {name: f"data/{file}" for name, file in names.items()}
    for configuration in configurations:
        configuration.data.save(directory / files[configuration.name])
    return [
        {"configuration": c.name, "file": files[c.name], "source": c.data.source}
        for c in configurations
    ]


def _mode_labels(posterior: Posterior) -> tuple[int | str, ...]:
    return tuple(
        label_in(modes.name, str(number)) if modes.name else number
        for modes in posterior.configurations
        for number in range(1, modes.n_modes + 1)
    )


def _further(posterior: Posterior, model_class: ModelClass) -> Further | None:
    """What other packages make use of beside a posterior's draws."""
    if posterior.parameter_names != model_class.parameter_names:
        return None
    z = np.random.default_rng(0).standard_normal((PRIOR_DRAWS, len(posterior.parameter_names)))
    identified = [c.data.frequencies_hz for c in model_class.configurations]
    return Further(model_class.values(z), posterior.datum_terms, np.concatenate(identified))


def _record(ranking: Ranking, files: Mapping[str, str], study_file: str) -> dict[str, Any]:
    study = ranking.study
    return {
        "format": FORMAT,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "study": study.name,
        "description": study.description,
        "study_file": study_file,
        "seed": ranking.seed,
        "settings": asdict(ranking.settings),
        "prior_weights": None if study.prior_weights is None else dict(study.prior_weights),
        "data_digest": ranking.comparison.data_digest,
        "versions": versions(),
        "model_classes": [candidate.summary() for candidate in study.model_classes],
        "posteriors": [
            _entry(posterior, files[posterior.name]) for posterior in ranking.posteriors
        ],
    }


IN_THE_FILE_OF_DRAWS = ("draws", "log_likelihoods", "frequencies_hz", "datum_terms")


def _entry(posterior: Posterior, file: str) -> dict[str, Any]:
    """Everything of a posterior but its draws."""
    entry: dict[str, Any] = {"file": file}
    for item in fields(posterior):
        value = getattr(posterior, item.name)
        if item.name in IN_THE_FILE_OF_DRAWS:
            continue
        if isinstance(value, np.ndarray):
            value = value.tolist()
        elif isinstance(value, Evidence):
            value = asdict(value)
        elif item.name in ("regions", "configurations"):
            value = [asdict(part) for part in value]
        entry[item.name] = value
    entry["summary"] = [asdict(row) for row in posterior.summary]
    return entry


def _posterior(directory: Path, entry: Mapping[str, Any]) -> Posterior:
    names = tuple(entry["parameter_names"])
    stored = load_draws(directory / "posteriors" / entry["file"], names)
    evidence = dict(entry["evidence"])
    for check in ("bridge", "repeat"):
        evidence[check] = Estimate(**{k: float(v) for k, v in evidence[check].items()})
    for number, value in evidence.items():
        if isinstance(value, str):  # an infinity or NaN
            evidence[number] = float(value)
    return Posterior(
        parameter_names=names,
        draws=stored.draws,
        log_likelihoods=stored.log_likelihoods,
        frequencies_hz=stored.frequencies_hz,
        effective_sample_sizes=np.array(entry["effective_sample_sizes"], dtype=float),
        evidence=Evidence(**evidence),
        regions=tuple(
            Region(
                share=region["share"],
                error=region["error"],
                n_searches=region["n_searches"],
                shares_of_starts=tuple(region["shares_of_starts"]),
                mean=tuple(region["mean"]),
            )
            for region in entry["regions"]
        ),
        maxima=np.array(entry["maxima"], dtype=float),
        relative_spreads=np.array(entry["relative_spreads"], dtype=float),
        failed_checks=tuple(entry["failed_checks"]),
        edge_checks=tuple(entry["edge_checks"]),
        remarks=tuple(entry.get("remarks", ())),
        name=entry["name"],
        n_evaluations=entry["n_evaluations"],
        n_searches=entry["n_searches"],
        data_digest=entry["data_digest"],
        configurations=tuple(
            ConfigurationModes(
                name=modes["name"],
                n_modes=modes["n_modes"],
                pairing=modes["pairing"],
                inferred_pairing=_inferred_pairing(modes["inferred_pairing"]),
                updated=UpdatedModes.of_record(modes.get("updated")),
            )
            for modes in entry["configurations"]
        ),
        r_hat=float(entry["r_hat"]),
        autocorrelation_time=float(entry["autocorrelation_time"]),
        acceptance=float(entry["acceptance"]),
        seconds=float(entry["seconds"]),
    )


def _inferred_pairing(record: Mapping[str, Any] | None) -> InferredPairing | None:
    if record is None:
        return None
    return InferredPairing(
        tuple(PairingShare(**share) for share in record["pairings"]),
        {
            label: {int(number): share for number, share in row.items()}
            for label, row in record["of_modes"].items()
        },
    )


def _comparison(record: Mapping[str, Any]) -> Comparison:
    rows = tuple(
        RankedClass(**{**row, "failed_checks": tuple(row["failed_checks"])})
        for row in record["classes"]
    )
    return Comparison(rows, record["data_digest"], record["scale"])


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write a record; infinities and NaN as text."""
    text = json.dumps(plain_record(record), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def plain_record(value: Any) -> Any:
    """The value as JSON has it: numpy's numbers as numbers, and infinities and NaN as text."""
    if isinstance(value, Mapping):
        return {str(key): plain_record(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_record(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _read_json(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise ValueError(f"{path.parent}: not a result directory: no {path.name}") from None
    except ValueError as error:
        raise ValueError(f"{path}: damaged: {error}") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path}: damaged: not a record")
    return record


def _write_comparison_csv(path: Path, comparison: Comparison) -> None:
    names = [item.name for item in fields(RankedClass)]
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in comparison.classes:
            cells = asdict(row)
            cells["failed_checks"] = "; ".join(row.failed_checks)
            writer.writerow([cells[name] for name in names])


def _file_names(names: list[str], suffix: str = "nc") -> dict[str, str]:
    """A file name for each: its own name as far as file systems allow, made unique."""
    found: dict[str, str] = {}
    for name in names:
        stem = re.sub(r"[^A-Za-z0-9._+-]+", "_", name).strip(".") or "unnamed"
        taken = {file.lower() for file in found.values()}
        candidate, count = f"{stem}.{suffix}", 2
        while candidate.lower() in taken:
            candidate, count = f"{stem}_{count}.{suffix}", count + 1
        found[name] = candidate
    return found
