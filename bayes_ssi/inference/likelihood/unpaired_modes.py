"""Modes of one side alone: model modes that were missed, and identified modes that are spurious."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_model import IdentificationModel
from bayes_ssi.inference.likelihood.shape_density import log_sphere_area
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData


@dataclass(frozen=True, eq=False)
class UnpairedModes:
    """The terms of a likelihood that belong to modes without a counterpart."""

    data: ModalData
    identification: IdentificationModel

    def log_missed(
        self, frequencies_hz: FloatArray, prediction_var: FloatArray, which: Sequence[int]
    ) -> FloatArray:
        """log(1 - p_D P_in), (B, len(which)): log probability that these model modes are missed.

        Args:
            frequencies_hz: (B, n_modes), of all model modes.
            prediction_var: (B, 1), squared prediction errors of frequencies.
            which: of the model modes, from 0.
        """
        if not which:
            return np.zeros((len(frequencies_hz), 0))
        low, high = self.data.band_hz
        frequencies = frequencies_hz.T[which].T
        sd = np.sqrt(prediction_var + self._typical_frequency_var) * frequencies
        inside = ndtr((high - frequencies) / sd) - ndtr((low - frequencies) / sd)
        return np.log1p(-self.identification.detection_probability * inside)

    def near_a_limit(
        self, frequencies_hz: FloatArray, prediction_var: FloatArray, which: Iterable[int]
    ) -> NDArray[np.bool_]:
        """Whether model modes are within two standard errors of a limit other than zero.

        Arguments are as for :meth:`log_missed`; false (B, n_modes) for modes not in ``which``.
        """
        reach = 2.0 * np.sqrt(prediction_var + self._typical_frequency_var) * frequencies_hz
        limits = [limit for limit in self.data.band_hz if limit > 0]
        near = np.zeros(frequencies_hz.shape, dtype=bool)
        for mode in which:
            for limit in limits:
                near[:, mode] |= np.abs(frequencies_hz[:, mode] - limit) < reach[:, mode]
        return near

    def log_spurious(self, mode: IdentifiedMode) -> float:
        """The log density of an identified mode that belongs to no model mode."""
        low, high = self.data.band_hz
        density = math.log(self.identification.expected_spurious_modes / (high - low))
        return density - (log_sphere_area(mode.n_measured) if mode.scored_shape is not None else 0)

    @cached_property
    def _typical_frequency_var(self) -> float:
        """Squared identification error assumed for modes that were not identified."""
        return float(np.mean([(mode.frequency_cov or 0.0) ** 2 for mode in self.data.modes]))
