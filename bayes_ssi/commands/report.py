"""``bayes-ssi report``: a stored result as a page that people read."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import click

from bayes_ssi.commands.terminal import console, json_option, progress_bars, say, tell_record

__all__ = ["report"]


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Where to write the report; 'report' in RESULT if not given.",
)
@click.option("--overwrite", is_flag=True, help="Replace a report that exists.")
@json_option
def report(result: Path, out: Path | None, overwrite: bool) -> None:
    """Write a report of RESULT, a directory that rank or search saved.

    One HTML page that needs nothing else, and the same in Markdown: the question, the data, the
    ranking and what it means, every model class before and after updating, the checks, and how
    to reproduce it. Nothing is sampled; the study file is not needed.
    """
    from bayes_ssi.report import write_report

    with progress_bars() as tell, _nothing_collected():
        written = write_report(result, out, overwrite=overwrite, progress=partial(tell, "report"))
    tell_record(
        lambda: {
            "page": str(written.page), "twin": str(written.twin), "figures": written.n_figures
        }
    )  # fmt: skip
    say(console(), f"Written: {written.page} and {written.twin}, with {written.n_figures} figures.")


@contextmanager
def _nothing_collected() -> Iterator[None]:
    """Without the search for cycles of objects, a tenth of the time that figures take to draw."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()
