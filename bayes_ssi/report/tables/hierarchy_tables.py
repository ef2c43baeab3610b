"""Many tests of one structure: populations ranked, and what they say of the parameters."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.report.tables.layout import add_row, interval, new_table
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy
from bayes_ssi.studies.ranking.comparison import SCALE_NAME, probability_text


def populations_table(hierarchy: Hierarchy) -> Table:
    """Populations ranked by log evidence, the best first."""
    table = new_table(
        f"{hierarchy.model_class!r} in {len(hierarchy.tests)} tests: its parameters are or vary",
        ["parameters"],
        ["log evidence", "ln B", "probability"],
    )
    table.add_column("evidence against")
    for row in hierarchy.populations:
        add_row(
            table,
            f"{row.name} (!)" if row.failed_checks else row.name,
            f"{row.log_evidence:.2f} ± {row.error:.2f}",
            f"{row.log_bayes_factor:.2f}",
            probability_text(row.probability),
            row.against,
        )
    return table


def population_table(hierarchy: Hierarchy, covariate: float | None = None) -> Table:
    """The most probable population, and what the next test will give, parameter by parameter.

    Args:
        covariate: its value in the next test; the mean of the tests if None.
    """
    best, scale = hierarchy.best, hierarchy.covariate
    columns: dict[str, FloatArray] = {"centre": hierarchy.centres(best)}
    if best.population.follows and scale is not None:
        columns[f"change per unit of\n{scale.name}"] = hierarchy.slopes(best)
    if best.population.varies:
        columns["sd from\ntest to test"] = hierarchy.spreads(best)
    own = [parameter.name for parameter in hierarchy.parameters]
    chosen = [own.index(name) for name in hierarchy.names]
    columns["next test"] = hierarchy.next_test(covariate=covariate)[:, chosen]
    table = new_table(
        f"Population {best.name!r}; next test, all populations averaged: 90 % intervals",
        ["parameter"],
        list(columns),
    )
    for i, name in enumerate(hierarchy.names):
        quantiles = (np.quantile(draws[:, i], [0.05, 0.95]) for draws in columns.values())
        add_row(table, name, *(interval(low, high) for low, high in quantiles))
    return table


def hierarchy_notes(hierarchy: Hierarchy, covariate: float | None = None) -> list[str]:
    """Notes below the tables: the scale, the covariate, remarks, failed checks."""
    notes = [f"Evidence against: scale of {SCALE_NAME}."]
    scale = hierarchy.covariate
    if scale is not None:
        value = scale.mean if covariate is None else covariate
        notes.append(
            f"{scale.name}: {scale.mean:.4g} on average over the tests, standard deviation "
            f"{scale.sd:.3g}; centre at the average, next test at {value:.4g}."
        )
    notes += [f"Remark: {remark}." for remark in hierarchy.remarks]
    failed = hierarchy.all_failed_checks
    if failed:
        notes.append("Failed checks; do not trust the ranking until they are understood:")
        notes += [f"  (!) {check}" for check in failed]
    return notes
