"""Compression of the prior: particles climb through levels of the likelihood.

Particles from the prior are ranked by likelihood. A quarter survives; the others are set aside,
each with its share of the prior's mass. Copies of the survivors are moved by emcee's ensemble
moves under the prior above the level that the others did not pass, and so on, until what is left
of the prior is too little to matter. This is nested sampling, level by level instead of particle
by particle (Skilling 2006; Salomone et al. 2018), or subset simulation (Au and Beck 2001).

Only the order of the likelihoods counts. Unlike powers of the likelihood, levels pass from a broad
region to a narrow one however much higher the narrow one is, and reach likelihoods that are
positive in a tiny part of the prior alone. Equal likelihoods are ranked by a number drawn for each
particle, so that every level keeps the same share of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.ensembles import Walkers
from bayes_ssi.sampling.estimates import EvidenceEstimate
from bayes_ssi.sampling.maxima import Maxima
from bayes_ssi.sampling.mixture import LIGHT_TAILS, Proposal, StudentMixture
from bayes_ssi.sampling.mixture_fitting import fit_mixture
from bayes_ssi.sampling.resampling import systematic_indices
from bayes_ssi.sampling.target import Target, log_standard_normal

# Share of the particles that survives a level: for a given error, from 0.1 to 0.3 takes the fewest
# evaluations (Zuev, Beck, Au and Katafygiotis 2012).
SURVIVING = 0.25
# Compression ends where the largest likelihood, in all the prior left, would add no more than this
# share of the evidence: little beside the error of the estimate.
NEGLIGIBLE = 1e-2
# And where all particles are within this many nats of the highest: the prior left around the top of
# a broad region is so small that particles come upon a narrow one on its slope.
TOP = 0.2
# Where most of the prior is impossible, at most this many draws are made for each particle.
MOST_DRAWN = 500
# Proposals for one half of the possible draws are fitted to the other: enough for a covariance.
FEWEST_POSSIBLE_PER_DIMENSION = 2
# Moves go on until positions and ranks have lost half of their correlation with where they began,
# or no more of it is lost.
CORRELATION_LEFT = 0.5
MAX_STEPS = 25
# Particles per dimension that one component of the proposals' mixture is fitted to.
FITTED_PER_DIMENSION = 30
# Families of particles that became smaller than this share are mixed and parted again.
LEAST_FAMILY = 0.25
# Shares of the maxima's components and of the prior in the proposals.
MAXIMA_SHARE, PRIOR_SHARE = 0.3, 0.02


@dataclass(frozen=True, eq=False)
class Compression:
    """What one compression of the prior made.

    Attributes:
        positions: (n_particles, d), distributed as the posterior, in standard-normal coordinates.
        log_likelihoods: (n_particles,).
        passed: (m, d), all particles on the way, at their levels.
        log_likelihoods_passed: (m,).
        log_evidence: the sum of likelihood times prior mass.
        log_evidence_error: its standard error, from the chance by which particles survive and the
            correlation left between levels.
    """

    positions: FloatArray
    log_likelihoods: FloatArray
    passed: FloatArray
    log_likelihoods_passed: FloatArray
    log_evidence: float
    log_evidence_error: float

    @property
    def draws(self) -> FloatArray:
        return self.positions

    @cached_property
    def log_posteriors(self) -> FloatArray:
        """Likelihood times prior density, (n_particles,)."""
        return self.log_likelihoods + log_standard_normal(self.positions)

    def walkers(self, n: int, rng: np.random.Generator) -> Walkers:
        """``n`` of the particles at random, with repetition only where there are fewer."""
        chosen = rng.choice(len(self.positions), n, replace=len(self.positions) < n)
        return Walkers(self.positions[chosen], self.log_posteriors[chosen])


@dataclass(frozen=True, eq=False)
class _Level:
    """Particles that did not pass a level, or the last ones.

    Attributes:
        positions: (m, d).
        log_likelihoods: (m,).
        log_mass: of the prior, that each of them stands for.
        memory: by how much correlation with earlier levels multiplies variances.
    """

    positions: FloatArray
    log_likelihoods: FloatArray
    log_mass: float
    memory: float


def compress_prior(
    target: Target,
    n_particles: int,
    maxima: Maxima,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] = lambda _: None,
) -> Compression:
    """Carry ``n_particles`` from the prior to the highest likelihood.

    Args:
        target: what is sampled.
        n_particles: at least :data:`~bayes_ssi.sampling.settings.LEAST_PER_DIMENSION` times the
            number of dimensions.
        maxima: the known maxima of the posterior; proposals around them keep the shares of
            separate regions right.
        seed: everything random follows from it.
        progress: called with the share of the known maximum's level that is reached.

    Raises:
        ValueError: the likelihood is positive at hardly any draw from the prior.
    """
    rng = np.random.default_rng(seed)
    n_surviving = max(2, round(SURVIVING * n_particles))
    positions, log_likelihoods, possible = _possible(target, n_particles, n_surviving, rng)
    log_prior_left, memory, log_evidence = math.log(possible), 1.0, -math.inf
    variance = (1.0 - possible) / len(positions)
    if possible < 1.0:
        families = np.arange(len(positions)) % 2
        positions, log_likelihoods, families, left = _moved(
            target, maxima, positions, log_likelihoods, families, (-math.inf, 1.0), n_particles, rng
        )
        memory = _memory(left)
    else:
        families = np.arange(n_particles) % 2
    ranks_of_equals = rng.random(n_particles)
    highest = float((maxima.log_posteriors - log_standard_normal(maxima.z)).max())
    levels: list[_Level] = []
    most_levels = levels_left = _levels_to_top(target.n_dimensions)
    while True:
        log_mass = log_prior_left - math.log(n_particles)
        highest = max(highest, float(log_likelihoods.max()))
        if highest + log_prior_left < log_evidence + math.log(NEGLIGIBLE):
            levels_left -= 1
        if levels_left < 0 or (levels_left < most_levels and np.ptp(log_likelihoods) < TOP):
            levels.append(_Level(positions, log_likelihoods, log_mass, memory))
            break
        order = np.lexsort((ranks_of_equals, log_likelihoods))
        lost, kept = order[:-n_surviving], order[-n_surviving:]
        levels.append(_Level(positions[lost], log_likelihoods[lost], log_mass, memory))
        added = log_mass + float(logsumexp(log_likelihoods[lost]))
        log_evidence = float(np.logaddexp(log_evidence, added))
        log_prior_left += math.log(n_surviving / n_particles)
        level = (float(log_likelihoods[lost[-1]]), float(ranks_of_equals[lost[-1]]))
        positions, log_likelihoods, families, left = _moved(
            target,
            maxima,
            positions[kept],
            log_likelihoods[kept],
            families[kept],
            level,
            n_particles,
            rng,
        )
        memory = _memory(left)
        # Given that it is above the level, the number drawn for a particle is uniform.
        least = np.where(log_likelihoods == level[0], level[1], 0.0)
        ranks_of_equals = least + (1.0 - least) * rng.random(n_particles)
        progress(_progress(log_evidence, highest + log_prior_left))
    progress(1.0)
    return _compression(levels, n_particles, variance, rng)


def _possible(
    target: Target, n: int, least: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, float]:
    """Draws from the prior and their log-likelihoods, and the share of the prior they stand for.

    ``n`` draws, or if the likelihood is positive at fewer than ``least`` of them those of many
    more at which it is.
    """
    d = target.n_dimensions
    positions = rng.standard_normal((n, d))
    values = target.log_likelihood(positions)
    if np.isfinite(values).sum() >= least:
        return positions, values, 1.0
    n_drawn = n
    enough = FEWEST_POSSIBLE_PER_DIMENSION * (d + 1)
    positions, values = positions[np.isfinite(values)], values[np.isfinite(values)]
    while len(values) < enough:
        if n_drawn >= MOST_DRAWN * n:
            raise ValueError(
                f"the likelihood is positive at {len(values)} of {n_drawn} draws from the prior, "
                "too few to sample from; are the priors, the pairing and the units those of the "
                "data?"
            )
        drawn = rng.standard_normal((n, d))
        of_drawn = target.log_likelihood(drawn)
        n_drawn += n
        positions = np.concatenate([positions, drawn[np.isfinite(of_drawn)]])
        values = np.concatenate([values, of_drawn[np.isfinite(of_drawn)]])
    return positions, values, len(values) / n_drawn


def _levels_to_top(n_dimensions: int) -> int:
    """How many levels lead from the bulk of a normal density to its top.

    The likelihood falls by about half of d nats from the top to the bulk, and the mass of a ball
    within TOP nats of the top is smaller by the ratio of these to the power of d / 2.
    """
    ratio = max(0.5 * n_dimensions / TOP, 1.0)
    return math.ceil(0.5 * n_dimensions * math.log(ratio) / -math.log(SURVIVING))


def _memory(left: float) -> float:
    """By how much a correlation with the survivors that they copy multiplies variances.

    Copies of one particle, each with that correlation with it, have its square among themselves.
    """
    return 1.0 + (1.0 / SURVIVING - 1.0) * left**2


def _progress(log_evidence: float, log_evidence_left: float) -> float:
    """The completed share of the way from as much evidence left as collected, to a negligible."""
    return float(np.clip((log_evidence - log_evidence_left) / -math.log(NEGLIGIBLE), 0.0, 1.0))


def _moved(
    target: Target,
    maxima: Maxima,
    positions: FloatArray,
    log_likelihoods: FloatArray,
    families: NDArray[np.intp],
    level: tuple[float, float],
    n_particles: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, NDArray[np.intp], float]:
    """Copies of survivors, moved under the prior above a level.

    Proposals fitted to the very particles that they move, or to their relatives, would hold them
    together: there are two families, and those of each are fitted to the other.

    Args:
        target: what is sampled.
        maxima: the known maxima.
        positions: (m, d), the survivors.
        log_likelihoods: (m,).
        families: (m,), 0 or 1.
        level: a log-likelihood and a rank of equals.
        n_particles: number of copies.
        rng: everything random follows from it.

    Returns:
        Positions, log-likelihoods, families and the correlation left with where they began.
    """

    def log_density(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = target.log_likelihood(z)
        above = (values > level[0]) | ((values == level[0]) & (rng.random(len(z)) > level[1]))
        return np.where(above, log_standard_normal(z), -np.inf), values

    around_maxima = maxima.above(level[0])
    if np.bincount(families, minlength=2).min() < LEAST_FAMILY * len(families):
        families = rng.permutation(np.arange(len(families)) % 2)
    copies = np.resize(rng.permutation(len(positions)), n_particles)
    # The second family's proposals are fitted to where the first has moved: one after the other,
    # as in emcee's own moves, leaves their joint distribution as it should be.
    others, moved = positions[families == 1], []
    for family in (0, 1):
        own = copies[families[copies] == family]
        proposal = _proposal(others, around_maxima, rng)
        moved.append(_move(log_density, positions[own], log_likelihoods[own], proposal, rng))
        others = moved[0][0]
    at, values, left = zip(*moved, strict=True)
    return np.concatenate(at), np.concatenate(values), np.repeat((0, 1), [*map(len, at)]), max(left)


def _proposal(
    others: FloatArray, around_maxima: StudentMixture | None, rng: np.random.Generator
) -> Proposal:
    """Proposals fitted to other particles (n, d), and around the maxima."""
    n, d = others.shape
    mixture = fit_mixture(others, max(1, n // (FITTED_PER_DIMENSION * d)), LIGHT_TAILS, rng)
    if around_maxima is not None:
        mixture = mixture.mixed_with(around_maxima, MAXIMA_SHARE)
    # Few particles may all be copies of one, to which no mixture can be fitted.
    differ = bool(np.ptp(others, axis=0).any())
    return Proposal(mixture.with_prior_component(PRIOR_SHARE), 0.7 if differ else 0.0)


def _move(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    positions: FloatArray,
    log_likelihoods: FloatArray,
    proposal: Proposal,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, float]:
    """Positions (n, d), log-likelihoods (n,) and the correlation left after moves."""
    from bayes_ssi.sampling.moves import ensemble_sampler, initial_state

    n, d = positions.shape
    sampler = ensemble_sampler(log_density, n, d, proposal)
    ranks = _ranks(log_likelihoods, rng)
    start = initial_state(positions, log_standard_normal(positions), log_likelihoods, rng)
    left = 1.0
    states = sampler.sample(start, iterations=MAX_STEPS, store=False, skip_initial_state_check=True)
    for made, state in enumerate(states, start=1):
        before, left = (
            left,
            max(
                _correlation(positions, state.coords),
                _correlation(ranks, _ranks(state.blobs, rng)),
            ),
        )
        if made >= 2 and left < CORRELATION_LEFT:
            break
        # Between separate regions nothing may move: then the correlation settles above the mark.
        if made >= 8 and before - left < 0.002:
            break
    return np.array(state.coords), np.array(state.blobs), float(np.clip(left, 0.0, 0.9))


def _ranks(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Ranks (n, 1), those of equals at random, whose correlation far-off values do not decide."""
    ranks = np.empty((len(values), 1))
    ranks[np.lexsort((rng.random(len(values)), values)), 0] = np.arange(len(values))
    return ranks


def _correlation(before: FloatArray, after: FloatArray) -> float:
    """The mean over dimensions of the correlation between positions before and after.

    One where all positions are the same.
    """
    a, b = before - before.mean(0), after - after.mean(0)
    spreads = np.sqrt((a * a).sum(0) * (b * b).sum(0))
    return float(np.mean(np.where(spreads > 0, (a * b).sum(0) / np.maximum(spreads, 1e-300), 1.0)))


def _compression(
    levels: Sequence[_Level], n_particles: int, variance: float, rng: np.random.Generator
) -> Compression:
    """Posterior particles and the evidence from all levels.

    ``variance`` is that of the log evidence that came before them.
    """
    passed = np.concatenate([level.positions for level in levels])
    log_likelihoods = np.concatenate([level.log_likelihoods for level in levels])
    log_terms = [level.log_likelihoods + level.log_mass for level in levels]
    log_evidence = float(logsumexp(np.concatenate(log_terms)))
    weights = [np.exp(terms - log_evidence) for terms in log_terms]
    beyond = 1.0
    for level, of_level in zip(levels, weights, strict=True):
        # Among n particles, the number that survives varies, and with it all evidence beyond.
        each = np.zeros(n_particles)
        each[: len(of_level)] = of_level
        beyond -= float(of_level.sum())
        each[len(of_level) :] = max(beyond, 0.0) / max(n_particles - len(of_level), 1)
        variance += level.memory * n_particles * float(each.var(ddof=1))
    chosen = systematic_indices(np.concatenate(weights), n_particles, rng)
    return Compression(
        passed[chosen],
        log_likelihoods[chosen],
        passed,
        log_likelihoods,
        log_evidence,
        math.sqrt(variance),
    )


def compression_estimate(compressions: Sequence[Compression]) -> EvidenceEstimate:
    """The compressions' evidence, averaged, with the larger of its two errors.

    One error follows from the particles of every level and leaves out what the levels share; the
    other is the scatter of the compressions.
    """
    each = np.array([compression.log_evidence for compression in compressions])
    log_evidence = float(logsumexp(each) - np.log(len(each)))
    by_levels = math.sqrt(sum(c.log_evidence_error**2 for c in compressions)) / len(each)
    by_scatter = float(each.std(ddof=1)) / math.sqrt(len(each))
    return EvidenceEstimate("compression of the prior", log_evidence, max(by_levels, by_scatter))
