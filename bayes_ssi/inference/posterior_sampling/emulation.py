"""Sampling of classes whose structures take long, with emulators in their place.

The structures are solved at some hundred points; all else is sampled as any class with approximate
structures is (:mod:`bayes_ssi.inference.posterior_sampling.refinement`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import refined
from bayes_ssi.inference.posterior_sampling.required_accuracy import RefinementSettings
from bayes_ssi.inference.posterior_sampling.to_posterior import sample_as_it_is
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.journal import Journal
from bayes_ssi.inference.workers.recorded_structure import RecordedStructure
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.emulation.emulated_structure import EmulatedStructure
from bayes_ssi.structures.structure import Structure


def with_emulated_structures(
    model_class: ModelClass, workers: Workers | None = None, journal: Journal | None = None
) -> ModelClass:
    """The class with an emulator in place of every structure that takes long.

    Those with small matrices, and those that are approximate already, stay.

    Args:
        workers: solve the structures; in this process if None.
    """
    emulators: dict[int, EmulatedStructure] = {}

    def emulated(structure: Structure, _: int) -> Structure:
        if structure.is_cheap or not structure.parameters:
            return structure
        if id(structure) not in emulators:
            recorded = RecordedStructure(structure, workers, journal)
            emulators[id(structure)] = EmulatedStructure(recorded)
        return emulators[id(structure)]

    return model_class.with_structures(emulated)


def emulated_again(model_class: ModelClass, posterior: Posterior) -> ModelClass:
    """The class with the emulators with which it was sampled; unchanged if there were none."""
    fits = posterior.emulators

    def emulated(structure: Structure, i: int) -> Structure:
        fit = fits[i] if fits else None
        return structure if fit is None else EmulatedStructure(structure, fit=fit)

    return model_class.with_structures(emulated)


def sample_emulated(
    emulated: ModelClass,
    seed: int,
    settings: SamplingSettings,
    run: Run,
    refinement: RefinementSettings | None = None,
    known_starts: FloatArray | None = None,
) -> Posterior:
    """The posterior of a class with emulated structures; ``n_evaluations`` counts solutions.

    Arguments and errors are as in :func:`bayes_ssi.inference.posterior_sampling.sample.sample`.
    """
    in_process = Run(progress=run.progress)  # emulators are faster than sending them
    sample_class = partial(
        sample_as_it_is, seed=seed, settings=settings, run=in_process, known_starts=known_starts
    )
    posterior = refined(
        emulated, sample_class, seed, settings.log_evidence_error, settings=refinement
    )
    exact = {id(test.structure.exact): test.structure.exact for test in emulated.configurations}
    n_solved = sum(each.n_solved for each in exact.values() if isinstance(each, RecordedStructure))
    return replace(posterior, n_evaluations=n_solved)
