"""Mixtures of Student-t distributions, straight or bent along curved ridges.

The first, wide whitened coordinates w of a bent component stay as they are, and the thin ones
become w_j = v_j + P_j(v_1, …, v_m) with polynomials P_j of the wide ones: a map whose Jacobian is
1, so that a density of v is one of w.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln

from bayes_ssi.foundations.arrays import FloatArray, IntArray

# Degrees of freedom: the variance of importance weights stays finite where a posterior has
# tails as heavy as those of five; thirty are nearly normal; two serve tails like Cauchy's.
LIGHT_TAILS = 30.0
HEAVY_TAILS = 5.0
HEAVIEST_TAILS = 2.0
# Weight of components added in case a mixture misses a part of the posterior: the importance
# weights of the other draws rise by a ninth at most.
DEFENSIVE_SHARE = 0.1
# More components must raise the mean log density of held-out draws by so many nats.
LEAST_GAIN = 0.01
DRAWS_PER_DIMENSION = 10  # a component needs this many draws for each dimension
COUNTS = (1, 2, 3, 4, 6, 8, 12, 16)  # numbers of components that are tried
# Arguments of bends end at this multiple of a component's width: hardly a draw is further out.
REACH = 10.0


@dataclass(frozen=True, eq=False)
class Bend:
    """The polynomials of one component's thin coordinates.

    Components whose bends have the same array of coefficients differ in nothing but ``width``:
    polynomials are evaluated once for all of them.
    """

    coefficients: FloatArray  # (d - m, F), of all monomials of the wide coordinates
    n_wide: int  # m
    degree: int
    width: float = 1.0  # of the component, over that which the coefficients are for

    def straightened(self, w: FloatArray) -> FloatArray:
        """Coordinates v (d, n) of w (d, n)."""
        return np.concatenate([w[: self.n_wide], w[self.n_wide :] - self.shifts(w) / self.width])

    def bent(self, v: FloatArray) -> FloatArray:
        """Coordinates w (d, n) of v (d, n)."""
        return np.concatenate([v[: self.n_wide], v[self.n_wide :] + self.shifts(v) / self.width])

    def widened(self, factor: float) -> "Bend":
        """The bend of the same ridge for a component ``factor`` times as wide."""
        return replace(self, width=factor * self.width)

    def shifts(self, w: FloatArray) -> FloatArray:
        """The polynomials (d - m, n) at w (d, n), constant beyond their reach."""
        wide = np.clip(self.width * w[: self.n_wide], -REACH, REACH)
        return self.coefficients @ monomials(wide, self.degree)


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """K Student-t components in d dimensions, and a share of the standard normal prior."""

    weights: FloatArray  # (K,), adding up to ``1 - prior_share``
    means: FloatArray  # (K, d)
    factors: FloatArray  # (K, d, d), F with scale matrices F Fᵀ: z = mean + F w
    dof: FloatArray  # (K,), degrees of freedom
    # Weight of N(0, I), the defensive component: it bounds every importance weight by the greatest
    # likelihood over ``prior_share``.
    prior_share: float = 0.0
    # Of the components that follow a curved ridge, None for straight ones; empty where all are
    # straight.
    bends: tuple[Bend | None, ...] = ()

    @property
    def n_components(self) -> int:
        """Student-t components; the defensive one does not count."""
        return len(self.weights)

    @cached_property
    def _whitening(self) -> tuple[FloatArray, FloatArray]:
        """All inverse factors as one (K·d, d), and the whitened means (K·d, 1)."""
        inverses = np.linalg.inv(self.factors)
        factors: FloatArray = np.concatenate(inverses).astype(float, copy=False)
        return factors, np.einsum("kij,kj->ki", inverses, self.means).reshape(-1, 1)

    @cached_property
    def _log_constants(self) -> FloatArray:
        d, dof = self.means.shape[1], self.dof
        constants = gammaln((dof + d) / 2) - gammaln(dof / 2) - 0.5 * d * np.log(dof * math.pi)
        log_determinants: FloatArray = np.linalg.slogdet(self.factors)[1]
        return constants - log_determinants

    def squared_distances(self, z: FloatArray) -> FloatArray:
        """Mahalanobis distances squared of ``z`` (n, d) from every component, (K, n).

        Those of bent components are along their bends.
        """
        factors, means = self._whitening
        whitened = factors @ z.T
        whitened -= means
        whitened = whitened.reshape(*self.means.shape, len(z))
        shifts: dict[int, FloatArray] = {}
        for bend, of_component in zip(self.bends, whitened, strict=False):
            if bend is not None:
                ridge = id(bend.coefficients)
                if ridge not in shifts:
                    shifts[ridge] = bend.shifts(of_component)
                of_component[bend.n_wide :] -= shifts[ridge] / bend.width
        whitened *= whitened
        return whitened.sum(axis=1)

    def log_components(self, squared_distances: FloatArray) -> FloatArray:
        """log(weight · density) of every Student-t component at these distances, (K, n)."""
        dof = self.dof[:, None]
        tails = np.log1p(squared_distances / dof)
        tails *= 0.5 * (dof + self.means.shape[1])
        return np.subtract((np.log(self.weights) + self._log_constants)[:, None], tails, out=tails)

    def log_pdf(self, z: FloatArray) -> FloatArray:
        """The log density (n,) at ``z`` (n, d), the defensive component included."""
        parts = self._parts(z)
        if len(parts) > 1:
            return np.concatenate([self.log_pdf(part) for part in parts])
        total = log_sum(self.log_components(self.squared_distances(z)))
        if self.prior_share == 0.0:
            return total
        prior = -0.5 * (np.einsum("nd,nd->n", z, z) + z.shape[1] * math.log(2.0 * math.pi))
        return np.logaddexp(total, prior + math.log(self.prior_share))

    def shares(self, z: FloatArray, weights: FloatArray) -> FloatArray:
        """The share (K,) of weighted draws ``z`` (n, d) in every component."""
        shares = np.zeros(self.n_components)
        end = 0
        for part in self._parts(z):
            log_parts = self.log_components(self.squared_distances(part))
            begin, end = end, end + len(part)
            shares += np.exp(log_parts - log_sum(log_parts)) @ weights[begin:end]
        return shares / shares.sum()

    def log_pdf_with_last(self, z: FloatArray, log_pdf_without: FloatArray) -> FloatArray:
        """The log density (n,) at ``z`` (n, d), given that without the last component added."""
        last = StudentMixture(np.ones(1), self.means[-1:], self.factors[-1:], self.dof[-1:])
        share = float(self.weights[-1])
        return np.logaddexp(math.log1p(-share) + log_pdf_without, math.log(share) + last.log_pdf(z))

    def chart(self, z: FloatArray) -> "Chart | None":
        """That of the bent component to which most of the draws ``z`` (n, d) belong, if any."""
        if not any(self.bends):
            return None
        shares = self.shares(z, np.ones(len(z)))
        k = int(shares.argmax())
        bend = self.bends[k]
        return Chart(self.means[k], self.factors[k], bend) if bend and shares[k] > 0.5 else None

    def _parts(self, z: FloatArray) -> list[FloatArray]:
        """Draws in parts whose distances from all components stay in the processor's cache."""
        n_terms = max((bend.coefficients.shape[-1] for bend in self.bends if bend), default=0)
        n = max(64, 2**18 // (self.means.size + 2 * n_terms))
        return np.split(z, range(n, len(z), n))

    def with_prior_component(self, prior_share: float = DEFENSIVE_SHARE) -> "StudentMixture":
        """This mixture with ``prior_share`` of its weight given to the prior N(0, I)."""
        weights = self.weights * ((1.0 - prior_share) / self.weights.sum())
        return replace(self, weights=weights, prior_share=prior_share)

    def widened(self) -> "StudentMixture":
        """This mixture and, with a defensive share, its components at twice their width.

        They cover what lies just beyond a mixture that was fitted to draws, as the ends of a
        ridge: weights of draws from it then have no heavy tail. Their own tails are the heaviest.
        """
        bends = tuple(bend and bend.widened(2.0) for bend in self.bends)
        dof = np.minimum(self.dof, HEAVIEST_TAILS)
        return self.mixed_with(replace(self, factors=2.0 * self.factors, bends=bends, dof=dof))

    def mixed_with(
        self, other: "StudentMixture", share: float = DEFENSIVE_SHARE
    ) -> "StudentMixture":
        """This mixture with ``share`` of its weight given to the components of another."""
        return StudentMixture(
            np.concatenate([self.weights * (1.0 - share), other.weights * share]),
            np.concatenate([self.means, other.means]),
            np.concatenate([self.factors, other.factors]),
            np.concatenate([self.dof, other.dof]),
            bends=self._all_bends + other._all_bends,
        )

    def reweighted(self, z: FloatArray, weights: FloatArray) -> "StudentMixture":
        """The same components with the shares that weighted draws ``z`` (n, d) give them.

        All components share the defensive share equally: a walker could hardly leave a region
        again if its component were hardly ever proposed.
        """
        defensive = DEFENSIVE_SHARE
        shares = (1.0 - defensive) * self.shares(z, weights) + defensive / self.n_components
        return replace(self, weights=shares)

    def draw(self, counts: IntArray, rng: np.random.Generator) -> FloatArray:
        """Draws (n, d), ``counts[k]`` from component k, in order; the last is the prior N(0, I)."""
        d = self.means.shape[1]
        component = np.repeat(np.arange(self.n_components), counts[:-1])
        normal = rng.standard_normal((len(component), d))
        dof = self.dof[component]
        scale = np.sqrt(dof / rng.chisquare(dof))
        whitened = normal * scale[:, None]
        ends = np.cumsum(counts)
        for k, bend in enumerate(self.bends):
            if bend is not None:
                drawn = slice(ends[k] - counts[k], ends[k])
                whitened[drawn] = bend.bent(whitened[drawn].T).T
        parts = np.split(whitened, ends[: self.n_components - 1])
        steps = np.concatenate([part @ f.T for part, f in zip(parts, self.factors, strict=True)])
        return np.concatenate([self.means[component] + steps, rng.standard_normal((counts[-1], d))])

    @property
    def _all_bends(self) -> tuple[Bend | None, ...]:
        return self.bends or (None,) * self.n_components

    @property
    def all_weights(self) -> FloatArray:
        """(K + 1,): the components' weights and the defensive one's."""
        return np.append(self.weights, self.prior_share)


class Chart(NamedTuple):
    """Coordinates in which a bent component is straight and its factor is I.

    Densities in these are those in others times a constant.
    """

    mean: FloatArray  # (d,)
    factor: FloatArray  # (d, d)
    bend: Bend

    def straight(self, z: FloatArray) -> FloatArray:
        """Coordinates (n, d) of points ``z`` (n, d)."""
        whitened = np.linalg.solve(self.factor, (z - self.mean).T).astype(float, copy=False)
        return self.bend.straightened(whitened).T

    def curved(self, v: FloatArray) -> FloatArray:
        """Points (n, d) at these coordinates ``v`` (n, d)."""
        return self.mean + (self.factor @ self.bend.bent(v.T)).T


def tails_within(n_dimensions: int) -> float:
    """Degrees of freedom of proposals within a level, where a density has no tails.

    A component's width varies by 1/√(2 ν). In many dimensions nearly all of a level's volume is in
    a thin shell, which hardly a proposal of varying width hits.
    """
    return LIGHT_TAILS * max(1.0, n_dimensions / 5.0)


def log_sum(log_parts: FloatArray) -> FloatArray:
    """log Σ exp of finite numbers over the first axis, faster than the general functions."""
    highest = log_parts.max(axis=0)
    return np.log(np.exp(log_parts - highest).sum(axis=0)) + highest


def monomials(variables: FloatArray, degree: int) -> FloatArray:
    """All monomials (F, n) of ``variables`` (m, n) up to a degree, in the order of their degrees.

    Those of one degree are in the order of their last variable: that times the first ones of the
    degree before, which have no later variable.
    """
    m, n = variables.shape
    terms = np.empty((math.comb(m + degree, degree), n))
    terms[0] = 1.0
    before, end = 0, 1
    for lower in range(degree):
        first, before = before, end
        for i, variable in enumerate(variables):
            count = math.comb(i + lower, lower)
            np.multiply(terms[first : first + count], variable, out=terms[end : end + count])
            end += count
    return terms


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
    # Far below the draws' variance, far above the rounding of their means.
    rounding = 1e3 * np.finfo(float).eps * float(np.abs(draws).max())
    floor = max(1e-10 * float(draws.var(axis=0).max()), rounding**2, np.finfo(float).tiny)
    least = min(n, d + 1.0)
    last = -math.inf
    for _ in range(50):  # or until a step gains less than a tenth of what a component must
        totals = responsibilities.sum(1)
        kept = totals >= least
        if not kept.all() and kept.any():
            responsibilities, scale_weights = responsibilities[kept], scale_weights[kept]
            totals = totals[kept]
        combined = responsibilities * scale_weights
        means = combined @ draws / combined.sum(1, keepdims=True)
        centred = draws.T - means[:, :, None]
        scatter = np.matmul(centred * combined[:, None], centred.transpose(0, 2, 1))
        covariances = scatter / totals[:, None, None] + floor * np.eye(d)
        factors = np.linalg.cholesky(covariances)
        mixture = StudentMixture(totals / totals.sum(), means, factors, np.full(len(means), dof))

        squared_distances = mixture.squared_distances(draws)
        log_parts = mixture.log_components(squared_distances)
        log_total = log_sum(log_parts)
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
    grows until two larger numbers in turn no longer help. The weight of the tails comes last.
    """

    def fitted(count: int, dof: float = LIGHT_TAILS) -> tuple[StudentMixture, FloatArray]:
        mixture = fit_mixture(draws, count, dof, rng)
        return mixture, mixture.log_pdf(held_out)

    n_components, (best, log_densities) = 1, fitted(1)
    most = len(draws) // (DRAWS_PER_DIMENSION * draws.shape[1])
    in_vain = 0
    for count in COUNTS[1:]:
        if in_vain == 2 or count > most:
            break
        candidate, candidate_densities = fitted(count)
        gains = candidate_densities - log_densities
        by_chance = 3.0 * float(gains.std()) / math.sqrt(len(gains))
        in_vain += 1
        if gains.mean() > max(LEAST_GAIN, by_chance):
            n_components, best, log_densities, in_vain = count, candidate, candidate_densities, 0
    for dof in (HEAVY_TAILS, HEAVIEST_TAILS):
        candidate, candidate_densities = fitted(n_components, dof)
        if candidate_densities.mean() <= log_densities.mean():
            break
        best, log_densities = candidate, candidate_densities
    return best


def _initial_labels(draws: FloatArray, k: int, rng: np.random.Generator) -> IntArray:
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
        labels = ((scaled[:, None] - centres[None]) ** 2).sum(-1).argmin(1)
        occupied = np.unique(labels)
        centres = np.array([scaled[labels == group].mean(0) for group in occupied])
    return np.searchsorted(occupied, labels)
