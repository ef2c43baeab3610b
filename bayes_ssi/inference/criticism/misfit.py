"""How far the identified modes of one test are from a model's, draw by draw.

If the model class is right and the draws are from its posterior, each probability here is uniform
(see :mod:`bayes_ssi.inference.criticism.adequacy`).

Where a posterior lies at the edge of a setting, of a parameter's prior or of the band, the result
depends on it besides the data. By how much, only a ranking can say, in which the setting is moved
for all classes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, gammaincc, gammaln, log_ndtr, logsumexp, ndtr, ndtri_exp, pdtrc

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray, evenly_spaced_indices
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.shape_density import log_shape_survival
from bayes_ssi.inference.model_class.model_class import ModelClass

LOWEST_LOG_P = -1e300  # of a probability, as log 0 has no place in sums
INADEQUATE = 0.01  # p-value below which a class is inadequate; right ones are this often
ROUGH = 0.05  # with a larger error of frequencies, wrong stiffnesses fit as well
N_DRAWS = 400  # a quantile of 0.01 needs no more; each takes the shapes' quadrature
EXPECTED_SHARE = 0.95  # of a right model's shapes that have the MAC called expected
PRIOR_EDGE = 3.09  # in prior sds: one prior draw in a thousand lies beyond, each side
EDGE_SHARE = 0.5  # of the posterior, that may lie at an edge, of a prior or the band


def log_two_sided(residuals: FloatArray) -> FloatArray:
    """log P(|x| > |residual|) of a standard-normal x."""
    return np.asarray(math.log(2.0) + log_ndtr(-np.abs(residuals)), dtype=float)


def log_chi_square(squares: FloatArray, n: IntArray | int) -> FloatArray:
    """log P(χ² > squares) with ``n`` degrees of freedom; NaN where ``squares`` is."""
    a, x = 0.5 * np.asarray(n, dtype=float), 0.5 * squares
    with np.errstate(divide="ignore", invalid="ignore"):
        log_p = np.log(gammaincc(a, x))
        # Far out, Γ(a, x) ≈ x^(a-1) e^(-x) / (1 - (a - 1)/x), its series taken for a geometric one.
        far_out = (a - 1.0) * np.log(x) - x - gammaln(a) - np.log1p((1.0 - a) / x)
    return np.where(np.isneginf(log_p), far_out, log_p)


def log_joint(log_p: FloatArray, counted: BoolArray) -> FloatArray:
    """Fisher's combination (B,) of the independent p-values (B, n) that are counted.

    -2 Σ ln p of m of them is χ² with 2 m degrees of freedom. It is one where none is counted.
    """
    log_product = np.where(counted, log_p, 0.0).sum(axis=1)
    total = np.clip(-log_product, 0.0, -LOWEST_LOG_P)  # by rounding it may be below zero
    return log_chi_square(2.0 * total, 2 * np.maximum(counted.sum(axis=1), 1))


def log_harmonic_mean(log_p: FloatArray, axis: int) -> FloatArray:
    """The harmonic mean of p-values that depend on one another in an unknown way.

    Nearly a p-value itself whatever their dependence: exactly one where they are equal; of a
    hundred independent ones it is below 0.01 with probability 0.011 (Wilson 2019, The harmonic
    mean p-value for combining dependent tests, PNAS 116).
    """
    n = log_p.shape[axis]
    lowest = np.maximum(log_p, LOWEST_LOG_P)
    return np.asarray(np.minimum(math.log(n) - logsumexp(-lowest, axis=axis), 0.0), dtype=float)


def log_combined(log_p: FloatArray) -> FloatArray:
    """One p-value (B,) of several independent ones (B, n).

    Small if many are somewhat small, by Fisher's combination, or if one is very small, by the
    harmonic mean; the two are combined by their harmonic mean.
    """
    many = log_joint(log_p, np.ones(log_p.shape, dtype=bool))
    return log_harmonic_mean(np.stack([many, log_harmonic_mean(log_p, axis=1)]), axis=0)


def standard_deviations(log_p: float) -> float:
    """The distance from the mean that a normal variable exceeds, on both sides, with this p."""
    return max(0.0, -float(ndtri_exp(log_p - math.log(2.0))))


# The p-value of an inadequate class as a distance from the mean of a normal variable.
INADEQUATE_SDS = standard_deviations(math.log(INADEQUATE))


class Misfit(NamedTuple):
    """The misfit of J identified modes at B draws; NaN where a mode is spurious at a draw."""

    frequency_errors: FloatArray  # (B, J), model frequency over identified frequency, less one
    frequency_sds: FloatArray  # (B, J), the standard deviation that it should have
    frequency_log_p: FloatArray  # (B, J), log probability of a larger error
    macs: FloatArray  # (B, J); NaN also where no shape is scored, as are the next two
    expected_macs: FloatArray  # (B, J), exceeded by 95 % of the shapes of a right model
    shape_log_p: FloatArray  # (B, J), log probability of a smaller MAC
    # (B,), number of model modes that are not identified and would be expected to be, by their
    # probabilities to lie in the band.
    unidentified: FloatArray
    spurious_log_p: FloatArray  # (B,), log probability of as many spurious modes or more
    detected_log_p: FloatArray  # (B,), log probability of as few identified model modes or fewer


def misfit(
    likelihood: ModalLikelihood, values: FloatArray, modes: ComparedModes, rng: np.random.Generator
) -> Misfit:
    """The misfit of one configuration's identified modes at posterior draws (B, n_parameters).

    ``rng`` draws the pairing at each draw, where it is inferred.
    """
    pairs, n_data = likelihood.pairs, len(likelihood.data.modes)
    which = likelihood.sampled_pairs(values, modes, rng)
    shape_of_pair = np.full(len(pairs.modes) + 1, -1, dtype=np.intp)  # the last one is of no pair
    shape_of_pair[pairs.with_shape] = np.arange(len(pairs.with_shape))
    which_shape = shape_of_pair[which]
    frequency_sds, shape_sds = likelihood.standard_errors(values)
    errors = _taken(pairs.frequency_residuals(modes.frequencies_hz), which)
    sds = _taken(frequency_sds, which)
    distances = _taken(modes.shape_distances, which_shape)
    shape_sds = _taken(shape_sds, which_shape)
    frequency_log_p = log_two_sided(errors / sds)
    shape_log_p, expected_distances = _shape_misfit(likelihood, distances, shape_sds)
    if likelihood.joint_pairs is not None:
        own = likelihood.joint_pairs.errors(*likelihood.residuals(values, modes))
        frequency_log_p = log_two_sided(_taken(own[0], which))
        directions = np.array([max(mode.n_measured - 1, 0) for mode in likelihood.data.modes])
        squares, variances, squared_variances = (
            _taken(each, np.where(which_shape < 0, -1, which)) for each in own[1:]
        )
        shape_log_p = log_chi_square(squares, directions)
        # The sum of squares with these variances, as a multiple of chi-square of the same mean and
        # variance (Satterthwaite 1946).
        with np.errstate(invalid="ignore"):
            quantile = chdtri(variances**2 / squared_variances, 1.0 - EXPECTED_SHARE)
            expected_distances = 0.5 * squared_variances / variances * quantile
        expected_distances = np.minimum(expected_distances, 1.0)
    identification = likelihood.identification
    every = range(likelihood.structure.n_modes)
    error_var = likelihood.prediction_var(values)[:, :1]
    detected = -np.expm1(likelihood.log_missed(modes.frequencies_hz, error_var, every))
    model_modes = np.append(pairs.model_modes, -1)[which]
    is_paired = (model_modes[:, :, None] == np.arange(detected.shape[1])).any(axis=1)
    n_paired = is_paired.sum(axis=1)
    unseen = np.where(is_paired, 0.0, detected).sum(axis=1)
    n_spurious, expected = n_data - n_paired, identification.expected_spurious_modes
    as_many = np.where(n_spurious > 0, pdtrc(np.maximum(n_spurious - 1, 0), expected), 1.0)
    with np.errstate(divide="ignore"):
        return Misfit(
            frequency_errors=errors,
            frequency_sds=sds,
            frequency_log_p=frequency_log_p,
            macs=(1.0 - distances) ** 2,
            expected_macs=(1.0 - expected_distances) ** 2,
            shape_log_p=shape_log_p,
            unidentified=unseen / identification.detection_probability,
            spurious_log_p=np.log(as_many),
            detected_log_p=np.log(_at_most(n_paired, detected)),
        )


def _taken(columns: FloatArray, which: IntArray) -> FloatArray:
    """The chosen columns (B, J) of each row; NaN where the choice is -1."""
    with_none = np.column_stack([columns, np.full(len(columns), np.nan)])
    return np.take_along_axis(with_none, which, axis=1)


def _shape_misfit(
    likelihood: ModalLikelihood, distances: FloatArray, sds: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Log probabilities of larger distances, and the distances to expect, (B, J)."""
    log_p, expected = np.full(distances.shape, np.nan), np.full(distances.shape, np.nan)
    for j, mode in enumerate(likelihood.data.modes):
        rows = np.flatnonzero(np.isfinite(distances[:, j]))
        if len(rows):
            distance, sd, d = distances[rows, j], sds[rows, j], mode.n_measured
            log_p[rows, j] = log_shape_survival(distance, sd, d)
            # On a plane in place of the sphere the distance is half a sum of d - 1 squares.
            flat = 0.5 * sd**2 * chdtri(d - 1, 1.0 - EXPECTED_SHARE)
            expected[rows, j] = np.minimum(flat, 1.0)
    return log_p, expected


def _at_most(n: IntArray, probabilities: FloatArray) -> FloatArray:
    """Probability (B,) of ``n`` events or fewer of those with these probabilities (B, I)."""
    n_events = probabilities.shape[1]
    shares = np.zeros((len(n), n_events + 1))
    shares[:, 0] = 1.0
    for i in range(n_events):
        moved = shares[:, :-1] * probabilities[:, i : i + 1]
        shares *= 1.0 - probabilities[:, i : i + 1]
        shares[:, 1:] += moved
    return np.where(np.arange(n_events + 1) <= n[:, None], shares, 0.0).sum(axis=1)


@dataclass(frozen=True)
class AtEdge:
    """Most of a posterior lies at the edge of a setting."""

    statement: str
    end: int
    parameter: str | None = None  # name of the parameter whose prior it is; None for the band
    configuration: str | None = None  # name of the configuration whose band it is; None for a prior
    is_near_bound: bool = False  # of a prior, not where only one in a thousand prior draws lies


def edges(model_class: ModelClass, z: FloatArray, frequencies_hz: FloatArray) -> Iterator[AtEdge]:
    """The edges at which a posterior lies, from draws ``z`` (n, d).

    ``frequencies_hz`` (n, n_modes) are the model's there, all configurations in turn.
    """
    for column, parameter in enumerate(model_class.parameters):
        below, of_prior = ndtr(z[:, column]), parameter.prior
        for end, beyond in enumerate((z[:, column] < -PRIOR_EDGE, z[:, column] > PRIOR_EDGE)):
            # Of draws that fall from a bound as an exponential, 63 % are so near, and 45 % of half
            # a normal density, as the prior counts: draws of the prior itself are spread evenly.
            # Zero bounds the quantity itself.
            is_bound = 0.0 < abs(of_prior.support[end]) < math.inf
            near = is_bound & (np.abs(below - end) < below.std())
            share, where = beyond.mean(), "where only one in a thousand prior draws lies"
            if is_near := bool(near.mean() > EDGE_SHARE >= share):
                share, where = near.mean(), "within one of its own standard deviations"
            if share > EDGE_SHARE:
                statement = (
                    f"parameter {parameter.name!r}: {100 * share:.0f} % of the posterior lies at "
                    f"the {('lower', 'upper')[end]} edge of its prior, {of_prior!r}, {where}"
                )
                yield AtEdge(statement, end, parameter=parameter.name, is_near_bound=is_near)
    # The standard error of a share estimated from a thousand draws is 0.016 at most.
    chosen = evenly_spaced_indices(len(z), 1000)
    different, first, times = np.unique(z[chosen], axis=0, return_index=True, return_counts=True)
    remaining = frequencies_hz[chosen[first]]
    for configuration, likelihood, values in model_class.parts(model_class.values(different)):
        band = configuration.data.band_hz
        where = f"configuration {configuration.name!r}: " if configuration.name else ""
        n_modes = configuration.structure.n_modes
        frequencies, remaining = remaining[:, :n_modes], remaining[:, n_modes:]
        shares = times @ likelihood.at_band_edge(values, frequencies) / len(chosen)
        for mode, share in enumerate(shares, start=1):
            if share > EDGE_SHARE:
                middle = float(np.median(frequencies[:, mode - 1]))
                statement = (
                    f"{where}model mode {mode} is paired with nothing and lies at the edge of the "
                    f"band {band[0]:g} to {band[1]:g} Hz in {100 * share:.0f} % of the posterior: "
                    "whether it counts as missed depends on where the band ends"
                )
                end = int(abs(middle - band[1]) < abs(middle - band[0]))
                yield AtEdge(statement, end, configuration=configuration.name)
