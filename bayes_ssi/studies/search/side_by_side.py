"""Computations side by side, whose evaluations are made in common batches.

Of a small structure a batch takes hardly longer than one row, and a step of a chain or of an ascent
asks for a few rows only. Each computation has a thread of its own, which rests while it waits for
an answer; one thread at a time does anything. So nothing depends on their timing: what each asks
for, and the order of batches, are the same in every run.
"""

from collections.abc import Callable, Sequence
from contextvars import copy_context
from queue import SimpleQueue
from threading import Thread, get_ident
from typing import Any, Generic, TypeVar

Q = TypeVar("Q")
A = TypeVar("A")
R = TypeVar("R")


class SideBySide(Generic[Q, A]):
    """Answers the questions of several computations at once.

    Args:
        answer_all: an answer to each of several questions; an exception to one of them is raised
            where it was asked.
    """

    def __init__(self, answer_all: Callable[[Sequence[Q]], Sequence[A | Exception]]) -> None:
        self._answer_all = answer_all
        self._running: dict[int, _Computation[Q, A, Any]] = {}  # by the number of its thread

    def ask(self, question: Q) -> A:
        """The answer, with those to the questions that the other computations ask meanwhile."""
        own = self._running.get(get_ident())
        answer = own.wait(question) if own else self._answer_all([question])[0]
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def run(self, computations: Sequence[Callable[[], R]]) -> list[R]:
        """The results of all, which ask; the first exception that one of them raises is raised."""
        every = [_Computation[Q, A, R](function, self._running) for function in computations]
        try:
            waiting = [one for one in every if one.goes_on()]
            while waiting:
                answers = self._answer_all([one.asked[0] for one in waiting])
                for one, answer in zip(waiting, answers, strict=True):
                    one.answer = answer
                waiting = [one for one in waiting if one.goes_on()]
        finally:
            for one in every:
                one.abandon()
        return [one.result for one in every]


class _Abandoned(BaseException):
    """Raised in a computation whose answer will not come."""


class _Computation(Generic[Q, A, R]):
    asked: tuple[Q, ...]  # none at the end
    answer: A | Exception
    result: R

    def __init__(
        self, function: Callable[[], R], running: "dict[int, _Computation[Q, A, Any]]"
    ) -> None:
        self._function, self._running = function, running
        self._error: BaseException | None = None
        self._questions = SimpleQueue[tuple[Q, ...]]()
        self._answers = SimpleQueue[A | BaseException]()
        # With numpy's treatment of floating-point errors, among others.
        self._thread = Thread(target=copy_context().run, args=[self._run], daemon=True)

    def goes_on(self) -> bool:
        """Let it run until it asks, or ends; whether it asks."""
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._answers.put(self.answer)
        self.asked = self._questions.get()
        if self._error is not None:
            raise self._error
        return bool(self.asked)

    def wait(self, question: Q) -> A | BaseException:
        """In its thread: the answer."""
        self._questions.put((question,))
        return self._answers.get()

    def abandon(self) -> None:
        """End it, if it has not ended, where it asks next."""
        if self._thread.ident is not None:
            self._answers.put(_Abandoned())
            self._thread.join()

    def _run(self) -> None:
        self._running[get_ident()] = self
        try:
            self.result = self._function()
        except _Abandoned:
            pass
        except BaseException as error:  # noqa: BLE001 - raised where the others are run
            self._error = error
        finally:
            del self._running[get_ident()]
            self._questions.put(())
