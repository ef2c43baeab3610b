"""Commands that sample: their options, and a result that is saved even if they are stopped."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import click

from bayes_ssi.terminal import console, progress_bars, say

if TYPE_CHECKING:
    from bayes_ssi.results import StoredResult
    from bayes_ssi.sensitivity import Sensitivity
    from bayes_ssi.study import Ranking, Study
    from bayes_ssi.workers import Workers

__all__ = ["FAILED_CHECK", "Saved", "SavedRun", "notes_of", "run_options"]

FAILED_CHECK = 3
RESULTS = Path("runs") / "results"

T = TypeVar("T")


@dataclass(frozen=True)
class Saved(Generic[T]):
    """What was sampled, what was saved of it, and how its ranking moves, where it was asked."""

    found: T
    result: StoredResult
    sensitivity: Sensitivity | None


@dataclass(frozen=True)
class SavedRun:
    """Options that every command which samples has, and what they all do with them."""

    seed: int
    log_evidence_error: float
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
        from bayes_ssi.checkpoint import Checkpoint, name_of_run
        from bayes_ssi.plots import save_figures
        from bayes_ssi.results import require_new, save_result
        from bayes_ssi.sampling import SamplingSettings
        from bayes_ssi.sensitivity import sensitivity_record
        from bayes_ssi.workers import dask_workers

        if self.workers is not None and self.dask is not None:
            raise ValueError("--workers and --dask: give one of them")
        settings = SamplingSettings(log_evidence_error=self.log_evidence_error)
        directory = self.out or RESULTS / name
        checkpoint = Checkpoint(
            directory.with_name(f".{directory.name}.checkpoint"),
            run=name_of_run(study.model_classes, self.seed, settings, *options),
            discard_others=self.overwrite,
            say=lambda text: click.echo(text, err=True),
        )
        overwrite = self.overwrite or checkpoint.is_saving
        require_new(directory, overwrite=overwrite)
        with (
            nullcontext(self.workers) if self.dask is None else dask_workers(self.dask) as pool,
            progress_bars() as report,
        ):
            try:
                found = sample(self.seed, settings, report, workers=pool, checkpoint=checkpoint)
                moved = self._sensitivity(ranking(found), pool, report)
            except KeyboardInterrupt:
                click.echo("Stopped; the same command goes on from here.", err=True)
                raise
        further = dict(extra(found)) if extra else {}
        if moved is not None:
            further["sensitivity.json"] = sensitivity_record(moved)
        require_new(directory, overwrite=overwrite)
        checkpoint.begin_saving()
        result = save_result(
            ranking(found),
            directory,
            study_file=str(study_file),
            overwrite=overwrite,
            accept_failed_checks=self.accept_failed_checks,
            extra=further,
        )
        save_figures(_figures(result), result.tests, result.ranked_posteriors, result.comparison)
        if draw:
            draw(found, _figures(result))
        names = set(ranking(found).study.names)
        if is_leftover:
            names.update(each for each in checkpoint.names() if is_leftover(found, each))
        checkpoint.remove(names)
        return Saved(found, result, moved)

    def _sensitivity(
        self,
        ranking: Ranking,
        pool: int | Workers | None,
        report: Callable[[str, str, float], None],
    ) -> Sensitivity | None:
        from bayes_ssi.sensitivity import sensitivity

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
        if result.comparison.failed_checks and not self.accept_failed_checks:
            sys.exit(FAILED_CHECK)


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
                     help="Evaluate on a Dask cluster, by its scheduler's address."),
        click.option("--workers", type=click.IntRange(min=1), metavar="N",
                     help="Evaluate in N processes on this machine."),
        click.option("--sensitivity", is_flag=True,
                     help="Rank again with every setting halved and doubled: missed and spurious "
                     "modes, error sizes, widths of priors."),
        click.option("--overwrite", is_flag=True,
                     help="Replace a result, or an unfinished run, that exists."),
        click.option("--out", type=click.Path(path_type=Path),
                     help="Result directory; in runs/results if not given."),
        click.option("--error", "log_evidence_error", type=float, default=0.01,
                     show_default=True,
                     help="Wanted standard error of each log evidence, in nats."),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
                     help="The result follows from it."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


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
