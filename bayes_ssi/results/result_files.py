"""Directories created with all their files or not at all, and the JSON files in them."""

import csv
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from bayes_ssi.foundations.codec import from_record, to_record

T = TypeVar("T")


class ResultExistsError(FileExistsError):
    """A result of the same kind may be there, and was not to be overwritten."""


def write_json(path: Path, value: Any) -> None:
    """Write the record of an object, from :func:`~bayes_ssi.foundations.codec.to_record`."""
    text = json.dumps(to_record(value), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_stored(kind: type[T], path: Path) -> T:
    """Read an object from a record that :func:`write_json` wrote."""
    record = read_json(path)
    try:
        return from_record(kind, record)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_current(kind: type[T], path: Path, *, what: str, again: str) -> T:
    """Read a record whose ``format`` must be the one that this version of the package writes.

    Args:
        kind: a dataclass with the current format as default of its field ``format``.
        what: is stored, such as "a result", and ``again``, how to make it again, for messages.
    """
    current, stored = vars(kind)["format"], read_json(path).get("format")
    if stored != current:
        raise ValueError(
            f"{path.parent}: {what} of format {stored!r}, this version reads format {current}; "
            f"{again}"
        )
    return read_stored(kind, path)


def write_csv(path: Path, rows: Iterable[Iterable[object]]) -> None:
    with path.open("x", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def read_json(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path.parent}: not a result directory: no {path.name}") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: damaged: {error}") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path}: damaged: not a record")
    return record


DIGESTS = "digests.json"
# Beside the files of a result: what commands make of it, and may make again.
MADE_OF_RESULTS = {DIGESTS, "figures", "report", "predictions", "plan", "updated"}


def write_digests(directory: Path) -> None:
    """Write the digests of all files that are in a directory now."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    digests = {path.relative_to(directory).as_posix(): _digest(path) for path in files}
    write_json(directory / DIGESTS, digests)


def check_digests(directory: Path, *names: str) -> None:
    saved = read_json(directory / DIGESTS)
    for name in names:
        path = directory / name
        if not path.is_file():
            raise ValueError(f"{path}: no such file; the result is incomplete")
        if saved.get(name) != _digest(path):
            raise ValueError(
                f"{path}: changed after the result was saved, so that its numbers are not those "
                "that were computed; run the study again"
            )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_new(directory: str | Path, *, marker: str, overwrite: bool = False) -> None:
    """Refuse a directory that exists, unless it is of the same kind and may be overwritten.

    Its parent is created, so that a location that cannot be written is reported at once.
    """
    path = Path(directory)
    _require_name(path)
    if not os.path.lexists(path):
        _require_parent(path)
    elif not overwrite:
        raise ResultExistsError(
            f"{directory}: exists already and is not overwritten; name another, or overwrite it"
        )
    elif not (path / marker).is_file():
        raise FileExistsError(
            f"{directory}: holds no result of this package and is not overwritten"
        )
    elif (path / DIGESTS).is_file():
        own = {name.split("/")[0] for name in read_json(path / DIGESTS)} | MADE_OF_RESULTS
        found = {each.name for each in path.iterdir() if each.name[0] != "."}  # as file managers do
        if others := sorted(found - own):
            raise FileExistsError(f"{directory}: {', '.join(others)} would be lost; move it first")


def require_new_files(*paths: Path) -> None:
    """Refuse files that exist, and create their parents, before the work that they are to hold."""
    for path in paths:
        if os.path.lexists(path):
            raise FileExistsError(f"{path} exists; give another name")
        _require_parent(path)


def sibling(directory: Path, ending: str) -> Path:
    """The hidden path next to a directory, for what belongs to it while it is written."""
    _require_name(directory)
    return directory.with_name(f".{directory.name}.{ending}")


def _require_name(path: Path) -> None:
    if path.name in ("", ".."):
        raise ValueError(
            f"{str(path)!r} is not the path of a new directory, which ends in a name of its own, "
            "as in runs/results/tower"
        )


def _require_parent(path: Path) -> None:
    """Create the parent of a new directory or file, unless it exists."""
    existing = next(parent for parent in path.absolute().parents if os.path.lexists(parent))
    if not existing.is_dir():
        raise NotADirectoryError(f"{path}: cannot be created: {existing} is not a directory")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise PermissionError(f"{path}: cannot be created: no permission to write in {existing}")
    path.parent.mkdir(parents=True, exist_ok=True)


@contextmanager
def new_directory(directory: str | Path, *, marker: str, overwrite: bool = False) -> Iterator[Path]:
    """A temporary directory that becomes ``directory`` at the end, and is removed on failure.

    Arguments and errors are as in :func:`require_new`; errors of writing name the final place.
    """
    directory = Path(directory)
    require_new(directory, marker=marker, overwrite=overwrite)
    partial, replaced = sibling(directory, "partial"), sibling(directory, "replaced")
    for left_over in (partial, replaced):
        shutil.rmtree(left_over, ignore_errors=True)
    partial.mkdir()
    try:
        yield partial
        # Only between these two renames is neither the old nor the new directory in place.
        if directory.exists():
            directory.rename(replaced)
        partial.rename(directory)
    except OSError as error:
        if error.errno is None:
            raise
        file = str(error.filename or directory).replace(str(partial), str(directory))
        raise OSError(error.errno, os.strerror(error.errno), file) from error
    finally:
        if replaced.exists() and not directory.exists():
            replaced.rename(directory)
        for left_over in (partial, replaced):
            shutil.rmtree(left_over, ignore_errors=True)
