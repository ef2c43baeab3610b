"""The command line: ``bayes-ssi rank``, ``search``, ``calibrate`` and ``check``.

Exit codes: 0, all well; 2, an input is not usable, said in one line; 3, a result was computed and
saved but a check of it failed, unless that is accepted.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from rich.console import Console

    from bayes_ssi.results import StoredResult
    from bayes_ssi.search import AppendageSearch
    from bayes_ssi.study import Ranking, Study

__all__ = ["main"]

BAD_INPUT = 2
FAILED_CHECK = 3
RESULTS = Path("runs") / "results"
WIDTH = 80


class _OneLineErrors(click.Group):
    """A group whose usage errors, too, are one line, without the usage text before it."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        if not standalone_mode:
            return super().main(*args, standalone_mode=False, **extra)  # type: ignore[call-overload]
        try:
            code = super().main(*args, standalone_mode=False, **extra)  # type: ignore[call-overload]
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message(), err=True)
            sys.exit(BAD_INPUT)
        except click.ClickException as error:
            _fail(error.format_message())
        except click.Abort:
            click.echo("Interrupted.", err=True)
            sys.exit(1)
        sys.exit(code if isinstance(code, int) else 0)


@click.group(
    cls=_OneLineErrors,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="bayes_ssi")
def main() -> None:
    """Identified modes in, ranked model classes out."""


@dataclass(frozen=True)
class _Run:
    """Options that every command which samples has, and what they all do with them."""

    seed: int
    log_evidence_error: float
    out: Path | None
    overwrite: bool
    workers: int | None
    dask: str | None
    accept_failed_checks: bool

    def sample_and_save(
        self,
        study_file: Path,
        default: str,
        sample: Callable[..., _Found],
        study: Study,
        *options: object,
    ) -> tuple[_Found, StoredResult]:
        """Call ``sample(seed, settings, report, workers=, checkpoint=)`` and save its ranking.

        A run that was stopped goes on from its checkpoint beside the result directory. ``study``
        and ``options`` are what the result follows from, besides the seed and the settings.
        """
        from bayes_ssi.checkpoint import Checkpoint, name_of_run
        from bayes_ssi.results import require_new, save_result
        from bayes_ssi.sampling import SamplingSettings
        from bayes_ssi.workers import dask_workers

        if self.workers is not None and self.dask is not None:
            raise ValueError("--workers and --dask: give one of them")
        settings = SamplingSettings(log_evidence_error=self.log_evidence_error)
        directory = self.out or RESULTS / default
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
            _progress() as report,
        ):
            try:
                found = sample(self.seed, settings, report, workers=pool, checkpoint=checkpoint)
            except KeyboardInterrupt:
                click.echo("Stopped; the same command goes on from here.", err=True)
                raise
        require_new(directory, overwrite=overwrite)
        checkpoint.begin_saving()
        result = save_result(
            found.ranking,
            directory,
            study_file=str(study_file),
            overwrite=overwrite,
            accept_failed_checks=self.accept_failed_checks,
            extra=found.extra,
        )
        self._figures(result, found)
        checkpoint.remove(found.ranking.study.names)
        return found, result

    def _figures(self, result: StoredResult, found: _Found) -> None:
        from bayes_ssi.plots import save_figures

        directory = result.directory / "figures"
        save_figures(directory, result.tests, result.ranked_posteriors, result.comparison)
        if found.draw is not None:
            found.draw(directory)

    def end(self, result: StoredResult) -> None:
        """Say where the result is, and exit as its checks demand."""
        n_figures = len(list((result.directory / "figures").iterdir()))
        _say(_console(), f"Saved in {result.directory}, with {n_figures} figures.")
        if result.comparison.failed_checks and not self.accept_failed_checks:
            sys.exit(FAILED_CHECK)


@dataclass(frozen=True)
class _Found:
    """A ranking, further records to save with it, and a further figure to draw."""

    ranking: Ranking
    extra: Mapping[str, Any] = field(default_factory=dict)
    draw: Callable[[Path], object] | None = None


def _run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of :class:`_Run`, as one argument ``run``."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        own = {item.name: options.pop(item.name) for item in fields(_Run)}
        command(run=_Run(**own), **options)

    for option in (
        click.option("--accept-failed-checks", is_flag=True,
                     help="Exit with code 0 where checks failed; they are shown and saved all "
                     "the same."),
        click.option("--dask", metavar="ADDRESS",
                     help="Evaluate on a Dask cluster, by its scheduler's address."),
        click.option("--workers", type=click.IntRange(min=1), metavar="N",
                     help="Evaluate in N processes on this machine."),
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


@main.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--only", metavar="NAME,…", help="Rank only these model classes.")
@click.option("--any-pairing", is_flag=True,
              help="Infer which identified mode is which model mode; classes that differ in "
              "nothing else become one.")  # fmt: skip
@_run_options
def rank(study: Path, only: str | None, any_pairing: bool, run: _Run) -> None:
    """Sample every model class of STUDY, rank them by evidence, and save the result.

    A run that was stopped goes on when the same command is given again. Workers share the
    evaluations of one model, which pays where one takes milliseconds or more.
    """
    with _one_line_errors():
        from bayes_ssi.study import rank as rank_study

        loaded = _load(study, only)
        if any_pairing:
            loaded = loaded.with_any_pairing()
        loaded.require_same_data()

        def sample(*arguments: Any, **options: Any) -> _Found:
            return _Found(rank_study(loaded, *arguments, **options))

        _, result = run.sample_and_save(study, study.stem, sample, loaded, "rank")

        from bayes_ssi.tables import evidence_table, parameter_table, ranking_table

        console = _console()
        console.print(ranking_table(result.comparison, loaded.name))
        console.print(evidence_table(result.ranked_posteriors))
        console.print(parameter_table(result.ranked_posteriors[0]))
        _say(console, *_notes(result))
        run.end(result)


@main.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--baseline",
    metavar="NAME",
    help="Model class to hang appendages on; the study's first if not given.",
)
@click.option(
    "--mass-ratio",
    type=(float, float),
    metavar="MEDIAN COV",
    default=(0.05, 1.0),
    show_default=True,
    help="Lognormal prior of the mass that vibrates over the mean floor mass.",
)
@click.option(
    "--frequency",
    type=(float, float),
    metavar="LOW HIGH",
    help="Log-uniform prior of an appendage's frequency in Hz; from half the lowest "
    "identified frequency to the band's upper limit if not given.",
)
@click.option(
    "--most",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="Largest number of appendages at once.",
)
@_run_options
def search(
    study: Path,
    baseline: str | None,
    mass_ratio: tuple[float, float],
    frequency: tuple[float, float] | None,
    most: int,
    run: _Run,
) -> None:
    """Search for appendages that hide in the identified modes of STUDY.

    Hypotheses (no appendage; a pendulum on each floor; an infill in each storey; then two) are
    built on one model class, which should hold none itself, and ranked over all pairings of
    modes. Workers sample whole hypotheses side by side.
    """
    with _one_line_errors():
        from bayes_ssi.priors import LogNormal, LogUniform
        from bayes_ssi.search import SearchSettings, search_record
        from bayes_ssi.search import search as search_appendages

        loaded = _load(study, None)
        if baseline is not None:
            loaded = loaded.only([baseline])
        options = SearchSettings(
            mass_ratio=LogNormal(*mass_ratio),
            frequency=None if frequency is None else LogUniform(*frequency),
            number_weights=(1.0, 1.0, *(0.2**number for number in range(1, most))),
        )
        done: list[AppendageSearch] = []

        def sample(*arguments: Any, **more: Any) -> _Found:
            from bayes_ssi.plots import save_places

            found = search_appendages(loaded.model_classes[0], options, *arguments, **more)
            done.append(found)
            return _Found(
                found.ranking,
                {"search.json": search_record(found)},
                lambda directory: save_places(found, directory / "places.png"),
            )

        _, result = run.sample_and_save(
            study, f"{study.stem}_search", sample, loaded, "search", options
        )

        from bayes_ssi.tables import averaged_table, search_notes, search_table

        console = _console()
        console.print(search_table(done[0]))
        console.print(averaged_table(done[0]))
        _say(console, *search_notes(done[0]), *_notes(result, best_only=True))
        run.end(result)


def _notes(result: StoredResult, best_only: bool = False) -> list[str]:
    """What must be said beside a ranking's tables."""
    from bayes_ssi.tables import comparison_notes, pairing_notes, region_notes

    notes = comparison_notes(result.comparison)
    for posterior in result.ranked_posteriors[: 1 if best_only else None]:
        notes += [*pairing_notes(posterior), *region_notes(posterior)]
    return notes


def _say(console: Console, *lines: str) -> None:
    for line in lines:
        console.print(line, soft_wrap=True, markup=False, highlight=False)


@main.command()
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--only", metavar="NAME,…", help="Calibrate only these model classes.")
@click.option("--shape-weight", type=float,
              help="λ: weight of shapes relative to frequencies, 0 leaves them out; "
              "σ_f/σ_φ of the class's error model if not given.")  # fmt: skip
@click.option("--starts", type=int, default=64, show_default=True, help="Local searches.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
              help="Seed of the starts.")  # fmt: skip
def calibrate(
    study: Path, only: str | None, shape_weight: float | None, starts: int, seed: int
) -> None:
    """List every distinct minimum of the paper's objective for the model classes of STUDY."""
    with _one_line_errors():
        from bayes_ssi.calibration import NothingToCalibrateError
        from bayes_ssi.calibration import calibrate as calibrate_class
        from bayes_ssi.tables import calibration_modes_table, calibration_table

        console = _console()
        candidates = _load(study, only).model_classes
        for candidate in candidates:
            try:
                found = calibrate_class(candidate, shape_weight, n_starts=starts, seed=seed)
            except NothingToCalibrateError as error:
                if len(candidates) == 1:
                    raise
                console.print(f"(!) {error}", soft_wrap=True, markup=False, highlight=False)
                continue
            console.print(calibration_table(found))
            console.print(calibration_modes_table(found))
            if found.undetermined_directions:
                console.print(
                    f"(!) the data leave {found.undetermined_directions} direction(s) of the "
                    "parameters undetermined: minimum 1 is the point of a surface of equally "
                    "good ones that lies nearest to the prior median"
                )
            elif _is_not_unique([fit.objective for fit in found.minima]):
                console.print("(!) the fit is not unique: several minima are equally good")
            console.print()


@main.command()
@click.argument("data", type=click.Path(path_type=Path))
def check(data: Path) -> None:
    """Say what was read from the identified modes in DATA (CSV) and what is odd."""
    with _one_line_errors():
        from bayes_ssi.modal_csv import read_modal_csv
        from bayes_ssi.tables import modes_table

        read = read_modal_csv(data)
        low, high = read.data.band_hz
        console = _console()
        console.print(modes_table(read.data))
        sensors = ", ".join(read.data.sensors) or "none"
        remarks = [*read.remarks, *read.data.oddities()]
        for line in (
            f"Band: {low:g} to {high:g} Hz. Sensors: {sensors}. Digest: {read.data.digest}.",
            *(f"(!) {remark}" for remark in remarks),
            *([] if remarks else ["Nothing odd."]),
        ):
            console.print(line, soft_wrap=True, markup=False, highlight=False)


def _is_not_unique(objectives: list[float]) -> bool:
    """Whether the second minimum fits as well as the first, for any practical purpose."""
    return len(objectives) > 1 and objectives[1] <= 1.01 * objectives[0] + 1e-6


def _load(path: Path, only: str | None) -> Study:
    from bayes_ssi.study import load_study

    study = load_study(path)
    if only is None:
        return study
    if only in study.names:  # a name may itself hold commas
        return study.only([only])
    return study.only([name.strip() for name in only.split(",") if name.strip()])


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Bad input ends with one line on standard error and its own exit code."""
    try:
        yield
    except (ValueError, TypeError, OSError) as error:
        if type(error).__name__ == "LinAlgError":  # a ValueError, but no fault of the input's
            raise
        text = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            text = f"{error.filename}: {error.strerror}"
        _fail(text)


def _fail(text: str) -> NoReturn:
    click.echo(f"Error: {' '.join(text.split())}", err=True)
    sys.exit(BAD_INPUT)


def _console() -> Console:
    from rich.console import Console

    console = Console()
    # Piped output has no width of its own; tables are made for 80 columns.
    return console if console.is_terminal else Console(width=WIDTH)


# Share of a class's time at which each step of the sampling begins and ends.
STEPS = {
    "searches": (0.0, 0.1),
    "tempered start": (0.1, 0.45),
    "ensembles": (0.45, 0.9),
    "evidence": (0.9, 1.0),
}


@contextmanager
def _progress() -> Iterator[Callable[[str, str, float], None]]:
    """Progress bars on standard error, one a model class; a line each where it is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:

        def say(name: str, step: str, done: float) -> None:
            if step == "evidence" and done >= 1.0:
                click.echo(f"sampled {name}", err=True)

        yield say
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[step]}"),
        TimeElapsedColumn(),
        console=console,
    ) as progress:
        tasks: dict[str, TaskID] = {}

        def show(name: str, step: str, done: float) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=1.0, step="")
            begin, end = STEPS[step]
            progress.update(tasks[name], completed=begin + done * (end - begin), step=step)

        yield show
