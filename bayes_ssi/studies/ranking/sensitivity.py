"""Sensitivity of a ranking to the analyst's choice of settings.

These are the detection probability, the expected number of spurious modes, the error sizes and
the width of the priors. Each is changed in turn, and all classes are ranked again.

The posterior draws are reweighted; where they do not cover a changed class, or not precisely
enough, it is sampled again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.known_modes import known_at_draws
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.comparison import class_probabilities
from bayes_ssi.studies.ranking.reweighting import reweighted
from bayes_ssi.studies.ranking.study import Ranking
from bayes_ssi.studies.ranking.variations import Variation, default_variations

SETTINGS = SamplingSettings(log_evidence_error=0.03)


@dataclass(frozen=True)
class SensitivityRow:
    """The ranking under one variation.

    Attributes:
        log_evidences: model class → log evidence in nats, with its standard error.
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
        """Log of the probability ratio of the two best classes, in nats; inf for a single class."""
        shares = sorted(self.probabilities.values(), reverse=True)
        if len(shares) < 2 or shares[1] == 0.0:
            return math.inf
        return math.log(shares[0] / shares[1])


@dataclass(frozen=True)
class Sensitivity:
    """A ranking under every variation; the first row is the ranking without any."""

    rows: tuple[SensitivityRow, ...]

    def __post_init__(self) -> None:
        if not self.rows or not self.rows[0].probabilities:
            raise ValueError("Sensitivity: no ranking")

    @property
    def turning(self) -> tuple[SensitivityRow, ...]:
        """The variations under which another class is the most probable."""
        return tuple(row for row in self.rows if row.best != self.rows[0].best)


def sensitivity(
    ranking: Ranking,
    variations: Sequence[Variation] | None = None,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
) -> Sensitivity:
    """Rank again under every variation.

    Args:
        variations: :func:`default_variations` if None.
        settings: settings for classes that are sampled again; their wanted error also limits that
            of reweighting. By default it is 0.03 nats.
        run: workers for classes that are sampled again, and progress: called after each variation
            with "sensitivity", its name and the completed share of all. Nothing is kept on disk.
    """
    variations = default_variations() if variations is None else tuple(variations)
    names = [variation.name for variation in variations]
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise ValueError(f"sensitivity: two variations are named {repeated[0]!r}")
    rows = [_row("unchanged", ranking, {p.name: _quoted(p) for p in ranking.posteriors})]
    run, settings = run or Run(), settings or SETTINGS
    classes = {c.name: c for c in ranking.study.model_classes}
    known = {each.name: known_at_draws(classes[each.name], each) for each in ranking.posteriors}
    with run.working():
        for done, variation in enumerate(variations):
            rows.append(_varied(ranking, known, variation, settings, Run(run.workers)))
            run.report("sensitivity", variation.name, (done + 1) / len(variations))
    return Sensitivity(tuple(rows))


def _varied(
    ranking: Ranking,
    known: Mapping[str, ModelClass],
    variation: Variation,
    settings: SamplingSettings,
    run: Run,
) -> SensitivityRow:
    classes = {c.name: c for c in ranking.study.model_classes}
    error = settings.log_evidence_error
    estimates: dict[str, Estimate | None] = {
        each.name: _estimate(each, classes[each.name], known[each.name], variation, error)
        for each in ranking.posteriors
    }
    again = tuple(name for name, estimate in estimates.items() if estimate is None)
    changed = [variation.change(classes[name]) for name in again]
    sampled = sample_all(changed, ranking.seed, settings, run)
    estimates.update((posterior.name, _quoted(posterior)) for posterior in sampled)
    all_known = {name: estimate for name, estimate in estimates.items() if estimate is not None}
    failed = tuple(f"{p.name!r}: {check}" for p in sampled for check in p.failed_checks)
    row = _row(variation.name, ranking, all_known)
    return replace(row, sampled=again, failed_checks=failed)


def _estimate(
    posterior: Posterior,
    original: ModelClass,
    known: ModelClass,
    variation: Variation,
    max_error: float,
) -> Estimate | None:
    """The changed class's log evidence by reweighted draws; None if they do not allow it."""
    changed = variation.change(original)
    if changed.parameter_names != original.parameter_names:
        return None
    # Where a structure changes, its modes at the draws are solved for.
    before = [test.structure for test in original.configurations]
    at_draws = [test.structure for test in known.configurations]
    changed = changed.with_structures(lambda s, i: at_draws[i] if s is before[i] else s)
    answer = reweighted(posterior, known, changed)
    if answer.problem or answer.log_ratio.error > max_error:
        return None
    return answer.log_evidence


def _quoted(posterior: Posterior) -> Estimate:
    return Estimate(posterior.evidence.log_evidence, posterior.evidence.error)


def _row(name: str, ranking: Ranking, estimates: Mapping[str, Estimate]) -> SensitivityRow:
    log_evidences = {key: estimate.log_evidence for key, estimate in estimates.items()}
    probabilities = class_probabilities(log_evidences, ranking.study.prior_weights)
    return SensitivityRow(name, dict(estimates), probabilities)
