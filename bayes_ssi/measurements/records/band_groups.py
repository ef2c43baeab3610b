"""Modes that share a band, how far the band reaches, and its spectra.

Bands do not share lines, so that errors of different bands are independent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.local_spectra import LocalSpectra, local_spectra
from bayes_ssi.measurements.records.spectra import Transforms

# A band reaches so many half-power bandwidths beyond its modes, but no farther than a share of the
# frequency, or so few bandwidths, and no less than a smaller share, or so many lines.
REACH, WIDEST, LEAST_REACH, NARROWEST, FEWEST_LINES = 7.0, 0.12, 2.5, 0.05, 40
# Modes closer than this times the sum of their half-power bandwidths share a band.
TOGETHER = 1.25
# Dampings of candidates may be far off, most of all below a share of the median of all; modes are
# grouped, and bands made, as for these.
GROUP_DAMPINGS, REACH_DAMPINGS, OF_MEDIAN = (0.004, 0.04), (0.01, 0.04), 0.7
# Blocks of lines are this share of a damping wide, relative to their frequency.
BLOCK_OVER_DAMPING, MOST_BLOCK_DAMPING = 0.25, 0.03
# Directions of the channels: those of modes and neighbours, and a few for the rest; not more than
# this, unless modes are, and each for so many lines.
SPARE_DIRECTIONS, MOST_DIRECTIONS, LINES_OF_A_DIRECTION = 2, 6, 10.0


class Group(NamedTuple):
    """Modes that share a band.

    Attributes:
        low: lowest frequency in Hz.
        high: highest frequency in Hz.
    """

    low: float
    high: float
    modes: Resonances
    is_wanted: bool


def groups_of(
    transforms: Transforms,
    modes: Resonances,
    band_hz: tuple[float, float],
    least_reach: float = LEAST_REACH,
    share: float = 1.0,
) -> list[Group]:
    """Modes by band, in ascending order: those in the search, and the next to either side."""
    order = np.argsort(modes.frequencies_hz, kind="stable").tolist()
    members: list[list[int]] = []
    f = modes.frequencies_hz
    least = OF_MEDIAN * float(np.median(modes.dampings)) if len(f) else 0.0
    widths = 2.0 * np.maximum(modes.dampings, least).clip(*GROUP_DAMPINGS) * f
    for i in order:
        if members:
            last = members[-1][-1]
            if f[i] - f[last] < TOGETHER * (widths[i] + widths[last]):
                members[-1].append(i)
                continue
        members.append([i])
    usual = 2.0 * modes.dampings.clip(*REACH_DAMPINGS) * f
    reach = np.minimum(REACH * usual, np.maximum(WIDEST * f, least_reach * usual))
    reach = np.maximum(share * reach, np.maximum(NARROWEST * f, FEWEST_LINES * transforms.line_hz))
    lowest, highest = transforms.band_hz
    groups = []
    for k, group in enumerate(members):
        low = max(lowest, min(f[i] - reach[i] for i in group))
        high = min(highest, max(f[i] + reach[i] for i in group))
        if k:
            low = max(low, _between(modes, members[k - 1][-1], group[0]))
        if k + 1 < len(members):
            high = min(high, _between(modes, group[-1], members[k + 1][0]))
        # Where a mode is known but for half a bandwidth, it may be inside.
        inside = any(band_hz[0] - widths[i] <= f[i] <= band_hz[1] + widths[i] for i in group)
        groups.append(Group(low, high, modes.at(group), inside))
    wanted = [k for k, group in enumerate(groups) if group.is_wanted]
    return groups[max(0, wanted[0] - 1) : wanted[-1] + 2] if wanted else []


def _between(modes: Resonances, i: int, j: int) -> float:
    """Where two modes are as many of their own bandwidths away."""
    f, w = modes.frequencies_hz, modes.half_widths_hz
    return float((f[i] * w[j] + f[j] * w[i]) / (w[i] + w[j]))


def spectra_of(
    transforms: Transforms, group: Group, known: Resonances
) -> tuple[LocalSpectra, Resonances] | None:
    """Spectra of a band in its directions, and its neighbours there; None if it has no lines."""
    outside = [_nearest_outside(known, group, side) for side in (-1, 1)]
    neighbours = known.at([i for i in outside if i is not None])
    damping = min(float(np.median(group.modes.dampings)), MOST_BLOCK_DAMPING)
    try:
        spectra = transforms.spectra(group.low, group.high, BLOCK_OVER_DAMPING * damping)
    except ValueError:
        return None
    if spectra.weights.sum() < LINES_OF_A_DIRECTION:
        return None
    n_modes = len(group.modes.dampings) + len(neighbours.frequencies_hz)
    n_directions = min(
        n_modes + SPARE_DIRECTIONS,
        max(MOST_DIRECTIONS, len(group.modes.dampings) + SPARE_DIRECTIONS),
        max(2, int(spectra.weights.sum() / LINES_OF_A_DIRECTION)),
    )
    data = local_spectra(spectra, n_directions)
    return data, in_directions(data, neighbours)


def _nearest_outside(known: Resonances, group: Group, side: int) -> int | None:
    own = group.modes.frequencies_hz
    f = known.frequencies_hz
    outside = np.flatnonzero(f > own.max() * 1.0001 if side > 0 else f < own.min() * 0.9999)
    if not len(outside):
        return None
    return int(outside[np.abs(f[outside] - (own.max() if side > 0 else own.min())).argmin()])


def in_directions(data: LocalSpectra, modes: Resonances) -> Resonances:
    """Modes of all channels in the directions of a band, at unit length, as real as may be."""
    shapes = data.from_channels @ modes.shapes
    lengths = np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)
    shapes = shapes / lengths
    turned = shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0)))
    return modes._replace(shapes=turned)
