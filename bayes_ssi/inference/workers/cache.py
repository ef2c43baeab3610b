"""Evaluations kept on disk, so that a run that was interrupted does not repeat them.

Everything random follows from the seed: a run that is begun again asks for the same batches of
points, to the last digit, and takes from the cache what was evaluated before. Only the algebra
between the evaluations is repeated. Points that rounding led elsewhere, as on another kind of
processor, are evaluated.

The file is an SQLite database. Every batch is a transaction, so that a run that is killed leaves
whole batches, and the lock on the file ends with its process.
"""

import errno
import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.workers.workers import Evaluated

# Points that are evaluated again, to see that the model is still the same: a change of the model
# would hardly spare all of them.
POINTS_TO_CHECK = 3
OPEN = (
    "PRAGMA locking_mode = EXCLUSIVE",
    # Written batches survive a crash of the process, if not of the machine.
    "PRAGMA synchronous = OFF",
    "BEGIN EXCLUSIVE",
    "CREATE TABLE IF NOT EXISTS batches "
    "(key BLOB PRIMARY KEY, shape TEXT, numbers BLOB, failures TEXT)",
    "COMMIT",
)


class Cache:
    """Evaluations of the models of one run, by the points at which they were made.

    Each of its models has a number. What this run evaluates itself is for the next.

    Raises:
        ValueError: another process uses the file, or it is damaged.
        OSError: the file cannot be opened or written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._n_models = 0
        self._checked: set[int] = set()
        self._database = _opened(path, *OPEN)
        (self._last,) = self._database.execute("SELECT max(rowid) FROM batches").fetchone()
        self._is_empty = self._last is None

    def __enter__(self) -> "Cache":
        return self

    def __exit__(self, *_: object) -> None:
        self._database.close()
        if self._is_empty:  # as where the input is refused
            self.path.unlink()

    def new_model(self) -> int:
        """The number of one more model; models come in the same order in every run."""
        self._n_models += 1
        return self._n_models

    def evaluated(
        self, model: int, z: FloatArray, evaluate: Callable[[FloatArray], Evaluated]
    ) -> Evaluated:
        """What ``evaluate`` answers at ``z`` (B, d), or answered there in an earlier run.

        Raises:
            ValueError: at the first points that are recalled the model answers differently now.
        """
        evaluated = self.recalled(model, z)
        if evaluated is None:
            evaluated = evaluate(z)
            self.keep(model, z, evaluated)
        elif model not in self._checked:
            n = len(z[:POINTS_TO_CHECK])
            # The first number of each point: its log-likelihood, or its first frequency.
            before = evaluated.values[:n].reshape(n, -1)[:, 0]
            again = evaluate(z[:n]).values.reshape(n, -1)[:, 0]
            if not np.allclose(again, before, 1e-6, equal_nan=True):
                raise ValueError(
                    f"{self.path}: the model gives other values than when this checkpoint was "
                    "made; remove it to begin again"
                )
            self._checked.add(model)
        return evaluated

    def recalled(self, model: int, z: NDArray[Any]) -> Evaluated | None:
        """What an earlier run kept of a model at ``z``; None if nothing."""
        query = "SELECT shape, numbers, failures FROM batches WHERE key = ? AND rowid <= ?"
        with _errors_of(self.path):
            stored = self._database.execute(query, [_key(model, z), self._last]).fetchone()
        if stored is None:
            return None
        shape, numbers, failures = stored
        values = np.frombuffer(numbers).reshape(json.loads(shape))
        return Evaluated(values, {int(row): why for row, why in json.loads(failures).items()})

    def keep(self, model: int, z: NDArray[Any], evaluated: Evaluated) -> None:
        """Write what a model answered at ``z``."""
        values, failures = evaluated
        shape, reasons = json.dumps(values.shape), json.dumps(dict(failures))
        batch = (_key(model, z), shape, values.tobytes(), reasons)
        with _errors_of(self.path):
            self._database.execute("INSERT OR IGNORE INTO batches VALUES (?, ?, ?, ?)", batch)
        self._is_empty = False


def _key(model: int, z: NDArray[Any]) -> bytes:
    whole = repr((model, z.shape)).encode() + z.tobytes()
    return hashlib.blake2b(whole, digest_size=16).digest()


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a file that is there only as long as it is held; errors are as of :class:`Cache`.

    The lock ends with this process, however that ends.
    """
    database = _opened(path, "PRAGMA journal_mode = OFF", "BEGIN EXCLUSIVE")
    try:
        yield
    finally:
        database.close()
        path.unlink()


def _opened(path: Path, *statements: str) -> sqlite3.Connection:
    """Without waiting for a lock; every later statement is a transaction."""
    with _errors_of(path):
        database = sqlite3.connect(path, timeout=0.0, isolation_level=None)
        try:
            for statement in statements:
                database.execute(statement)
            (state,) = database.execute("PRAGMA quick_check(1)").fetchone()
            if state != "ok":
                raise sqlite3.DatabaseError(state)
        except BaseException:
            database.close()
            raise
        return database


@contextmanager
def _errors_of(path: Path) -> Iterator[None]:
    """Convert errors of SQLite to those that callers expect of a file."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise ValueError(f"{path}: another run is using this checkpoint") from None
        if error.sqlite_errorcode == sqlite3.SQLITE_FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        raise OSError(f"{path}: {error}") from error
    except sqlite3.DatabaseError as error:
        raise ValueError(
            f"{path}: damaged, or not a checkpoint; remove it to begin again"
        ) from error
