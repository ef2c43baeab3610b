"""Numbers in the lines of a text file, read fast, and refused with the line that is wrong."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_regular_file


def read_number_lines(
    path: Path, columns: str, *, delimiter: str | None = None, skip: int = 0, comment: str = ""
) -> FloatArray:
    """The numbers of a file that has the same columns in every line.

    Args:
        delimiter: between numbers; white space if None.

    Returns:
        (number of lines, number of columns).
    """
    require_whole_lines(path)
    width = columns.count(",") + 1
    load = partial(
        np.loadtxt, comments=comment or None, delimiter=delimiter, skiprows=skip, ndmin=2
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
        try:
            try:
                numbers = load(path)
            except ValueError:  # Fortran's exponents, as in 1.0D+06
                with path.open(encoding="ascii") as file:
                    numbers = load(line.replace("D", "E").replace("d", "e") for line in file)
        except ValueError:
            numbers = np.empty((0, 0))
    if numbers.shape[1] == width and np.isfinite(numbers).all():
        return numbers
    for number, fields in _fields(path, delimiter, skip, comment):
        if len(fields) != width or not all(map(_is_finite, fields)):
            shown = " ".join(" ".join(fields).split())
            raise ValueError(
                f"{path}: line {number}: expected {columns}, got {shown:.60}"
            ) from None
    raise ValueError(f"{path}: no line of numbers ({columns}); truncated?")


def require_whole_lines(path: Path) -> None:
    """Refuse a file whose last line does not end: its last number may be cut off."""
    require_regular_file(path)
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size == 0:
            raise ValueError(f"{path}: the file is empty")
        file.seek(-1, 2)
        if file.read(1) in b"\r\n\x1a":  # DOS ends files with the last of these
            return
    raise ValueError(f"{path}: ends within a line, whose last number may be cut off: truncated?")


def _fields(
    path: Path, delimiter: str | None, skip: int, comment: str
) -> Iterator[tuple[int, list[str]]]:
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if number > skip and text and not (comment and text.startswith(comment)):
                yield number, text.split(delimiter)


def _is_finite(field: str) -> bool:
    try:
        return bool(np.isfinite(float(field.replace("D", "E").replace("d", "e"))))
    except ValueError:
        return False
