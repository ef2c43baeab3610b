"""Workers: the evaluations of one batch spread over processes, a cluster, or any executor.

The engines are others': loky's processes, Dask, or whatever else is a
``concurrent.futures.Executor``, such as mpi4py's ``MPIPoolExecutor``. Here is what they have in
common: a batch is cut into parts, the model is sent once to each worker that asks for it, and
what becomes of a worker that dies. Since row i of an answer depends on row i alone, results do
not depend on the number of workers.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from functools import partial
from threading import Thread
from time import sleep
from types import TracebackType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayes_ssi.evaluation import Evaluated, Function, evaluate, joined
from bayes_ssi.priors import FloatArray

__all__ = ["Workers", "as_workers", "dask_workers", "local_workers"]

# Modules of study files carry this prefix; their content is sent along, since no worker could
# import them.
STUDY_MODULE = "bayes_ssi_study_"
# Parts of a batch for each worker: more than one, so that none waits long for the slowest.
PARTS_PER_WORKER = 4
# Parts where nobody knows how many workers there are.
PARTS_OF_UNKNOWN = 32
# How often a run may lose its workers before it gives up.
MAX_DEATHS = 20
CHECK_SECONDS = 5.0
# Checks in a row without a worker before a run gives up: a cluster may be replacing them.
CHECKS_WITHOUT_WORKERS = 6
MODELS_KEPT = 8
# How often a worker looks whether the process that made it is still there.
PARENT_SECONDS = 0.5

T = TypeVar("T")
R = TypeVar("R")

_models: OrderedDict[str, Function] = OrderedDict()


class Workers:
    """Where batches are evaluated.

    A context manager: leaving it shuts down the executors that it made itself.
    """

    def __init__(
        self,
        executor: Executor | None = None,
        *,
        n_workers: int | None = None,
        make: Callable[[], Executor] | None = None,
        alive: Callable[[], bool] = lambda: True,
    ) -> None:
        """Workers of an executor that exists, or of one that can be made anew.

        Args:
            executor: any ``concurrent.futures.Executor``; its owner shuts it down.
            n_workers: how many it has, if known.
            make: makes an executor, and another one when its workers have died.
            alive: whether there still are workers; asked while answers are waited for.
        """
        if (executor is None) == (make is None):
            raise TypeError("Workers: give either an executor or a way to make one")
        self._executor = executor
        self._make = make
        self._alive = alive
        self._n_workers = n_workers or 1
        self._n_parts = PARTS_PER_WORKER * n_workers if n_workers else PARTS_OF_UNKNOWN
        self._deaths = 0
        self._payload: tuple[Function, str, bytes] | None = None
        self._sent = False

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._make is not None:
            self._stop()

    def evaluate(self, function: Function, z: FloatArray) -> Evaluated:
        """``function`` at every row of ``z`` (B, d).

        A part whose worker died is tried once more; if that worker dies, too, its points are
        tried one by one, and a point at which a worker dies again counts as failed.

        Raises:
            ValueError: the function cannot be sent to a worker, there is no worker left, or
                workers die again and again.
        """
        parts: list[Evaluated | None]
        rows = [part for part in np.array_split(np.arange(len(z)), self._n_parts) if len(part)]
        parts = self._round(function, z, rows)
        if any(part is None for part in parts):
            lost = [i for i, part in enumerate(parts) if part is None]
            again = self._round(function, z, [rows[i] for i in lost])
            for i, part in zip(lost, again, strict=True):
                parts[i] = part
        return joined(
            [
                part if part is not None else self._one_by_one(function, z[own])
                for own, part in zip(rows, parts, strict=True)
            ]
        )

    def call_each(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: Callable[[int], None] | None = None,
    ) -> list[R]:
        """``function`` of every item, each in one worker, in the items' order.

        Args:
            function: picklable, and so are the items and the answers.
            items: as many as you like.
            done: called with the number of each item that is ready.

        An item whose worker died is tried again, as often as ``MAX_DEATHS`` allows.

        Raises:
            ValueError: an item cannot be sent, or workers die again and again.
        """
        answers: dict[int, R] = {}
        tasks = [_pickled(partial(function, item)) for item in items]
        while len(answers) < len(items):
            executor, died = self._running(), None
            waiting: dict[Future[Any], int] = {}
            try:
                for index in range(len(items)):
                    if index not in answers:
                        future = _submitted(executor, _call_there, tasks[index], os.getpid())
                        waiting[future] = index
                while waiting:
                    for future in self._wait(waiting):
                        index = waiting.pop(future)
                        error = future.exception()
                        if error is None:
                            answers[index] = future.result()
                            if done is not None:
                                done(index)
                        elif _is_death(error):
                            died = error
                        else:
                            raise _told(error)
            except BrokenExecutor as error:
                died = error
            finally:
                self._abandon(waiting)
            if died is not None:
                self._recover(died)
        return [answers[index] for index in range(len(items))]

    def _wait(self, waiting: Mapping[Future[Any], int]) -> set[Future[Any]]:
        """Futures that are ready; raises rather than wait for workers that are gone."""
        checks = 0
        while True:
            ready, _ = wait(waiting, timeout=CHECK_SECONDS, return_when=FIRST_COMPLETED)
            if any(future.cancelled() for future in ready):  # by Dask, without its scheduler
                raise ValueError("workers: an evaluation was cancelled; is the scheduler gone?")
            if ready:
                return ready
            checks = 0 if self._alive() else checks + 1
            if checks == CHECKS_WITHOUT_WORKERS:
                raise ValueError("workers: none is left")

    def _one_by_one(self, function: Function, z: FloatArray) -> Evaluated:
        """Every point alone, so that a death says which point is at fault."""
        found = []
        for row in range(len(z)):
            (part,) = self._round(function, z, [np.array([row])])
            dead = Evaluated(np.array([np.nan]), {0: "the worker that evaluated it died"})
            found.append(part if part is not None else dead)
        return joined(found)

    def _round(
        self, function: Function, z: FloatArray, rows: list[NDArray[np.intp]]
    ) -> list[Evaluated | None]:
        """Each part evaluated once; None where its worker died."""
        key, payload = self._packed(function)
        executor = self._running()
        send = None if self._sent else payload
        parts: list[Evaluated | None] = [None] * len(rows)
        died: BaseException | None = None
        waiting: dict[Future[Any], int] = {}
        owner = os.getpid()

        def submit(index: int, data: bytes | None) -> None:
            # The function is named, not sent: a worker imports this module.
            future = _submitted(executor, _evaluate_there, key, data, z[rows[index]], owner)
            waiting[future] = index

        try:
            for i in range(len(rows)):
                # Enough for every worker to have one; a worker that gets none asks.
                submit(i, send if i < self._n_workers else None)
            while waiting:
                for future in self._wait(waiting):
                    index = waiting.pop(future)
                    error = future.exception()
                    if error is not None and _is_death(error):
                        died = error
                    elif error is not None:
                        raise _told(error)
                    elif (answer := future.result()) is None:  # this worker has not seen the model
                        submit(index, payload)
                    else:
                        parts[index] = answer
        except BrokenExecutor as error:
            died = error
        finally:
            self._abandon(waiting)
        self._sent = True
        if died is not None:
            self._recover(died)
        return parts

    def _packed(self, function: Function) -> tuple[str, bytes]:
        """The function as bytes, and their digest; made once for each function."""
        # Bound methods are made anew at every access, and equal.
        if self._payload is None or self._payload[0] != function:
            data = _pickled(function)
            self._payload = (function, hashlib.blake2b(data, digest_size=16).hexdigest(), data)
            self._sent = False
        return self._payload[1:]

    def _running(self) -> Executor:
        if self._executor is None:
            assert self._make is not None
            self._executor = self._make()
            self._sent = False
        return self._executor

    def _recover(self, error: BaseException) -> None:
        """After a death: another executor where this one is of no more use."""
        self._deaths += 1
        if self._deaths > MAX_DEATHS:
            raise ValueError(
                f"workers: died {self._deaths} times, the last time with "
                f"{type(error).__name__}: {error}"
            ) from error
        if not isinstance(error, BrokenExecutor):
            return  # a cluster replaces its workers itself
        if self._make is None:
            raise ValueError(
                "workers: one died, and the executor that was given does not replace it: "
                f"{type(error).__name__}: {error}"
            ) from error
        self._stop()

    def _stop(self) -> None:
        """Shut down the executor that was made; what is still under way there is of no use."""
        executor, self._executor = self._executor, None
        if executor is not None:
            # Loky's own argument: its workers would finish their parts first.
            executor.shutdown(wait=True, kill_workers=True)  # type: ignore[call-arg]

    def _abandon(self, waiting: Mapping[Future[Any], int]) -> None:
        """Nobody waits any longer for what is under way."""
        if self._make is not None and waiting:
            self._stop()
        for future in waiting:
            future.cancel()


def local_workers(n: int) -> Workers:
    """``n`` processes on this machine; they start with the first batch.

    Raises:
        ValueError: ``n`` is not positive.
    """
    if n < 1:
        raise ValueError(f"workers must be at least 1, got {n!r}")

    def make() -> Executor:
        from loky import ProcessPoolExecutor

        executor: Executor = ProcessPoolExecutor(max_workers=n, initializer=_end_with_parent)
        return executor

    return Workers(n_workers=n, make=make)


def dask_workers(address: str) -> Workers:
    """The workers of a Dask cluster whose scheduler is at ``address``, as in tcp://host:8786.

    Raises:
        ValueError: Dask is not installed, or no scheduler answers.
    """
    try:
        from dask.distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError:
        raise ValueError(
            'Dask is not installed; install it with pip install "bayes_ssi[dask]"'
        ) from None
    try:
        get_address_host_port(address)  # a client of a malformed address hangs when it is closed
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"no Dask scheduler answers at {address!r}: {error}") from error

    def alive() -> bool:
        try:
            return bool(client.nthreads())
        except (OSError, RuntimeError):  # the scheduler is gone
            return False

    if not alive():
        client.close()
        raise ValueError(f"the Dask cluster at {address!r} has no workers")
    n = sum(client.nthreads().values())
    return _DaskWorkers(client, n, alive)


@contextmanager
def as_workers(workers: int | Executor | Workers | None) -> Iterator[Workers | None]:
    """Whatever a caller gave as workers; those made here are stopped in the end.

    Raises:
        ValueError: their number is not positive.
        TypeError: they are nothing that can evaluate.
    """
    if workers is None or isinstance(workers, Workers):
        yield workers
    elif isinstance(workers, int) and not isinstance(workers, bool):
        with local_workers(workers) as made:
            yield made
    elif isinstance(workers, Executor):
        yield Workers(workers)
    else:
        raise TypeError(f"workers must be a number or an executor, got {workers!r}")


class _DaskWorkers(Workers):
    """Workers of a Dask client, which is closed with them."""

    def __init__(self, client: Any, n_workers: int, alive: Callable[[], bool]) -> None:
        # An evaluation is a function of its arguments only as far as Dask can see.
        super().__init__(client.get_executor(pure=False), n_workers=n_workers, alive=alive)
        self._client = client

    def __exit__(self, *details: Any) -> None:
        self._client.close()


def _is_death(error: BaseException) -> bool:
    """Whether an error says that a worker died, and not that the evaluation went wrong."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def _submitted(executor: Executor, function: Callable[..., R], *arguments: Any) -> Future[R]:
    try:
        return executor.submit(function, *arguments)
    except BrokenExecutor:
        raise
    except RuntimeError as error:  # it is shut down
        raise ValueError(f"workers: the executor takes no work: {error}") from error


def _told(error: BaseException) -> BaseException:
    """What to raise for an error from a worker; a model's own errors are answers, not errors."""
    if isinstance(error, ValueError) or not isinstance(error, Exception):
        return error
    told = ValueError(f"workers: one cannot work: {type(error).__name__}: {error}")
    told.__cause__ = error
    return told


def _pickled(function: Callable[..., Any]) -> bytes:
    import cloudpickle

    studies = [m for name, m in sys.modules.items() if name.startswith(STUDY_MODULE)]
    for module in studies:
        cloudpickle.register_pickle_by_value(module)
    try:
        data: bytes = cloudpickle.dumps(function)
    except Exception as error:
        raise ValueError(
            f"the model cannot be sent to a worker: {type(error).__name__}: {error}"
        ) from error
    finally:
        for module in studies:
            cloudpickle.unregister_pickle_by_value(module)
    return data


def _end_with_parent() -> None:
    """In a worker of this machine: end when the process that made it is gone, however it went."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            sleep(PARENT_SECONDS)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _call_there(task: bytes, owner: int) -> Any:
    """In a worker: call what was sent."""
    return _rebuilt(task, owner)()


def _evaluate_there(key: str, payload: bytes | None, z: FloatArray, owner: int) -> Evaluated | None:
    """In a worker: the part of a batch; None if the model is not here yet.

    ``owner`` is the process that sent it; a worker may be a thread of the same.
    """
    if key not in _models:
        if payload is None:
            return None
        _models[key] = _rebuilt(payload, owner)
        while len(_models) > MODELS_KEPT:
            _models.popitem(last=False)
    return evaluate(_models[key], z)


def _rebuilt(payload: bytes, owner: int) -> Callable[..., Any]:
    """What was sent to this worker."""
    import cloudpickle

    try:
        function: Callable[..., Any] = cloudpickle.loads(payload)
    except Exception as error:
        raise ValueError(
            f"the model cannot be rebuilt in a worker: {type(error).__name__}: {error}"
        ) from error
    if os.getpid() != owner:
        # Threads of BLAS in several processes would only wait for one another.
        threadpool_limits(limits=1, user_api="blas")
    return function
