"""Settings of a model class that are varied, each in turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.parameters import as_product


@dataclass(frozen=True)
class Variation:
    """One setting changed."""

    name: str
    change: Callable[[ModelClass], ModelClass]


def default_variations() -> tuple[Variation, ...]:
    """Every setting halved and doubled: missed and spurious modes, error sizes, prior widths."""
    variations = []
    for factor, times in ((2.0, "× 2"), (0.5, "× ½")):
        variations += [
            Variation(f"missed modes {times}", partial(with_missed, factor)),
            Variation(f"spurious modes {times}", partial(with_spurious, factor)),
            Variation(f"σ_f {times}", partial(with_errors, factor, 1.0)),
            Variation(f"σ_φ {times}", partial(with_errors, 1.0, factor)),
            Variation(f"width of priors {times}", partial(with_wider_priors, factor)),
        ]
    return tuple(variations)


def with_missed(factor: float, candidate: ModelClass) -> ModelClass:
    """The class with ``factor`` times the probability that a mode is missed.

    The probability of detection is at most halved.
    """
    missed = 1.0 - candidate.identification.detection_probability
    changed = replace(
        candidate.identification,
        detection_probability=1.0 - min(factor * missed, 0.5 * (1.0 + missed)),
    )
    return replace(candidate, identification=changed)


def with_spurious(factor: float, candidate: ModelClass) -> ModelClass:
    """The class with ``factor`` times the expected number of spurious modes."""
    expected = factor * candidate.identification.expected_spurious_modes
    changed = replace(candidate.identification, expected_spurious_modes=expected)
    return replace(candidate, identification=changed)


def with_errors(of_frequencies: float, of_shapes: float, candidate: ModelClass) -> ModelClass:
    """The class with error sizes times these factors, also where they are inferred."""
    changed = replace(
        candidate.error,
        frequency_cov=of_frequencies * as_product(candidate.error.frequency_cov),
        shape_sd=of_shapes * as_product(candidate.error.shape_sd),
    )
    return replace(candidate, error=changed)


def with_wider_priors(factor: float, candidate: ModelClass) -> ModelClass:
    """The class with wider priors of the structures' parameters, but not of the error sizes."""
    wider = {p.name: p.prior.widened(factor) for p in candidate.structural_parameters}
    return replace(candidate, priors={**candidate.priors, **wider})
