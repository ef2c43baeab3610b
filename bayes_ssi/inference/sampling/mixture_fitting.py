"""Mixtures of Student-t distributions fitted to draws: proposals shaped like the posterior."""

from __future__ import annotations

import math
from typing import NamedTuple

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
    fitting = _Fitting(draws, held_out, rng)
    best = fitting.fitted(1)
    in_vain = 0
    for count in MIXTURES.counts[1:]:
        if in_vain == 2 or not fitting.affords(count):
            break
        candidate = fitting.fitted(count)
        in_vain += 1
        if candidate.improves_on(best):
            best, in_vain = candidate, 0
    for dof in (MIXTURES.heavy_tails, MIXTURES.heaviest_tails):
        candidate = fitting.fitted(best.n_components, dof)
        if candidate.log_densities.mean() <= best.log_densities.mean():
            break
        best = candidate
    return best.mixture


class _Fitted(NamedTuple):
    """A mixture, what it was fitted with, and the log densities (n,) of the held-out draws."""

    mixture: StudentMixture
    n_components: int
    log_densities: FloatArray

    def improves_on(self, other: _Fitted) -> bool:
        """Whether held-out draws are more probable by enough, and not by chance."""
        gains = self.log_densities - other.log_densities
        by_chance = 3.0 * float(gains.std()) / math.sqrt(len(gains))
        return bool(gains.mean() > max(MIXTURES.least_gain, by_chance))


class _Fitting(NamedTuple):
    draws: FloatArray
    held_out: FloatArray
    rng: np.random.Generator

    def affords(self, count: int) -> bool:
        """Whether there are enough draws for so many components."""
        n, d = self.draws.shape
        return count * d * MIXTURES.draws_per_dimension <= n

    def fitted(self, count: int, dof: float = MIXTURES.light_tails) -> _Fitted:
        mixture = fit_mixture(self.draws, count, dof, self.rng)
        return _Fitted(mixture, count, mixture.log_pdf(self.held_out))


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
