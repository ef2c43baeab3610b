"""Sampling with approximate structures: accurate where the posterior lies, and corrected.

A reduced model is accurate over the prior to about the data's own errors, which is all that
searches need. Where the posterior lies, its certified error must be a small share of the
identification and prediction errors; otherwise the reduced model is refined there and the class is
sampled again, which costs little. Finally, full solutions at some draws show the error of the
likelihood, and correct the evidence:

    p(D | full) = p(D | reduced) · E[p(D | θ, full) / p(D | θ, reduced)]

over the posterior of the reduced model. A class that no parameters bring anywhere near the data,
such as one with two modes exchanged, is sampled roughly: its posterior lies where modes change
places and no approximation is smooth, and would take many times as long as that of a right class.
While a class is sampled its structures do not change, so a result depends on nothing but the seed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.calibration.narrow_regions import (
    PairedResiduals,
    class_target,
    starts_in_narrow_regions,
)
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.inference.sampling.result import ERROR_OVER_WANTED
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import Requirement, Structure

ERROR_QUANTILE = 0.05  # of the errors that an approximation is compared with, at draws
N_CERTIFIED = 200  # draws at which errors of the approximation are certified
N_SEARCHED = 1000  # prior draws of a quick search for maxima
N_CLIMBS = 16  # from the best of them
N_CONFIRMED = 16  # draws at which full solutions confirm the evidence, at first
MOST_CONFIRMED = 64  # where the first leave too large an error
# Nats by which the best fit of no right class is worse than its errors can make it; beyond, a class
# is sampled roughly.
HOPELESS_MISFIT = 100.0
CORRECTION_SHARE = 0.5  # of the wanted error of the log evidence; the rest is sampling's
# Of the share of errors, where an error is certified, but what it changes in the likelihood, which
# is proportional to it, is not small enough.
STRICTER = 0.2
NEAR_THE_BAND = 1.05  # beyond, modes can hardly be taken for identified ones


@dataclass(frozen=True)
class RefinementSettings:
    """How accurate approximate structures are made where the posterior lies."""

    # Largest error of the approximation, as a share of the data's and the model's own errors: added
    # in quadrature, a tenth widens them by half a per cent.
    error_share: float = 0.1
    most_searches: int = 50  # each of which may refine the structures
    most_rounds: int = 4  # of sampling
    largest_correction: float = 0.3  # of the log evidence, that so few draws can support


def refined(
    model_class: ModelClass,
    sample_class: Callable[..., Posterior],
    seed: int,
    log_evidence_error: float,
    workers: Workers | None = None,
    settings: RefinementSettings | None = None,
    report: Callable[[str, float], None] = lambda *_: None,
) -> Posterior:
    """The posterior of a class with approximate structures, refined, certified and corrected.

    ``report`` is called with the name of the step and 0 or 1 when full solutions begin and end.
    """
    settings = settings or RefinementSettings()

    def confirmed_by_full_solutions() -> Confirmation:
        report("full solutions", 0.0)
        done = confirmed(model_class, posterior, log_evidence_error)
        report("full solutions", 1.0)
        return done

    model_class.check_structure()
    rng = np.random.default_rng([seed, 2])
    z = rng.standard_normal((N_CERTIFIED, len(model_class.parameters)))
    widened = _with_errors_of_approximation(model_class, model_class.values(z))
    misfit = least_misfit(widened, seed, workers)
    if misfit > HOPELESS_MISFIT:
        posterior = sample_class(model_class, roughly=True)
        hopeless = (
            f"even its best fit is {misfit:.0f} nats worse than its errors can make it, so it was "
            "sampled roughly, and the error of its evidence is not known"
        )
        return replace(posterior, failed_checks=(hopeless,), emulators=_emulators(model_class))
    model_class = _accurate_near_maxima(model_class, widened, seed, workers, settings)
    better = model_class
    n_before = 0  # full solutions that confirmed no more than that a better structure was needed
    for left in reversed(range(settings.most_rounds)):
        model_class = better
        posterior = sample_class(model_class)
        values = evenly_spaced_draws(posterior, N_CERTIFIED)
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
    remarks, failed = certified(model_class, posterior, settings)
    if n_before:
        remarks.append(f"{n_before} full solutions at draws showed that this accuracy is needed")
    failed += confirmation.failures(log_evidence_error, settings)
    return replace(
        corrected(posterior, confirmation, remarks),
        failed_checks=(*posterior.failed_checks, *failed),
        emulators=_emulators(model_class),
    )


def _emulators(model_class: ModelClass) -> tuple[Any, ...]:
    emulators = tuple(test.structure.emulator for test in model_class.configurations)
    return emulators if any(emulators) else ()


def least_misfit(model_class: ModelClass, seed: int, workers: Workers | None) -> float:
    """By how many nats the best fit is worse than errors can make it; at most zero if it is not.

    Half the least sum of squares of the paired residuals over their errors, where descents end,
    less twice what is expected, one half for each residual. A second search confirms the first one.
    Zero where a pairing is inferred, which can leave out any mode.
    """
    if not all(likelihood.pairing_is_given for likelihood in model_class.likelihoods):
        return 0.0
    least = math.inf
    for search in range(2):
        rng = np.random.default_rng([seed, 3, search])
        ends = starts_in_narrow_regions(model_class, workers, rng).z
        values = model_class.values(ends)
        halves = np.zeros(len(values))
        for _, likelihood, columns in model_class.parts(values):
            test = PairedResiduals(likelihood)
            pairings, errors = test.given_pairings(len(values)), test.errors(columns, 0.0)
            residuals = test.residuals(likelihood.modes(columns), pairings, errors)
            halves += 0.5 * (residuals**2).sum(axis=1) - residuals.shape[1]
        least = float(np.append(halves[np.isfinite(halves)], least).min())
        if least <= 0.0:
            break
    return least if math.isfinite(least) else 0.0


def _accurate_near_maxima(
    model_class: ModelClass,
    widened: ModelClass,
    seed: int,
    workers: Workers | None,
    settings: RefinementSettings,
) -> ModelClass:
    """The class with structures accurate where quick searches expect the posterior.

    The searches count the errors of the approximation as errors of the data, at first those over
    the prior, so that no region is lost because its modes are not accurate yet. They narrow as the
    structures become accurate.
    """
    for _ in range(settings.most_searches):
        values = _near_maxima(widened, seed, workers)
        better = improved(model_class, values, settings)
        if better is model_class:
            break
        model_class = better
        widened = _with_errors_of_approximation(model_class, values)
    return model_class


def _with_errors_of_approximation(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with the structures' errors at ``values`` added to those of the identification."""
    widened = []
    for test, likelihood, columns in model_class.parts(values):
        structure = likelihood.structure
        if not structure.is_approximate:
            widened.append(test)
            continue
        frequency, shape, *_ = structure.accuracy(
            columns[:, : len(structure.parameters)], n_needed(likelihood, columns)
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


def _near_maxima(model_class: ModelClass, seed: int, workers: Workers | None) -> FloatArray:
    """Parameter values where a quick search expects the posterior."""
    rng = np.random.default_rng([seed, 1])
    n = len(model_class.parameters)
    target = class_target(model_class, workers)
    z = rng.standard_normal((N_SEARCHED, n))
    best = np.argsort(-target.log_likelihood(z), kind="stable")[:N_CLIMBS]
    starts = np.concatenate([z[best], target.suggested(rng)])
    try:
        mixture = find_maxima(target, starts).as_mixture()
    except ValueError:  # the likelihood is zero everywhere, which sampling reports
        return model_class.values(starts)
    draws = mixture.draw(rng.multinomial(N_CERTIFIED, mixture.all_weights), rng)
    return model_class.values(draws)


class Confirmation(NamedTuple):
    """Exact solutions at draws, and what they change."""

    values: FloatArray  # (n, n_parameters), the draws
    correction: float  # of the log evidence
    error: float  # of the correction
    change: float  # of the mean log-likelihood
    # Largest relative difference of frequencies, and least MAC at the sensors; None without shapes.
    differences: tuple[float, float | None]
    kind: str  # of solutions, in the plural

    def failures(self, log_evidence_error: float, settings: RefinementSettings) -> tuple[str, ...]:
        """The check that fails where these draws do not support the correction, if any."""
        if not abs(self.correction) <= settings.largest_correction:
            return (
                f"{self.kind} at draws change the log evidence by {self.correction:+.2f}: the "
                "approximate structure is too coarse where the posterior lies",
            )
        if self.error > ERROR_OVER_WANTED * log_evidence_error:
            return (
                f"{len(self.values)} {self.kind} at draws leave an error of {self.error:.2g} in "
                f"the log evidence, more than the {log_evidence_error:g} wanted: the structure's "
                "modes do not follow the approximation, as where a model jumps or fails",
            )
        return ()


def confirmed(
    model_class: ModelClass, posterior: Posterior, log_evidence_error: float
) -> Confirmation:
    """Exact solutions at as many draws as the wanted error of the log evidence needs."""
    n = N_CONFIRMED
    while True:
        values = evenly_spaced_draws(posterior, n)
        exact = _confirming(model_class, values)
        change = exact.log_likelihood(values) - model_class.log_likelihood(values)
        weights = np.exp(change - change.max())
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n))
        needed = n * (error / (CORRECTION_SHARE * log_evidence_error)) ** 2
        if needed <= n or n >= MOST_CONFIRMED:
            break
        n = min(MOST_CONFIRMED, max(2 * n, math.ceil(needed)))
    possible = np.isfinite(change)
    return Confirmation(
        values,
        float(change.max() + math.log(weights.mean())),
        error,
        float(change[possible].mean()),
        _differences(model_class, exact, values[possible]),
        "solutions in a finer basis" if is_approximate(exact) else "full solutions",
    )


def _confirming(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with what confirms its structures at ``values`` (B, n_parameters)."""
    columns = [own for *_, own in model_class.parts(values)]
    return model_class.with_structures(
        lambda structure, i: structure.confirming(columns[i][:, : len(structure.parameters)])
    )


def corrected(
    posterior: Posterior, confirmation: Confirmation, remarks: Sequence[str]
) -> Posterior:
    """The posterior with its evidence corrected by exact solutions at some draws, and remarks."""
    correction, error = confirmation.correction, confirmation.error
    frequency, least_mac = confirmation.differences
    macs = "" if least_mac is None else f", MAC is {_just_below_one(least_mac)} or more,"
    remark = (
        f"confirmed by {len(confirmation.values)} {confirmation.kind} at draws: frequencies differ "
        f"by {frequency:.1g} at most{macs} and the log evidence was corrected by "
        f"{correction:+.4f} ± {error:.4f}"
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
        remarks=(*posterior.remarks, *remarks, remark),
        frequency_error=frequency,
    )


def _differences(
    model_class: ModelClass, exact: ModelClass, values: FloatArray
) -> tuple[float, float | None]:
    """Largest relative difference of frequencies, and least MAC at the sensors, at ``values``."""
    frequency, least_mac = 0.0, 1.0 if model_class.has_shapes else None
    parts = zip(model_class.parts(values), exact.likelihoods, strict=True)
    for (_, likelihood, columns), of_full_model in parts:
        approximate, full = likelihood.modes(columns), of_full_model.modes(columns)
        off = np.abs(approximate.frequencies_hz / full.frequencies_hz - 1.0)
        frequency = max(frequency, float(off.max()))
        shapes = (likelihood.shapes_at_sensors(modes) for modes in (approximate, full))
        if least_mac is not None and len(likelihood.data.sensors) > 1:
            alike = np.array([np.diag(mac(a, b)) for a, b in zip(*shapes, strict=True)])
            seen = alike[~np.isnan(alike)]  # by the sensors
            least_mac = float(seen.min(initial=least_mac))
    return frequency, least_mac


def _just_below_one(number: float) -> str:
    """The number as text, with enough digits to show that it is not one."""
    digits = min(max(4, 1 - math.floor(math.log10(max(1.0 - number, 1e-9)))), 9)
    return f"{math.floor(number * 10**digits) / 10**digits:.{digits}f}"


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


def requirements(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> list[Requirement]:
    """The requirement on every configuration, from its own errors at ``values``."""
    needed = []
    for configuration, likelihood, columns in model_class.parts(values):
        frequency, shape = (
            # One of the errors, as those of shapes that nothing is compared with are infinite.
            settings.error_share * float(np.quantile(errors, ERROR_QUANTILE, method="lower"))
            for errors in likelihood.least_errors(columns)
        )
        structural = columns[:, : len(configuration.structure.parameters)]
        n_modes = n_needed(likelihood, columns)
        needed.append(Requirement(structural, frequency, shape, n_modes))
    return needed


def n_needed(likelihood: ModalLikelihood, values: FloatArray) -> int:
    """Number of lowest model modes that are paired, or lie in or near the band, at ``values``."""
    # Where any pairing is possible, none is given.
    paired = max(likelihood.pairing.values(), default=1)
    frequencies = likelihood.modes(values).frequencies_hz
    reached = frequencies < NEAR_THE_BAND * likelihood.data.band_hz[1]
    return max(paired, int(reached.sum(axis=1).max(initial=0)))


def more_accurate(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> ModelClass:
    """The class with structures as accurate as needed at all ``values``, or as they become."""
    while (better := improved(model_class, values, settings)) is not model_class:
        model_class = better
    return model_class


def improved(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> ModelClass:
    """The class with structures accurate enough at ``values``, or more accurate than they were."""
    needed = requirements(model_class, values, settings)
    return model_class.with_structures(lambda structure, i: structure.accurate_at(needed[i]))


def with_solutions_at(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with its approximate structures making use of the exact ones at ``values``."""
    columns = [part for _, _, part in model_class.parts(values)]

    def better(structure: Structure, i: int) -> Structure:
        return structure.with_solutions_at(columns[i][:, : len(structure.parameters)])

    return model_class.with_structures(better)


def certified(
    model_class: ModelClass, posterior: Posterior, settings: RefinementSettings
) -> tuple[list[str], list[str]]:
    """Remarks on how accurate the structures are at posterior draws, and failed checks of it."""
    values = evenly_spaced_draws(posterior, N_CERTIFIED)
    needed = requirements(model_class, values, settings)
    remarks: list[str] = []
    failed: list[str] = []
    for configuration, required in zip(model_class.configurations, needed, strict=True):
        if not configuration.structure.is_approximate:
            continue
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        accuracy = configuration.structure.accuracy(required.values, required.n_modes)
        shapes = math.isfinite(required.shape)
        remarks.append(where + accuracy.statement + accuracy.of_shapes * shapes)
        # Inferred errors differ a little from round to round, and tolerances with them.
        if accuracy.frequency > 2.0 * required.frequency or accuracy.shape > 2.0 * required.shape:
            known = f" and {accuracy.shape:.1g} of a shape" * shapes
            wanted = f" and {required.shape:.1g}" * shapes
            failed.append(
                f"{where}the approximate structure is certified only to {accuracy.frequency:.1g} "
                f"of the frequency{known}, not to {required.frequency:.1g}{wanted}, "
                f"{settings.error_share:g} of the data's and model's errors; allow it more full "
                "solutions"
            )
    return remarks, failed
