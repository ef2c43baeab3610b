"""Sensitivity of a ranking to the analyst's choice of settings, from its draws.

These are the detection probability, the expected number of spurious modes, the error sizes and
the widths of the priors. Each is halved and doubled in turn, and all classes are ranked again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bayes_ssi.studies.ranking.comparison import RANKING, can_matter, class_probabilities
from bayes_ssi.studies.ranking.variations import SampledClasses, default_variations


@dataclass(frozen=True)
class SensitivityRow:
    """The ranking under one setting."""

    name: str
    probabilities: Mapping[str, float]  # of every model class; none where the draws do not say
    problem: str = ""  # why the draws do not say, class by class
    # Classes of which the draws say nothing reliable, but that are too improbable to matter.
    unsaid: tuple[str, ...] = ()

    @property
    def ranked(self) -> tuple[str, ...]:
        """Model classes, the most probable first."""
        return tuple(sorted(self.probabilities, key=lambda name: -self.probabilities[name]))

    @property
    def best(self) -> str:
        return self.ranked[0]

    @property
    def lead(self) -> float:
        """Log of the probability ratio of the two best classes, in nats.

        Infinite for a single class; NaN where the draws of the second do not say.
        """
        best, *others = self.ranked
        if not others or self.probabilities[others[0]] == 0.0:
            return math.inf
        if others[0] in self.unsaid:
            return math.nan
        return math.log(self.probabilities[best] / self.probabilities[others[0]])


@dataclass(frozen=True)
class Sensitivity:
    """A ranking under every setting; the first row is the ranking itself."""

    rows: tuple[SensitivityRow, ...]

    @property
    def known(self) -> tuple[SensitivityRow, ...]:
        """The rows of which the draws say something."""
        return tuple(row for row in self.rows if row.probabilities)

    @property
    def turning(self) -> tuple[SensitivityRow, ...]:
        """The settings under which another class is the most probable."""
        return tuple(row for row in self.known if row.best != self.rows[0].best)

    @property
    def problems(self) -> tuple[str, ...]:
        """What the draws do not say, a sentence for each setting."""
        return tuple(f"{row.name}: {row.problem}" for row in self.rows if row.problem)


def sensitivity(sampled: SampledClasses, prior_weights: Mapping[str, float] | None) -> Sensitivity:
    """Rank model classes again under every setting, by reweighting their draws.

    Where these do not cover it, a class is sampled again if it is known as it was sampled.

    Args:
        prior_weights: name → prior weight; equal if None.
    """
    log_evidences = {name: p.evidence.log_evidence for name, p in sampled.posteriors.items()}
    shares = class_probabilities(log_evidences, prior_weights)
    rows = [SensitivityRow("unchanged", shares)]
    for variation in default_variations():
        answers = sampled.varied(variation, lambda one: bool(sampled.classes and one.problem))
        changed = {name: each.log_evidence.log_evidence for name, each in answers.items()}
        after = class_probabilities(changed, prior_weights)
        unsaid = [name for name, each in answers.items() if each.problem]
        errors = {name: RANKING.standard_errors * answers[name].log_ratio.error for name in unsaid}
        problem = "; ".join(
            f"{name!r}: {answers[name].problem}"
            for name in unsaid
            if can_matter(shares[name])
            or can_matter(after[name], min(errors[name], RANKING.wrong_by))
        )
        rows.append(
            SensitivityRow(variation.name, {} if problem else after, problem, tuple(unsaid))
        )
    return Sensitivity(tuple(rows))
