"""Does a mode rise and fall as under random loads, or keep the amplitude of a machine?

A machine whose speed wanders makes a peak as wide as its speeds, which a mode explains. Random
loads make the power p of a mode's coordinate vary as that of Gaussian noise; a machine's stays.
In a band of lines X_k, of powers a_k, the relative variance of p over time is

    c = 2 Σ_l |R_l|² / R_0²,    R_l = Σ_k X_k X̄_{k+l},    l > 0.

Lines of Gaussian noise have independent phases, whatever their powers, so that c then has the mean
2 Σ_l r_l / r_0², with r_l = Σ_k a_k a_{k+l} and r_0 = (Σ a_k)², and about the variance
4 Σ_l r_l² / r_0²: |R_l|² are nearly independent, and exponential.
"""

import math

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray
from bayes_ssi.measurements.records.spectra import Resonances, Transforms
from bayes_ssi.structures.modal import mac

REACH, LEAST_REACH = 4.0, 0.01  # of a band, in half widths of its mode and as a share of frequency
ALIKE = 0.9  # MAC of modes by which one machine is explained
FEWEST_LINES = 4
# Of ln c below that of its mean: of 1,000 motions under random loads, of 4, 15 or 100 lines each,
# none is beyond (tests/records/test_steady_amplitudes.py).
MOST_SDS = 5.0


def steady_modes(transforms: Transforms, modes: Resonances) -> list[int]:
    """Places of the modes of a band whose amplitude is too steady for random loads."""
    f = modes.frequencies_hz
    reach = np.maximum(REACH * modes.half_widths_hz, LEAST_REACH * f)
    near = np.abs(f[:, None] - f) < reach[:, None] + reach
    alike = near & (mac(modes.shapes, modes.shapes) > ALIKE)
    steady = []
    for i, (same, beside) in enumerate(zip(alike, near, strict=True)):
        others, own = modes.shapes[:, beside & ~same], modes.shapes[:, i]
        own = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
        low, high = (f - reach)[same].min(), (f + reach)[same].max()
        at_hz = transforms.frequencies_hz
        inside = np.flatnonzero((at_hz > low) & (at_hz < high))[::2]
        if len(inside) >= FEWEST_LINES:
            ratio, sd = variation(own.conj() @ transforms.values[:, inside])
            steady += [i] if math.log(ratio) < -MOST_SDS * sd else []
    return steady


def variation(lines: ComplexArray) -> tuple[float, float]:
    """c of some lines (L,) over its mean under random loads, and the standard deviation of that."""
    n = len(lines)
    of_powers = np.abs(np.fft.fft(np.abs(lines) ** 2, 2 * n)) ** 2
    expected = np.fft.ifft(of_powers).real[1:n]
    correlations = np.fft.ifft(np.abs(np.fft.fft(lines, 2 * n)) ** 2)[1:n]
    total = expected.sum()
    ratio = (np.abs(correlations) ** 2).sum() / total
    return float(ratio), float(np.sqrt((expected**2).sum()) / total)
