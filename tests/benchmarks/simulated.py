"""Identified modes drawn from a model class's own prior and likelihood."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.stats import vonmises_fisher

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.close_modes import close_pairs, relative_distances
from bayes_ssi.parameters.parameters import as_product


class IdentificationErrors(NamedTuple):
    """What a test states of its identified modes, in addition to the model's prediction errors."""

    frequency_cov: float
    shape_sd: float


def simulate(
    candidate: bs.ModelClass, rng: np.random.Generator, stated: IdentificationErrors | None = None
) -> tuple[np.ndarray, bs.ModalData, dict[str, int]]:
    """Parameter values, identified modes and their pairing, drawn from prior and likelihood.

    For a class with one configuration; otherwise as :func:`simulate_tests`.
    """
    values, ((data, pairing),) = simulate_tests(candidate, rng, stated)
    return values, data, pairing


def simulate_tests(
    candidate: bs.ModelClass, rng: np.random.Generator, stated: IdentificationErrors | None = None
) -> tuple[np.ndarray, list[tuple[bs.ModalData, dict[str, int]]]]:
    """Parameter values, and identified modes and their pairing in every configuration.

    Each model mode in the band is identified with the detection probability, with errors of its
    frequency and shape, and spurious modes are added. Where a test has no identified mode all is
    drawn again, since there is nothing to invert.
    """
    while True:
        values = candidate.values(rng.standard_normal((1, len(candidate.parameters))))
        named = dict(zip(candidate.parameter_names, values[0].tolist(), strict=True))
        tests = [
            _modes_of_test(candidate, configuration, likelihood.modes(own), named, rng, stated)
            for configuration, likelihood, own in candidate.parts(values)
        ]
        if all(observed for observed, _ in tests):
            return values[0], [
                (bs.ModalData(tuple(observed), c.data.band_hz, c.data.sensors), pairing)
                for (observed, pairing), c in zip(tests, candidate.configurations, strict=True)
            ]


def _modes_of_test(
    candidate: bs.ModelClass,
    configuration: bs.Configuration,
    modes: bs.Modes,
    named: dict[str, float],
    rng: np.random.Generator,
    stated: IdentificationErrors | None,
) -> tuple[list[bs.IdentifiedMode], dict[str, int]]:
    """The identified modes of one test, and their pairing."""
    error, identification = candidate.error, candidate.identification
    of_model = [
        size.scale * math.prod(named[p.name] ** power for p, power in size.powers)
        for size in map(as_product, (error.frequency_cov, error.shape_sd))
    ]
    frequency_cov, shape_sd = map(math.hypot, of_model, stated or (0.0, 0.0))
    own = stated._asdict() if stated else {}
    sensors = configuration.data.sensors
    low, high = configuration.data.band_hz
    (model_hz,) = modes.frequencies_hz
    identified = model_hz * (1.0 + frequency_cov * rng.standard_normal(len(model_hz)))
    is_seen = rng.random(len(model_hz)) < identification.detection_probability
    seen_hz = np.where(is_seen & (low < identified) & (identified < high), identified, np.nan)
    shapes = configuration.structure.sensor_matrix(sensors).apply(modes.shapes)[0]
    _turn(shapes, model_hz, seen_hz, np.square([of_model]), rng)
    observed, pairing = [], {}
    for i, frequency in enumerate(seen_hz):
        if not np.isnan(frequency):
            direction = shapes[:, i] / np.linalg.norm(shapes[:, i])
            # exp(-(1 - cos t)/σ²) is the von Mises-Fisher density with κ = 1/σ²; for small σ its
            # mirror image at -φ adds nothing but the sign.
            variance = shape_sd**2 + configuration.structure.shape_variances.get(i, 0.0)
            shape = vonmises_fisher(direction, 1.0 / variance, seed=rng).rvs(1)[0]
            label = str(len(observed) + 1)
            observed.append(bs.IdentifiedMode(label, frequency, shape, **own))
            pairing[label] = i + 1
    for _ in range(rng.poisson(identification.expected_spurious_modes)):
        shape = rng.standard_normal(len(sensors))
        frequency = rng.uniform(low, high)
        observed.append(bs.IdentifiedMode(f"s{len(observed)}", frequency, shape, **own))
    return observed, pairing


def _turn(shapes, model_hz, seen_hz, variances, rng):
    """Turn shapes (n_sensors, n_modes) of close modes as the likelihood of those seen has it."""
    distances = relative_distances(seen_hz[:-1], seen_hz[1:])
    close = close_pairs(model_hz[None], distances[:, None], variances, distances[:, None])
    for k, i in enumerate(() if close is None else close.lower):
        kappa = float(close.concentrations(distances[[i]], np.array([k]))[0])
        t = 0.5 * rng.vonmises(0.0, kappa) if math.isfinite(kappa) else 0.0
        turn = [[math.cos(t), -math.sin(t)], [math.sin(t), math.cos(t)]]
        shapes[:, i : i + 2] = shapes[:, i : i + 2] @ turn


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
