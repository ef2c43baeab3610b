"""Everything that sampling one target produces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.compression import Compression
from bayes_ssi.inference.sampling.diagnostics import r_hat
from bayes_ssi.inference.sampling.ensembles import Ensemble
from bayes_ssi.inference.sampling.estimates import Estimate, EvidenceEstimate
from bayes_ssi.inference.sampling.importance import ImportanceSample
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.multistart import MultistartSearch
from bayes_ssi.inference.sampling.regions import Regions
from bayes_ssi.inference.sampling.settings import REGIONS
from bayes_ssi.inference.sampling.target import log_standard_normal


@dataclass(frozen=True, eq=False)
class SamplingResult:
    """Everything that sampling one target produced, in standard-normal coordinates."""

    search: MultistartSearch
    compressions: tuple[Compression, ...]
    maxima: Maxima
    ensembles: tuple[Ensemble, ...]
    importance: ImportanceSample
    evidence_checks: tuple[EvidenceEstimate, ...]  # estimates of the log evidence by other methods
    regions: Regions
    # (n_regions, m), whether a maximum that the searches found is in a region.
    maxima_of_regions: NDArray[np.bool_]
    wanted_error: float  # wanted standard error of the log evidence
    n_evaluations: int  # evaluations of the log-likelihood
    # Posterior draws resampled from the importance draws, where ensembles mix too slowly and the
    # importance draws suffice; else empty.
    resampled: tuple[Ensemble, ...] = ()

    @property
    def draws(self) -> tuple[Ensemble, ...]:
        """The posterior draws, in two independent parts."""
        return self.resampled or self.ensembles

    @property
    def effective_sample_sizes(self) -> FloatArray:
        """Effective sample size of the draws, coordinate by coordinate, (d,)."""
        return np.sum([part.effective_sample_sizes for part in self.draws], axis=0)

    @property
    def r_hat(self) -> float:
        """The largest R-hat of any coordinate between the parts, each of them as one chain.

        Walkers of one ensemble depend on one another, ensembles do not. Together they are so many
        that, unlike R-hat between short chains of single walkers, it is near 1 where all is well.
        """
        return float(r_hat([part.draws for part in self.draws]).max())

    @property
    def evidence(self) -> Estimate:
        """The quoted log evidence."""
        return self.importance.estimate

    @property
    def region_shares(self) -> FloatArray:
        """Share of the posterior in each region, (n_regions,)."""
        return self.regions.shares(self.importance.z, self.importance.weights)

    @property
    def prior_masses_of_regions(self) -> FloatArray:
        """Prior mass of the bulk of each region, (n_regions,).

        There, the likelihood is hardly below that of typical posterior draws.
        """
        sample = self.importance
        groups, typical = self.regions.assign(sample.z), sample.weights > 0.1 / len(sample.z)
        masses = np.exp(log_standard_normal(sample.z) - sample.log_proposals) / len(sample.z)
        levels = sample.log_likelihoods
        bulk = np.zeros(self.regions.n_regions)
        for region in np.unique(groups[typical]):
            lowest = np.median(levels[typical & (groups == region)]) - REGIONS.valley_depth
            bulk[region] = masses[(groups == region) & (levels >= lowest)].sum()
        return bulk

    @property
    def searches_of_regions(self) -> NDArray[np.intp]:
        """How many of the independent searches found a maximum in each region, (n_regions,)."""
        found = self.search.found_by @ self.maxima_of_regions.T
        counts: NDArray[np.intp] = found.sum(axis=0)
        return counts

    @property
    def region_errors(self) -> FloatArray:
        """Standard errors of :attr:`region_shares`."""
        groups = self.regions.assign(self.importance.z)
        return self.importance.share_errors(groups, self.regions.n_regions)
