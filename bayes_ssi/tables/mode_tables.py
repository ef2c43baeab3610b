"""Identified modes as they were read."""

from __future__ import annotations

import math

from rich.table import Table

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.tables.layout import add_row, new_table, number

__all__ = [
    "modes_table",
]


def modes_table(data: ModalData) -> Table:
    """The identified modes as they were read."""
    table = new_table(data.source)
    for heading in ("mode", "frequency Hz", "c.o.v. %", "damping %", "shape at", "phases °"):
        table.add_column(heading, justify="right")
    for mode in data.modes:
        of_all = f"{mode.n_measured} of {len(data.sensors)}"
        add_row(
            table,
            mode.label,
            f"{mode.frequency_hz:.5g}",
            number(_percent(mode.frequency_cov), ".3g"),
            number(_percent(mode.damping), ".3g"),
            of_all if mode.n_measured else "-",
            f"{mode.phase_scatter_deg:.1f}" if mode.n_measured else "-",
        )
    return table


def _percent(fraction: float | None) -> float:
    return math.nan if fraction is None else 100.0 * fraction
