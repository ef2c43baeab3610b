"""Mixtures of Student-t distributions fitted to draws: proposals shaped like the posterior."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from bayes_ssi.arrays import FloatArray

# Degrees of freedom: the variance of importance weights stays finite where a posterior has tails
# as heavy as those of five; thirty are nearly normal.
HEAVY_TAILS, LIGHT_TAILS = 5.0, 30.0
# Weight of components added in case a mixture misses a part of the posterior: the importance
# weights of the other draws rise by a ninth at most.
DEFENSIVE_SHARE = 0.1
# More components must raise the mean log density of held-out draws by this much, in nats.
LEAST_GAIN = 0.01
# A component needs this many draws per dimension for a meaningful covariance.
DRAWS_PER_DIMENSION = 10
# Densities of more points than this are computed in parts, which stay in the processor's cache.
PART = 2048


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """K Student-t components in d dimensions, and a share of the standard normal prior.

    Attributes:
        weights: (K,), adding up to ``1 - prior_share``.
        means: (K, d).
        choleskys: (K, d, d), lower Cholesky factors of the scale matrices.
        dof: (K,), degrees of freedom.
        prior_share: weight of N(0, I), the defensive component: it bounds every importance
            weight by the greatest likelihood over ``prior_share``.
    """

    weights: FloatArray
    means: FloatArray
    choleskys: FloatArray
    dof: FloatArray
    prior_share: float = 0.0

    @property
    def n_components(self) -> int:
        """Student-t components; the defensive one does not count."""
        return len(self.weights)

    @cached_property
    def _whitening(self) -> tuple[FloatArray, FloatArray]:
        """All inverse Cholesky factors as one (K·d, d), and the whitened means (K·d, 1)."""
        inverses = np.linalg.inv(self.choleskys)
        factors: FloatArray = np.concatenate(inverses).astype(float, copy=False)
        return factors, np.einsum("kij,kj->ki", inverses, self.means).reshape(-1, 1)

    @cached_property
    def _log_constants(self) -> FloatArray:
        d, dof = self.means.shape[1], self.dof
        of_tails = gammaln((dof + d) / 2) - gammaln(dof / 2) - 0.5 * d * np.log(dof * math.pi)
        diagonals = np.diagonal(self.choleskys, axis1=1, axis2=2)
        return of_tails - np.log(diagonals).sum(1)

    def squared_distances(self, z: FloatArray) -> FloatArray:
        """Mahalanobis distances squared of ``z`` (n, d) from every component, (K, n)."""
        factors, means = self._whitening
        whitened = factors @ z.T
        whitened -= means
        whitened *= whitened
        squares: FloatArray = whitened.reshape(*self.means.shape, len(z)).sum(axis=1)
        return squares

    def log_components(self, squared_distances: FloatArray) -> FloatArray:
        """log(weight · density) of every Student-t component at these distances, (K, n)."""
        dof = self.dof[:, None]
        tails = np.log1p(squared_distances / dof)
        tails *= 0.5 * (dof + self.means.shape[1])
        return np.subtract((np.log(self.weights) + self._log_constants)[:, None], tails, out=tails)

    def log_pdf(self, z: FloatArray) -> FloatArray:
        """The log density (n,) at ``z`` (n, d), the defensive component included."""
        if len(z) > PART:
            return np.concatenate([self.log_pdf(z[i : i + PART]) for i in range(0, len(z), PART)])
        total = _log_sum(self.log_components(self.squared_distances(z)))
        if self.prior_share == 0.0:
            return total
        d = z.shape[1]
        prior = -0.5 * (np.einsum("nd,nd->n", z, z) + d * math.log(2.0 * math.pi))
        return np.logaddexp(total, prior + math.log(self.prior_share))

    def with_prior_component(self, prior_share: float = DEFENSIVE_SHARE) -> StudentMixture:
        """This mixture with ``prior_share`` of its weight given to the prior N(0, I)."""
        weights = self.weights * ((1.0 - prior_share) / self.weights.sum())
        return StudentMixture(weights, self.means, self.choleskys, self.dof, prior_share)

    def widened(self) -> StudentMixture:
        """This mixture and, with a defensive share, its components at twice their width.

        They cover what lies just beyond a mixture that was fitted to draws: weights of draws
        from it then have no heavy tail.
        """
        return self.mixed_with(replace(self, choleskys=2.0 * self.choleskys))

    def mixed_with(self, other: StudentMixture, share: float = DEFENSIVE_SHARE) -> StudentMixture:
        """This mixture with ``share`` of its weight given to the components of another."""
        return StudentMixture(
            np.concatenate([self.weights * (1.0 - share), other.weights * share]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.choleskys, other.choleskys]),
            np.concatenate([self.dof, other.dof]),
        )

    def reweighted(self, z: FloatArray, weights: FloatArray) -> StudentMixture:
        """The same components with the shares that weighted draws ``z`` (n, d) give them.

        All components share the defensive share equally: a walker could hardly leave a region
        again if its component were hardly ever proposed.
        """
        log_parts = self.log_components(self.squared_distances(z))
        shares = np.exp(log_parts - _log_sum(log_parts)) @ weights
        shares = (1.0 - DEFENSIVE_SHARE) * shares / shares.sum() + DEFENSIVE_SHARE / len(shares)
        return replace(self, weights=shares)

    def draw(self, counts: NDArray[np.intp], rng: np.random.Generator) -> FloatArray:
        """``counts[k]`` draws from component k, in order; the last count is for the prior N(0, I).

        Args:
            counts: (K + 1,).

        Returns:
            (counts.sum(), d).
        """
        d = self.means.shape[1]
        component = np.repeat(np.arange(self.n_components), counts[:-1])
        normal = rng.standard_normal((len(component), d))
        dof = self.dof[component]
        scale = np.sqrt(dof / rng.chisquare(dof))
        steps = np.einsum("nij,nj->ni", self.choleskys[component], normal) * scale[:, None]
        return np.concatenate([self.means[component] + steps, rng.standard_normal((counts[-1], d))])

    @property
    def all_weights(self) -> FloatArray:
        """(K + 1,): the components' weights and the defensive one's."""
        return np.append(self.weights, self.prior_share)


class Proposal(NamedTuple):
    """Independence proposal of walkers' moves.

    Attributes:
        mixture: fitted beforehand, and fixed.
        share: share of the steps that it proposes; differential evolution and the stretch move
            propose the others.
    """

    mixture: StudentMixture
    share: float = 0.7


def fit_mixture(
    draws: FloatArray, n_components: int, dof: float, rng: np.random.Generator
) -> StudentMixture:
    """Fit a Student-t mixture to ``draws`` (n, d) by expectation-maximisation.

    Components that lose their draws are dropped, so fewer than ``n_components`` may come back.
    """
    n, d = draws.shape
    labels = _initial_labels(draws, n_components, rng)
    responsibilities = (labels == np.arange(labels.max() + 1)[:, None]).astype(float)
    scale_weights = np.ones_like(responsibilities)
    floor = 1e-10 * np.eye(d) * max(float(draws.var(axis=0).max()), 1e-300)
    least = min(n, d + 1.0)
    last = -math.inf
    for _ in range(50):  # or until a step gains less than a tenth of LEAST_GAIN
        totals = responsibilities.sum(1)
        kept = totals >= least
        if not kept.all() and kept.any():
            responsibilities, scale_weights = responsibilities[kept], scale_weights[kept]
            totals = totals[kept]
        combined = responsibilities * scale_weights
        means = combined @ draws / combined.sum(1, keepdims=True)
        centred = draws.T - means[:, :, None]
        scatter = np.matmul(centred * combined[:, None], centred.transpose(0, 2, 1))
        covariances = scatter / totals[:, None, None] + floor
        mixture = StudentMixture(
            weights=totals / totals.sum(),
            means=means,
            choleskys=np.linalg.cholesky(covariances),
            dof=np.full(len(means), dof),
        )

        squared_distances = mixture.squared_distances(draws)
        log_parts = mixture.log_components(squared_distances)
        log_total = _log_sum(log_parts)
        responsibilities = np.exp(log_parts - log_total)
        scale_weights = (dof + d) / (dof + squared_distances)
        mean_log_density = float(log_total.mean())
        if mean_log_density - last < 0.1 * LEAST_GAIN:
            break
        last = mean_log_density
    return mixture


def choose_mixture(
    draws: FloatArray, held_out: FloatArray, rng: np.random.Generator
) -> StudentMixture:
    """The mixture, fitted to ``draws``, under which ``held_out`` is most probable.

    It is the nearest to the posterior in the Kullback-Leibler sense. The number of components
    grows until two larger numbers in turn no longer help, and the weight of the tails is chosen
    by the held-out draws.
    """
    n, d = draws.shape
    best_count = 1
    best = fit_mixture(draws, best_count, LIGHT_TAILS, rng)
    best_score = float(best.log_pdf(held_out).mean())
    in_vain = 0
    for count in (2, 3, 4, 6, 8, 12, 16):
        if in_vain == 2 or count * d * DRAWS_PER_DIMENSION > n:
            break
        candidate = fit_mixture(draws, count, LIGHT_TAILS, rng)
        score = float(candidate.log_pdf(held_out).mean())
        in_vain += 1
        if score > best_score + LEAST_GAIN:
            best, best_count, best_score, in_vain = candidate, count, score, 0
    heavier = fit_mixture(draws, best_count, HEAVY_TAILS, rng)
    return heavier if float(heavier.log_pdf(held_out).mean()) > best_score else best


def _log_sum(log_parts: FloatArray) -> FloatArray:
    """log Σ exp of finite numbers over the first axis, faster than the general functions."""
    highest = log_parts.max(axis=0)
    total: FloatArray = np.log(np.exp(log_parts - highest).sum(axis=0)) + highest
    return total


def _initial_labels(draws: FloatArray, k: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """A first partition of the draws into k groups, by k-means on standardised coordinates."""
    if k == 1:
        return np.zeros(len(draws), dtype=np.intp)
    spread = draws.std(axis=0)
    scaled = (draws - draws.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    centres = scaled[rng.integers(len(scaled))][None]
    nearest = ((scaled - centres[0]) ** 2).sum(1)
    while len(centres) < k and nearest.max() > 0:  # far points first: k-means++
        chosen = rng.choice(len(scaled), p=nearest / nearest.sum())
        centres = np.vstack([centres, scaled[chosen]])
        nearest = np.minimum(nearest, ((scaled - scaled[chosen]) ** 2).sum(1))
    for _ in range(5):
        distances = ((scaled[:, None] - centres[None]) ** 2).sum(-1)
        labels = distances.argmin(1)
        occupied = np.unique(labels)
        centres = np.array([scaled[labels == group].mean(0) for group in occupied])
    return np.searchsorted(occupied, labels)
