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

# Lengths are in prior standard deviations. Differences are forward first and central second ones,
# whose truncation and rounding errors balance for log-likelihoods of some thousand nats.
GRADIENT_STEP = 1e-6
HESSIAN_STEP = 1e-3
# Steps over which the log posterior falls by more nats are shortened: further away a narrow
# maximum may have given way to what surrounds it.
LARGEST_FALL = 0.1
# Where a model is noisy: longer steps, over which the log posterior changes by more.
STEP_OVER_NOISE = 0.05  # forward steps over the root of the noise, the best at sd 0.03
NOISY_HESSIAN_STEP = 0.3  # the first, which are shortened as above
# An ascent along a curved ridge may need more steps: it is continued once.
STEPS_OF_ASCENT = 60
LONGEST_STEP = 2.0
STEP_LENGTHS = (1.0, 0.4, 0.1, 0.01)  # tried together, as shares of the BFGS step
# An ascent ends where a step gains fewer nats, and so within so many standard deviations per
# coordinate of a maximum.
LEAST_RISE = 1e-3
ENDS_WITHIN = 0.1
# Or where so many steps rise by less than this share of it: they creep up to an edge, over which
# the log posterior falls.
MOST_CREEPING, CREEPING = 6, 0.1
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

    ``covariances`` (S, d, d) are what is known of those at the maxima; a first ascent finds them if
    None.
    """
    d = target.n_dimensions
    known = known or no_maxima(d)
    if covariances is None:
        unit = np.tile(np.eye(d), (len(starts), 1, 1))
        rough = _distinct(target, *ascend(target, starts, unit), known)
        # Ascents along a curved ridge can stop short of its top: continue with its curvature.
        starts, covariances = rough.z, rough.covariances
    new = _distinct(target, *ascend(target, starts, covariances), known)
    maxima = Maxima(
        np.concatenate([known.z, new.z]),
        np.concatenate([known.log_posteriors, new.log_posteriors]),
        np.concatenate([known.precisions, new.precisions]),
    )
    if not len(maxima.z):
        raise ValueError("find_maxima: the likelihood is zero at every start")
    order = np.argsort(-maxima.log_posteriors, kind="stable")
    log_masses = maxima.log_masses[order]
    kept = order[log_masses > log_masses.max() + NEGLIGIBLE_LOG_MASS]
    return Maxima(maxima.z[kept], maxima.log_posteriors[kept], maxima.precisions[kept])


def _distinct(
    target: Target, ends: FloatArray, log_posteriors: FloatArray, known: Maxima
) -> Maxima:
    """The highest of every group of ascents that ended at the same maximum, but at none known."""
    d = target.n_dimensions
    possible = np.flatnonzero(np.isfinite(log_posteriors))
    is_known = reached(target, known, ends[possible], log_posteriors[possible]).any(axis=0)
    new = possible[~is_known]
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


def ascend(
    target: Target, starts: FloatArray, inverse: FloatArray, axes: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """All ascents at once, by BFGS with finite differences: end points and their log posteriors.

    ``inverse`` (S, k, k) are the first inverse Hessians, along the orthonormal ``axes`` (k, d) that
    ascents keep to; those of the coordinates if None.
    """
    inverse = inverse.copy()
    z = np.array(starts, dtype=float)
    n, d = z.shape
    axes = np.eye(d) if axes is None else axes
    value = target.log_posterior(z)
    gradient = np.zeros((n, len(axes)))
    active = np.flatnonzero(np.isfinite(value))
    gradient[active] = _gradient(target, z[active], value[active], axes)
    reach, n_creeping = np.full(n, 1.0), np.zeros(n, dtype=int)
    step_lengths = np.array(STEP_LENGTHS)
    least_rise = max(LEAST_RISE, 3.0 * target.noise)
    for _ in range(STEPS_OF_ASCENT):
        if not len(active):
            break
        slope = gradient[active]
        direction = np.einsum("nij,nj->ni", inverse[active], slope)
        expected = np.einsum("nd,nd->n", direction, slope)
        lengths = np.linalg.norm(direction, axis=1)
        direction *= np.minimum(1.0, LONGEST_STEP / np.maximum(lengths, 1e-300))[:, None]
        tried = (step_lengths[:, None] * reach[active])[..., None] * direction
        tried_z = z[active][None] + tried @ axes
        values = target.log_posterior(tried_z.reshape(-1, d)).reshape(len(step_lengths), -1)
        best = values.argmax(0)
        rows = np.arange(len(active))
        rise = values[best, rows] - value[active]
        better = rise > 0
        # An ascent without a rise tries shorter steps; after a rise it returns to full steps.
        reach[active] = np.where(better, 1.0, reach[active] * step_lengths[-1])
        n_creeping[active] += better & (rise < CREEPING * least_rise)
        moved = active[better]
        step = tried[best, rows][better]
        z[moved] = tried_z[best, rows][better]
        value[moved] = values[best, rows][better]
        new_gradient = _gradient(target, z[moved], value[moved], axes)
        _update_inverse(inverse, moved, step, gradient[moved] - new_gradient)
        gradient[moved] = new_gradient
        finished = better & (rise < least_rise) & (expected < 10 * least_rise)
        finished |= (reach[active] < 1e-5) | (n_creeping[active] >= MOST_CREEPING)
        active = active[~finished]
    return z, value


def _gradient(target: Target, z: FloatArray, value: FloatArray, axes: FloatArray) -> FloatArray:
    """Forward differences along axes (k, d), (n, k), all in one batch."""
    step = max(GRADIENT_STEP, STEP_OVER_NOISE * math.sqrt(target.noise))
    ahead = z[:, None, :] + step * axes
    rises = target.log_posterior(ahead.reshape(-1, z.shape[1])).reshape(len(z), len(axes))
    rise = rises - value[:, None]
    return np.nan_to_num(rise / step, nan=0.0, posinf=0.0, neginf=0.0)


def _update_inverse(
    inverse: FloatArray, rows: np.ndarray, step: FloatArray, fall: FloatArray
) -> None:
    """The BFGS update of inverse Hessians in place, where the curvature allows it."""
    curvature = np.einsum("nd,nd->n", step, fall)
    curved = curvature > 1e-12
    rows, step, fall, curvature = rows[curved], step[curved], fall[curved], curvature[curved]
    d = step.shape[1]
    left = np.eye(d) - step[:, :, None] * fall[:, None, :] / curvature[:, None, None]
    inverse[rows] = (
        left @ inverse[rows] @ left.transpose(0, 2, 1)
        + step[:, :, None] * step[:, None, :] / curvature[:, None, None]
    )


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
