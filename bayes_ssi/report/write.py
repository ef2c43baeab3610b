"""Writing the report of a stored result."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.versions import versions
from bayes_ssi.results.load import load_result
from bayes_ssi.results.new_directory import new_directory, require_new

PAGE = "report.html"


@checked
def write_report(
    result: str | Path,
    directory: str | Path | None = None,
    *,
    overwrite: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write the report of a stored result as one HTML page that needs no other file.

    Nothing is sampled, and the study file is not needed.

    Args:
        result: the result directory.
        directory: where the report goes; ``report`` in the result directory if None.
        overwrite: replace a report that exists.
        progress: called with the name of a step and the completed fraction of the work.

    Returns:
        The path of the page, ``report.html`` in the directory.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds no report.
        ValueError: it is not a result, is damaged, or was written by another version.
    """
    import jinja2

    from bayes_ssi.report.page_content import page_content
    from bayes_ssi.report.report_figures import draw_figures
    from bayes_ssi.report.template_filters import FILTERS, TESTS

    # Imported here, not at start-up: figures, tables and filters are needed for reports alone.
    from bayes_ssi.results.predictions.saved_predictions import load_saved_predictions

    def report(step: str, done: float) -> None:
        if progress is not None:
            progress(step, done)

    report("reading", 0.0)
    stored = load_result(result)
    predictions = load_saved_predictions(stored.directory)
    directory = Path(directory) if directory is not None else stored.directory / "report"
    require_new(directory, marker=PAGE, overwrite=overwrite)
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bayes_ssi", "report/templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(FILTERS)
    environment.tests.update(TESTS)
    try:
        report("figures", 0.1)
        figures = draw_figures(
            stored, predictions, lambda done: report("figures", 0.1 + 0.8 * done)
        )
        report("page", 0.9)
        page = environment.get_template(f"{PAGE}.j2").render(
            page_content(stored, predictions, figures),
            page_versions=versions(),
            result=str(stored.directory),
        )
    except (LookupError, TypeError, AttributeError, jinja2.UndefinedError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"{stored.directory}: incomplete or damaged result: {what}") from error
    with new_directory(directory, marker=PAGE, overwrite=overwrite) as partial:
        (partial / PAGE).write_text(page.rstrip() + "\n", encoding="utf-8")
    report("page", 1.0)
    return directory / PAGE
