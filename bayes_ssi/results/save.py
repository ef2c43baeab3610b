"""Saving a ranking to a result directory."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.codec import to_record
from bayes_ssi.foundations.packages import versions
from bayes_ssi.foundations.text_files import file_names
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.modal_csv import write_modal_data
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.draws import save_draws
from bayes_ssi.results.load import (
    COMPARISON,
    FIGURES,
    IN_THE_FILE_OF_DRAWS,
    MARKER,
    ResultRecord,
    StoredResult,
    load_result,
)
from bayes_ssi.results.result_files import new_directory, write_digests, write_json
from bayes_ssi.studies.ranking.comparison import Comparison, RankedClass
from bayes_ssi.studies.ranking.study import Ranking, Study


@checked
def save_result(
    ranking: Ranking,
    directory: str | Path,
    *,
    study_file: str = "",
    overwrite: bool = False,
    accept_failed_checks: bool = False,
    command: str = "",
    extra: Mapping[str, Any] | None = None,
    figures: Sequence[Callable[[Path], object]] = (),
    run: Run | None = None,
) -> StoredResult:
    """Write a ranking to a new directory; nothing is left there if writing fails.

    Args:
        ranking: the result.
        directory: where the result goes.
        study_file: the file that defines the study, for the record.
        overwrite: replace a result that exists.
        accept_failed_checks: record that failed checks were accepted.
        command: the command that reproduces the result, for the record.
        extra: name of a further JSON file → the object whose record it holds.
        figures: functions that write figures into the directory that they are called with, which
            becomes ``figures`` of the result; this process draws the first one, which should be
            the one that takes longest.
        run: processes that write files side by side.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds something other
            than a result.
        OSError: a file cannot be written.
    """
    with new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        (partial / "posteriors").mkdir()
        data = _save_tests(ranking.study, partial)
        files = file_names([posterior.name for posterior in ranking.posteriors], "nc")
        draws = {name: f"posteriors/{file}" for name, file in files.items()}
        classes = {candidate.name: candidate for candidate in ranking.study.model_classes}
        with (run or Run()).side_by_side() as begin:
            if figures:
                (partial / FIGURES).mkdir()
                # By one process: to import matplotlib takes longer than to draw most of them.
                begin(_draw, (figures[1:], partial / FIGURES))
            for each in ranking.posteriors:
                begin(_save_draws, (partial / draws[each.name], each, classes[each.name]))
            record = result_record(ranking, draws, data, study_file, command, accept_failed_checks)
            write_json(partial / MARKER, record)
            write_json(partial / COMPARISON, ranking.comparison)
            for name, further in (extra or {}).items():
                write_json(partial / name, further)
            _write_comparison_csv(partial / "comparison.csv", ranking.comparison)
            _draw((figures[:1], partial / FIGURES))
        write_digests(partial)
    return load_result(directory)


def _draw(arguments: tuple[Sequence[Callable[[Path], object]], Path]) -> None:
    figures, directory = arguments
    for figure in figures:
        figure(directory)


def _save_draws(arguments: tuple[Path, Posterior, ModelClass]) -> None:
    save_draws(*arguments)


def _save_tests(study: Study, directory: Path) -> dict[str, str]:
    """Write the identified modes of every configuration: its name → its file."""
    configurations = study.model_classes[0].configurations
    files = {"": "data.csv"}
    if [configuration.name for configuration in configurations] != [""]:
        (directory / "data").mkdir()
        names = file_names([configuration.name for configuration in configurations], "csv")
        files = {name: f"data/{file}" for name, file in names.items()}
    for configuration in configurations:
        path = directory / files[configuration.name]
        write_modal_data(_with_own_figures(configuration.data, path), path)
    return files


def _with_own_figures(data: ModalData, path: Path) -> ModalData:
    """The modes, the figures of their identification copied to a directory next to their file."""
    own = path.with_suffix(".figures")
    identifications = []
    for i, each in enumerate(data.identifications, 1):
        copies = []
        for file in filter(Path.is_file, map(Path, each.figures)):
            own.mkdir(exist_ok=True)
            copies.append(str(shutil.copyfile(file, own / f"{i}_{file.name}")))
        identifications.append(replace(each, figures=tuple(copies)))
    return replace(data, identifications=tuple(identifications))


def result_record(
    ranking: Ranking,
    draws: Mapping[str, str],
    data: Mapping[str, str],
    study_file: str,
    command: str,
    accept_failed_checks: bool,
) -> ResultRecord:
    study = ranking.study
    return ResultRecord(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        study=study.name,
        description=study.description,
        study_file=study_file,
        seed=ranking.seed,
        settings=ranking.settings,
        prior_weights=study.prior_weights,
        data_digest=ranking.comparison.data_digest,
        versions=versions(),
        model_classes=tuple(map(class_record, study.model_classes)),
        stands_for=study.stands_for,
        posteriors=tuple(map(_without_draws, ranking.posteriors)),
        draws=draws,
        data=data,
        failed_checks_accepted=accept_failed_checks,
        command=command,
    )


def _without_draws(posterior: Posterior) -> dict[str, Any]:
    """The record of a posterior without its draws, but with its summary for other programs."""
    record: dict[str, Any] = to_record(posterior, without=(*IN_THE_FILE_OF_DRAWS, "emulators"))
    return record | {"summary": to_record(posterior.summary)}


def _write_comparison_csv(path: Path, comparison: Comparison) -> None:
    names = [item.name for item in fields(RankedClass) if item.name != "checks"]
    of_checks = ("misfit", "failed_checks", "remarks")
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*names, *of_checks])
        for row in comparison.classes:
            checks = (row.misfit, "; ".join(row.failed_checks), "; ".join(row.remarks))
            writer.writerow([*(getattr(row, name) for name in names), *checks])
