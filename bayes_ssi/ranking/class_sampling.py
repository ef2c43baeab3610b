"""Sampling several model classes: one after another, or side by side in workers.

Workers can share the evaluations of one class, or take whole classes. Evaluations that take
microseconds cost more to send than to make, so classes with a fast model go to workers as a whole;
those with a slow one are sampled one after another, each by all workers. Results do not depend on
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from bayes_ssi.execution.workers import Workers
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.sample import sample
from bayes_ssi.ranking.checkpoint import Checkpoint, as_checkpoint
from bayes_ssi.ranking.progress_files import ProgressFile, ProgressReader
from bayes_ssi.sampling.settings import SamplingSettings

__all__ = ["Report", "sample_all", "sample_one"]

# Told the name of a class, of a step, and the share of it that is done.
Report = Callable[[str, str, float], None]

# From so many seconds an evaluation, it pays to share the evaluations of one class.
SLOW = 1e-3
# Batches at the prior medians that are timed, the first being slower than the others.
TIMED_BATCHES = (1, 1, 32)
# A batch that takes longer than this is told to be slow without another one.
LONG_SECONDS = 0.2


def sample_one(
    candidate: ModelClass,
    seed: int,
    settings: SamplingSettings,
    progress: Report | None = None,
    workers: Workers | None = None,
    checkpoint: Checkpoint | None = None,
) -> Posterior:
    """Sample one class of a study; arguments and errors as those of :func:`sample_all`.

    Workers share the evaluations. The checkpoint is no path: in a worker a relative one would be
    another place.
    """

    def report(step: str, done: float) -> None:
        if progress is not None:
            progress(candidate.name, step, done)

    if checkpoint is None:
        return sample(candidate, seed, settings, report, workers=workers)
    journal = checkpoint.journal(candidate, seed, settings)
    try:
        with journal:
            return sample(candidate, seed, settings, report, workers=workers, journal=journal)
    except ValueError:
        if journal.is_empty:  # or it would refuse the class once its input is mended
            checkpoint.remove([candidate.name])
        raise


def sample_all(
    candidates: Sequence[ModelClass],
    seed: int,
    settings: SamplingSettings,
    progress: Report | None = None,
    workers: Workers | None = None,
    checkpoint: str | Path | Checkpoint | None = None,
) -> list[Posterior]:
    """Sample several classes; in their order.

    Args:
        candidates: the classes.
        seed: a class's result follows from it and the class's name.
        settings: how precisely to sample.
        progress: told of every class; where workers share no files with this process, of its end
            alone.
        workers: take classes as a whole where there are several and their models are fast, and
            share the evaluations of the others; here, one after another, if None. The evaluations
            of a class whose worker died are shared, too, so that the points at which workers die
            are found.
        checkpoint: as for :func:`~bayes_ssi.ranking.study.rank`.

    Raises:
        ValueError: a class's likelihood is zero everywhere, the model cannot be evaluated by the
            workers, or the checkpoint is of another run.
    """
    checkpoint = as_checkpoint(checkpoint)
    found: dict[int, Posterior] = {}
    if workers is not None and len(candidates) > 1:
        fast = [i for i, each in enumerate(candidates) if _seconds_per_evaluation(each) < SLOW]
        # The largest first: none should be left alone with one worker in the end.
        fast.sort(key=lambda i: -len(candidates[i].parameters))
        chosen = [candidates[i] for i in fast]
        sampled = _side_by_side(chosen, seed, settings, progress, workers, checkpoint)
        found = {fast[k]: posterior for k, posterior in sampled.items()}
    return [
        found[i] if i in found else sample_one(each, seed, settings, progress, workers, checkpoint)
        for i, each in enumerate(candidates)
    ]


def _side_by_side(
    candidates: Sequence[ModelClass],
    seed: int,
    settings: SamplingSettings,
    progress: Report | None,
    workers: Workers,
    checkpoint: Checkpoint | None,
) -> dict[int, Posterior]:
    """Whole classes, each in one worker; without those whose worker died."""
    names = [candidate.name for candidate in candidates]
    if checkpoint is not None:
        checkpoint.tell_continued(names)
    sample_there = partial(
        _sample_there,
        seed=seed,
        settings=settings,
        checkpoint=checkpoint.silent() if checkpoint else None,
    )
    if progress is None:
        return workers.try_each(sample_there, [(candidate, None) for candidate in candidates])
    with TemporaryDirectory(prefix="bayes_ssi_progress_") as directory:
        reader = ProgressReader(directory, names, progress)
        items = [(candidate, reader.file(i)) for i, candidate in enumerate(candidates)]
        return workers.try_each(sample_there, items, reader.end, reader.tell)


def _sample_there(
    item: tuple[ModelClass, ProgressFile | None],
    seed: int,
    settings: SamplingSettings,
    checkpoint: Checkpoint | None,
) -> Posterior:
    candidate, report = item
    return sample_one(candidate, seed, settings, report, None, checkpoint)


def _seconds_per_evaluation(candidate: ModelClass) -> float:
    """Of the log-likelihood at the prior medians, in a batch; 0 where it has no answer."""
    seconds = 0.0
    for rows in TIMED_BATCHES:
        begun = perf_counter()
        try:
            candidate.log_likelihood_at(np.zeros((rows, len(candidate.parameters))))
        except Exception:  # noqa: BLE001 - whatever a user's model may raise; sampling tells it
            return 0.0
        seconds = (perf_counter() - begun) / rows
        if seconds * rows > LONG_SECONDS:
            break
    return seconds
