"""Exact solutions at draws of an approximate class: how they correct its evidence."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    evenly_spaced_draws,
    with_exact_structures,
)
from bayes_ssi.inference.sampling.settings import CHECKS
from bayes_ssi.structures.modal import mac

# Largest error of the correction, as a share of the wanted error of the log evidence: the rest is
# left to sampling.
CORRECTION_SHARE = 0.5


class Confirmation(NamedTuple):
    """Exact solutions at draws, and what they change.

    Attributes:
        values: (n, n_parameters), the draws.
        correction, error: of the log evidence.
        change: of the mean log-likelihood.
    """

    values: FloatArray
    correction: float
    error: float
    change: float
    differences: tuple[float, float]

    def failures(self, log_evidence_error: float, settings: RefinementSettings) -> tuple[str, ...]:
        """The check that fails where these draws do not support the correction, if any."""
        if not abs(self.correction) <= settings.largest_correction:
            return (
                f"full solutions at draws change the log evidence by {self.correction:+.2f}: the "
                "approximate structure is too coarse where the posterior lies",
            )
        if self.error > CHECKS.error_over_wanted * log_evidence_error:
            return (
                f"{len(self.values)} full solutions at draws leave an error of {self.error:.2g} in "
                f"the log evidence, more than the {log_evidence_error:g} wanted: the structure's "
                "modes do not follow the approximation, as where a model jumps or fails",
            )
        return ()


def confirmed(
    model_class: ModelClass,
    posterior: Posterior,
    log_evidence_error: float,
    settings: RefinementSettings,
) -> Confirmation:
    """Exact solutions at as many draws as the wanted error of the log evidence needs."""
    exact = with_exact_structures(model_class)
    n = settings.n_confirmed
    while True:
        values = evenly_spaced_draws(posterior, n)
        change = exact.log_likelihood(values) - model_class.log_likelihood(values)
        weights = np.exp(change - change.max())
        error = float(weights.std(ddof=1) / weights.mean() / math.sqrt(n))
        needed = n * (error / (CORRECTION_SHARE * log_evidence_error)) ** 2
        if needed <= n or n >= settings.most_confirmed:
            break
        n = min(settings.most_confirmed, max(2 * n, math.ceil(needed)))
    possible = np.isfinite(change)
    return Confirmation(
        values,
        float(change.max() + math.log(weights.mean())),
        error,
        float(change[possible].mean()),
        _differences(model_class, exact, values[possible]),
    )


def corrected(
    posterior: Posterior,
    confirmation: Confirmation,
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
        failed_checks=(
            *posterior.failed_checks,
            *confirmation.failures(log_evidence_error, settings),
        ),
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
            alike = np.array([np.diag(mac(a, b)) for a, b in zip(*shapes, strict=True)])
            seen = alike[~np.isnan(alike)]  # by the sensors
            least_mac = float(seen.min(initial=least_mac))
    return frequency, least_mac


def _just_below_one(number: float) -> str:
    """The number as text, with enough digits to show that it is not one."""
    digits = min(max(4, 1 - math.floor(math.log10(max(1.0 - number, 1e-9)))), 9)
    return f"{math.floor(number * 10**digits) / 10**digits:.{digits}f}"
