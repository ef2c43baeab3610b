"""Modes that share a band, how far the band reaches, and its spectra.

Bands do not share lines, so that errors of different bands are independent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.measurements.records.identification_settings import BANDS
from bayes_ssi.measurements.records.resonances import Resonances
from bayes_ssi.measurements.records.spectra import LocalSpectra, Transforms, local_spectra


class Group(NamedTuple):
    """Modes that share a band."""

    low: float  # lowest frequency in Hz
    high: float  # highest frequency in Hz
    modes: Resonances
    is_wanted: bool


def groups_of(
    transforms: Transforms,
    modes: Resonances,
    band_hz: tuple[float, float],
    least_bandwidths: float = BANDS.least_bandwidths,
    share: float = 1.0,
) -> list[Group]:
    """Modes by band, in ascending order: those in the search, and the next to either side."""
    if not modes.n_modes:
        return []
    f = modes.frequencies_hz
    order = np.argsort(f, kind="stable")
    least = BANDS.least_share_of_median_damping * float(np.median(modes.dampings))
    widths = 2.0 * np.maximum(modes.dampings, least).clip(*BANDS.dampings_of_groups) * f
    gaps = np.diff(f[order])
    sums = widths[order][1:] + widths[order][:-1]
    ends = np.flatnonzero(gaps >= BANDS.shared_band * sums) + 1
    members = [part.tolist() for part in np.split(order, ends)]
    usual = 2.0 * modes.dampings.clip(*BANDS.dampings_of_reach) * f
    reach = np.minimum(
        BANDS.reach_bandwidths * usual,
        np.maximum(BANDS.widest_share * f, least_bandwidths * usual),
    )
    least_reach = np.maximum(BANDS.narrowest_share * f, BANDS.fewest_lines * transforms.line_hz)
    reach = np.maximum(share * reach, least_reach)
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
    neighbours = _neighbours(group, known)
    damping = min(float(np.median(group.modes.dampings)), BANDS.most_damping_of_blocks)
    try:
        spectra = transforms.spectra(group.low, group.high, BANDS.block_over_damping * damping)
    except ValueError:
        return None
    n_lines = spectra.weights.sum()
    if n_lines < BANDS.lines_of_a_direction:
        return None
    m = group.modes.n_modes
    n_directions = min(
        m + neighbours.n_modes + BANDS.spare_directions,
        max(BANDS.most_directions, m + BANDS.spare_directions),
        max(2, int(n_lines / BANDS.lines_of_a_direction)),
    )
    data = local_spectra(spectra, n_directions)
    return data, neighbours.in_directions(data)


def _neighbours(group: Group, known: Resonances) -> Resonances:
    """The nearest known modes to either side."""
    f = known.frequencies_hz
    lowest, highest = group.modes.frequencies_hz.min(), group.modes.frequencies_hz.max()
    # Those of the group are among the known ones, but for rounding.
    below, above = np.flatnonzero(f < lowest * 0.9999), np.flatnonzero(f > highest * 1.0001)
    nearest = [int(below[np.abs(f[below] - lowest).argmin()])] if len(below) else []
    if len(above):
        nearest.append(int(above[np.abs(f[above] - highest).argmin()]))
    return known.at(nearest)
