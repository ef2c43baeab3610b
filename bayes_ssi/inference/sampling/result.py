"""Everything that sampling one target produces, and checks of it: estimates that should agree.

A group of checks is one function in ``_CHECKS`` that yields a sentence for each thing that fails.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray
from bayes_ssi.inference.sampling.compression import Compression
from bayes_ssi.inference.sampling.diagnostics import STANDARD_ERRORS, Estimate, EvidenceEstimate
from bayes_ssi.inference.sampling.ensembles import ChainStatistics, Ensemble
from bayes_ssi.inference.sampling.importance import PARETO_K_LIMIT, ImportanceSample
from bayes_ssi.inference.sampling.multistart import MultistartSearch
from bayes_ssi.inference.sampling.regions import VALLEY_DEPTH, Regions
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.sampling.target import FARTHEST, log_standard_normal

LEAST_EFFECTIVE_SAMPLE_SIZE = 400  # Vehtari et al. (2021) ask for it
ERROR_OVER_WANTED = 1.5  # the wanted error counts as reached up to this multiple of it
# Importance draws may miss a share of the posterior up to this multiple of the evidence's
# error: the evidence is too low by that share, and two standard errors are no surprise.
MISSED_OVER_ERROR = 2.0
# A region with less of the posterior than this need not be found by every part of the sampling.
SMALL_SHARE = 0.02
# Nor need one whose part of the prior had, on average, so many of the draws of each search: it
# was seen, but led to a higher neighbour.
DRAWS_THAT_SEE = 5.0
# An evidence that rests on one value of the likelihood, which more than this share of the prior
# has, says nothing.
FLAT_SHARE = 0.9999


@dataclass(frozen=True, eq=False)
class SamplingResult:
    """Everything that sampling one target produced, in standard-normal coordinates."""

    search: MultistartSearch
    compressions: tuple[Compression, ...]
    ensembles: tuple[Ensemble, ...]
    quoted: tuple[Ensemble, ...]  # the same, thinned
    chains: ChainStatistics  # of all their walkers
    importance: ImportanceSample
    evidence_checks: tuple[EvidenceEstimate, ...]  # estimates of the log evidence by other methods
    regions: Regions
    # (n_regions, m), whether a maximum that the searches found is in a region.
    maxima_of_regions: BoolArray
    settings: SamplingSettings
    n_evaluations: int  # evaluations of the log-likelihood
    is_flat: bool = False  # whether no parameter is meant to have an influence on it

    @cached_property
    def failed_checks(self) -> list[str]:
        """Disagreements, a sentence each; empty when all is well."""
        return [message for check in _CHECKS for message in check(self)]

    @property
    def chains_mix(self) -> bool:
        """Whether R-hat and effective sample sizes are those of chains that can be quoted."""
        return not list(_chains(self))

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
            lowest = np.median(levels[typical & (groups == region)]) - VALLEY_DEPTH
            bulk[region] = masses[(groups == region) & (levels >= lowest)].sum()
        return bulk

    @property
    def searches_of_regions(self) -> IntArray:
        """How many of the independent searches found a maximum in each region, (n_regions,)."""
        return (self.search.reached_by @ self.maxima_of_regions.T).sum(axis=0)

    @property
    def region_errors(self) -> FloatArray:
        """Standard errors of :attr:`region_shares`."""
        groups = self.regions.assign(self.importance.z)
        return self.importance.share_errors(groups, self.regions.n_regions)


def _chains(sampled: SamplingResult) -> Iterator[str]:
    r_hat, limit = sampled.chains.r_hat, sampled.settings.r_hat
    n_steps = sampled.ensembles[0].n_steps
    if not r_hat <= limit:
        yield f"the chains differ: R-hat is {r_hat:.3f}, above {limit:g}, after {n_steps} steps"
    size, least = sampled.chains.smallest_size, LEAST_EFFECTIVE_SAMPLE_SIZE
    if not size >= least:
        yield f"effective sample size of the chains {size:.0f}, at least {least} needed"


def _importance_draws(sampled: SamplingResult) -> Iterator[str]:
    error, draws = sampled.evidence.error, sampled.importance
    # It is at least the largest share of the evidence that one importance draw carries.
    if error > ERROR_OVER_WANTED * sampled.settings.log_evidence_error:
        yield (
            f"the standard error of the log evidence is {error:.3f} after {len(draws.z)} "
            f"importance draws; {sampled.settings.log_evidence_error:g} was wanted"
        )
    if not draws.pareto_k <= PARETO_K_LIMIT:
        k, limit = draws.pareto_k, PARETO_K_LIMIT
        yield f"a few importance draws may carry the evidence: Pareto k is {k:.2f}, above {limit}"
    missed = draws.share_beyond((*sampled.ensembles, *sampled.compressions))
    if missed > MISSED_OVER_ERROR * error:
        yield (
            f"the importance draws may miss {100 * missed:.1f} % of the posterior: draws of the "
            "chains or particles weigh more than the heaviest of them"
        )


def _evidence_estimates(sampled: SamplingResult) -> Iterator[str]:
    quoted = sampled.evidence
    for other in sampled.evidence_checks:
        if not other.agrees_with(quoted):
            both = f"{quoted} and {other}"
            yield f"importance sampling and {other.name} disagree on the log evidence: {both}"


def _regions(sampled: SamplingResult) -> Iterator[str]:
    """Regions that a part of the sampling missed."""
    regions, region_shares = sampled.regions, sampled.region_shares
    if regions.n_regions == 1:
        return
    found_by, n_searches = sampled.searches_of_regions, sampled.search.n_searches
    n_draws = sampled.search.n_draws / n_searches
    seen = sampled.prior_masses_of_regions * n_draws >= DRAWS_THAT_SEE
    shares_of_compressions = [regions.shares(one.draws) for one in sampled.compressions]
    shares_of_chains = regions.shares(np.concatenate([part.draws for part in sampled.ensembles]))
    for region in np.flatnonzero(region_shares > SMALL_SHARE):
        name = f"a region with {100 * region_shares[region]:.1f} % of the posterior"
        if found_by[region] < 2 and not seen[region]:
            found = f"found by {found_by[region]} of {n_searches} independent searches"
            yield f"{name} was {found}; there may be others"
        missed = sum(shares[region] == 0 for shares in shares_of_compressions)
        if missed:
            by = f"{missed} of {len(shares_of_compressions)} compressions of the prior"
            yield f"{name} was missed by {by}; there may be others"
        if shares_of_chains[region] == 0:
            yield f"{name} was never visited by the chains"


def _reach(sampled: SamplingResult) -> Iterator[str]:
    """A posterior so far from the prior that coordinates may have cut it off."""
    z = sampled.importance.z
    share = float(sampled.importance.weights @ (np.abs(z).max(axis=1) > FARTHEST - 1.0))
    if share > SMALL_SHARE:
        yield (
            f"{100 * share:.0f} % of the posterior is {FARTHEST - 1.0:g} prior standard deviations "
            "or more from the prior's median, where what is farther is left out: does a prior "
            "contradict the data?"
        )


def _influence(sampled: SamplingResult) -> Iterator[str]:
    """A log evidence that rests on one value of the log-likelihood, which most of the prior has.

    By masses in the prior all importance draws share it that are possible: others far out, where a
    model fails or coordinates end, do not hide it, unless they are most of the prior.
    """
    if sampled.is_flat:
        return
    draws = sampled.importance
    values, possible = draws.log_likelihoods, np.isfinite(draws.log_likelihoods)
    masses = np.exp(log_standard_normal(draws.z) - draws.log_proposals)
    heaviest = values[(masses * possible).argmax()]
    alike = np.isclose(values, heaviest, 1e-9, 1e-9)
    mass, beyond = masses @ alike, float(draws.weights @ ~alike)  # of the prior, of the posterior
    if mass < FLAT_SHARE * (masses @ possible) or mass < 0.5 * masses.sum():
        return
    if beyond <= STANDARD_ERRORS * sampled.evidence.error:
        yield (
            f"the log-likelihood is {heaviest:.6g} wherever it was evaluated: either no "
            "parameter has an influence on it, or this is a floor at which small likelihoods are "
            "cut off, and all above it lies in regions of less than "
            f"{sampled.search.largest_unseen_mass:.1g} of the prior, which were not found"
        )


def _searches(sampled: SamplingResult) -> Iterator[str]:
    """Maxima that only one search found, where there are no particles as a second check."""
    if not (sampled.compressions or sampled.search.converged):
        n = sampled.search.n_searches
        yield f"{n} independent searches found different maxima; there may be others"


_CHECKS = (_chains, _importance_draws, _evidence_estimates, _regions, _reach, _influence, _searches)
