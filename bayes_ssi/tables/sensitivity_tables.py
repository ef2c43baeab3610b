"""How a ranking moves with settings."""

from __future__ import annotations

import math

from rich.table import Table

from bayes_ssi.ranking.comparison import probability_text
from bayes_ssi.ranking.sensitivity import Sensitivity
from bayes_ssi.tables.layout import add_row, new_table

__all__ = ["sensitivity_notes", "sensitivity_table"]


def sensitivity_table(found: Sensitivity) -> Table:
    """A line a setting: what comes first then, and by how much."""
    first = found.rows[0].best
    table = new_table("If settings were others")
    table.add_column("setting", no_wrap=True)
    table.add_column("most probable", overflow="fold")
    table.add_column("probability", justify="right", no_wrap=True)
    table.add_column("nats ahead", justify="right", no_wrap=True)
    table.add_column(f"of {first}", justify="right")
    for row in found.rows:
        add_row(
            table,
            f"{row.name} (!)" if row.failed_checks else row.name,
            row.best,
            probability_text(row.probabilities[row.best]),
            "-" if math.isinf(row.lead) else f"{row.lead:.2f}",
            probability_text(row.probabilities[first]),
        )
    return table


def sensitivity_notes(found: Sensitivity) -> list[str]:
    """Whether the ranking stands, and which checks failed where classes were sampled anew."""
    first = found.rows[0].best
    if found.turning:
        told = "; ".join(f"{row.best!r} with {row.name}" for row in found.turning)
        notes = [f"{first!r} does not come first under every setting: {told}."]
    else:
        notes = [f"{first!r} comes first under every setting."]
    for row in found.rows:
        notes += [f"  (!) {row.name}: {check}" for check in row.failed_checks]
    return notes
