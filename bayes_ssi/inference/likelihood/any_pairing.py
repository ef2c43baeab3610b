"""The likelihood where the pairing is inferred along with the parameters: a sum over all pairings.

The order of model modes may change with the parameters, and the pairing with it.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices, row_sums
from bayes_ssi.inference.likelihood.close_modes import CloseCases, ClosePairs, relative_distances
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import (
    MOST_DRAWS,
    InferredPairing,
    PairingWeights,
    inferred_pairing,
    log_sum,
    pair_probabilities,
    sample_pairings,
)
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser

# The one datum of a test whose pairing is inferred.
ALL_MODES = "all modes"
# An identified mode turns with no model mode that it is with less than exp(this) of the weight of
# being spurious, however alike their shapes.
NEGLIGIBLE_WEIGHT = -9.0
# The same of shapes that fit no better than they can at any turn: leaving out a larger share is a
# step in the likelihood, at which ascents stop early.
LEAST_WEIGHT = 2.0 * NEGLIGIBLE_WEIGHT
NEVER = 1e-9  # probability


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
        pairs = [(label, i) for label in self.data.labels for i in numbers]
        return PairedModes.of(self.data, pairs, self.structure.shape_variances)

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
        values = values[evenly_spaced_indices(len(values), MOST_DRAWS)]
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
        weights = PairingWeights(
            log_ratios, self.data.frequencies_hz, modes.frequencies_hz, log_gains=modes.log_gains
        )
        return weights, missed

    @cached_property
    def _observed_distances(self) -> FloatArray:
        """The least distance of two identified modes, whichever model modes they are."""
        hz = self.data.frequencies_hz
        apart = relative_distances(hz[:, None], hz)[~np.eye(len(hz), dtype=bool)]
        return np.full(self.structure.n_modes - 1, apart.min(initial=np.inf))

    def _most_log_weights(self, close: ClosePairs, frequencies_hz: FloatArray) -> FloatArray:
        """Largest possible log weights of identified modes as the two of a close pair, (C, 2, J).

        With shapes equal to the model's.
        """
        model_hz = frequencies_hz[close.rows[:, None], close.lower[:, None] + [0, 1]]
        own = np.square([mode.frequency_cov or 0.0 for mode in self.data.modes])
        variances = close.variances[:, :1, None] + own
        residuals = model_hz[:, :, None] / self.data.frequencies_hz - 1.0
        detected = self.identification.detection_probability
        odds = math.log(detected / max(1.0 - detected, NEVER))
        d = max(mode.n_measured for mode in self.data.modes)
        alike = -log_shape_normaliser(np.sqrt(close.variances[:, 1]), d)[:, None, None]
        most = odds + alike - np.log(self.data.frequencies_hz) - self._spurious
        terms = residuals**2 / variances + np.log(2.0 * math.pi * variances)
        return np.asarray(most - 0.5 * terms)

    def _cases(self, close: ClosePairs, frequencies_hz: FloatArray) -> CloseCases:
        """Each identified shape by itself, as the only one of a pair that is identified."""
        most = self._most_log_weights(close, frequencies_hz)
        near = most > NEGLIGIBLE_WEIGHT
        near &= (self._columns[:, 0] >= 0) & close.turn_alone[:, None, None]
        pair, upper, j = np.nonzero(near)
        columns = self._columns[j, close.lower[pair] + upper]
        least = LEAST_WEIGHT - most[near]
        return CloseCases(pair, columns[None], upper[None] > 0, np.full(len(pair), np.nan), least)

    @cached_property
    def _columns(self) -> NDArray[np.intp]:
        """Column (J, n_modes) among shapes of an identified one as a model mode; -1 if none."""
        columns = np.full(len(self.pairs.modes), -1)
        columns[self.pairs.with_shape] = range(len(self.pairs.with_shape))
        return columns.reshape(-1, self.structure.n_modes)

    def _log_gains(
        self, close: ClosePairs, shapes: FloatArray, compared: ComparedModes
    ) -> FloatArray:
        frequencies_hz, distances, turned, unit, _ = compared
        n, hz = len(self.data.modes), self.data.frequencies_hz
        most = self._most_log_weights(close, frequencies_hz)
        near = most > NEGLIGIBLE_WEIGHT
        pair, j, k = np.nonzero(near[:, 0, :, None] & near[:, 1, None] & ~np.eye(n, dtype=bool))
        turns = np.isfinite(close.concentrations(relative_distances(hz[j], hz[k]), pair))
        some = turns | close.turn_alone[pair]
        pair, j, k = pair[some], j[some], k[some]
        columns = np.array([self._columns[i, close.lower[pair] + u] for u, i in enumerate((j, k))])
        observed = relative_distances(hz[j], hz[k])
        least = LEAST_WEIGHT - most[pair, 0, j] - most[pair, 1, k]
        cases = CloseCases(pair, columns, np.array([[False], [True]]), observed, least)
        mean = self._mean_over_turns(close, cases, shapes)
        rows, variances = close.rows[pair], self._shapes_or_none[2][columns]
        alone = turned[rows, columns] - distances[rows, columns] / (
            close.variances[pair, 1] + variances
        )
        gains = np.zeros((len(shapes), self.structure.n_modes - 1, n, n))
        more = mean.log_means - np.where(columns < 0, 0.0, alone).sum(axis=0)
        if self.joint_pairs is not None:
            # Their joint density was that of each shape turned by itself.
            together = cases.turned(close, shapes, mean.angles)
            by_themselves = unit.reshape(*distances.shape, -1)
            for u in (0, 1):
                scored = np.flatnonzero(columns[u] >= 0)
                of, row, which = columns[u, scored], rows[scored], pair[scored]
                frequencies = frequencies_hz[row, close.lower[which] + u]
                after, before = (
                    self.joint_pairs.ratios_of_shapes(of, frequencies, each, close.variances[which])
                    for each in (
                        self.pairs.unit_shapes_like(of, together[:, u, scored]),
                        by_themselves[row, of],
                    )
                )
                more[scored] += after - before
        gains[rows, close.lower[pair], j, k] = more
        return gains

    @cached_property
    def _unpaired_model_modes(self) -> list[int]:
        """All of them, which is what weights are relative to."""
        return list(range(self.structure.n_modes))

    @cached_property
    def _spurious(self) -> FloatArray:
        return np.array([self.log_spurious(mode) for mode in self.data.modes])
