"""Evaluation of a batch, some points of which may fail: here, or by the workers of an executor.

Executors come from other packages: loky's processes, or any ``concurrent.futures.Executor``, such
as mpi4py's ``MPIPoolExecutor`` or that of a Dask client. Since row i of an answer depends on row i
alone, results do not depend on the number of workers. Functions arrive there pickled, and a worker
unpickles each of them only once.
"""

import hashlib
import multiprocessing.connection
import os
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Thread
from time import sleep
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.error_places import rows_at_fault, with_place

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
    """The workers of any executor, which its creator shuts down.

    A context manager that may be entered repeatedly. Subclasses start their own workers at the
    outermost entry, or at the first call, and stop them at the outermost exit.
    """

    parts_per_worker = 4  # of a batch: none should wait long for the slowest
    # Into which lost points are divided to be evaluated again, down to single points: four isolate
    # the point of a batch of 1024 at which a worker dies after six deaths at most.
    groups = 4
    most_deaths = 100  # enough to find some twenty points at which workers die

    def __init__(self, executor: Executor | None, n_workers: int = 8) -> None:
        """Use an executor; by ``n_workers``, where known, batches are divided into parts."""
        self._executor = executor
        self._n_workers = n_workers
        self._n_entered = 0
        self._n_deaths = 0
        self._packed: tuple[Callable[..., Any], PackedFunction] | None = None

    @property
    def n_workers(self) -> int:
        """Number of workers, where known."""
        return self._n_workers

    @property
    def n_parts(self) -> int:
        """Best number of parts to divide a batch into."""
        return self.parts_per_worker * max(self.n_workers, 1)

    def __enter__(self) -> "Workers":
        if not self._n_entered:
            self._start()
        self._n_entered += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._n_entered -= 1
        if not self._n_entered:
            self._stop()

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
            lost = np.concatenate(
                [p for i, p in enumerate(parts) if i not in answers] or [rows[:0]]
            )
            if len(lost) == len(rows) == 1 and suspect[rows[0]]:
                failures[int(rows[0])] = "the worker that evaluated it died"
            else:
                suspect[lost] = True
                groups += _divided(lost, self.groups)
        return Evaluated(values, failures)

    def call_each(self, function: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """As :meth:`try_each`, in the order of items; those whose worker died are tried again."""
        answers: dict[int, R] = {}
        while len(answers) < len(items):
            left = [i for i in range(len(items)) if i not in answers]
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
            if waiting:
                self._abandon(waiting)
        if death is not None:
            self._recover(death)
        return answers

    def _pack(self, function: Callable[..., Any]) -> "PackedFunction":
        """The function in the form that is sent, pickled again only when it changes."""
        # Every access creates a new bound method, but bound methods compare equal.
        if self._packed is None or self._packed[0] != function:
            data = pickled(function)
            packed = PackedFunction(digest_of(data), os.getpid(), self._content(data))
            self._packed = (function, packed)
        return self._packed[1]

    def _recover(self, death: BrokenExecutor) -> None:
        """Replace workers after one died, or give up."""
        self._n_deaths += 1
        if self._n_deaths > self.most_deaths:
            raise ValueError(
                f"workers: died {self._n_deaths} times, the last time with "
                f"{type(death).__name__}: {death}"
            ) from death
        self._replace(death)

    # Methods that subclasses override:

    def _start(self) -> None:
        """Start workers that must be there before the first call."""

    def _stop(self) -> None:
        """Stop workers that were started here."""

    def _running(self) -> Executor:
        assert self._executor is not None
        return self._executor

    def _content(self, data: bytes) -> Any:
        """What is sent for a pickled function: here the function itself, with every call."""
        return data

    def _replace(self, death: BrokenExecutor) -> None:
        """Replace an executor that is broken."""
        raise ValueError(
            "workers: one died, and the executor that was given does not replace it: "
            f"{type(death).__name__}: {death}"
        ) from death

    def _abandon(self, waiting: Collection[Future[Any]]) -> None:
        """Cancel calls whose results are no longer needed."""
        for future in waiting:
            future.cancel()


def _divided(rows: NDArray[np.intp], n: int) -> list[NDArray[np.intp]]:
    """At most ``n`` parts of nearly equal size, none of them empty."""
    return [part for part in np.array_split(rows, n) if len(part)]


def _submitted(executor: Executor, function: "PackedFunction", item: bytes) -> Future[Any]:
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


# Modules of study files carry this prefix. No worker could import them, so they are pickled too.
STUDY_MODULE = "bayes_ssi_study_"


@dataclass(frozen=True)
class PackedFunction:
    """A pickled function to be sent to workers."""

    digest: str
    sender: int = field(compare=False)
    content: bytes | Path = field(compare=False, repr=False)


def digest_of(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()


def pickled(what: object) -> bytes:
    """Any object as bytes, including the code from a study file that it needs."""
    import cloudpickle

    studies = [m for name, m in sys.modules.items() if name.startswith(STUDY_MODULE)]
    for module in studies:
        cloudpickle.register_pickle_by_value(module)
    try:
        data: bytes = cloudpickle.dumps(what)
    except Exception as error:
        raise ValueError(
            f"the model cannot be sent to a worker: {type(error).__name__}: {error}"
        ) from error
    finally:
        for module in studies:
            cloudpickle.unregister_pickle_by_value(module)
    return data


def call_packed(function: PackedFunction, item: bytes) -> Any:
    """The function's value at a pickled item."""
    return _unpacked(function)(_unpickled(item))


# Batch after batch is evaluated by the same function until a class is done.
@lru_cache(maxsize=1)
def _unpacked(function: PackedFunction) -> Callable[[Any], Any]:
    content = function.content
    data = content if isinstance(content, bytes) else content.read_bytes()
    unpacked: Callable[[Any], Any] = _unpickled(data)
    if os.getpid() != function.sender:  # a worker may be a thread of the same process
        # BLAS threads of several processes would compete for the same cores.
        threadpool_limits(limits=1, user_api="blas")
    return unpacked


def _unpickled(data: bytes) -> Any:
    import cloudpickle

    try:
        return cloudpickle.loads(data)
    except Exception as error:
        raise ValueError(
            f"the model cannot be rebuilt in a worker: {type(error).__name__}: {error}"
        ) from error


def end_with_parent() -> None:
    """End this process when its parent process is gone for any reason."""
    parent = os.getppid()
    process = multiprocessing.parent_process()
    # A copy of its parent has a pipe that breaks with it; other processes have to look.
    pipe: int | None = process.sentinel if process is not None else None

    def watch() -> None:
        while os.getppid() == parent:
            if pipe is None:
                sleep(0.5)
            else:
                multiprocessing.connection.wait([pipe], timeout=0.5)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
