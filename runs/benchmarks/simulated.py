"""Identified modes drawn from a model class's own prior and likelihood."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.stats import vonmises_fisher

import bayes_ssi as bs


def simulate(
    candidate: bs.ModelClass, rng: np.random.Generator
) -> tuple[np.ndarray, bs.ModalData, dict[str, int]]:
    """Parameter values, identified modes and their pairing, drawn from prior and likelihood.

    Each model mode in the band is identified with the detection probability, with errors of its
    frequency and shape, and spurious modes are added. A data set without any identified mode is
    drawn again, since there is nothing to invert.
    """
    values = candidate.values(rng.standard_normal((1, len(candidate.parameters))))
    likelihood = candidate.likelihoods[0]
    modes = likelihood.modes(values)
    shapes = likelihood.shapes_at_sensors(modes)[0]
    low, high = candidate.data.band_hz
    observed, pairing = [], {}
    for i, frequency in enumerate(modes.frequencies_hz[0]):
        identified = frequency * (1.0 + candidate.error.frequency_cov * rng.standard_normal())
        detected = rng.random() < candidate.identification.detection_probability
        if detected and low < identified < high:
            direction = shapes[:, i] / np.linalg.norm(shapes[:, i])
            # exp(-(1 - cos t)/σ²) is the von Mises-Fisher density with κ = 1/σ²; for small σ its
            # mirror image at -φ adds nothing but the sign.
            kappa = candidate.error.shape_sd**-2
            shape = vonmises_fisher(direction, kappa, seed=rng).rvs(1)[0]
            label = str(len(observed) + 1)
            observed.append(bs.IdentifiedMode(label, identified, shape))
            pairing[label] = i + 1
    for _ in range(rng.poisson(candidate.identification.expected_spurious_modes)):
        shape = rng.standard_normal(len(candidate.data.sensors))
        observed.append(bs.IdentifiedMode(f"s{len(observed)}", rng.uniform(low, high), shape))
    if not observed:
        return simulate(candidate, rng)
    data = bs.ModalData(tuple(observed), candidate.data.band_hz, candidate.data.sensors)
    return values[0], data, pairing


def print_bands(stated: np.ndarray, right: np.ndarray, edges: tuple[float, ...]) -> None:
    """Print how often statements of probability (n,) were right (n,), by bands of probability."""
    from scipy.stats import binomtest

    for low, high in pairwise(edges):
        band = (stated >= low) & ((stated < high) | (high == edges[-1]))
        if band.any():
            expected = float(stated[band].mean())
            test = binomtest(int(right[band].sum()), int(band.sum()), min(max(expected, 0), 1))
            print(
                f"stated {low:.2f} to {high:.2f} ({expected:.3f} on average): right in "
                f"{right[band].mean():.3f} of {band.sum()}, p = {test.pvalue:.2f}"
            )
