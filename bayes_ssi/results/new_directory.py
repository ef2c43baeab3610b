"""Directories that are created with all their files, or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def require_new(directory: str | Path, *, marker: str, overwrite: bool = False) -> None:
    """Refuse a directory that exists, unless it is of the same kind and may be overwritten.

    Its parent is created, so that a location that cannot be written is reported at once.

    Args:
        directory: directory to be written.
        marker: the file that every directory of this kind holds.
        overwrite: whether a directory of this kind may be replaced.

    Raises:
        FileExistsError: it exists, and ``overwrite`` is false or it holds something else.
        OSError: its parent cannot be created.
    """
    path = Path(directory)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
    elif overwrite:
        if not (path / marker).is_file():
            raise FileExistsError(
                f"{directory}: holds no result of this package and is not overwritten"
            )
    else:
        raise FileExistsError(
            f"{directory}: exists already and is not overwritten; name another with --out, or "
            "pass --overwrite"
        )


@contextmanager
def new_directory(directory: str | Path, *, marker: str, overwrite: bool = False) -> Iterator[Path]:
    """A temporary directory that becomes ``directory`` at the end, and is removed on failure.

    Arguments and errors are as in :func:`require_new`.
    """
    directory = Path(directory)
    require_new(directory, marker=marker, overwrite=overwrite)
    partial = directory.with_name(f".{directory.name}.partial")
    replaced = directory.with_name(f".{directory.name}.replaced")
    for left_over in (partial, replaced):
        shutil.rmtree(left_over, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        # Only between these two renames is neither the old nor the new directory in place.
        if directory.exists():
            directory.rename(replaced)
        partial.rename(directory)
    finally:
        if replaced.exists() and not directory.exists():
            replaced.rename(directory)
        for left_over in (partial, replaced):
            shutil.rmtree(left_over, ignore_errors=True)
