"""Mixtures of Student-t distributions fitted to draws: proposals shaped like the posterior."""

import math

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.mixture import StudentMixture, log_sum
from bayes_ssi.inference.sampling.settings import MIXTURES


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
        if mean_log_density - last < 0.1 * MIXTURES.least_gain:
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

    def fitted(count: int, dof: float = MIXTURES.light_tails) -> tuple[StudentMixture, FloatArray]:
        mixture = fit_mixture(draws, count, dof, rng)
        return mixture, mixture.log_pdf(held_out)

    n_components, (best, log_densities) = 1, fitted(1)
    most = len(draws) // (MIXTURES.draws_per_dimension * draws.shape[1])
    in_vain = 0
    for count in MIXTURES.counts[1:]:
        if in_vain == 2 or count > most:
            break
        candidate, candidate_densities = fitted(count)
        gains = candidate_densities - log_densities
        by_chance = 3.0 * float(gains.std()) / math.sqrt(len(gains))
        in_vain += 1
        if gains.mean() > max(MIXTURES.least_gain, by_chance):
            n_components, best, log_densities, in_vain = count, candidate, candidate_densities, 0
    for dof in (MIXTURES.heavy_tails, MIXTURES.heaviest_tails):
        candidate, candidate_densities = fitted(n_components, dof)
        if candidate_densities.mean() <= log_densities.mean():
            break
        best, log_densities = candidate, candidate_densities
    return best


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
