"""What looks wrong with the samples of a record, before modes are identified from it.

A sound record of an ambient test gives no remark.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.records.clocks import late_sensors
from bayes_ssi.records.machine_lines import machine_lines

# A sensor in motion does not stay on one value, or on one straight line, for so many samples.
STRAIGHT = 10
# Means of twentieths of a record scatter by less than the samples do, unless they drift.
PARTS, DRIFT = 20, 0.5


def remarks_on(samples: FloatArray, rate_hz: float, sensors: Sequence[str]) -> list[str]:
    """What looks wrong, a sentence each; empty for a sound record.

    Args:
        samples: (n, N).
        rate_hz: samples per second.
        sensors: n names.
    """
    moving = samples.min(1) < samples.max(1)
    remarks = [
        f"sensor {name!r}: dead, all samples are {row[0]:g}"
        for name, row, moves in zip(sensors, samples, moving, strict=True)
        if not moves
    ]
    remarks += _copies(samples, sensors, moving)
    for name, row, moves in zip(sensors, samples, moving, strict=True):
        if not moves:
            continue
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
        if (drift := _drift(row)) > DRIFT:
            remarks.append(
                f"sensor {name!r}: drifts; its mean over twentieths of the record scatters by "
                f"{drift:.2g} times what is left without them"
            )
    names = [name for name, moves in zip(sensors, moving, strict=True) if moves]
    if len(names) == len(sensors):
        remarks += late_sensors(samples, rate_hz, names)
        remarks += machine_lines(samples, rate_hz)
    return remarks


def _copies(samples: FloatArray, sensors: Sequence[str], moving: np.ndarray) -> list[str]:
    """Sensors whose samples are those of another one, perhaps with the other sign."""
    remarks = []
    for i in np.flatnonzero(moving).tolist():
        for j in np.flatnonzero(moving[:i]).tolist():
            # A few samples tell nearly all sensors apart.
            for sign, how in (
                (1.0, "the same samples"),
                (-1.0, "the same samples but for the sign"),
            ):
                if np.array_equal(samples[i, :100], sign * samples[j, :100]) and np.array_equal(
                    samples[i], sign * samples[j]
                ):
                    remarks.append(f"sensors {sensors[j]!r} and {sensors[i]!r}: {how}")
    return remarks


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
    if lengths[longest] < STRAIGHT:
        return None
    # A coarse sensor often stays on one value: a gap stands out from its other runs.
    usual = np.sort(lengths)[-max(1, len(lengths) // 1000) - 1] if len(lengths) > 1 else 0
    if lengths[longest] < 2 * usual:
        return None
    return ends[longest] + 1, int(lengths[longest])


def _drift(row: FloatArray) -> float:
    """Scatter of the means of parts, over that of the samples about them."""
    edges = np.linspace(0, len(row), PARTS + 1).astype(int)
    if len(row) < 2 * PARTS:
        return 0.0
    means = np.array([row[a:b].mean() for a, b in pairwise(edges)])
    inner = float(np.sqrt(np.mean([row[a:b].var() for a, b in pairwise(edges)])))
    return float(means.std()) / max(inner, np.finfo(float).tiny)
