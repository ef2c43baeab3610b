"""Sample a model class, with exact, approximate or emulated structures.

Structures that take long are solved at some hundred points, and emulators take their place; all
else is sampled as any class with approximate structures is.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from functools import partial

from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import refined
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    is_approximate,
)
from bayes_ssi.inference.posterior_sampling.to_posterior import sample_as_it_is
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.journal import Journal
from bayes_ssi.inference.workers.recorded_structure import RecordedStructure
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.emulation.emulated_structure import EmulatedStructure
from bayes_ssi.structures.structure import Structure


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
        # As in a worker: how many threads add up a sum must not change its last digit.
        one_thread = threadpool_limits(limits=1, user_api="blas")
        with run.working(), journal or nullcontext(), one_thread:
            emulated = model_class
            if settings.economical:
                emulated = with_emulated_structures(model_class, seed, run.workers, journal)
            is_emulated = emulated is not model_class
            # Emulators are faster than sending them, and their solutions are in the journal.
            own_run = Run(progress=run.progress) if is_emulated else run
            sample_class = partial(
                sample_as_it_is,
                seed=seed,
                settings=settings,
                run=own_run,
                journal=None if is_emulated else journal,
                known_starts=known_starts,
            )
            if not is_approximate(emulated):
                return sample_class(emulated)
            refine = partial(
                refined, emulated, sample_class, seed, settings.log_evidence_error,
                own_run.workers, refinement,
            )  # fmt: skip
            if is_emulated:
                return _with_solutions_counted(refine(), emulated)
            return refine(report=partial(run.report, model_class.name))
    except ValueError:
        if checkpoint and journal and journal.is_empty:
            # It would refuse the class once its input is corrected.
            checkpoint.remove([model_class.name])
        raise


def _with_solutions_counted(posterior: Posterior, emulated: ModelClass) -> Posterior:
    """The posterior with solutions of the emulated structures in place of evaluations."""
    exact = {id(test.structure.exact): test.structure.exact for test in emulated.configurations}
    n_solved = sum(each.n_solved for each in exact.values() if isinstance(each, RecordedStructure))
    return replace(posterior, n_evaluations=n_solved)


def with_emulated_structures(
    model_class: ModelClass, seed: int, workers: Workers | None, journal: Journal | None
) -> ModelClass:
    """The class with an emulator in place of every structure that takes long.

    Those with small matrices, and those that are approximate already, stay.
    """
    emulators: dict[int, EmulatedStructure] = {}

    def emulated(structure: Structure, _: int) -> Structure:
        if structure.is_cheap or not structure.parameters:
            return structure
        if id(structure) not in emulators:
            recorded = RecordedStructure(structure, workers, journal)
            emulators[id(structure)] = EmulatedStructure(recorded, seed=seed)
        return emulators[id(structure)]

    return model_class.with_structures(emulated)


def emulated_again(model_class: ModelClass, posterior: Posterior) -> ModelClass:
    """The class with the emulators with which it was sampled; unchanged if there were none."""
    fits = posterior.emulators

    def emulated(structure: Structure, i: int) -> Structure:
        fit = fits[i] if fits else None
        return structure if fit is None else EmulatedStructure(structure, fit=fit)

    return model_class.with_structures(emulated)
