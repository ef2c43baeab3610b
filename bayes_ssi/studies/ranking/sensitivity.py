"""Sensitivity of a ranking to the analyst's choice of settings.

These are the detection probability, the expected number of spurious modes, the error sizes and
the width of the priors. Each is changed in turn, and all classes are ranked again.

The posterior draws are reweighted; where they do not cover a changed class, or not precisely
enough, it is sampled again.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.comparison import class_probabilities
from bayes_ssi.studies.ranking.study import Ranking
from bayes_ssi.studies.ranking.variations import SampledClasses, Variation, default_variations


@dataclass(frozen=True)
class SensitivityRow:
    """The ranking under one variation."""

    name: str
    # Model class → log evidence in nats, with its standard error.
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
    estimates = {
        each.name: Estimate(each.evidence.log_evidence, each.evidence.error)
        for each in ranking.posteriors
    }
    rows = [SensitivityRow("unchanged", estimates, _probabilities(estimates, ranking))]
    run, settings = run or Run(), settings or SamplingSettings(log_evidence_error=0.03)
    error = settings.log_evidence_error
    with run.working():
        sampled = SampledClasses.of(
            ranking.study.model_classes,
            ranking.posteriors,
            lambda changed: sample_all(changed, ranking.seed, settings, Run(run.workers)),
        )
        for done, variation in enumerate(variations, 1):
            answers = sampled.varied(
                variation, lambda one: bool(one.problem) or one.log_ratio.error > error
            )
            again = {name: each for name, each in answers.items() if each.is_sampled_again}
            estimates = {name: each.log_evidence for name, each in answers.items()}
            rows.append(
                SensitivityRow(
                    variation.name,
                    estimates,
                    _probabilities(estimates, ranking),
                    sampled=tuple(again),
                    failed_checks=tuple(
                        f"{name!r}: {check}"
                        for name, each in again.items()
                        for check in each.posterior.failed_checks
                    ),
                )
            )
            run.report("sensitivity", variation.name, done / len(variations))
    return Sensitivity(tuple(rows))


def _probabilities(estimates: Mapping[str, Estimate], ranking: Ranking) -> dict[str, float]:
    log_evidences = {name: estimate.log_evidence for name, estimate in estimates.items()}
    return class_probabilities(log_evidences, ranking.study.prior_weights)
