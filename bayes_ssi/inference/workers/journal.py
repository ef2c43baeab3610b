"""A journal of evaluations, from which an interrupted run is resumed to the same result.

Everything random follows from the seed, so a run is repeated exactly by giving it the same
log-likelihoods, solutions and suggested starts. The journal keeps every batch of them, in order. A
resumed run takes them from the journal while they last: no matter where the first run was
interrupted, the result is the same to the last digit. Only the algebra between the evaluations is
repeated, which costs little where evaluations are expensive.

On another kind of processor that algebra is rounded in another way. Batches at coordinates that
differ by as little are taken from the journal, too; from the first that is elsewhere on, everything
is computed again.

The file is an SQLite database. Every batch is a transaction, so that a run that is killed leaves
whole batches, and the lock on the file ends with its process.

Solutions of a slow structure are kept, too, and counted.
"""

import errno
import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.codec import to_record
from bayes_ssi.inference.workers.workers import Evaluated, Workers, evaluate
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure, SubstituteStructure

FORMAT = 6
OPEN = (
    "PRAGMA locking_mode = EXCLUSIVE",
    # Written batches survive a crash of the process, if not of the machine.
    "PRAGMA synchronous = OFF",
    "BEGIN EXCLUSIVE",
    "CREATE TABLE IF NOT EXISTS run (description TEXT)",
    "CREATE TABLE IF NOT EXISTS batches "
    "(number INTEGER PRIMARY KEY, coordinates BLOB, numbers BLOB, failures TEXT, "
    "digest BLOB, n_evaluations INTEGER)",
)
# In place of coordinates, where a batch holds starts that were suggested.
SUGGESTION = b"suggested starts"
OTHER_ROUNDING = "they were made on another kind of processor, whose rounding led elsewhere"


class OtherRunError(ValueError):
    """The journal belongs to another run."""


class DamagedJournalError(ValueError):
    """The file cannot be read as a journal."""


class Journal:
    """The evaluations of one run, written to disk as they are made."""

    def __init__(
        self, path: str | Path, run: Mapping[str, Any], say: Callable[[str], None] = lambda _: None
    ) -> None:
        self.path, self._say = Path(path), say
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
        self._n_batches, self.n_kept = self._database.execute(
            "SELECT count(*), coalesce(sum(n_evaluations), 0) FROM batches"
        ).fetchone()

    def close(self) -> None:
        self._database.close()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def recalled(self, z: FloatArray) -> Evaluated | None:
        """The numbers of the next batch ``z`` (B, d), flat; None if there are no more.

        Damaged ones, and those at other coordinates, are dropped, with all that follow them, and so
        computed again.
        """
        batch = self._next(_key(z))
        if batch is None:
            return None
        values, failures, _ = batch
        return Evaluated(values, {int(row): why for row, why in json.loads(failures).items()})

    def recalled_suggestion(self, n_dimensions: int) -> tuple[FloatArray, int] | None:
        """The next batch as suggested starts, and the evaluations that they took; None likewise."""
        batch = self._next(SUGGESTION)
        return None if batch is None else (batch[0].reshape(-1, n_dimensions), batch[2])

    def _next(self, key: bytes) -> tuple[FloatArray, str, int] | None:
        """Numbers, failures and evaluations of the next batch, if it has the key."""
        if self._n_recalled == self._n_batches:
            return None
        number = self._n_recalled + 1
        with self._errors_of_file():
            stored_key, numbers, failures, digest, n_evaluations = self._database.execute(
                "SELECT coordinates, numbers, failures, digest, n_evaluations "
                "FROM batches WHERE number = ?",
                [number],
            ).fetchone()
            whole = digest == _digest(numbers, failures.encode())
            if not (whole and _agree(stored_key, key)):
                self._drop_from(number, OTHER_ROUNDING if whole else "they are damaged")
                return None
        self._n_recalled = number
        return np.frombuffer(numbers), failures, n_evaluations

    def _drop_from(self, number: int, why: str) -> None:
        self._database.execute("DELETE FROM batches WHERE number >= ?", [number])
        n_batches, self._n_batches = self._n_batches, self._n_recalled
        self._say(
            f"{self.path}: {n_batches - self._n_recalled} of {n_batches} batches are computed "
            f"again: {why}"
        )

    def add(self, z: FloatArray, evaluated: Evaluated) -> None:
        """Write one more batch."""
        failures = json.dumps(dict(evaluated.failures))
        self._write(_key(z), evaluated.values, failures, len(z))

    def add_suggestion(self, starts: FloatArray, n_evaluations: int) -> None:
        """Write suggested starts (m, d) and the evaluations that they took; errors as above."""
        self._write(SUGGESTION, starts, "{}", n_evaluations)

    def _write(self, key: bytes, numbers: FloatArray, failures: str, n_evaluations: int) -> None:
        data = numbers.tobytes()
        batch = (key, data, failures, _digest(data, failures.encode()), n_evaluations)
        with self._errors_of_file():
            self._database.execute("INSERT INTO batches VALUES (NULL, ?, ?, ?, ?, ?)", batch)
        self.is_empty = False

    @contextmanager
    def _errors_of_file(self) -> Iterator[None]:
        """Convert errors of SQLite to those that callers expect of a file."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                raise ValueError(f"{self.path}: another run is using this checkpoint") from None
            if error.sqlite_errorcode == sqlite3.SQLITE_FULL:
                full = errno.ENOSPC
                raise OSError(full, os.strerror(full), str(self.path)) from error
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


def _key(z: FloatArray) -> bytes:
    """B, d and weighted sums of the columns of points (B, d), which tell them from others."""
    weights = np.cos(np.outer([1.0, 2.3, 3.7], np.arange(1.0, len(z) + 1.0)))
    return np.concatenate([[*z.shape], (weights @ z).ravel()]).tobytes()


def _agree(stored: bytes, asked: bytes) -> bool:
    """Whether two keys are of the same points, but for rounding."""
    if stored == asked or len(stored) != len(asked) or SUGGESTION in (stored, asked):
        return stored == asked
    there, here = np.frombuffer(stored), np.frombuffer(asked)
    # A hundredth of the narrowest posterior that is told from a point.
    scale = np.maximum(np.sqrt(here[0]), np.abs(here[2:]))
    near = np.abs(there[2:] - here[2:]) <= 1e-8 * scale
    return np.array_equal(there[:2], here[:2]) and bool(near.all())


def _digest(*parts: bytes) -> bytes:
    return hashlib.blake2b(b"".join(parts), digest_size=16).digest()


class RecordedStructure(SubstituteStructure):
    """Another structure, solved once at each set of values."""

    def __init__(
        self, structure: Structure, workers: Workers | None = None, journal: Journal | None = None
    ) -> None:
        self.structure = structure
        self.n_solved = 0
        self.failures: dict[bytes, str] = {}
        self._known: dict[bytes, FloatArray] = {}
        self._workers, self._journal = workers, journal

    @property
    def substituted(self) -> Structure:
        return self.structure

    def modes(self, values: FloatArray) -> Modes:
        """The structure's modes; NaN in rows at which it fails."""
        keys = [row.tobytes() for row in np.ascontiguousarray(values)]
        # A row that is there twice is solved once.
        new = {key: row for key, row in zip(keys, values, strict=True) if key not in self._known}
        if new:
            self._solve(np.array(list(new.values())))
        if len(keys) == 1 and keys[0] in self.failures:
            raise ValueError(self.failures[keys[0]])
        n_dof, n_modes = len(self.degrees_of_freedom), self.n_modes
        rows = np.array([self._known[key] for key in keys]).reshape(-1, (1 + n_dof) * n_modes)
        return Modes(rows[:, :n_modes], rows[:, n_modes:].reshape(len(keys), n_dof, n_modes))

    def _solve(self, values: FloatArray) -> None:
        evaluated = self._journal.recalled(values) if self._journal else None
        if evaluated is None:
            function = partial(_solutions, self.structure)
            n_columns = (1 + len(self.degrees_of_freedom)) * self.n_modes
            if self._workers is None:
                evaluated = evaluate(function, values, n_columns)
            else:
                evaluated = self._workers.evaluate(function, values, n_columns)
            if self._journal:
                self._journal.add(values, evaluated)
        self.n_solved += len(values)
        solutions = evaluated.values.reshape(len(values), -1)
        for i, (row, solution) in enumerate(zip(values, solutions, strict=True)):
            self._known[row.tobytes()] = solution
            if i in evaluated.failures:
                self.failures[row.tobytes()] = evaluated.failures[i]

    def __getstate__(self) -> dict[str, Any]:
        """State without what belongs to this process."""
        return {**self.__dict__, "_workers": None, "_journal": None}


def _solutions(structure: Structure, values: FloatArray) -> FloatArray:
    """Frequencies and shapes (B, (1 + n_dof) n_modes) at ``values`` (B, n_parameters)."""
    frequencies_hz, shapes = structure.modes(values)
    modes = Modes(frequencies_hz, shapes).repeated(len(values))
    return np.hstack([modes.frequencies_hz, modes.shapes.reshape(len(values), -1)])
