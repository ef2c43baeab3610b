"""A journal of evaluations, from which an interrupted run is resumed to the same result.

Everything random follows from the seed, so a run is repeated exactly by giving it the same
log-likelihoods. The journal keeps every batch of them, in order. A resumed run takes its
log-likelihoods from the journal while they last: no matter where the first run was interrupted,
the result is the same to the last digit. Only the algebra between the evaluations is repeated,
which costs little where evaluations are expensive.

The file is an SQLite database. Every batch is a transaction, so that a run that is killed leaves
whole batches, and the lock on the file ends with its process.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.codec import to_record
from bayes_ssi.execution.batch import Evaluated

FORMAT = 2
OPEN = (
    "PRAGMA locking_mode = EXCLUSIVE",
    # Written batches survive a crash of the process, if not of the machine.
    "PRAGMA synchronous = OFF",
    "BEGIN EXCLUSIVE",
    "CREATE TABLE IF NOT EXISTS run (description TEXT)",
    "CREATE TABLE IF NOT EXISTS batches "
    "(number INTEGER PRIMARY KEY, coordinates_digest BLOB, log_likelihoods BLOB, failures TEXT, "
    "digest BLOB)",
)


class OtherRunError(ValueError):
    """The journal belongs to another run."""


class DamagedJournalError(ValueError):
    """The file cannot be read as a journal."""


class Journal:
    """The evaluations of one run, written to disk as they are made.

    Attributes:
        path: path of the file.
        n_kept: evaluations that the file held when it was opened.
        is_empty: whether it holds no evaluation.
    """

    def __init__(self, path: str | Path, run: Mapping[str, Any]) -> None:
        """Open a journal, or create one.

        Args:
            path: path of the file, in an existing directory.
            run: identifies the run.

        Raises:
            OtherRunError: the file belongs to another run.
            DamagedJournalError: it is damaged, or not a journal.
            ValueError: another run has it open.
            OSError: it cannot be read or written.
        """
        self.path = Path(path)
        with self._errors_of_file():
            # Without waiting for a lock; every statement is a transaction.
            self._database = sqlite3.connect(self.path, timeout=0.0, isolation_level=None)
        try:
            with self._errors_of_file():
                self._open({"format": FORMAT, **run})
        except BaseException:
            self.close()
            raise
        self.is_empty = self.n_kept == 0
        self._n_recalled = 0

    def _open(self, run: Mapping[str, Any]) -> None:
        for statement in OPEN:
            self._database.execute(statement)
        (state,) = self._database.execute("PRAGMA quick_check(1)").fetchone()
        if state != "ok":
            raise sqlite3.DatabaseError(state)
        here = json.dumps(to_record(run), sort_keys=True)
        stored = self._database.execute("SELECT description FROM run").fetchone()
        if stored is None:
            self._database.execute("INSERT INTO run VALUES (?)", [here])
        elif stored[0] != here:
            raise OtherRunError(
                f"{self.path}: the checkpoint of another run, with "
                f"{_differences(json.loads(stored[0]), json.loads(here))}; finish that one, or "
                "begin again without it (--overwrite)"
            )
        self._database.execute("COMMIT")
        self._n_batches, n_bytes = self._database.execute(
            "SELECT count(*), coalesce(sum(length(log_likelihoods)), 0) FROM batches"
        ).fetchone()
        self.n_kept = n_bytes // np.dtype(float).itemsize

    def close(self) -> None:
        self._database.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def recalled(self, z: FloatArray) -> Evaluated | None:
        """The journal's log-likelihoods of the next batch ``z`` (B, d); None if it holds no more.

        Damaged log-likelihoods are dropped, with all that follow them, and so computed again.

        Raises:
            ValueError: the journal's next batch was at other coordinates.
        """
        if self._n_recalled == self._n_batches:
            return None
        number = self._n_recalled + 1
        with self._errors_of_file():
            coordinates_digest, log_likelihoods, failures, digest = self._database.execute(
                "SELECT coordinates_digest, log_likelihoods, failures, digest FROM batches "
                "WHERE number = ?",
                [number],
            ).fetchone()
            if digest != _digest(log_likelihoods, failures.encode()):
                self._database.execute("DELETE FROM batches WHERE number >= ?", [number])
                self._n_batches = self._n_recalled
                return None
        values = np.frombuffer(log_likelihoods)
        if coordinates_digest != _digest(z.tobytes()) or len(values) != len(z):
            raise ValueError(
                f"{self.path}: batch {number} of this checkpoint is at other coordinates than the "
                "run asks for: it was made on another machine or with other versions of the "
                "libraries; remove it to begin again"
            )
        self._n_recalled = number
        return Evaluated(values, {int(row): why for row, why in json.loads(failures).items()})

    def add(self, z: FloatArray, evaluated: Evaluated) -> None:
        """Write one more batch.

        Raises:
            OSError: it cannot be written.
        """
        values, failures = evaluated.values.tobytes(), json.dumps(dict(evaluated.failures))
        batch = (_digest(z.tobytes()), values, failures, _digest(values, failures.encode()))
        with self._errors_of_file():
            self._database.execute("INSERT INTO batches VALUES (NULL, ?, ?, ?, ?)", batch)
        self.is_empty = False

    @contextmanager
    def _errors_of_file(self) -> Iterator[None]:
        """Convert errors of SQLite to those that callers expect of a file."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                raise ValueError(f"{self.path}: another run is using this checkpoint") from None
            raise OSError(f"{self.path}: {error}") from error
        except sqlite3.DatabaseError as error:
            raise DamagedJournalError(f"{self.path}: damaged, or not a checkpoint") from error


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} {_short(there.get(name))} there and {_short(here.get(name))} here"
        for name in {**there, **here}
        if there.get(name) != here.get(name)
    )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _digest(*parts: bytes) -> bytes:
    return hashlib.blake2b(b"".join(parts), digest_size=16).digest()
