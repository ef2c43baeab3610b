"""Sampling with structures that approximate others: accurate where it matters, and confirmed.

A reduced model is made accurate over the prior as far as searches need, which is about as far as
the data's own errors. Where the posterior lies it must do better: its error, certified against the
full model, is to be below a tenth of the identification and prediction errors at the draws. Where
it is not, the reduced model is improved there and the class is sampled again, which costs little.
In the end full solutions at some draws tell how far the likelihood is off, and correct the
evidence:

    p(D | full) = p(D | reduced) · E[p(D | θ, full) / p(D | θ, reduced)]

over the posterior of the reduced model. While a class is sampled its structures do not change, so
a result depends on nothing but the seed.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.execution.journal import Journal
from bayes_ssi.execution.workers import Workers, as_workers
from bayes_ssi.modal import mac
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.to_posterior import sample_as_it_is
from bayes_ssi.sampling.maxima import find_maxima
from bayes_ssi.sampling.result import Progress, SamplingSettings
from bayes_ssi.sampling.target import Target

__all__ = ["sample"]

# The approximation's error may be this share of the data's and the model's own errors.
SHARE = 0.1
# At a few draws errors may be smaller still.
ERROR_QUANTILE = 0.05
DRAWS_TO_CERTIFY = 200
# Prior draws of a quick search, and how many of the best ones it climbs from.
DRAWS_TO_SEARCH, SEARCHES = 1000, 16
DRAWS_TO_CONFIRM = 16
MOST_ROUNDS = 4
# A larger correction of the log evidence cannot be trusted to a few draws.
LARGE_CORRECTION = 0.3


def sample(
    model_class: ModelClass,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    progress: Progress | None = None,
    *,
    workers: int | Executor | Workers | None = None,
    journal: Journal | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Structures that approximate others are made accurate where the posterior lies, and the evidence
    is corrected by solutions of the others; ``remarks`` of the result tell how far.

    Args:
        model_class: what is sampled.
        seed: the result follows from it and from the class's name alone.
        settings: how precisely.
        progress: called with the name of a step and the share of it that is done.
        workers: where the model is evaluated; in this process if None. The result is the same.
        journal: of an earlier run with the same arguments that was stopped; its evaluations are
            used, and the new ones are added.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior, or the model cannot be
            evaluated by the workers, or is not that of the journal.
    """
    with as_workers(workers) as pool:
        approximate = _exact(model_class) is not model_class
        if approximate:
            model_class.check_structure()
            model_class = _improved(model_class, _near_maxima(model_class, seed, pool))
        for _ in range(MOST_ROUNDS):
            posterior = sample_as_it_is(
                model_class, seed, settings, progress, workers=pool, journal=journal
            )
            if not approximate:
                return posterior
            better = _improved(model_class, _thinned(posterior, DRAWS_TO_CERTIFY))
            if better is model_class:
                break
            model_class = better
    return _confirmed(model_class, _certified(model_class, posterior))


def _exact(model_class: ModelClass) -> ModelClass:
    """The class with the structures that its own approximate; itself if they are exact."""
    return model_class.with_structures(lambda structure, _: structure.exact)


def _near_maxima(model_class: ModelClass, seed: int, pool: Workers | None) -> FloatArray:
    """Parameter values where the posterior lies, as far as a quick search tells."""
    rng = np.random.default_rng([seed, 1])
    n = len(model_class.parameters)
    target = Target(model_class.log_likelihood_at, n, pool)
    z = rng.standard_normal((DRAWS_TO_SEARCH, n))
    best = np.argsort(-target.log_likelihood(z), kind="stable")[:SEARCHES]
    try:
        mixture = find_maxima(target, z[best]).as_mixture()
    except ValueError:  # zero everywhere: sampling will say so
        return model_class.values(z[best])
    draws = mixture.draw(rng.multinomial(DRAWS_TO_CERTIFY, mixture.all_weights), rng)
    return model_class.values(draws)


def _thinned(posterior: Posterior, n: int) -> FloatArray:
    """``n`` draws, evenly spaced."""
    at = (np.arange(n) + 0.5) * len(posterior.values) / n
    return posterior.values[at.astype(np.intp)]


def _tolerances(model_class: ModelClass, values: FloatArray) -> list[tuple[float, float]]:
    """Largest errors of frequency and shape that a structure may have, in each configuration."""
    found = []
    for _, likelihood, own in model_class.parts(values):
        errors = [np.quantile(each, ERROR_QUANTILE) for each in likelihood.least_errors(own)]
        found.append((SHARE * float(errors[0]), SHARE * float(errors[1])))
    return found


def _own_values(model_class: ModelClass, values: FloatArray) -> list[FloatArray]:
    """The columns of each structure's own parameters."""
    return [
        own[:, : len(configuration.structure.parameters)]
        for configuration, _, own in model_class.parts(values)
    ]


def _improved(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with structures accurate enough at all ``values``; itself if they are already."""
    wanted, own = _tolerances(model_class, values), _own_values(model_class, values)
    return model_class.with_structures(
        lambda structure, i: structure.accurate_at(own[i], *wanted[i])
    )


def _certified(model_class: ModelClass, posterior: Posterior) -> Posterior:
    """The posterior with remarks on how accurate the structures are at its draws."""
    values = _thinned(posterior, DRAWS_TO_CERTIFY)
    remarks, failed = [], []
    for configuration, own, wanted in zip(
        model_class.configurations,
        _own_values(model_class, values),
        _tolerances(model_class, values),
        strict=True,
    ):
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        known = configuration.structure.accuracy(own)
        if configuration.structure.exact is not configuration.structure:
            remarks.append(where + known.told)
        # Errors inferred anew at every round move the limit a little.
        if known.frequency > 2.0 * wanted[0] or known.shape > 2.0 * wanted[1]:
            failed.append(
                f"{where}the approximate structure is certified only to {known.frequency:.1g} of "
                f"the frequency and {known.shape:.1g} of a shape, not to {wanted[0]:.1g} and "
                f"{wanted[1]:.1g}, a tenth of the errors; let it take more full solutions"
            )
    return replace(
        posterior,
        remarks=(*posterior.remarks, *remarks),
        failed_checks=(*posterior.failed_checks, *failed),
    )


def _confirmed(model_class: ModelClass, posterior: Posterior) -> Posterior:
    """The posterior with its evidence corrected by full solutions at some draws."""
    exact = _exact(model_class)
    values = _thinned(posterior, DRAWS_TO_CONFIRM)
    change = exact.log_likelihood(values) - model_class.log_likelihood(values)
    weights = np.exp(change - change.max())
    correction = float(change.max() + math.log(weights.mean()))
    error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(len(weights)))
    frequency, least_mac = _differences(model_class, exact, values)
    remark = (
        f"confirmed by {len(values)} full solutions at draws: frequencies differ by "
        f"{frequency:.1g} at most, MAC is {_just_below_one(least_mac)} or more, and the log "
        f"evidence was corrected by {correction:+.4f} ± {error:.4f}"
    )
    failed = posterior.failed_checks
    if not abs(correction) <= LARGE_CORRECTION:
        failed = (
            *failed,
            f"full solutions at draws change the log evidence by {correction:+.2f}: the "
            "approximate structure is too coarse where the posterior lies",
        )
    evidence = posterior.evidence
    return replace(
        posterior,
        evidence=replace(
            evidence,
            log_evidence=evidence.log_evidence + correction,
            error=math.hypot(evidence.error, error),
            mean_log_likelihood=evidence.mean_log_likelihood + float(change.mean()),
            checks=tuple(check.shifted(correction, error) for check in evidence.checks),
        ),
        failed_checks=failed,
        remarks=(*posterior.remarks, remark),
    )


def _differences(
    model_class: ModelClass, exact: ModelClass, values: FloatArray
) -> tuple[float, float]:
    """Largest relative difference of frequencies, and least MAC at the sensors, at ``values``."""
    frequency, least_mac = 0.0, 1.0
    for (_, ours, own), theirs in zip(model_class.parts(values), exact.likelihoods, strict=True):
        approximate, full = ours.modes(own), theirs.modes(own)
        off = np.abs(approximate.frequencies_hz / full.frequencies_hz - 1.0)
        frequency = max(frequency, float(off.max()))
        shapes = ours.shapes_at_sensors(approximate), theirs.shapes_at_sensors(full)
        if shapes[0].shape[1] > 1:
            alike = [np.diag(mac(a, b)).min() for a, b in zip(*shapes, strict=True)]
            least_mac = min(least_mac, float(min(alike)))
    return frequency, least_mac


def _just_below_one(number: float) -> str:
    """With enough digits to tell it from one."""
    digits = min(max(4, 1 - math.floor(math.log10(max(1.0 - number, 1e-9)))), 9)
    return f"{math.floor(number * 10**digits) / 10**digits:.{digits}f}"
