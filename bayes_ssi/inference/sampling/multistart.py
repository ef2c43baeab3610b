"""Multistart: independent searches for every maximum of the posterior, until they agree.

One search is multi-level single linkage (Rinnooy Kan and Timmer 1987): many draws from the prior,
and an ascent from each draw that is higher than all its neighbours. Few ascents then share a
basin, and a narrow basin needs one draw in it, not one ascent in hundreds. Where the target knows
its problem, the search climbs from what it suggests, too.

No later step can reveal what the searches miss. Independent searches that find the same maxima are
the evidence that there are no others; they go on until every maximum that matters was found by
two of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.maxima import (
    Maxima,
    first_ascent,
    maxima_near,
    no_maxima,
    reached,
)
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
# Searches climb on, in rounds of so many times as many ascents, while so many maxima or more are
# expected beyond those that they have reached. Of a rough posterior, each draw may be near a
# maximum of its own.
EXPECTED_UNSEEN = 0.5
ROUNDS = 1, 2, 2


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

    At least ``n_searches`` times and twice, the target's earlier one included, from ``n_draws``
    prior draws each, of which ``n_ascents`` are climbed from at once. The first ones climb side by
    side.
    """
    alone = target.suggest_starts is None
    n_draws = n_draws or (DRAWS if alone else DRAWS_BESIDE_STARTS)
    n_ascents = n_ascents or (ASCENTS if alone else ASCENTS_BESIDE_STARTS)
    searches = _Searches(target, n_ascents)
    if target.known_starts is not None:
        possible = np.isfinite(target.log_likelihood(target.known_starts))
        if possible.any():
            searches.climb([(target.known_starts[:0], target.known_starts[possible])])
    seeds, n_made = seed.spawn(max(MOST_TIMES_WANTED * n_searches, 2)), 0
    while True:
        n_more = max(max(n_searches, 2) - searches.n, 1)
        starts = []
        for own_seed in seeds[n_made : n_made + n_more]:
            starts.append(search_starts(target, n_draws, np.random.default_rng(own_seed)))
            progress(min((searches.n + 0.5 * len(starts)) / n_searches, 1.0))
        searches.climb(starts)
        n_made += n_more
        progress(min(searches.n / n_searches, 1.0))
        if not len(searches.maxima.z):
            raise ValueError(
                f"the likelihood is zero at all of {n_made * n_draws} draws from the prior; "
                "are the priors, the pairing and the units those of the data?"
            )
        if not target.noise and target.is_noisy_at(searches.maxima.z):
            searches.climb_on()
        result = searches.agreement(n_made * n_draws)
        if result.converged or n_made == len(seeds):
            return result


class _Searches:
    """The maxima that independent searches found together, and where the ascents of each ended."""

    def __init__(self, target: Target, n_ascents: int) -> None:
        self.target, self.n_ascents, self.n = target, n_ascents, 0
        self.maxima = no_maxima(target.n_dimensions)
        self.z, self.log_posteriors = self.maxima.z, self.maxima.log_posteriors  # of ends, (N, d)
        self.numbers = np.empty(0, dtype=np.intp)  # of the search that an ascent is of, (N,)

    def climb(self, starts: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """From the highest draws and the suggested starts of each of some more searches.

        As many further ascents follow, from lower draws, while maxima are likely to be left.
        """
        begin = 0
        for end in self.n_ascents * np.cumsum(ROUNDS):
            highest = [draws[begin:end] for draws, _ in starts]
            suggested = [those if begin == 0 else those[:0] for _, those in starts]
            of_each = list(map(np.concatenate, zip(highest, suggested, strict=True)))
            if not any(map(len, of_each)) or (begin and self._are_likely_all):
                break
            begin = end
            z, log_posteriors = first_ascent(self.target, np.concatenate(of_each))
            self.maxima = maxima_near(self.target, z, log_posteriors, self.maxima)
            self.z = np.concatenate([self.z, z])
            self.log_posteriors = np.append(self.log_posteriors, log_posteriors)
            numbers = np.repeat(np.arange(len(starts)), [len(own) for own in of_each])
            self.numbers = np.append(self.numbers, self.n + numbers)
        self.n += len(starts)

    def climb_on(self) -> None:
        """From all ends, of a target that turned out to be noisy."""
        self.z, self.log_posteriors = first_ascent(self.target, self.z)
        none = no_maxima(self.target.n_dimensions)
        self.maxima = maxima_near(self.target, self.z, self.log_posteriors, none)

    @property
    def _are_likely_all(self) -> bool:
        """Whether few maxima are left to find, by how many the ascents met.

        Of w that n ascents reached, w (w + 1) / (n - w - 2) are expected to be left, if the sizes
        of basins are unknown (Boender and Rinnooy Kan 1987).
        """
        n_reached = int(_matter(self.maxima).sum())
        surplus = len(self.z) - n_reached - 2
        return surplus > 0 and n_reached * (n_reached + 1) < EXPECTED_UNSEEN * surplus

    def agreement(self, n_draws: int) -> MultistartSearch:
        """Which search reached which maximum by itself."""
        at = reached(self.target, self.maxima, self.z, self.log_posteriors)
        by = np.array([at[:, self.numbers == number].any(axis=1) for number in range(self.n)])
        return MultistartSearch(self.maxima, by, n_draws)


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
