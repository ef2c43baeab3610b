"""Loads that are not stationary: a shock, which lasts less long than the motion that it leaves.

Lines of a band divided by the factors of their spectral matrices are white, and so is the history
that they give back, at one sample each 1 / (highest - lowest frequency). There a shock is as short
as its load, while the modes' decay is gone. Of a Gaussian record the power of w samples of n
sensors over its mean is a gamma variable of shape n w and mean one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.bayesian_fft import BandFit
from bayes_ssi.records.spectra import MOST_ENTRIES, Lines
from bayes_ssi.records.spectral_model import covariances

# Samples of a window; a window and its neighbours hold a shock wherever in it it is.
WINDOW = 4
# Where a record begins and ends it is cut off, which is like a shock: this share of it is left out.
END = 0.05
# Of stationary records, one in so many shows a shock by chance.
RARE = 1e6


class Shock(NamedTuple):
    """The strongest loads of a record, beyond chance.

    Attributes:
        time_s: when, from the beginning of the record.
        ratio: their power over its mean.
        frequencies_hz: (m,), of the modes.
        shares: (m,), of the power within each mode's half-power bandwidth.
        moved: (m,), by about how many standard deviations that could move each mode: the share
            times the square root of the lines in the bandwidth.
    """

    time_s: float
    ratio: float
    frequencies_hz: FloatArray
    shares: FloatArray
    moved: FloatArray

    def __str__(self) -> str:
        most = int(self.moved.argmax())
        share, moved = self.shares[most], self.moved[most]
        return (
            f"the loads about {self.time_s:.4g} s are {self.ratio:.3g} times as strong as on "
            f"average, which is no chance: they have {share:.0%} of the power of the mode at "
            f"{self.frequencies_hz[most]:.4g} Hz and may move it by {moved:.2g} standard "
            "deviations, since the spectral model takes loads to be stationary"
        )


def shock(fit: BandFit, lines: Lines) -> Shock | None:
    """The strongest loads of a record, if stationary loads are not so strong.

    Args:
        fit: the modes of the band.
        lines: of the record.
    """
    from scipy.stats import gamma

    history = _white_history(fit, lines)
    n, n_samples = history.shape
    first = round(END * n_samples)
    n_windows = (n_samples - 2 * first) // WINDOW
    end = first + n_windows * WINDOW
    history[:, :first], history[:, end:] = 0.0, 0.0
    windows = (np.abs(history[:, first:end]) ** 2).reshape(n, n_windows, WINDOW)
    powers = windows.sum((0, 2))
    ratios = powers / powers.mean()
    strongest = int(ratios.argmax())
    shape = n * WINDOW
    if ratios[strongest] < gamma.isf(1.0 / (RARE * n_windows), shape) / shape:
        return None
    middle = first + strongest * WINDOW + WINDOW // 2
    own = np.zeros_like(history)
    around = slice(max(0, middle - 3 * WINDOW // 2), middle + 3 * WINDOW // 2)
    own[:, around] = history[:, around]
    of_shock, of_all = ((np.abs(np.fft.fft(part, axis=1)) ** 2).sum(0) for part in (own, history))
    line_hz = 2.0 * float(lines.frequencies_hz[1] - lines.frequencies_hz[0])
    frequencies_hz = lines.frequencies_hz[0] + line_hz * np.arange(n_samples)
    frequencies, dampings, _ = fit.poles
    widths = dampings * frequencies
    near = np.abs(frequencies_hz - frequencies[:, None]) < widths[:, None]
    shares = (near @ of_shock) / (near @ of_all)
    return Shock(
        middle / (n_samples * line_hz),
        float(ratios[strongest]),
        frequencies,
        shares,
        shares * np.sqrt(2.0 * widths / line_hz),
    )


def _white_history(fit: BandFit, lines: Lines) -> ComplexArray:
    """The history (n, S) that the lines give back, each divided by the factor of its matrix.

    Differences of lines are those of the record under a sine, which ends softly; the history is
    divided by it.
    """
    tapered = lines.transforms[:, :-2] - lines.transforms[:, 2:]
    n, n_lines = tapered.shape
    for part in np.array_split(np.arange(n_lines), math.ceil(n_lines * n**2 / MOST_ENTRIES)):
        covariance = covariances(fit.model, lines.frequencies_hz[part + 1], fit.q)
        factors = np.linalg.cholesky(covariance)
        tapered[:, part] = np.linalg.solve(factors, tapered[:, part].T[..., None])[..., 0].T
    # Lines are those of the record padded to twice its length.
    n_samples = n_lines // 2
    history: ComplexArray = np.fft.ifft(tapered, axis=1)[:, :n_samples]
    return history / np.sin(np.pi * (np.arange(n_samples) + 0.5) / n_samples)
