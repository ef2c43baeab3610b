"""How a calculation is carried out: its workers, its checkpoint and its reports of progress.

A checkpoint is a journal for each model class, all in one directory.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.codec import to_record
from bayes_ssi.foundations.packages import versions
from bayes_ssi.foundations.text_files import file_stem
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.journal import DamagedJournalError, Journal, OtherRunError
from bayes_ssi.inference.workers.workers import Workers, as_workers

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


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


# This file exists from the moment the run begins to write its result.
SAVING = "saving"
# This one while a run uses the checkpoint.
LOCK = "lock"
SUFFIX = ".journal"


def _warn(text: str) -> None:
    warnings.warn(text, RuntimeWarning, stacklevel=3)


def _keep_quiet(text: str) -> None:
    del text


@dataclass(frozen=True)
class Checkpoint:
    """Journals of the model classes of one run."""

    # Holds the journals; created with the first one, inside an existing directory. A relative path
    # starts in the working directory of this process, also for its workers.
    directory: Path
    run: str = field(default="", kw_only=True)
    discard_others: bool = field(default=False, kw_only=True)
    # Called with a message when an earlier run is resumed, and when a journal is damaged or was
    # made on another kind of processor; issues a warning by default.
    say: Callable[[str], None] = field(default=_warn, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "directory", Path(self.directory).absolute())

    def journal(self, model_class: ModelClass, seed: int, settings: DataclassInstance) -> Journal:
        """The journal of one model class, closed by the caller; a damaged one is replaced."""
        self.directory.mkdir(exist_ok=True)
        path = self._path(model_class.name)
        begun = path.exists()
        run = {
            "model class": model_class.name,
            "definition": _definition(model_class),
            "seed": seed,
            **asdict(settings),
            **versions(),
        }
        try:
            journal = Journal(path, run, self.say)
        except DamagedJournalError as error:
            self.say(f"{error}; everything is computed again")
        except OtherRunError:
            if not self.discard_others:
                raise
        else:
            if begun:
                kept = f"resumes after {journal.n_kept} evaluations"
                words = kept if journal.n_kept else "begins again, as no evaluation was kept"
                self.say(f"model class {model_class.name!r}: {words}")
            return journal
        _remove(path)
        return Journal(path, run, self.say)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs from this checkpoint, also between two model classes and while saving.

        Where an earlier run was killed before it began a journal, as in the first steps of a
        search, a message says so.
        """
        begun = self.directory.is_dir()
        self.directory.mkdir(exist_ok=True)
        left_behind = [path.name for path in self.directory.iterdir()]
        # A journal without evaluations: its lock ends with this process, however that ends.
        lock = Journal(self.directory / LOCK, {})
        if begun and not any(name.endswith((SUFFIX, SAVING)) for name in left_behind):
            self.say("an earlier run was interrupted before it kept an evaluation; begins again")
        try:
            yield
        finally:
            lock.close()
            _remove(lock.path)
            self._remove_if_empty()

    def silent(
        self, model_classes: Iterable[ModelClass], seed: int, settings: DataclassInstance
    ) -> Checkpoint:
        """The same for other processes, once it is said which of these classes are resumed."""
        quiet, resumed = replace(self, say=_keep_quiet), []
        for each in model_classes:
            if self._path(each.name).exists():
                with quiet.journal(each, seed, settings) as journal:  # refused if of another run
                    resumed += [each.name] if journal.n_kept else []
        if resumed:
            self.say(f"resumes an earlier run of {', '.join(map(repr, resumed))}")
        return quiet

    @property
    def is_saving(self) -> bool:
        """Whether this run was interrupted while, or after, it wrote its result."""
        marker = self.directory / SAVING
        return marker.exists() and marker.read_text(encoding="utf-8") == self.run

    def begin_saving(self) -> None:
        """Mark the result directory as this run's own from now on."""
        (self.directory / SAVING).write_text(self.run, encoding="utf-8")

    def remove(self, names: Iterable[str] | None = None) -> None:
        """Remove the journals of these or all classes, and the directory if it is then empty."""
        journals = self.directory.glob(f"*{SUFFIX}") if names is None else map(self._path, names)
        for path in journals:
            _remove(path)
        (self.directory / SAVING).unlink(missing_ok=True)
        self._remove_if_empty()

    def _remove_if_empty(self) -> None:
        if self.directory.exists() and not any(self.directory.iterdir()):
            self.directory.rmdir()

    def _path(self, name: str) -> Path:
        stem = file_stem(name)
        digest = hashlib.sha256(name.encode()).hexdigest()[:8]
        return self.directory / f"{stem}-{digest}{SUFFIX}"


def _remove(journal: Path) -> None:
    """Remove a journal and the file that SQLite leaves next to it if a run is killed."""
    for path in (journal.with_name(f"{journal.name}-journal"), journal):
        path.unlink(missing_ok=True)


def name_of_run(model_classes: Iterable[ModelClass], *options: object) -> str:
    """A digest that identifies a run by its model classes and all else that determines it."""
    parts = [*map(_definition, model_classes), *map(repr, options)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


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
    """What shows progress below the cell that runs; None outside of notebooks."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return _notebook_lines() if getattr(shell, "kernel", None) else None


def _notebook_lines() -> Progress:
    """A line for each name, replaced as it goes on, five times a second."""
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
