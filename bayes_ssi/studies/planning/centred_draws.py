"""Parameter values of a class about each simulated test, whose average is the class's evidence.

A test has its likelihood in a small part of the prior, in which few of a thousand prior draws lie,
or none: their average would be biased by nats. Here a few Gauss-Newton searches, from the prior
draws that suit a test best, find where the class comes nearest to it; parameters are drawn from
Student-t densities there, and each draw takes a pairing of modes in proportion to what it explains.
The weights are exact, so all that a poor search costs is effective draws, which are counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.studies.planning.plan_settings import PLANNING
from bayes_ssi.studies.planning.planned_class import PlannedClass, SeenModes
from bayes_ssi.studies.planning.simulated_tests import ShapeSums, SimulatedTests


class SeenTests(NamedTuple):
    """Tests as all candidates would give them, n at a time."""

    frequencies_hz: FloatArray  # (n, J)
    present: NDArray[np.bool_]  # (n, J)
    unit_shapes: FloatArray | None  # (n, n_candidates, J); None where no shape is scored

    def rows(self, which: slice) -> SeenTests:
        shapes = None if self.unit_shapes is None else self.unit_shapes[which]
        return SeenTests(self.frequencies_hz[which], self.present[which], shapes)


def target_of(tests: SimulatedTests) -> SeenTests:
    """The identified modes of tests at all candidates."""
    shapes, noise = tests.shapes, tests.noise
    d = shapes.shape[1]
    if d < 2:
        return SeenTests(tests.frequencies_hz, tests.present, None)
    sums = ShapeSums(*((x * y).sum(axis=1) for x, y in (
        (shapes, shapes), (shapes, noise), (noise, noise))))  # fmt: skip
    a, b = tests.coefficients(sums, d)
    unit = a[:, None] * shapes + b[:, None] * noise
    return SeenTests(tests.frequencies_hz, tests.present, unit)


class LogRatios(NamedTuple):
    """Log densities of identified modes j as model modes i over leaving both unpaired."""

    frequency: FloatArray  # (n, k, J, I)
    shape: FloatArray | float  # the same, of the shapes at all candidates; 0 where there are none
    unpaired: FloatArray  # (n, k), log density of all modes unpaired, shapes left out

    def with_shapes(self, share: float | FloatArray = PLANNING.shares_of_shapes[0]) -> FloatArray:
        """(n, k, J, I), with a share of the shapes, or one for each k."""
        return self.frequency + np.reshape(share, (-1, 1, 1)) * self.shape


@dataclass(frozen=True, eq=False)
class CentredDraws:
    """K draws of a class about each of N tests.

    Together with a pairing each; J places of identified modes in a test.
    """

    # (N, K): log of density before the test, times that of frequencies for the pairing, over the
    # density that draws and pairings come from.
    log_weights: FloatArray
    shapes: NDArray[np.float32]  # (n_candidates, N, K, J), of paired model modes; 0 elsewhere
    paired: NDArray[np.bool_]  # (N, K, J)
    shape_var: FloatArray  # (N, K), σ²
    z: FloatArray  # (N, K, n_parameters)


def centred_draws(
    planned: PlannedClass, tests: SimulatedTests, n_draws: int, rng: np.random.Generator
) -> CentredDraws:
    """Draws of the class about tests, which it or another class gave."""
    target = target_of(tests)
    pool_z = planned.draw(PLANNING.n_pool, rng)
    pool = _Model.at(planned, pool_z[None])
    n_modes, n_seen = planned.structure.n_modes, len(planned.candidates)
    step = max(1, PLANNING.array_size // (n_draws * n_modes * max(n_seen, 8)))
    parts = []
    for first in range(0, len(tests.present), step):
        rows = target.rows(slice(first, first + step))
        starts = _starts(rows, pool, planned, pool_z, rng)
        parts.append(_draws(rows, planned, _components(rows, planned, starts, rng), n_draws, rng))
    axis = {"shapes": 1}
    return CentredDraws(
        **{
            name: np.concatenate([getattr(part, name) for part in parts], axis=axis.get(name, 0))
            for name in CentredDraws.__dataclass_fields__
        }
    )


FIRST_ERRORS = np.array(PLANNING.first_errors)


class _Model(NamedTuple):
    """A class at parameter values z (n, k, n_parameters)."""

    frequencies_hz: FloatArray  # (n, k, I)
    shapes: FloatArray  # (n, k, n_candidates, I)
    variances: FloatArray  # (n, k, 2)

    def widened(self, share: float) -> _Model:
        """With errors such as the first look at a test needs, or a share of these."""
        return self._replace(variances=self.variances + np.square(share * FIRST_ERRORS))

    @classmethod
    def at(cls, planned: PlannedClass, z: FloatArray) -> _Model:
        flat = z.reshape(-1, z.shape[-1])
        modes = planned.modes(flat)
        arrays = SeenModes(*(each.reshape(*z.shape[:2], *each.shape[1:]) for each in modes))
        return cls(*arrays, planned.error_variances(flat).reshape(*z.shape[:2], 2))


def _log_ratios(target: SeenTests, planned: PlannedClass, model: _Model) -> LogRatios:
    frequencies, variances = model.frequencies_hz, model.variances
    expected = planned.identification.expected_spurious_modes
    log_spurious = math.log(expected) + planned.test.log_spurious
    flat = frequencies.reshape(-1, frequencies.shape[-1]), variances.reshape(-1, 2)
    missed = planned.log_missed(*flat).reshape(frequencies.shape)
    variance = variances[:, :, None, None, 0]
    identified = target.frequencies_hz[:, None, :, None]
    residuals = frequencies[:, :, None] / identified - 1.0
    detected = math.log(planned.identification.detection_probability) - log_spurious
    ratios = -0.5 * (residuals * residuals / variance + np.log(2.0 * math.pi * variance))
    ratios += detected - np.log(identified) - missed[:, :, None]
    ratios[~np.isfinite(ratios)] = -np.inf
    ratios = np.where(target.present[:, None, :, None], ratios, -np.inf)
    unpaired = target.present.sum(axis=1)[:, None] * log_spurious - expected + missed.sum(axis=2)
    return LogRatios(ratios, _shape_ratios(target, model), np.nan_to_num(unpaired, nan=-np.inf))


def _shape_ratios(target: SeenTests, model: _Model) -> FloatArray | float:
    if target.unit_shapes is None:
        return 0.0
    d, variance = target.unit_shapes.shape[1], model.variances[..., 1]
    identified = target.unit_shapes.transpose(0, 2, 1)[:, None]
    length = np.sqrt(np.square(model.shapes).sum(axis=2))
    cosine = np.abs(identified @ model.shapes) / np.where(length > 0.0, length, 1.0)[:, :, None]
    constants = log_sphere_area(d) - log_shape_normaliser(np.sqrt(variance), d)
    ratios = constants[:, :, None, None] - (1.0 - cosine) / variance[:, :, None, None]
    return np.nan_to_num(ratios, nan=0.0)


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


def _of_pairs(array: FloatArray, chosen: NDArray[np.intp], fill: float) -> FloatArray:
    """The entries (..., J) of (..., J, I) that are chosen (..., J)."""
    taken = np.take_along_axis(array, np.maximum(chosen, 0)[..., None], axis=-1)[..., 0]
    return np.where(chosen >= 0, taken, fill)


def _starts(
    target: SeenTests,
    pool: _Model,
    planned: PlannedClass,
    pool_z: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """z (n, n_starts, n_parameters): draws of the class that suit each test, at random."""
    n = len(target.frequencies_hz)
    repeated = _Model(*(np.broadcast_to(each, (n, *each.shape[1:])) for each in pool))
    # No more than an upper limit of the sum over pairings, which takes no time.
    ratios = _log_ratios(target, planned, repeated.widened(1.0)).with_shapes()
    matched = np.logaddexp(0.0, logsumexp(ratios, axis=3))
    scores = np.nan_to_num(matched.sum(axis=2), neginf=-1e9)
    scores -= scores.max(axis=1, keepdims=True)
    # Tempered such that three times as many draws as there are starts share the weight.
    low, high = np.zeros((n, 1)), np.ones((n, 1))
    for _ in range(30):
        middle = 0.5 * (low + high)
        weights = np.exp(middle * scores)
        many = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1) > 3.0 * PLANNING.n_starts
        low, high = np.where(many[:, None], middle, low), np.where(many[:, None], high, middle)
    best = np.argsort(-(low * scores + rng.gumbel(size=scores.shape)), axis=1)
    return pool_z[best[:, : PLANNING.n_starts]]


class _Components(NamedTuple):
    """Normal approximations about n_starts points each; of the structure's d parameters."""

    centre: FloatArray  # (n, R, d), points of expansion
    # (2, n, R, d, d) and (2, n, R, d): squares of the derivatives of frequencies and shapes, and
    # their products with the residuals, for errors of 1.
    squares: FloatArray
    products: FloatArray
    log_shares: FloatArray  # (n, R)

    def conditional(
        self, planned: PlannedClass, variances: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Means (n, k, R, d) and precisions (n, k, R, d, d) at squared errors (n, k, 2)."""
        mean, precision = _before(planned)
        shares = np.stack([np.ones(self.centre.shape[1]), _shares(self.centre.shape[1])])
        inverse = shares[:, None, None] / variances.transpose(2, 0, 1)[..., None]
        total = np.einsum("snkr,snrij->nkrij", inverse, self.squares) + precision
        right = np.einsum("snkr,snri->nkri", inverse, self.products)
        right += ((mean - self.centre) @ precision)[:, None]
        change = np.linalg.solve(total, right[..., None])[..., 0]
        return np.asarray(self.centre[:, None] + change, dtype=float), total


def _shares(n_starts: int) -> FloatArray:
    """Of the shapes, for each start: every other one is for layouts that see little of them."""
    return np.resize(PLANNING.shares_of_shapes, n_starts)


def _before(planned: PlannedClass) -> tuple[FloatArray, FloatArray]:
    """Mean and precision of the structure's parameters before the test."""
    d = planned.n_structural
    mean, covariance = planned.before
    precision = np.asarray(np.linalg.inv(covariance[:d, :d]), dtype=float)
    return mean[:d], precision


def _components(
    target: SeenTests, planned: PlannedClass, z: FloatArray, rng: np.random.Generator
) -> _Components:
    d = planned.n_structural
    z = z.copy()
    z[..., d:] = planned.before[0][d:]
    for share in PLANNING.narrowing:
        components, value, variances = _expanded(target, planned, z, share, rng)
        means, precisions = components.conditional(planned, variances[:, :1])
        if share > 0.0:
            change = means[:, 0] - z[..., :d]
            length = np.abs(change).max(axis=2, keepdims=True)
            z[..., :d] += change * np.minimum(1.0, PLANNING.most_step / np.maximum(length, 1e-9))
    log_mass = value - 0.5 * np.linalg.slogdet(precisions[:, 0])[1]
    # Searches that ended at one point share its mass.
    apart = z[:, :, None, :d] - z[:, None, :, :d]
    distance = np.einsum("nrsi,nrij,nrsj->nrs", apart, precisions[:, 0], apart)
    of_kind = _shares(z.shape[1])
    alike = (distance < 1.0) & (of_kind[:, None] == of_kind)
    log_mass -= np.log(alike.sum(axis=2))
    log_mass = np.nan_to_num(log_mass, nan=-1e9, neginf=-1e9)
    shares = np.empty(log_mass.shape)
    kinds = len(PLANNING.shares_of_shapes)
    for i in range(kinds):
        own = log_mass[:, i::kinds]
        shares[:, i::kinds] = np.exp(own - logsumexp(own, axis=1, keepdims=True)) / kinds
    mixed = (1.0 - PLANNING.defensive) * shares + PLANNING.defensive / shares.shape[1]
    return components._replace(log_shares=np.log(mixed))


def _expanded(
    target: SeenTests, planned: PlannedClass, z: FloatArray, share: float, rng: np.random.Generator
) -> tuple[_Components, FloatArray, FloatArray]:
    """Derivatives at z (n, R, ·) for sampled pairings, log target (n, R), squared errors."""
    n, r, _ = z.shape
    d, h = planned.n_structural, PLANNING.difference
    shifted = np.repeat(z[:, :, None], d + 1, axis=2)
    shifted[:, :, np.arange(1, d + 1), np.arange(d)] += h
    model = _Model.at(planned, shifted.reshape(n, r * (d + 1), -1))
    n_modes = model.frequencies_hz.shape[-1]
    at = _Model(*(each.reshape(n, r, d + 1, *each.shape[2:])[:, :, 0] for each in model))
    at = at.widened(share)
    ratios = _log_ratios(target, planned, at)
    own = ratios.with_shapes(_shares(r))
    chosen, _ = sampled_pairings(own, rng)
    value = ratios.unpaired + _of_pairs(own, chosen, 0.0).sum(axis=2)
    mean, precision = _before(planned)
    off = z[..., :d] - mean
    value = value - 0.5 * np.einsum("nri,ij,nrj->nr", off, precision, off)

    index = np.maximum(chosen, 0)[:, :, None]  # (n, R, 1, J)
    used = (chosen >= 0)[:, :, None]
    logs = np.log(model.frequencies_hz).reshape(n, r, d + 1, n_modes)
    logs = np.where(used, np.take_along_axis(logs, index, axis=3), 0.0)
    identified = np.log(target.frequencies_hz)[:, None, None]
    outputs = [(logs, np.where(used, identified, 0.0)[:, :, 0])]
    if target.unit_shapes is not None:
        shapes = model.shapes.reshape(n, r, d + 1, -1, n_modes)
        shapes = np.take_along_axis(shapes, index[:, :, :, None], axis=4)
        length = np.sqrt(np.square(shapes).sum(axis=3, keepdims=True))
        shapes = shapes / np.where(length > 0.0, length, 1.0)
        wanted = np.where(used[:, :, 0, None], target.unit_shapes[:, None], 0.0)
        sign = np.sign((shapes * wanted[:, :, None]).sum(axis=3, keepdims=True))
        shapes = np.where(used[:, :, :, None], shapes * sign, 0.0)
        outputs.append((shapes.reshape(n, r, d + 1, -1), wanted.reshape(n, r, -1)))
    squares, products = np.zeros((2, n, r, d, d)), np.zeros((2, n, r, d))
    for kind, (output, wanted) in enumerate(outputs):
        output = np.nan_to_num(output)
        derivatives = (output[:, :, 1:] - output[:, :, :1]) / h
        squares[kind] = derivatives @ derivatives.transpose(0, 1, 3, 2)
        products[kind] = (derivatives @ (wanted - output[:, :, 0])[..., None])[..., 0]
    components = _Components(z[..., :d].copy(), squares, products, np.zeros((n, r)))
    return components, value, at.variances


def _draws(
    target: SeenTests,
    planned: PlannedClass,
    components: _Components,
    k: int,
    rng: np.random.Generator,
) -> CentredDraws:
    n, r, d = components.centre.shape
    z, log_q = _drawn_errors(planned, (n, k), rng)
    shape = (n, 1) if planned.has_fixed_errors else (n, k)
    flat = z[:, : shape[1]].reshape(-1, z.shape[2])
    variances = planned.error_variances(flat).reshape(*shape, 2)
    means, precisions = components.conditional(planned, variances)
    picked = (components.log_shares[:, None] + rng.gumbel(size=(n, k, r))).argmax(axis=2)
    rows, columns = np.arange(n)[:, None], np.arange(k) if shape[1] > 1 else np.zeros(1, np.intp)
    factors = np.linalg.cholesky(precisions).swapaxes(-1, -2)
    normals = rng.standard_normal((n, k, d)) / np.sqrt(
        rng.chisquare(PLANNING.tail, (n, k, 1)) / PLANNING.tail
    )
    spread = np.linalg.solve(factors[rows, columns, picked], normals[..., None])[..., 0]
    z[..., :d] = means[rows, columns, picked] + spread
    off = z[:, :, None, :d] - means
    squares = (off[..., None, :] @ precisions @ off[..., None])[..., 0, 0]
    log_t = (
        0.5 * np.linalg.slogdet(precisions)[1]
        - 0.5 * (PLANNING.tail + d) * np.log1p(squares / PLANNING.tail)
        + float(gammaln(0.5 * (PLANNING.tail + d)) - gammaln(0.5 * PLANNING.tail))
        - 0.5 * d * math.log(PLANNING.tail * math.pi)
    )
    log_q = log_q + logsumexp(components.log_shares[:, None] + log_t, axis=2)

    model = _Model.at(planned, z)
    ratios = _log_ratios(target, planned, model)
    chosen, log_pairing = sampled_pairings(ratios.with_shapes(), rng)
    before = planned.log_before(z.reshape(-1, z.shape[2])).reshape(n, k)
    explained = ratios.unpaired + _of_pairs(ratios.frequency, chosen, 0.0).sum(axis=2)
    shapes = np.take_along_axis(model.shapes, np.maximum(chosen, 0)[:, :, None], axis=3)
    shapes = np.nan_to_num(np.where((chosen >= 0)[:, :, None], shapes, 0.0))
    return CentredDraws(
        before + explained - log_q - log_pairing,
        shapes.transpose(2, 0, 1, 3).astype(np.float32),
        chosen >= 0,
        model.variances[..., 1],
        z,
    )


def _drawn_errors(
    planned: PlannedClass, shape: tuple[int, int], rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """z (n, k, n_parameters) with those of the errors drawn, and the log of their density."""
    d = planned.n_structural
    mean, covariance = planned.before
    sd = PLANNING.wider_errors * np.sqrt(np.diag(covariance)[d:])
    normals = rng.standard_normal((*shape, len(sd)))
    z = np.broadcast_to(mean, (*shape, len(mean))).copy()
    z[..., d:] += sd * normals
    log_density = -0.5 * np.square(normals).sum(axis=2) - np.log(sd * math.sqrt(2 * math.pi)).sum()
    return z, log_density
