"""Result directories: rankings saved at once or not at all, and read back without sampling.

A result directory holds ``result.json`` (study, inputs, versions, seed, settings and everything
but the draws), ``data.csv`` (the identified modes; next to it, how they were identified; where
there are several configurations, files for each in ``data/``), ``comparison.json`` and
``comparison.csv``, and of each class ``posteriors/*.nc`` (draws, which arviz opens) and ``*.npz``
(what its log evidence is recomputed from, which nothing here reads). Results of commands have
``figures``. ``digests.json`` holds the digests of all these files.
"""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.codec import from_record
from bayes_ssi.foundations.displayed import columns
from bayes_ssi.foundations.text_files import file_names
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.modal_files import read_modal_data, write_modal_data
from bayes_ssi.results import result_files
from bayes_ssi.results.draws import load_draws, save_draws
from bayes_ssi.studies.appendages import appendage_search  # noqa: F401 - kinds of FamilyRecord
from bayes_ssi.studies.changes import change_search  # noqa: F401
from bayes_ssi.studies.ranking.comparison import Comparison, RankedClass
from bayes_ssi.studies.ranking.study import IN_THE_FILE_OF_DRAWS, RankedStudy, Ranking, ResultRecord
from bayes_ssi.studies.search.findings import FamilyRecord, SearchResult

# The file that every result directory holds.
MARKER = "result.json"
COMPARISON = "comparison.json"
FIGURES = "figures"
SEARCH = "search.json"


@dataclass(frozen=True, eq=False, repr=False)
class StoredResult(RankedStudy):
    """A study's result, as a directory holds it.

    Attributes:
        directory: path of the directory.
        record: everything but the draws and the data.
        tests: name of a configuration → the modes identified in it.
        posteriors: the posteriors, in the study's order.
        comparison: the ranking.
        search: the search, for appendages or for changes, that gave the ranking; None if none did.
        study: None, for files hold no Python objects; ``record`` says what it was.
    """

    directory: Path
    record: ResultRecord
    tests: Mapping[str, ModalData]
    posteriors: tuple[Posterior, ...]
    comparison: Comparison
    search: FamilyRecord | None = None
    study: None = field(default=None, init=False)

    @property
    def seed(self) -> int:
        """From which the result follows."""
        return self.record.seed

    @property
    def settings(self) -> SamplingSettings:
        """How precisely classes were sampled."""
        return self.record.settings

    def _line(self) -> str:
        return f"of {self.record.study!r} in {self.directory}: {self.comparison._line()}"


# A ranking, as it was made or read, or the directory that holds it.
AnyResult = Ranking | StoredResult | str | Path


@checked
def load_result(directory: str | Path) -> StoredResult:
    """Read a result directory.

    Raises:
        ValueError: it does not exist, is incomplete or damaged, was changed after it was saved, or
            was written by another version.
    """
    directory = Path(directory)
    record = result_files.read_current(
        ResultRecord, directory / MARKER, what="a result", again="run the study again"
    )
    result_files.check_digests(
        directory, MARKER, COMPARISON, *record.draws.values(), *record.data.values()
    )
    comparison = result_files.read_stored(Comparison, directory / COMPARISON)
    search = None
    if (directory / SEARCH).is_file():
        result_files.check_digests(directory, SEARCH)
        kind: Any = FamilyRecord  # its record says which
        search = result_files.read_stored(kind, directory / SEARCH)
    tests = {name: read_modal_data(directory / file) for name, file in record.data.items()}
    not_here: dict[str, Any] = dict.fromkeys(IN_THE_FILE_OF_DRAWS, np.empty(0))
    posteriors = (from_record(Posterior, posterior, **not_here) for posterior in record.posteriors)
    with_draws = tuple(load_draws(directory / record.draws[each.name], each) for each in posteriors)
    return StoredResult(directory, record, tests, with_draws, comparison, search)


def as_stored(result: AnyResult) -> StoredResult:
    """A result as it is read from its directory, or would be if it were saved."""
    if isinstance(result, StoredResult):
        return result
    if not isinstance(result, Ranking):
        return load_result(Path(result))
    return StoredResult(Path(), result.record, result.tests, result.posteriors, result.comparison)


@checked
def save_result(
    result: Ranking | SearchResult[Any],
    directory: str | Path,
    *,
    study_file: str = "",
    overwrite: bool = False,
    accept_failed_checks: bool = False,
    command: str = "",
    extra: Mapping[str, Any] | None = None,
    figures: Callable[[Path], object] | None = None,
) -> StoredResult:
    """Write a result to a new directory; nothing is left there if writing fails.

    Args:
        result: of a ranking, or of a search for appendages or changes.
        directory: where the result goes.
        study_file: the file that defines the study, for the record.
        overwrite: replace a result that exists.
        accept_failed_checks: record that failed checks were accepted.
        command: the command that reproduces the result, for the record.
        extra: name of a further JSON file → the object whose record it holds.
        figures: writes figures into the directory that it is called with, ``figures`` of the
            result.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds something other
            than a result.
        OSError: a file cannot be written.
    """
    ranking = result.ranking if isinstance(result, SearchResult) else result
    further = dict(extra or {})
    if isinstance(result, SearchResult):
        further[SEARCH] = result.record
    with result_files.new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        (partial / "posteriors").mkdir()
        data = _save_tests(ranking.tests, partial)
        files = file_names([row.name for row in ranking.posteriors], "nc")
        draws = {name: f"posteriors/{file}" for name, file in files.items()}
        for posterior in ranking.posteriors:
            path = partial / draws[posterior.name]
            save_draws(path, posterior)
            if posterior.importance_draws is not None:
                np.savez(path.with_suffix(".npz"), **posterior.importance_draws)
        record = replace(ranking.record, study_file=study_file, command=command, draws=draws)
        record = replace(record, data=data, failed_checks_accepted=accept_failed_checks)
        result_files.write_json(partial / MARKER, record)
        result_files.write_json(partial / COMPARISON, ranking.comparison)
        for name, record_of_file in further.items():
            result_files.write_json(partial / name, record_of_file)
        _write_comparison_csv(partial / "comparison.csv", ranking.comparison)
        if figures is not None:
            (partial / FIGURES).mkdir()
            figures(partial / FIGURES)
        result_files.write_digests(partial)
    return load_result(directory)


def _save_tests(tests: Mapping[str, ModalData], directory: Path) -> dict[str, str]:
    """Write the identified modes of every configuration: its name → its file."""
    files = {"": "data.csv"}
    if list(tests) != [""]:
        (directory / "data").mkdir()
        files = {name: f"data/{file}" for name, file in file_names(list(tests), "csv").items()}
    for name, data in tests.items():
        path = directory / files[name]
        write_modal_data(_with_own_figures(data, path), path)
    return files


def _with_own_figures(data: ModalData, path: Path) -> ModalData:
    """The modes, the figures of their identification copied to a directory next to their file."""
    own, identifications = path.with_suffix(".figures"), []
    for i, each in enumerate(data.identifications, 1):
        files = [file for file in map(Path, each.figures) if file.is_file()]
        if files:
            own.mkdir(exist_ok=True)
        copies = (str(shutil.copyfile(file, own / f"{i}_{file.name}")) for file in files)
        identifications.append(replace(each, figures=tuple(copies)))
    return replace(data, identifications=tuple(identifications))


def _write_comparison_csv(path: Path, comparison: Comparison) -> None:
    names = [item.name for item in fields(RankedClass) if item.name != "checks"]
    rows: list[list[object]] = [[*names, "misfit", "failed_checks", "remarks"]]
    for row in comparison.classes:
        own = columns(row, names).values()
        rows.append([*own, row.misfit, "; ".join(row.failed_checks), "; ".join(row.remarks)])
    result_files.write_csv(path, rows)
