"""Writing the report of a stored result."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.packages import versions
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.report.tables.layout import number
from bayes_ssi.results.result_files import new_directory, read_record, require_new
from bayes_ssi.results.stored_result import load_result
from bayes_ssi.results.wording import listed
from bayes_ssi.studies.planning.plan_record import SAVED, Plan
from bayes_ssi.studies.ranking.comparison import probability_text

MISSING = "-"
# Endings of a column's name in a CSV file, and other columns that hold numbers.
UNITS = {"_hz": "Hz", "_s": "s"}
NUMBERS = ("low", "median", "high", "share")


def interval(three: Sequence[Any] | None, digits: int = 4) -> str:
    """Median and ends of (low, median, high)."""
    if three is None:
        return MISSING
    low, median, high = (number(value, f".{digits}g") for value in three)
    return f"{median} ({low} to {high})"


def percent(fraction: Any, digits: int = 3) -> str:
    return MISSING if fraction is None else f"{number(100.0 * float(fraction), f'.{digits}g')} %"


def error_percent(model: Any, identified: float) -> str:
    """The relative error of a frequency, with its sign."""
    if model is None or not math.isfinite(float(model)):
        return MISSING
    error = round(100.0 * (float(model) / identified - 1.0), 1)
    return f"{error:+.1f} %" if error else "0.0 %"


def settings(given: SamplingSettings) -> str:
    """Settings in a line, without those that leave a choice to the sampling."""
    words = {True: "yes", False: "no"}
    return ", ".join(
        f"{key.replace('_', ' ')} {words[value] if isinstance(value, bool) else value}"
        for key, value in asdict(given).items()
        if value is not None
    )


def heading(name: str) -> str:
    """The heading of a CSV file's column in a table."""
    for ending, unit in UNITS.items():
        if name.endswith(ending):
            return f"{name.removesuffix(ending).replace('_', ' ')} ({unit})"
    return name.replace("_", " ")


def of_numbers(name: str) -> bool:
    """Whether a column of a predictions file holds numbers."""
    return name in NUMBERS or any(name.endswith(ending) for ending in UNITS)


FORMATS: tuple[Callable[..., Any], ...] = (
    number, interval, percent, error_percent, settings, heading
)  # fmt: skip
FILTERS = {form.__name__: form for form in FORMATS} | {
    "probability": probability_text,
    "names": listed,
}
PAGE = "report.html"


@checked
def write_report(
    result: str | Path,
    directory: str | Path | None = None,
    *,
    overwrite: bool = False,
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

    from bayes_ssi.report.page_content import page_content
    from bayes_ssi.report.report_figures import draw_figures

    # Imported here, not at start-up: figures, tables and filters are needed for reports alone.
    from bayes_ssi.results.predictions.prediction_files import load_saved_predictions
    from bayes_ssi.results.stored_what_if import every_setting

    stored = load_result(result)
    predictions = load_saved_predictions(stored.directory)
    saved = stored.directory / SAVED
    plan = read_record(Plan, saved) if saved.is_file() else None
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
        can_be_varied = all(each.sensor_shapes is not None for each in stored.posteriors)
        several = len(stored.posteriors) > 1
        sensitivity = every_setting(stored) if several and can_be_varied else None
        figures = draw_figures(stored, predictions, sensitivity, plan)
        page = environment.get_template(f"{PAGE}.j2").render(
            page_content(stored, predictions, sensitivity, figures, plan),
            page_versions=versions(),
            result=str(stored.directory),
        )
    except (LookupError, TypeError, AttributeError, jinja2.UndefinedError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"{stored.directory}: incomplete or damaged result: {what}") from error
    with new_directory(directory, marker=PAGE, overwrite=overwrite) as partial:
        (partial / PAGE).write_text(page.rstrip() + "\n", encoding="utf-8")
    return directory / PAGE
