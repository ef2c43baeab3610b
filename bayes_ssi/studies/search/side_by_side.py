"""Computations side by side, whose evaluations are made in common batches.

Of a small structure a batch takes hardly longer than one row, and a step of a chain or of an ascent
asks for a few rows only. Each computation has a thread of its own, which rests while it waits for
an answer; one thread at a time does anything. So nothing depends on their timing: what each asks
for, and the order of batches, are the same in every run.
"""

from collections.abc import Callable, Sequence
from contextvars import copy_context
from threading import Lock, Thread, get_ident
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
        if isinstance(answer, Exception):
            raise answer
        return answer

    def run(self, computations: Sequence[Callable[[], R]]) -> list[R]:
        """The results of all, which ask; the first exception that one of them raises is raised."""
        every = [_Computation[Q, A, R](function, self._running) for function in computations]
        try:
            waiting = [one for one in every if one.goes_on()]
            while waiting:
                answers = self._answer_all([one.question for one in waiting])
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
    question: Q
    answer: A | Exception
    result: R

    def __init__(
        self, function: Callable[[], R], running: "dict[int, _Computation[Q, A, Any]]"
    ) -> None:
        self._function, self._running = function, running
        self._error: BaseException | None = None
        self._ended = self._abandoned = False
        self._may_go_on, self._rests = Lock(), Lock()
        self._may_go_on.acquire()
        self._rests.acquire()
        # With numpy's treatment of floating-point errors, among others.
        self._thread = Thread(target=copy_context().run, args=[self._run], daemon=True)

    def goes_on(self) -> bool:
        """Let it run until it asks, or ends; whether it asks."""
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._may_go_on.release()
        self._rests.acquire()
        if self._error is not None:
            raise self._error
        return not self._ended

    def wait(self, question: Q) -> A | Exception:
        """In its thread: the answer."""
        self.question = question
        self._rests.release()
        self._may_go_on.acquire()
        if self._abandoned:
            raise _Abandoned
        return self.answer

    def abandon(self) -> None:
        """End it, if it has not ended, where it asks next."""
        if self._thread.ident is None:
            return
        self._abandoned = True
        if not self._ended and self._may_go_on.locked():
            self._may_go_on.release()
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
            self._ended = True
            self._rests.release()
