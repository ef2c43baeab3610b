"""A ranking on disk: written once, whole, and read back without sampling again.

A result directory holds ``result.json`` (study, inputs, versions, seed, settings and everything
but the draws), ``data.csv`` (the identified modes; where there are several configurations, a
file for each in ``data/``), ``comparison.json`` and ``comparison.csv``, and ``posteriors/*.nc``
(draws of each class, which arviz opens).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.data.modal_csv import read_modal_csv
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.identification.inferred_pairing import InferredPairing, PairingShare
from bayes_ssi.model_class.configuration import only_one
from bayes_ssi.posterior.configuration_modes import ConfigurationModes
from bayes_ssi.posterior.posterior import Evidence, Posterior, Region
from bayes_ssi.posterior.updated_modes import UpdatedModes
from bayes_ssi.ranking.comparison import Comparison, RankedClass
from bayes_ssi.results.consistency import require_record, require_whole
from bayes_ssi.results.draws import load_draws
from bayes_ssi.results.json_files import read_json
from bayes_ssi.sampling.estimates import EvidenceEstimate

__all__ = ["StoredResult", "load_result"]

FORMAT = 5
# The file that every result directory holds.
MARKER = "result.json"


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


def load_result(directory: str | Path) -> StoredResult:
    """Read a result directory.

    Raises:
        ValueError: it does not exist, is incomplete or damaged, or another version's.
    """
    directory = Path(directory)
    record = read_json(directory / MARKER)
    if record.get("format") != FORMAT:
        raise ValueError(
            f"{directory}: a result of format {record.get('format')!r}, "
            f"this version reads format {FORMAT}; run the study again"
        )
    try:
        require_record(record)
    except ValueError as error:
        raise ValueError(f"{directory / MARKER}: damaged: {error}") from error
    try:
        posteriors = tuple(_posterior(directory, entry) for entry in record["posteriors"])
        comparison = _comparison(read_json(directory / "comparison.json"))
        tests = {
            test["configuration"]: read_modal_csv(directory / test["file"])
            for test in record["data"]
        }
    except OSError as error:
        told = f"{error.filename}: {error.strerror}"
        raise ValueError(f"{directory}: incomplete or damaged result: {told}") from error
    except (LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{directory}: incomplete or damaged result: {error!r}") from error
    try:
        require_whole(record, tests, posteriors, comparison)
    except (ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{directory}: incomplete or damaged result: {error}") from error
    return StoredResult(directory, record, tests, posteriors, comparison)


def _posterior(directory: Path, entry: Mapping[str, Any]) -> Posterior:
    names = tuple(entry["parameter_names"])
    stored = load_draws(directory / "posteriors" / entry["file"], names)
    evidence = dict(entry["evidence"])
    evidence["checks"] = tuple(
        EvidenceEstimate(
            check["name"],
            float(check["log_evidence"]),
            None if check["error"] is None else float(check["error"]),
            float(check["tolerance"]),
        )
        for check in evidence["checks"]
    )
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
        failed_edge_checks=tuple(entry["edge_checks"]),
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
