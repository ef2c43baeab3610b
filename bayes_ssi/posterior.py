"""The posterior of one model class: draws, summaries, evidence, and what was checked."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter

import numpy as np

from bayes_ssi.evidence import Estimate
from bayes_ssi.model_class import ModelClass
from bayes_ssi.priors import FloatArray
from bayes_ssi.production import (
    LENGTH_IN_AUTOCORRELATION_TIMES,
    effective_sample_size,
    r_hat,
)
from bayes_ssi.sampling import Progress, Sampled, SamplingSettings, sample_target
from bayes_ssi.target import Target

__all__ = ["Evidence", "ParameterSummary", "Posterior", "Region", "sample"]

R_HAT_LIMIT = 1.01
LARGEST_WEIGHT_LIMIT = 0.02
# Estimates that differ by more than this many of their standard errors disagree.
DISAGREEMENT = 4.0
# The tempered start's estimate is coarse: smaller differences from it mean nothing.
TEMPERED_TOLERANCE = 1.0
# A region with less of the posterior than this need not be found by every tempered start.
SMALL_SHARE = 0.02
# Evaluations without modes in a smaller share than this lie in the far tails of a prior.
NEGLIGIBLE_FAILURES = 1e-3


@dataclass(frozen=True)
class Evidence:
    """The log evidence of a model class in nats, and the estimates that check it.

    Attributes:
        log_evidence: by mixture importance sampling, the quoted value.
        error: its standard error.
        effective_sample_size: of the importance draws.
        n_draws: number of importance draws.
        bridge: bridge sampling's estimate.
        tempered: the tempered starts' estimate, coarse.
        laplace: Laplace's approximation, summed over the maxima found; a quick look.
        mean_log_likelihood: posterior mean of the log-likelihood, how well the class fits.
    """

    log_evidence: float
    error: float
    effective_sample_size: float
    n_draws: int
    bridge: Estimate
    tempered: Estimate
    laplace: float
    mean_log_likelihood: float

    @property
    def information_gained(self) -> float:
        """What the data taught about the parameters, in nats: the price of the fit.

        The relative entropy of posterior to prior; log evidence = mean log-likelihood - this.
        """
        return self.mean_log_likelihood - self.log_evidence


@dataclass(frozen=True)
class Region:
    """A part of the posterior that a valley divides from the others.

    Attributes:
        share: probability of the region, by importance sampling.
        error: its standard error.
        shares_of_starts: share of each tempered start's particles.
        mean: posterior mean of every parameter within the region.
    """

    share: float
    error: float
    shares_of_starts: tuple[float, ...]
    mean: tuple[float, ...]


@dataclass(frozen=True)
class ParameterSummary:
    """Posterior of one parameter.

    ``mean_error`` and ``sd_error`` are Monte Carlo errors; ``relative_spread`` is as in
    :class:`Posterior`.
    """

    name: str
    mean: float
    sd: float
    mean_error: float
    sd_error: float
    quantile_05: float
    median: float
    quantile_95: float
    relative_spread: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of one model class.

    Attributes:
        name: of the model class.
        parameter_names: columns of ``draws``.
        draws: (n_chains, n_steps, n_parameters), equally weighted parameter values; a chain is a
            walker of one of the ensembles.
        log_likelihoods: (n_chains, n_steps).
        frequencies_hz: (n_chains, n_steps, n_modes), of the model at the draws.
        effective_sample_sizes: (n_parameters,), of the draws.
        evidence: log evidence and its checks.
        regions: separate regions, the most probable first.
        maxima: (m, n_parameters), parameter values at the maxima of likelihood times prior
            density in standard-normal coordinates, the highest first.
        r_hat: the largest potential scale reduction of any parameter.
        autocorrelation_time: the longest, in steps.
        acceptance: share of proposals accepted.
        n_evaluations: of the log-likelihood, all steps together.
        seconds: wall-clock time.
        failed_checks: what should have agreed and did not, a sentence each.
        data_digest: identifies the data whose density the evidence is.
        pairing: label of an identified mode → number of the model mode, from 1.
        relative_spreads: (n_parameters,), standard deviation of the posterior over that of the
            prior, both in standard-normal coordinates: 1 where the data say nothing.
    """

    name: str
    parameter_names: tuple[str, ...]
    draws: FloatArray
    log_likelihoods: FloatArray
    frequencies_hz: FloatArray
    effective_sample_sizes: FloatArray
    evidence: Evidence
    regions: tuple[Region, ...]
    maxima: FloatArray
    r_hat: float
    autocorrelation_time: float
    acceptance: float
    n_evaluations: int
    seconds: float
    failed_checks: tuple[str, ...]
    data_digest: str
    pairing: Mapping[str, int]
    relative_spreads: FloatArray

    @property
    def values(self) -> FloatArray:
        """All draws, (n_draws, n_parameters)."""
        return self.draws.reshape(-1, len(self.parameter_names))

    @cached_property
    def summary(self) -> tuple[ParameterSummary, ...]:
        """Mean, standard deviation and quantiles of every parameter."""
        means, sds = self.values.mean(0), self.values.std(0)
        # What the errors of the regions' shares do to the mean. Shares add up to one, so their
        # errors go together: exact for two regions, a bound for more.
        between = sum(region.error * np.abs(region.mean - means) for region in self.regions)
        mean_errors = np.sqrt(sds**2 / self.effective_sample_sizes + between**2)
        fourth = ((self.values - means) ** 4).mean(0)
        sd_errors = np.sqrt(np.maximum(fourth - sds**4, 0.0) / self.effective_sample_sizes)
        quantiles = np.quantile(self.values, [0.05, 0.5, 0.95], axis=0)
        return tuple(
            ParameterSummary(
                name=name,
                mean=float(means[i]),
                sd=float(sds[i]),
                mean_error=float(mean_errors[i]),
                sd_error=float(sd_errors[i] / (2.0 * sds[i])) if sds[i] > 0 else 0.0,
                quantile_05=float(quantiles[0, i]),
                median=float(quantiles[1, i]),
                quantile_95=float(quantiles[2, i]),
                relative_spread=float(self.relative_spreads[i]),
            )
            for i, name in enumerate(self.parameter_names)
        )


def sample(
    model_class: ModelClass,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    progress: Progress | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Args:
        model_class: what is sampled.
        seed: the result follows from it and from the class's name alone.
        settings: how precisely.
        progress: called with the name of a step and the share of it that is done.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior.
    """
    started = perf_counter()
    model_class.check_structure()
    n = len(model_class.parameters)
    target = Target(model_class.log_likelihood_at, n)
    try:
        sampled = sample_target(target, _seed_of(model_class.name, seed), settings, progress)
    except np.linalg.LinAlgError:  # a ValueError, but no fault of the input's
        raise
    except ValueError as error:
        raise ValueError(f"model class {model_class.name!r}: {error}") from error
    z, log_likelihoods = _corrected_draws(sampled, np.random.default_rng(seed))
    values = model_class.values(z.reshape(-1, n))
    frequencies_hz = model_class.likelihood.modes(values).frequencies_hz
    values = values.reshape(z.shape)
    return Posterior(
        name=model_class.name,
        parameter_names=model_class.parameter_names,
        draws=values,
        log_likelihoods=log_likelihoods,
        frequencies_hz=frequencies_hz.reshape(*z.shape[:2], -1),
        effective_sample_sizes=effective_sample_size(sampled.ensembles),
        evidence=_evidence(sampled),
        regions=_regions(sampled, z, values),
        maxima=model_class.values(sampled.maxima.z),
        r_hat=float(r_hat(sampled.ensembles).max()),
        autocorrelation_time=max(float(e.autocorrelation_times.max()) for e in sampled.ensembles),
        acceptance=float(np.mean([e.acceptance for e in sampled.ensembles])),
        n_evaluations=sampled.n_evaluations,
        seconds=perf_counter() - started,
        failed_checks=tuple(failed_checks(sampled)),
        data_digest=model_class.data.digest,
        pairing=dict(model_class.pairing),
        relative_spreads=z.reshape(-1, n).std(axis=0),
    )


def failed_checks(sampled: Sampled) -> list[str]:
    """What should agree in a result and does not, a sentence each; empty when all is well."""
    failed = []
    wanted = LENGTH_IN_AUTOCORRELATION_TIMES
    for ensemble in sampled.ensembles:
        if not ensemble.is_long_enough:
            failed.append(
                f"a chain of {ensemble.n_steps} steps is shorter than {wanted} autocorrelation "
                f"times of {ensemble.autocorrelation_times.max():.0f} steps"
            )
    largest = float(r_hat(sampled.ensembles).max())
    if not largest <= R_HAT_LIMIT:
        failed.append(f"the ensembles differ: R-hat is {largest:.3f}, above {R_HAT_LIMIT}")
    quoted, bridge, tempered = sampled.evidence, sampled.bridge, sampled.tempered
    weight = float(sampled.importance.weights.max())
    if weight > LARGEST_WEIGHT_LIMIT:
        failed.append(f"one importance draw carries {100 * weight:.0f} % of the evidence")
    apart = abs(bridge.log_evidence - quoted.log_evidence)
    if not apart <= DISAGREEMENT * math.hypot(bridge.error, quoted.error):
        failed.append(
            f"log evidence by importance sampling, {_plus_minus(quoted)}, and by bridge "
            f"sampling, {_plus_minus(bridge)}, disagree"
        )
    apart = abs(tempered.log_evidence - quoted.log_evidence)
    if not apart <= max(DISAGREEMENT * tempered.error, TEMPERED_TOLERANCE):
        failed.append(
            f"log evidence by importance sampling, {_plus_minus(quoted)}, and by the tempered "
            f"start, {_plus_minus(tempered)}, disagree"
        )
    failed.extend(_regions_amiss(sampled))
    if sampled.n_failed > NEGLIGIBLE_FAILURES * sampled.n_evaluations:
        failed.append(
            f"the model gave NaN at {sampled.n_failed} of {sampled.n_evaluations} evaluations; "
            "they count as likelihood zero"
        )
    return failed


def _regions_amiss(sampled: Sampled) -> list[str]:
    """Regions that a part of the sampling did not see."""
    failed: list[str] = []
    regions, shares = sampled.regions, sampled.region_shares
    if regions.n_regions == 1:
        return failed
    of_starts = [regions.shares(start.positions) for start in sampled.starts]
    of_chains = regions.shares(np.concatenate([e.draws for e in sampled.ensembles]))
    for region in np.flatnonzero(shares > SMALL_SHARE):
        missed = sum(start[region] == 0 for start in of_starts)
        if missed:
            failed.append(
                f"a region with {100 * shares[region]:.1f} % of the posterior was missed by "
                f"{missed} of {len(of_starts)} tempered starts; there may be others"
            )
        if of_chains[region] == 0:
            failed.append(
                f"a region with {100 * shares[region]:.1f} % of the posterior was never visited "
                "by the chains"
            )
    return failed


def _plus_minus(estimate: Estimate) -> str:
    return f"{estimate.log_evidence:.3f} ± {estimate.error:.3f}"


def _seed_of(name: str, seed: int) -> np.random.SeedSequence:
    """A seed of its own for every model class, whatever others are sampled beside it."""
    digest = hashlib.sha256(name.encode()).digest()
    return np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little")])


def _evidence(sampled: Sampled) -> Evidence:
    quoted = sampled.evidence
    return Evidence(
        log_evidence=quoted.log_evidence,
        error=quoted.error,
        effective_sample_size=sampled.importance.effective_sample_size,
        n_draws=len(sampled.importance.z),
        bridge=sampled.bridge,
        tempered=sampled.tempered,
        laplace=sampled.maxima.log_evidence,
        mean_log_likelihood=sampled.importance.log_likelihood_mean,
    )


def _corrected_draws(sampled: Sampled, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draws (n_chains, n_steps, d) and their log-likelihoods, with the regions' right shares.

    Chains visit far-apart regions in shares that are too noisy; where there are several, the
    draws are resampled to the shares that importance sampling gives.
    """
    n = min(ensemble.n_steps for ensemble in sampled.ensembles)
    z = np.concatenate([e.positions[-n:] for e in sampled.ensembles], axis=1).transpose(1, 0, 2)
    densities = np.concatenate([e.log_posteriors[-n:] for e in sampled.ensembles], axis=1).T
    if sampled.regions.n_regions > 1:
        flat = z.reshape(-1, z.shape[-1])
        label = sampled.regions.assign(flat)
        counts = np.bincount(label, minlength=sampled.regions.n_regions)
        weights = (sampled.region_shares / np.maximum(counts, 1))[label]
        ladder = (np.arange(len(flat)) + rng.random()) / len(flat)
        cumulative = np.cumsum(weights)
        chosen = rng.permutation(np.searchsorted(cumulative / cumulative[-1], ladder))
        z = flat[chosen].reshape(z.shape)
        densities = densities.reshape(-1)[chosen].reshape(densities.shape)
    prior = -0.5 * (np.einsum("csd,csd->cs", z, z) + z.shape[-1] * math.log(2.0 * math.pi))
    return z, densities - prior


def _regions(sampled: Sampled, z: FloatArray, values: FloatArray) -> tuple[Region, ...]:
    regions = sampled.regions
    shares, errors = sampled.region_shares, sampled.region_errors
    of_starts = np.array([regions.shares(start.positions) for start in sampled.starts])
    labels = regions.assign(z.reshape(-1, z.shape[-1]))
    flat = values.reshape(-1, values.shape[-1])
    records: Sequence[Region] = [
        Region(
            share=float(shares[k]),
            error=float(errors[k]),
            shares_of_starts=tuple(float(share) for share in of_starts[:, k]),
            mean=tuple(float(mean) for mean in flat[labels == k].mean(0)),
        )
        for k in range(regions.n_regions)
        if np.any(labels == k)
    ]
    return tuple(sorted(records, key=lambda region: -region.share))
