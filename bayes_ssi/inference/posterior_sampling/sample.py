"""Sample a model class, with exact or approximate structures."""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.emulation import (
    sample_emulated,
    with_emulated_structures,
)
from bayes_ssi.inference.posterior_sampling.refinement import refined
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    is_approximate,
)
from bayes_ssi.inference.posterior_sampling.to_posterior import sample_as_it_is
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run


@checked
def sample(
    model_class: ModelClass,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    refinement: RefinementSettings | None = None,
    known_starts: FloatArray | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Approximate structures are refined where the posterior lies, and the evidence is corrected by
    exact solutions; ``remarks`` of the result state how accurate both are.

    Args:
        model_class: what is sampled.
        seed: determines the result, together with the class's name.
        settings: how precisely to sample.
        run: workers that share the evaluations, a checkpoint to resume from, and progress; the
            result does not depend on them.
        refinement: how accurate approximate structures are made.
        known_starts: (m, d), near maxima that an earlier search found, in standard-normal
            coordinates; it counts as one of the independent searches.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior, the model cannot be
            evaluated by the workers, or the checkpoint is of another run.
    """
    settings, run = settings or SamplingSettings(), run or Run()
    checkpoint = run.checkpoint
    journal = checkpoint.journal(model_class, seed, settings) if checkpoint else None
    try:
        with run.working(), journal or nullcontext():
            if settings.economical:
                emulated = with_emulated_structures(model_class, run.workers, journal)
                if emulated is not model_class:
                    return sample_emulated(emulated, seed, settings, run, refinement, known_starts)
            sample_class = partial(
                sample_as_it_is,
                seed=seed,
                settings=settings,
                run=run,
                journal=journal,
                known_starts=known_starts,
            )
            if is_approximate(model_class):
                return refined(
                    model_class,
                    sample_class,
                    seed,
                    settings.log_evidence_error,
                    run.workers,
                    refinement,
                    partial(run.report, model_class.name),
                )
            return sample_class(model_class)
    except ValueError:
        if checkpoint and journal and journal.is_empty:
            # It would refuse the class once its input is corrected.
            checkpoint.remove([model_class.name])
        raise
