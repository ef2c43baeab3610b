"""A directory that is written once and whole: it is there with all its files, or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["new_directory", "require_new"]


def require_new(directory: str | Path, *, marker: str, overwrite: bool = False) -> None:
    """Refuse a directory that exists, unless it is of its kind and may be overwritten.

    The directory above it is made, so that a place that cannot be written is known at once.

    Args:
        directory: what is to be written.
        marker: the file that every directory of this kind holds.
        overwrite: whether one of this kind may be replaced.

    Raises:
        FileExistsError: it exists, and ``overwrite`` is false or it holds something else.
        OSError: the directory above it cannot be made.
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
    """A directory to write into, which becomes ``directory`` at the end; nothing is left if not.

    Arguments and errors as those of :func:`require_new`.
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
        # One of the two is there, whole, at every moment but between these two.
        if directory.exists():
            directory.rename(replaced)
        partial.rename(directory)
    finally:
        if replaced.exists() and not directory.exists():
            replaced.rename(directory)
        for left_over in (partial, replaced):
            shutil.rmtree(left_over, ignore_errors=True)
