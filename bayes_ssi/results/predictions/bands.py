"""Draws of a predicted quantity, and credible bands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted


class Band(NamedTuple):
    """A central interval at every point of a prediction, and the median."""

    low: FloatArray
    median: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Displayed):
    """Draws of a predicted quantity, equally weighted.

    Attributes:
        draws: (n_draws, ...).
        share: of the draws that predict the quantity at all; below 1 where some classes do not
            explain an identified mode.
    """

    draws: FloatArray
    share: float = 1.0

    def band(self, level: float = 0.95) -> Band:
        """The central interval that holds ``level`` of the draws, point by point.

        Raises:
            ValueError: the level is not strictly between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"band: level must lie strictly between 0 and 1, got {level!r}")
        levels = [0.5 * (1.0 - level), 0.5, 0.5 * (1.0 + level)]
        flat = self.draws.reshape(len(self.draws), -1)
        # In parts that the processor's cache holds, np.quantile takes a third of the time.
        n_parts = -(-flat.size // 1_000_000)
        parts = [
            np.quantile(part, levels, axis=0) for part in np.array_split(flat, n_parts, axis=1)
        ]
        return Band(*np.concatenate(parts, axis=1).reshape(3, *self.draws.shape[1:]))

    def _line(self) -> str:
        return f"{counted(len(self.draws), 'draw')} of shape {self.draws.shape[1:]}"

    def _rows(self) -> list[dict[str, Any]]:
        bands = zip(*(part.ravel().tolist() for part in self.band(0.9)), strict=True)
        return [dict(zip(("5 %", "median", "95 %"), band, strict=True)) for band in bands]
