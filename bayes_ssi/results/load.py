"""Reading a result directory.

A result directory holds ``result.json`` (study, inputs, versions, seed, settings and everything
but the draws), ``data.csv`` (the identified modes; next to it, how they were identified; where
there are several configurations, files for each in ``data/``), ``comparison.json`` and
``comparison.csv``, and ``posteriors/*.nc`` (draws of each class, which arviz opens). Results of
commands have ``figures``. ``digests.json`` holds the digests of all these files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.codec import from_record
from bayes_ssi.foundations.displayed import InWords
from bayes_ssi.inference.model_class.class_record import ClassRecord
from bayes_ssi.inference.model_class.configuration import (
    choose_configuration,
    failed_data_checks,
    joint_digest,
)
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.measurements.modes.modal_csv import read_modal_csv
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.draws import load_draws
from bayes_ssi.results.result_files import check_digest, read_json, read_record
from bayes_ssi.studies.appendages.search_result import SearchRecord
from bayes_ssi.studies.ranking.comparison import Comparison
from bayes_ssi.studies.ranking.sensitivity import Sensitivity

# Increased whenever the format of a result's files changes.
FORMAT = 19


@dataclass(frozen=True)
class ResultRecord:
    """Everything in a result but its draws and its data.

    Attributes:
        study_file: the file that defines the study; empty where there is none.
        prior_weights: model class → prior weight; None where all are equal.
        command: the command that reproduces the result; empty where it was made from Python.
    """

    created: str
    study: str
    description: str
    study_file: str
    seed: int
    settings: SamplingSettings
    prior_weights: Mapping[str, float] | None
    data_digest: str
    versions: Mapping[str, str]
    model_classes: tuple[ClassRecord, ...]
    stands_for: Mapping[str, tuple[str, ...]]
    posteriors: tuple[Mapping[str, Any], ...]
    draws: Mapping[str, str]
    data: Mapping[str, str]
    failed_checks_accepted: bool
    command: str
    format: int = FORMAT

    def model_class(self, name: str) -> ClassRecord:
        """The record of the model class ``name``; KeyError if there is none."""
        return {each.name: each for each in self.model_classes}[name]


# The file that every result directory holds.
MARKER = "result.json"
COMPARISON = "comparison.json"
FIGURES = "figures"
SEARCH, SENSITIVITY = "search.json", "sensitivity.json"
IN_THE_FILE_OF_DRAWS = (
    "draws",
    "log_likelihoods",
    "frequencies_hz",
    "sensor_shapes",
    "datum_terms",
)

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False)
class StoredResult(InWords):
    """What a result directory holds.

    Attributes:
        directory: path of the directory.
        record: everything but the draws and the data.
        tests: name of a configuration → the modes identified in it.
        posteriors: the posteriors, in the study's order.
        comparison: the ranking.
    """

    directory: Path
    record: ResultRecord
    tests: Mapping[str, ModalData]
    posteriors: tuple[Posterior, ...]
    comparison: Comparison

    @property
    def data(self) -> ModalData:
        """The identified modes of the only configuration; ValueError where there are several."""
        return choose_configuration(self.tests, None, str(self.directory))

    @cached_property
    def sensitivity(self) -> Sensitivity | None:
        """Sensitivity of the ranking to settings; None if it was not computed.

        Raises:
            ValueError: its file is damaged.
        """
        return self._further(Sensitivity, SENSITIVITY)

    @cached_property
    def search(self) -> SearchRecord | None:
        """The search for appendages that gave the ranking; None if there was none.

        Raises:
            ValueError: its file is damaged.
        """
        return self._further(SearchRecord, SEARCH)

    def _further(self, kind: type[T], file: str) -> T | None:
        path = self.directory / file
        if not path.is_file():
            return None
        record = read_record(kind, path)
        check_digest(self.directory, file)
        return record

    @property
    def ranked_posteriors(self) -> tuple[Posterior, ...]:
        """The posteriors in the order of the ranking, the best first."""
        return tuple(self.posterior(row.name) for row in self.comparison.classes)

    def posterior(self, name: str) -> Posterior:
        """The posterior of one class.

        Raises:
            ValueError: no class has that name.
        """
        by_name = {posterior.name: posterior for posterior in self.posteriors}
        require_known(f"{self.directory}: no model class", [name], by_name)
        return by_name[name]

    def _line(self) -> str:
        return f"of {self.record.study!r} in {self.directory}: {self.comparison._line()}"

    def _rows(self) -> list[dict[str, Any]]:
        return self.comparison._rows()


@checked
def load_result(directory: str | Path) -> StoredResult:
    """Read a result directory.

    Raises:
        ValueError: it does not exist, is incomplete or damaged, was changed after it was saved, or
            was written by another version.
    """
    directory = Path(directory)
    file = directory / MARKER
    stored_format = read_json(file).get("format")
    if stored_format != FORMAT:
        raise ValueError(
            f"{directory}: a result of format {stored_format!r}, this version reads format "
            f"{FORMAT}; run the study again"
        )
    record = read_record(ResultRecord, file)
    comparison = read_record(Comparison, directory / COMPARISON)
    posteriors = tuple(_posterior(directory, record, i) for i in range(len(record.posteriors)))
    try:
        tests = {name: read_modal_csv(directory / file) for name, file in record.data.items()}
    except OSError as error:
        raise ValueError(f"{error.filename}: {error.strerror}") from error
    comparison = comparison.with_common("data", failed_data_checks(tests))
    result = StoredResult(directory, record, tests, posteriors, comparison)
    if joint_digest(tests) != record.data_digest:
        raise ValueError(f"{directory}: the identified modes are not those that were ranked")
    names = {row.name for row in comparison.classes}
    if not names or any(
        {each.name for each in others} != names for others in (posteriors, record.model_classes)
    ):
        raise ValueError(f"{directory}: its files are not of the same model classes")
    for name in (MARKER, COMPARISON, *record.draws.values()):
        check_digest(directory, name)
    return result


def _posterior(directory: Path, record: ResultRecord, i: int) -> Posterior:
    not_here: dict[str, Any] = dict.fromkeys(IN_THE_FILE_OF_DRAWS, np.empty(0))
    not_here |= {"datum_terms": None, "emulators": ()}
    try:
        posterior = from_record(Posterior, record.posteriors[i], f"posteriors[{i}]", **not_here)
        if posterior.name not in record.draws:
            raise ValueError(f"draws.{posterior.name}: missing")
    except ValueError as error:
        raise ValueError(f"{directory / MARKER}: {error}") from error
    return load_draws(directory / record.draws[posterior.name], posterior)
