"""The target that stands for a model class."""

from __future__ import annotations

from bayes_ssi.arrays import FloatArray
from bayes_ssi.calibration.narrow_regions import NarrowRegions
from bayes_ssi.execution.journal import Journal
from bayes_ssi.execution.workers import Workers
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.sampling.target import Target


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
