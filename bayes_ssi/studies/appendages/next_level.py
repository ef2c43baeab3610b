"""Which hypotheses a search tries next: those with one more appendage than the best so far.

One appendage is tried everywhere. More are tried as long as the evidence grows: on the best
hypotheses, everywhere; and wherever the evidence that is to be expected gives the hypothesis a
noticeable probability. An appendage is expected to add what it adds alone, as it does where the two
act on different modes. Where both explain the same modes this is too much, which costs work alone;
an appendage that shows only next to another one is tried with the best, not with all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.screening import Key, ScreenedHypothesis

Hypotheses = Mapping[Key, ScreenedHypothesis]
Places = Mapping[str, Sequence[AppendagePlace]]
# The least expected probability of a hypothesis that is tried, and the most of these hypotheses.
LEAST_EXPECTED, MOST_EXPECTED = 1e-3, 300


class NextLevel(NamedTuple):
    """Hypotheses to try, and those of as many appendages that are not.

    Attributes:
        log_mass_not_tried: log of their expected evidences times prior weights, summed.
    """

    keys: list[Key]
    n_not_tried: int = 0
    log_mass_not_tried: float = -math.inf


def next_level(
    hypotheses: Hypotheses,
    places_of: Places,
    prior_weight: Callable[[str, int], float],
    most_appendages: int,
    branches: int,
) -> NextLevel:
    """Hypotheses with one more appendage; none where more are not considered, or do not help."""
    n = max(len(key.places) for key in hypotheses)
    if n == most_appendages:
        return NextLevel([])
    if n == 0:
        return NextLevel([Key(name, (place,)) for name in places_of for place in places_of[name]])
    best = _best(hypotheses, n)
    if _log_evidence(hypotheses, best[0]) <= _log_evidence(hypotheses, _best(hypotheses, n - 1)[0]):
        return NextLevel([])
    so_far = [each.approximate_log_mass.log_evidence for each in hypotheses.values()]
    known = float(logsumexp(so_far))
    tables = [
        _Expected(hypotheses, name, places, n, math.log(prior_weight(name, n + 1)) - known)
        for name, places in places_of.items()
        if len(places) > n
    ]
    chosen: dict[Key, float] = {}
    for table in tables:
        for parent in best[:branches]:
            chosen.update(table.extending(parent))
    likely = dict(item for table in tables for item in table.above(math.log(LEAST_EXPECTED)))
    for key in sorted(likely, key=lambda key: -likely[key])[:MOST_EXPECTED]:
        chosen[key] = likely[key]
    n_all = sum(math.comb(len(table.places), n + 1) for table in tables)
    if n_all == len(chosen):
        return NextLevel(list(chosen))
    left = sum(table.total for table in tables) - sum(map(math.exp, chosen.values()))
    return NextLevel(
        list(chosen), n_all - len(chosen), known + math.log(left) if left > 0.0 else -math.inf
    )


class _Expected:
    """Expected log masses of hypotheses on one baseline, with one more appendage than known.

    Attributes:
        log_masses: (n_parents, n_places), minus infinity where the place is taken.
    """

    def __init__(
        self,
        hypotheses: Hypotheses,
        name: str,
        places: Sequence[AppendagePlace],
        n: int,
        log_weight: float,
    ) -> None:
        self.name, self.places = name, places
        self.n_appendages = n + 1
        self.index = {place: i for i, place in enumerate(places)}
        self.parents = [key for key in hypotheses if key.baseline == name and len(key.places) == n]
        alone = np.array([_log_evidence(hypotheses, Key(name, (place,))) for place in places])
        gains = alone - _log_evidence(hypotheses, Key(name, ()))
        so_far = np.array([_log_evidence(hypotheses, parent) for parent in self.parents])
        self.log_masses: FloatArray = so_far[:, None] + gains + log_weight
        for row, parent in enumerate(self.parents):
            self.log_masses[row, [self.index[place] for place in parent.places]] = -math.inf

    @property
    def total(self) -> float:
        """The sum over all hypotheses, each of which extends as many as it has appendages."""
        return float(np.exp(self.log_masses).sum()) / self.n_appendages

    def extending(self, parent: Key) -> Iterator[tuple[Key, float]]:
        """The hypotheses that extend one known, and their expected log masses."""
        if parent.baseline == self.name:
            row = self.parents.index(parent)
            yield from self._items(row, np.flatnonzero(np.isfinite(self.log_masses[row])))

    def above(self, least: float) -> Iterator[tuple[Key, float]]:
        """The hypotheses whose expected log masses are above a bound."""
        for row in range(len(self.parents)):
            yield from self._items(row, np.flatnonzero(self.log_masses[row] > least))

    def _items(self, row: int, columns: NDArray[np.intp]) -> Iterator[tuple[Key, float]]:
        taken = [self.index[place] for place in self.parents[row].places]
        for column in columns.tolist():
            places = tuple(self.places[i] for i in sorted((*taken, column)))
            yield Key(self.name, places), float(self.log_masses[row, column])


def _best(hypotheses: Hypotheses, n: int) -> list[Key]:
    """The hypotheses with n appendages, by their evidence."""
    of_level = [key for key in hypotheses if len(key.places) == n]
    return sorted(of_level, key=lambda key: -_log_evidence(hypotheses, key))


def _log_evidence(hypotheses: Hypotheses, key: Key) -> float:
    return hypotheses[key].screened.log_evidence
