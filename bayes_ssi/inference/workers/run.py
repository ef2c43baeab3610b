"""How a calculation is carried out: its workers, checkpoint and progress reports."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from bayes_ssi.foundations.notebook import notebook_progress
from bayes_ssi.inference.workers.checkpoint import Checkpoint
from bayes_ssi.inference.workers.local_workers import as_workers
from bayes_ssi.inference.workers.workers import Workers

LOG = logging.getLogger("bayes_ssi")
LOG.addHandler(logging.NullHandler())

# Called with the name of what is computed (usually a model class), the name of the step, and the
# completed share of that step.
Progress = Callable[[str, str, float], None]


@dataclass(frozen=True, init=False, eq=False)
class Run:
    """How to carry out a calculation; no result depends on it.

    Attributes:
        workers: where models are evaluated; in this process if None. Several model classes are
            sampled side by side where there are at least as many as workers or their models are
            fast; otherwise workers share the evaluations of one.
        checkpoint: keeps every evaluation on disk, so that a run that was interrupted is resumed
            to the same result; nothing is kept if None. The caller removes it.
        progress: called with the name of a model class, the name of the step, and the completed
            share of the step; for a class sampled in a worker of another machine, only at its
            end. In a notebook, lines below the cell if None.
    """

    workers: Workers | None
    checkpoint: Checkpoint | None
    progress: Progress | None

    def __init__(
        self,
        workers: int | Executor | Workers | None = None,
        checkpoint: str | Path | Checkpoint | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Choose workers, checkpoint and progress.

        Args:
            workers: may also be a number of processes on this machine, or any
                ``concurrent.futures.Executor``.
            checkpoint: may also be a directory, created if necessary inside an existing one.
            progress: as the attribute.

        Raises:
            ValueError: the number of workers is not positive.
            TypeError: the workers are neither a number nor an executor.
        """
        if isinstance(checkpoint, (str, Path)):
            checkpoint = Checkpoint(Path(checkpoint))
        object.__setattr__(self, "workers", as_workers(workers))
        object.__setattr__(self, "checkpoint", checkpoint)
        object.__setattr__(self, "progress", progress or notebook_progress())

    @contextmanager
    def working(self) -> Iterator[None]:
        """Keep the workers running; at the outermost exit, stop those that were started here."""
        with self.workers or nullcontext():
            yield

    def report(self, name: str, step: str, done: float) -> None:
        """Report the completed share ``done`` of a ``step`` of the class ``name``, and log it."""
        level = logging.INFO if done >= 1.0 else logging.DEBUG
        LOG.log(level, "%s: %s %.0f %%", name, step, 100.0 * done)
        if self.progress is not None:
            self.progress(name, step, done)
