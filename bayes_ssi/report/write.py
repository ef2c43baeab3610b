"""Writing the report of a stored result."""

from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.packages import versions
from bayes_ssi.results.result_files import new_directory, read_stored, require_new
from bayes_ssi.results.stored_result import load_result
from bayes_ssi.studies.planning.plan_record import SAVED, Plan

PAGE = "report.html"


@checked
def write_report(
    result: str | Path, directory: str | Path | None = None, *, overwrite: bool = False
) -> Path:
    """Write the report of a stored result as one HTML page that needs no other file.

    Nothing is sampled, and the study file is not needed.

    Args:
        result: the result directory.
        directory: where the report goes; ``report`` in the result directory if None.
        overwrite: replace a report that exists.

    Returns:
        The path of the page, ``report.html`` in the directory.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds no report.
        ValueError: it is not a result, is damaged, or was written by another version.
    """
    import jinja2

    from bayes_ssi.report.page_content import FILTERS, of_numbers, page_content
    from bayes_ssi.report.report_figures import draw_figures

    # Imported here, not at start-up: figures, tables and filters are needed for reports alone.
    from bayes_ssi.results.predictions.requested_predictions import load_saved_predictions

    stored = load_result(result)
    predictions = load_saved_predictions(stored.directory)
    saved = stored.directory / SAVED
    plan = read_stored(Plan, saved) if saved.is_file() else None
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
    environment.tests["of_numbers"] = of_numbers
    try:
        figures = draw_figures(stored, predictions, plan)
        template = environment.get_template(f"{PAGE}.j2")
        content = page_content(stored, predictions, figures, plan)
        page = template.render(content, page_versions=versions(), result=str(stored.directory))
    except (LookupError, TypeError, AttributeError, jinja2.UndefinedError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"{stored.directory}: incomplete or damaged result: {what}") from error
    with new_directory(directory, marker=PAGE, overwrite=overwrite) as partial:
        (partial / PAGE).write_text(page.rstrip() + "\n", encoding="utf-8")
    return directory / PAGE
