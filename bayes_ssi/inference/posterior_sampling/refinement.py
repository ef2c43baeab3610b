"""Sampling with approximate structures: accurate where the posterior lies, and corrected.

A reduced model is accurate over the prior to about the data's own errors, which is all that
searches need. Where the posterior lies, its certified error must be a small share of the
identification and prediction errors; otherwise the reduced model is refined there and the class is
sampled again, which costs little. Finally, full solutions at some draws show the error of the
likelihood, and correct the evidence:

    p(D | full) = p(D | reduced) · E[p(D | θ, full) / p(D | θ, reduced)]

over the posterior of the reduced model. While a class is sampled its structures do not change, so a
result depends on nothing but the seed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.result import ERROR_OVER_WANTED
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import ApproximateStructure, Requirement

ERROR_QUANTILE = 0.05  # of the errors that an approximation is compared with, at draws
N_CERTIFIED = 200  # draws at which errors of the approximation are certified
N_CONFIRMED = 16  # draws at which full solutions confirm the evidence, at first
MOST_CONFIRMED = 64  # where the first leave too large an error
LARGEST_CORRECTION = 0.3  # of the log evidence, that so few draws can support
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
    most_rounds: int = 6  # of sampling


def refined(
    model_class: ModelClass,
    sample_class: Callable[[ModelClass], Posterior],
    log_evidence_error: float,
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
    better = model_class
    has_exact = all(test.structure.has_exact for test in model_class.configurations)
    n_before = 0  # full solutions that confirmed no more than that a better structure was needed
    for left in reversed(range(settings.most_rounds)):
        model_class = better
        posterior = sample_class(model_class)
        values = evenly_spaced_draws(posterior, N_CERTIFIED)
        confirmation = None
        if not left or not has_exact:
            break
        better = more_accurate(model_class, values, settings)
        if better is model_class:
            confirmation = confirmed_by_full_solutions()
            if confirmation.failures(log_evidence_error):
                settings = replace(settings, error_share=STRICTER * settings.error_share)
                better = more_accurate(model_class, values, settings)
        if better is model_class:
            break
        if confirmation is not None:
            n_before += len(confirmation.values)
    remarks, failed = certified(model_class, posterior, settings)
    if n_before:
        remarks.append(f"{n_before} full solutions at draws showed that this accuracy is needed")
    posterior = replace(posterior, remarks=(*posterior.remarks, *remarks))
    if has_exact:
        confirmation = confirmation or confirmed_by_full_solutions()
        failed += confirmation.failures(log_evidence_error)
        emulators = tuple(test.structure.emulator for test in model_class.configurations)
        posterior = replace(posterior, emulators=emulators if any(emulators) else ())
        posterior = corrected(posterior, confirmation)
    return replace(posterior, failed_checks=(*posterior.failed_checks, *failed))


class Confirmation(NamedTuple):
    """Exact solutions at draws, and what they change."""

    values: FloatArray  # (n, n_parameters), the draws
    correction: float  # of the log evidence
    error: float  # of the correction
    changes: FloatArray  # (n,), of the log-likelihood at the draws
    # Largest relative difference of frequencies, and least MAC at the sensors; None without shapes.
    differences: tuple[float, float | None]
    kind: str  # of solutions, in the plural

    def failures(self, log_evidence_error: float) -> tuple[str, ...]:
        """The check that fails where these draws do not support the correction, if any."""
        if not abs(self.correction) <= LARGEST_CORRECTION:
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


def confirmed(model_class: ModelClass, posterior: Posterior, wanted_error: float) -> Confirmation:
    """Exact solutions at as many draws as the wanted error of the log evidence needs."""
    n = N_CONFIRMED
    while True:
        values = evenly_spaced_draws(posterior, n)
        exact = with_confirming_structures(model_class, values)
        change = exact.log_likelihood(values) - model_class.log_likelihood(values)
        if not np.isfinite(change).any():
            raise ValueError(
                f"model class {model_class.name!r}: its full solutions fail at all {n} draws"
            )
        weights = np.exp(change - change.max())
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n))
        needed = n * (error / (CORRECTION_SHARE * wanted_error)) ** 2
        if needed <= n or n >= MOST_CONFIRMED:
            break
        n = min(MOST_CONFIRMED, max(2 * n, math.ceil(needed)))
    possible = np.isfinite(change)
    return Confirmation(
        values,
        float(change.max() + math.log(weights.mean())),
        error,
        change,
        _differences(model_class, exact, values[possible]),
        "solutions in a finer basis" if is_approximate(exact) else "full solutions",
    )


def corrected(posterior: Posterior, confirmation: Confirmation) -> Posterior:
    """The posterior with its evidence corrected by exact solutions at some draws, and a remark."""
    correction, error = confirmation.correction, confirmation.error
    frequency, least_mac = confirmation.differences
    macs = "" if least_mac is None else f", MAC is {_just_below_one(least_mac)} or more,"
    remark = (
        f"confirmed by {len(confirmation.values)} {confirmation.kind} at draws: frequencies differ "
        f"by {frequency:.1g} at most{macs} and the log evidence was corrected by "
        f"{correction:+.4f} ± {error:.4f}"
    )
    evidence, changes = posterior.evidence, confirmation.changes
    of_mean = float(changes[np.isfinite(changes)].mean())
    return replace(
        posterior,
        importance_draws={**(posterior.importance_draws or {}), "changes": changes},
        evidence=replace(
            evidence,
            log_evidence=evidence.log_evidence + correction,
            error=math.hypot(evidence.error, error),
            mean_log_likelihood=evidence.mean_log_likelihood + of_mean,
            checks=tuple(check.shifted(correction, error) for check in evidence.checks),
        ),
        remarks=(*posterior.remarks, remark),
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


def with_confirming_structures(model_class: ModelClass, values: FloatArray) -> ModelClass:
    """The class with structures that confirm its own at ``values`` (B, n_parameters)."""
    columns = [own for *_, own in model_class.parts(values)]
    return model_class.with_structures(
        lambda structure, i: structure.confirming(columns[i][:, : len(structure.parameters)])
    )


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
        # Of the lowest modes, all that are paired, or lie in or near the band at any of the values;
        # where any pairing is possible, none is given.
        paired = max(likelihood.pairing.values(), default=1)
        highest = NEAR_THE_BAND * likelihood.data.band_hz[1]
        reached = (likelihood.modes(columns).frequencies_hz < highest).sum(axis=1)
        n_modes = max(paired, int(reached.max(initial=0)))
        needed.append(Requirement(structural, frequency, shape, n_modes))
    return needed


def more_accurate(
    model_class: ModelClass, values: FloatArray, settings: RefinementSettings
) -> ModelClass:
    """The class with structures as accurate as needed at all ``values``, or as they become."""
    needed = requirements(model_class, values, settings)
    better = model_class.with_structures(lambda structure, i: structure.accurate_at(needed[i]))
    return better if better is model_class else more_accurate(better, values, settings)


def certified(
    model_class: ModelClass, posterior: Posterior, settings: RefinementSettings
) -> tuple[list[str], list[str]]:
    """Remarks on how accurate the structures are at posterior draws, and failed checks of it."""
    needed = requirements(model_class, evenly_spaced_draws(posterior, N_CERTIFIED), settings)
    remarks: list[str] = []
    failed: list[str] = []
    for configuration, required in zip(model_class.configurations, needed, strict=True):
        structure = configuration.structure
        if not isinstance(structure, ApproximateStructure):
            continue
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        accuracy = structure.accuracy(required.values, required.n_modes)
        shapes = math.isfinite(required.shape)
        remarks.append(where + accuracy.statement + accuracy.of_shapes * shapes)
        # Inferred errors differ a little from round to round, and tolerances with them.
        limit = 2.0 if structure.has_exact else 1.0
        too_large = accuracy.frequency > limit * required.frequency
        if too_large or accuracy.shape > limit * required.shape:
            known = f" and {accuracy.shape:.1g} of a shape" * shapes
            wanted = f" and {required.shape:.1g}" * shapes
            failed.append(
                f"{where}the approximate structure is certified only to {accuracy.frequency:.1g} "
                f"of the frequency{known}, not to {required.frequency:.1g}{wanted}, "
                f"{settings.error_share:g} of the data's and model's errors; "
                f"{structure.advice(required)}"
            )
    return remarks, failed
