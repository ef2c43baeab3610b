"""Worker processes on this machine, and the choice of workers."""

from __future__ import annotations

from collections.abc import Collection
from concurrent.futures import BrokenExecutor, Executor, Future
from numbers import Integral
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO, Any

from bayes_ssi.execution.remote import end_with_parent
from bayes_ssi.execution.workers import Workers


class LocalWorkers(Workers):
    """Processes on this machine; they start at the first call and are replaced if they die."""

    def __init__(self, n: int) -> None:
        """Prepare ``n`` processes.

        Raises:
            ValueError: ``n`` is not positive.
        """
        if n < 1:
            raise ValueError(f"workers must be at least 1, got {n!r}")
        super().__init__(None, n)
        self._file: IO[bytes] | None = None

    def _running(self) -> Executor:
        from loky import ProcessPoolExecutor

        if self._executor is None:
            self._executor = ProcessPoolExecutor(self.n_workers, initializer=end_with_parent)
        return self._executor

    def _content(self, data: bytes) -> Path:
        """Send a file: models may hold large matrices, and each process reads them only once."""
        self._remove_file()
        self._file = NamedTemporaryFile(prefix="bayes_ssi_")  # noqa: SIM115 - closed by _stop
        self._file.write(data)
        self._file.flush()
        return Path(self._file.name)

    def _remove_file(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = self._packed = None

    def _stop(self) -> None:
        self._stop_processes()
        self._remove_file()

    def _stop_processes(self) -> None:
        executor, self._executor = self._executor, None
        if executor is not None:
            # Loky's own argument: otherwise its workers would first finish their tasks.
            executor.shutdown(wait=True, kill_workers=True)  # type: ignore[call-arg]

    def _replace(self, death: BrokenExecutor) -> None:
        del death
        self._stop_processes()

    def _abandon(self, waiting: Collection[Future[Any]]) -> None:
        self._stop_processes()
        super()._abandon(waiting)


def as_workers(workers: int | Executor | Workers | None) -> Workers | None:
    """The workers from whatever a caller passed.

    Raises:
        ValueError: their number is not positive.
        TypeError: they cannot evaluate anything.
    """
    if workers is None or isinstance(workers, Workers):
        return workers
    if isinstance(workers, Integral) and not isinstance(workers, bool):
        return LocalWorkers(int(workers))
    if isinstance(workers, Executor):
        return Workers(workers)
    raise TypeError(f"workers must be a number or an executor, got {workers!r}")
