"""Text files of columns, as spreadsheets and other programs write them, and names of files."""

import codecs
import csv
import errno
import os
import re
import stat
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bayes_ssi.foundations.packages import optional_package


def file_stem(name: str) -> str:
    """The name with underscores for characters that a file system may not allow, if long cut."""
    # File systems allow 255 bytes, of which directories being written and endings take some.
    return re.sub(r"[^A-Za-z0-9._+-]+", "_", name)[:100].strip(".") or "unnamed"


def require_name(name: object, what: str) -> None:
    """Refuse what is no text, or a name that tables and files could not hold."""
    if not isinstance(name, str) or not name.strip():
        raise ValueError(f"{what} must be text and not empty, got {name!r}")
    if name != name.strip() or not name.isprintable():
        raise ValueError(
            f"{what} may not begin or end with a space, or hold a line break or tab, got {name!r}"
        )


def file_names(names: Iterable[str], suffix: str) -> dict[str, str]:
    """Name → file name; file names are unique even where case is ignored."""
    files: dict[str, str] = {}
    for name in names:
        stem = file_stem(name)
        taken = {file.lower() for file in files.values()}
        candidate, count = f"{stem}.{suffix}", 2
        while candidate.lower() in taken:
            candidate, count = f"{stem}_{count}.{suffix}", count + 1
        files[name] = candidate
    return files


# The first line in which a file states its delimiter, as Excel reads and writes it.
STATED_DELIMITER = re.compile(r'\s*"?sep=([,;\t])"?[,;\s]*?(?=\n|\Z)', re.IGNORECASE)

WORKBOOKS = (".xlsx", ".xlsm")


def require_regular_file(path: Path) -> None:
    """Refuse what can be opened but has no end of its own, such as a pipe or a device."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise ValueError(f"{path}: not a regular file, but a pipe or a device")


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Turn whatever a library raises of a damaged file into one line that names the file."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or "no reason given"
        raise ValueError(
            f"{path}: cannot be read; damaged or truncated? {type(error).__name__}: {reason}"
        ) from error


def first_bytes(path: Path) -> bytes:
    """The beginning of a file, by which formats are recognised."""
    require_regular_file(path)
    with path.open("rb") as file:
        return file.read(8192)


def read_columns(path: Path, sheet: str | int = 0) -> tuple[str, str | None]:
    """The text of a file of columns, and the delimiter that it states, None where it states none.

    Text is in UTF-8, in UTF-16 with its mark, or else in Windows' Latin alphabet. Of a workbook
    (.xlsx), a sheet is the text. A first line such as ``sep=;`` is blank, so that the numbers of
    the others stay the same.
    """
    require_regular_file(path)
    if path.suffix.lower() in WORKBOOKS:
        return _sheet_text(path, sheet), ","
    content, text = path.read_bytes(), "\0"
    marked = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    for encoding in ("latin-1", "cp1252", "utf-16" if marked else "utf-8-sig"):
        with suppress(UnicodeDecodeError):
            text = content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
    if "\0" in text:
        raise ValueError(f"{path}: not a text file; save it as CSV (UTF-8), unpacked")
    if not text.strip():
        raise ValueError(f"{path}: the file is empty, and holds no samples or modes")
    if text.lstrip()[:1] == "<":
        raise ValueError(f"{path}: a web page or XML, not a table; save it as CSV (UTF-8)")
    stated = STATED_DELIMITER.match(text)
    if stated is None:
        return text, None
    return "\n" * stated[0].count("\n") + text[stated.end() :], stated[1]


def sheet_names(path: Path) -> list[str]:
    """The sheets of a workbook, in their order."""
    import pandas as pd

    with optional_package("openpyxl", extra="xlsx"):
        import openpyxl  # noqa: F401 - pandas reads with it
    with damage_named(path), _no_remarks_on_styles(), pd.ExcelFile(path, "openpyxl") as book:
        return [str(name) for name in book.sheet_names]


@contextmanager
def _no_remarks_on_styles() -> Iterator[None]:
    """Within it openpyxl does not warn of styles, which other programs leave out."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=UserWarning, module="openpyxl")
        yield


def _sheet_text(path: Path, sheet: str | int) -> str:
    """A sheet of a workbook as CSV."""
    import pandas as pd

    names = sheet_names(path)
    if sheet not in (0, *names):
        raise ValueError(f"{path}: no sheet {sheet!r}; choose from {', '.join(map(repr, names))}")
    with damage_named(path), _no_remarks_on_styles():
        cells = pd.read_excel(path, sheet, header=None, dtype=object, engine="openpyxl")
    return str(cells.to_csv(header=False, index=False, lineterminator="\n"))


def read_table(path: Path) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """A CSV file with a heading: names of the columns; file and line of each row, and its cells.

    Empty rows, and those that begin with ``#``, are left out.
    """
    text, delimiter = read_columns(path)
    reader = csv.reader(text.splitlines(), delimiter=delimiter or ",", skipinitialspace=True)
    numbered = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    lines = [(f"{path}, line {n}", row) for n, row in numbered if any(row) and row[0][:1] != "#"]
    return (lines[0][1], lines[1:]) if lines else ([], [])
