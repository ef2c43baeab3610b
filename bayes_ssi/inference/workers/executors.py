"""Workers of this machine, and the choice of workers."""

import multiprocessing
import sys
import threading
from collections.abc import Collection
from concurrent.futures import BrokenExecutor, Executor, Future
from numbers import Integral
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO, Any

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
