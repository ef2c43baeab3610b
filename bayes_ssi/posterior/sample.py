"""Sample a model class, of whatever kind its structures are."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial

from bayes_ssi.execution.journal import Journal
from bayes_ssi.execution.workers import Workers, as_workers
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.refinement import RefinementSettings, is_approximate, refined
from bayes_ssi.posterior.to_posterior import sample_as_it_is
from bayes_ssi.sampling.settings import Progress, SamplingSettings

__all__ = ["sample"]


def sample(
    model_class: ModelClass,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    progress: Progress | None = None,
    *,
    workers: int | Executor | Workers | None = None,
    journal: Journal | None = None,
    refinement: RefinementSettings | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Approximate structures are refined where the posterior lies, and the evidence is corrected by
    exact solutions; ``remarks`` of the result state how accurate both are.

    Args:
        model_class: what is sampled.
        seed: the result follows from it and from the class's name alone.
        settings: how precisely.
        progress: called with the name of a step and the share of it that is done.
        workers: where the model is evaluated; in this process if None. The result is the same.
        journal: of an earlier run with the same arguments that was stopped; its evaluations are
            used, and the new ones are added.
        refinement: how accurate approximate structures are made.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior, or the model cannot be
            evaluated by the workers, or is not that of the journal.
    """
    with as_workers(workers) as pool:
        sample_class = partial(
            sample_as_it_is,
            seed=seed,
            settings=settings,
            progress=progress,
            workers=pool,
            journal=journal,
        )
        if is_approximate(model_class):
            return refined(model_class, sample_class, seed, pool, refinement)
        return sample_class(model_class)
