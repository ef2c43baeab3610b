"""How far the identified modes of one test are from a model's, draw by draw.

If the model class is right and the draws are from its posterior, each probability here is uniform
(see :mod:`bayes_ssi.inference.criticism.adequacy`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, pdtrc

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.criticism.p_values import log_chi_square, log_two_sided
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.likelihood_terms import ComparedModes
from bayes_ssi.inference.likelihood.shape_density import log_shape_survival

# The share of the shapes of a right model whose MAC is at least the one that is called expected.
EXPECTED_SHARE = 0.95


class Misfit(NamedTuple):
    """The misfit of J identified modes at B draws; NaN where a mode is spurious at a draw.

    Attributes:
        frequency_errors: (B, J), model frequency over identified frequency, less one.
        frequency_sds: (B, J), the standard deviation that it should have.
        frequency_log_p: (B, J), log probability of a larger error.
        macs: (B, J); NaN also where no shape is scored, as are the next two.
        expected_macs: (B, J), exceeded by 95 % of the shapes of a right model.
        shape_log_p: (B, J), log probability of a smaller MAC.
        unidentified: (B,), number of model modes that are not identified and would be expected to
            be, by their probabilities to lie in the band.
        spurious_log_p: (B,), log probability of as many spurious modes or more.
        detected_log_p: (B,), log probability of as few identified model modes or fewer.
        joint_log_p: (B,), log probability of a larger misfit of all paired modes together, where
            their errors are joint; None elsewhere.
    """

    frequency_errors: FloatArray
    frequency_sds: FloatArray
    frequency_log_p: FloatArray
    macs: FloatArray
    expected_macs: FloatArray
    shape_log_p: FloatArray
    unidentified: FloatArray
    spurious_log_p: FloatArray
    detected_log_p: FloatArray
    joint_log_p: FloatArray | None


def misfit(
    likelihood: ModalLikelihood,
    values: FloatArray,
    modes: ComparedModes,
    rng: np.random.Generator,
) -> Misfit:
    """The misfit of one configuration's identified modes.

    Args:
        values: draws from the posterior, (B, n_parameters).
        rng: draws the pairing at each draw, where it is inferred.
    """
    pairs, n_data = likelihood.pairs, len(likelihood.data.modes)
    which = likelihood.pairs_of(likelihood.sampled_pairings(values, modes, rng))
    shape_of_pair = np.full(len(pairs.modes) + 1, -1, dtype=np.intp)  # the last one is of no pair
    shape_of_pair[pairs.with_shape] = np.arange(len(pairs.with_shape))
    which_shape = shape_of_pair[which]
    frequency_sds, shape_sds = likelihood.errors.of_pairs(values)
    errors = _taken(pairs.frequency_residuals(modes.frequencies_hz), which)
    sds = _taken(frequency_sds, which)
    distances, shape_sds = (
        _taken(modes.shape_distances, which_shape),
        _taken(shape_sds, which_shape),
    )
    frequency_log_p = log_two_sided(errors / sds)
    shape_log_p, expected_distances = _shape_misfit(likelihood, distances, shape_sds)
    if likelihood.joint_pairs is not None:
        own = likelihood.joint_pairs.errors_of_pairs(likelihood.residuals(values, modes))
        frequency_log_p = log_two_sided(_taken(own.frequencies, which))
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
    detected = -np.expm1(likelihood.log_missed(values, modes))
    model_modes = np.append(pairs.model_modes, -1)[which]
    is_paired = (model_modes[:, :, None] == np.arange(detected.shape[1])).any(axis=1)
    n_paired = is_paired.sum(axis=1)
    with np.errstate(divide="ignore"):
        return Misfit(
            frequency_errors=errors,
            frequency_sds=sds,
            frequency_log_p=frequency_log_p,
            macs=(1.0 - distances) ** 2,
            expected_macs=(1.0 - expected_distances) ** 2,
            shape_log_p=shape_log_p,
            unidentified=np.where(is_paired, 0.0, detected).sum(axis=1)
            / identification.detection_probability,
            spurious_log_p=np.log(
                _at_least(n_data - n_paired, identification.expected_spurious_modes)
            ),
            detected_log_p=np.log(_at_most(n_paired, detected)),
            joint_log_p=_joint_misfit(likelihood, values, modes),
        )


def _joint_misfit(
    likelihood: ModalLikelihood, values: FloatArray, modes: ComparedModes
) -> FloatArray | None:
    """Log probability (B,) of a larger misfit of all modes of a given pairing with joint errors."""
    if likelihood.joint_pairs is None or not likelihood.pairing_is_given:
        return None
    white = likelihood.joint_pairs.together.white(*likelihood.residuals(values, modes))
    n_errors = white.frequencies.shape[1] + white.shapes.shape[1]
    return log_chi_square(white.frequency_squares + white.shape_squares, n_errors)


def _taken(columns: FloatArray, which: NDArray[np.intp]) -> FloatArray:
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


def _at_least(n: NDArray[np.intp], expected: float) -> FloatArray:
    """Probability (B,) of ``n`` events or more where that many are expected (Poisson)."""
    return np.where(n > 0, pdtrc(np.maximum(n - 1, 0), expected), 1.0)


def _at_most(n: NDArray[np.intp], probabilities: FloatArray) -> FloatArray:
    """Probability (B,) of ``n`` events or fewer of those with these probabilities (B, I)."""
    n_events = probabilities.shape[1]
    shares = np.zeros((len(n), n_events + 1))
    shares[:, 0] = 1.0
    for i in range(n_events):
        moved = shares[:, :-1] * probabilities[:, i : i + 1]
        shares *= 1.0 - probabilities[:, i : i + 1]
        shares[:, 1:] += moved
    return np.where(np.arange(n_events + 1) <= n[:, None], shares, 0.0).sum(axis=1)
