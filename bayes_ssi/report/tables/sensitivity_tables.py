"""How a ranking changes with settings."""

from __future__ import annotations

import math

from rich.table import Table

from bayes_ssi.report.tables.layout import add_row, new_table
from bayes_ssi.studies.ranking.comparison import probability_text
from bayes_ssi.studies.ranking.sensitivity import Sensitivity


def sensitivity_table(sensitivity: Sensitivity) -> Table:
    """Setting by setting, which class ranks first, and its lead in nats."""
    first = sensitivity.rows[0].best
    table = new_table(
        "Sensitivity to settings",
        ["setting", "most probable"],
        ["probability", "lead (nats)", f"probability of {first}"],
    )
    for row in sensitivity.rows:
        add_row(
            table,
            f"{row.name} (!)" if row.failed_checks else row.name,
            row.best,
            probability_text(row.probabilities[row.best]),
            "-" if math.isinf(row.lead) else f"{row.lead:.2f}",
            probability_text(row.probabilities[first]),
        )
    return table


def sensitivity_notes(sensitivity: Sensitivity) -> list[str]:
    """Whether the same class always ranks first, and which checks of resampled classes failed."""
    first = sensitivity.rows[0].best
    if sensitivity.turning:
        others = "; ".join(f"{row.best!r} does with {row.name}" for row in sensitivity.turning)
        notes = [f"{first!r} does not rank first under every setting: {others}."]
    else:
        notes = [f"{first!r} ranks first under every setting."]
    for row in sensitivity.rows:
        notes += [f"  (!) {row.name}: {check}" for check in row.failed_checks]
    return notes
