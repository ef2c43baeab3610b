"""How to sample, and everything that sampling one target gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.ensembles import Ensemble
from bayes_ssi.sampling.estimates import Estimate, EvidenceEstimate
from bayes_ssi.sampling.importance import ImportanceSample
from bayes_ssi.sampling.maxima import Maxima
from bayes_ssi.sampling.multistart import MultistartSearch
from bayes_ssi.sampling.regions import Regions
from bayes_ssi.sampling.tempering import TemperedStart

__all__ = ["Progress", "SamplingResult", "SamplingSettings"]

# Called with the name of a step and the share of it that is done.
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class SamplingSettings:
    """How precisely to sample.

    Attributes:
        log_evidence_error: wanted standard error of the log evidence, in nats.
        particles: of each tempered start; None chooses by the number of parameters.
        searches: least number of independent searches for maxima.
        max_steps: longest chain of an ensemble, in steps.
        economical: by importance sampling around the maxima alone, with tens of times fewer
            evaluations; for models that take long, and posteriors of a few plain regions.

    Raises:
        ValueError: a setting is not positive, or there are fewer particles than 4 a parameter.
    """

    log_evidence_error: float = 0.01
    particles: int | None = None
    searches: int = 4
    max_steps: int = 5000
    economical: bool = False

    def __post_init__(self) -> None:
        for name in ("log_evidence_error", "particles", "searches", "max_steps"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ValueError(f"SamplingSettings: {name} must be positive, got {value!r}")

    def n_particles(self, n_dimensions: int) -> int:
        """How many particles sample so many parameters.

        Raises:
            ValueError: fewer were asked for than these need.
        """
        if self.particles is None:
            return max(500, 100 * n_dimensions)
        if self.particles < 4 * n_dimensions:
            raise ValueError(
                f"SamplingSettings: particles must be at least {4 * n_dimensions} for "
                f"{n_dimensions} parameters, got {self.particles!r}"
            )
        return self.particles


@dataclass(frozen=True, eq=False)
class SamplingResult:
    """Everything that sampling one target produced, in standard-normal coordinates.

    Attributes:
        discovery: what the searches for maxima found.
        starts: the tempered starts; none on the economical path.
        maxima: of the posterior, all that were found.
        ensembles: of posterior draws.
        resampled: posterior draws made of the importance draws instead, where ensembles mix too
            slowly and these draws are many; else empty.
        importance: what the evidence and the regions' shares come from.
        evidence_checks: estimates of the log evidence by other methods.
        regions: separate regions of the posterior.
        wanted_error: of the log evidence.
        n_evaluations: of the log-likelihood.
    """

    discovery: MultistartSearch
    starts: tuple[TemperedStart, ...]
    maxima: Maxima
    ensembles: tuple[Ensemble, ...]
    importance: ImportanceSample
    evidence_checks: tuple[EvidenceEstimate, ...]
    regions: Regions
    wanted_error: float
    n_evaluations: int
    resampled: tuple[Ensemble, ...] = ()

    @property
    def draws(self) -> tuple[Ensemble, ...]:
        """The posterior draws, in two independent parts."""
        return self.resampled or self.ensembles

    @property
    def evidence(self) -> Estimate:
        """The quoted log evidence."""
        return self.importance.estimate

    @property
    def region_shares(self) -> FloatArray:
        """Share of the posterior in each region, (n_regions,)."""
        return self.regions.shares(self.importance.z, self.importance.weights)

    @property
    def searches_of_regions(self) -> NDArray[np.intp]:
        """How many of the independent searches found a maximum in each region, (n_regions,)."""
        label = self.regions.assign(self.discovery.maxima.z)
        inside = label == np.arange(self.regions.n_regions)[:, None]
        found: NDArray[np.intp] = (self.discovery.found_by @ inside.T).sum(axis=0)
        return found

    @property
    def region_errors(self) -> FloatArray:
        """Standard errors of :attr:`region_shares`."""
        groups = self.regions.assign(self.importance.z)
        return self.importance.share_errors(groups, self.regions.n_regions)
