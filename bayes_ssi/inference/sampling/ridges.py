"""Components that follow the ridges on which a posterior's maxima lie.

Few precise data leave most directions of many parameters to the prior, and the others to a thin
sheet that curves with them. Points drawn in the wide directions climb onto the sheet along the thin
ones; polynomials through where they arrive bend a component. As the points carry no noise, few are
needed for each coefficient.
"""

from dataclasses import replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.bends import Bend, bend_along, n_monomials
from bayes_ssi.inference.sampling.maxima import Maxima, ascend
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.settings import MIXTURES, RIDGES
from bayes_ssi.inference.sampling.target import Target


def along_ridges(target: Target, maxima: Maxima, rng: np.random.Generator) -> StudentMixture | None:
    """The mixture around ``maxima`` with heavy components bent; None where none is on a ridge."""
    mixture = maxima.as_mixture()
    factors, dof = mixture.factors.copy(), mixture.dof.copy()
    bends: list[Bend | None] = [None] * len(dof)
    for k in np.argsort(-mixture.weights, kind="stable")[: RIDGES.most]:
        found = _ridge(target, mixture.means[k], factors[k], rng)
        if found is not None:
            factors[k], bends[k] = found
            dof[k] = MIXTURES.light_tails
    if not any(bends):
        return None
    bent = replace(mixture, factors=factors, dof=dof, bends=tuple(bends))
    return bent.mixed_with(_thickened(bent), RIDGES.share_of_thicker)


def _thickened(mixture: StudentMixture) -> StudentMixture:
    """The mixture with its bent components thicker, which covers where polynomials miss a ridge.

    Along the ridge, they are as wide as before: more would be far from nearly all of it.
    """
    factors, bends = mixture.factors.copy(), list(mixture.bends)
    for k, bend in enumerate(bends):
        if bend is not None:
            factors[k][:, bend.n_wide :] *= RIDGES.thicker
            bends[k] = replace(bend, coefficients=bend.coefficients / RIDGES.thicker)
    return replace(mixture, factors=factors, bends=tuple(bends))


def _ridge(
    target: Target, mean: FloatArray, factor: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, Bend] | None:
    """Factor (d, d) and bend of a component; None where no direction is wide, or none is thin.

    The degree rises while points are farther from the polynomials than the ridge is thick.
    """
    variances, axes = np.linalg.eigh(factor @ factor.T)
    variances, axes = variances[::-1], axes[:, ::-1]
    m, d = int(np.sum(variances > RIDGES.least_variance)), len(mean)
    if m in (0, d):
        return None
    factor, top = axes * np.sqrt(variances), float(target.log_posterior(mean[None])[0])
    wide, thin, weights = np.empty((m, 0)), np.empty((d - m, 0)), np.empty(0)
    found = None
    for degree in range(2, RIDGES.highest_degree + 1):
        n_fitted = n_monomials(m, degree)
        if n_fitted > RIDGES.most_monomials:
            break
        n_points = n_fitted + max(n_fitted, RIDGES.least_points_left)
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
        bend, widths = bend_along(wide, thin, weights, degree)
        if found is None or widths.prod() < found[0].prod():
            found = widths, bend
        if found[0].max() < RIDGES.enough:
            break
    return None if found is None else (factor * found[0], found[1])
