"""Compression of the prior: particles climb through levels of the likelihood.

Particles from the prior are ranked by likelihood. A quarter survives; the others are set aside,
each with its share of the prior's mass. Copies of the survivors are moved under the prior above the
level that the others did not pass, and so on, until what is left of the prior is too little to
matter. This is nested sampling, level by level instead of particle by particle (Skilling 2006;
Salomone et al. 2018), or subset simulation (Au and Beck 2001).

Only the order of the likelihoods counts. Unlike powers of the likelihood, levels pass from a broad
region to a narrow one however much higher the narrow one is, and reach likelihoods that are
positive in a tiny part of the prior alone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray, IntArray, systematic_indices
from bayes_ssi.inference.sampling.diagnostics import EvidenceEstimate
from bayes_ssi.inference.sampling.ensembles import Walkers
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.mixture import StudentMixture, fit_mixture, tails_within
from bayes_ssi.inference.sampling.proposals import begin, drawn_anew
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

# Share of the particles that survives a level: for a given error, from 0.1 to 0.3 takes the
# fewest evaluations (Zuev, Beck, Au and Katafygiotis 2012).
SURVIVING = 0.25
# Compression ends where the largest likelihood, in all the prior left, would add no more than
# this share of the evidence: little beside the error of the estimate.
NEGLIGIBLE_SHARE = 1e-2
# And where all particles are within this many nats of the highest: the prior left around the
# top of a broad region is so small that particles come upon a narrow one on its slope.
TOP = 0.2
# Where most of the prior is impossible, at most this many draws are made for each particle.
MOST_DRAWN = 500
# Moves go on until positions and ranks have lost half of their correlation with where they
# began, or no more of it is lost.
CORRELATION_LEFT = 0.5
MOST_MOVES = 25
# Particles per dimension that one component of the proposals' mixture is fitted to.
PARTICLES_PER_COMPONENT = 30
MAXIMA_SHARE, PRIOR_SHARE = 0.3, 0.02  # of the maxima's components and the prior in proposals


@dataclass(frozen=True, eq=False)
class Compression:
    """What one compression of the prior made."""

    # (n_particles, d), distributed as the posterior, in standard-normal coordinates.
    draws: FloatArray
    log_posteriors: FloatArray  # (n_particles,), likelihood times prior density
    log_evidence: float
    # Its standard error, from the chance by which particles survive and the correlation left
    # between levels.
    log_evidence_error: float
    behind: float  # by about how much it is too low, for particles that fell behind their levels

    def walkers(self, n: int, rng: np.random.Generator) -> Walkers:
        """``n`` of the particles at random, with repetition only where there are fewer."""
        chosen = rng.choice(len(self.draws), n, replace=len(self.draws) < n)
        return Walkers(self.draws[chosen], self.log_posteriors[chosen])


def compress_prior(
    target: Target,
    n_particles: int,
    maxima: Maxima,
    seeds: Sequence[np.random.SeedSequence],
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Compression, Compression]:
    """Carry two times ``n_particles`` from the prior to the highest likelihood.

    Moves proposed from the very particles that they move, or from copies of these, would favour
    some of them: the particles of each compression move with respect to those of the other, level
    by level in turn. Proposals around known maxima keep the shares of separate regions right.
    """
    climbs = [_Climb(target, maxima, n_particles, np.random.default_rng(seed)) for seed in seeds]
    highest = float((maxima.log_posteriors - log_standard_normal(maxima.z)).max())
    log_negligible = math.log(NEGLIGIBLE_SHARE)
    most_levels = levels_left = _levels_to_top(target.n_dimensions)
    while True:
        # The second with respect to where the first has moved.
        for climb, other in zip(climbs, reversed(climbs), strict=True):
            climb.move(other.positions)
        highest = max(highest, *(float(climb.log_likelihoods.max()) for climb in climbs))
        to_come = max(highest + climb.log_prior_left - climb.log_evidence for climb in climbs)
        if to_come < log_negligible:
            levels_left -= 1
        are_at_top = all(np.ptp(climb.log_likelihoods) < TOP for climb in climbs)
        if levels_left < 0 or (levels_left < most_levels and are_at_top):
            break
        for climb in climbs:
            climb.leave_lowest()
        # From as much evidence to come as collected, to a negligible share.
        progress(float(np.clip(to_come / log_negligible, 0.0, 1.0)))
    progress(1.0)
    return climbs[0].compression(), climbs[1].compression()


class _Left(NamedTuple):
    """Particles that did not pass a level, or the last ones."""

    positions: FloatArray  # (m, d)
    log_likelihoods: FloatArray  # (m,)
    log_mass: float  # of the prior, for each particle
    memory: float  # how many times the variance of independent particles theirs is
    behind: float  # by how many nats of the prior's mass they are behind their level


class _Climb:
    """The particles of one compression on their way.

    Their ``positions`` are (n, d); fewer, the survivors of a level, until they have moved.
    ``log_prior_left`` is the log of the prior's mass that they stand for.
    """

    def __init__(
        self, target: Target, maxima: Maxima, n_particles: int, rng: np.random.Generator
    ) -> None:
        self._target, self._maxima, self._n, self._rng = target, maxima, n_particles, rng
        self._n_surviving = max(2, round(SURVIVING * n_particles))
        drawn = _possible(target, n_particles, self._n_surviving, rng)
        self.positions, self.log_likelihoods, possible = drawn
        self.log_prior_left, self.log_evidence = math.log(possible), -math.inf
        self._variance = (1.0 - possible) / len(self.positions)
        self._memory, self._behind = 1.0, 0.0
        # Every level keeps the same share of particles with equal likelihoods.
        self._ranks_of_equals = rng.random(len(self.positions))
        self._left: list[_Left] = []
        # The log-likelihood, and the rank among equals, 0 to 1, above which particles are.
        # Particles that are not drawn from the prior are to be copied and moved.
        self._level: tuple[float, float] | None = (-math.inf, 1.0) if possible < 1.0 else None

    def leave_lowest(self) -> None:
        """Set the lowest particles aside, at a level that the survivors are above."""
        order = np.lexsort((self._ranks_of_equals, self.log_likelihoods))
        lost, kept = order[: -self._n_surviving], order[-self._n_surviving :]
        values = self.log_likelihoods[lost]
        self._left.append(self._as_left(lost))
        added = self._left[-1].log_mass + float(logsumexp(values))
        self.log_evidence = float(np.logaddexp(self.log_evidence, added))
        self.log_prior_left += math.log(self._n_surviving / self._n)
        self._level = float(values[-1]), float(self._ranks_of_equals[lost[-1]])
        self.positions, self.log_likelihoods = self.positions[kept], self.log_likelihoods[kept]

    def _as_left(self, chosen: IntArray) -> _Left:
        positions, values = self.positions[chosen], self.log_likelihoods[chosen]
        log_mass = self.log_prior_left - math.log(self._n)
        return _Left(positions, values, log_mass, self._memory, self._behind)

    def move(self, others: FloatArray) -> None:
        """Copy and move the survivors, if there was a level.

        Moves are proposed from ``others`` (m, d), independent particles at a similar level.
        """
        if self._level is None:
            return
        (level, rank), rng = self._level, self._rng

        def log_density(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            values = self._target.log_likelihood(z)
            above = values > level
            above |= (values == level) & (rng.random(len(z)) > rank)
            return np.where(above, log_standard_normal(z), -np.inf), values

        copies = np.resize(rng.permutation(len(self.positions)), self._n)
        positions, before = self.positions[copies], self.log_likelihoods[copies]
        mixture, ranks = self._proposals(others), _ranks(before, rng)
        # Few particles may all be copies of one, to which no mixture can be fitted.
        share = 0.7 if np.ptp(others, axis=0).any() else 0.0
        independence = drawn_anew(mixture, share, log_density, rng)
        values = log_standard_normal(positions), before
        sampler, start = begin(log_density, positions, values, independence, rng, others)
        left = 1.0
        states = sampler.sample(
            start, iterations=MOST_MOVES, store=False, skip_initial_state_check=True
        )
        for made, state in enumerate(states, start=1):
            last, of_ranks = left, _correlation(ranks, _ranks(state.blobs, rng))
            left = max(_correlation(positions, state.coords), of_ranks)
            # Between separate regions nothing may move: then it settles above the mark.
            if left < CORRELATION_LEFT or (made >= 7 and last - left < 0.002):
                break
        self.positions, self.log_likelihoods = np.array(state.coords), np.array(state.blobs)
        left = float(np.clip(left, 0.0, 0.9))
        # Copies of one particle, each with that correlation with it, have its square among
        # themselves.
        self._memory = 1.0 + (1.0 / SURVIVING - 1.0) * left**2
        # Moves leave survivors where they should be as they are. Where they raise them instead,
        # they would go on to do so while they are correlated with where they began.
        self._behind = _risen(before, self.log_likelihoods) * left / (1.0 - left)
        # Given that it is above the level, the number drawn for a particle is uniform.
        least = np.where(self.log_likelihoods == level, rank, 0.0)
        self._ranks_of_equals = least + (1.0 - least) * rng.random(self._n)

    def _proposals(self, others: FloatArray) -> StudentMixture:
        n, d = others.shape
        n_components = max(1, n // (PARTICLES_PER_COMPONENT * d))
        mixture = fit_mixture(others, n_components, tails_within(d), self._rng).widened()
        if len(self._maxima.z):
            mixture = mixture.mixed_with(self._maxima.as_mixture(), MAXIMA_SHARE)
        return mixture.with_prior_component(PRIOR_SHARE)

    def compression(self) -> Compression:
        """The posterior and the evidence, from all levels and the particles that are left."""
        n, variance, beyond, behind = self._n, self._variance, 1.0, 0.0
        levels = [*self._left, self._as_left(np.arange(n))]
        passed = np.concatenate([level.positions for level in levels])
        log_likelihoods = np.concatenate([level.log_likelihoods for level in levels])
        log_terms = [level.log_likelihoods + level.log_mass for level in levels]
        log_evidence = float(logsumexp(np.concatenate(log_terms)))
        weights = [np.exp(terms - log_evidence) for terms in log_terms]
        for level, level_weights in zip(levels, weights, strict=True):
            # Among n particles, the number that survives varies, and with it all evidence beyond.
            beyond -= float(level_weights.sum())
            shares = np.full(n, max(beyond, 0.0) / max(n - len(level_weights), 1))
            shares[: len(level_weights)] = level_weights
            variance += level.memory * n * float(shares.var(ddof=1))
            behind += max(beyond, 0.0) * level.behind
        chosen = systematic_indices(np.concatenate(weights), n, self._rng)
        return Compression(
            passed[chosen],
            log_likelihoods[chosen] + log_standard_normal(passed[chosen]),
            log_evidence,
            math.sqrt(variance),
            behind,
        )


def _possible(
    target: Target, n: int, least: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, float]:
    """Draws from the prior and their log-likelihoods, and the share of the prior they stand for.

    ``n`` draws, or if the likelihood is positive at fewer than ``least`` of them those of many
    more at which it is.
    """
    d, n_drawn = target.n_dimensions, 0
    positions, values = np.empty((0, d)), np.empty(0)
    enough = d + 1  # for a covariance, which proposals for the other particles are fitted with
    while len(values) < enough:
        if n_drawn >= MOST_DRAWN * n:
            raise ValueError(
                f"the likelihood is positive at {len(values)} of {n_drawn} draws from the prior, "
                "too few to sample from; are the priors, the pairing and the units those of the "
                "data?"
            )
        drawn = rng.standard_normal((n, d))
        drawn_values = target.log_likelihood(drawn)
        possible = np.isfinite(drawn_values)
        if n_drawn == 0 and possible.sum() >= least:
            return drawn, drawn_values, 1.0
        n_drawn += n
        positions = np.concatenate([positions, drawn[possible]])
        values = np.concatenate([values, drawn_values[possible]])
    return positions, values, len(values) / n_drawn


def _levels_to_top(n_dimensions: int) -> int:
    """How many levels lead from the bulk of a normal density to its top.

    The likelihood falls by about half of d nats from the top to the bulk, and the mass of a ball
    within ``TOP`` nats of the top is smaller by the ratio of these to the power of d / 2.
    """
    ratio = max(0.5 * n_dimensions / TOP, 1.0)
    return math.ceil(0.5 * n_dimensions * math.log(ratio) / -math.log(SURVIVING))


def _ranks(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Ranks (n, 1), those of equals at random, whose correlation far-off values do not decide."""
    ranks = np.empty((len(values), 1))
    ranks[np.lexsort((rng.random(len(values)), values)), 0] = np.arange(len(values))
    return ranks


def _risen(before: FloatArray, after: FloatArray) -> float:
    """By how many nats of the prior's mass particles (n,) have risen from others (n,).

    Of n particles above a level, a share e^-x is above the rest by x nats; the log of the rank from
    the top falls by as much as they rise.
    """
    from scipy.stats import rankdata  # takes long to import, but arviz does so anyway

    log_ranks = np.log(rankdata(-np.concatenate([before, after])))
    return float(log_ranks[: len(before)].mean() - log_ranks[len(before) :].mean())


def _correlation(before: FloatArray, after: FloatArray) -> float:
    """The mean over dimensions of the correlation between positions before and after.

    One where all positions are the same.
    """
    a, b = before - before.mean(0), after - after.mean(0)
    spreads = np.sqrt((a * a).sum(0) * (b * b).sum(0))
    # Copies are equal to the last digit, but their mean may be rounded.
    differ = np.ptp(before, axis=0) * np.ptp(after, axis=0) > 0
    return float(np.mean(np.where(differ, (a * b).sum(0) / np.maximum(spreads, 1e-300), 1.0)))


def compression_estimate(compressions: Sequence[Compression]) -> EvidenceEstimate:
    """The compressions' evidence, averaged, with the larger of its two errors.

    One error follows from the particles of every level and leaves out what the levels share; the
    other is the scatter of the compressions. What both of them are behind is added.
    """
    n, log_evidences = len(compressions), np.array([c.log_evidence for c in compressions])
    log_evidence = float(logsumexp(log_evidences) - np.log(n))
    by_levels = math.sqrt(sum(c.log_evidence_error**2 for c in compressions)) / n
    by_scatter = float(log_evidences.std(ddof=1)) / math.sqrt(n)
    behind = float(np.mean([c.behind for c in compressions]))
    error = math.hypot(max(by_levels, by_scatter), behind)
    return EvidenceEstimate("compression of the prior", log_evidence, error)
