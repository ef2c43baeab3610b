"""A log-likelihood whose log evidence is known, and the densities that such problems are made of.

Coordinates are standard normal a priori; uniform priors take their distribution function.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import ncx2

from bayes_ssi import ModelClass

Array = np.ndarray


@dataclass(frozen=True)
class Problem:
    """A log-likelihood with a known log evidence.

    Attributes:
        name: unique among all problems.
        n_dimensions: d.
        log_likelihood: coordinates (B, d) → (B,).
        log_evidence: exact, or to the number of digits that the problem states.
        regions: name → test of coordinates (B, d) → (B,), and the known probability.
        hidden_mass: prior mass of a region in which alone its likelihood shows, where nothing
            outside leads to it; a method that did not draw inside cannot know of it. None where
            the whole posterior can be reached.
        model_class: whose likelihood it is, where searches may use it; None for a black box.
    """

    name: str
    n_dimensions: int
    log_likelihood: Callable[[Array], Array]
    log_evidence: float
    regions: Mapping[str, tuple[Callable[[Array], Array], float]] = field(default_factory=dict)
    hidden_mass: float | None = None
    model_class: ModelClass | None = None


def log_normal_pdf(x: Array, mean: Array | float, sd: Array | float) -> Array:
    return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd) - 0.5 * math.log(2.0 * math.pi)


def in_box(z: Array, low: float, high: float) -> Array:
    """Uniform in (low, high), of standard-normal coordinates."""
    return low + (high - low) * ndtr(z)


def shifted(problem: Problem, by: float) -> Problem:
    """The problem with a constant added to the log-likelihood."""
    return replace(
        problem,
        name=f"{problem.name} {by:+g}",
        log_likelihood=lambda z: problem.log_likelihood(z) + by,
        log_evidence=problem.log_evidence + by,
    )


def sum_of_gaussians(
    name: str, centres: Array, sds: Array, shares: Array, hidden_mass: float | None = None
) -> Problem:
    """Gaussians at ``centres`` (K, d) with ``sds`` (K,), by their shares (K,) of the evidence.

    Closed form: ∫ N(z; c, s²) N(z; 0, 1) dz = N(c; 0, 1 + s²) in each coordinate. The evidence
    is 1. A point belongs to the term that is highest there: right where they hardly overlap.
    """
    n_dimensions = centres.shape[1]
    own = log_normal_pdf(centres, 0.0, np.sqrt(1.0 + sds**2)[:, None]).sum(1)
    heights = np.log(shares) - own - n_dimensions * np.log(sds)

    def terms(z: Array) -> Array:
        squares = sum((z[:, [i]] - centres[:, i]) ** 2 for i in range(n_dimensions))
        return heights - 0.5 * squares / sds**2 - 0.5 * n_dimensions * math.log(2.0 * math.pi)

    def member(k: int) -> Callable[[Array], Array]:
        return lambda z: terms(z).argmax(1) == k

    return Problem(
        name, n_dimensions, lambda z: np.logaddexp.reduce(terms(z), axis=1), math.log(shares.sum()),
        {f"region {k + 1}": (member(k), share) for k, share in enumerate(shares / shares.sum())},
        hidden_mass,
    )  # fmt: skip


def of_distance(
    name: str, n_dimensions: int, away: float, log_likelihood: Callable[[Array], Array], upto: Array
) -> Problem:
    """A function of the distance from a point that is ``away`` from the prior's centre.

    Quadrature: the squared distance of a standard-normal point is noncentral χ² with d degrees of
    freedom. ``upto`` (n,) are distances between which the function is smooth; beyond the last
    nothing is left of the posterior.
    """
    centre = np.full(n_dimensions, away / math.sqrt(n_dimensions))

    def mass(r: float) -> float:
        density = 2.0 * r * ncx2.pdf(r * r, n_dimensions, away**2)
        return float(density * np.exp(log_likelihood(np.array([r]))[0]))

    edges = np.concatenate([[0.0], upto])
    pieces = [
        quad(mass, low, high, epsabs=0.0, epsrel=1e-9)[0] for low, high in itertools.pairwise(edges)
    ]
    return Problem(
        name, n_dimensions, lambda z: log_likelihood(np.linalg.norm(z - centre, axis=1)),
        math.log(math.fsum(pieces)),
    )  # fmt: skip
