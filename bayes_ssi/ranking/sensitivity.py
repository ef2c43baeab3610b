"""How a ranking moves with the settings that nobody measures.

The detection probability, the expected number of spurious modes, the error sizes and the width
of the priors are an analyst's choice. A ranking is worth as much as it withstands other choices:
each is changed in turn, and everything is ranked again.

Where only the likelihood changes, the draws that there are serve again: the log evidence changes
by the log of the mean ratio of the new likelihood to the old. Where these draws do not cover what
the changed class asks for (the ratios' tail is too heavy), and where priors change, the class is
sampled anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.execution.run import Run
from bayes_ssi.identification.error_model import ErrorModel
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.parameters import as_product
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.class_sampling import sample_all
from bayes_ssi.ranking.study import Ranking
from bayes_ssi.sampling.diagnostics import pareto_shape
from bayes_ssi.sampling.estimates import Estimate
from bayes_ssi.sampling.settings import SamplingSettings

__all__ = [
    "Sensitivity",
    "SensitivityRow",
    "Variation",
    "default_variations",
    "sensitivity",
]

MAX_DRAWS = 4000
# Draws serve again while the ratios' variance is surely finite and small: where the changed
# likelihood is wider than the draws, their tail is where its evidence comes from. Ratios that
# are all alike have no tail that matters.
MAX_PARETO_K = 0.5
MAX_ERROR = 0.03  # nats
ALIKE = 3.0  # times the mean
SETTINGS = SamplingSettings(log_evidence_error=0.03)


@dataclass(frozen=True)
class Variation:
    """One setting changed.

    Attributes:
        name: for tables.
        change: a model class → the class with the setting changed.
        of_priors: whether priors change, and not only the likelihood.
    """

    name: str
    change: Callable[[ModelClass], ModelClass]
    of_priors: bool = False


@dataclass(frozen=True)
class SensitivityRow:
    """The ranking under one variation.

    Attributes:
        name: of the variation.
        log_evidences: model class → log evidence in nats, with its standard error.
        probabilities: model class → posterior probability, with the study's prior weights.
        sampled: the classes that were sampled anew; for the others the draws served again.
        failed_checks: of the classes that were sampled anew.
    """

    name: str
    log_evidences: Mapping[str, Estimate]
    probabilities: Mapping[str, float]
    sampled: tuple[str, ...] = ()
    failed_checks: tuple[str, ...] = ()

    @property
    def ranked(self) -> tuple[str, ...]:
        """Model classes, the most probable first."""
        return tuple(sorted(self.probabilities, key=lambda name: -self.probabilities[name]))

    @property
    def best(self) -> str:
        return self.ranked[0]

    @property
    def lead(self) -> float:
        """Log of the best class's probability over the next one's, in nats; inf if it is alone."""
        shares = sorted(self.probabilities.values(), reverse=True)
        if len(shares) < 2 or shares[1] == 0.0:
            return math.inf
        return math.log(shares[0] / shares[1])


@dataclass(frozen=True)
class Sensitivity:
    """A ranking under every variation; the first row is the ranking as it is.

    Raises:
        ValueError: there is no first row, or it ranks no class.
    """

    rows: tuple[SensitivityRow, ...]

    def __post_init__(self) -> None:
        if not self.rows or not self.rows[0].probabilities:
            raise ValueError("Sensitivity: no ranking")

    @property
    def turning(self) -> tuple[SensitivityRow, ...]:
        """The variations under which another class is the most probable."""
        return tuple(row for row in self.rows if row.best != self.rows[0].best)


def default_variations() -> tuple[Variation, ...]:
    """Every setting halved and doubled: missed and spurious modes, error sizes, prior widths."""
    found = []
    for factor, told in ((2.0, "× 2"), (0.5, "× ½")):
        found += [
            Variation(f"missed modes {told}", partial(_missed, factor)),
            Variation(f"spurious modes {told}", partial(_spurious, factor)),
            Variation(f"σ_f {told}", partial(_errors, factor, 1.0)),
            Variation(f"σ_φ {told}", partial(_errors, 1.0, factor)),
            Variation(f"width of priors {told}", partial(_priors, factor), of_priors=True),
        ]
    return tuple(found)


def sensitivity(
    ranking: Ranking,
    variations: Sequence[Variation] | None = None,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
) -> Sensitivity:
    """Rank again under every variation.

    Args:
        ranking: as it is.
        variations: :func:`default_variations` if None.
        settings: of the classes that are sampled anew; by default to 0.03 nats.
        run: workers for classes that are sampled again, and progress: called after each variation
            with "sensitivity", its name and the share of all that are done. Nothing is kept on
            disk.

    Raises:
        ValueError: two variations have one name, or a class cannot be sampled.
    """
    variations = default_variations() if variations is None else tuple(variations)
    names = [variation.name for variation in variations]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise ValueError(f"sensitivity: two variations are named {repeated[0]!r}")
    rows = [_row("as it is", ranking, {p.name: _quoted(p) for p in ranking.posteriors})]
    run = run or Run()
    with run.working():
        for done, variation in enumerate(variations):
            rows.append(_varied(ranking, variation, settings or SETTINGS, Run(run.workers)))
            run.report("sensitivity", variation.name, (done + 1) / len(variations))
    return Sensitivity(tuple(rows))


def _varied(
    ranking: Ranking, variation: Variation, settings: SamplingSettings, run: Run
) -> SensitivityRow:
    classes = {c.name: variation.change(c) for c in ranking.study.model_classes}
    estimates: dict[str, Estimate | None] = {
        posterior.name: None
        if variation.of_priors
        else _reweighted(posterior, classes[posterior.name])
        for posterior in ranking.posteriors
    }
    anew = [name for name, estimate in estimates.items() if estimate is None]
    sampled = sample_all([classes[name] for name in anew], ranking.seed, settings, run)
    estimates.update((posterior.name, _quoted(posterior)) for posterior in sampled)
    found = {name: estimate for name, estimate in estimates.items() if estimate is not None}
    failed = tuple(f"{p.name}: {check}" for p in sampled for check in p.failed_checks)
    return replace(_row(variation.name, ranking, found), sampled=tuple(anew), failed_checks=failed)


def _quoted(posterior: Posterior) -> Estimate:
    return Estimate(posterior.evidence.log_evidence, posterior.evidence.error)


def _row(name: str, ranking: Ranking, estimates: Mapping[str, Estimate]) -> SensitivityRow:
    weights = ranking.study.prior_weights or dict.fromkeys(estimates, 1.0)
    log_masses = {
        key: estimate.log_evidence + math.log(weights[key]) for key, estimate in estimates.items()
    }
    log_total = float(logsumexp(list(log_masses.values())))
    probabilities = {key: math.exp(mass - log_total) for key, mass in log_masses.items()}
    return SensitivityRow(name, dict(estimates), probabilities)


def _reweighted(posterior: Posterior, changed: ModelClass) -> Estimate | None:
    """The changed class's log evidence by the posterior's draws; None if they do not serve."""
    values, log_likelihoods = posterior.values, posterior.log_likelihoods.ravel()
    chosen = np.linspace(0, len(values) - 1, min(MAX_DRAWS, len(values))).astype(np.intp)
    log_ratios = changed.log_likelihood(values[chosen]) - log_likelihoods[chosen]
    top = float(log_ratios.max())
    if not math.isfinite(top):
        return None
    ratios = np.exp(log_ratios - top)
    # nan, of too few draws, is no more to be trusted than a heavy tail.
    alike = ratios.max() <= ALIKE * ratios.mean()
    if not (alike or pareto_shape(ratios / ratios.sum()) <= MAX_PARETO_K):
        return None
    n_independent = min(float(posterior.effective_sample_sizes.min()), len(chosen))
    error = float(ratios.std() / ratios.mean()) / math.sqrt(n_independent)
    if error > MAX_ERROR:
        return None
    quoted = posterior.evidence
    log_change = top + math.log(float(ratios.mean()))
    return Estimate(quoted.log_evidence + log_change, math.hypot(quoted.error, error))


def _missed(factor: float, candidate: ModelClass) -> ModelClass:
    """With ``factor`` times the probability that a mode is missed, as far as that can be."""
    missed = 1.0 - candidate.identification.detection_probability
    changed = replace(
        candidate.identification,
        detection_probability=1.0 - min(factor * missed, 0.5 * (1.0 + missed)),
    )
    return replace(candidate, identification=changed)


def _spurious(factor: float, candidate: ModelClass) -> ModelClass:
    expected = factor * candidate.identification.expected_spurious_modes
    changed = replace(candidate.identification, expected_spurious_modes=expected)
    return replace(candidate, identification=changed)


def _errors(of_frequencies: float, of_shapes: float, candidate: ModelClass) -> ModelClass:
    """Error sizes times factors; where they are inferred, their priors move with them."""
    error = candidate.error
    return replace(
        candidate,
        error=ErrorModel(
            of_frequencies * as_product(error.frequency_cov), of_shapes * as_product(error.shape_sd)
        ),
    )


def _priors(factor: float, candidate: ModelClass) -> ModelClass:
    """With wider priors of all that the structures leave open; not of the error sizes."""
    wider = {p.name: p.prior.widened(factor) for p in candidate.structural_parameters}
    return replace(candidate, priors=wider)
