"""The posterior of one model class: draws, summaries, evidence, and what was checked."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from time import perf_counter

import numpy as np

from bayes_ssi.evaluation.journal import Journal
from bayes_ssi.evaluation.workers import Workers, as_workers
from bayes_ssi.identification.inferred_pairing import InferredPairing
from bayes_ssi.model_class.configuration import only_one
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.priors import FloatArray
from bayes_ssi.sampling.engine import sample_target
from bayes_ssi.sampling.evidence import Estimate
from bayes_ssi.sampling.production import effective_sample_size, r_hat
from bayes_ssi.sampling.sampled import Progress, Sampled, SamplingSettings
from bayes_ssi.sampling.target import Target
from bayes_ssi.updating.checks import failed_checks, failed_edge_checks
from bayes_ssi.updating.configuration_modes import ConfigurationModes, configuration_modes
from bayes_ssi.updating.datum_terms import AtDraws, DatumTerms, at_draws, datum_terms

__all__ = ["Evidence", "ParameterSummary", "Posterior", "Region", "sample"]

# Failed evaluations in a smaller share than this lie in the far tails of a prior.
NEGLIGIBLE_FAILURES = 1e-3
# The final draws' frequencies are shared out to workers in so many parts.
PARTS_OF_DRAWS = 64


@dataclass(frozen=True)
class Evidence:
    """The log evidence of a model class in nats, and the estimates that check it.

    Attributes:
        log_evidence: by mixture importance sampling, the quoted value.
        error: its standard error.
        effective_sample_size: of the importance draws.
        pareto_k: shape of the tail of their weights; the error is to be trusted below 0.7.
        n_draws: number of importance draws.
        bridge: bridge sampling's estimate.
        repeat: an estimate by other means: the tempered starts', which is coarse, or on the
            economical path that of importance sampling done a second time.
        laplace: Laplace's approximation, summed over the maxima found; a quick look.
        mean_log_likelihood: posterior mean of the log-likelihood, how well the class fits.
    """

    log_evidence: float
    error: float
    effective_sample_size: float
    pareto_k: float
    n_draws: int
    bridge: Estimate
    repeat: Estimate
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
        n_searches: how many of the independent searches for maxima found one in it.
        shares_of_starts: share of each tempered start's particles.
        mean: posterior mean of every parameter within the region.
    """

    share: float
    error: float
    n_searches: int
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
        frequencies_hz: (n_chains, n_steps, n_modes), of the model at the draws; where there are
            several configurations, the modes of all of them in turn.
        effective_sample_sizes: (n_parameters,), of the draws.
        evidence: log evidence and its checks.
        regions: separate regions, the most probable first.
        maxima: (m, n_parameters), parameter values at the maxima of likelihood times prior
            density in standard-normal coordinates, the highest first.
        r_hat: the largest potential scale reduction of any parameter.
        autocorrelation_time: the longest, in steps.
        acceptance: share of proposals accepted.
        n_evaluations: of the log-likelihood, all steps together.
        n_searches: independent searches for maxima.
        seconds: wall-clock time.
        failed_checks: what should have agreed and did not, a sentence each.
        edge_checks: what the posterior leans on that is not data, a sentence each.
        data_digest: identifies the data whose density the evidence is.
        configurations: the model's modes and their pairing, configuration by configuration.
        relative_spreads: (n_parameters,), standard deviation of the posterior over that of the
            prior, both in standard-normal coordinates: 1 where the data say nothing.
        datum_terms: log-likelihoods and predictions datum by datum, for other packages; not read
            back from a stored result, whose files of draws hold them.
        remarks: what else a reader should know of how it was computed, a sentence each.
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
    n_searches: int
    seconds: float
    failed_checks: tuple[str, ...]
    edge_checks: tuple[str, ...]
    data_digest: str
    configurations: tuple[ConfigurationModes, ...]
    relative_spreads: FloatArray
    datum_terms: DatumTerms | None = None
    remarks: tuple[str, ...] = ()

    @property
    def configuration_names(self) -> tuple[str, ...]:
        return tuple(configuration.name for configuration in self.configurations)

    @property
    def pairing(self) -> Mapping[str, int]:
        """The pairing of a class with one configuration; ValueError otherwise."""
        return self._only.pairing

    @property
    def inferred_pairing(self) -> InferredPairing | None:
        """How probable pairings are, of a class with one configuration; ValueError otherwise."""
        return self._only.inferred_pairing

    @property
    def _only(self) -> ConfigurationModes:
        names = self.configuration_names
        return only_one(self.configurations, f"posterior of {self.name!r}", names)

    def configuration(self, name: str) -> tuple[ConfigurationModes, FloatArray]:
        """The modes of one configuration, and its part of ``frequencies_hz``.

        Raises:
            ValueError: no configuration has that name.
        """
        begin = 0
        for modes in self.configurations:
            if modes.name == name:
                return modes, self.frequencies_hz[..., begin : begin + modes.n_modes]
            begin += modes.n_modes
        raise ValueError(
            f"posterior of {self.name!r}: no configuration {name!r}; "
            f"choose from {', '.join(map(repr, self.configuration_names))}"
        )

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
    *,
    workers: int | Executor | Workers | None = None,
    journal: Journal | None = None,
) -> Posterior:
    """Sample the posterior of a model class and estimate its evidence.

    Args:
        model_class: what is sampled.
        seed: the result follows from it and from the class's name alone.
        settings: how precisely.
        progress: called with the name of a step and the share of it that is done.
        workers: where the model is evaluated; in this process if None. The result is the same.
        journal: of an earlier run with the same arguments that was stopped; its evaluations are
            used, and the new ones are added.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior, or the model cannot be
            evaluated by the workers, or is not that of the journal.
    """
    started = perf_counter()
    model_class.check_structure()
    n = len(model_class.parameters)
    with as_workers(workers) as pool:
        target = Target(model_class.log_likelihood_at, n, pool, journal)
        try:
            sampled = sample_target(target, _seed_of(model_class.name, seed), settings, progress)
        except np.linalg.LinAlgError:  # a ValueError, but no fault of the input's
            raise
        except ValueError as error:
            told = "".join(f"; {sentence}" for sentence in _failures(model_class, target))
            raise ValueError(f"model class {model_class.name!r}: {error}{told}") from error
        rng = np.random.default_rng(seed)
        z, log_likelihoods = _corrected_draws(sampled, rng)
        values = model_class.values(z.reshape(-1, n))
        found = _at_draws(model_class, values, pool)
    configurations = configuration_modes(model_class, values)
    values = values.reshape(z.shape)
    return Posterior(
        name=model_class.name,
        parameter_names=model_class.parameter_names,
        draws=values,
        log_likelihoods=log_likelihoods,
        frequencies_hz=found.frequencies_hz.reshape(*z.shape[:2], -1),
        effective_sample_sizes=effective_sample_size(sampled.draws),
        evidence=_evidence(sampled),
        regions=_regions(sampled, z, values),
        maxima=model_class.values(sampled.maxima.z),
        r_hat=float(r_hat(sampled.draws).max()),
        autocorrelation_time=max(float(e.autocorrelation_times.max()) for e in sampled.draws),
        acceptance=float(np.mean([e.acceptance for e in sampled.draws])),
        n_evaluations=sampled.n_evaluations,
        n_searches=sampled.discovery.n_searches,
        seconds=perf_counter() - started,
        failed_checks=(*failed_checks(sampled), *_failures(model_class, target)),
        edge_checks=tuple(failed_edge_checks(model_class, z.reshape(-1, n), found.frequencies_hz)),
        data_digest=model_class.data_digest,
        configurations=configurations,
        relative_spreads=z.reshape(-1, n).std(axis=0),
        datum_terms=datum_terms(
            model_class, found, [each.pairing for each in configurations], z.shape[:2], rng
        ),
    )


def _at_draws(model_class: ModelClass, values: FloatArray, pool: Workers | None) -> AtDraws:
    """The model at ``values`` (n, n_parameters)."""
    # A draw is the one before it wherever a proposal was not accepted.
    different, which = np.unique(values, axis=0, return_inverse=True)
    if pool is None:
        found = at_draws(model_class, different)
    else:
        parts = np.array_split(different, min(PARTS_OF_DRAWS, len(different)))
        done = pool.call_each(partial(at_draws, model_class), parts)
        found = AtDraws(*(np.concatenate(arrays) for arrays in zip(*done, strict=True)))
    return AtDraws(*(array[which.ravel()] for array in found))


def _failures(model_class: ModelClass, target: Target) -> list[str]:
    """One sentence on where and why the model has no answer, unless that is hardly ever."""
    if target.n_failed <= NEGLIGIBLE_FAILURES * target.n_evaluations:
        return []
    first = target.failures[0]
    values = model_class.values(first.z[None])[0]
    each = zip(model_class.parameter_names, values, strict=True)
    where = ", ".join(f"{name} = {value:.6g}" for name, value in each)
    return [
        f"the model failed at {target.n_failed} of {target.n_evaluations} evaluations, which count "
        f"as likelihood zero; the first time at {where}: {first.reason}"
    ]


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
        pareto_k=sampled.importance.pareto_k,
        n_draws=len(sampled.importance.z),
        bridge=sampled.bridge,
        repeat=sampled.repeat,
        laplace=sampled.maxima.log_evidence,
        mean_log_likelihood=sampled.importance.log_likelihood_mean,
    )


def _corrected_draws(sampled: Sampled, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draws (n_chains, n_steps, d) and their log-likelihoods, with the regions' right shares.

    Chains visit far-apart regions in shares that are too noisy; where there are several, the
    draws are resampled to the shares that importance sampling gives.
    """
    n = min(ensemble.n_steps for ensemble in sampled.draws)
    z = np.concatenate([e.positions[-n:] for e in sampled.draws], axis=1).transpose(1, 0, 2)
    densities = np.concatenate([e.log_posteriors[-n:] for e in sampled.draws], axis=1).T
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
    of_starts = [regions.shares(start.positions) for start in sampled.starts]
    labels = regions.assign(z.reshape(-1, z.shape[-1]))
    flat = values.reshape(-1, values.shape[-1])
    records: Sequence[Region] = [
        Region(
            share=float(shares[k]),
            error=float(errors[k]),
            n_searches=int(sampled.searches_of_regions[k]),
            shares_of_starts=tuple(float(shares[k]) for shares in of_starts),
            mean=tuple(float(mean) for mean in flat[labels == k].mean(0)),
        )
        for k in range(regions.n_regions)
        if np.any(labels == k)
    ]
    return tuple(sorted(records, key=lambda region: -region.share))
