"""Evaluation of a batch, some points of which may fail: here, or by workers.

These are loky's processes, or those of any ``concurrent.futures.Executor``, such as mpi4py's
``MPIPoolExecutor`` or that of a Dask client. Since row i of an answer depends on row i alone,
results do not depend on the number of workers.
"""

import multiprocessing
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO, Any, NamedTuple, TypeVar

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, IntArray
from bayes_ssi.foundations.error_places import rows_at_fault, with_place
from bayes_ssi.inference.workers.packing import (
    PackedFunction,
    call_packed,
    end_with_parent,
    pickled,
)

R = TypeVar("R")
T = TypeVar("T")
# (B, d) coordinates → (B,) log-likelihoods. Row i of the answer depends on row i alone, to the
# last digit: a batch may be evaluated in parts, here or elsewhere.
Function = Callable[[FloatArray], FloatArray]


class Evaluated(NamedTuple):
    """What a model answers at a batch of points."""

    values: FloatArray  # (B,) log-likelihoods, or (B, n_columns); NaN where the model failed
    failures: Mapping[int, str]  # row → reason, where one is known beyond that the answer was NaN


def evaluate(function: Function, z: FloatArray, n_columns: int | None = None) -> Evaluated:
    """``function`` at every row of ``z`` (B, d); rows at which it raises are NaN.

    It returns ``n_columns`` values for each row, (B, n_columns); if None, one, (B,).
    """
    of_row = () if n_columns is None else (n_columns,)
    values = np.full((len(z), *of_row), np.nan)
    failures: dict[int, str] = {}
    for rows, answer in rows_at_fault(lambda rows: function(z[rows]), len(z)) if len(z) else ():
        if isinstance(answer, Exception):
            failures[rows.start] = with_place(answer)
            continue
        part = np.asarray(answer, dtype=float)
        n = rows.stop - rows.start
        if part.shape != (n, *of_row):
            expected = "one value" if n_columns is None else f"{n_columns} values"
            raise ValueError(
                f"log-likelihood: expected {expected} for each of {n} points, "
                f"got shape {part.shape}"
            )
        values[rows] = part
    return Evaluated(values, failures)


@dataclass(frozen=True)
class SafeFunction:
    function: Function
    n_columns: int | None = None

    def __call__(self, z: FloatArray) -> Evaluated:
        return evaluate(self.function, z, self.n_columns)


class Workers:
    """Processes on this machine, or the workers of an executor, which its creator shuts down.

    A context manager that may be entered repeatedly. Processes start at the first call, are
    replaced if they die, and stop at the outermost exit.

    Attributes:
        executor: the one that was given; None for processes.
        n_workers: number of processes, or of workers as far as it is known, by which batches are
            divided into parts.
        copies: whether processes start as copies of this one, where that is possible: at once, at
            the outermost entry, while a new process imports the package for about a second. There
            must be no state of other threads and libraries that a copy could stumble over.
    """

    parts_per_worker = 4  # of a batch: none should wait long for the slowest
    # Into which lost points are divided to be evaluated again, down to single points: four isolate
    # the point of a batch of 1024 at which a worker dies after six deaths at most.
    groups = 4
    most_deaths = 100  # enough to find some twenty points at which workers die

    def __init__(
        self, executor: Executor | None = None, n_workers: int = 8, *, copies: bool = False
    ) -> None:
        if n_workers < 1:
            raise ValueError(f"workers must be at least 1, got {n_workers!r}")
        self.executor, self.n_workers, self.copies = executor, n_workers, copies
        self._processes: Executor | None = None
        self._n_entered = self._n_deaths = 0
        self._packed: tuple[Callable[..., Any], PackedFunction] | None = None
        self._file: IO[bytes] | None = None

    @property
    def n_parts(self) -> int:
        """Best number of parts to divide a batch into."""
        return self.parts_per_worker * self.n_workers

    def __enter__(self) -> "Workers":
        if not self._n_entered and self.executor is None and self.copies and can_copy():
            self._processes = self._started(multiprocessing.get_context("fork"))
            try:
                self._processes.submit(int).result()  # now, before a thread of this process begins
            except BrokenExecutor as death:
                self.abandon()
                problem = f"one of {self.n_workers} died while they started; is memory short?"
                raise ValueError(f"workers: {problem}") from death
        self._n_entered += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._n_entered -= 1
        if not self._n_entered:
            self.abandon()
            self._remove_file()

    def evaluate(
        self, function: Function, z: FloatArray, n_columns: int | None = None
    ) -> Evaluated:
        """``function`` at every row of ``z`` (B, d), of ``n_columns`` values or, if None, one.

        Points whose worker died are evaluated again in smaller groups, down to single points. A
        single point at which a worker dies again counts as failed.
        """
        values = np.full((len(z),) if n_columns is None else (len(z), n_columns), np.nan)
        failures: dict[int, str] = {}
        suspect = np.zeros(len(z), dtype=bool)
        groups = _divided(np.arange(len(z)), 1)
        while groups:
            rows = groups.pop()
            parts = _divided(rows, self.n_parts)
            answers = self.try_each(SafeFunction(function, n_columns), [z[part] for part in parts])
            for i, answer in answers.items():
                values[parts[i]] = answer.values
                failures.update((int(parts[i][row]), why) for row, why in answer.failures.items())
            left_out = [part for i, part in enumerate(parts) if i not in answers]
            lost = np.concatenate([rows[:0], *left_out])
            if len(lost) == len(rows) == 1 and suspect[rows[0]]:
                failures[int(rows[0])] = "the worker that evaluated it died"
            else:
                suspect[lost] = True
                groups += _divided(lost, self.groups)
        return Evaluated(values, failures)

    def call_each(self, function: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """As :meth:`try_each`, in the order of items; those whose worker died are tried again."""
        answers: dict[int, R] = {}
        while left := [i for i in range(len(items)) if i not in answers]:
            new = self.try_each(function, [items[i] for i in left])
            answers.update((left[i], answer) for i, answer in new.items())
        return [answers[i] for i in range(len(items))]

    def try_each(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: Callable[[int], object] | None = None,
        meanwhile: Callable[[], object] | None = None,
    ) -> dict[int, R]:
        """``function`` of every item, each in one worker; items whose worker died are left out."""
        answers: dict[int, R] = {}
        waiting: dict[Future[R], int] = {}
        death: BrokenExecutor | None = None
        try:
            packed = self._pack(function)
            executor = self._running()
            for i, item in enumerate(items):
                waiting[_submitted(executor, packed, pickled(item))] = i
            while waiting:
                if meanwhile is not None:
                    meanwhile()
                # Between two looks at the progress of calls.
                for future in wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED).done:
                    i = waiting.pop(future)
                    error = future.exception()
                    if error is None:
                        answers[i] = future.result()
                        if done is not None:
                            done(i)
                    elif isinstance(error, BrokenExecutor):
                        death = error
                    else:
                        raise _as_input_error(error)
        except BrokenExecutor as error:
            death = error
        finally:
            if waiting:  # for what is no longer needed
                self.abandon()
            for future in waiting:
                future.cancel()
        if death is not None:
            self._recover(death)
        return answers

    def _pack(self, function: Callable[..., Any]) -> PackedFunction:
        """The function in the form that is sent, pickled again only when it changes."""
        # Every access creates a new bound method, but bound methods compare equal.
        if self._packed is None or self._packed[0] != function:
            data = pickled(function)
            self._packed = (function, PackedFunction.of(data, self._content(data)))
        return self._packed[1]

    def _recover(self, death: BrokenExecutor) -> None:
        """Replace workers after one died, or give up."""
        self._n_deaths += 1
        if self._n_deaths > self.most_deaths:
            raise ValueError(
                f"workers: died {self._n_deaths} times, the last time with "
                f"{type(death).__name__}: {death}"
            ) from death
        if self.executor is not None:
            raise ValueError(
                "workers: one died, and the executor that was given does not replace it: "
                f"{type(death).__name__}: {death}"
            ) from death
        self.abandon()

    def _running(self) -> Executor:
        if self.executor is not None:
            return self.executor
        self._processes = self._processes or self._started(None)
        return self._processes

    def _started(self, context: Any) -> Executor:
        from loky import ProcessPoolExecutor

        # What a worker keeps for the next call, such as factors of matrices, is no leak.
        kept = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e12"}
        return ProcessPoolExecutor(
            self.n_workers, context=context, initializer=end_with_parent, env=kept
        )

    def _content(self, data: bytes) -> bytes | Path:
        """A file for processes, each of which reads it only once; else the function itself."""
        if self.executor is not None:
            return data
        self._remove_file()
        self._file = NamedTemporaryFile(prefix="bayes_ssi_")  # noqa: SIM115 - closed at the exit
        try:
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            error.filename = self._file.name  # Python names it where opening fails only
            raise
        return Path(self._file.name)

    def _remove_file(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = self._packed = None

    def abandon(self) -> None:
        """Stop processes in the middle of what they do; the next call starts others."""
        processes, self._processes = self._processes, None
        if processes is not None:
            feeder = getattr(getattr(processes, "_call_queue", None), "_thread", None)
            # Loky's own argument: otherwise its workers would first finish their tasks.
            processes.shutdown(wait=True, kill_workers=True)  # type: ignore[call-arg]
            if feeder is not None:
                # Loky does not wait for the thread that feeds its queue. If this process ends while
                # that thread gives a semaphore back, it is half removed, which loky then reports.
                feeder.join()


def _divided(rows: IntArray, n: int) -> list[IntArray]:
    """At most ``n`` parts of nearly equal size, none of them empty."""
    return [part for part in np.array_split(rows, n) if len(part)]


def _submitted(executor: Executor, function: PackedFunction, item: bytes) -> Future[Any]:
    try:
        return executor.submit(call_packed, function, item)
    except BrokenExecutor:
        raise
    except RuntimeError as error:  # it is shut down
        raise ValueError(f"workers: the executor takes no work: {error}") from error


def _as_input_error(error: BaseException) -> BaseException:
    """A ValueError in one line for an error from a worker.

    Interruptions, and errors of files, which name the file, are left unchanged.
    """
    is_of_file = isinstance(error, OSError) and type(error).__module__ == "builtins"
    if isinstance(error, ValueError) or is_of_file or not isinstance(error, Exception):
        return error
    raised = ValueError(f"workers: one cannot work: {type(error).__name__}: {error}")
    raised.__cause__ = error
    return raised


def usable_cores() -> int:
    """Number of cores that this process may use, by its affinity and its share of the machine."""
    from loky import cpu_count

    return cpu_count()


def can_copy() -> bool:
    """Whether this process can be copied: on Linux, and unless it has other threads.

    Apple's libraries do not work in a copy, and Windows makes none.
    """
    return sys.platform == "linux" and threading.active_count() == 1


def as_workers(workers: int | Executor | Workers | None) -> Workers | None:
    """The workers from whatever a caller passed."""
    if workers is None or isinstance(workers, Workers):
        return workers
    if isinstance(workers, Integral) and not isinstance(workers, bool):
        return Workers(n_workers=int(workers))
    if isinstance(workers, Executor):
        return Workers(workers)
    raise TypeError(f"workers must be a number or an executor, got {workers!r}")
