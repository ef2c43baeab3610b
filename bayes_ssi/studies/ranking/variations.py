"""Settings of a model class that are varied, and the draws of classes reweighted to them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.parameters.parameters import as_product
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.studies.ranking.reweighting import Reweighted, reweighted


@dataclass(frozen=True)
class Variation:
    """One setting changed."""

    name: str
    change: Callable[[ModelClass], ModelClass]

    def reweighted(
        self, posteriors: Mapping[str, Posterior], known: Mapping[str, ModelClass]
    ) -> dict[str, Reweighted]:
        """The posteriors of all classes under it; ``known`` has their modes at the draws."""
        return {
            name: reweighted(posteriors[name], candidate, self.change(candidate))
            for name, candidate in known.items()
        }


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


def with_wider_priors(
    factor: float, candidate: ModelClass, names: Collection[str] | None = None
) -> ModelClass:
    """The class with wider priors of some parameters; of all but error sizes if none are named."""
    if names is None:
        names = {p.name for p in candidate.structural_parameters}
    wider = {p.name: p.prior.widened(factor) for p in candidate.parameters if p.name in names}
    return with_priors(wider, candidate)


def with_priors(priors: Mapping[str, Prior], candidate: ModelClass) -> ModelClass:
    """The class with other priors of those of the parameters that it has."""
    own = {name: prior for name, prior in priors.items() if name in candidate.parameter_names}
    return replace(candidate, priors={**candidate.priors, **own}) if own else candidate


def with_bands(bands_hz: Mapping[str, tuple[float, float]], candidate: ModelClass) -> ModelClass:
    """The class with other bands, by name of the configuration."""
    tests = tuple(
        replace(test, data=replace(test.data, band_hz=bands_hz[test.name]))
        if test.name in bands_hz
        else test
        for test in candidate.configurations
    )
    return replace(candidate, configurations=tests) if bands_hz else candidate
