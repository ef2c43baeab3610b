"""What follows from stored results: predictions, and populations of many tests."""

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.report.tables.layout import digits, interval, marked, new_table
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy
from bayes_ssi.results.predictions.requested_predictions import ResponseBands
from bayes_ssi.studies.ranking.comparison import SCALE_NAME, probability_text


def frequency_table(responses: Sequence[ResponseBands]) -> Table:
    """Frequency of every identified mode before and after updating, median and band.

    Where only some of the averaged classes explain a mode, the fraction of such draws is given.
    """
    rows = [(response.name, mode) for response in responses for mode in response.modes]
    with_fractions = any(mode.share < 1.0 for _, mode in rows)
    cells = [
        (
            name,
            mode.label,
            f"{mode.identified_hz:.5g}",
            *digits(mode.before_hz, float(mode.after_hz[1])),
            interval(float(mode.after_hz[0]), float(mode.after_hz[2])),
            *[f"{100 * mode.share:.3g} %"] * with_fractions,
        )
        for name, mode in rows
    ]
    title = "Natural frequencies (Hz) before and after updating, 90 % band"
    headings = ["identified", "before", "median", "band", *["of draws"] * with_fractions]
    return new_table(title, ["model class", "mode"], headings, cells)


def peak_table(responses: Sequence[ResponseBands]) -> Table:
    """Peaks of transfer functions and of time histories at every place, median and band."""
    request = responses[0].request
    title = f"Peak {request.output.quantity}, absolute value, 90 % band"
    rows = [
        (response.name, motion or "transfer", place, f"{median:.4g}", interval(low, high), unit)
        for response in responses
        for motion, unit, place, low, median, high in response.peak_rows()
    ]
    return new_table(title, ["model class", "of", "place"], ["median", "band", "unit"], rows)


def populations_table(hierarchy: Hierarchy) -> Table:
    title = f"{hierarchy.model_class!r} in {len(hierarchy.tests)} tests: its parameters are or vary"
    numbers = ["log evidence", "ln B", "probability"]
    rows = [
        (
            marked(row.name, row.failed_checks),
            f"{row.log_evidence:.2f} ± {row.error:.2f}",
            f"{row.log_bayes_factor:.2f}",
            probability_text(row.probability),
            row.against,
        )
        for row in hierarchy.populations
    ]
    return new_table(title, ["parameters"], numbers, rows, last=["evidence against"])


def population_table(hierarchy: Hierarchy, covariate: float | None = None) -> Table:
    """The most probable population, and what the next test will give, parameter by parameter."""
    best, scale = hierarchy.best, hierarchy.covariate
    columns: dict[str, FloatArray] = {"centre": hierarchy.centres(best)}
    if best.population.follows and scale is not None:
        columns[f"change per unit of\n{scale.name}"] = hierarchy.slopes(best)
    if best.population.varies:
        columns["sd from\ntest to test"] = hierarchy.spreads(best)
    columns["next test"] = hierarchy.next_test(covariate=covariate)[:, hierarchy.population_columns]
    ends = [np.quantile(draws, [0.05, 0.95], axis=0).T for draws in columns.values()]
    rows = [
        [name, *(interval(*of_column[i]) for of_column in ends)]
        for i, name in enumerate(hierarchy.names)
    ]
    title = f"Population {best.name!r}; next test, all populations averaged: 90 % intervals"
    return new_table(title, ["parameter"], list(columns), rows)


def hierarchy_notes(hierarchy: Hierarchy, covariate: float | None = None) -> list[str]:
    notes = [f"Evidence against: scale of {SCALE_NAME}."]
    if (scale := hierarchy.covariate) is not None:
        value = scale.mean if covariate is None else covariate
        notes.append(
            f"{scale.name}: {scale.mean:.4g} on average over the tests, standard deviation "
            f"{scale.sd:.3g}; centre at the average, next test at {value:.4g}."
        )
    notes += [f"Remark: {remark}." for remark in hierarchy.remarks]
    if failed := hierarchy.all_failed_checks:
        notes.append("Failed checks; do not trust the ranking until they are understood:")
        notes += [f"  (!) {check}" for check in failed]
    return notes
