"""Sampling of several model classes: one after another, or side by side in workers.

Workers can take whole classes, or share the evaluations of one. Whole classes keep all workers
busy when there are at least as many classes as workers. With fewer classes, evaluations are
shared, except those of small matrices and of approximate structures: these are solved in batches,
in less time than it takes to send them. Results do not depend on this choice.
"""

import json
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FunctionType
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import pareto_k
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import RefinementSettings
from bayes_ssi.inference.posterior_sampling.sample import sample
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Checkpoint, Run
from bayes_ssi.inference.workers.workers import Workers, can_copy, usable_cores


@dataclass(frozen=True)
class ProgressFile:
    """The last report of one piece of work; called by it like any function of progress.

    Where the file cannot be written, as by a worker on another machine, nothing is reported.
    """

    path: Path

    def __call__(self, name: str, step: str, done: float) -> None:
        # Replaced as a whole: what is read is never half a report.
        new = self.path.with_suffix(".new")
        with suppress(OSError):
            new.write_text(json.dumps([name, step, done]), encoding="utf-8")
            new.replace(self.path)

    def read(self) -> tuple[str, str, float] | None:
        try:
            name, step, done = json.loads(self.path.read_text(encoding="utf-8"))
        except OSError:
            return None
        return name, step, done


# The last step of a class, completed.
END = ("evidence", 1.0)


def sample_all(
    candidates: Sequence[ModelClass],
    seed: int,
    settings: SamplingSettings,
    run: Run | None = None,
    refinement: RefinementSettings | None = None,
    known_starts: Sequence[FloatArray | None] = (),
) -> list[Posterior]:
    """Sample several classes; the posteriors are in their order.

    Args:
        run: progress of a class sampled as a whole by a worker of another machine is reported at
            its end. If the worker of a class died, the class's evaluations are shared, so that the
            points at which workers die are isolated.
        known_starts: for each class, if given, where an earlier search found maxima.
    """
    run = run or Run()
    sampled = partial(sample, seed=seed, settings=settings, refinement=refinement)
    with run.working():
        items = list(zip_longest(candidates, known_starts))
        posteriors = _side_by_side(items, sampled, run)
        for i, (candidate, starts) in enumerate(items):
            if i not in posteriors:
                posteriors[i] = sampled(candidate, run=run, known_starts=starts)
        return [posteriors[i] for i in range(len(items))]


def _side_by_side(
    items: Sequence[tuple[ModelClass, FloatArray | None]],
    sampled: Callable[..., Posterior],
    run: Run,
) -> dict[int, Posterior]:
    """Posteriors of whole classes, each sampled in one worker; none where the worker died."""
    if run.workers is None or len(items) == 1:
        return {}
    candidates = [candidate for candidate, _ in items]
    all_whole = len(candidates) >= run.workers.n_workers
    whole = [i for i, each in enumerate(candidates) if all_whole or is_cheap(each)]
    # The largest first: none should keep a single worker busy at the end.
    whole.sort(key=lambda i: -len(candidates[i].parameters))
    names = [candidates[i].name for i in whole]
    with TemporaryDirectory(prefix="bayes_ssi_") as directory:
        files = [ProgressFile(Path(directory, str(k))) for k in range(len(whole))]
        known: dict[ProgressFile, tuple[str, str, float]] = {}

        def relay() -> None:
            """Pass on what workers report; their end is reported elsewhere."""
            for file in files:
                report = file.read()
                if report is not None and report != known.get(file):
                    known[file] = report
                    if report[1:] != END:
                        run.report(*report)

        if run.workers.executor is not None:
            for name in names:
                run.report(name, "in a worker", 0.0)
        posteriors = run.workers.try_each(
            partial(_sample_in_worker, sampled=sampled, checkpoint=run.checkpoint),
            [(*items[i], file) for i, file in zip(whole, files, strict=True)],
            lambda k: run.report(names[k], *END),
            relay,
        )
    return {whole[k]: posterior for k, posterior in posteriors.items()}


def _sample_in_worker(
    item: tuple[ModelClass, FloatArray | None, ProgressFile],
    sampled: Callable[..., Posterior],
    checkpoint: Checkpoint | None,
) -> Posterior:
    candidate, starts, progress = item
    run = Run(checkpoint=checkpoint, progress=progress)
    return sampled(candidate, run=run, known_starts=starts)


def is_cheap(candidate: ModelClass) -> bool:
    """Whether all structures have small matrices or are approximate."""
    return all(test.structure.is_cheap for test in candidate.configurations)


# Their objects have no state beyond themselves.
KNOWN_PACKAGES = {"bayes_ssi", "numpy", "scipy", *sys.stdlib_module_names}


def holds_user_code(what: object) -> bool:
    """Whether ``what`` holds functions, or objects of classes, that a user wrote or imported.

    These may have a state, such as open files, a licence, or a counter, that processes do not
    share. So may objects that cannot be pickled.
    """
    import cloudpickle

    class Inspector(cloudpickle.Pickler):
        def reducer_override(self, item: Any) -> Any:
            kind = item if isinstance(item, type | FunctionType) else type(item)
            if kind.__module__.partition(".")[0] not in KNOWN_PACKAGES:
                raise TypeError(f"{kind.__module__} is a user's own")
            return super().reducer_override(item)

    try:
        # Arrays are handed to the callback, which drops them, instead of being copied.
        Inspector(BytesIO(), protocol=5, buffer_callback=lambda _: None).dump(what)
    except Exception:  # noqa: BLE001 - whatever an object's own pickling may raise
        return True
    return False


# A new process takes about a second to import the package, the smallest classes half a second to
# be sampled: two processes save as much as they cost from here on.
CLASSES_FOR_NEW_PROCESSES = 4


def automatic_workers(candidates: Sequence[ModelClass], n_classes: int) -> Workers | None:
    """One process for each core that can be used, as far as they are busy; None if one is enough.

    None, too, where models hold a user's own code (see :func:`holds_user_code`), or classes are
    few and every process would have to import the package anew.
    """
    n = usable_cores()
    if all(map(is_cheap, candidates)):
        n = min(n, n_classes)
        if not can_copy() and n_classes < CLASSES_FOR_NEW_PROCESSES:
            return None
    if n == 1 or holds_user_code(list(candidates)):
        return None
    return _copies(n)


def chosen_workers(candidates: Sequence[ModelClass], n: int) -> Workers:
    n = min(n, usable_cores())
    if holds_user_code(list(candidates)):
        return Workers(n_workers=n)
    return _copies(n)


def _copies(n: int) -> Workers:
    """Processes that are copies of this one, where that is possible, with all that they need."""
    if can_copy():  # once here, not in every copy; what arviz needs it imports when asked
        import emcee  # noqa: F401

        pareto_k(np.arange(100.0))
    return Workers(n_workers=n, copies=True)
