"""File names from arbitrary names."""

from __future__ import annotations

import re
from collections.abc import Iterable


def file_stem(name: str) -> str:
    """The name with underscores for characters that a file system may not allow."""
    return re.sub(r"[^A-Za-z0-9._+-]+", "_", name).strip(".") or "unnamed"


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
