"""What all tables share: nothing is cropped, names are shown as they are."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, JustifyMethod, RenderResult
from rich.table import Column, Table
from rich.text import Text

# How tables fit a terminal; the saved result has what they leave out.
# Spaces between columns, where there is room and where there is not.
GAPS = (3, 2)
NARROWEST_COLUMN = 5  # width of a column for names; below it, a line holds less than a syllable
MOST_COLUMNS = 8  # of numbers, for which a terminal of 80 characters has room
MOST_HYPOTHESES = 8  # of a search that are listed, and ``MOST_PLACES``
MOST_PLACES = 8


class WholeTable(Table):
    """A table that crops nothing, whatever the width of the terminal.

    Names, in the text columns ahead of the first number, wrap at words. Numbers stay on one line:
    where the columns do not fit next to one another, the table continues below, with its names
    repeated. Only where not even one column fits next to the names are numbers folded.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        if self.title:  # as a paragraph: a table's own would wrap at the width of the table
            yield Text(str(self.title), style="table.title")
        for columns, gap in self._parts(options.max_width):
            padding = (0, 1, 0, gap - 2)  # and one space that the box draws
            part = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=padding)
            part.columns = columns
            part.rows = self.rows
            yield from part.__rich_console__(console, options)

    def _parts(self, width: int) -> Iterator[tuple[list[Column], int]]:
        """The columns of each part of the table with their widths, and the gap between them."""
        names = list(takewhile(lambda column: column.justify == "left", self.columns))
        others = self.columns[len(names) :]
        for gap in GAPS:
            if _needed(self.columns, width, gap) <= width:
                yield _fitted(self.columns, len(names), width, gap), gap
                return
        while others:
            n = 1
            while n < len(others) and _needed([*names, *others[: n + 1]], width, gap) <= width:
                n += 1
            yield _fitted([*names, *others[:n]], len(names), width, gap), gap
            others = others[n:]


def _fitted(columns: Sequence[Column], n_names: int, width: int, gap: int) -> list[Column]:
    """Columns with their widths: what they need, then more for names first, if there is room."""
    widths = [_least_width(column, width) for column in columns]
    room = width - _with_gaps(widths, gap)
    enough = [
        _longest("\n".join([str(column.header), *map(str, column.cells)]).splitlines())
        for column in columns
    ]
    for growing in (range(n_names), range(n_names, len(columns))):
        while room > 0 and (wrapped := [i for i in growing if widths[i] < enough[i]]):
            widths[min(wrapped, key=lambda i: widths[i])] += 1
            room -= 1
    for shrinking, least in ((range(n_names), NARROWEST_COLUMN), (range(len(columns)), 1)):
        while room < 0 and max((widths[i] for i in shrinking), default=0) > least:
            widths[max(shrinking, key=lambda i: widths[i])] -= 1
            room += 1
    numbered = enumerate(zip(columns, widths, strict=True))
    return [replace(column, width=each, _index=i) for i, (column, each) in numbered]


def _needed(columns: Sequence[Column], width: int, gap: int) -> int:
    return _with_gaps([_least_width(column, width) for column in columns], gap)


def _with_gaps(widths: Sequence[int], gap: int) -> int:
    return sum(widths) + gap * (len(widths) - 1) + 2  # and the edges


def _least_width(column: Column, width: int) -> int:
    """Width at which words are not folded, unless they take a quarter of the table's ``width``."""
    heading, cells = _longest(str(column.header).split()), list(map(str, column.cells))
    if column.justify == "right":
        return max(heading, _longest(line for cell in cells for line in cell.splitlines()))
    longest = max(heading, _longest(word for cell in cells for word in cell.split()))
    return min(longest, max(width // 4, NARROWEST_COLUMN))


def _longest(texts: Iterable[str]) -> int:
    return max(map(cell_len, texts), default=1)


def new_table(
    title: str,
    texts: Sequence[str],
    numbers: Sequence[str],
    rows: Iterable[Iterable[str]] = (),
    last: Sequence[str] = (),
) -> WholeTable:
    """A table: columns of words, which may wrap, numbers, which may not, and last words."""
    table = WholeTable(title=Text(title) if title else None)
    columns: list[tuple[Sequence[str], JustifyMethod]]
    columns = [(texts, "left"), (numbers, "right"), (last, "left")]
    for headings, justify in columns:
        for heading in headings:
            table.add_column(Text(heading), justify=justify, overflow="fold")
    for row in rows:
        add_row(table, *row)
    return table


def add_row(table: Table, *cells: str) -> None:
    """Add cells literally: names may hold square brackets, which rich takes for markup."""
    table.add_row(*(Text(cell) for cell in cells))


def marked(name: str, failed: object) -> str:
    """A name, with a sign where something failed."""
    return f"{name} (!)" if failed else name


def number(value: Any, form: str = ".4g") -> str:
    """A number, or its text, formatted; a dash for None, NaN and infinities. Zero has no sign."""
    if value is None or not math.isfinite(float(value)):
        return "-"
    text = format(float(value), form)
    return text.removeprefix("-") if float(text) == 0.0 else text


def digits(*values: float) -> list[str]:
    """Numbers to four significant digits."""
    return [f"{value:.4g}" for value in values]


def percent(fraction: float | None, form: str) -> str:
    return number(None if fraction is None else 100.0 * fraction, form)


def interval(low: float, high: float, form: str = ".4g") -> str:
    return f"{low:{form}} to {high:{form}}"
