"""What all tables share: at most 80 columns wide, names as they are."""

from __future__ import annotations

import math

from rich import box
from rich.table import Table
from rich.text import Text

__all__ = [
    "add_row",
    "new_table",
    "number",
]


def new_table(title: str) -> Table:
    return Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )


def add_row(table: Table, *cells: str) -> None:
    """Add cells as they are: names may hold square brackets, which rich takes for markup."""
    table.add_row(*(Text(cell) for cell in cells))


def number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else format(value, form)
