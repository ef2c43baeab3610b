"""Output of commands: errors in one line, tables, lines, and progress.

With ``--quiet`` only errors are printed; with ``--json`` standard output is one JSON record, in
place of tables and lines, or an object with the key ``error``. Progress, errors, and what a study
prints go to standard error.
"""

from __future__ import annotations

import codecs
import functools
import io
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from time import monotonic
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


# Exit codes of commands that do not succeed.
OUTPUT_CLOSED = 1  # as rich has it
BAD_INPUT = 2
FAILED_CHECK = 3
INTERRUPTED = 130  # as shells have it: 128 + SIGINT

META = "bayes_ssi"
COMMAND_LINE, QUIET, JSON = f"{META}.command_line", f"{META}.quiet", f"{META}.json"
RECORD = f"{META}.record"
# Share of a class's time at which each step of the sampling begins and ends.
STEPS = {
    "searches": (0.0, 0.1),
    "compression of the prior": (0.1, 0.45),
    "ensembles": (0.45, 0.9),
    "evidence": (0.9, 1.0),
}
SAID_EVERY = 60.0  # seconds between lines of a log


class OneLineErrors(click.Group):
    """A group of commands that reports errors, also of usage, in one line with an exit code."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(self.commands)  # in their own order, where click would sort them

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[COMMAND_LINE] = shlex.join(["bayes-ssi", *args])
        return super().parse_args(ctx, args)

    def main(
        self, args: Sequence[str] | None = None, *others: Any, standalone_mode: bool = True,
        **named: Any,
    ) -> Any:  # fmt: skip
        run: Callable[[], Any] = functools.partial(
            super().main, args, *others, standalone_mode=False, **named
        )
        if not standalone_mode:
            return run()
        _accept_any_encoding()
        try:
            with _one_line_errors():
                code = run()
                click.echo(nl=False)  # what is still in the buffer
        except BrokenPipeError:  # its reader, such as head, has seen enough
            _discard_standard_output()
            sys.exit(OUTPUT_CLOSED)
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message(), err=True)
            sys.exit(BAD_INPUT)
        except click.ClickException as error:
            line = " ".join(error.format_message().split())
            if len(line) > 2000:  # whatever it repeats, it fits on a screen; choices are at its end
                line = f"{line[:1000]} … {line[-1000:]}"
            click.echo(f"Error: {line}", err=True)
            # Options may not have been parsed.
            if "--json" in (sys.argv[1:] if args is None else args):
                click.echo(json_text({"error": line}))
            sys.exit(BAD_INPUT)
        except click.Abort:
            click.echo("Interrupted.", err=True)
            sys.exit(INTERRUPTED)
        sys.exit(code if isinstance(code, int) else 0)


# What stands for a character that the encoding of an output lacks.
PLAIN = {
    "≈": "~", "±": "+/-", "×": "x", "σ": "sd", "ζ": "zeta", "φ": "phi", "ω": "omega", "√": "sqrt ",
    "²": "2", "³": "3", "⁻": "-", "…": "...", "–": "-", "─": "-", "━": "-", "≤": "<=", "≥": ">=",
    "→": "->", "°": " deg", "∠": " at ", "µ": "u", "μ": "u", "·": "*",
}  # fmt: skip


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(c, "?") for c in error.object[error.start : error.end]), error.end


def _accept_any_encoding() -> None:
    """Print on outputs of any encoding, also where standard error is closed."""
    codecs.register_error(META, _plain)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the exit
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=META)


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Turn errors of bad input into those that click reports."""
    try:
        yield
    except BrokenPipeError:
        raise
    except (ValueError, TypeError, OSError) as error:
        if type(error).__name__ == "LinAlgError":  # a ValueError, but no fault of the input's
            raise
        text = str(error)
        if type(error).__name__ == "ResultExistsError":
            text += " (--out, --overwrite)"
        if isinstance(error, OSError) and error.errno is not None:
            # An error of a file that has no name is one of standard output.
            text = f"{error.filename or 'output'}: {error.strerror}"
            if error.filename is None:
                _discard_standard_output()
        raise click.ClickException(text) from error


def command_line() -> str:
    """The command as it was given, quoted for a shell."""
    return str(_meta().get(COMMAND_LINE, "bayes-ssi"))


def is_quiet() -> bool:
    return bool(_meta().get(QUIET, False))


def _meta() -> dict[str, Any]:
    context = click.get_current_context(silent=True)
    return {} if context is None else context.meta


KEPT: dict[str, Any] = {
    "is_flag": True,
    "expose_value": False,
    "callback": lambda context, option, on: context.meta.update({f"{META}.{option.name}": on}),
}
QUIET_HELP = "Print nothing but errors, and the record of --json; the exit code says the rest."
QUIET_OPTION = click.Option(["--quiet"], help=QUIET_HELP, **KEPT)  # for any command


def json_option(command: Callable[..., None]) -> Callable[..., None]:
    """Add the option ``--json`` to a command that ends with :func:`conclude`."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        if not _meta().get(JSON, False):
            command(**options)
            return
        try:
            with _standard_output_on_standard_error():
                command(**options)
        finally:
            if RECORD in _meta():
                click.echo(_meta()[RECORD])

    return click.option("--json", help="Print one JSON record instead of tables.", **KEPT)(wrapped)


def _console() -> Console:
    from rich.console import Console

    if is_quiet() or _meta().get(JSON, False):
        return Console(quiet=True)
    made = Console()
    # Piped output has no width of its own, unless COLUMNS gives one.
    return made if made.is_terminal or "COLUMNS" in os.environ else Console(width=80)


def conclude(record: Mapping[str, Any], failed: Sequence[str] = ()) -> None:
    """Print the command's JSON record, if it is wanted, and exit by its failed checks."""
    if _meta().get(JSON, False):
        _meta()[RECORD] = json_text(record)
    if failed and is_quiet():
        several = "s" if len(failed) > 1 else ""
        click.echo(f"(!) {len(failed)} failed check{several}: {'; '.join(failed)}", err=True)
    if failed:
        sys.exit(FAILED_CHECK)


def show(*shown: RenderableType) -> None:
    """Print tables, or sentences wrapped at words."""
    for each in shown:
        _console().print(each)


def say_in_paragraphs(*paragraphs: str) -> None:
    """Print paragraphs, wrapped at words, with a blank line before each."""
    for paragraph in paragraphs:
        _console().print(f"\n{paragraph}", markup=False, highlight=False)


def say_warnings(warnings: Iterable[tuple[str, Sequence[str]]]) -> None:
    """Print sentences, and the items below them, of what to understand first."""
    for text, items in warnings:
        say_in_paragraphs("\n".join([f"(!) {text}", *(f"  {item}" for item in items)]))


def say(*lines: str) -> None:
    """Print lines without wrapping."""
    for line in lines:
        _console().print(line, soft_wrap=True, markup=False, highlight=False)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, str, float], None]]:
    """A function that reports progress on standard error, unless output is suppressed.

    A terminal shows a bar for each model class, other output lines of a log.
    """
    from rich.console import Console

    stderr = Console(stderr=True)
    if is_quiet():
        yield lambda *_: None
    elif stderr.is_terminal:
        with _bars(stderr) as show:
            yield show
    else:
        yield lines_of_progress()


def lines_of_progress(now: Callable[[], float] = monotonic) -> Callable[[str, str, float], None]:
    """Lines of a log: each class at its end, and every minute what is done and how long is left."""
    begun: dict[str, tuple[float, float]] = {}
    said = now()

    def show(name: str, step: str, done: float) -> None:
        nonlocal said
        begin, end = STEPS.get(step, (0.0, 1.0))
        share, what = begin + done * (end - begin), name if step in STEPS else f"{name}, {step}"
        first, before = begun.setdefault(what, (now(), share))
        if step == "evidence" and done >= 1.0:
            click.echo(f"sampled {name}", err=True)
        elif share > before and now() - said >= SAID_EVERY:
            said = now()
            minutes = (said - first) * (1.0 - share) / (share - before) / 60.0
            text = f"{what}: {100.0 * share:.0f} % done, about {minutes:.0f} min left"
            click.echo(text, err=True)

    return show


@contextmanager
def _bars(stderr: Console) -> Iterator[Callable[[str, str, float], None]]:
    from rich import progress as bars

    with bars.Progress(
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.TextColumn("{task.fields[step]}"),
        bars.TimeElapsedColumn(),
        bars.TextColumn("left"),
        # Steps differ in pace: estimate the time left from the whole run, not the last seconds.
        bars.TimeRemainingColumn(),
        console=stderr,
        speed_estimate_period=3600.0,
    ) as progress:
        tasks: dict[str, bars.TaskID] = {}

        def show(name: str, step: str, done: float) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=1.0, step="")
            begin, end = STEPS.get(step, (0.0, 1.0))  # other steps are all there is
            progress.update(tasks[name], completed=begin + done * (end - begin), step=step)

        yield show


@contextmanager
def _standard_output_on_standard_error() -> Iterator[None]:
    """Send to standard error what is printed: by Python, by libraries, and by new processes.

    Libraries write to the descriptor, which processes started here inherit.
    """
    if sys.stdout is not None:  # None where it is closed
        sys.stdout.flush()
    with redirect_stdout(sys.stderr), ExitStack() as at_end:
        # Some streams have no descriptor.
        with suppress(AttributeError, OSError, io.UnsupportedOperation):
            own, target = sys.__stdout__.fileno(), sys.__stderr__.fileno()  # type: ignore[union-attr]
            kept = os.dup(own)
            os.dup2(target, own)
            at_end.callback(os.close, kept)
            at_end.callback(os.dup2, kept, own)
            at_end.callback(sys.stderr.flush)
        yield


def _discard_standard_output() -> None:
    """Write to nowhere from now on: what is left in the buffer would fail again at the exit."""
    with suppress(AttributeError, OSError, io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def json_text(record: Mapping[str, Any]) -> str:
    """The record as JSON; infinities and NaN are text."""
    from bayes_ssi.foundations.codec import to_record

    return json.dumps(to_record(record), indent=2, allow_nan=False)
