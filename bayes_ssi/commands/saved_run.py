"""Commands that sample: their options, checkpoints, and saving of the result."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns

if TYPE_CHECKING:
    from rich.console import RenderableType

    from bayes_ssi.inference.model_class.model_class import ModelClass
    from bayes_ssi.inference.sampling.settings import SamplingSettings
    from bayes_ssi.inference.workers.run import Checkpoint, Run
    from bayes_ssi.inference.workers.workers import Workers
    from bayes_ssi.results.stored_result import StoredResult
    from bayes_ssi.studies.ranking.study import Ranking, Study
    from bayes_ssi.studies.search.family import Family
    from bayes_ssi.studies.search.findings import FamilyRecord

RESULTS = Path("runs") / "results"


# What is sampled within a run: its ranking, and further records by the names of their files.
Sample = Callable[["Run"], tuple["Ranking", Mapping[str, Any]]]
# Those of a result, and notes, in the order in which they are read.
Tables = Callable[["StoredResult"], Iterable["RenderableType"]]


@dataclass(frozen=True)
class RunOptions:
    """Options of every command that samples, and what these commands have in common."""

    seed: int
    log_evidence_error: float
    economical: bool
    out: Path | None
    overwrite: bool
    workers: int | None
    accept_failed_checks: bool
    verbose: bool

    @property
    def settings(self) -> SamplingSettings:
        from bayes_ssi.inference.sampling.settings import SamplingSettings

        return SamplingSettings(
            log_evidence_error=self.log_evidence_error, economical=self.economical
        )

    def answer(
        self, study: Study, study_file: Path, name: str, sample: Sample, first: Tables,
        others: Tables, n_classes: int | None = None,
    ) -> None:  # fmt: skip
        """Sample a study or resume its run, save what was found, print it and exit.

        Printed are failed checks, the answer and the first tables; the others if wanted.

        Args:
            name: of the result directory.
            n_classes: number of classes that are sampled, at least; the study's by default.

        The exit code says whether a check failed that was not accepted.
        """
        from bayes_ssi.results.answer import answer as say_answer

        directory = RESULTS / name if self.out is None else self.out
        checkpoint = self._checkpoint(directory)
        with self._running(study, checkpoint, n_classes) as run:
            ranking, records = sample(run)
            result = self._save(ranking, records, study_file, directory, run)
        # Also what an earlier run sampled and this one did not.
        checkpoint.remove()
        answered = say_answer(result)
        terminal.say_warnings(answered.warnings)
        terminal.say_in_paragraphs(*answered.paragraphs)
        terminal.say(*(line for command in answered.commands for line in ("", command)), "")
        terminal.show(*first(result))
        # Sensors that measured nothing, by each test.
        identifications = (one for data in result.tests.values() for one in data.identifications)
        terminal.say(*(f"(!) {text}." for one in identifications for text in one.said_of_sensors))
        if self.verbose:
            terminal.say_in_paragraphs(*answered.further)
            for each in (*others(result), *_notes(result)):
                if isinstance(each, str):
                    terminal.say(each)
                else:
                    terminal.show(each)
        terminal.say(
            f"Saved in {result.directory}. Everything, with figures, on one page:",
            f"bayes-ssi report {shlex.quote(str(result.directory))}",
        )
        failed = () if self.accept_failed_checks else result.comparison.failed_checks
        terminal.conclude(
            _json_record(result, (*answered.paragraphs, *answered.further), records), failed
        )

    def _checkpoint(self, directory: Path) -> Checkpoint:
        """That of a run with this result; no other run may write there now."""
        from bayes_ssi.inference.workers.run import Checkpoint
        from bayes_ssi.results.result_files import require_new, sibling
        from bayes_ssi.results.stored_result import MARKER

        require_new(directory, marker=MARKER, overwrite=self.overwrite)
        checkpoint = Checkpoint(sibling(directory, "checkpoint"))
        is_resumed = click.get_current_context().with_resource(checkpoint.locked())
        if is_resumed and not terminal.is_quiet():
            words = "an earlier run was interrupted; it is resumed as far as it was the same"
            click.echo(words, err=True)
        return checkpoint

    @contextmanager
    def _running(
        self, study: Study, checkpoint: Checkpoint, n_classes: int | None
    ) -> Iterator[Run]:
        """The workers, the checkpoint and the progress bars to sample and save a study with."""
        from bayes_ssi.inference.workers.run import Run

        workers = self._workers(study.model_classes, n_classes or len(study.model_classes))
        if not self.economical and not terminal.is_quiet():
            _print_performance_hints(study)
        try:
            # Workers begin first: the progress bars have a thread of their own.
            with workers or nullcontext(), terminal.progress_bars() as progress:
                yield Run(workers, checkpoint, progress)
        except OSError as error:  # of a file, such as one on a full disk
            if error.errno is None:
                raise
            advice = f"{error.strerror}; no evaluation is lost, the same command resumes the run"
            raise OSError(error.errno, advice, error.filename) from error
        except KeyboardInterrupt:  # below the progress bars, which have ended
            click.echo(f"Interrupted; resume with: {terminal.command_line()}", err=True)
            sys.exit(terminal.INTERRUPTED)

    def _workers(self, candidates: Sequence[ModelClass], n_classes: int) -> Workers | None:
        from bayes_ssi.inference.workers.workers import usable_cores
        from bayes_ssi.studies.ranking.class_sampling import automatic_workers, chosen_workers

        if self.workers is None:
            return automatic_workers(candidates, n_classes)
        if self.workers == 1:
            return None
        n_cores = usable_cores()
        if self.workers > n_cores and not terminal.is_quiet():
            click.echo(
                f"--workers {self.workers}: reduced to {n_cores}, the number of cores that can be "
                "used; more processes would only wait for one another.",
                err=True,
            )
        return chosen_workers(candidates, self.workers)

    def _save(
        self, ranking: Ranking, records: Mapping[str, Any], study_file: Path, directory: Path,
        run: Run,
    ) -> StoredResult:  # fmt: skip
        from bayes_ssi.plots.moving_shapes import save_scenes
        from bayes_ssi.results.stored_result import save_result

        run.report("saving", "result", 0.0)
        # The path is relative only where the result, too, is below where the command began.
        below = directory.absolute().is_relative_to(Path.cwd())
        result = save_result(
            ranking,
            directory,
            study_file=str(study_file if below else study_file.absolute()),
            overwrite=self.overwrite,
            accept_failed_checks=self.accept_failed_checks,
            command=terminal.command_line(),
            extra=records,
            figures=partial(save_scenes, ranking),
        )
        run.report("saving", "result", 1.0)
        return result

    def search(
        self, study: Study, study_file: Path, kind: str, family: Family[Any],
        findings: Callable[..., FamilyRecord],
    ) -> None:  # fmt: skip
        """Search a family of hypotheses, save what was found, print it and exit."""
        from bayes_ssi.report.tables.search_tables import first_tables, further_tables
        from bayes_ssi.results.stored_result import SEARCH
        from bayes_ssi.studies.questions import searched

        def sample(run: Run) -> tuple[Ranking, Mapping[str, Any]]:
            result = searched(family, findings, self.seed, self.settings, run)
            return result.ranking, {SEARCH: result.record}

        name, of_one = f"{study_file.stem}_{kind}", family.features.values()
        n_classes = sum(1 + len(features) for features in of_one)
        self.answer(study, study_file, name, sample, first_tables, further_tables, n_classes)


def run_options(command: options.Command, error: float = 0.01) -> options.Command:
    """The command with the options of :class:`RunOptions`, as one argument ``sampling``.

    ``error`` is the wanted standard error of log evidences by default, in nats.
    """
    own: dict[str, options.Decorator] = {
        "seed": options.seed_option("The result follows from it."),
        "log_evidence_error": click.option(
            "--error", "log_evidence_error", type=float, default=error, show_default=True,
            help="Wanted standard error of each log evidence, in nats."),
        "economical": options.flag(
            "--economical", text="Emulate the modes of slow models from some hundred solutions, "
            "hundreds of times fewer."),
        "out": options.path_option("--out", text="Result directory; in runs/results if not given."),
        "overwrite": options.flag(
            "--overwrite", text="Replace a result that exists."),
        "workers": click.option(
            "--workers", type=click.IntRange(min=1), metavar="N",
            help="Sample in N processes on this machine, at most one for each core. If not given: "
            "one for each core that has a class to sample, but only this process where a model is "
            "a user's own function or class of structure, or a single small one."),
        "verbose": options.flag("--verbose", text="Print all tables and notes."),
        "accept_failed_checks": options.flag(
            "--accept-failed-checks", text="Exit with code 0 where checks failed; they are shown "
            "and saved all the same."),
    }  # fmt: skip
    return terminal.json_option(options.gathered(command, "sampling", RunOptions, own))


def _print_performance_hints(study: Study) -> None:
    """Say what nothing holds, and advise how to shorten a long run, once for each of a kind."""
    names_by_hint: dict[tuple[str, str], list[str]] = {}
    for candidate in study.model_classes:
        for configuration in candidate.configurations:
            structure = configuration.structure
            free = ""
            if n := structure.n_rigid_modes:
                modes = f"{n} rigid-body mode{'s' if n > 1 else ''}"
                free = f"{modes} left out; mode 1 is the first that deforms"
            for hint in (("Slow", structure.performance_hint), ("No support", free)):
                if hint[1]:
                    names_by_hint.setdefault(hint, []).append(repr(candidate.name))
    for (what, words), names in names_by_hint.items():
        click.echo(f"{what}: {', '.join(dict.fromkeys(names))}: {words}", err=True)


def _json_record(
    result: StoredResult, paragraphs: Sequence[str], records: Mapping[str, Any]
) -> dict[str, Any]:
    return {
        "directory": str(result.directory),
        "study": result.record.study,
        "answer": paragraphs,
        **columns(result.comparison),
        "failed_checks": list(result.comparison.failed_checks),
        "not_distinguishable": list(result.comparison.not_distinguishable),
        "parameters": {posterior.name: posterior.summary for posterior in result.ranked_posteriors},
        "adequacy": {posterior.name: posterior.adequacy for posterior in result.ranked_posteriors},
        "pairings": {
            posterior.name: {modes.name: dict(modes.pairing) for modes in posterior.configurations}
            for posterior in result.ranked_posteriors
        },
        **{Path(file).stem: record for file, record in records.items()},
    }


def _notes(result: StoredResult) -> list[str]:
    from bayes_ssi.report.tables.ranking_tables import comparison_notes, pairing_notes, region_notes

    of_search = result.search is not None
    notes = comparison_notes(result.comparison, with_scales=not of_search)
    for posterior in result.ranked_posteriors[: 1 if of_search else None]:
        for heading, items in (*pairing_notes(posterior), *region_notes(posterior)):
            notes += [heading, *(f"  {item}" for item in items)]
        notes += [f"{posterior.name!r}: {remark}." for remark in posterior.remarks]
    return notes
