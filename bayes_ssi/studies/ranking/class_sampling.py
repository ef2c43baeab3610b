"""Sampling of several model classes: one after another, or side by side in workers.

Workers can take whole classes, or share the evaluations of one. Whole classes keep all workers
busy when there are at least as many classes as workers. With fewer classes, evaluations are
shared, except those of small matrices and of approximate structures: these are solved in batches,
in less time than it takes to send them. Results do not depend on this choice.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.required_accuracy import RefinementSettings
from bayes_ssi.inference.posterior_sampling.sample import sample
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.checkpoint import Checkpoint
from bayes_ssi.inference.workers.local_workers import LocalWorkers
from bayes_ssi.inference.workers.run import Run


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
        """The last report; None if there is none."""
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
        run: workers, checkpoint and progress. Progress of a class sampled as a whole by a worker
            of another machine is reported at its end. If the worker of a class died, the class's
            evaluations are shared, so that the points at which workers die are isolated.
        known_starts: for each class, if given, where an earlier search found maxima, as in
            :func:`~bayes_ssi.inference.posterior_sampling.sample.sample`.
    """
    run = run or Run()
    with run.working():
        items = list(zip_longest(candidates, known_starts))
        posteriors = _side_by_side(items, seed, settings, run, refinement)
        return [
            posteriors[i]
            if i in posteriors
            else sample(candidate, seed, settings, run, refinement=refinement, known_starts=starts)
            for i, (candidate, starts) in enumerate(items)
        ]


def _side_by_side(
    items: Sequence[tuple[ModelClass, FloatArray | None]],
    seed: int,
    settings: SamplingSettings,
    run: Run,
    refinement: RefinementSettings | None,
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
    checkpoint = run.checkpoint
    if checkpoint is not None:
        checkpoint.say_resumed(names)
        checkpoint = checkpoint.silent()
    with TemporaryDirectory(prefix="bayes_ssi_") as directory:
        files = [ProgressFile(Path(directory, str(k))) for k in range(len(whole))]
        relay = _Relay(run, files)
        if not isinstance(run.workers, LocalWorkers):
            for name in names:
                run.report(name, "in a worker", 0.0)
        posteriors = run.workers.try_each(
            partial(
                _sample_in_worker,
                seed=seed,
                settings=settings,
                checkpoint=checkpoint,
                refinement=refinement,
            ),
            [(*items[i], file) for i, file in zip(whole, files, strict=True)],
            lambda k: run.report(names[k], *END),
            relay,
        )
    return {whole[k]: posterior for k, posterior in posteriors.items()}


def _sample_in_worker(
    item: tuple[ModelClass, FloatArray | None, ProgressFile],
    seed: int,
    settings: SamplingSettings,
    checkpoint: Checkpoint | None,
    refinement: RefinementSettings | None,
) -> Posterior:
    candidate, starts, progress = item
    run = Run(checkpoint=checkpoint, progress=progress)
    return sample(candidate, seed, settings, run, refinement=refinement, known_starts=starts)


@dataclass(frozen=True)
class _Relay:
    """Passes on what workers report, whenever it is called; their end is reported elsewhere."""

    run: Run
    files: Sequence[ProgressFile]
    known: dict[ProgressFile, tuple[str, str, float]] = field(default_factory=dict)

    def __call__(self) -> None:
        for file in self.files:
            report = file.read()
            if report is not None and report != self.known.get(file):
                self.known[file] = report
                if report[1:] != END:
                    self.run.report(*report)


def is_cheap(candidate: ModelClass) -> bool:
    """Whether all structures have small matrices or are approximate."""
    return all(test.structure.is_cheap for test in candidate.configurations)
