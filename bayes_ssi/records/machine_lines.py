"""Lines of machines: motion at one frequency, which a record of any length shows in one line.

Of a stationary Gaussian record the power at a line, over its mean nearby, is exponential, and its
mean is that of m lines: the ratio exceeds r with probability (1 + r/m)^-m. A sine stands out from
both the lines next to it and those around; a resonance is at least a few lines wide.
"""

from __future__ import annotations

import numpy as np

from bayes_ssi.arrays import FloatArray

# Lines to either side: those that a Hann window spreads a sine over, those next to it, and around.
SPREAD, NEXT, AROUND = 2, 6, 22
# Of sound records, one in so many shows a line by chance; more where damping is light.
RARE = 1e6


def machine_lines(samples: FloatArray, rate_hz: float) -> list[str]:
    """A sentence for each frequency at which a machine seems to run.

    Args:
        samples: (n, N).
        rate_hz: samples per second.
    """
    n_samples = samples.shape[1]
    if n_samples < 20 * AROUND:
        return []
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_samples) / n_samples)
    found: dict[int, float] = {}
    for row in samples:
        power = np.abs(np.fft.rfft(window * (row - row.mean()))) ** 2
        # Windowed neighbours are alike: half of the lines count.
        near = _ratios(power, SPREAD, NEXT)
        ratios = np.minimum(
            _ratios(power, SPREAD, AROUND) / _limit(len(power) * len(samples), AROUND - SPREAD),
            near / _limit(1.0, NEXT - SPREAD),
        )
        ratios[:AROUND] = 0.0  # a drift is no machine
        for line in np.flatnonzero(ratios > 1.0).tolist():
            found[line] = max(found.get(line, 0.0), float(ratios[line]))
    strongest: list[int] = []
    for line in sorted(found, key=lambda each: -found[each]):
        if all(abs(line - other) > SPREAD for other in strongest):
            strongest.append(line)
    return [
        f"a line at {line * rate_hz / n_samples:.5g} Hz, as of a machine; a mode so narrow would "
        "have decayed less than once over the record"
        for line in sorted(strongest)
    ]


def _ratios(power: FloatArray, inner: int, outer: int) -> FloatArray:
    """Power of each line over the mean of lines more than ``inner`` and up to ``outer`` away."""
    sums = np.concatenate([[0.0], np.cumsum(power)])
    line = np.arange(len(power))

    def total(reach: int) -> tuple[FloatArray, FloatArray]:
        low, high = np.maximum(line - reach, 0), np.minimum(line + reach + 1, len(power))
        return sums[high] - sums[low], (high - low).astype(float)

    (wide, n_wide), (narrow, n_narrow) = total(outer), total(inner)
    means = (wide - narrow) / (n_wide - n_narrow)
    ratios: FloatArray = power / np.maximum(means, np.finfo(float).tiny)
    return ratios


def _limit(n_lines: float, m: int) -> float:
    return m * ((RARE * n_lines) ** (1.0 / m) - 1.0)
