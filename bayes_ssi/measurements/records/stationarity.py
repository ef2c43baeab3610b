"""Which parts of a record are stationary: without quakes, shocks and bursts.

A spectral model takes loads to be the same all the time. The motion of a band in short windows is
compared with its median: where it is many times as strong, those windows are left out, with what
follows until it has decayed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.identification_settings import CHECKS
from bayes_ssi.measurements.records.record import Record


class Stationary(NamedTuple):
    """The stationary part of a record."""

    # (N,) factors of the samples, 0 where they are left out; None if nothing is.
    mask: FloatArray | None
    spans_s: tuple[tuple[float, float], ...]
    varies: float


# Where what drives the structure is measured, all of a record is used.
EVERYTHING = Stationary(None, (), 1.0)


def stationary_part(record: Record, band_hz: tuple[float, float]) -> Stationary:
    """The stationary part, as the motion of a band shows it."""
    from scipy.fft import irfft, rfft

    n, rate = record.n_samples, record.rate_hz
    low, high = band_hz
    frequencies = np.fft.rfftfreq(n, 1.0 / rate)
    passed = (frequencies > low) & (frequencies < high)
    length = max(1, min(round(CHECKS.window_periods * rate / low), n // CHECKS.fewest_windows))
    n_windows = n // length
    powers = np.zeros(n_windows)
    for row in record.samples:
        motion = irfft(np.where(passed, rfft(row - row.mean()), 0.0), n)
        own = (motion[: n_windows * length].reshape(n_windows, length) ** 2).mean(1)
        powers += own / max(float(np.median(own)), np.finfo(float).tiny)
    powers /= np.median(powers)
    out = powers > CHECKS.strong_power
    for _ in range(n_windows):  # until what was set in motion has decayed
        beside = np.zeros_like(out)
        beside[1:] |= out[:-1]
        beside[:-1] |= out[1:]
        wider = out | (beside & (powers > CHECKS.decayed_power))
        if (wider == out).all():
            break
        out = wider
    if not out.any() or out.mean() > CHECKS.most_left_out:
        return Stationary(None, (), float(powers.max()))
    mask = np.ones(n)
    spans = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], out.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        # Flanks of one window; the last window holds the rest of the record.
        start, end = first * length, n if last == n_windows else last * length
        mask[start:end] = 0.0
        flank = np.sin(0.5 * np.pi * (np.arange(length) + 0.5) / length) ** 2
        before = mask[max(0, start - length) : start]
        before[:] = np.minimum(before, flank[::-1][-len(before) :] if len(before) else before)
        after = mask[end : end + length]
        after[:] = np.minimum(after, flank[: len(after)])
        spans.append((start / rate, end / rate))
    return Stationary(mask, tuple(spans), float(powers[~out].max()))
