"""Parameters averaged over model classes by the classes' probabilities."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.ranking.comparison import Comparison


@dataclass(frozen=True)
class AveragedParameter(Summary):
    """A parameter averaged over the model classes that infer it, weighted by their probabilities.

    Classes in which it has a fixed value, or does not occur, are left out.
    """

    n_classes: int  # number of classes that infer it
    probability: float  # of these classes together


@dataclass(frozen=True)
class AveragedAndNaive(AveragedParameter):
    """A parameter of the baseline, averaged over all hypotheses by their probability.

    Attributes:
        naive_mean, naive_sd: under the most probable hypothesis of no appendage that infers it.
    """

    naive_mean: float
    naive_sd: float


def averaged_parameters(
    posteriors: Sequence[Posterior], comparison: Comparison
) -> tuple[AveragedParameter, ...]:
    """Every parameter that several classes infer, in the order in which they first appear.

    Parameters with the same name are the same. One whose classes all have probability zero is
    left out.
    """
    probabilities = {row.name: row.probability for row in comparison.classes}
    holders: dict[str, list[Posterior]] = {}
    for posterior in posteriors:
        for name in posterior.parameter_names:
            holders.setdefault(name, []).append(posterior)
    return tuple(
        averaged_parameter(name, own, [probabilities[posterior.name] for posterior in own])
        for name, own in holders.items()
        if len(own) > 1 and sum(probabilities[posterior.name] for posterior in own) > 0.0
    )


def averaged_parameter(
    name: str, posteriors: Sequence[Posterior], probabilities: Sequence[float]
) -> AveragedParameter:
    """A parameter over the classes that infer it, which have these probabilities."""
    total = sum(probabilities)
    draws, weights = [], []
    for posterior, probability in zip(posteriors, probabilities, strict=True):
        own = posterior.values[:, posterior.parameter_names.index(name)]
        draws.append(own)
        weights.append(np.full(len(own), probability / total / len(own)))
    x, w = np.concatenate(draws), np.concatenate(weights)
    return AveragedParameter.weighted(
        name, x, w, n_classes=len(posteriors), probability=min(total, 1.0)
    )
