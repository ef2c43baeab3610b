"""Maxima of a posterior by many local ascents at once, and Laplace's approximation at each.

Components at the maxima are added to all proposals, so that regions that particles lost, which
reach one in proportion to its mass on the way from the prior, are still visited.

Few precise data leave most directions of many parameters to the prior, and the others to a thin
sheet that curves with them. Points drawn in the wide directions of a component climb onto the sheet
along the thin ones; polynomials through where they arrive bend it. As the points carry no noise,
few are needed for each coefficient.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.ascents import GRADIENT_STEP, LEAST_RISE, ascend
from bayes_ssi.inference.sampling.diagnostics import EvidenceEstimate
from bayes_ssi.inference.sampling.mixture import (
    HEAVY_TAILS,
    LIGHT_TAILS,
    Bend,
    StudentMixture,
    monomials,
)
from bayes_ssi.inference.sampling.regions import VALLEY_DEPTH, lowest_between
from bayes_ssi.inference.sampling.target import Target

MOST_RIDGES = 8  # maxima, those with the most mass first, whose ridges are followed
# A direction is along the ridge if the posterior has more than this share of the prior's
# variance in it.
LEAST_VARIANCE = 0.1
# It is no ridge where no point along it has more than this share of the density expected there.
LEAST_ON_RIDGE = 1e-9
HIGHEST_DEGREE = 6  # polynomials are of this degree at most
# Most coefficients of a thin coordinate: to solve for them takes as long as some ten thousand
# evaluations of a small structure. Those of three thin in twenty coordinates are fewer, to the
# third degree.
MOST_MONOMIALS = 1200
# Points, at least as many again as coefficients, and at least so many more, to know by how much
# polynomials miss the ridge.
LEAST_POINTS_LEFT = 60
# Polynomials are good enough where they widen a ridge by no more than this factor.
MOST_WIDENING = 1.1

# In prior standard deviations. Central second differences, whose truncation and rounding errors
# balance for log-likelihoods of some thousand nats.
HESSIAN_STEP = 1e-3
# Steps over which the log posterior falls by more nats are shortened: further away a narrow
# maximum may have given way to what surrounds it.
LARGEST_FALL = 0.1
NOISY_HESSIAN_STEP = 0.3  # where a model is noisy: the first, which are shortened as above
# Ascents end within so many standard deviations per coordinate of a maximum.
ENDS_WITHIN = 0.1
# A maximum with less than e^-12, 6 in a million, of the mass is left out.
NEGLIGIBLE_LOG_MASS = -12.0


@dataclass(frozen=True, eq=False)
class Maxima:
    """Distinct maxima of likelihood times prior density in standard-normal coordinates."""

    z: FloatArray  # (m, d), the highest first
    log_posteriors: FloatArray  # (m,), likelihood times prior density
    precisions: FloatArray  # (m, d, d), the negative Hessian

    @property
    def covariances(self) -> FloatArray:
        """Inverses of the precisions, (m, d, d), symmetric to the last digit."""
        # By eigenvalues, 1 to 1e12: an inverse could round to what is not positive definite.
        precisions, axes = np.linalg.eigh(self.precisions)
        inverses = (axes / precisions[:, None]) @ axes.transpose(0, 2, 1)
        return np.asarray(0.5 * (inverses + inverses.transpose(0, 2, 1)), dtype=float)

    def are_at(self, z: FloatArray, within: float = 1.0) -> NDArray[np.bool_]:
        """Whether ``z`` (n, d) lie within so many standard deviations per coordinate, (m, n)."""
        away = z[None] - self.z[:, None]
        squared_distances = np.einsum("mni,mij,mnj->mn", away, self.precisions, away)
        return squared_distances < within**2 * z.shape[1]

    @property
    def log_masses(self) -> FloatArray:
        """Laplace's approximation of the log evidence of each maximum, (m,)."""
        d = self.z.shape[1]
        _, log_determinants = np.linalg.slogdet(self.precisions)
        return self.log_posteriors + 0.5 * d * math.log(2.0 * math.pi) - 0.5 * log_determinants

    @property
    def laplace_estimate(self) -> EvidenceEstimate:
        """Laplace's approximation of the log evidence, summed over the maxima."""
        return EvidenceEstimate("Laplace", float(logsumexp(self.log_masses)))

    def as_mixture(self) -> StudentMixture:
        """One component per maximum, weighted by its mass."""
        log_weights = self.log_masses - logsumexp(self.log_masses)
        kept = log_weights > NEGLIGIBLE_LOG_MASS
        weights = np.asarray(np.exp(log_weights[kept]), dtype=float)
        factors = np.linalg.cholesky(self.covariances).astype(float, copy=False)[kept]
        dof = np.full(len(weights), HEAVY_TAILS)
        return StudentMixture(weights / weights.sum(), self.z[kept], factors, dof)


def reached(
    target: Target, maxima: Maxima, z: FloatArray, log_posteriors: FloatArray
) -> NDArray[np.bool_]:
    """Whether ``z`` (n, d) are at maxima, with no valley between, (m, n)."""
    are_at = maxima.are_at(z)
    m, n = np.nonzero(are_at & ~maxima.are_at(z, ENDS_WITHIN))
    lower_ends = np.minimum(maxima.log_posteriors[m], log_posteriors[n])
    lowest = lowest_between(target.log_posterior, maxima.z[m], z[n], lower_ends)
    are_at[m, n] = lowest >= lower_ends - VALLEY_DEPTH
    return are_at


def no_maxima(n_dimensions: int) -> Maxima:
    d = n_dimensions
    return Maxima(np.empty((0, d)), np.empty(0), np.empty((0, d, d)))


def find_maxima(
    target: Target,
    starts: FloatArray,
    known: Maxima | None = None,
    covariances: FloatArray | None = None,
) -> Maxima:
    """Climb from every row of ``starts`` (S, d): the distinct maxima reached, and those known.

    ``covariances`` (S, d, d) are those at the maxima, roughly; of a first ascent if None.
    """
    known = known or no_maxima(target.n_dimensions)
    if covariances is None:
        maxima = maxima_near(target, *first_ascent(target, starts), known)
    else:
        maxima = _joined(known, _distinct(target, *ascend(target, starts, covariances), known))
    if not len(maxima.z):
        raise ValueError("find_maxima: the likelihood is zero at every start")
    return maxima


def first_ascent(
    target: Target, starts: FloatArray, least_rise: float = LEAST_RISE
) -> tuple[FloatArray, FloatArray]:
    """As of `ascend`, from every row of ``starts`` (S, d), where no curvature is known."""
    inverse = np.tile(np.eye(target.n_dimensions), (len(starts), 1, 1))
    return ascend(target, starts, inverse, least_rise=least_rise)


def maxima_near(
    target: Target, ends: FloatArray, log_posteriors: FloatArray, known: Maxima
) -> Maxima:
    """The distinct maxima to which ends (S, d) of first ascents lead, and those known."""
    # Ascents along a curved ridge can stop short of its top: continue with its curvature.
    rough = _distinct(target, ends, log_posteriors, known)
    return _joined(known, _distinct(target, *ascend(target, rough.z, rough.covariances), known))


def _joined(known: Maxima, new: Maxima) -> Maxima:
    """Both, the highest first, without those of negligible mass."""
    maxima = Maxima(
        np.concatenate([known.z, new.z]),
        np.concatenate([known.log_posteriors, new.log_posteriors]),
        np.concatenate([known.precisions, new.precisions]),
    )
    order = np.argsort(-maxima.log_posteriors, kind="stable")
    log_masses = maxima.log_masses[order]
    kept = order[log_masses > log_masses.max(initial=-math.inf) + NEGLIGIBLE_LOG_MASS]
    return Maxima(maxima.z[kept], maxima.log_posteriors[kept], maxima.precisions[kept])


def _distinct(
    target: Target, ends: FloatArray, log_posteriors: FloatArray, known: Maxima
) -> Maxima:
    """The highest of every group of ascents that ended at the same maximum, but at none known."""
    d = target.n_dimensions
    possible = np.flatnonzero(np.isfinite(log_posteriors))
    new = possible[~reached(target, known, ends[possible], log_posteriors[possible]).any(axis=0)]
    left = new[np.argsort(-log_posteriors[new], kind="stable")]
    # A narrow maximum may be high and have little mass: what a low one could have, were it as wide
    # as the prior, decides.
    widest = 0.5 * d * math.log(2.0 * math.pi)
    largest = float(known.log_masses.max(initial=-math.inf))
    highest: list[np.intp] = []
    precisions: list[FloatArray] = []
    while len(left):
        top, left = left[0], left[1:]
        if log_posteriors[top] + widest < largest + NEGLIGIBLE_LOG_MASS:
            break
        precision = _precision(target, ends[top], float(log_posteriors[top]))
        maximum = Maxima(ends[[top]], log_posteriors[[top]], precision[None])
        largest = max(largest, float(maximum.log_masses[0]))
        highest.append(top)
        precisions.append(precision)
        left = left[~reached(target, maximum, ends[left], log_posteriors[left])[0]]
    chosen = np.array(highest, dtype=np.intp)
    return Maxima(ends[chosen], log_posteriors[chosen], np.reshape(precisions, (-1, d, d)))


def _precision(target: Target, z: FloatArray, value: float) -> FloatArray:
    """Negative Hessian (d, d) at a maximum, by central differences, made positive definite.

    Where the posterior is flat or rises, the curvature of the prior, 1, is used instead.
    """
    d = len(z)
    pairs = [(i, j) for i in range(d) for j in range(i)]

    def corners(lengths: FloatArray) -> FloatArray:
        steps = np.diag(lengths)
        signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
        points = [z + a * steps[i] + b * steps[j] for i, j in pairs for a, b in signs]
        return np.reshape(points, (-1, d))

    # All in one batch: of a small structure, one more takes as long as many more points.
    first = np.full(d, HESSIAN_STEP if not target.noise else NOISY_HESSIAN_STEP)
    near = [z + np.diag(first), z - np.diag(first), corners(first)]
    beside, values = np.split(target.log_posterior(np.concatenate(near)), [2 * d])
    lengths, beside = _step_lengths(target, z, value, first, beside.reshape(2, d))
    if (lengths < first).any():
        values = target.log_posterior(corners(lengths))
    if not (np.isfinite(values).all() and np.isfinite(beside).all()):
        return np.eye(d)  # at the edge of where the likelihood is positive
    hessian = np.empty((d, d))
    hessian[range(d), range(d)] = beside.sum(0) - 2.0 * value
    for (i, j), terms in zip(pairs, values.reshape(-1, 4), strict=True):
        hessian[i, j] = hessian[j, i] = (terms[0] - terms[1] - terms[2] + terms[3]) / 4.0
    eigenvalues, vectors = np.linalg.eigh(-hessian / np.outer(lengths, lengths))
    # Beyond this ratio to the prior's precision, 1, rounding would lose the prior's.
    return (vectors * np.clip(eigenvalues, 1.0, 1e12)) @ vectors.T


def _step_lengths(
    target: Target, z: FloatArray, value: float, first: FloatArray, beside: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Step lengths (d,) for second differences, and the log posteriors (2, d) one step away.

    From the first ones, shortened where the log posterior falls too far.
    """
    lengths, beside = first.copy(), beside.copy()
    largest_fall = max(LARGEST_FALL, 30.0 * target.noise)
    steep = np.arange(len(z))
    while True:
        fall = value - beside[:, steep].min(axis=0)
        with np.errstate(invalid="ignore"):
            too_far = np.isfinite(fall) & (fall > largest_fall)
        too_far &= lengths[steep] > GRADIENT_STEP
        steep, fall = steep[too_far], fall[too_far]
        if not len(steep):
            return lengths, beside
        lengths[steep] *= np.sqrt(0.5 * largest_fall / fall)
        steps = lengths[steep, None] * np.eye(len(z))[steep]
        beside[:, steep] = target.log_posterior(np.concatenate([z + steps, z - steps])).reshape(
            2, -1
        )


def along_ridges(target: Target, maxima: Maxima, rng: np.random.Generator) -> StudentMixture | None:
    """The mixture around ``maxima`` with heavy components bent; None where none is on a ridge."""
    mixture = maxima.as_mixture()
    factors, dof = mixture.factors.copy(), mixture.dof.copy()
    bends: list[Bend | None] = [None] * len(dof)
    for k in np.argsort(-mixture.weights, kind="stable")[:MOST_RIDGES]:
        ridge = _ridge(target, mixture.means[k], factors[k], rng)
        if ridge is not None:
            factors[k], bends[k] = ridge
            dof[k] = LIGHT_TAILS
    if not any(bends):
        return None
    return replace(mixture, factors=factors, dof=dof, bends=tuple(bends))


def _ridge(
    target: Target, mean: FloatArray, factor: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, Bend] | None:
    """Factor (d, d) and bend of a component; None where no direction is wide, or none is thin.

    The degree rises while points are farther from the polynomials than the ridge is thick.
    """
    variances, axes = np.linalg.eigh(factor @ factor.T)
    variances, axes = variances[::-1], axes[:, ::-1]
    m, d = int(np.sum(variances > LEAST_VARIANCE)), len(mean)
    if m in (0, d):
        return None
    factor, top = axes * np.sqrt(variances), float(target.log_posterior(mean[None])[0])
    wide, thin, weights = np.empty((m, 0)), np.empty((d - m, 0)), np.empty(0)
    narrowest = None
    for degree in range(2, HIGHEST_DEGREE + 1):
        n_fitted = math.comb(m + degree, degree)  # monomials, the constant included
        if n_fitted > MOST_MONOMIALS:
            break
        n_points = n_fitted + max(n_fitted, LEAST_POINTS_LEFT)
        new = rng.standard_normal((m, n_points - wide.shape[1]))
        inverse = np.tile(np.diag(variances[m:]), (new.shape[1], 1, 1))
        starts = mean + (factor[:, :m] @ new).T
        z, heights = ascend(target, starts, inverse, axes[:, m:].T)
        wide = np.concatenate([wide, new], axis=1)
        reached = (axes[:, m:].T @ (z - mean).T) / np.sqrt(variances[m:])[:, None]
        thin = np.concatenate([thin, reached], axis=1)
        # Of little weight is what is far below the density of the component's wide directions.
        below = np.minimum(heights + 0.5 * (new**2).sum(axis=0) - top, 0.0)
        weights = np.concatenate([weights, np.exp(below)])
        if weights.max() < LEAST_ON_RIDGE:
            return None
        bend, widths = bend_along(wide, thin, weights, degree)
        if narrowest is None or widths.prod() < narrowest[0].prod():
            narrowest = widths, bend
        if narrowest[0].max() < MOST_WIDENING:
            break
    return None if narrowest is None else (factor * narrowest[0], narrowest[1])


def bend_along(
    wide: FloatArray, thin: FloatArray, weights: FloatArray, degree: int
) -> tuple[Bend, FloatArray]:
    """Thin coordinates (k, n) of points on a ridge as polynomials of wide ones (m, n), whitened.

    By least squares with weights (n,) of at most one. Returns the bend of all coordinates, the wide
    ones first, and the width (m + k,) of each: one, but for what the polynomials leave.
    """
    terms = monomials(wide, degree)
    weighted = terms * weights
    gram = weighted @ terms.T
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-9
    fitted = np.linalg.solve(gram, weighted @ thin.T).T
    n, n_fitted = float(weights.sum()), len(terms)
    # What is left of points that the fit has not seen, as it would be of noise.
    unseen = (n + n_fitted) / max(n - n_fitted, 1.0)
    left = unseen * ((thin - fitted @ terms) ** 2 @ weights) / n
    widths = np.sqrt(1.0 + left)
    bend = Bend(fitted / widths[:, None], len(wide), degree)
    return bend, np.append(np.ones(len(wide)), widths)
