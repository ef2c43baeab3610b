"""What all tables share: at most 80 columns wide, names as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

# Width of a terminal, and of a number with the space next to it, in characters.
TERMINAL, NUMBER = 80, 9


def new_table(title: str, texts: Sequence[str] = (), numbers: Sequence[str] = ()) -> Table:
    """An empty table with :func:`add_columns`."""
    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    add_columns(table, texts, numbers)
    return table


def add_columns(table: Table, texts: Sequence[str] = (), numbers: Sequence[str] = ()) -> None:
    """Add columns of words, which may wrap, and of numbers, which may not."""
    for heading in texts:
        table.add_column(Text(heading), overflow="fold")
    for heading in numbers:
        table.add_column(Text(heading), justify="right", no_wrap=True)


def add_row(table: Table, *cells: str) -> None:
    """Add cells literally: names may hold square brackets, which rich takes for markup."""
    table.add_row(*(Text(cell) for cell in cells))


def number(value: float | None, form: str) -> str:
    """A formatted number; a dash for None and NaN. Negative zero has no sign."""
    if value is None or math.isnan(value):
        return "-"
    text = format(value, form)
    return text.removeprefix("-") if float(text) == 0.0 else text


def interval(low: float, high: float, form: str = ".4g") -> str:
    return f"{low:{form}} to {high:{form}}"
