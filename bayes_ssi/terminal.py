"""What the command line has of a terminal: errors in one line, tables, lines, and progress."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

import click

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["BAD_INPUT", "OneLineErrors", "console", "progress_bars", "say"]

BAD_INPUT = 2
WIDTH = 80
# Share of a class's time at which each step of the sampling begins and ends.
STEPS = {
    "searches": (0.0, 0.1),
    "tempered start": (0.1, 0.45),
    "ensembles": (0.45, 0.9),
    "evidence": (0.9, 1.0),
}


class OneLineErrors(click.Group):
    """A group whose errors, of its commands and of their usage, are one line and an exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        with _one_line_errors():
            return super().invoke(ctx)

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


def console() -> Console:
    """Where tables are printed."""
    from rich.console import Console

    made = Console()
    # Piped output has no width of its own; tables are made for 80 columns.
    return made if made.is_terminal else Console(width=WIDTH)


def say(where: Console, *lines: str) -> None:
    """Lines as they are, unbroken."""
    for line in lines:
        where.print(line, soft_wrap=True, markup=False, highlight=False)


@contextmanager
def progress_bars() -> Iterator[Callable[[str, str, float], None]]:
    """Progress bars on standard error, one a model class; a line each where it is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    stderr = Console(stderr=True)
    if not stderr.is_terminal:

        def tell(name: str, step: str, done: float) -> None:
            if step == "evidence" and done >= 1.0:
                click.echo(f"sampled {name}", err=True)

        yield tell
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[step]}"),
        TimeElapsedColumn(),
        console=stderr,
    ) as progress:
        tasks: dict[str, TaskID] = {}

        def show(name: str, step: str, done: float) -> None:
            if name not in tasks:
                tasks[name] = progress.add_task(name, total=1.0, step="")
            begin, end = STEPS.get(step, (0.0, 1.0))  # other steps are told as a whole
            progress.update(tasks[name], completed=begin + done * (end - begin), step=step)

        yield show
