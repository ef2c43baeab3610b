"""Residuals of identified modes whose pairing with model modes changes from point to point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.any_pairing import AnyPairing
from bayes_ssi.inference.likelihood.error_model import ErrorModel
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import sample_pairings
from bayes_ssi.structures.modal import Modes


class PairedResiduals:
    """Residuals of one configuration's J identified modes, S of them with a shape that is scored.

    Each is paired with a model mode or none. Where the pairing is given, only its modes count.
    """

    def __init__(self, likelihood: ModalLikelihood) -> None:
        self.likelihood = likelihood
        self.inferred = likelihood if isinstance(likelihood, AnyPairing) else None
        labels = likelihood.data.labels if self.inferred else tuple(likelihood.pairing)
        # Mode j of the chosen model modes belongs to identified mode j.
        self.pairs = PairedModes.of(likelihood.data, ((x, j) for j, x in enumerate(labels, 1)))
        self.given = np.array(list(likelihood.pairing.values()), dtype=np.intp) - 1
        self.n_identified = len(labels)

    def residuals(
        self, modes: Modes, chosen: NDArray[np.intp], errors: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Residuals over ``errors``, (B, m), where identified mode j is model mode ``chosen``.

        Zero where it is -1, for a spurious mode.
        """
        n = len(chosen)
        column = np.maximum(chosen, 0)
        frequencies = np.take_along_axis(modes.frequencies_hz, column, axis=1)
        paired = chosen >= 0
        of_frequencies = self.pairs.frequency_residuals(frequencies) / errors[0]
        parts = [np.where(paired, of_frequencies, 0.0)]
        if len(self.pairs.with_shape):
            shapes = self.likelihood.shapes_at_sensors(modes)
            shapes = np.take_along_axis(shapes, column[:, None, :], axis=2)
            of_shapes = self.pairs.shape_differences(shapes) / errors[1][:, None, :]
            of_shapes = np.where(paired[:, None, self.pairs.with_shape], of_shapes, 0.0)
            parts.append(of_shapes.reshape(n, -1))
        return np.concatenate(parts, axis=1)

    def errors(self, values: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Errors of frequencies (B, J) and shapes (B, S), their own and ``width`` together."""
        sizes = self.likelihood.errors.of_pairs(values)
        # With any pairing the pairs of an identified mode with all model modes follow each other.
        step = self.likelihood.structure.n_modes if self.inferred else 1
        frequency, shape = (np.sqrt(size[:, ::step] ** 2 + width**2) for size in sizes)
        return frequency, shape

    def given_pairings(self, n: int) -> NDArray[np.intp]:
        """The given pairing for each of n rows, (n, J)."""
        return np.tile(self.given, (n, 1))

    def pairings(
        self,
        values: FloatArray,
        modes: Modes,
        width: float,
        considered: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> NDArray[np.intp]:
        """A pairing (B, J) for each row, of the considered modes (B, J); -1 for spurious modes."""
        likelihood = self.inferred
        if likelihood is None:
            return self.given_pairings(len(values))
        compared = likelihood.compared_modes(values, modes)
        if width > 0.0:
            likelihood = replace(likelihood, error=ErrorModel(width, width))
        weights = likelihood.pairing_weights(values, compared)
        log_ratios = np.where(considered[:, :, None], weights.log_ratios, -np.inf)
        return sample_pairings(replace(weights, log_ratios=log_ratios), rng)

    def with_pair(
        self,
        values: FloatArray,
        modes: Modes,
        chosen: NDArray[np.intp],
        identified: NDArray[np.intp],
        width: float,
        rng: np.random.Generator,
    ) -> NDArray[np.intp]:
        """The pairings ``chosen`` (B, J) with one more mode (B,) of each row, paired at random.

        In proportion to the weights of pairs if all errors were of this width.
        """
        likelihood = self.inferred
        assert likelihood is not None
        compared = likelihood.compared_modes(values, modes)
        wide = replace(likelihood, error=ErrorModel(width, width))
        rows = np.arange(len(values))
        log_weights = wide.pairing_weights(values, compared).log_ratios[rows, identified]
        row, column = np.nonzero(chosen >= 0)
        log_weights[row, chosen[row, column]] = -np.inf
        extended = chosen.copy()
        extended[rows, identified] = (log_weights + rng.gumbel(size=log_weights.shape)).argmax(1)
        return extended
