"""How accurate the approximate structures of a class must be, and making them so."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True)
class RefinementSettings:
    """How accurate approximate structures are made where the posterior lies."""

    # Largest error of the approximation, as a share of the data's and the model's own errors: added
    # in quadrature, a tenth widens them by half a per cent.
    error_share: float = 0.1
    error_quantile: float = 0.05  # of these errors, which may be inferred, at draws
    n_certified: int = 200  # draws at which errors of the approximation are certified
    n_searched: int = 1000  # prior draws of a quick search for maxima
    n_climbs: int = 16  # from the best of them
    n_confirmed: int = 16  # draws at which full solutions confirm the evidence, at first
    most_confirmed: int = 64  # where the first leave too large an error
    most_searches: int = 50  # each of which may refine the structures
    most_rounds: int = 4  # of sampling
    # Nats by which the best fit of no right class is worse than its errors can make it; beyond, a
    # class is sampled roughly.
    hopeless_misfit: float = 100.0
    largest_correction: float = 0.3  # of the log evidence, that so few draws can support
    correction_share: float = 0.5  # of the wanted error of the log evidence; the rest is sampling's
    # Of the share above, where an error is certified, but what it changes in the likelihood, which
    # is proportional to it, is not small enough.
    stricter: float = 0.2
    near_the_band: float = 1.05  # beyond, modes can hardly be taken for identified ones


def with_exact_structures(model_class: ModelClass) -> ModelClass:
    """The class with the structures that its own approximate; the class itself if none does."""
    return model_class.with_structures(lambda structure, _: structure.exact)


def is_approximate(model_class: ModelClass) -> bool:
    """Whether any structure of the class approximates another."""
    return any(c.structure.is_approximate for c in model_class.configurations)


def evenly_spaced_draws(posterior: Posterior, n: int) -> FloatArray:
    """Parameter values (n, n_parameters)."""
    at = (np.arange(n) + 0.5) * len(posterior.values) / n
    return posterior.values[at.astype(np.intp)]


class Requirement(NamedTuple):
    """Where the structure of a configuration must be accurate, and how accurate."""

    values: FloatArray  # (B, n_parameters), parameter values of the structure
    frequency: float
    shape: float  # largest error of shapes at unit length
    n_modes: int


def requirements(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> list[Requirement]:
    """The requirement on every configuration, from its own errors at ``values``."""
    needed = []
    for configuration, likelihood, columns in model_class.parts(values):
        frequency, shape = (
            settings.error_share * float(np.quantile(errors, settings.error_quantile))
            for errors in likelihood.least_errors(columns)
        )
        structural = columns[:, : len(configuration.structure.parameters)]
        n_modes = n_needed(likelihood, columns, settings)
        needed.append(Requirement(structural, frequency, shape, n_modes))
    return needed


def n_needed(likelihood: ModalLikelihood, values: FloatArray, settings: RefinementSettings) -> int:
    """Number of lowest model modes that are paired, or lie in or near the band, at ``values``."""
    # Where any pairing is possible, none is given.
    paired = max(likelihood.pairing.values(), default=1)
    frequencies = likelihood.modes(values).frequencies_hz
    reached = frequencies < settings.near_the_band * likelihood.data.band_hz[1]
    return max(paired, int(reached.sum(axis=1).max(initial=0)))


def more_accurate(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> ModelClass:
    """The class with structures accurate enough at all ``values``; unchanged if they are.

    Structures that cannot be made so accurate are as accurate as they become.
    """
    while True:
        better = improved(model_class, requirements(model_class, values, settings))
        if better is model_class:
            return model_class
        model_class = better


def improved(model_class: ModelClass, needed: list[Requirement]) -> ModelClass:
    """The class with structures that are accurate enough, or more accurate than they were."""
    return model_class.with_structures(lambda structure, i: structure.accurate_at(*needed[i]))


def with_solutions_at(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with its approximate structures making use of the exact ones at ``values``."""
    columns = [part for _, _, part in model_class.parts(values)]

    def better(structure: Structure, i: int) -> Structure:
        return structure.with_solutions_at(columns[i][:, : len(structure.parameters)])

    return model_class.with_structures(better)


def certified(
    model_class: ModelClass, posterior: Posterior, settings: RefinementSettings
) -> Posterior:
    """The posterior with remarks on how accurate the structures are at its draws."""
    values = evenly_spaced_draws(posterior, settings.n_certified)
    needed = requirements(model_class, values, settings)
    remarks, failed = [], []
    for configuration, required in zip(model_class.configurations, needed, strict=True):
        if not configuration.structure.is_approximate:
            continue
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        accuracy = configuration.structure.accuracy(required.values, required.n_modes)
        remarks.append(where + accuracy.statement)
        # Inferred errors differ a little from round to round, and tolerances with them.
        if accuracy.frequency > 2.0 * required.frequency or accuracy.shape > 2.0 * required.shape:
            failed.append(
                f"{where}the approximate structure is certified only to {accuracy.frequency:.1g} "
                f"of the frequency and {accuracy.shape:.1g} of a shape, not to "
                f"{required.frequency:.1g} and {required.shape:.1g}, {settings.error_share:g} of "
                "the data's and model's errors; allow it more full solutions"
            )
    return replace(
        posterior,
        remarks=(*posterior.remarks, *remarks),
        failed_checks=(*posterior.failed_checks, *failed),
    )
