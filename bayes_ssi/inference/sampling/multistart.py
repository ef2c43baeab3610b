"""Multistart: independent searches for every maximum of the posterior, until they agree.

One search is multi-level single linkage (Rinnooy Kan and Timmer 1987): many draws from the prior,
and an ascent from each draw that is higher than all its neighbours. Few ascents then share a
basin, and a narrow basin needs one draw in it, not one ascent in hundreds. Where the target knows
its problem, the search climbs from what it suggests, too.

No later step can reveal what the searches miss. Independent searches that find the same maxima are
the evidence that there are no others; they go on until every maximum that matters was found by
two of them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.maxima import Maxima, find_maxima, no_maxima, reached
from bayes_ssi.inference.sampling.regions import local_maxima
from bayes_ssi.inference.sampling.target import Target

# Searches are repeated, up to this multiple of the wanted number, while a maximum with more
# than this share of the posterior, by Laplace's approximation, was found by only one of them.
MOST_TIMES_WANTED = 3
LEAST_SHARE = 1e-3
# Prior draws of one search, of 4000 of which a basin with a thousandth of the prior holds four,
# and ascents at once from the highest local maxima among them.
DRAWS = 4000
ASCENTS = 40
# Where starts are suggested, which lead to narrow basins, fewer find the wide ones.
DRAWS_BESIDE_STARTS = 1000
ASCENTS_BESIDE_STARTS = 10
# A search climbs on while so many maxima, or more, are expected beyond those that it has reached,
# but no more than so many times: of a rough posterior, each draw may be near a maximum of its own.
EXPECTED_UNSEEN = 0.5
MOST_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class MultistartSearch:
    """The maxima that independent searches found."""

    maxima: Maxima
    reached_by: NDArray[np.bool_]  # (n_searches, m), whether a search found a maximum by itself
    n_draws: int

    @property
    def n_searches(self) -> int:
        return len(self.reached_by)

    @property
    def largest_unseen_mass(self) -> float:
        """Prior mass of a region that no draw of the searches hit with a probability of 5 %.

        Of n independent draws none lies in a region of prior mass p with probability (1 - p)^n.
        A larger region in which the likelihood is higher than around it was climbed to; a smaller
        one can only have been found by a slope that leads there, or by a suggested start.
        """
        return float(-np.expm1(np.log(0.05) / self.n_draws))

    @property
    def converged(self) -> bool:
        """Whether every maximum that matters was found by two searches."""
        return bool((self.reached_by[:, _matter(self.maxima)].sum(axis=0) >= 2).all())


def _matter(maxima: Maxima) -> NDArray[np.bool_]:
    """Which of the maxima have more than a negligible share of the posterior, (m,)."""
    masses = maxima.log_masses
    return np.asarray(masses - logsumexp(masses) > np.log(LEAST_SHARE))


def search_maxima(
    target: Target,
    n_searches: int,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] = lambda _: None,
    n_draws: int | None = None,
    n_ascents: int | None = None,
) -> MultistartSearch:
    """Search for maxima until independent searches agree.

    At least ``n_searches`` times, the target's earlier one included, from ``n_draws`` prior draws
    each, of which ``n_ascents`` are climbed from at once.
    """
    alone = target.suggest_starts is None
    n_draws = n_draws or (DRAWS if alone else DRAWS_BESIDE_STARTS)
    n_ascents = n_ascents or (ASCENTS if alone else ASCENTS_BESIDE_STARTS)
    searches: list[Maxima] = []
    if target.known_starts is not None:
        possible = np.isfinite(target.log_likelihood(target.known_starts))
        if possible.any():
            searches.append(find_maxima(target, target.known_starts[possible]))
    seeds = seed.spawn(max(MOST_TIMES_WANTED * n_searches, 2))
    for n_made, seed_of_search in enumerate(seeds, start=1):
        rng = np.random.default_rng(seed_of_search)
        searches.append(_search(target, n_draws, n_ascents, rng))
        progress(min(len(searches) / n_searches, 1.0))
        if len(searches) < n_searches:
            continue
        ends = np.concatenate([search.z for search in searches])
        if not len(ends):
            raise ValueError(
                f"the likelihood is zero at all of {n_made * n_draws} draws from the prior; "
                "are the priors, the pairing and the units those of the data?"
            )
        # Climbing on from all of them merges those that stopped short of the same maximum; once
        # more, where they differ, if the target turns out to be noisy.
        for _ in range(2):
            maxima = find_maxima(target, ends)
            reached_by = np.array(
                [reached(target, maxima, one.z, one.log_posteriors).any(axis=1) for one in searches]
            )
            result = MultistartSearch(maxima, reached_by, n_made * n_draws)
            if result.converged or target.noise or not target.is_noisy_at(maxima.z):
                break
        if result.converged:
            break
    return result


def _search(target: Target, n_draws: int, n_ascents: int, rng: np.random.Generator) -> Maxima:
    """The maxima that one search finds; none if the likelihood is zero at all its starts.

    As many further ascents follow, from lower and lower draws, while maxima are likely to be left.
    """
    highest, suggested = search_starts(target, n_draws, rng)
    maxima, n_climbed = no_maxima(target.n_dimensions), 0
    for n in range(0, MOST_ROUNDS * n_ascents, n_ascents):
        starts = highest[n : n + n_ascents]
        if n == 0:
            starts = np.concatenate([starts, suggested])
        if not len(starts) or _expected_unseen(maxima, n_climbed) < EXPECTED_UNSEEN:
            break
        maxima = find_maxima(target, starts, maxima)
        n_climbed += len(starts)
    return maxima


def _expected_unseen(maxima: Maxima, n_climbed: int) -> float:
    """How many maxima are left to find after so many ascents, by how many of these met.

    Of w that n ascents reached, w (w + 1) / (n - w - 2), if the sizes of basins are unknown
    (Boender and Rinnooy Kan 1987).
    """
    reached = int(_matter(maxima).sum()) if n_climbed else 0
    surplus = n_climbed - reached - 2
    return reached * (reached + 1) / surplus if surplus > 0 else math.inf


def search_starts(
    target: Target, n_draws: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws (m, d) higher than their neighbours, the highest first; suggested starts (n, d)."""
    draws = rng.standard_normal((n_draws, target.n_dimensions))
    log_likelihoods = target.log_likelihood(draws)
    possible = np.isfinite(log_likelihoods)
    suggested = target.suggested(rng)
    if not possible.any():
        return draws[:0], suggested
    return local_maxima(draws[possible], log_likelihoods[possible]), suggested
