"""Parameter values of a class about each simulated test, whose average is the class's evidence.

A test has its likelihood in a small part of the prior, in which few of a thousand prior draws lie,
or none: their average would be biased by nats. Here Gauss-Newton searches, from prior draws that
suit a test, find where the class comes near it; parameters are drawn from Student-t densities
there, and each draw takes a pairing of modes in proportion to what it explains. The weights are
exact, so all that a poor search costs is effective draws, which are counted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.studies.planning.plan_settings import PLANNING
from bayes_ssi.studies.planning.planned_class import PlannedClass, SeenModes
from bayes_ssi.studies.planning.simulated_tests import SimulatedTests


class CentredDraws(NamedTuple):
    """K draws of a class about each of N tests, each with a pairing."""

    # (N, K): log of the density before the test, times that of the frequencies for the pairing,
    # over the density that draws and pairings come from.
    log_weights: FloatArray
    shapes: NDArray[np.float32]  # (N, K, n_candidates, J), of paired model modes; 0 elsewhere
    paired: NDArray[np.bool_]  # (N, K, J)
    shape_var: FloatArray  # (N, K), σ²
    z: FloatArray  # (N, K, n_parameters)
    log_explained: FloatArray  # (N, K), weights with the shapes at all candidates


def centred_draws(
    planned: PlannedClass, tests: SimulatedTests, n_draws: int, rng: np.random.Generator
) -> CentredDraws:
    """Draws of the class about tests, which it or another class gave."""
    pool_z = planned.draw(PLANNING.n_pool, rng)
    pool = planned.modes(pool_z)
    per_test = n_draws * max(pool.shapes[0].size, PLANNING.n_starts * pool_z.shape[1] ** 2)
    step, parts = max(1, PLANNING.batch // max(per_test, PLANNING.n_pool)), []
    for first in range(0, len(tests.shapes), step):
        some = tests.rows(slice(first, first + step))
        seen = some.identified_shapes(range(some.shapes.shape[1]))
        ratios = log_ratios(planned, some.frequencies_hz, seen, _batched(pool, (1, -1)), 1.0)
        # No more than an upper limit of the sum over pairings, which takes no time.
        matched = np.logaddexp(0.0, logsumexp(ratios.partly(0.5), axis=3)).sum(axis=2)
        blocks = matched.reshape(len(matched), PLANNING.n_starts, -1).argmax(axis=2)
        n_each = matched.shape[1] // PLANNING.n_starts
        z = pool_z[blocks + n_each * np.arange(PLANNING.n_starts)]
        mixture = _mixture(planned, some.frequencies_hz, seen, z, rng)
        draws = _draws(planned, some.frequencies_hz, seen, mixture, n_draws, rng)
        if planned.n_structural < pool_z.shape[1]:  # shapes tell how large errors are
            errors = _error_sizes(draws, planned.n_structural)
            mixture = mixture._replace(error_sizes=errors)
            draws = _draws(planned, some.frequencies_hz, seen, mixture, n_draws, rng)
        parts.append(draws)
    return joined(parts)


def _batched(modes: SeenModes, shape: tuple[int, int]) -> SeenModes:
    """Modes (B, …) as (n, k, …)."""
    return SeenModes(*(array.reshape(*shape, *array.shape[1:]) for array in modes))


class LogRatios(NamedTuple):
    """Log densities of identified modes j as model modes i over leaving both unpaired."""

    frequency: FloatArray  # (n, k, J, I)
    shape: FloatArray  # the same, of the shapes at all candidates
    unpaired: FloatArray  # (n, k), log density of all modes unpaired, shapes left out

    def partly(self, share: float | FloatArray) -> FloatArray:
        """(n, k, J, I), with a share of the shapes, or one for each k."""
        return self.frequency + np.reshape(share, (-1, 1, 1)) * self.shape


def log_ratios(
    planned: PlannedClass, found_hz: FloatArray, seen: FloatArray, modes: SeenModes, added: float
) -> LogRatios:
    """Of n tests and k parameter values.

    Args:
        found_hz: (n, J), and ``seen`` (n, n_candidates, J), their unit shapes.
        modes: (n or 1, k, …).
        added: share of the first errors that is added.
    """
    frequencies = modes.frequencies_hz
    modes = modes._replace(variances=modes.variances + np.square(added * FIRST_ERRORS))
    flat = SeenModes(*(array.reshape(-1, *array.shape[2:]) for array in modes))
    missed = planned.log_missed(flat).reshape(frequencies.shape)
    variance, shape_var = np.moveaxis(modes.variances[:, :, None, None], -1, 0)
    identification = planned.model_class.identification
    found = found_hz[:, None, :, None]
    residuals = frequencies[:, :, None] / found - 1.0
    ratios = -0.5 * (residuals * residuals / variance + np.log(2.0 * math.pi * variance))
    ratios += math.log(identification.detection_probability) - planned.log_spurious
    ratios = ratios - np.log(found) - missed[:, :, None]
    n_found = np.isfinite(found_hz).sum(axis=1)[:, None]
    unpaired = n_found * planned.log_spurious - identification.expected_spurious_modes
    unpaired = np.nan_to_num(unpaired + missed.sum(axis=2), nan=-np.inf)
    of_shapes = np.zeros(1)
    if (d := seen.shape[1]) > 1:
        length = np.sqrt(np.square(modes.shapes).sum(axis=2))[:, :, None]
        cosine = np.abs(seen.swapaxes(1, 2)[:, None] @ modes.shapes)
        distance = 1.0 - cosine / np.where(length > 0.0, length, 1.0)
        of_shapes = log_sphere_area(d) - log_shape_normaliser(np.sqrt(shape_var), d)
        of_shapes = np.nan_to_num(of_shapes - distance / shape_var)
    return LogRatios(np.nan_to_num(ratios, nan=-np.inf), of_shapes, unpaired)


FIRST_ERRORS = np.array(PLANNING.first_errors)


def sampled_pairings(
    ratios: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.intp], FloatArray]:
    """A random pairing for each row of log ratios (n, k, J, I), and the log of its probability.

    Identified modes choose one after the other, in an order of its own in each row, among the model
    modes that are left, or none: a draw of all orders gives every pairing its chance.

    Returns:
        The model mode (n, k, J), -1 for none; and (n, k).
    """
    n, k, n_data, n_model = ratios.shape
    order = rng.random((n, k, n_data)).argsort(axis=2)
    chosen = np.full((n, k, n_data), -1, dtype=np.intp)
    taken = np.zeros((n, k, n_model), dtype=bool)
    log_probability = np.zeros((n, k))
    for place in range(n_data):
        j = order[:, :, place, None]
        own = np.take_along_axis(ratios, j[..., None], axis=2)[:, :, 0]
        options = np.concatenate([np.where(taken, -np.inf, own), np.zeros((n, k, 1))], axis=2)
        picked = (options + rng.gumbel(size=options.shape)).argmax(axis=2)[..., None]
        log_probability += np.take_along_axis(options, picked, axis=2)[..., 0]
        log_probability -= logsumexp(options, axis=2)
        np.put_along_axis(chosen, j, np.where(picked < n_model, picked, -1), axis=2)
        taken |= np.arange(n_model) == picked
    return chosen, log_probability


def _of_pairs(array: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
    """The sums (n, k) of the entries of (n, k, J, I) that are chosen (n, k, J)."""
    taken = np.take_along_axis(array, np.maximum(chosen, 0)[..., None], axis=-1)[..., 0]
    return np.asarray(np.where(chosen >= 0, taken, 0.0).sum(axis=-1))


class _Mixture(NamedTuple):
    """Student-t densities about the points where R searches for each of n tests ended.

    Of the structure's d parameters, given the error sizes, which are normal about what is known.
    """

    planned: PlannedClass
    centres: FloatArray  # (n, R, d), where modes are linear in the parameters
    # (2, n, R, d, d) and (2, n, R, d), of frequencies and shapes: products of their derivatives
    # with one another and with the residuals, for errors of 1.
    squares: FloatArray
    products: FloatArray
    log_shares: FloatArray  # (n, R)
    error_sizes: FloatArray  # (2, n, 1, n_errors), mean and width of z of inferred error sizes

    def given(self, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means (n, k, R, d) and precisions (n, k, R, d, d) at squared errors (n, k, 2)."""
        d = self.centres.shape[2]
        mean, covariance = self.planned.moments
        before = np.linalg.inv(covariance[:d, :d])
        inverse = 1.0 / np.moveaxis(variances, 2, 0)[..., None]
        precisions = (inverse[..., None, None] * self.squares[:, :, None]).sum(axis=0) + before
        towards = (inverse[..., None] * self.products[:, :, None]).sum(axis=0)
        towards += ((mean[:d] - self.centres) @ before)[:, None]
        change = np.linalg.solve(precisions, towards[..., None])[..., 0]
        return np.asarray(self.centres[:, None] + change), precisions

    def draw(self, k: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """k draws z (n, k, n_parameters) each, and the log of their density (n, k)."""
        n, r, d = self.centres.shape
        known = self.planned.moments[0]
        means, widths = self.error_sizes
        z = np.broadcast_to(known, (n, k, len(known))).copy()
        z[..., d:] = means + widths * rng.standard_normal((n, k, means.shape[2]))
        scaled = (z[..., d:] - means) / widths
        log_density = -0.5 * (scaled**2 + np.log(2.0 * math.pi * widths**2)).sum(axis=2)
        variances = self.planned.error_variances(z if d < len(known) else z[:, :1])
        means, precisions = self.given(variances)
        picked = (self.log_shares[:, None] + rng.gumbel(size=(n, k, r))).argmax(axis=2)
        at = np.arange(n)[:, None], np.arange(k) % means.shape[1], picked
        steps = rng.standard_normal((n, k, d, 1))
        steps /= np.sqrt(rng.chisquare(PLANNING.tail, (n, k, 1, 1)) / PLANNING.tail)
        roots = np.linalg.cholesky(precisions[at]).swapaxes(-1, -2)
        z[..., :d] = means[at] + np.linalg.solve(roots, steps)[..., 0]
        off = z[:, :, None, :d] - means
        squares = (off[..., None, :] @ precisions @ off[..., None])[..., 0, 0]
        heights = self.log_shares[:, None] + 0.5 * np.linalg.slogdet(precisions)[1]
        tails = -0.5 * (PLANNING.tail + d) * np.log1p(squares / PLANNING.tail)
        constant = gammaln(0.5 * (PLANNING.tail + d)) - gammaln(0.5 * PLANNING.tail)
        log_density += logsumexp(heights + tails, axis=2) + constant
        return z, log_density - 0.5 * d * math.log(PLANNING.tail * math.pi)


def _mixture(
    planned: PlannedClass,
    found_hz: FloatArray,
    seen: FloatArray,
    z: FloatArray,
    rng: np.random.Generator,
) -> _Mixture:
    """About the points where searches from z (n, R, n_parameters) end, at known error sizes."""
    d = planned.n_structural
    mean, covariance = planned.moments
    shares = np.resize(PLANNING.shares_of_shapes, z.shape[1])
    sizes = np.stack([mean, PLANNING.error_width * np.sqrt(np.diag(covariance))])[:, None, None, d:]
    for added in PLANNING.narrowing:
        z = np.concatenate(
            [z[..., :d], np.broadcast_to(mean[d:], (*z.shape[:2], len(mean) - d))], 2
        )
        log_target, squares, products = _expanded(planned, found_hz, seen, z, shares, added, rng)
        mixture = _Mixture(planned, z[..., :d], squares, products, np.zeros(z.shape[:2]), sizes)
        variances = planned.error_variances(z[:, :1]) + np.square(added * FIRST_ERRORS)
        means, precisions = (each[:, 0] for each in mixture.given(variances))
        if added > 0.0:
            change = means - z[..., :d]
            longest = np.abs(change).max(axis=2, keepdims=True)
            z[..., :d] += change * np.minimum(1.0, PLANNING.most_step / np.maximum(longest, 1e-9))
    off = z[..., :d] - mean[:d]
    log_mass = log_target - 0.5 * (off @ np.linalg.inv(covariance[:d, :d]) * off).sum(axis=2)
    log_mass -= 0.5 * np.linalg.slogdet(precisions)[1]
    # Searches that ended at one point share its mass.
    apart = means[:, :, None] - means[:, None]
    distance = (apart[..., None, :] @ precisions[:, :, None] @ apart[..., None])[..., 0, 0]
    log_mass -= np.log(((distance < 1.0) & (shares[:, None] == shares)).sum(axis=2))
    log_mass = np.nan_to_num(log_mass, nan=-1e9, neginf=-1e9)
    for share in PLANNING.shares_of_shapes:  # as many draws for either kind
        log_mass[:, shares == share] -= logsumexp(log_mass[:, shares == share], axis=1)[:, None]
    mass = np.exp(log_mass) / len(PLANNING.shares_of_shapes)
    mixed = (1.0 - PLANNING.defensive) * mass + PLANNING.defensive / len(shares)
    return mixture._replace(log_shares=np.log(mixed))


def _expanded(
    planned: PlannedClass,
    found_hz: FloatArray,
    seen: FloatArray,
    z: FloatArray,
    shares: FloatArray,
    added: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At z (n, R, ·), for sampled pairings: log likelihood (n, R), squares and products."""
    n, r, n_all = z.shape
    d, h = planned.n_structural, PLANNING.difference
    shifted = np.repeat(z[:, :, None], d + 1, axis=2)
    shifted[:, :, np.arange(1, d + 1), np.arange(d)] += h
    modes = planned.modes(shifted.reshape(-1, n_all))
    modes = SeenModes(*(each.reshape(n, r, d + 1, *each.shape[1:]) for each in modes))
    at = SeenModes(*(each[:, :, 0] for each in modes))
    ratios = log_ratios(planned, found_hz, seen, at, added)
    chosen, _ = sampled_pairings(ratios.partly(shares), rng)
    log_target = ratios.unpaired + _of_pairs(ratios.partly(shares), chosen)
    index, used = np.maximum(chosen, 0)[:, :, None], (chosen >= 0)[:, :, None]
    logs = np.take_along_axis(np.log(modes.frequencies_hz), index, axis=3)
    shapes = np.take_along_axis(modes.shapes, index[:, :, :, None], axis=4)
    length = np.sqrt(np.square(shapes).sum(axis=3, keepdims=True))
    wanted = seen[:, None, None]
    sign = np.sign((shapes * wanted).sum(axis=3, keepdims=True))
    of_shapes = shapes * sign / np.where(length > 0.0, length, 1.0) - wanted
    of_shapes *= np.sqrt(shares)[:, None, None, None]
    squares, products = np.zeros((2, n, r, d, d)), np.zeros((2, n, r, d))
    for kind, off in enumerate(
        [(logs - np.log(found_hz)[:, None, None])[:, :, :, None], of_shapes]
    ):
        off = np.nan_to_num(np.where(used[:, :, :, None], off, 0.0)).reshape(n, r, d + 1, -1)
        slopes = (off[:, :, 1:] - off[:, :, :1]) / h
        squares[kind] = slopes @ slopes.swapaxes(-1, -2)
        products[kind] = -(slopes @ off[:, :, 0, :, None])[..., 0]
    return log_target, squares, products


def _error_sizes(draws: CentredDraws, d: int) -> FloatArray:
    """Mean and width of z of the error sizes, (2, n, 1, n_errors), after each test."""
    shares = draws.log_explained - logsumexp(draws.log_explained, axis=1, keepdims=True)
    shares = np.exp(np.minimum(shares, -0.5 * math.log(shares.shape[1])))[..., None]
    shares /= shares.sum(axis=1, keepdims=True)  # truncated: none decides alone
    mean = (shares * draws.z[..., d:]).sum(axis=1, keepdims=True)
    variance = (shares * np.square(draws.z[..., d:] - mean)).sum(axis=1, keepdims=True)
    return np.stack([mean, PLANNING.error_width * np.sqrt(variance) + 0.1])


def _draws(
    planned: PlannedClass,
    found_hz: FloatArray,
    seen: FloatArray,
    mixture: _Mixture,
    k: int,
    rng: np.random.Generator,
) -> CentredDraws:
    z, log_density = mixture.draw(k, rng)
    flat = z.reshape(-1, z.shape[2])
    modes = _batched(planned.modes(flat), z.shape[:2])
    ratios = log_ratios(planned, found_hz, seen, modes, 0.0)
    chosen, log_pairing = sampled_pairings(ratios.partly(PLANNING.shares_of_shapes[0]), rng)
    explained = ratios.unpaired + _of_pairs(ratios.frequency, chosen)
    before = planned.log_before(flat).reshape(z.shape[:2])
    shapes = np.take_along_axis(modes.shapes, np.maximum(chosen, 0)[:, :, None], axis=3)
    shapes = np.nan_to_num(np.where((chosen >= 0)[:, :, None], shapes, 0.0))
    return CentredDraws(
        before + explained - log_density - log_pairing,
        shapes.astype(np.float32),
        chosen >= 0,
        modes.variances[..., 1],
        z,
        before + ratios.unpaired + _of_pairs(ratios.partly(1.0), chosen) - log_density,
    )
