"""``bayes-ssi report``: a stored result as an HTML page."""

from pathlib import Path

import click

from bayes_ssi.commands.options import flag, path_option, result_argument
from bayes_ssi.commands.terminal import json_option, print_record, say


@click.command()
@result_argument
@path_option("--out", text="Directory of the report.  [default: RESULT/report]")
@flag("--overwrite", text="Replace an existing report.")
@json_option
def report(result: Path, out: Path | None, overwrite: bool) -> None:
    """Write a report of RESULT, a directory that rank or search saved.

    One HTML page that needs no other file: the question, the data, the ranking and what it
    means, every model class before and after updating, the checks, and how to reproduce it.
    Nothing is sampled, and the study file is not needed.
    """
    from bayes_ssi.report.write import write_report

    page = write_report(result, out, overwrite=overwrite)
    print_record(lambda: {"page": str(page)})
    say(f"Report saved in {page}.")
