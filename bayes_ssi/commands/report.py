"""``bayes-ssi report``: a stored result as an HTML page."""

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal


@click.command()
@options.result_argument
@options.path_option("--out", text="Directory of the report.  [default: RESULT/report]")
@options.flag("--overwrite", text="Replace an existing report.")
@terminal.json_option
def report(result: Path, out: Path | None, overwrite: bool) -> None:
    """Write a report of RESULT, a directory that rank or search saved.

    One HTML page that needs no other file: the question, the data, the ranking and what it
    means, every model class before and after updating, the checks, and how to reproduce it.
    Nothing is sampled, and the study file is not needed.
    """
    from bayes_ssi.report.write import write_report

    page = write_report(result, out, overwrite=overwrite)
    terminal.say(f"Report saved in {page}.")
    terminal.conclude({"page": str(page)})
