"""The likelihood summed over all pairings of identified modes with model modes.

The pairing is inferred along with the parameters, and the order of model modes may change with
them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, row_sums
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import (
    InferredPairing,
    PairingWeights,
    inferred_pairing,
    log_sum,
    pair_probabilities,
    sample_pairings,
    thinned,
)

# The one datum of a test whose pairing is inferred.
ALL_MODES = "all modes"


@dataclass(frozen=True, eq=False)
class AnyPairing(ModalLikelihood):
    """The log-likelihood of identified modes, summed over all pairings with model modes.

    Its ``pairing`` is empty: the weights of all pairings are relative to the one in which every
    identified mode is spurious and every model mode missed. Of a joint covariance of the data it
    takes each mode's own part, of its frequency and its shape: errors of different modes count as
    independent, because the sum over pairings is one over products.
    """

    pairing_is_given = False

    def __post_init__(self) -> None:
        if self.error.is_correlated:
            raise ValueError(
                "pairing 'any' needs independent prediction errors, because the sum over pairings "
                "is one over products; give the pairing, or leave between_tests and "
                "between_modes at 0"
            )

    @cached_property
    def pairs(self) -> PairedModes:
        """Every pair of an identified mode and a model mode, grouped by identified mode."""
        numbers = range(1, self.structure.n_modes + 1)
        return PairedModes.of(
            self.data, [(label, i) for label in self.data.labels for i in numbers]
        )

    def _is_unpaired(self, values: FloatArray) -> NDArray[np.bool_]:
        return pair_probabilities(self.pairing_weights(values)).sum(axis=1) < 0.5

    @property
    def datum_names(self) -> tuple[str, ...]:
        return (ALL_MODES,)

    def log_likelihoods(self, values: FloatArray, modes: ComparedModes) -> FloatArray:
        """One column: a sum over pairings has no terms of single modes."""
        return self.log_density(values, modes)[:, None]

    def log_density(self, values: FloatArray, modes: ComparedModes | None = None) -> FloatArray:
        nothing_paired = -self.identification.expected_spurious_modes + self._spurious.sum()
        weights, missed = self._weights(values, modes)
        return nothing_paired + row_sums(missed) + log_sum(weights)

    def inferred_pairing(self, values: FloatArray) -> InferredPairing:
        values = thinned(values)
        return inferred_pairing(self.data.labels, self.pairing_weights(values))

    def sampled_pairs(
        self, values: FloatArray, modes: ComparedModes, rng: np.random.Generator
    ) -> NDArray[np.intp]:
        chosen = sample_pairings(self.pairing_weights(values, modes), rng)
        first = self.structure.n_modes * np.arange(len(self.data.labels))
        return np.where(chosen < 0, -1, first + chosen)

    def pairing_weights(
        self, values: FloatArray, modes: ComparedModes | None = None
    ) -> PairingWeights:
        """The weights of all pairs at ``values`` (B, n_parameters)."""
        return self._weights(values, modes)[0]

    def _weights(
        self, values: FloatArray, modes: ComparedModes | None = None
    ) -> tuple[PairingWeights, FloatArray]:
        """Weights of pairs, and log probabilities (B, I) that a model mode is missed."""
        modes = self.compared_modes(values) if modes is None else modes
        terms = self.terms(values, modes)
        paired, missed = terms.frequency, terms.missed
        paired[:, self.pairs.with_shape] += terms.shape
        if self.joint_pairs is not None:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                paired += self.joint_pairs.log_ratios(*self.residuals(values, modes))
        paired = paired.reshape(len(values), len(self.data.modes), missed.shape[1])
        log_ratios = paired - self._spurious[:, None] - missed[:, None, :]
        return PairingWeights(log_ratios, self.data.frequencies_hz, modes.frequencies_hz), missed

    @cached_property
    def _unpaired_model_modes(self) -> list[int]:
        """All of them, which is what weights are relative to."""
        return list(range(self.structure.n_modes))

    @cached_property
    def _spurious(self) -> FloatArray:
        return np.array([self.log_spurious(mode) for mode in self.data.modes])
