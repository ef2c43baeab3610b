"""Problems of the literature and of textbooks, and one modal problem of several maxima.

Sources: Beck and Au (2002) with the settings of Straub and Papaioannou (2015); Yuen (2010) with
the data of SimCenter's UCSD_UQ examples; the others are textbook cases.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from known_evidence import Array, Problem, in_box, log_normal_pdf, shifted
from scipy.special import ndtr
from scipy.stats import multivariate_normal

import bayes_ssi as bs

STUDY = Path(__file__).parents[2] / "model_classes" / "shear_building.py"


def beck_au() -> Problem:
    """Two-storey shear building; no normalising constant in the likelihood."""
    m1, m2, k = 16531.0, 16131.0, 29.7e6

    def factors(z: Array) -> Array:
        return np.exp([0.5102367348, 0.1695776862] + z * [0.4978679246, 0.6266747462])

    def log_likelihood(z: Array) -> Array:
        k1, k2 = k * factors(z).T
        half_trace = 0.5 * ((k1 + k2) / m1 + k2 / m2)
        root = np.sqrt(half_trace**2 - k1 * k2 / (m1 * m2))
        squares = np.array([half_trace - root, half_trace + root]) / (2.0 * math.pi) ** 2
        return -128.0 * ((squares.T / [3.13**2, 9.83**2] - 1.0) ** 2).sum(1)

    return Problem(
        "Beck-Au", 2, log_likelihood, -6.48699,
        {"t1 < 1": (lambda z: factors(z)[:, 0] < 1.0, 0.5317)},
    )  # fmt: skip


def yuen(case: int) -> Problem:
    """Two eigenvalues and a shape ratio, five measurements of each; cases use some of them."""
    lambda1 = np.array([0.386, 0.3922, 0.4157, 0.3592, 0.3615])
    lambda2 = np.array([2.3614, 2.5877, 2.707, 2.3875, 2.7272])
    ratio = np.array([1.68245252, 1.71103903, 1.57876073, 1.58722342, 1.61878479])

    def log_likelihood(z: Array) -> Array:
        k1, k2 = 0.8 + 1.4 * ndtr(z[:, 0]), 0.4 + 0.8 * ndtr(z[:, 1])
        h = 0.5 * k1 + k2
        root = np.sqrt(h * h - k1 * k2)
        total = log_normal_pdf((h - root)[:, None], lambda1, 0.0191).sum(1)
        if case == 2:
            total = total + log_normal_pdf((h + root)[:, None], lambda2, 0.1309).sum(1)
        if case == 3:
            shape = (k1 + k2 - (h - root)) / k2
            total = total + log_normal_pdf(shape[:, None], ratio, 0.0809).sum(1)
        return total

    return Problem(f"Yuen {case}", 2, log_likelihood, (9.68747, 10.00599, 14.01714)[case - 1])


def linear_gaussian(d: int, seed: int = 0) -> Problem:
    """3d observations of d parameters, two columns of the design correlated 0.95."""
    rng = np.random.default_rng([seed, d])
    design = rng.standard_normal((3 * d, d))
    design[:, 1] = 0.95 * design[:, 0] + math.sqrt(1 - 0.95**2) * design[:, 1]
    observed = design @ (2.0 * rng.standard_normal(d)) + 0.3 * rng.standard_normal(3 * d)
    covariance = 0.09 * np.eye(3 * d) + 4.0 * design @ design.T
    return Problem(
        f"linear d={d}", d, lambda z: log_normal_pdf(2.0 * z @ design.T, observed, 0.3).sum(1),
        float(multivariate_normal(np.zeros(3 * d), covariance).logpdf(observed)),
    )  # fmt: skip


def shells(d: int) -> Problem:
    """Two shells of radius 2 and width 0.1, centres ±3.5 on the first axis, prior U(-6, 6)^d."""
    centre = np.zeros(d)
    centre[0] = 3.5

    def log_likelihood(z: Array) -> Array:
        x = in_box(z, -6.0, 6.0)
        distances = [np.linalg.norm(x - sign * centre, axis=1) for sign in (1.0, -1.0)]
        return np.logaddexp(*(log_normal_pdf(distance, 2.0, 0.1) for distance in distances))

    exact = {2: -1.7456, 5: -5.6736, 10: -14.5905}[d]
    return Problem(
        f"shells d={d}", d, log_likelihood, exact, {"x1 > 0": (lambda z: z[:, 0] > 0.0, 0.5)}
    )


def edge() -> Problem:
    """The posterior lies at the edge of the support: log L = -Σt/0.02, prior U(0, 1)³."""
    return Problem("edge", 3, lambda z: -ndtr(z).sum(1) / 0.02, -11.7361)


def one_dimension() -> Problem:
    return Problem("one dimension", 1, lambda z: log_normal_pdf(z[:, 0], 5.0, 0.2), -12.95778)


def four_regions(seed: int = 0) -> Problem:
    """Four spherical Gaussians of unequal weight and width in a box of side 10, d = 4."""
    centres = np.random.default_rng(seed).uniform(-3.0, 3.0, (4, 4))
    weights, sds = np.array([0.6, 0.25, 0.1, 0.05]), np.array([0.1, 0.2, 0.15, 0.3])

    def parts(z: Array) -> Array:
        squares = ((in_box(z, -5.0, 5.0)[:, None] - centres) ** 2).sum(-1)
        return np.log(weights) - 2.0 * np.log(2.0 * math.pi * sds**2) - 0.5 * squares / sds**2

    def member(k: int) -> Callable[[Array], Array]:
        return lambda z: parts(z).argmax(1) == k

    return Problem(
        "four regions", 4, lambda z: np.logaddexp.reduce(parts(z), axis=1), -4.0 * math.log(10.0),
        {f"region {k + 1}": (member(k), float(weights[k])) for k in range(4)},
    )  # fmt: skip


def wider_prior() -> Problem:
    """The one-dimensional problem's likelihood with a uniform prior, 100 times as wide."""
    width = 400.0  # U(3, 7) loses 1.5e-23 of the likelihood's mass outside
    return Problem(
        "wider prior", 1, lambda z: log_normal_pdf(width * (ndtr(z[:, 0]) - 0.5), 0.0, 0.2),
        -math.log(width),
    )  # fmt: skip


def several_maxima_class() -> bs.ModelClass:
    """Approach 3 on frequencies alone, errors of 0.2 %, priors with a c.o.v. of 0.5."""
    augmented = bs.load_study(STUDY).only(["3"]).model_classes[0]
    wide = {p.name: bs.Parameter(p.name, bs.LogNormal(1.0, 0.5)) for p in augmented.parameters}
    frame, (infill,) = augmented.structure, augmented.structure.elements
    structure = bs.ShearBuilding(
        masses=frame.masses,
        stiffnesses=[
            product.scale * wide[f"k{i}"] for i, product in enumerate(frame.stiffnesses, 1)
        ],
    ).with_element(replace(infill, stiffness_factor=wide["ks"]))
    data = augmented.data.without_shapes()
    error = bs.ErrorModel(frequency_cov=0.002, shape_sd=0.05)
    return bs.ModelClass("several maxima", structure, data, error, pairing=augmented.pairing)


def several_maxima() -> Problem:
    """The numerical study's approach 3 on frequencies alone; its posterior has several maxima."""
    candidate = several_maxima_class()

    def k(z: Array, i: int) -> Array:
        return candidate.values(z)[:, i - 1]

    return Problem(
        "several maxima", 4, candidate.log_likelihood_at, 2.694,
        {
            "k1 > 1.8": (lambda z: k(z, 1) > 1.8, 0.029),
            "k3 > 1.06": (lambda z: (k(z, 1) < 1.8) & (k(z, 3) > 1.06), 0.534),
            "true values": (lambda z: (k(z, 1) < 1.8) & (k(z, 3) <= 1.06), 0.437),
        },
    )  # fmt: skip


def problems() -> list[Problem]:
    return [
        beck_au(), *(yuen(case) for case in (1, 2, 3)),
        *(linear_gaussian(d) for d in (2, 6, 12, 20)), *(shells(d) for d in (2, 5, 10)), edge(),
        one_dimension(), wider_prior(), four_regions(), shifted(beck_au(), 1000.0),
        shifted(beck_au(), -1000.0), several_maxima(),
    ]  # fmt: skip
