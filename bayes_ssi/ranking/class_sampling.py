"""Sampling of several model classes: one after another, or side by side in workers.

Workers can take whole classes, or share the evaluations of one. Whole classes keep all workers
busy when there are at least as many classes as workers. With fewer classes, evaluations are
shared, except those of small matrices and of approximate structures: these are solved in batches,
in less time than it takes to send them. Results do not depend on this choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from bayes_ssi.execution.run import Run
from bayes_ssi.finite_elements.approximate_structure import ApproximateStructure
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.sample import sample
from bayes_ssi.sampling.settings import SamplingSettings
from bayes_ssi.structures.lumped import LumpedStructure


def sample_all(
    candidates: Sequence[ModelClass],
    seed: int,
    settings: SamplingSettings,
    run: Run | None = None,
) -> list[Posterior]:
    """Sample several classes; the posteriors are in their order.

    Args:
        candidates: the classes.
        seed: a class's result follows from it and the class's name.
        settings: how precisely to sample.
        run: workers, checkpoint and progress. Progress of a class sampled as a whole by a worker
            is reported at its end; if its worker died, its evaluations are shared, so that the
            points at which workers die are isolated.

    Raises:
        ValueError: a class's likelihood is zero everywhere, the model cannot be evaluated by the
            workers, or the checkpoint is of another run.
    """
    run = run or Run()
    with run.working():
        posteriors = _side_by_side(candidates, seed, settings, run)
        return [
            posteriors[i] if i in posteriors else sample(candidate, seed, settings, run)
            for i, candidate in enumerate(candidates)
        ]


def _side_by_side(
    candidates: Sequence[ModelClass], seed: int, settings: SamplingSettings, run: Run
) -> dict[int, Posterior]:
    """Posteriors of whole classes, each sampled in one worker; none where the worker died."""
    if run.workers is None or len(candidates) == 1:
        return {}
    all_whole = len(candidates) >= run.workers.n_workers
    whole = [i for i, each in enumerate(candidates) if all_whole or is_cheap(each)]
    # The largest first: none should keep a single worker busy at the end.
    whole.sort(key=lambda i: -len(candidates[i].parameters))
    names = [candidates[i].name for i in whole]
    checkpoint = run.checkpoint
    if checkpoint is not None:
        checkpoint.say_resumed(names)
        checkpoint = checkpoint.silent()
    for name in names:
        run.report(name, "in a worker", 0.0)
    posteriors = run.workers.try_each(
        partial(sample, seed=seed, settings=settings, run=Run(checkpoint=checkpoint)),
        [candidates[i] for i in whole],
        lambda k: run.report(names[k], "evidence", 1.0),
    )
    return {whole[k]: posterior for k, posterior in posteriors.items()}


def is_cheap(candidate: ModelClass) -> bool:
    """Whether all structures have small matrices or are approximate."""
    structures = [configuration.structure for configuration in candidate.configurations]
    return all(isinstance(each, (LumpedStructure, ApproximateStructure)) for each in structures)
