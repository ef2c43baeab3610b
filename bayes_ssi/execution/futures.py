"""Futures of an executor: handed over, waited for, and what their errors mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from time import monotonic
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["R", "cut", "first_ready", "is_death", "submitted", "told_error"]

CHECK_SECONDS = 5.0
# How often whoever waits is told so.
IDLE_SECONDS = 0.25
R = TypeVar("R")


def cut(rows: NDArray[np.intp], n: int) -> list[NDArray[np.intp]]:
    """At most ``n`` parts of nearly one size, none of them empty."""
    return [part for part in np.array_split(rows, n) if len(part)]


def first_ready(
    waiting: Mapping[Future[Any], int], idle: Callable[[], None] | None
) -> set[Future[Any]]:
    """Futures that are ready, none after some time; ``idle`` is called on the way."""
    seconds = CHECK_SECONDS if idle is None else IDLE_SECONDS
    ready: set[Future[Any]] = set()
    give_up = monotonic() + CHECK_SECONDS
    while not ready:
        ready, _ = wait(waiting, timeout=seconds, return_when=FIRST_COMPLETED)
        if idle is not None:
            idle()
        if monotonic() >= give_up:
            break
    return ready


def is_death(error: BaseException) -> bool:
    """Whether an error says that a worker died, and not that the evaluation went wrong."""
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def submitted(executor: Executor, function: Callable[..., R], *arguments: Any) -> Future[R]:
    try:
        return executor.submit(function, *arguments)
    except BrokenExecutor:
        raise
    except RuntimeError as error:  # it is shut down
        raise ValueError(f"workers: the executor takes no work: {error}") from error


def told_error(error: BaseException) -> BaseException:
    """What to raise for an error from a worker; a model's own errors are answers, not errors."""
    if isinstance(error, ValueError) or not isinstance(error, Exception):
        return error
    told = ValueError(f"workers: one cannot work: {type(error).__name__}: {error}")
    told.__cause__ = error
    return told
