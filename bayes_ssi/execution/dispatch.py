"""Handing the parts of a batch to workers, and what becomes of those whose worker died."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from types import TracebackType
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.execution.batch import Evaluated, Function, evaluate
from bayes_ssi.execution.futures import R, cut, first_ready, is_death, submitted, told_error
from bayes_ssi.execution.in_workers import call_there, call_with_pickled, pickled

__all__ = ["Workers"]

# Parts of a batch for each worker: more than one, so that none waits long for the slowest.
PARTS_PER_WORKER = 4
# Parts where nobody knows how many workers there are.
PARTS_OF_UNKNOWN = 32
# Groups that points without an answer are cut into, to find those at which workers die.
GROUPS = 4
# Deaths that no point explains, and points at which workers die, before a run gives up.
MAX_DEATHS = 20
# Checks in a row without a worker before a run gives up: a cluster may be replacing them.
CHECKS_WITHOUT_WORKERS = 6

T = TypeVar("T")


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
        self._n_workers = n_workers
        self._deaths = 0
        self._deadly_points = 0
        self._last_death: BaseException | None = None
        self._payload: tuple[tuple[object, object], str, bytes] | None = None
        # Digest of the function that the workers of the present executor were sent.
        self._known: str | None = None

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

        Points whose worker died are cut into groups, each spread over all workers, down to single
        points; a point at which a worker dies again, alone, counts as failed.

        Raises:
            ValueError: the function cannot be sent to a worker, there is no worker left, or
                workers die again and again.
        """
        values = np.full(len(z), np.nan)
        failures: dict[int, str] = {}
        suspect = np.zeros(len(z), dtype=bool)
        deaths_before = self._deaths
        groups = cut(np.arange(len(z)), 1)
        while groups:
            rows = groups.pop()
            lost = self._evaluate_group(function, z, rows, values, failures)
            if len(rows) == 1 and len(lost) and suspect[rows[0]]:
                failures[int(rows[0])] = "the worker that evaluated it died"
                self._blame_point(deaths_before)
            else:
                suspect[lost] = True
                groups += cut(lost, GROUPS)
        return Evaluated(values, failures)

    def _evaluate_group(
        self,
        function: Function,
        z: FloatArray,
        rows: NDArray[np.intp],
        values: FloatArray,
        failures: dict[int, str],
    ) -> NDArray[np.intp]:
        """Fill in the answers at some rows of ``z``; returns the rows whose worker died."""
        parts = cut(rows, self._n_parts())

        def take(i: int, part: Evaluated) -> None:
            values[parts[i]] = part.values
            failures.update((int(parts[i][row]), why) for row, why in part.failures.items())

        lost = self._each_once(evaluate, function, [z[part] for part in parts], take)
        return np.concatenate([rows[:0], *(parts[i] for i in lost)])

    def call_each(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: Callable[[int], None] | None = None,
    ) -> list[R]:
        """``function`` of every item, each in one worker, in the items' order.

        Arguments and errors as those of :meth:`try_each`. An item whose worker died is tried
        again, as often as ``MAX_DEATHS`` allows.
        """
        answers: dict[int, R] = {}
        while len(answers) < len(items):
            left = [i for i in range(len(items)) if i not in answers]

            def tell(i: int, left: list[int] = left) -> None:
                if done is not None:
                    done(left[i])

            found = self.try_each(function, [items[i] for i in left], tell)
            answers.update((left[i], answer) for i, answer in found.items())
        return [answers[index] for index in range(len(items))]

    def try_each(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        done: Callable[[int], None] | None = None,
        idle: Callable[[], None] | None = None,
    ) -> dict[int, R]:
        """``function`` of every item, each in one worker; not of those whose worker died.

        Args:
            function: picklable, and so are the items and the answers.
            items: as many as you like.
            done: called with the number of each item that is ready.
            idle: called every now and then while answers are waited for.

        Raises:
            ValueError: an item cannot be sent, or workers die again and again.
        """
        answers: dict[int, R] = {}

        def take(i: int, answer: R) -> None:
            answers[i] = answer
            if done is not None:
                done(i)

        self._each_once(call_with_pickled, function, [pickled(item) for item in items], take, idle)
        return answers

    def _each_once(
        self,
        call: Callable[..., Any],
        function: Callable[..., Any],
        arguments: Sequence[Any],
        take: Callable[[int, Any], None],
        idle: Callable[[], None] | None = None,
    ) -> list[int]:
        """``call(function, argument)`` for every argument, in whatever order.

        ``take`` is given the number and the answer of each, and ``idle`` is called meanwhile;
        returns the numbers of those whose worker died.
        """
        key, payload = self._packed(call, function)
        executor = self._running()
        # Enough for every worker to have one; a worker that gets none asks.
        n_sent = 0 if key == self._known else self._count() or 1
        lost = set(range(len(arguments)))
        waiting: dict[Future[Any], int] = {}
        died: BaseException | None = None

        def submit(index: int, data: bytes | None) -> None:
            # What is called is named, not sent: a worker imports its module.
            arguments_there = (key, data, arguments[index], os.getpid())
            waiting[submitted(executor, call_there, *arguments_there)] = index

        try:
            for i in range(len(arguments)):
                submit(i, payload if i < n_sent else None)
            while waiting:
                for future in self._wait(waiting, idle):
                    index = waiting.pop(future)
                    error = future.exception()
                    if error is not None and is_death(error):
                        died = error
                    elif error is not None:
                        raise told_error(error)
                    elif not (answer := future.result()):  # this worker has not seen the function
                        submit(index, payload)
                    else:
                        take(index, *answer)
                        lost.discard(index)
        except BrokenExecutor as error:
            died = error
        finally:
            self._abandon(waiting)
        self._known = key
        if died is not None:
            self._recover(died)
        return sorted(lost)

    def _wait(
        self, waiting: Mapping[Future[Any], int], idle: Callable[[], None] | None
    ) -> set[Future[Any]]:
        """Futures that are ready; raises rather than wait for workers that are gone."""
        checks = 0
        while True:
            ready = first_ready(waiting, idle)
            if any(future.cancelled() for future in ready):  # by Dask, without its scheduler
                raise ValueError("workers: an evaluation was cancelled; is the scheduler gone?")
            if ready:
                return ready
            checks = 0 if self._alive() else checks + 1
            if checks == CHECKS_WITHOUT_WORKERS:
                raise ValueError("workers: none is left")

    def _packed(self, call: Callable[..., Any], function: Callable[..., Any]) -> tuple[str, bytes]:
        """What is sent as bytes, and their digest; made once for each function."""
        # Bound methods are made anew at every access, and equal.
        if self._payload is None or self._payload[0] != (call, function):
            data = pickled(partial(call, function))
            digest = hashlib.blake2b(data, digest_size=16).hexdigest()
            self._payload = ((call, function), digest, data)
        return self._payload[1:]

    def _count(self) -> int | None:
        """How many workers there are, if known."""
        return self._n_workers

    def _n_parts(self) -> int:
        n_workers = self._count()
        return PARTS_PER_WORKER * n_workers if n_workers else PARTS_OF_UNKNOWN

    def _running(self) -> Executor:
        if self._executor is None:
            assert self._make is not None
            self._executor = self._make()
            self._known = None
        return self._executor

    def _recover(self, error: BaseException) -> None:
        """After a death: another executor where this one is of no more use."""
        self._last_death = error
        self._deaths += 1
        if self._deaths > MAX_DEATHS:
            self._give_up(f"{self._deaths} times")
        if not isinstance(error, BrokenExecutor):
            return  # a cluster replaces its workers itself
        if self._make is None:
            raise ValueError(
                "workers: one died, and the executor that was given does not replace it: "
                f"{type(error).__name__}: {error}"
            ) from error
        self._stop()

    def _blame_point(self, deaths_before: int) -> None:
        """A point explains the deaths that it took to find it."""
        self._deaths = deaths_before
        self._deadly_points += 1
        if self._deadly_points > MAX_DEATHS:
            self._give_up(f"at {self._deadly_points} points")

    def _give_up(self, how_often: str) -> NoReturn:
        error = self._last_death
        raise ValueError(
            f"workers: died {how_often}, the last time with {type(error).__name__}: {error}"
        ) from error

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
