"""Workers: the evaluations of one batch spread over processes, a cluster, or any executor.

The engines are others': loky's processes, Dask, or whatever else is a
``concurrent.futures.Executor``, such as mpi4py's ``MPIPoolExecutor``. Since row i of an answer
depends on row i alone, results do not depend on the number of workers.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from numbers import Integral
from time import monotonic, sleep
from typing import Any

from bayes_ssi.execution.dispatch import Workers
from bayes_ssi.execution.in_workers import end_with_parent

__all__ = ["Workers", "as_workers", "dask_workers", "local_workers"]

# How long a cluster may take to answer, and again to have its first worker.
CLUSTER_SECONDS = 10.0


def local_workers(n: int) -> Workers:
    """``n`` processes on this machine; they start with the first batch.

    Raises:
        ValueError: ``n`` is not positive.
    """
    if n < 1:
        raise ValueError(f"workers must be at least 1, got {n!r}")

    def make() -> Executor:
        from loky import ProcessPoolExecutor

        executor: Executor = ProcessPoolExecutor(max_workers=n, initializer=end_with_parent)
        return executor

    return Workers(n_workers=n, make=make)


def dask_workers(address: str) -> Workers:
    """The workers of a Dask cluster whose scheduler is at ``address``, as in tcp://host:8786.

    A cluster that is only starting is waited for.

    Raises:
        ValueError: Dask is not installed, no scheduler answers, or it has no workers.
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
        client = Client(address, timeout=CLUSTER_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(f"no Dask scheduler answers at {address!r}: {error}") from error
    try:
        give_up = monotonic() + CLUSTER_SECONDS
        while not _n_threads(client):
            if monotonic() > give_up:
                raise ValueError(
                    f"the Dask cluster at {address!r} has no workers, not even after "
                    f"{CLUSTER_SECONDS:g} s"
                )
            sleep(0.1)
    except BaseException:
        client.close()
        raise
    return _DaskWorkers(client)


@contextmanager
def as_workers(workers: int | Executor | Workers | None) -> Iterator[Workers | None]:
    """Whatever a caller gave as workers; those made here are stopped in the end.

    Raises:
        ValueError: their number is not positive.
        TypeError: they are nothing that can evaluate.
    """
    if workers is None or isinstance(workers, Workers):
        yield workers
    elif isinstance(workers, Integral) and not isinstance(workers, bool):
        with local_workers(int(workers)) as made:
            yield made
    elif isinstance(workers, Executor):
        yield Workers(workers)
    else:
        raise TypeError(f"workers must be a number or an executor, got {workers!r}")


class _DaskWorkers(Workers):
    """Workers of a Dask client, which is closed with them."""

    def __init__(self, client: Any) -> None:
        # An evaluation is a function of its arguments only as far as Dask can see.
        super().__init__(client.get_executor(pure=False), alive=lambda: _n_threads(client) > 0)
        self._client = client

    def _count(self) -> int:
        """As many as there are now: a cluster grows and shrinks."""
        return _n_threads(self._client)

    def __exit__(self, *_: object) -> None:
        self._client.close()


def _n_threads(client: Any) -> int:
    """Of all workers of a Dask client; none without its scheduler."""
    try:
        return sum(client.nthreads().values())
    except (OSError, RuntimeError):
        return 0
