"""Executors to test workers with, and what they evaluate."""

import multiprocessing
import pickle
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager

import numpy as np

from bayes_ssi.inference.workers.workers import Workers


def points(n, d=2):
    """Some points, (n, d)."""
    return np.random.default_rng(5).standard_normal((n, d))


def numbered(n):
    """Points (n, 1) that are their own row numbers."""
    return np.arange(float(n))[:, None]


def sums(z):
    """A model."""
    return z.sum(axis=1)


class Minimal(Executor):
    """A minimal executor, as some packages have it: only ``submit``, with pickled arguments."""

    def submit(self, function, /, *arguments):
        function, arguments = pickle.loads(pickle.dumps((function, arguments)))
        future = Future()
        try:
            future.set_result(function(*arguments))
        except (ValueError, ArithmeticError) as error:
            future.set_exception(error)
        return future


@contextmanager
def workers_of(executor):
    with executor:
        yield Workers(executor, 2)


def spawning(n, initializer=None, *arguments):
    """Processes of the standard library that begin with a call."""
    return ProcessPoolExecutor(n, multiprocessing.get_context("spawn"), initializer, arguments)


class Death(BaseException):
    """What kills a worker of a :class:`Crew`; no model's own error."""


class Crew(Workers):
    """Workers in one process that break as processes do: with all calls under way.

    ``n_calls`` is the number of calls begun, ``n_deaths`` the number of deaths.
    """

    def __init__(self, n_workers=2):
        super().__init__(n_workers=n_workers)
        self.n_calls = self.n_deaths = 0

    def _running(self):
        self._processes = self._processes or _Breaking(self)
        return self._processes

    def _content(self, data):
        return data


class _Breaking(Executor):
    """Calls at once, in turn, until one kills it."""

    def __init__(self, crew):
        self.crew = crew
        self.error = None

    def submit(self, function, /, *arguments):
        future = Future()
        if self.error is None:
            self.crew.n_calls += 1
            try:
                future.set_result(function(*arguments))
            except Death:
                self.crew.n_deaths += 1
                self.error = BrokenExecutor("a worker died")
        if self.error is not None:
            future.set_exception(self.error)
        return future

    def shutdown(self, wait=True, *, cancel_futures=False, kill_workers=False):
        del wait, cancel_futures, kill_workers
