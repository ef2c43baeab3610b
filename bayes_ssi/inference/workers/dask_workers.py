"""The workers of a Dask cluster."""

from collections.abc import Collection
from concurrent.futures import FIRST_COMPLETED, Future, wait
from time import monotonic
from typing import Any

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.inference.workers.workers import Workers


class DaskWorkers(Workers):
    """The workers of a Dask cluster, whose number may change.

    Entering connects to the scheduler, and waits for a cluster that is still starting.
    """

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
        """Connect."""
        with optional_package("Dask", extra="dask"):
            from dask.distributed import Client
            from distributed.comm import get_address_host_port
        try:
            # Closing a client of a malformed address hangs.
            get_address_host_port(self.address)
            self._client = Client(
                self.address, timeout=self.settings.cluster_seconds, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ValueError(f"no Dask scheduler answers at {self.address!r}: {error}") from error
        # Dask would take equal calls for one call.
        self._executor = self._client.get_executor(pure=False)
        try:
            self._client.wait_for_workers(1, timeout=self.settings.cluster_seconds)
        except TimeoutError:
            self._stop()
            raise ValueError(
                f"the Dask cluster at {self.address!r} has no workers, not even after "
                f"{self.settings.cluster_seconds:g} s"
            ) from None
        except BaseException:
            self._stop()
            raise

    def _stop(self) -> None:
        self._client.close()
        self._client = self._executor = None

    def _ready(self, waiting: Collection[Future[Any]]) -> Collection[Future[Any]]:
        """Futures that are ready; raises instead of waiting for workers that are gone."""
        seconds = self.settings.cluster_seconds
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
