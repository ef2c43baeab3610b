"""Posteriors in several places: narrow regions beside broad ones, and many maxima."""

from __future__ import annotations

import itertools
import math

import numpy as np
from known_evidence import Array, Problem, in_box, log_normal_pdf, sum_of_gaussians
from scipy.integrate import dblquad
from scipy.optimize import brentq
from scipy.special import gammaln, logsumexp, ndtr


def log_mass_of_hole(centres: Array, sds: Array, shares: Array) -> float:
    """Log prior mass of the ball around the second Gaussian in which it exceeds the first.

    As ``sum_of_gaussians``. Outside the ball nothing leads to the second; the first Gaussian and
    the prior are taken as constant within.
    """
    d, narrow = centres.shape[1], centres[1]
    own = log_normal_pdf(centres, 0.0, np.sqrt(1.0 + sds**2)[:, None]).sum(1)
    there = np.log(shares) + log_normal_pdf(narrow, centres, sds[:, None]).sum(1) - own
    radius = sds[1] * math.sqrt(2.0 * (there[1] - there[0]))
    log_volume = 0.5 * d * math.log(math.pi) - gammaln(0.5 * d + 1.0) + d * math.log(radius)
    return float(log_volume + log_normal_pdf(narrow, 0.0, 1.0).sum())


def golf_hole(d: int, prior_mass: float) -> Problem:
    """Half of the evidence in a narrow Gaussian of this prior mass beside a broad one."""
    broad, narrow = np.zeros(d), np.zeros(d)
    broad[0], narrow[0] = -1.0, 1.5
    centres, shares = np.array([broad, narrow]), np.array([0.5, 0.5])

    def excess(sd: float) -> float:
        return log_mass_of_hole(centres, np.array([0.7, sd]), shares) - math.log(prior_mass)

    sds = np.array([0.7, brentq(excess, 1e-6, 0.2)])
    return sum_of_gaussians(f"golf hole {prior_mass:.0e} d={d}", centres, sds, shares, prior_mass)


def spike_in_slab(d: int, offset: float) -> Problem:
    """Skilling's (2006) phase transition: a spike with 99 % of the evidence inside a slab.

    Gaussians of standard deviations 0.01, 100 times as heavy, and 0.1 in a unit cube; ``offset``
    of the spike in every coordinate. Closed form, with what the cube cuts off.
    """
    sds, centres, weights = np.array([0.01, 0.1]), np.array([offset, 0.0]), np.array([100.0, 1.0])

    def terms(z: Array) -> Array:
        x = in_box(z, -0.5, 0.5)
        each = [log_normal_pdf(x, c, s).sum(1) for c, s in zip(centres, sds, strict=True)]
        return np.log(weights) + np.column_stack(each)

    inside = d * np.log(ndtr((0.5 - centres) / sds) - ndtr((-0.5 - centres) / sds))
    logs = np.log(weights) + inside
    name = f"spike in slab d={d}" + (f", {offset:g} off" if offset else "")
    return Problem(
        name, d, lambda z: logsumexp(terms(z), axis=1), float(logsumexp(logs)),
        {"spike": (lambda z: terms(z).argmax(1) == 0, float(np.exp(logs[0] - logsumexp(logs))))},
    )  # fmt: skip


def unequal_widths() -> Problem:
    """Gaussians of widths 0.5 and 0.05 in five dimensions, 70 and 30 % of the evidence.

    The narrow one is a golf hole, too: it holds 8e-5 of the prior.
    """
    centres = np.array([np.full(5, -0.45), np.full(5, 0.45)])
    sds, shares = np.array([0.5, 0.05]), np.array([0.7, 0.3])
    hidden = math.exp(log_mass_of_hole(centres, sds, shares))
    return sum_of_gaussians("unequal widths d=5", centres, sds, shares, hidden)


def random_modes(n_modes: int = 32, d: int = 3, seed: int = 0) -> Problem:
    """Equal Gaussians of width 0.05 at random places."""
    centres = np.random.default_rng([seed, n_modes]).uniform(-2.0, 2.0, (n_modes, d))
    return sum_of_gaussians(
        f"{n_modes} random modes d={d}", centres, np.full(n_modes, 0.05),
        np.full(n_modes, 1.0 / n_modes),
    )  # fmt: skip


def grid_of_modes(values: tuple[float, ...], d: int, sd: float) -> Problem:
    """Equal Gaussians at every combination of ``values`` in ``d`` dimensions."""
    centres = np.array(list(itertools.product(values, repeat=d)))
    n = len(centres)
    return sum_of_gaussians(
        f"{n} modes on a grid d={d}", centres, np.full(n, sd), np.full(n, 1.0 / n)
    )


def eggbox() -> Problem:
    """Feroz et al. (2009): (2 + cos(x/2) cos(y/2))⁵ in (0, 10π)²; 18 equal maxima.

    Quadrature; the other quarters of periods are reflections of the first.
    """

    def log_likelihood(z: Array) -> Array:
        return (2.0 + np.cos(0.5 * in_box(z, 0.0, 10.0 * math.pi)).prod(1)) ** 5

    # The mean of each sign of the product over a quarter period, and how many hold which:
    # cos(x/2) > 0 in (0, π), (3π, 5π) and (7π, 9π), one half of ten quarters.
    def mean(sign: float) -> float:
        def integrand(y: float, x: float) -> float:
            return math.exp((2.0 + sign * math.cos(0.5 * x) * math.cos(0.5 * y)) ** 5 - 3.0**5)

        whole, _ = dblquad(integrand, 0.0, math.pi, 0.0, math.pi, epsabs=0.0, epsrel=1e-9)
        return whole / math.pi**2

    exact = 3.0**5 + math.log(0.5 * mean(1.0) + 0.5 * mean(-1.0))
    return Problem("eggbox", 2, log_likelihood, exact)


def problems() -> list[Problem]:
    return [
        golf_hole(2, 1e-4),
        golf_hole(3, 1e-6),
        golf_hole(4, 1e-8),
        *(spike_in_slab(d, offset) for d in (10, 20) for offset in (0.0, 0.031)),
        unequal_widths(),
        random_modes(),
        grid_of_modes((-2.0, -1.2, -0.4, 0.4, 1.2, 2.0), 2, 0.05),
        grid_of_modes((-1.0, 1.0), 6, 0.15),
        eggbox(),
    ]
