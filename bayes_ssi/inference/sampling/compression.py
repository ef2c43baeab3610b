"""Compression of the prior: particles climb through levels of the likelihood.

Particles from the prior are ranked by likelihood. A quarter survives; the others are set aside,
each with its share of the prior's mass. Copies of the survivors are moved under the prior above the
level that the others did not pass, and so on, until what is left of the prior is too little to
matter. This is nested sampling, level by level instead of particle
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
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.ensembles import Walkers
from bayes_ssi.inference.sampling.estimates import EvidenceEstimate
from bayes_ssi.inference.sampling.level_moves import Level, LevelMoves
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.resampling import systematic_indices
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

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


@dataclass(frozen=True, eq=False)
class Compression:
    """What one compression of the prior made.

    Attributes:
        positions: (n_particles, d), distributed as the posterior, in standard-normal coordinates.
        log_likelihoods: (n_particles,).
        passed: (m, d), all particles on the way, at their levels.
        log_likelihoods_passed: (m,).
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
    """

    positions: FloatArray
    log_likelihoods: FloatArray
    log_mass: float
    memory: float


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
    by level in turn. Given those, they are distributed as if they were alone.

    Args:
        n_particles: in each compression; at least
            :data:`~bayes_ssi.inference.sampling.settings.LEAST_PER_DIMENSION` times the number of
            dimensions.
        maxima: the known maxima of the posterior; proposals around them keep the shares of
            separate regions right.
    """
    moves = LevelMoves(target, maxima)
    climbs = [_Climb(target, n_particles, np.random.default_rng(seed)) for seed in seeds]
    _move_in_turn(climbs, moves)
    highest = float((maxima.log_posteriors - log_standard_normal(maxima.z)).max())
    most_levels = levels_left = _levels_to_top(target.n_dimensions)
    while True:
        highest = max(highest, *(float(climb.log_likelihoods.max()) for climb in climbs))
        to_come = max(highest + climb.log_prior_left - climb.log_evidence for climb in climbs)
        if to_come < math.log(NEGLIGIBLE):
            levels_left -= 1
        are_at_top = all(np.ptp(climb.log_likelihoods) < TOP for climb in climbs)
        if levels_left < 0 or (levels_left < most_levels and are_at_top):
            break
        for climb in climbs:
            climb.leave_lowest()
        _move_in_turn(climbs, moves)
        # From as much evidence to come as collected, to a negligible share.
        progress(float(np.clip(to_come / math.log(NEGLIGIBLE), 0.0, 1.0)))
    progress(1.0)
    return climbs[0].compression(), climbs[1].compression()


class _Climb:
    """The particles of one compression on their way.

    Attributes:
        positions: (n, d); survivors of a level until they have moved.
        log_likelihoods: (n,).
        log_prior_left: log of the prior's mass that the particles stand for.
    """

    def __init__(self, target: Target, n_particles: int, rng: np.random.Generator) -> None:
        self._n, self._rng = n_particles, rng
        self._n_surviving = max(2, round(SURVIVING * n_particles))
        drawn = _possible(target, n_particles, self._n_surviving, rng)
        self.positions, self.log_likelihoods, possible = drawn
        self.log_prior_left, self.log_evidence = math.log(possible), -math.inf
        self._variance = (1.0 - possible) / len(self.positions)
        self._memory = 1.0
        self._ranks_of_equals = rng.random(len(self.positions))
        self._levels: list[_Level] = []
        # Particles that are not drawn from the prior are to be copied and moved.
        self._level = Level(-math.inf, 1.0) if possible < 1.0 else None

    @property
    def _log_mass(self) -> float:
        return self.log_prior_left - math.log(self._n)

    def leave_lowest(self) -> None:
        """Set the lowest particles aside, at a level that the survivors are above."""
        order = np.lexsort((self._ranks_of_equals, self.log_likelihoods))
        lost, kept = order[: -self._n_surviving], order[-self._n_surviving :]
        values = self.log_likelihoods[lost]
        self._levels.append(_Level(self.positions[lost], values, self._log_mass, self._memory))
        added = self._log_mass + float(logsumexp(values))
        self.log_evidence = float(np.logaddexp(self.log_evidence, added))
        self.log_prior_left += math.log(self._n_surviving / self._n)
        self._level = Level(float(values[-1]), float(self._ranks_of_equals[lost[-1]]))
        self.positions, self.log_likelihoods = self.positions[kept], self.log_likelihoods[kept]

    def move(self, moves: LevelMoves, others: FloatArray) -> None:
        """Copy and move the survivors, if there was a level, proposing from ``others`` (m, d)."""
        if self._level is None:
            return
        copies = np.resize(self._rng.permutation(len(self.positions)), self._n)
        moved = moves.moved(
            self.positions[copies], self.log_likelihoods[copies], self._level, others, self._rng
        )
        self.positions, self.log_likelihoods, left = moved
        # Copies of one particle, each with that correlation with it, have its square among
        # themselves.
        self._memory = 1.0 + (1.0 / SURVIVING - 1.0) * left**2
        # Given that it is above the level, the number drawn for a particle is uniform.
        least = np.where(self.log_likelihoods == self._level.log_likelihood, self._level.rank, 0.0)
        self._ranks_of_equals = least + (1.0 - least) * self._rng.random(self._n)

    def compression(self) -> Compression:
        """The posterior and the evidence, the particles that are left included."""
        last = _Level(self.positions, self.log_likelihoods, self._log_mass, self._memory)
        return _compression([*self._levels, last], self._n, self._variance, self._rng)


def _move_in_turn(climbs: Sequence[_Climb], moves: LevelMoves) -> None:
    """Move both, the second with respect to where the first has moved.

    As in emcee's own moves, this leaves their joint distribution as it should be.
    """
    first, second = climbs
    first.move(moves, second.positions)
    second.move(moves, first.positions)


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
    enough = d + 1  # for a covariance, which proposals for the other particles are fitted with
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
