"""What disturbs a record: lines of machines, and quakes, shocks and bursts.

Machines run at sines, which a record of any length shows in one line, and all through it.
At a sine the transforms z of a few sensors stand out of their spectral matrix G nearby: for
stationary motion, zᴴ G⁻¹ z with G the mean of m lines is m n / (m - n + 1) times a variable of
Fisher's F(2 n, 2 (m - n + 1)). What sensors do together, as under ground motion, does not hide a
sine that they share in other proportions. A resonance is at least a few lines wide, and its phase
wanders; a shock is over soon. A sine has one phase in all parts of the record.

A spectral model takes loads to be the same all the time. The motion of a band in short windows is
compared with its median: where it is many times as strong, those windows are left out, with what
follows until it has decayed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.identification_settings import CHECKS, MACHINE_LINES

# Lines to either side over which a Hann window spreads a sine.
HANN_SPREAD = 2


def machine_lines(samples: FloatArray, rate_hz: float) -> FloatArray:
    """Frequencies in Hz at which machines seem to run, the strongest first.

    They are right to some hundredths of a line (1 / duration) for the weakest, and better for
    stronger ones. Modes with ζ f T below 1, T the duration, look the same.
    """
    n_samples = samples.shape[1]
    found: list[tuple[float, float]] = []
    if n_samples >= 20 * MACHINE_LINES.lines_around:
        for group in np.array_split(
            samples, -(-len(samples) // MACHINE_LINES.sensors_together) or 1
        ):
            found += _lines_of(group[np.ptp(group, axis=1) > 0.0])
    strongest: list[float] = []
    for _, line in sorted(found, reverse=True):
        if all(abs(line - other) > HANN_SPREAD for other in strongest):
            strongest.append(line)
    return np.array(strongest) * rate_hz / n_samples


def _lines_of(samples: FloatArray) -> list[tuple[float, float]]:
    """Share of the power, and frequency in lines, of the sines in a few sensors, which move."""
    from scipy.stats import f as fisher

    n, n_samples = samples.shape
    if not n:
        return []
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_samples) / n_samples)
    samples = samples - samples.mean(1, keepdims=True)
    transforms = np.fft.rfft(window * samples)
    powers = np.abs(transforms) ** 2
    # Of a sine's power in a Hann window two thirds are in its line; a drift is no machine.
    around = MACHINE_LINES.lines_around
    shares = (1.5 * powers / powers[:, around:].sum(1, keepdims=True)).max(0)
    lines = np.flatnonzero(shares > 0.5 * MACHINE_LINES.least_amplitude**2)
    lines = lines[(lines >= around) & (lines < len(shares) - around)]
    if not len(lines):
        return []
    ratios, directions = _standing_out(transforms, lines)
    m = around - HANN_SPREAD  # windowed neighbours are alike: half of the lines count
    one_in = MACHINE_LINES.records_per_chance_line * len(lines)
    chance = fisher.isf(1.0 / one_in, 2 * n, 2 * (m - n + 1))
    found = []
    for k in np.flatnonzero(ratios > m * n / (m - n + 1) * chance):
        line, direction = int(lines[k]), directions[k].conj()
        before, here, after = np.abs(direction @ transforms[:, line - 1 : line + 2])
        if here < max(before, after):
            continue
        # Exact for a sine in a Hann window.
        beside = max(before, after) / here
        refined = line + (2.0 * beside - 1.0) / (1.0 + beside) * (1 if after > before else -1)
        if _coherence(direction @ samples, refined) > MACHINE_LINES.coherent_share:
            found.append((float(shares[line]), refined))
    return found


def _standing_out(
    transforms: ComplexArray, lines: NDArray[np.intp]
) -> tuple[FloatArray, ComplexArray]:
    """zᴴ G⁻¹ z of lines (L,), and G⁻¹ z (L, n)."""
    farthest = MACHINE_LINES.lines_around
    nearby = np.setdiff1d(
        np.arange(-farthest, farthest + 1), np.arange(-HANN_SPREAD, HANN_SPREAD + 1)
    )
    around = transforms[:, lines[:, None] + nearby].swapaxes(0, 1)
    matrices = around @ around.conj().swapaxes(1, 2) / len(nearby)
    # Sensors may be copies: their difference is then no motion.
    matrices += 1e-6 * np.eye(len(transforms)) * np.einsum("kii->ki", matrices)[:, :, None]
    here = transforms[:, lines].T
    directions = np.linalg.solve(matrices, here[:, :, None])[:, :, 0]
    return (here.conj() * directions).sum(1).real, directions


def _coherence(history: ComplexArray, line: float) -> float:
    """Coherent power of the parts of a history at a frequency in lines, over their whole power."""
    n = MACHINE_LINES.parts
    n_part = len(history) // n
    steady = np.exp(-2j * np.pi * line / len(history) * np.arange(n * n_part))
    parts = (history[: len(steady)] * steady).reshape(n, n_part) @ np.hanning(n_part)
    return float(np.abs(parts.sum()) ** 2 / (n * (np.abs(parts) ** 2).sum()))


def without_lines(samples: FloatArray, rate_hz: float, frequencies_hz: FloatArray) -> FloatArray:
    """Samples without the sines of some frequencies, by joint least squares of all of them.

    Sine and cosine of a frequency may each grow linearly over the record: so little do amplitude
    and phase of a machine drift where all is in one line, and what a frequency misses is removed,
    too. Where a sine is taken out, up to two lines (2 rate / N) of the rest go with it: frequencies
    must be as far apart, or more.
    """
    if not len(frequencies_hz):
        return samples
    n_samples = samples.shape[1]
    left = samples - samples.mean(1, keepdims=True)
    length = MACHINE_LINES.samples_at_a_time
    starts = range(0, n_samples, length)
    blocks = [slice(start, min(start + length, n_samples)) for start in starts]

    def waves(block: slice) -> FloatArray:
        instants = np.arange(block.start, block.stop)
        turns = np.exp(2j * np.pi / rate_hz * np.outer(frequencies_hz, instants))
        steady = np.concatenate([turns.real, turns.imag])
        return np.concatenate([steady, (2.0 * instants / n_samples - 1.0) * steady])

    products = sum(waves(block) @ waves(block).T for block in blocks)
    projections = sum(waves(block) @ left[:, block].T for block in blocks)
    amplitudes = np.linalg.lstsq(products, projections)[0]
    return np.concatenate(
        [samples[:, block] - amplitudes.T @ waves(block) for block in blocks], axis=1
    )


class Stationary(NamedTuple):
    """The stationary part of a record, by default all of it."""

    # (N,) factors of the samples, 0 where they are left out; None if nothing is.
    mask: FloatArray | None = None
    spans_s: tuple[tuple[float, float], ...] = ()
    varies: float = 1.0  # the most power of a window that is not left out, over the median


def stationary_part(
    samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]
) -> Stationary:
    """The stationary part of samples (n, N), as the motion of a band shows it."""
    from scipy.fft import irfft, rfft
    from scipy.ndimage import binary_propagation, distance_transform_edt, find_objects, label

    n = samples.shape[1]
    low, high = band_hz
    frequencies = np.fft.rfftfreq(n, 1.0 / rate_hz)
    passed = (frequencies > low) & (frequencies < high)
    length = max(1, min(round(CHECKS.window_periods * rate_hz / low), n // CHECKS.fewest_windows))
    n_windows = n // length
    powers = np.zeros(n_windows)
    for row in samples:
        motion = irfft(np.where(passed, rfft(row - row.mean()), 0.0), n)
        power = (motion[: n_windows * length].reshape(n_windows, length) ** 2).mean(1)
        powers += power / max(float(np.median(power)), np.finfo(float).tiny)
    powers /= np.median(powers)
    # And what was set in motion, until it has decayed.
    strong, decaying = powers > CHECKS.strong_power, powers > CHECKS.decayed_power
    out = binary_propagation(strong, mask=decaying)
    if not out.any() or out.mean() > CHECKS.most_left_out:
        return Stationary(varies=float(powers.max()))
    is_out = np.repeat(out, length)
    is_out = np.concatenate([is_out, np.full(n - len(is_out), out[-1])])
    # Flanks of one window.
    apart = (distance_transform_edt(~is_out) - 0.5).clip(0.0, length)
    mask = np.sin(0.5 * np.pi * apart / length) ** 2
    spans = [
        (span.start / rate_hz, span.stop / rate_hz) for (span,) in find_objects(label(is_out)[0])
    ]
    return Stationary(mask, tuple(spans), float(powers[~out].max()))
