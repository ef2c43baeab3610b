"""Workers of this machine and of a Dask cluster, and the choice of workers."""

import multiprocessing
import sys
import threading
from collections.abc import Collection
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from numbers import Integral
from pathlib import Path
from tempfile import NamedTemporaryFile
from time import monotonic
from typing import IO, Any

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.inference.workers.workers import Workers, end_with_parent


class LocalWorkers(Workers):
    """Processes on this machine; they start at the first call and are replaced if they die."""

    def __init__(self, n: int, *, copies: bool = False) -> None:
        """Prepare ``n`` processes.

        ``copies`` starts them as copies of this process, where that is possible: at once, while a
        new process imports the package for about a second. There must be no state of other threads
        and libraries that a copy could stumble over.
        """
        if n < 1:
            raise ValueError(f"workers must be at least 1, got {n!r}")
        super().__init__(None, n)
        self.copies = copies
        self._file: IO[bytes] | None = None

    def _start(self) -> None:
        if self.copies and can_copy():
            self._executor = self._new_executor(multiprocessing.get_context("fork"))
            try:
                self._executor.submit(int).result()  # now, before a thread of this process begins
            except BrokenExecutor as death:
                self.abandon()
                problem = f"one of {self.n_workers} died while they started; is memory short?"
                raise ValueError(f"workers: {problem}") from death

    def _running(self) -> Executor:
        if self._executor is None:
            self._executor = self._new_executor(None)
        return self._executor

    def _new_executor(self, context: Any) -> Executor:
        from loky import ProcessPoolExecutor

        return ProcessPoolExecutor(self.n_workers, context=context, initializer=end_with_parent)

    def _content(self, data: bytes) -> Path:
        """Send a file: models may hold large matrices, and each process reads them only once."""
        self._remove_file()
        self._file = NamedTemporaryFile(prefix="bayes_ssi_")  # noqa: SIM115 - closed by _stop
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

    def _stop(self) -> None:
        self.abandon()
        self._remove_file()

    def abandon(self) -> None:
        """Stop the processes in the middle of what they do; the next call starts others."""
        executor, self._executor = self._executor, None
        if executor is not None:
            feeder = getattr(getattr(executor, "_call_queue", None), "_thread", None)
            # Loky's own argument: otherwise its workers would first finish their tasks.
            executor.shutdown(wait=True, kill_workers=True)  # type: ignore[call-arg]
            if feeder is not None:
                # Loky does not wait for the thread that feeds its queue. If this process ends while
                # that thread gives a semaphore back, it is half removed, which loky then reports.
                feeder.join()

    def _replace(self, death: BrokenExecutor) -> None:
        del death
        self.abandon()

    def _abandon(self, waiting: Collection[Future[Any]]) -> None:
        self.abandon()
        super()._abandon(waiting)


class DaskWorkers(Workers):
    """The workers of a Dask cluster, whose number may change.

    Entering connects to the scheduler, and waits for a cluster that is still starting.
    """

    cluster_seconds = 10.0  # to answer, to have its first worker, to replace its last one

    def __init__(self, address: str) -> None:
        """Use the cluster whose scheduler is at ``address``, as in tcp://host:8786."""
        super().__init__(None)
        self.address = address
        self._client: Any = None

    @property
    def n_workers(self) -> int:
        """Number of threads of all workers; 0 without a scheduler."""
        try:
            return sum(self._client.nthreads().values())
        except (OSError, RuntimeError):
            return 0

    def _start(self) -> None:
        with optional_package("Dask", extra="dask"):
            from dask.distributed import Client
            from distributed.comm import get_address_host_port
        try:
            # Closing a client of a malformed address hangs.
            get_address_host_port(self.address)
            self._client = Client(self.address, timeout=self.cluster_seconds, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise ValueError(f"no Dask scheduler answers at {self.address!r}: {error}") from error
        # Dask would take equal calls for one call.
        self._executor = self._client.get_executor(pure=False)
        try:
            self._client.wait_for_workers(1, timeout=self.cluster_seconds)
        except TimeoutError:
            self._stop()
            raise ValueError(
                f"the Dask cluster at {self.address!r} has no workers, not even after "
                f"{self.cluster_seconds:g} s"
            ) from None
        except BaseException:
            self._stop()
            raise

    def _stop(self) -> None:
        self._client.close()
        self._client = self._executor = None

    def _ready(self, waiting: Collection[Future[Any]]) -> Collection[Future[Any]]:
        """Futures that are ready; raises instead of waiting for workers that are gone."""
        seconds = self.cluster_seconds
        give_up = monotonic() + seconds
        while True:
            ready = wait(waiting, timeout=seconds / 10, return_when=FIRST_COMPLETED).done
            if any(future.cancelled() for future in ready):  # by Dask, without its scheduler
                raise ValueError("workers: an evaluation was cancelled; is the scheduler gone?")
            if ready:
                return ready
            if self.n_workers:
                give_up = monotonic() + seconds
            elif monotonic() > give_up:
                raise ValueError("workers: none is left")

    def _is_death(self, error: BaseException) -> bool:
        return super()._is_death(error) or type(error).__name__ == "KilledWorker"


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
        return LocalWorkers(int(workers))
    if isinstance(workers, Executor):
        return Workers(workers)
    raise TypeError(f"workers must be a number or an executor, got {workers!r}")
