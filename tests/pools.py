"""Executors to test workers with, and what they evaluate."""

import multiprocessing
import pickle
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager

import numpy as np

from bayes_ssi.inference.workers.workers import Workers


def points(n, d=2):
    """Some points, (n, d)."""
    return np.random.default_rng(5).standard_normal((n, d))


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


def spawning(n):
    """Processes of the standard library."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(n, context)
