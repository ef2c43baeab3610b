"""Reference log evidences of the modal problems, independent of the engine.

    python tests/benchmarks/modal_references.py [--only NAME,…] [--draws 400000] [--seed 0]

Least-squares ascents of every pairing from draws of the prior find the maxima. Importance sampling
from one Student t at each, and from the prior, gives the evidence. Where more than 1000 pairings
are possible, the pairings tried are those of highest probability at draws of the prior whose errors
are made 1, 10 and 100 times larger.

Where frequencies alone are known, a quadrature confirms it, and is all there is for a ridge: cells
of coordinates are halved wherever the likelihood can matter until they are as small as its width.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from known_evidence import Array
from problems_modal import modal_classes, two_frequencies
from scipy.optimize import least_squares
from scipy.special import logsumexp
from scipy.stats import multivariate_t

import bayes_ssi as bs

# Ascents, shared by the pairings, and most of them for one pairing.
ASCENTS, MOST_STARTS = 2000, 200
DEGREES_OF_FREEDOM, PRIOR_SHARE = 4.0, 0.05
# Maxima whose Laplace estimates are smaller by this many nats count for nothing.
NEGLIGIBLE = 20.0


def all_pairings(candidate: bs.ModelClass) -> Iterator[dict[str, int]]:
    labels, n_modes = candidate.data.labels, candidate.structure.n_modes
    for n in range(1, min(len(labels), n_modes) + 1):
        for chosen in itertools.combinations(labels, n):
            for numbers in itertools.permutations(range(1, n_modes + 1), n):
                yield dict(zip(chosen, numbers, strict=True))


def likely_pairings(candidate: bs.ModelClass, z: Array) -> list[dict[str, int]]:
    """The pairings of frequencies and shapes that fit best at ``z``, with widened errors."""
    likely = {}
    for widened in (1.0, 10.0, 100.0):
        error = candidate.error
        wide = replace(
            candidate,
            error=bs.ErrorModel(
                min(widened * error.frequency_cov, 0.1), min(widened * error.shape_sd, 0.3)
            ),
        )
        (likelihood,) = wide.likelihoods
        for log_ratios in likelihood.pairing_weights(wide.values(z)).log_ratios:
            pairing, free = {}, log_ratios.copy()
            while free.max() > 0.0:
                i, j = np.unravel_index(free.argmax(), free.shape)
                pairing[wide.data.labels[i]] = int(j) + 1
                free[i], free[:, j] = -np.inf, -np.inf
            if pairing:
                likely[tuple(sorted(pairing.items()))] = pairing
    return list(likely.values())


def ascents(candidate: bs.ModelClass, pairing: dict[str, int], starts: Array) -> list[Array]:
    """Maxima of the posterior with this pairing, (d,) each, from ``starts`` (n, d)."""
    tests = tuple(replace(test, pairing=pairing) for test in candidate.configurations)
    (likelihood,) = replace(candidate, configurations=tests).likelihoods
    pairs = likelihood.pairs

    def residuals(z: Array) -> Array:
        values = candidate.values(z)
        modes = likelihood.modes(values)
        rows = [z, pairs.frequency_residuals(modes.frequencies_hz) / candidate.error.frequency_cov]
        for pair in pairs.with_shape:
            shape = likelihood.shapes_at_sensors(modes)[:, :, pairs.model_modes[pair]]
            shape = shape / np.linalg.norm(shape, axis=1, keepdims=True)
            identified = candidate.data.mode(pairs.modes[pair].label).unit_shape
            sign = np.sign(shape @ identified)[:, None]
            rows.append((sign * shape - identified) / candidate.error.shape_sd)
        return np.concatenate(rows, axis=1)

    def jacobian(z: Array) -> Array:
        step = 1e-6 * np.eye(len(z))
        each = residuals(np.concatenate([z + step, z - step]))
        return (each[: len(z)] - each[len(z) :]).T / 2e-6

    ends = []
    for start in starts:
        fit = least_squares(lambda z: residuals(z[None])[0], start, jacobian, xtol=1e-12)
        if not any(np.linalg.norm(fit.x - end) < 1e-6 for end, _ in ends):
            ends.append((fit.x, np.linalg.inv(fit.jac.T @ fit.jac)))
    return ends


def log_prior(z: Array) -> Array:
    return -0.5 * (z * z).sum(1) - 0.5 * z.shape[1] * math.log(2.0 * math.pi)


def reference(
    candidate: bs.ModelClass, n_draws: int, seed: int, n_ascents: int = ASCENTS
) -> tuple[float, float, int]:
    """Log evidence, its standard error, and the number of maxima that matter."""
    rng = np.random.default_rng(seed)
    d = len(candidate.parameters)
    if candidate.pairing != "any":
        tried = [dict(candidate.pairing)]
    elif candidate.structure.n_modes > 4:
        tried = likely_pairings(candidate, rng.standard_normal((200, d)))
    else:
        tried = list(all_pairings(candidate))
    starts = rng.standard_normal((min(MOST_STARTS, 1 + n_ascents // len(tried)), d))
    found = [end for pairing in tried for end in ascents(candidate, pairing, starts)]
    laplace = np.array([
        candidate.log_likelihood_at(z[None])[0] + log_prior(z[None])[0]
        + 0.5 * np.linalg.slogdet(2.0 * math.pi * covariance)[1]
        for z, covariance in found
    ])  # fmt: skip
    kept = np.flatnonzero(laplace > laplace.max() - NEGLIGIBLE)
    # Where pairings have one maximum in common, the most pairs make it the narrowest.
    kept = sorted(kept, key=lambda i: np.linalg.slogdet(found[i][1])[1])
    maxima: list[int] = []
    for i in kept:
        if all(np.linalg.norm(found[i][0] - found[j][0]) > 1e-5 for j in maxima):
            maxima.append(i)
    # Half of the draws by Laplace's shares, half evenly, so that none is overlooked.
    shares = np.exp(laplace[maxima] - logsumexp(laplace[maxima]))
    shares = (1.0 - PRIOR_SHARE) * (0.5 * shares + 0.5 / len(maxima))
    terms = [multivariate_t(*found[i], df=DEGREES_OF_FREEDOM) for i in maxima]
    counts = rng.multinomial(n_draws, [*shares, PRIOR_SHARE])
    draws = [t.rvs(n, rng).reshape(n, d) for t, n in zip(terms, counts, strict=False) if n]
    z = np.concatenate([*draws, rng.standard_normal((counts[-1], d))])
    proposal = [np.log(s) + t.logpdf(z) for s, t in zip(shares, terms, strict=True)]
    proposal.append(math.log(PRIOR_SHARE) + log_prior(z))
    log_weights = log_prior(z) - logsumexp(proposal, axis=0)
    log_weights += np.concatenate([
        np.nan_to_num(candidate.log_likelihood_at(part), nan=-np.inf)
        for part in np.array_split(z, max(1, len(z) // 10_000))
    ])  # fmt: skip
    weights = np.exp(log_weights - log_weights.max())
    error = weights.std() / weights.mean() / math.sqrt(len(weights))
    return log_weights.max() + math.log(weights.mean()), error, len(maxima)


def by_refinement(candidate: bs.ModelClass, reach: float = 6.5) -> float:
    """The log evidence of frequencies alone, by cells that are halved about the likelihood.

    A cell is kept where some frequency's residual could be within 8 standard deviations inside
    it, by the largest derivative of its logarithm with respect to a coordinate.
    """
    error, d = candidate.error.frequency_cov, len(candidate.parameters)
    # ln f moves by at most half of ln k, so by half of a prior's log standard deviation.
    log_sd = math.sqrt(math.log1p(candidate.parameters[0].prior.cov ** 2))
    side = 0.5
    axis = np.arange(-reach + side / 2, reach, side)
    cells = np.stack(np.meshgrid(*[axis] * d), axis=-1).reshape(-1, d)
    observed = np.log(candidate.data.frequencies_hz)
    while True:
        parts = np.array_split(cells, max(1, len(cells) // 100_000))
        off = [
            np.abs(np.log(modes.frequencies_hz[:, : len(observed)]) - observed).max(1)
            for part in parts
            for modes in candidate.modes(candidate.values(part))
        ]
        slack = 0.5 * log_sd * 0.5 * side * math.sqrt(d)
        cells = cells[np.concatenate(off) < 8.0 * error + slack]
        if 0.5 * log_sd * side < 1.5 * error:
            break
        corners = 0.25 * side * np.array(list(itertools.product((-1.0, 1.0), repeat=d)))
        cells = (cells[:, None] + corners).reshape(-1, d)
        side *= 0.5
    parts = np.array_split(cells, max(1, len(cells) // 100_000))
    logs = np.concatenate([candidate.log_likelihood_at(part) + log_prior(part) for part in parts])
    return float(logsumexp(logs) + d * math.log(side))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="part of the names of classes")
    parser.add_argument("--draws", type=int, default=400_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for candidate in modal_classes():
        if options.only not in candidate.name:
            continue
        if candidate.pairing != "any":
            print(f"{candidate.name}: {by_refinement(candidate):.4f} by quadrature", flush=True)
        if candidate.name == two_frequencies().name:
            continue  # a ridge, which no few Student t's cover
        value, error, n = reference(candidate, options.draws, options.seed)
        print(f"{candidate.name}: {value:.4f} ± {error:.4f}, {n} maxima", flush=True)


if __name__ == "__main__":
    main()
