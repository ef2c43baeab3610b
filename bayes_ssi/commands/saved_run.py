"""Commands that sample: their options, and a result that is saved even if they are stopped."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import click

from bayes_ssi.commands.terminal import (
    command_line,
    console,
    is_quiet,
    json_option,
    progress_bars,
    say,
    tell_record,
)

if TYPE_CHECKING:
    from bayes_ssi.execution.workers import Workers
    from bayes_ssi.ranking.sensitivity import Sensitivity
    from bayes_ssi.ranking.study import Ranking, Study
    from bayes_ssi.results.load import StoredResult

__all__ = ["FAILED_CHECK", "Saved", "SavedRun", "notes_of", "run_options"]

FAILED_CHECK = 3
RESULTS = Path("runs") / "results"

T = TypeVar("T")


@dataclass(frozen=True)
class Saved(Generic[T]):
    """What was sampled, what was saved of it, and how its ranking moves, where it was asked.

    ``further`` are the records saved beside the ranking, by their files.
    """

    found: T
    result: StoredResult
    sensitivity: Sensitivity | None
    further: Mapping[str, Any]


@dataclass(frozen=True)
class SavedRun:
    """Options that every command which samples has, and what they all do with them."""

    seed: int
    log_evidence_error: float
    economical: bool
    out: Path | None
    overwrite: bool
    workers: int | None
    dask: str | None
    accept_failed_checks: bool
    sensitivity: bool

    def sample_and_save(
        self,
        sample: Callable[..., T],
        study: Study,
        study_file: Path,
        *,
        name: str,
        options: tuple[object, ...],
        ranking: Callable[[T], Ranking],
        extra: Callable[[T], Mapping[str, Any]] | None = None,
        draw: Callable[[T, Path], object] | None = None,
        is_leftover: Callable[[T, str], bool] | None = None,
    ) -> Saved[T]:
        """Sample, and save the ranking that this gives, with figures.

        A run that was stopped goes on from its checkpoint beside the result directory.

        Args:
            sample: called with seed, settings, progress, ``workers=`` and ``checkpoint=``.
            study: what is sampled, from ``study_file``.
            name: of the result directory, where none was given.
            options: what the result follows from besides the study, the seed and the settings.
            ranking: of what was sampled.
            extra: further records to save, file name → content.
            draw: draws a further figure into a directory.
            is_leftover: whether a class that was not ranked, but has a checkpoint here, needs it
                no more.
        """
        from bayes_ssi.execution.workers import dask_workers
        from bayes_ssi.plots.result_figures import save_figures
        from bayes_ssi.ranking.checkpoint import Checkpoint, name_of_run
        from bayes_ssi.ranking.sensitivity import sensitivity_record
        from bayes_ssi.results.save import require_new, save_result
        from bayes_ssi.sampling.settings import SamplingSettings

        if self.workers is not None and self.dask is not None:
            raise ValueError("--workers and --dask: give one of them")
        settings = SamplingSettings(
            log_evidence_error=self.log_evidence_error, economical=self.economical
        )
        directory = self.out or RESULTS / name
        checkpoint = Checkpoint(
            directory.with_name(f".{directory.name}.checkpoint"),
            run=name_of_run(study.model_classes, self.seed, settings, *options),
            discard_others=self.overwrite,
            say=lambda text: click.echo(text, err=True),
        )
        overwrite = self.overwrite or checkpoint.is_saving
        require_new(directory, overwrite=overwrite)
        if not self.economical and not is_quiet():
            _print_performance_hints(study)
        try:
            with (
                nullcontext(self.workers) if self.dask is None else dask_workers(self.dask) as pool,
                progress_bars() as report,
            ):
                found = sample(self.seed, settings, report, workers=pool, checkpoint=checkpoint)
                moved = self._sensitivity(ranking(found), pool, report)
        except KeyboardInterrupt:  # said below the progress bars, once these stand still
            click.echo(f"Stopped; this goes on from here: {command_line()}", err=True)
            raise
        further = dict(extra(found)) if extra else {}
        if moved is not None:
            further["sensitivity.json"] = sensitivity_record(moved)
        require_new(directory, overwrite=overwrite)
        checkpoint.begin_saving()
        with progress_bars() as report:
            report("saving", "result", 0.0)
            result = save_result(
                ranking(found),
                directory,
                study_file=str(study_file),
                overwrite=overwrite,
                accept_failed_checks=self.accept_failed_checks,
                command=command_line(),
                extra=further,
            )
            report("saving", "figures", 0.2)
            figures = _figures(result)
            save_figures(figures, result.tests, result.ranked_posteriors, result.comparison)
            if draw:
                draw(found, figures)
            report("saving", "figures", 1.0)
        names = set(ranking(found).study.names)
        if is_leftover:
            names.update(each for each in checkpoint.names() if is_leftover(found, each))
        checkpoint.remove(names)
        return Saved(found, result, moved, further)

    def _sensitivity(
        self,
        ranking: Ranking,
        pool: int | Workers | None,
        report: Callable[[str, str, float], None],
    ) -> Sensitivity | None:
        from bayes_ssi.ranking.sensitivity import sensitivity

        if not self.sensitivity:
            return None
        return sensitivity(ranking, progress=partial(report, "sensitivity"), workers=pool)

    def end(self, saved: Saved[Any]) -> None:
        """Say how the ranking moves, where it was asked, and where the result is; then exit.

        The exit code is as the checks demand.
        """
        from bayes_ssi.tables import sensitivity_notes, sensitivity_table

        result = saved.result
        if saved.sensitivity is not None:
            console().print(sensitivity_table(saved.sensitivity))
            say(console(), *sensitivity_notes(saved.sensitivity))
        n_figures = len(list(_figures(result).iterdir()))
        say(console(), f"Saved in {result.directory}, with {n_figures} figures.")
        tell_record(lambda: _record(saved))
        failed = result.comparison.failed_checks
        if failed and not self.accept_failed_checks:
            if is_quiet():
                click.echo(f"(!) {len(failed)} failed checks: {'; '.join(failed)}", err=True)
            sys.exit(FAILED_CHECK)


def _print_performance_hints(study: Study) -> None:
    """Say before a long run where it need not be long, once for structures that are alike."""
    from bayes_ssi.finite_elements.reducible_structure import ReducibleStructure

    names_by_hint: dict[str, list[str]] = {}
    for candidate in study.model_classes:
        for configuration in candidate.configurations:
            structure = configuration.structure
            if isinstance(structure, ReducibleStructure) and structure.performance_hint:
                names = names_by_hint.setdefault(structure.performance_hint, [])
                names.append(repr(candidate.name))
    for hint, names in names_by_hint.items():
        click.echo(f"Slow: {', '.join(dict.fromkeys(names))}: {hint}", err=True)


def run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of :class:`SavedRun`, as one argument ``run``."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        own = {item.name: options.pop(item.name) for item in fields(SavedRun)}
        command(run=SavedRun(**own), **options)

    for option in (
        click.option("--accept-failed-checks", is_flag=True,
                     help="Exit with code 0 where checks failed; they are shown and saved all "
                     "the same."),
        click.option("--dask", metavar="ADDRESS",
                     help="Sample on a Dask cluster, by its scheduler's address."),
        click.option("--workers", type=click.IntRange(min=1), metavar="N",
                     help="Sample in N processes on this machine."),
        click.option("--sensitivity", is_flag=True,
                     help="Rank again with every setting halved and doubled: missed and spurious "
                     "modes, error sizes, widths of priors."),
        click.option("--overwrite", is_flag=True,
                     help="Replace a result, or an unfinished run, that exists."),
        click.option("--out", type=click.Path(path_type=Path),
                     help="Result directory; in runs/results if not given."),
        click.option("--economical", is_flag=True,
                     help="Sample with tens of times fewer evaluations, for models that take "
                     "long and posteriors of a few plain regions."),
        click.option("--error", "log_evidence_error", type=float, default=0.01,
                     show_default=True,
                     help="Wanted standard error of each log evidence, in nats."),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
                     help="The result follows from it."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return json_option(wrapped)


def _record(saved: Saved[Any]) -> dict[str, Any]:
    """What ``--json`` prints: the ranking, what was learnt, and where the result is."""
    result = saved.result
    record: dict[str, Any] = {
        "directory": str(result.directory),
        "study": result.record["study"],
        **asdict(result.comparison),
        "failed_checks": list(result.comparison.failed_checks),
        "not_distinguishable": list(result.comparison.not_distinguishable),
        "parameters": {
            posterior.name: [asdict(row) for row in posterior.summary]
            for posterior in result.ranked_posteriors
        },
        "pairings": {
            posterior.name: {modes.name: dict(modes.pairing) for modes in posterior.configurations}
            for posterior in result.ranked_posteriors
        },
    }
    for name, further in saved.further.items():
        record[name.removesuffix(".json")] = further
    return record


def notes_of(result: StoredResult, best_only: bool = False) -> list[str]:
    """What must be said beside a ranking's tables."""
    from bayes_ssi.tables import comparison_notes, pairing_notes, region_notes

    notes = comparison_notes(result.comparison)
    for posterior in result.ranked_posteriors[: 1 if best_only else None]:
        notes += [*pairing_notes(posterior), *region_notes(posterior)]
        notes += [f"{posterior.name!r}: {remark}." for remark in posterior.remarks]
    return notes


def _figures(result: StoredResult) -> Path:
    return result.directory / "figures"
