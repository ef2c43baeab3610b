"""Whether a table shows every cell, whatever the width of the terminal; and tables in files."""

import csv
import io
import re

from rich.console import Console


def printed(table, width=80):
    """The lines of a table on a terminal of this width, without spaces at their ends."""
    file = io.StringIO()
    Console(file=file, width=width).print(table)
    return [line.rstrip() for line in file.getvalue().splitlines()]


def rows_of_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def assert_every_cell_is_whole(table, width):
    shown = printed(table, width)
    assert max(map(len, shown)) <= width
    text = "\n".join(shown)
    squeezed = re.sub(r"\s", "", text)
    for column in table.columns:
        for cell in map(str, column.cells):
            if column.justify == "right":  # a number, on one line
                assert cell in text
            else:
                assert all(word[:15] in squeezed for word in cell.split())
        assert all(word in squeezed for word in str(column.header).split())
