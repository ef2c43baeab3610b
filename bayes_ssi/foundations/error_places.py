"""Errors of a user's own code: at which rows of a batch, and where in the user's files."""

import sysconfig
import traceback
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
SENT = "<dynamic-code>"  # file of what cloudpickle sent, from its version 3.1.3 on


def rows_at_fault(
    function: Callable[[slice], T], n_rows: int
) -> Iterator[tuple[slice, T | Exception]]:
    """``function`` of all rows at once, or where it raises, of halves down to single rows.

    Yields:
        Rows in order, and what the function answered, or raised at a single row.
    """
    left = [slice(0, n_rows)]
    while left:
        rows = left.pop()
        try:
            answer = function(rows)
        except Exception as error:  # noqa: BLE001 - whatever a user's model may raise
            if rows.stop - rows.start <= 1:
                yield rows, error
            else:
                middle = (rows.start + rows.stop) // 2
                left += [slice(middle, rows.stop), slice(rows.start, middle)]
        else:
            yield rows, answer


def own_lines(error: BaseException) -> list[tuple[str, int]]:
    """(file, line) of the calls that led to the error, outermost first, in the user's own files.

    Those are the files outside this package, Python's library and installed packages.
    """
    return [
        (frame.name if frame.filename == SENT else frame.filename, frame.lineno)
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.lineno is not None and _is_own(frame.filename)
    ]


def with_place(error: BaseException) -> str:
    """An error in one line: its type and message, and the user's own line where it was raised.

    Of a function that was sent to another process the file may not be known; it is named instead.
    """
    lines = own_lines(error)
    place = f" ({Path(lines[-1][0]).name}, line {lines[-1][1]})" if lines else ""
    return " ".join(f"{type(error).__name__}: {error}{place}".split())


@cache
def _is_own(filename: str) -> bool:
    installed = (sysconfig.get_path(key) for key in ("stdlib", "purelib", "platlib"))
    roots = (Path(__file__).parents[1], *map(Path, installed))
    path = Path(filename)
    # Other code without a file has a name in angle brackets, too.
    is_installed = any(path.is_relative_to(root) for root in roots)
    return filename == SENT or (path.is_absolute() and not is_installed)
