"""Parameter values of a class about each simulated test, whose average is the class's evidence.

A test has its likelihood in a small part of the prior, in which few of a thousand prior draws lie,
or none: their average would be biased by nats. Here Gauss-Newton searches, from prior draws that
suit a test, find where the class comes near it; parameters are drawn from Student-t densities
there, and each draw takes a pairing of modes in proportion to what it explains.

What suits a test depends on the sensors: where they are few, quite other parameters and pairings
explain it than where they are many. Searches and pairings hence serve several layouts in turn,
frequencies alone and all candidates among them. The weights of draws are exact, so all that a poor
search costs is effective draws, which are counted.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.studies.planning.planned_class import BATCH, PlannedClass, SeenModes, SimulatedTests

N_POOL = 600  # draws of a class, of which those that suit a test start its searches
N_STARTS = 4  # for each of the layouts that draws serve
# Where sizes of errors are inferred, draws about every point where a second search of a layout
# ends: more points, close together, fill the many directions that data leave wide.
DRAWS_OF_A_START = 25
# Errors of frequencies and shapes that are added at first, the distance between a test and the
# nearest draws; and their share in every Gauss-Newton step, none at last.
FIRST_ERRORS = (0.05, 0.2)
NARROWING = (1.0, 0.2, 0.0)
MOST_STEP = 2.0  # of z, beyond which modes are not linear
DIFFERENCE_OF_Z = 1e-3  # of z, for derivatives
# Of the densities of draws, where data do not narrow them, as a share of the prior's: modes
# are not linear beyond, and there are many densities side by side.
WIDTH_OF_DRAWS = 0.5
TAIL_OF_DRAWS = 6.0  # degrees of freedom of the Student-t densities of draws


class CentredDraws(NamedTuple):
    """K draws of a class about each of N tests, each with a pairing."""

    # (N, K): log of the density before the test, times that of the frequencies for the pairing,
    # over the density that draws and pairings come from.
    log_weights: FloatArray
    shapes: NDArray[np.float32]  # (N, n_candidates, K, J), of paired model modes; 0 elsewhere
    n_paired: NDArray[np.intp]  # (N, K)
    shape_var: FloatArray  # (N, K), σ²
    z: FloatArray  # (N, K, n_parameters)


class Seen(NamedTuple):
    """What S layouts see of n tests: of shapes nothing where they have fewer than two sensors."""

    frequencies_hz: FloatArray  # (n, J)
    shapes: FloatArray  # (S, n, n_candidates, J), of unit length; 0 where there is no sensor
    sensors: NDArray[np.bool_]  # (S, n_candidates)

    @classmethod
    def of(cls, tests: SimulatedTests, layouts: Sequence[Sequence[int]]) -> "Seen":
        sensors = np.zeros((len(layouts), tests.shapes.shape[1]), dtype=bool)
        shapes = np.zeros((len(layouts), *tests.shapes.shape))
        for i, layout in enumerate(layouts):
            if len(layout) > 1:
                sensors[i, layout] = True
                shapes[i][:, layout] = tests.identified_shapes(layout)
        return cls(tests.frequencies_hz, shapes, sensors)


def centred_draws(
    planned: PlannedClass,
    tests: SimulatedTests,
    layouts: Sequence[Sequence[int]],
    n_draws: int,
    rng: np.random.Generator,
) -> CentredDraws:
    """Draws of the class about tests that it or another class gave, for layouts of sensors.

    The first layout is the empty one: its weights are those that :class:`CentredDraws` keep.
    """
    pool_z = planned.draw(N_POOL, rng)
    pool = planned.modes(pool_z[None])
    of_pairs = len(layouts) * max(n_draws, N_POOL) * tests.frequencies_hz.shape[1]
    of_shapes = n_draws * len(planned.candidates)
    per_test = max(of_pairs, of_shapes) * pool.frequencies_hz.shape[2]
    step, parts = max(1, BATCH // per_test), []
    for first in range(0, len(tests.shapes), step):
        seen = Seen.of(tests.rows(slice(first, first + step)), layouts)
        ratios, unpaired = log_ratios(planned, seen, pool, 1.0)
        # The best pairs, whether they exclude one another or not.
        matched = unpaired + np.maximum(ratios.max(axis=4), 0.0).sum(axis=3)
        z = pool_z[_resampled(matched, N_STARTS, rng)]
        for added in NARROWING:
            z, precisions = _searched(planned, seen, z, added, rng)
        if planned.n_structural < z.shape[2]:  # the sizes of errors are inferred
            log_weights, draws = _draws(planned, seen, z, precisions, n_draws, rng)
            # These draws know which sizes explain the test; those of the pool do not.
            n_starts = max(N_STARTS, n_draws // DRAWS_OF_A_START)
            again = _resampled(log_weights, n_starts, rng)
            z = np.take_along_axis(draws.z, again[..., None], axis=1)
            z, precisions = _searched(planned, seen, z, 0.0, rng)
        _, draws = _draws(planned, seen, z, precisions, n_draws, rng)
        parts.append(draws)
    return joined(parts)


def _resampled(
    log_weights: FloatArray, n_starts: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Places (n, R) drawn after the log weights (S, n, k) of each layout; none decides alone."""
    k = log_weights.shape[2]
    log_shares = log_weights - logsumexp(log_weights, axis=2, keepdims=True)
    log_shares = np.minimum(log_shares, -0.5 * math.log(k))[:, :, None]
    noise = rng.gumbel(size=(*log_weights.shape[:2], n_starts, k))
    return np.asarray(np.concatenate((log_shares + noise).argmax(axis=3), axis=1))


def log_ratios(
    planned: PlannedClass, seen: Seen, modes: SeenModes, added: float
) -> tuple[FloatArray, FloatArray]:
    """Pairs of n tests and modes (n or 1, k, …), with a share of the first errors added.

    Returns:
        Log density (S, n, k, J, I) of identified modes j as model modes i over leaving both
        unpaired, with the shapes that each layout sees; and (n, k), that of all modes unpaired,
        shapes left out.
    """
    frequencies, shape_of_modes, variances = modes
    variances = variances + np.square(np.multiply(added, FIRST_ERRORS))
    identification, band_hz = planned.model_class.identification, planned.configuration.data.band_hz
    missed = identification.log_missed(frequencies, variances[..., :1], band_hz)
    log_spurious = math.log(identification.expected_spurious_modes / (band_hz[1] - band_hz[0]))
    variance, shape_var = np.moveaxis(variances[:, :, None, None], -1, 0)
    identified_hz = seen.frequencies_hz[:, None, :, None]
    residuals = frequencies[:, :, None] / identified_hz - 1.0
    ratios = -0.5 * (residuals * residuals / variance + np.log(2.0 * math.pi * variance))
    ratios += math.log(identification.detection_probability) - log_spurious
    ratios = np.nan_to_num(ratios - np.log(identified_hz) - missed[:, :, None], nan=-np.inf)
    n_identified = np.isfinite(seen.frequencies_hz).sum(axis=1)[:, None]
    unpaired = n_identified * log_spurious - identification.expected_spurious_modes
    unpaired = np.nan_to_num(unpaired + missed.sum(axis=2), nan=-np.inf)
    of_layouts = np.repeat(ratios[None], len(seen.sensors), axis=0)
    for total, shapes, sensors in zip(of_layouts, seen.shapes, seen.sensors, strict=True):
        if (d := int(sensors.sum())) > 1:
            of_modes = shape_of_modes[:, :, sensors]
            length = np.sqrt(np.square(of_modes).sum(axis=2))[:, :, None]
            cosine = np.abs(shapes[:, sensors].swapaxes(1, 2)[:, None] @ of_modes)
            distance = 1.0 - cosine / np.where(length > 0.0, length, 1.0)
            constant = log_sphere_area(d) - log_shape_normaliser(np.sqrt(shape_var), d)
            total += np.nan_to_num(constant - distance / shape_var)
    return of_layouts, unpaired


def _sampled_pairings(
    ratios: FloatArray, layout: NDArray[np.intp], rng: np.random.Generator
) -> tuple[NDArray[np.intp], FloatArray]:
    """A random pairing for each row, by the log ratios (S, n, k, J, I) of its layout (k,).

    Identified modes choose one after the other, in an order of its own in each row, among the model
    modes that are left, or none: a draw of all orders gives every pairing its chance.

    Returns:
        The model mode (n, k, J), -1 for none; and (n, k), the log of the probability that one of
        the layouts, each as often as the others, would have given this pairing in this order.
    """
    n_layouts, n, k, n_data, n_model = ratios.shape
    order = rng.random((n, k, n_data)).argsort(axis=2)
    chosen = np.full((n, k, n_data), -1, dtype=np.intp)
    taken = np.zeros((n, k, n_model), dtype=bool)
    log_probability = np.zeros((n_layouts, n, k))
    for place in range(n_data):
        j = order[:, :, place, None]
        pairs = np.take_along_axis(ratios, j[None, ..., None], axis=3)[..., 0, :]
        pairs = np.where(taken, -np.inf, pairs)
        options = np.concatenate([pairs, np.zeros((n_layouts, n, k, 1))], axis=3)
        drawn = options[layout, :, np.arange(k)].swapaxes(0, 1)
        picked = (drawn + rng.gumbel(size=drawn.shape)).argmax(axis=2)[..., None]
        log_probability += np.take_along_axis(options, picked[None], axis=3)[..., 0]
        log_probability -= logsumexp(options, axis=3)
        np.put_along_axis(chosen, j, np.where(picked < n_model, picked, -1), axis=2)
        taken |= np.arange(n_model) == picked
    return chosen, np.asarray(logsumexp(log_probability, axis=0)) - math.log(n_layouts)


def _searched(
    planned: PlannedClass, seen: Seen, z: FloatArray, added: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """A Gauss-Newton step from z (n, R, n_parameters), for sampled pairings.

    It goes to the nearest point that fits, not towards the prior: many points may fit as well.

    Returns:
        z after it; and the precisions (n, R, n_parameters, n_parameters) of parameters there.
    """
    n, r, n_all = z.shape
    d, h = planned.n_structural, DIFFERENCE_OF_Z
    shifted = np.repeat(z[:, :, None], d + 1, axis=2)
    shifted[:, :, np.arange(1, d + 1), np.arange(d)] += h
    modes = planned.modes(shifted)
    at = SeenModes(*(array[:, :, 0] for array in modes))
    layout = np.repeat(np.arange(len(seen.sensors)), r // len(seen.sensors))
    ratios, _ = log_ratios(planned, seen, at, added)
    chosen, _ = _sampled_pairings(ratios, layout, rng)

    index, used = np.maximum(chosen, 0)[:, :, None], (chosen >= 0)[:, :, None]
    sd = np.sqrt(at.variances + np.square(np.multiply(added, FIRST_ERRORS)))[:, :, None]
    logs = np.take_along_axis(np.log(modes.frequencies_hz), index, axis=3)
    of_frequencies = (logs - np.log(seen.frequencies_hz)[:, None, None]) / sd[..., :1]
    shapes = np.take_along_axis(modes.shapes, index[:, :, :, None], axis=4)
    shapes = shapes * seen.sensors[layout][:, None, :, None]
    wanted = seen.shapes[layout].swapaxes(0, 1)[:, :, None]
    length = np.sqrt(np.square(shapes).sum(axis=3, keepdims=True))
    length *= np.sign((shapes * wanted).sum(axis=3, keepdims=True))
    of_shapes = (shapes / np.where(length == 0.0, 1.0, length) - wanted) / sd[..., 1:, None]
    residuals = np.concatenate([of_frequencies[:, :, :, None], of_shapes], axis=3)
    residuals = np.where(used[:, :, :, None], np.nan_to_num(residuals), 0.0)
    residuals = residuals.reshape(n, r, d + 1, -1)
    slopes = np.zeros((n, r, n_all, residuals.shape[3]))
    slopes[:, :, :d] = (residuals[:, :, 1:] - residuals[:, :, :1]) / h
    precisions = slopes @ slopes.swapaxes(-1, -2) + planned.precision / WIDTH_OF_DRAWS**2
    step = -np.linalg.solve(precisions, slopes @ residuals[:, :, 0, :, None])[..., 0]
    longest = np.abs(step).max(axis=2, keepdims=True)
    return z + step * np.minimum(1.0, MOST_STEP / np.maximum(longest, 1e-9)), precisions


def _draws(
    planned: PlannedClass,
    seen: Seen,
    centres: FloatArray,
    precisions: FloatArray,
    k: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, CentredDraws]:
    """k draws about each test of Student-t densities about the centres (n, R, n_parameters).

    And their log weights (S, n, k), with the shapes that each layout sees.
    """
    n, r, d = centres.shape
    factors = np.linalg.inv(np.linalg.cholesky(precisions)).swapaxes(-1, -2)
    tails = np.full(r, TAIL_OF_DRAWS)
    z, log_density = np.empty((n, k, d)), np.empty((n, k))
    for row, (means, own) in enumerate(zip(centres, factors, strict=True)):
        mixture = StudentMixture(np.full(r, 1.0 / r), means, own, tails)
        counts = np.append(rng.multinomial(k, mixture.weights), 0)
        z[row] = rng.permutation(mixture.draw(counts, rng))
        log_density[row] = mixture.log_pdf(z[row])

    modes = planned.modes(z)
    ratios, unpaired = log_ratios(planned, seen, modes, 0.0)
    layout = rng.integers(len(seen.sensors), size=k)
    chosen, log_pairing = _sampled_pairings(ratios, layout, rng)
    index = np.maximum(chosen, 0)
    log_weights = planned.log_before(z.reshape(-1, d)).reshape(n, k) + unpaired
    log_weights -= log_density + log_pairing
    of_pairs = np.take_along_axis(ratios, index[None, ..., None], axis=4)[..., 0]
    by_layout = log_weights + np.where(chosen >= 0, of_pairs, 0.0).sum(axis=3)
    shapes = np.take_along_axis(modes.shapes, index[:, :, None], axis=3)
    shapes = np.nan_to_num(np.where((chosen >= 0)[:, :, None], shapes, 0.0))
    paired, shape_var = shapes.swapaxes(1, 2).astype(np.float32), modes.variances[..., 1]
    n_paired = (chosen >= 0).sum(axis=2)
    return by_layout, CentredDraws(by_layout[0], paired, n_paired, shape_var, z)
