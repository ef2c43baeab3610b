"""Executors to test workers with, and what they evaluate."""

import multiprocessing
import pickle
import threading
from collections import OrderedDict
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager

import numpy as np

from bayes_ssi.execution import in_workers
from bayes_ssi.execution.workers import Workers, as_workers


def points(n, d=2):
    """Some points, (n, d)."""
    return np.random.default_rng(5).standard_normal((n, d))


def sums(z):
    """A model."""
    return z.sum(axis=1)


class Minimal(Executor):
    """As little of an executor as some packages have: ``submit``, and arguments are pickled.

    ``stores`` are the models that its workers hold; the workers take turns.
    """

    def __init__(self, n_workers=1):
        self.payloads = []
        self.stores = [OrderedDict() for _ in range(n_workers)]
        self.before = in_workers._models

    def submit(self, function, /, *arguments):
        function, arguments = pickle.loads(pickle.dumps((function, arguments)))
        self.payloads += [a for a in arguments if isinstance(a, bytes)]
        in_workers._models = self.stores[0]
        self.stores.append(self.stores.pop(0))
        future = Future()
        try:
            future.set_result(function(*arguments))
        except (ValueError, ArithmeticError) as error:
            future.set_exception(error)
        finally:
            in_workers._models = self.before
        return future


@contextmanager
def own_executor(executor):
    with executor, as_workers(executor) as pool:
        yield pool


def spawning(n, initializer=None, *arguments):
    """Processes of the standard library that begin with a call."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(n, context, initializer, arguments)


class Late(Executor):
    """An executor whose answer comes after so many seconds."""

    def __init__(self, seconds):
        self.seconds = seconds

    def submit(self, function, /, *arguments):
        future = Future()
        timer = threading.Timer(
            self.seconds, lambda: future.cancelled() or future.set_result(function(*arguments))
        )
        timer.daemon = True
        timer.start()
        return future


class Death(BaseException):
    """What kills a worker of a :class:`Crew`; no model's own error."""


class Crew:
    """Workers in one process, which break like processes: with all that is under way.

    ``sizes`` are the numbers of points of the parts that were begun, ``n_deaths`` is how often
    the workers died.
    """

    def __init__(self, n_workers=2):
        self.sizes = []
        self.n_deaths = 0
        self.workers = Workers(n_workers=n_workers, make=lambda: _Breaking(self))


class _Breaking(Executor):
    """Calls at once, in turn, until one kills it."""

    def __init__(self, crew):
        self.crew = crew
        self.error = None

    def submit(self, function, /, *arguments):
        future = Future()
        if self.error is None:
            self.crew.sizes.append(len(arguments[2]))
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
