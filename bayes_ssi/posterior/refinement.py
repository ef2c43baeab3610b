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
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.execution.workers import Workers
from bayes_ssi.finite_elements.approximate_structure import ApproximateStructure
from bayes_ssi.finite_elements.emulated_structure import EmulatedStructure
from bayes_ssi.identification.likelihood import ModalLikelihood
from bayes_ssi.modal import mac
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.class_target import class_target
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.sampling.checks import REACHED
from bayes_ssi.sampling.maxima import find_maxima
from bayes_ssi.structures.structure import Structure

# Largest error of the correction, as a share of the wanted error of the log evidence: the rest is
# left to sampling.
CORRECTION_SHARE = 0.5
# Modes beyond the band by more than this factor can hardly be taken for identified ones.
NEAR_THE_BAND = 1.05


@dataclass(frozen=True)
class RefinementSettings:
    """How accurate approximate structures are made where the posterior lies.

    Attributes:
        error_share: largest error of the approximation, as a share of the data's and the model's
            own errors: added in quadrature, a tenth widens them by half a per cent.
        error_quantile: quantile of the own errors over the draws that counts as their size.
        n_certified: draws at which errors are certified.
        n_searched: prior draws of the quick search that precedes sampling.
        n_climbs: number of local searches, which start from the best of these draws.
        n_confirmed: least number of draws at which full solutions correct the evidence.
        most_confirmed: largest number.
        most_searches: largest number of quick searches.
        most_rounds: largest number of rounds of sampling and refining.
        largest_correction: largest correction of the log evidence that these draws can support.
    """

    error_share: float = 0.1
    error_quantile: float = 0.05
    n_certified: int = 200
    n_searched: int = 1000
    n_climbs: int = 16
    n_confirmed: int = 16
    most_confirmed: int = 64
    most_searches: int = 50
    most_rounds: int = 4
    largest_correction: float = 0.3


def with_exact_structures(model_class: ModelClass) -> ModelClass:
    """The class with the structures that its own approximate; the class itself if none does."""
    return model_class.with_structures(
        lambda s, _: s.exact if isinstance(s, ApproximateStructure) else s
    )


def is_approximate(model_class: ModelClass) -> bool:
    """Whether any structure of the class approximates another."""
    return any(isinstance(c.structure, ApproximateStructure) for c in model_class.configurations)


def refined(
    model_class: ModelClass,
    sample_class: Callable[[ModelClass], Posterior],
    seed: int,
    log_evidence_error: float,
    workers: Workers | None = None,
    settings: RefinementSettings | None = None,
) -> Posterior:
    """The posterior of a class with approximate structures, refined, certified and corrected.

    Args:
        model_class: the class.
        sample_class: samples it with its structures unchanged.
        seed: seed of the quick search.
        log_evidence_error: wanted standard error of the log evidence.
        workers: where the quick search evaluates the model; in this process if None.
        settings: how accurate structures are made.
    """
    settings = settings or RefinementSettings()
    model_class.check_structure()
    model_class = _accurate_near_maxima(model_class, seed, workers, settings)
    better = model_class
    for left in reversed(range(settings.most_rounds)):
        model_class = better
        posterior = sample_class(model_class)
        values = _evenly_spaced_draws(posterior, settings.n_certified)
        confirmation = None
        if not left:
            break
        better = _more_accurate(model_class, values, settings)
        if better is model_class:
            confirmation = _confirmed(model_class, posterior, log_evidence_error, settings)
            if confirmation.error > log_evidence_error:
                better = _with_solutions_at(model_class, confirmation.values)
        if better is model_class:
            break
    if confirmation is None:
        confirmation = _confirmed(model_class, posterior, log_evidence_error, settings)
    certified = _certified(model_class, posterior, settings)
    structures = [test.structure for test in model_class.configurations]
    emulators = [s.fitted if isinstance(s, EmulatedStructure) else None for s in structures]
    return replace(
        _corrected(certified, confirmation, log_evidence_error, settings),
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
        better = _improved(model_class, _requirements(model_class, values, settings))
        if better is model_class:
            break
        model_class = better
    return model_class


def _with_errors_of_approximation(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with the structures' errors at ``values`` added to those of the identification."""
    widened = []
    for test, likelihood, own in model_class.parts(values):
        structure = likelihood.structure
        if not isinstance(structure, ApproximateStructure):
            widened.append(test)
            continue
        frequency, shape, _ = structure.accuracy(
            own[:, : len(structure.parameters)], _n_needed(likelihood, own)
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
        widened.append(replace(test, data=replace(test.data, modes=modes)))
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


def _evenly_spaced_draws(posterior: Posterior, n: int) -> FloatArray:
    """Parameter values (n, n_parameters)."""
    at = (np.arange(n) + 0.5) * len(posterior.values) / n
    return posterior.values[at.astype(np.intp)]


class _Requirement(NamedTuple):
    """Where the structure of a configuration must be accurate, and how accurate.

    Attributes:
        values: (B, n_parameters), parameter values of the structure.
        frequency: largest relative error of frequencies.
        shape: largest error of shapes at unit length.
        n_modes: number of lowest modes that must be accurate.
    """

    values: FloatArray
    frequency: float
    shape: float
    n_modes: int


def _requirements(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> list[_Requirement]:
    """The requirement on every configuration, from its own errors at ``values``."""
    requirements = []
    for configuration, likelihood, own in model_class.parts(values):
        frequency, shape = (
            settings.error_share * float(np.quantile(each, settings.error_quantile))
            for each in likelihood.least_errors(own)
        )
        of_structure = own[:, : len(configuration.structure.parameters)]
        n_modes = _n_needed(likelihood, own)
        requirements.append(_Requirement(of_structure, frequency, shape, n_modes))
    return requirements


def _n_needed(likelihood: ModalLikelihood, values: FloatArray) -> int:
    """Number of lowest model modes that are paired, or lie in or near the band, at ``values``."""
    # Where any pairing is possible, none is given.
    paired = max(likelihood.pairing.values(), default=1)
    frequencies = likelihood.modes(values).frequencies_hz
    reached = frequencies < NEAR_THE_BAND * likelihood.data.band_hz[1]
    return max(paired, int(reached.sum(axis=1).max(initial=0)))


def _more_accurate(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> ModelClass:
    """The class with structures accurate enough at all ``values``; unchanged if they are.

    Structures that cannot be made so accurate are as accurate as they become.
    """
    while True:
        better = _improved(model_class, _requirements(model_class, values, settings))
        if better is model_class:
            return model_class
        model_class = better


def _improved(model_class: ModelClass, requirements: list[_Requirement]) -> ModelClass:
    """The class with structures that are accurate enough, or more accurate than they were."""

    def improved(structure: Structure, i: int) -> Structure:
        if not isinstance(structure, ApproximateStructure):
            return structure
        return structure.accurate_at(*requirements[i])

    return model_class.with_structures(improved)


def _with_solutions_at(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with its approximate structures making use of the exact ones at ``values``."""
    own = [part for _, _, part in model_class.parts(values)]

    def better(structure: Structure, i: int) -> Structure:
        if not isinstance(structure, ApproximateStructure):
            return structure
        return structure.with_solutions_at(own[i][:, : len(structure.parameters)])

    return model_class.with_structures(better)


def _certified(
    model_class: ModelClass, posterior: Posterior, settings: RefinementSettings
) -> Posterior:
    """The posterior with remarks on how accurate the structures are at its draws."""
    values = _evenly_spaced_draws(posterior, settings.n_certified)
    requirements = _requirements(model_class, values, settings)
    remarks, failed = [], []
    for configuration, required in zip(model_class.configurations, requirements, strict=True):
        if not isinstance(configuration.structure, ApproximateStructure):
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


class _Confirmation(NamedTuple):
    """Exact solutions at draws, and what they change.

    Attributes:
        values: (n, n_parameters), the draws.
        correction, error: of the log evidence.
        change: of the mean log-likelihood.
        differences: largest relative difference of frequencies, and least MAC at the sensors.
    """

    values: FloatArray
    correction: float
    error: float
    change: float
    differences: tuple[float, float]


def _confirmed(
    model_class: ModelClass,
    posterior: Posterior,
    log_evidence_error: float,
    settings: RefinementSettings,
) -> _Confirmation:
    """Exact solutions at as many draws as the wanted error of the log evidence needs."""
    exact = with_exact_structures(model_class)
    n = settings.n_confirmed
    while True:
        values = _evenly_spaced_draws(posterior, n)
        change = exact.log_likelihood(values) - model_class.log_likelihood(values)
        weights = np.exp(change - change.max())
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n))
        needed = n * (error / (CORRECTION_SHARE * log_evidence_error)) ** 2
        if needed <= n or n >= settings.most_confirmed:
            break
        n = min(settings.most_confirmed, max(2 * n, math.ceil(needed)))
    possible = np.isfinite(change)
    return _Confirmation(
        values,
        float(change.max() + math.log(weights.mean())),
        error,
        float(change[possible].mean()),
        _differences(model_class, exact, values[possible]),
    )


def _corrected(
    posterior: Posterior,
    confirmation: _Confirmation,
    log_evidence_error: float,
    settings: RefinementSettings,
) -> Posterior:
    """The posterior with its evidence corrected by exact solutions at some draws."""
    correction, error = confirmation.correction, confirmation.error
    frequency, least_mac = confirmation.differences
    remark = (
        f"confirmed by {len(confirmation.values)} full solutions at draws: frequencies differ by "
        f"{frequency:.1g} at most, MAC is {_just_below_one(least_mac)} or more, and the log "
        f"evidence was corrected by {correction:+.4f} ± {error:.4f}"
    )
    failed = posterior.failed_checks
    if not abs(correction) <= settings.largest_correction:
        failed = (
            *failed,
            f"full solutions at draws change the log evidence by {correction:+.2f}: the "
            "approximate structure is too coarse where the posterior lies",
        )
    elif error > REACHED * log_evidence_error:
        failed = (
            *failed,
            f"{len(confirmation.values)} full solutions at draws leave an error of {error:.2g} in "
            f"the log evidence, more than the {log_evidence_error:g} wanted: the structure's modes "
            "do not follow the approximation, as where a model jumps or fails",
        )
    evidence = posterior.evidence
    return replace(
        posterior,
        evidence=replace(
            evidence,
            log_evidence=evidence.log_evidence + correction,
            error=math.hypot(evidence.error, error),
            mean_log_likelihood=evidence.mean_log_likelihood + confirmation.change,
            checks=tuple(check.shifted(correction, error) for check in evidence.checks),
        ),
        failed_checks=failed,
        remarks=(*posterior.remarks, remark),
        frequency_error=frequency,
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
    """The number as text, with enough digits to show that it is not one."""
    digits = min(max(4, 1 - math.floor(math.log10(max(1.0 - number, 1e-9)))), 9)
    return f"{math.floor(number * 10**digits) / 10**digits:.{digits}f}"
