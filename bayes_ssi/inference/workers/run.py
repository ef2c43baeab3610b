"""How a calculation is carried out: its workers, its checkpoint and its reports of progress."""

from __future__ import annotations

import hashlib
import json
import logging
import re
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.codec import to_record
from bayes_ssi.foundations.packages import versions
from bayes_ssi.foundations.text_files import file_stem
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.cache import Cache, locked
from bayes_ssi.inference.workers.workers import Workers, as_workers

LOG = logging.getLogger("bayes_ssi")
LOG.addHandler(logging.NullHandler())

# Called with the name of what is computed (usually a model class), the name of the step, and the
# completed share of that step.
Progress = Callable[[str, str, float], None]


@dataclass(frozen=True, init=False, eq=False)
class Run:
    """How to carry out a calculation; no result depends on it.

    Attributes:
        workers: where models are evaluated; in this process if None. May be given as a number of
            processes on this machine, or as any ``concurrent.futures.Executor``. Several model
            classes are sampled side by side where there are at least as many as workers or their
            models are fast; otherwise workers share the evaluations of one.
        checkpoint: keeps every evaluation on disk, so that a run that was interrupted is resumed
            to the same result; nothing is kept if None. May be given as a directory, created if
            necessary inside an existing one. The caller removes it.
        progress: called with the name of a model class, the name of the step, and the completed
            share of the step; for a class sampled in a worker of another machine, only at its
            end. In a notebook, lines below the cell if None.

    Raises:
        ValueError: the number of workers is not positive.
        TypeError: the workers are neither a number nor an executor.
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


LOCK = "lock"  # a run holds this file of its checkpoint


@dataclass(frozen=True)
class Checkpoint:
    """Evaluations of model classes, kept in a directory with a file for each."""

    # Inside an existing one. A relative path starts in the working directory of this process, also
    # for its workers.
    directory: Path

    def __post_init__(self) -> None:
        object.__setattr__(self, "directory", Path(self.directory).absolute())

    def cache(self, model_class: ModelClass, *options: object) -> Cache:
        """The evaluations of one model class, closed by the caller.

        Those with other options, or with other versions of packages, are in another file.
        """
        self.directory.mkdir(exist_ok=True)
        parts = (model_class.name, _definition(model_class), *map(repr, options), str(versions()))
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
        return Cache(self.directory / f"{file_stem(model_class.name)}-{digest}")

    @contextmanager
    def locked(self) -> Iterator[bool]:
        """Keep other runs from it, also between model classes; yields whether anything is kept.

        The directory is removed at the end, unless it holds evaluations then.
        """
        self.directory.mkdir(exist_ok=True)
        try:
            with locked(self.directory / LOCK):
                yield any(self._files())
        finally:
            if not any(self.directory.iterdir()):
                self.directory.rmdir()

    def remove(self) -> None:
        """Remove all evaluations."""
        for path in self._files():
            path.unlink()

    def _files(self) -> list[Path]:
        return [path for path in self.directory.iterdir() if path.name != LOCK]


def _definition(model_class: ModelClass) -> str:
    """A digest of a model class, as far as its description tells classes apart."""
    with np.printoptions(threshold=sys.maxsize):  # arrays in full
        text = json.dumps(to_record(class_record(model_class)), sort_keys=True)
    # The default description of an object holds its address, which differs between processes.
    text = re.sub(r" at 0x[0-9a-fA-F]+", "", text)
    # The last digits of computed numbers depend on the processor.
    text = re.sub(r"\d+\.\d+(e[-+]\d+)?", lambda match: f"{float(match[0]):.9g}", text)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def notebook_progress() -> Progress | None:
    """What shows progress below the cell that runs; None outside of notebooks.

    A line for each name, replaced as it goes on, five times a second.
    """
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    if not getattr(shell, "kernel", None):
        return None
    lines: dict[str, str] = {}
    shown_at, handle = float("-inf"), None

    def show(name: str, step: str, done: float) -> None:
        nonlocal shown_at, handle
        lines[name] = f"{name}: {step} {100.0 * done:.0f} %"
        if done < 1.0 and time.monotonic() - shown_at < 0.2:
            return
        shown_at = time.monotonic()
        from IPython.display import display

        shown = {"text/plain": "\n".join(lines.values())}
        if handle is None:
            handle = display(shown, raw=True, display_id=True)
        else:
            handle.update(shown, raw=True)

    return show
