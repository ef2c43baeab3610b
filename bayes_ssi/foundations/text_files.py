"""Text files of columns, as spreadsheets and other programs write them."""

from __future__ import annotations

import errno
import os
import re
import stat
from pathlib import Path

# The first line in which a file states its delimiter, as Excel reads and writes it.
STATED_DELIMITER = re.compile(r'\s*"?sep=([,;\t])"?[,;\s]*?(?=\n|\Z)', re.IGNORECASE)


def require_regular_file(path: Path) -> None:
    """Refuse what can be opened but has no end of its own, such as a pipe or a device."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise ValueError(f"{path}: not a regular file, but a pipe or a device")


def read_columns(path: Path) -> tuple[str, str | None]:
    """The text of a file of columns, and the delimiter that it states.

    Returns:
        The text, in which a first line such as ``sep=;`` is blank, so that the numbers of the
        others stay the same; and the delimiter, None where the file states none.
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
