"""Spectral matrices around a few modes, in the directions in which the sensors move together.

Channels are scaled by the part of their power that no other channel explains, which is their noise
or less; the leading real directions of what is left hold all that modes do. The few coordinates
are such that the quiet part of the band has the unit matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.spectra import Spectra

# Share of the blocks that is quiet.
QUIET = 1.0 / 3.0
# Added to every direction, as shares of its own quiet power and of that of all: a background that
# vanishes in some direction would explain blocks of few lines without bound.
OWN_FLOOR, COMMON_FLOOR = 0.1, 0.001


class LocalSpectra(NamedTuple):
    """Spectral matrices of K blocks in r directions of n channels.

    Attributes:
        frequencies_hz: (K,), centres of the blocks.
        widths_hz: (K,), of the blocks.
        weights: (K,), independent transforms of each.
        matrices: (K, r, r).
        floor: (r,), added to the diagonal in fits.
        to_channels: (n, r), what the channels measure of each direction.
        from_channels: (r, n), the directions of what channels measure.
        rest: (K, n - r, r), cross spectra of all other directions, of unit noise, with these.
        rest_to_channels: (n, n - r).
    """

    frequencies_hz: FloatArray
    widths_hz: FloatArray
    weights: FloatArray
    matrices: ComplexArray
    floor: FloatArray
    to_channels: FloatArray
    from_channels: FloatArray
    rest: ComplexArray
    rest_to_channels: FloatArray

    @property
    def band_hz(self) -> tuple[float, float]:
        """From where to where the blocks reach."""
        half = 0.5 * self.widths_hz
        return float(self.frequencies_hz[0] - half[0]), float(self.frequencies_hz[-1] + half[-1])

    @property
    def line_hz(self) -> float:
        """Width in Hz of one independent transform."""
        return float(self.widths_hz.sum() / self.weights.sum())


def noise_scales(spectra: Spectra) -> FloatArray:
    """Root of the power (n,) of each channel that no other channel explains."""
    weights = spectra.weights / spectra.weights.sum()
    mean = np.einsum("k,kij->ij", weights, spectra.matrices)
    powers = np.maximum(mean.diagonal().real, np.finfo(float).tiny)
    roots = np.sqrt(powers)
    n, n_lines = len(mean), float(spectra.weights.sum())
    # Fewer lines than channels explain everything.
    ridge = 1e-9 + (n / n_lines if n_lines < 2.0 * n else 0.0)
    coherence = mean / roots / roots[:, None] + ridge * np.eye(n)
    partial = 1.0 / np.linalg.inv(coherence).diagonal().real
    return np.asarray(roots * np.sqrt(partial.clip(1e-9, 1.0)), dtype=np.float64)


def local_spectra(spectra: Spectra, n_directions: int) -> LocalSpectra:
    """The spectra in their leading directions."""
    scales = noise_scales(spectra)
    scaled = spectra.matrices / scales / scales[:, None]
    mean = np.einsum("k,kij->ij", spectra.weights, scaled.real) / spectra.weights.sum()
    vectors = np.linalg.eigh(mean)[1][:, ::-1]
    r = min(n_directions, len(scales))
    leading, others = vectors[:, :r], vectors[:, r:]
    powers = np.einsum("kii->k", scaled).real
    quiet = np.argsort(powers, kind="stable")[: max(1, round(QUIET * len(powers)))]
    background = scaled[quiet].real.mean(0)
    values, turns = np.linalg.eigh(leading.T @ background @ leading)
    values = values.clip(1e-9 * values[-1])
    floored = (1.0 + OWN_FLOOR) * values + COMMON_FLOOR * values.mean()
    roots = np.sqrt(floored)
    noise = np.sqrt(np.einsum("ia,ij,ja->a", others, background, others).clip(1e-9))
    from_scaled = (leading @ turns / roots).T
    rest_from_scaled = (others / noise).T
    return LocalSpectra(
        spectra.frequencies_hz,
        spectra.widths_hz,
        spectra.weights,
        from_scaled @ scaled @ from_scaled.T,
        1.0 - values / floored,
        scales[:, None] * (leading @ turns * roots),
        from_scaled / scales,
        rest_from_scaled @ scaled @ from_scaled.T,
        scales[:, None] * (others * noise),
    )
