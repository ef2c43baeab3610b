"""Posteriors with heavy tails, extreme scales or strong correlation, and models that fail."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from known_evidence import Array, Problem, in_box, log_normal_pdf, shifted
from scipy.special import ndtr, voigt_profile
from scipy.stats import multivariate_normal, multivariate_t


def log_cauchy_pdf(x: Array, at: float) -> Array:
    """Of width 0.05."""
    return -np.log(math.pi * 0.05 * (1.0 + ((x - at) / 0.05) ** 2))


def cauchys_in_a_box(d: int) -> Problem:
    """Cauchy coordinates of width 0.05 about 2, x uniform in (-10, 10). Closed form."""
    inside = (math.atan(8.0 / 0.05) + math.atan(12.0 / 0.05)) / math.pi
    return Problem(
        f"Cauchys in a box d={d}", d, lambda z: log_cauchy_pdf(in_box(z, -10.0, 10.0), 2.0).sum(1),
        d * math.log(inside / 20.0),
    )  # fmt: skip


def cauchys(d: int) -> Problem:
    """Cauchy coordinates of width 0.05 about 0.5. With a normal prior: Voigt's profile."""
    exact = d * math.log(voigt_profile(0.5, 1.0, 0.05))
    return Problem(f"Cauchys d={d}", d, lambda z: log_cauchy_pdf(z, 0.5).sum(1), exact)


def student_posterior() -> Problem:
    """A posterior in two dimensions that is Student's t with ν = 3, tails heavier than the prior's.

    The likelihood is the t density over the prior's, so the evidence is 1.
    """
    nu, d = 3.0, 2
    t = multivariate_t(shape=np.eye(d), df=nu)
    return Problem(
        "Student posterior d=2", d, lambda z: t.logpdf(z) - log_normal_pdf(z, 0.0, 1.0).sum(1), 0.0
    )


def wider_than_the_prior() -> Problem:
    """log L = 0.45 |z|²: a normal posterior √10 times as wide as the prior. Closed form."""
    return Problem(
        "wider than the prior d=3", 3, lambda z: 0.45 * (z * z).sum(1), 1.5 * math.log(10.0)
    )


def log_gamma(d: int) -> Problem:
    """Beaujean and Caldwell (2013): four maxima, half of the coordinates log-gamma, half normal.

    x is uniform in (-30, 30); the densities are normalised there to 1e-8.
    """

    def log_gamma_pdf(x: Array, at: float) -> Array:
        return (x - at) - np.exp(np.minimum(x - at, 700.0))

    def log_likelihood(z: Array) -> Array:
        x = in_box(z, -30.0, 30.0)
        total = np.logaddexp(log_gamma_pdf(x[:, 0], 10.0), log_gamma_pdf(x[:, 0], -10.0))
        normals = [log_normal_pdf(x[:, 1], at, 1.0) for at in (10.0, -10.0)]
        total = total + np.logaddexp(*normals) - 2.0 * math.log(2.0)
        half = (d + 2) // 2
        total = total + log_gamma_pdf(x[:, 2:half], 10.0).sum(1)
        return total + log_normal_pdf(x[:, half:], 10.0, 1.0).sum(1)

    def quadrant(first: bool, second: bool) -> Callable[[Array], Array]:
        return lambda z: ((z[:, 0] > 0.0) == first) & ((z[:, 1] > 0.0) == second)

    regions = {
        f"x1 {'>' if i else '<'} 0, x2 {'>' if j else '<'} 0": (quadrant(i, j), 0.25)
        for i in (True, False)
        for j in (True, False)
    }
    return Problem(f"log-gamma d={d}", d, log_likelihood, -d * math.log(60.0), regions)


def gaussian(name: str, mean: Array, covariance: Array) -> Problem:
    """N(z; mean, covariance). Closed form: N(mean; 0, covariance + I)."""
    d = len(mean)
    half = np.linalg.cholesky(covariance)
    constant = -np.log(np.diag(half)).sum() - 0.5 * d * math.log(2.0 * math.pi)

    def log_likelihood(z: Array) -> Array:
        return constant - 0.5 * (np.linalg.solve(half, (z - mean).T) ** 2).sum(0)

    exact = float(multivariate_normal(np.zeros(d), covariance + np.eye(d)).logpdf(mean))
    return Problem(name, d, log_likelihood, exact)


def correlated() -> list[Problem]:
    """Standard deviations from 0.01 to 1 along random axes; correlations 0.999 and 0.9^|i - j|."""
    rng = np.random.default_rng(16)
    axes = np.linalg.qr(rng.standard_normal((10, 10)))[0]
    random_axes = (axes * np.logspace(-4.0, 0.0, 10)) @ axes.T
    equal = 0.25 * (0.999 * np.ones((30, 30)) + 0.001 * np.eye(30))
    neighbours = 0.09 * 0.9 ** np.abs(np.subtract.outer(np.arange(50), np.arange(50)))
    return [
        gaussian("random axes d=10", 0.5 * rng.standard_normal(10), random_axes),
        gaussian("equal correlations d=30", np.full(30, 0.5), equal),
        gaussian("correlated neighbours d=50", np.full(50, 0.2), neighbours),
    ]


def far_out(sds: float) -> Problem:
    """A Gaussian of width 0.3 in three dimensions, that many prior deviations away."""
    mean = np.full(3, sds * 1.09 / math.sqrt(3.0))
    return gaussian(f"{sds:g} sd away d=3", mean, 0.09 * np.eye(3))


def needle() -> Problem:
    """A Gaussian of width 1e-6 in two dimensions."""
    return gaussian("needle d=2", np.array([1.0, -0.5]), 1e-12 * np.eye(2))


def almost_flat() -> Problem:
    """log L = -1e-6 |z|² in four dimensions. Closed form."""
    return Problem("almost flat d=4", 4, lambda z: -1e-6 * (z * z).sum(1), -2.0 * math.log1p(2e-6))


def fails_in_a_half() -> Problem:
    """A Gaussian in three dimensions; NaN where z_1 + z_2 > 0.5. Closed form."""
    whole = gaussian("", np.full(3, 0.3), 0.25 * np.eye(3))
    # A posteriori the sum has the mean 0.6/1.25 and the variance 2 · 0.25/1.25.
    left = ndtr((0.5 - 0.48) / math.sqrt(0.4))
    return Problem(
        "fails in a half d=3", 3,
        lambda z: np.where(z[:, 0] + z[:, 1] > 0.5, np.nan, whole.log_likelihood(z)),
        whole.log_evidence + math.log(left),
    )  # fmt: skip


def fails_in_stripes() -> Problem:
    """A Gaussian in two dimensions; NaN where sin(6 z_1) > 1/2. Sums of normal probabilities."""
    whole = gaussian("", np.array([0.5, 0.5]), 0.25 * np.eye(2))
    turns = 2.0 * math.pi * np.arange(-12, 13)
    mean, sd = 0.5 / 1.25, math.sqrt(0.2)
    lost = ndtr(((turns + 5.0 * math.pi / 6.0) / 6.0 - mean) / sd)
    lost = lost - ndtr(((turns + math.pi / 6.0) / 6.0 - mean) / sd)
    return Problem(
        "fails in stripes d=2", 2,
        lambda z: np.where(np.sin(6.0 * z[:, 0]) > 0.5, np.nan, whole.log_likelihood(z)),
        whole.log_evidence + math.log1p(-lost.sum()),
    )  # fmt: skip


def problems() -> list[Problem]:
    return [
        cauchys_in_a_box(3), cauchys(3), cauchys(5), student_posterior(), wider_than_the_prior(),
        log_gamma(2), log_gamma(10), *correlated(), far_out(4.0), far_out(6.0), needle(),
        almost_flat(), shifted(far_out(2.0), 1e6), fails_in_a_half(), fails_in_stripes(),
    ]  # fmt: skip
