"""Posteriors of awkward shape: curved, funnels, shells, plateaus, corners and steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from known_evidence import Array, Problem, log_normal_pdf, of_distance
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import chi, ncx2


def log_integral(log_integrand: Callable[[float], float]) -> float:
    """The log of an integral over a standard-normal coordinate, by adaptive quadrature."""
    top = max(log_integrand(float(x)) for x in np.linspace(-8.0, 8.0, 1601))
    parts = [
        quad(lambda x: math.exp(log_integrand(x) - top), low, high, epsabs=1e-14, epsrel=1e-10)[0]
        for low, high in itertools.pairwise(np.linspace(-9.0, 9.0, 73))
    ]
    return top + math.log(math.fsum(parts))


def banana(d: int, width: float) -> Problem:
    """z_j = 1 - z_1² ± width for every other coordinate: one curved ridge.

    The other coordinates integrate in closed form, the first by quadrature.
    """
    spread = math.hypot(1.0, width)
    exact = log_integral(
        lambda x: (
            float(log_normal_pdf(x, 0.0, 1.0))
            + (d - 1) * float(log_normal_pdf(1.0 - x * x, 0.0, spread))
        )
    )
    return Problem(
        f"banana {width:g} d={d}", d,
        lambda z: log_normal_pdf(z[:, 1:] + z[:, :1] ** 2, 1.0, width).sum(1), exact,
    )  # fmt: skip


def bananas(n: int) -> Problem:
    """n independent bananas of width 0.1, in 2n dimensions."""
    one = banana(2, 0.1)
    return Problem(
        f"{n} bananas d={2 * n}", 2 * n,
        lambda z: sum(one.log_likelihood(z[:, 2 * i : 2 * i + 2]) for i in range(n)),
        n * one.log_evidence,
    )  # fmt: skip


def funnel(d: int) -> Problem:
    """Neal (2003): d - 1 values of zero whose standard deviation is exp(1.5 z_1).

    The others integrate in closed form, z_1 by quadrature.
    """
    exact = log_integral(
        lambda x: (
            float(log_normal_pdf(x, 0.0, 1.0))
            - 0.5 * (d - 1) * math.log(2.0 * math.pi * (1.0 + math.exp(3.0 * x)))
        )
    )
    return Problem(
        f"funnel d={d}", d,
        lambda z: log_normal_pdf(z[:, 1:], 0.0, np.exp(1.5 * z[:, :1])).sum(1), exact,
    )  # fmt: skip


def ring() -> Problem:
    """A ring of radius 2 and width 0.01, off the prior's centre."""
    return of_distance(
        "thin ring", 2, 0.5, lambda r: log_normal_pdf(r, 2.0, 0.01), np.array([1.9, 2.0, 2.1])
    )


def nested_shells() -> Problem:
    """Shells of radii 1 and 2.5 and width 0.03 about the centre of three dimensions."""

    def log_likelihood(z: Array) -> Array:
        r = np.linalg.norm(z, axis=1)
        return np.logaddexp(log_normal_pdf(r, 1.0, 0.03), log_normal_pdf(r, 2.5, 0.03))

    def mass(radius: float) -> float:
        def integrand(r: float) -> float:
            return float(chi.pdf(r, 3) * np.exp(log_normal_pdf(r, radius, 0.03)))

        return quad(integrand, radius - 0.3, radius + 0.3, points=[radius], epsrel=1e-10)[0]

    inner, outer = mass(1.0), mass(2.5)
    return Problem(
        "nested shells d=3", 3, log_likelihood, math.log(inner + outer),
        {"inner": (lambda z: np.linalg.norm(z, axis=1) < 1.75, inner / (inner + outer))},
    )  # fmt: skip


def hard_ball(d: int, prior_mass: float) -> Problem:
    """Likelihood 1 inside a ball with that prior mass, 1 from the prior's centre; 0 outside."""
    radius = math.sqrt(ncx2.ppf(prior_mass, d, 1.0))
    centre = np.full(d, 1.0 / math.sqrt(d))
    return Problem(
        f"hard ball {prior_mass:.0e} d={d}", d,
        lambda z: np.where(np.linalg.norm(z - centre, axis=1) < radius, 0.0, -np.inf),
        math.log(prior_mass),
    )  # fmt: skip


def flat_top() -> Problem:
    """Constant inside a ball of five dimensions; outside it falls within 0.05."""
    return of_distance(
        "flat top d=5", 5, 1.0, lambda r: -0.5 * (np.maximum(r - 0.8, 0.0) / 0.05) ** 2,
        np.array([0.8, 1.0, 1.4]),
    )  # fmt: skip


def beyond_a_threshold() -> Problem:
    """Positive only where z_1 exceeds a value with prior probability 1e-4: exp(z_2) there."""
    threshold = 3.719016485455709  # Φ(-3.719…) = 1e-4
    return Problem(
        "beyond a threshold d=3", 3, lambda z: np.where(z[:, 0] > threshold, z[:, 1], -np.inf),
        math.log(ndtr(-threshold)) + 0.5,
    )  # fmt: skip


def between_walls() -> Problem:
    """Positive in a slot with prior mass 1e-3 in four dimensions; three Gaussian coordinates."""
    half = 0.5e-3 / math.exp(float(log_normal_pdf(1.0, 0.0, 1.0)))

    def log_likelihood(z: Array) -> Array:
        inside = np.abs(z[:, 0] - 1.0) < half
        return np.where(inside, log_normal_pdf(z[:, 1:], 0.5, 0.2).sum(1), -np.inf)

    others = 3.0 * float(log_normal_pdf(0.5, 0.0, math.hypot(1.0, 0.2)))
    exact = math.log(ndtr(1.0 + half) - ndtr(1.0 - half)) + others
    return Problem("between walls d=4", 4, log_likelihood, exact)


def corner(d: int, length: float) -> Problem:
    """exp(-Σt/length) for t uniform in (0, 1): in one corner. Closed form."""
    exact = d * math.log(-length * math.expm1(-1.0 / length))
    return Problem(f"corner d={d}", d, lambda z: -ndtr(z).sum(1) / length, exact)


def two_corners() -> Problem:
    """Opposite corners of three dimensions, lengths 0.02 and 0.01, 0.2 and 0.8 of the evidence."""
    lengths, shares = (0.02, 0.01), (0.2, 0.8)
    log_own = [3.0 * math.log(-length * math.expm1(-1.0 / length)) for length in lengths]

    def log_likelihood(z: Array) -> Array:
        low, high = ndtr(z).sum(1), ndtr(-z).sum(1)
        return np.logaddexp(
            math.log(shares[0]) - log_own[0] - low / lengths[0],
            math.log(shares[1]) - log_own[1] - high / lengths[1],
        )

    return Problem(
        "two corners d=3", 3, log_likelihood, 0.0, {"low": (lambda z: z.sum(1) < 0.0, shares[0])}
    )


def beyond_the_edge(d: int = 4) -> Problem:
    """Gaussian coordinates whose means lie two standard deviations outside (0, 1). Closed form."""
    exact = d * math.log(ndtr(-2.0) - ndtr(-22.0))
    return Problem(
        f"beyond the edge d={d}", d, lambda z: log_normal_pdf(ndtr(z), 1.1, 0.05).sum(1), exact
    )


def staircase() -> Problem:
    """log L = -2 for every half unit of distance in three dimensions. A sum of χ probabilities."""
    steps = np.arange(40)
    masses = np.diff(chi.cdf(0.5 * np.arange(41), 3))
    return Problem(
        "staircase d=3", 3, lambda z: -2.0 * np.floor(2.0 * np.linalg.norm(z, axis=1)),
        math.log(np.sum(np.exp(-2.0 * steps) * masses)),
    )  # fmt: skip


def cliff() -> Problem:
    """A Gaussian of four dimensions, e^10 lower behind a wall. Closed form."""
    whole = 4.0 * float(log_normal_pdf(0.5, 0.0, math.hypot(1.0, 0.3)))
    before = ndtr((0.6 - 0.5 / 1.09) * math.hypot(1.0, 0.3) / 0.3)
    return Problem(
        "cliff d=4", 4, lambda z: log_normal_pdf(z, 0.5, 0.3).sum(1) - 10.0 * (z[:, 0] > 0.6),
        whole + math.log(before + math.exp(-10.0) * (1.0 - before)),
    )  # fmt: skip


def checkerboard() -> Problem:
    """Squares of side 0.5, every other e^5 lower. Sums of normal probabilities."""
    first, side = 0.1, 0.5
    numbers = np.arange(-40, 40)
    masses = ndtr(first + side * (numbers + 1)) - ndtr(first + side * numbers)
    even = masses[numbers % 2 == 0].sum()
    same = even**2 + (1.0 - even) ** 2
    return Problem(
        "checkerboard", 2, lambda z: -5.0 * (np.floor((z - first) / side).sum(1) % 2),
        math.log(same + math.exp(-5.0) * (1.0 - same)),
    )  # fmt: skip


def problems() -> list[Problem]:
    return [
        banana(2, 0.1), banana(2, 0.01), banana(5, 0.1), bananas(2), bananas(5),
        *(funnel(d) for d in (2, 5, 10)), ring(), nested_shells(), hard_ball(6, 1e-3), flat_top(),
        beyond_a_threshold(), between_walls(), corner(8, 0.005), two_corners(), beyond_the_edge(),
        staircase(), cliff(), checkerboard(),
    ]  # fmt: skip
