"""Posterior probabilities of the pairings of identified modes with model modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.pairings import (
    PairingWeights,
    log_sum,
    pair_probabilities,
    sample_pairings,
)

MAX_DRAWS = 1000
# Pairings less probable than a tenth of one draw are not listed.
LEAST_PROBABILITY = 0.1 / MAX_DRAWS


@dataclass(frozen=True)
class PairingShare:
    """One pairing and its posterior probability.

    Attributes:
        pairing: label of an identified mode → number of the model mode, from 1; modes that are
            left out are spurious.
    """

    pairing: Mapping[str, int]
    probability: float


@dataclass(frozen=True)
class InferredPairing:
    """Posterior probabilities of pairings of identified with model modes.

    Attributes:
        of_modes: label of an identified mode → number of a model mode, from 1, or 0 for spurious
            → probability. Probabilities below 0.0001 are left out.
    """

    pairings: tuple[PairingShare, ...]
    of_modes: Mapping[str, Mapping[int, float]]

    @property
    def best(self) -> Mapping[str, int]:
        """The most probable pairing."""
        return self.pairings[0].pairing

    def probability(self, pairing: Mapping[str, int]) -> float:
        """The probability of one pairing; 0 where it is not listed."""
        shares = (share for share in self.pairings if dict(share.pairing) == dict(pairing))
        return next((share.probability for share in shares), 0.0)


def thinned(values: FloatArray) -> FloatArray:
    """At most ``MAX_DRAWS`` of equally weighted draws (n, n_parameters)."""
    if len(values) <= MAX_DRAWS:
        return values
    return values[np.linspace(0, len(values) - 1, MAX_DRAWS).astype(np.intp)]


def inferred_pairing(labels: Sequence[str], weights: PairingWeights) -> InferredPairing:
    """Pairings of identified modes by their probability, averaged over posterior draws."""
    # Random pairings show which ones matter; the probability of each is exact at every draw.
    drawn = np.unique(sample_pairings(weights, np.random.default_rng(0)), axis=0)
    total = log_sum(weights)
    shares = []
    for pairing in drawn:
        paired = np.flatnonzero(pairing >= 0)
        log_weight = weights.log_ratios[:, paired, pairing[paired]].sum(axis=1)
        numbers = {labels[j]: int(pairing[j]) + 1 for j in paired.tolist()}
        shares.append(PairingShare(numbers, float(np.exp(log_weight - total).mean())))
    shares.sort(key=lambda share: -share.probability)
    kept = [share for share in shares if share.probability >= LEAST_PROBABILITY][:10]
    of_pairs = pair_probabilities(weights).mean(axis=0)
    with_spurious = np.column_stack([1.0 - of_pairs.sum(axis=1), of_pairs])
    return InferredPairing(
        tuple(kept or shares[:1]),
        {
            label: {
                number: float(probability)
                for number, probability in enumerate(row)
                if probability >= LEAST_PROBABILITY
            }
            for label, row in zip(labels, with_spurious, strict=True)
        },
    )
