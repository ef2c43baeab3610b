"""The target that stands for a model class."""

from __future__ import annotations

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.calibration.narrow_regions import NarrowRegions
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.inference.workers.journal import Journal
from bayes_ssi.inference.workers.workers import Workers


def class_target(
    model_class: ModelClass,
    workers: Workers | None = None,
    journal: Journal | None = None,
    known_starts: FloatArray | None = None,
) -> Target:
    """The log-likelihood of a class, which suggests starts in its posterior's narrow regions.

    Args:
        workers: where it is evaluated; in this process if None.
        known_starts: (m, d), near maxima that an earlier search found, in standard-normal
            coordinates.
    """
    return Target(
        model_class.log_likelihood_at,
        len(model_class.parameters),
        workers,
        journal,
        NarrowRegions(model_class, workers),
        known_starts,
    )
