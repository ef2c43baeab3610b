"""The tempered start: particles carried from the prior to the posterior.

Sequential Monte Carlo through p_β ∝ likelihood^β · prior with 0 = β_0 < … < β_m = 1: each step
is chosen for an effective sample size of one half, then the particles are resampled and moved by
emcee's ensemble moves. The weights give a first log evidence (Del Moral, Doucet and Jasra 2006).

Proposals around the known maxima of the posterior, widened to each temperature, keep the shares
of separate regions right on the way: a region that holds few particles would otherwise be lost by
chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.ensembles import Walkers
from bayes_ssi.sampling.estimates import EvidenceEstimate
from bayes_ssi.sampling.maxima import Maxima
from bayes_ssi.sampling.mixture import HEAVY_TAILS, Proposal
from bayes_ssi.sampling.mixture_fitting import fit_mixture
from bayes_ssi.sampling.resampling import systematic_indices
from bayes_ssi.sampling.target import Target, log_standard_normal

# Moves go on until positions have lost about two thirds of their correlation with where they
# began, or no more of it is lost.
CORRELATION_LEFT = 0.35
MAX_STEPS = 25
# Each stage gains about ln 2 nats of information: enough for 350.
MAX_STAGES = 500
# Where most of the prior is impossible, at most this many draws are made for each particle.
MOST_REDRAWN = 50
# Particles per dimension that one component of the proposals' mixture is fitted to. Fitted too
# closely to the very particles that it moves, a mixture keeps them where they are, and the
# evidence comes out too low.
PARTICLES_PER_DIMENSION = 120
# Share of the maxima's components in the proposals.
MAXIMA_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class TemperedStart:
    """Particles distributed as the posterior, and a first estimate of the evidence.

    Attributes:
        positions: (n_particles, d), in standard-normal coordinates.
        log_likelihoods: (n_particles,).
        log_evidence: estimate by the product of mean weights.
        log_evidence_error: its standard error, from the spread of the weights of each stage and
            the correlation left between stages.
    """

    positions: FloatArray
    log_likelihoods: FloatArray
    log_evidence: float
    log_evidence_error: float

    def walkers(self, n: int, rng: np.random.Generator) -> Walkers:
        """``n`` of the particles at random, with repetition only where there are fewer."""
        chosen = rng.choice(len(self.positions), n, replace=len(self.positions) < n)
        positions = self.positions[chosen]
        return Walkers(positions, self.log_likelihoods[chosen] + log_standard_normal(positions))


def tempered_start(
    target: Target,
    n_particles: int,
    maxima: Maxima,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] = lambda _: None,
) -> TemperedStart:
    """Carry ``n_particles`` from the prior to the posterior.

    Args:
        target: what is sampled.
        n_particles: at least twice the number of dimensions.
        maxima: the known maxima of the posterior.
        seed: everything random follows from it.
        progress: called with β after each stage.

    Raises:
        ValueError: the likelihood is zero at every particle, or β does not reach 1.
    """
    rng = np.random.default_rng(seed)
    positions, log_likelihoods, n_drawn = _possible_particles(target, n_particles, rng)
    beta, n_stages = 0.0, 0
    log_evidence, left = np.log(n_particles / n_drawn), 0.0
    relative_variance = (1.0 - n_particles / n_drawn) / n_particles
    while beta < 1.0:
        if n_stages == MAX_STAGES:
            raise ValueError(f"the tempered start did not reach β = 1 in {MAX_STAGES} stages")
        n_stages += 1
        increment = _next_increment(log_likelihoods, beta)
        log_weights = increment * log_likelihoods
        log_total = float(logsumexp(log_weights))
        log_evidence += log_total - np.log(n_particles)
        weights = np.exp(log_weights - log_total)
        # Particles that remember the last stage count for less than as many independent ones.
        memory = (1.0 + left) / (1.0 - left)
        spread = float(np.sum(weights**2)) - 1.0 / n_particles
        relative_variance += memory * max(0.0, spread)  # equal weights round to below zero
        chosen = systematic_indices(weights, n_particles, rng)
        beta = 1.0 if beta + increment >= 1.0 - 1e-12 else beta + increment
        positions, log_likelihoods, left = _move(
            target, maxima, positions[chosen], log_likelihoods[chosen], beta, rng
        )
        progress(beta)
    return TemperedStart(
        positions, log_likelihoods, log_evidence, float(np.sqrt(relative_variance))
    )


def _possible_particles(
    target: Target, n: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, float]:
    """``n`` draws from the possible part of the prior, and the number of prior draws they took."""
    positions, log_likelihoods, n_drawn = np.empty((0, target.n_dimensions)), np.empty(0), 0
    while len(positions) < n and n_drawn < MOST_REDRAWN * n:
        drawn = rng.standard_normal((n, target.n_dimensions))
        values = target.log_likelihood(drawn)
        n_drawn += n
        possible = np.isfinite(values)
        positions = np.concatenate([positions, drawn[possible]])
        log_likelihoods = np.concatenate([log_likelihoods, values[possible]])
    n_possible = len(positions)
    if not n_possible:
        raise ValueError(f"the likelihood is zero at all of {n_drawn} draws from the prior")
    # If there are too few, some of them stand for two particles.
    chosen = rng.permutation(n_possible)[:n]
    if n_possible < n:
        chosen = rng.integers(n_possible, size=n)
    return positions[chosen], log_likelihoods[chosen], n_drawn * n / n_possible


def _next_increment(log_likelihoods: FloatArray, beta: float) -> float:
    """The step in β that halves the effective sample size, by bisection."""
    relative = log_likelihoods - log_likelihoods.max()

    def effective(step: float) -> float:
        weights = np.exp(step * relative)
        return float(weights.sum() ** 2 / (weights**2).sum())

    wanted = 0.5 * len(relative)
    low, high = 0.0, 1.0 - beta
    if effective(high) >= wanted:
        return high
    while np.nextafter(low, high) < high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= wanted else (low, middle)
    return high


def _move(
    target: Target,
    maxima: Maxima,
    positions: FloatArray,
    log_likelihoods: FloatArray,
    beta: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, float]:
    """Move particles under p_β: positions, log-likelihoods and the correlation left."""
    from bayes_ssi.sampling.moves import ensemble_sampler, initial_state

    def log_density(z: FloatArray) -> FloatArray:
        return beta * target.log_likelihood(z) + log_standard_normal(z)

    n, d = positions.shape
    n_components = max(1, n // (PARTICLES_PER_DIMENSION * d))
    mixture = fit_mixture(positions, n_components, HEAVY_TAILS, rng)
    mixture = mixture.mixed_with(maxima.as_mixture(beta), MAXIMA_SHARE).with_prior_component()
    sampler = ensemble_sampler(log_density, n, d, Proposal(mixture))
    density = beta * log_likelihoods + log_standard_normal(positions)
    start = initial_state(positions, density, rng)
    left = 1.0
    states = sampler.sample(start, iterations=MAX_STEPS, store=False, skip_initial_state_check=True)
    for made, state in enumerate(states, start=1):
        log_now = (state.log_prob - log_standard_normal(state.coords)) / beta
        before, left = (
            left,
            max(
                _correlation(positions, state.coords),
                _correlation(_ranks(log_likelihoods)[:, None], _ranks(log_now)[:, None]),
            ),
        )
        if made >= 2 and left < CORRELATION_LEFT:
            break
        # Between separate regions nothing may move: then the correlation settles above the mark.
        if made >= 8 and before - left < 0.002:
            break
    return np.array(state.coords), log_now, float(np.clip(left, 0.0, 0.9))


def _ranks(values: FloatArray) -> FloatArray:
    """Ranks, whose correlation does not depend on a few far-off values."""
    ranks = np.empty(len(values))
    ranks[np.argsort(values)] = np.arange(len(values))
    return ranks


def _correlation(before: FloatArray, after: FloatArray) -> float:
    """The mean over dimensions of the correlation between positions before and after."""
    a, b = before - before.mean(0), after - after.mean(0)
    return float(np.mean((a * b).sum(0) / np.sqrt((a * a).sum(0) * (b * b).sum(0))))


def tempered_estimate(starts: Sequence[TemperedStart]) -> EvidenceEstimate:
    """The tempered starts' evidence, averaged, with the larger of its two errors.

    One error follows from the weights of every stage and leaves out what the stages share; the
    other is the scatter of the starts.
    """
    each = np.array([start.log_evidence for start in starts])
    log_evidence = float(logsumexp(each) - np.log(len(each)))
    by_weights = np.sqrt(sum(s.log_evidence_error**2 for s in starts)) / len(starts)
    by_scatter = float(each.std(ddof=1)) / np.sqrt(len(each))
    error = float(max(by_weights, by_scatter))
    # The estimate is coarse: differences from it of less than one nat mean nothing.
    return EvidenceEstimate("tempered starts", log_evidence, error, tolerance=1.0)
