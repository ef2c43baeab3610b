"""Sampling with approximate structures: accurate where the posterior lies, and corrected.

A reduced model is accurate over the prior to about the data's own errors, which is all that
searches need. Where the posterior lies, its certified error must be a small share of the
identification and prediction errors; otherwise the reduced model is refined there and the class is
sampled again, which costs little. Finally, full solutions at some draws show the error of the
likelihood, and correct the evidence:

    p(D | full) = p(D | reduced) · E[p(D | θ, full) / p(D | θ, reduced)]

over the posterior of the reduced model. While a class is sampled its structures do not change, so
a result depends on nothing but the seed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.class_target import class_target
from bayes_ssi.inference.posterior_sampling.confirmation import Confirmation, confirmed, corrected
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    certified,
    evenly_spaced_draws,
    improved,
    more_accurate,
    n_needed,
    requirements,
    with_solutions_at,
)
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.inference.workers.workers import Workers

# The step in which exact structures confirm the evidence, for reports of progress.
FULL_SOLUTIONS = "full solutions"
# Where a certified error was small enough by itself, but what it changes in the likelihood is not:
# that is proportional to it, so this leaves a fifth.
STRICTER = 0.2


def refined(
    model_class: ModelClass,
    sample_class: Callable[[ModelClass], Posterior],
    seed: int,
    log_evidence_error: float,
    workers: Workers | None = None,
    settings: RefinementSettings | None = None,
    report: Callable[[str, float], None] = lambda *_: None,
) -> Posterior:
    """The posterior of a class with approximate structures, refined, certified and corrected.

    Args:
        log_evidence_error: wanted standard error of the log evidence.
        workers: where the quick search evaluates the model; in this process if None.
        report: called when full solutions begin and end, which may take longer than sampling, with
            the name of this step and 0 or 1.
    """
    settings = wanted = settings or RefinementSettings()

    def confirmed_by_full_solutions() -> Confirmation:
        report(FULL_SOLUTIONS, 0.0)
        done = confirmed(model_class, posterior, log_evidence_error, wanted)
        report(FULL_SOLUTIONS, 1.0)
        return done

    model_class.check_structure()
    model_class = _accurate_near_maxima(model_class, seed, workers, settings)
    better = model_class
    n_before = 0  # full solutions that confirmed no more than that a better structure was needed
    for left in reversed(range(settings.most_rounds)):
        model_class = better
        posterior = sample_class(model_class)
        values = evenly_spaced_draws(posterior, settings.n_certified)
        confirmation = None
        if not left:
            break
        better = more_accurate(model_class, values, settings)
        if better is model_class:
            confirmation = confirmed_by_full_solutions()
            if confirmation.error > log_evidence_error:
                better = with_solutions_at(model_class, confirmation.values)
            if better is model_class and confirmation.failures(log_evidence_error, settings):
                settings = replace(settings, error_share=STRICTER * settings.error_share)
                better = more_accurate(model_class, values, settings)
        if better is model_class:
            break
        if confirmation is not None:
            n_before += len(confirmation.values)
    if confirmation is None:
        confirmation = confirmed_by_full_solutions()
    posterior = certified(model_class, posterior, settings)
    if n_before:
        remark = f"{n_before} full solutions at draws showed that this accuracy is needed"
        posterior = replace(posterior, remarks=(*posterior.remarks, remark))
    emulators = [test.structure.emulator for test in model_class.configurations]
    return replace(
        corrected(posterior, confirmation, log_evidence_error, settings),
        emulators=tuple(emulators) if any(emulators) else (),
    )


def _accurate_near_maxima(
    model_class: ModelClass, seed: int, workers: Workers | None, settings: RefinementSettings
) -> ModelClass:
    """The class with structures accurate where quick searches expect the posterior.

    The searches count the errors of the approximation as errors of the data, so that no region is
    lost because its modes are not accurate yet. They narrow as the structures become accurate.
    """
    rng = np.random.default_rng([seed, 2])
    n = len(model_class.parameters)
    values = model_class.values(rng.standard_normal((settings.n_certified, n)))
    for _ in range(settings.most_searches):
        widened = _with_errors_of_approximation(model_class, values)
        values = _near_maxima(widened, seed, workers, settings)
        better = improved(model_class, requirements(model_class, values, settings))
        if better is model_class:
            break
        model_class = better
    return model_class


def _with_errors_of_approximation(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with the structures' errors at ``values`` added to those of the identification."""
    widened = []
    for test, likelihood, own in model_class.parts(values):
        structure = likelihood.structure
        if not structure.is_approximate:
            widened.append(test)
            continue
        frequency, shape, _ = structure.accuracy(
            own[:, : len(structure.parameters)], n_needed(likelihood, own)
        )
        modes = tuple(
            replace(
                mode,
                frequency_cov=math.hypot(mode.frequency_cov or 0.0, frequency) or None,
                shape_sd=(mode.shape is not None and math.hypot(mode.shape_sd or 0.0, shape))
                or None,
            )
            for mode in test.data.modes
        )
        widened.append(replace(test, data=replace(test.data.without_covariance(), modes=modes)))
    return replace(model_class, configurations=tuple(widened))


def _near_maxima(
    model_class: ModelClass, seed: int, workers: Workers | None, settings: RefinementSettings
) -> FloatArray:
    """Parameter values where a quick search expects the posterior."""
    rng = np.random.default_rng([seed, 1])
    n = len(model_class.parameters)
    target = class_target(model_class, workers)
    z = rng.standard_normal((settings.n_searched, n))
    best = np.argsort(-target.log_likelihood(z), kind="stable")[: settings.n_climbs]
    starts = np.concatenate([z[best], target.suggested(rng)])
    try:
        mixture = find_maxima(target, starts).as_mixture()
    except ValueError:  # the likelihood is zero everywhere, which sampling reports
        return model_class.values(starts)
    draws = mixture.draw(rng.multinomial(settings.n_certified, mixture.all_weights), rng)
    return model_class.values(draws)
