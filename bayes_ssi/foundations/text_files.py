"""Text files of columns, as spreadsheets and other programs write them, and names of files."""

import csv
import errno
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


def file_stem(name: str) -> str:
    """The name with underscores for characters that a file system may not allow, if long cut."""
    # File systems allow 255 bytes, of which directories being written and endings take some.
    return re.sub(r"[^A-Za-z0-9._+-]+", "_", name)[:100].strip(".") or "unnamed"


def require_printable(name: str, what: str) -> None:
    """Refuse a name that tables and files could not hold."""
    if not name.isprintable():
        raise ValueError(
            f"{what}: name may not hold a line break, a tab or another character that cannot be "
            f"printed, got {name!r}"
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


def read_columns(path: Path) -> tuple[str, str | None]:
    """The text of a file of columns, and the delimiter that it states, None where it states none.

    A first line such as ``sep=;`` is blank, so that the numbers of the others stay the same.
    """
    require_regular_file(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file in UTF-8; save it as CSV (UTF-8)") from None
    if not text.strip():
        raise ValueError(f"{path}: the file is empty")
    stated = STATED_DELIMITER.match(text)
    if stated is None:
        return text, None
    return "\n" * stated[0].count("\n") + text[stated.end() :], stated[1]


def read_table(path: Path) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """A CSV file with a heading: names of the columns; file and line of each row, and its cells.

    Empty rows, and those that begin with ``#``, are left out.
    """
    text, delimiter = read_columns(path)
    reader = csv.reader(text.splitlines(), delimiter=delimiter or ",", skipinitialspace=True)
    numbered = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    lines = [(f"{path}, line {n}", row) for n, row in numbered if any(row) and row[0][:1] != "#"]
    return (lines[0][1], lines[1:]) if lines else ([], [])
