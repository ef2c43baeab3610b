"""What looks wrong with the samples of a record, before modes are identified from it.

A sound record of an ambient test gives no remark.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.disturbances import machine_lines
from bayes_ssi.measurements.records.identification_settings import CHECKS
from bayes_ssi.measurements.records.sensor_delays import late_sensors


def moving(samples: FloatArray) -> NDArray[np.bool_]:
    """Which sensors (n,) have samples (n, N) that differ by more than rounding."""
    low, high = samples.min(1), samples.max(1)
    moves: NDArray[np.bool_] = high - low > 1e-12 * np.maximum(np.abs(low), np.abs(high))
    return moves


def remarks_on(samples: FloatArray, rate_hz: float, sensors: Sequence[str]) -> list[str]:
    """What looks wrong, a sentence each; empty for a sound record.

    Args:
        samples: (n, N).
        rate_hz: samples per second.
    """
    moves = moving(samples)
    remarks = [
        f"sensor {name!r}: dead, all samples are {row[0]:g}"
        for name, row, has in zip(sensors, samples, moves, strict=True)
        if not has
    ]
    samples = samples if moves.all() else samples[moves]  # a long record fills memory
    sensors = [name for name, has in zip(sensors, moves, strict=True) if has]
    remarks += _copies(samples, sensors)
    for name, row in zip(sensors, samples, strict=True):
        if _is_clipped(row):
            remarks.append(
                f"sensor {name!r}: stays at its extreme value for three samples or more; is it "
                "clipped?"
            )
        elif (gap := _longest_straight(row)) is not None:
            first, length = gap
            remarks.append(
                f"sensor {name!r}: on a straight line from {first / rate_hz:.6g} s on for "
                f"{length / rate_hz:.3g} s; is it a gap that was filled?"
            )
        if (drift := _drift(row)) > CHECKS.drift_scatter:
            remarks.append(
                f"sensor {name!r}: drifts; its mean over twentieths of the record scatters by "
                f"{drift:.2g} times what is left without them"
            )
    noise = _incoherent(samples)
    remarks += [
        f"sensor {sensors[i]!r}: noise alone, coherent with no other sensor at any frequency; is "
        "it connected?"
        for i in noise
    ]
    clear = np.delete(samples, noise, axis=0) if noise else samples
    remarks += late_sensors(clear, rate_hz, [s for i, s in enumerate(sensors) if i not in noise])
    return remarks + _machines(samples, rate_hz)


def _incoherent(samples: FloatArray) -> list[int]:
    """Rows of samples that share no motion with any other row."""
    n, n_samples = samples.shape
    n_windows = CHECKS.windows
    length = min(2 * n_samples // (n_windows + 1), CHECKS.longest_window)
    if n < 2 or length < n_windows:
        return []
    starts = np.linspace(0, n_samples - length, n_windows).astype(int)
    windows = samples[:, starts[:, None] + np.arange(length)]
    windows = (windows - windows.mean(2, keepdims=True)) * np.hanning(length)
    lines = np.fft.rfft(windows)[:, :, 2:].transpose(2, 0, 1)  # (lines, n, windows)
    tiny = np.finfo(float).tiny
    lines /= np.sqrt(np.maximum((np.abs(lines) ** 2).sum(2, keepdims=True), tiny))
    coherence = np.abs(lines @ lines.conj().swapaxes(1, 2)) ** 2
    coherence[:, range(n), range(n)] = 0.0
    # Of noise it exceeds c with probability (1 - c)^(m - 1), m windows; half of them overlap.
    one_in = CHECKS.records_per_coherent_noise * n * len(lines)
    limit = 1.0 - one_in ** (-1.0 / (0.75 * n_windows - 1.0))
    return np.flatnonzero(coherence.max((0, 2)) < limit).tolist()


def _machines(samples: FloatArray, rate_hz: float) -> list[str]:
    frequencies = machine_lines(samples, rate_hz)
    if not len(frequencies):
        return []
    n = len(frequencies)
    lines = f"lines at {n} frequencies, the strongest" if n > 1 else "a line"
    named = ", ".join(f"{frequency:.4g}" for frequency in frequencies[: CHECKS.named_lines])
    return [
        f"{lines} at {named} Hz, as of a machine; a mode so narrow would have decayed less than "
        "once over the record"
    ]


def _copies(samples: FloatArray, sensors: Sequence[str]) -> list[str]:
    """Sensors whose samples are those of another one, perhaps with the other sign."""
    return [
        f"sensors {sensors[j]!r} and {sensors[i]!r}: the same samples{how}"
        for i in range(len(samples))
        for j in range(i)
        for sign, how in ((1.0, ""), (-1.0, " but for the sign"))
        # A few samples tell nearly all sensors apart.
        if all(np.array_equal(samples[i, :n], sign * samples[j, :n]) for n in (100, None))
    ]


def _is_clipped(row: FloatArray) -> bool:
    """Whether three samples in a row are at an extreme, which is no rare value.

    Samples of a coarse sensor are at its extreme less often than at the value next to it.
    """
    for sign in (-1.0, 1.0):
        highest = float((sign * row).max())
        at_end = sign * row == highest
        if np.any(at_end[2:] & at_end[1:-1] & at_end[:-2]):
            below = sign * row[~at_end]
            if at_end.sum() > (below == below.max()).sum():
                return True
    return False


def _longest_straight(row: FloatArray) -> tuple[int, int] | None:
    """First sample and length of the longest straight run, if it is too long."""
    bend = np.abs(row[2:] - 2.0 * row[1:-1] + row[:-2])
    rounding = 8.0 * np.finfo(float).eps * float(np.abs(row).max())
    bent = np.flatnonzero(bend > rounding)
    ends = [-1, *bent.tolist(), len(bend)]
    lengths = np.diff(ends) + 1  # samples on the line
    longest = int(lengths.argmax())
    if lengths[longest] < CHECKS.straight_samples:
        return None
    # A coarse sensor often stays on one value: a gap stands out from its other runs.
    usual = np.sort(lengths)[-max(1, len(lengths) // 1000) - 1] if len(lengths) > 1 else 0
    if lengths[longest] < 2 * usual:
        return None
    return ends[longest] + 1, int(lengths[longest])


def _drift(row: FloatArray) -> float:
    """Scatter of the means of parts, over that of the samples about them."""
    edges = np.linspace(0, len(row), CHECKS.drift_parts + 1).astype(int)
    if len(row) < 2 * CHECKS.drift_parts:
        return 0.0
    means = np.array([row[a:b].mean() for a, b in pairwise(edges)])
    inner = float(np.sqrt(np.mean([row[a:b].var() for a, b in pairwise(edges)])))
    return float(means.std()) / max(inner, np.finfo(float).tiny)
