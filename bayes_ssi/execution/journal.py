"""A journal of evaluations, from which an interrupted run is resumed to the same result.

Everything random follows from the seed, so a run is repeated exactly by giving it the same
log-likelihoods. The journal keeps every batch of them, in order. A run that has a journal takes
its log-likelihoods from there while they last: wherever the first run was interrupted, the result
is the same to the last digit. Only the algebra between the evaluations is done twice, which costs
little where evaluations are expensive.

The file is a line of JSON that identifies the run, followed by records. A record is its length, a
checksum of these four bytes, a digest of the rest and the rest: a digest of the coordinates and
the values. A record that is incomplete because the run was interrupted is dropped; if one does not
match its checksums the file is damaged, and only what precedes it is used.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import weakref
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.execution.batch import Evaluated

__all__ = ["Journal", "JournalInUseError", "run_of_journal"]

FORMAT = 1
DIGEST_SIZE = 16
PREFIX = struct.Struct("<II")  # length of a record's body, checksum of that length


class JournalInUseError(ValueError):
    """Another run, still going, writes the same journal."""


class Journal:
    """The evaluations of one run, on disk as they are made.

    Attributes:
        path: of the file.
        n_kept: evaluations that the file held when it was opened.
        damage: what is wrong with the file; empty if nothing is.
    """

    def __init__(self, path: str | Path, run: Mapping[str, Any]) -> None:
        """Open a journal, or begin one.

        Args:
            path: of the file; its directory must exist.
            run: identifies the run, JSON-ready. Another run's journal is refused.

        Raises:
            JournalInUseError: another run has it open.
            ValueError: the file belongs to another run, or is not a journal.
            OSError: it cannot be read or written.
        """
        self.path = Path(path)
        self.damage = ""
        self.n_kept = 0
        self._kept: list[tuple[bytes, Evaluated]] = []
        self._next, self._n_added = 0, 0
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
        # Unbuffered: what was written survives the process.
        self._file: BinaryIO = os.fdopen(descriptor, "r+b", buffering=0)
        _close_in_children(self._file)
        try:
            self._lock()
            self._read(run)
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    @property
    def is_empty(self) -> bool:
        """Whether it holds no evaluation."""
        return not (self.n_kept or self._n_added)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def recalled(self, z: FloatArray) -> Evaluated | None:
        """The journal's log-likelihoods of the next batch ``z`` (B, d); None if it holds no more.

        Raises:
            ValueError: the journal's next batch was at other coordinates.
        """
        if self._next == len(self._kept):
            return None
        digest, evaluated = self._kept[self._next]
        if digest != _digest(z) or len(evaluated.values) != len(z):
            raise ValueError(
                f"{self.path}: batch {self._next + 1} of this checkpoint is at other coordinates "
                "than the run asks for: it was made on another machine or with other versions of "
                "the libraries; remove it to begin again"
            )
        self._next += 1
        return evaluated

    def add(self, z: FloatArray, evaluated: Evaluated) -> None:
        """Write one more batch."""
        values = np.ascontiguousarray(evaluated.values, dtype="<f8").tobytes()
        failures = {str(row): reason for row, reason in evaluated.failures.items()}
        text = json.dumps(failures).encode() if failures else b""
        body = _digest(z) + struct.pack("<I", len(z)) + values + text
        length = struct.pack("<I", len(body))
        record = PREFIX.pack(len(body), zlib.crc32(length)) + _sum(body) + body
        self._write(record)
        self._n_added += len(z)

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:  # an unbuffered write may take only a part
            view = view[self._file.write(view) or 0 :]

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # not on this platform
            return
        try:
            # The system releases it when the process ends, however it ends.
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise JournalInUseError(f"{self.path}: another run is using this checkpoint") from None

    def _read(self, run: Mapping[str, Any]) -> None:
        record = {"format": FORMAT, "run": run}
        header = json.dumps(record, sort_keys=True, default=_plain).encode() + b"\n"
        content = self._file.read()
        end = content.find(b"\n")
        if end < 0 and header.startswith(content):  # new, or interrupted in this line
            self._restart(0)
            self._write(header)
            return
        self._check_header(content[: end + 1], header)
        good = end + 1
        while good < len(content):
            read = self._record(content, good)
            if read is None:
                break
            good, digest, evaluated = read
            self._kept.append((digest, evaluated))
            self.n_kept += len(evaluated.values)
        self._restart(good)

    def _check_header(self, actual: bytes, expected: bytes) -> None:
        if actual == expected:
            return
        if (header := _read_header(actual)) is None:
            raise ValueError(f"{self.path}: damaged, or not a checkpoint; remove it to begin again")
        number, there = header
        here = json.loads(expected)["run"]
        names = [name for name in {**there, **here} if there.get(name) != here.get(name)]
        what = ", ".join(
            f"{name} {_short(there.get(name))} there and {_short(here.get(name))} here"
            for name in names
        )
        raise ValueError(
            f"{self.path}: the checkpoint of another run, with "
            f"{what or f'format {number!r} there and {FORMAT} here'}; finish that one, or begin "
            "again without it (--overwrite)"
        )

    def _record(self, content: bytes, at: int) -> tuple[int, bytes, Evaluated] | None:
        """The end, digest and values of the record at a position; None if it is not whole."""
        begin = at + PREFIX.size
        if begin > len(content):
            return None
        length, checksum = PREFIX.unpack_from(content, at)
        sound = zlib.crc32(content[at : at + 4]) == checksum
        end = begin + DIGEST_SIZE + length
        if sound and end > len(content):
            return None
        body = content[begin + DIGEST_SIZE : end]
        if not sound or _sum(body) != content[begin : begin + DIGEST_SIZE]:
            self.damage = (
                f"{self.path}: damaged after {self.n_kept} evaluations, which are used; the rest "
                "is computed again"
            )
            return None
        (n,) = struct.unpack_from("<I", body, DIGEST_SIZE)
        values_end = DIGEST_SIZE + 4 + 8 * n
        values = np.frombuffer(body[DIGEST_SIZE + 4 : values_end], dtype="<f8").astype(float)
        failures = json.loads(body[values_end:]) if len(body) > values_end else {}
        evaluated = Evaluated(values, {int(row): reason for row, reason in failures.items()})
        return end, body[:DIGEST_SIZE], evaluated

    def _restart(self, position: int) -> None:
        """Continue writing at ``position``; what follows it is dropped."""
        self._file.seek(position)
        self._file.truncate()


def run_of_journal(path: Path) -> dict[str, Any]:
    """What identifies the run of a journal, even of an open one; empty if that is unreadable."""
    with path.open("rb") as file:
        header = _read_header(file.readline())
    return {} if header is None else header[1]


def _read_header(line: bytes) -> tuple[Any, dict[str, Any]] | None:
    """Number of the format, and the run; None if the line does not hold them."""
    try:
        record = json.loads(line)
        return record["format"], dict(record["run"])
    except (ValueError, TypeError, KeyError, RecursionError):
        return None


def _close_in_children(file: BinaryIO) -> None:
    """Forked children would hold the lock as long as they live, which may be longer."""
    alive = weakref.ref(file)

    def close() -> None:
        if (kept := alive()) is not None:
            kept.close()

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=close)


def _plain(value: Any) -> Any:
    """A NumPy number as a Python one."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be stored as JSON")


def _digest(z: FloatArray) -> bytes:
    return _sum(np.ascontiguousarray(z, dtype="<f8").tobytes())


def _sum(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=DIGEST_SIZE).digest()


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
