"""What the data determine of a calibrated model's parameters, and what they leave open.

Near a fit the residuals over their standard errors are linear in the standard-normal coordinates
of the parameters, with Jacobian J. A singular value s of J is a direction's signal over its noise:
along it the data have the standard error 1/s, in prior standard deviations. They determine it
where they know more of it than the prior did, s > 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from bayes_ssi.foundations.arrays import EQUAL_SIZES, FloatArray, place_of_largest
from bayes_ssi.inference.calibration.least_squares import (
    CALIBRATION,
    DIFFERENCE_STEP,
    CalibrationProblem,
)


@dataclass(frozen=True)
class Combination:
    """A sum of components times parameters, or a change of several parameters at once.

    Attributes:
        components: parameter name → component of ``ln θ``, or of θ itself where it may be zero or
            negative; the largest is 1.
        standard_error: of a sum that is determined; of a change that is not, in prior standard
            deviations, infinite where the data say nothing of it.
    """

    components: Mapping[str, float]
    standard_error: float


@dataclass(frozen=True)
class Determination:
    """What the data determine at a fit, to first order.

    Attributes:
        standard_errors: of every parameter, in its own unit; from the data, and from the prior
            where the calibration has it. Infinite where the data alone do not determine it.
        positive: whether each parameter is positive, and combinations hold its logarithm.
        singular_values: of the residuals over their standard errors, the largest first, in
            standard errors per prior standard deviation.
        determined: the combinations of several parameters that are determined where these are
            not one by one.
        undetermined: changes that the data notice less than the prior, the least noticed first.
            There are as many of them and of ``determined`` together as parameters that are not
            determined one by one.
    """

    standard_errors: tuple[float, ...]
    positive: tuple[bool, ...]
    singular_values: tuple[float, ...]
    determined: tuple[Combination, ...]
    undetermined: tuple[Combination, ...]


def determination(problem: CalibrationProblem, z: FloatArray) -> Determination:
    """What the data determine around ``z`` (d,)."""
    jacobian = problem.sensitivities(z)
    positive = [p.prior.probability_below(0.0) == 0.0 for p in problem.parameters]
    slopes = _slopes(problem, z, positive)
    alone = [float(np.linalg.norm(_marginal(jacobian, [column]))) for column in range(len(z))]
    open_ = [column for column, size in enumerate(alone) if size <= 1.0]
    determined: list[Combination] = []
    undetermined: list[Combination] = []
    for group in _groups(jacobian, open_):
        columns, names = _marginal(jacobian, group), [problem.names[c] for c in group]
        determined += _sums(columns, names, slopes[group])
        undetermined += _changes(columns, names, slopes[group], float(np.linalg.norm(jacobian)))
    own_unit = _slopes(problem, z, [False] * len(z))
    if problem.with_prior:
        variance = np.linalg.inv(jacobian.T @ jacobian + np.eye(len(z))).diagonal()
        in_prior_sds = np.sqrt(variance)
    else:
        in_prior_sds = np.array([1.0 / size if size > 1.0 else math.inf for size in alone])
    singular_values = np.zeros(len(z))
    found = np.linalg.svd(jacobian, compute_uv=False)
    singular_values[: len(found)] = found
    return Determination(
        standard_errors=tuple((in_prior_sds * own_unit).tolist()),
        positive=tuple(positive),
        singular_values=tuple(singular_values.tolist()),
        determined=tuple(determined),
        undetermined=tuple(sorted(undetermined, key=lambda change: -change.standard_error)),
    )


def _slopes(problem: CalibrationProblem, z: FloatArray, logarithm: Sequence[bool]) -> FloatArray:
    """Change of every parameter, or of its logarithm, per prior standard deviation, (d,)."""
    low, high = problem.values(z[None] + DIFFERENCE_STEP * np.array([[-1.0], [1.0]]))
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (np.where(logarithm, np.log(at), at) for at in (low, high))
    slopes: FloatArray = (high - low) / (2.0 * DIFFERENCE_STEP)
    return slopes


def _marginal(jacobian: FloatArray, columns: Sequence[int]) -> FloatArray:
    """The columns (m, k) without what changes of the other parameters can make up for."""
    chosen, rest = jacobian[:, columns], np.delete(jacobian, columns, axis=1)
    if not rest.size:
        return chosen
    return chosen - rest @ (np.linalg.pinv(rest, rcond=CALIBRATION.zero_sensitivity) @ chosen)


def _groups(jacobian: FloatArray, columns: list[int]) -> list[list[int]]:
    """Parameters that are only determined together, or each alone where nothing is."""
    if not columns:
        return []
    shared = _determined_rows(_marginal(jacobian, columns))
    mixed: NDArray[np.bool_] = np.abs(shared.T @ shared) > CALIBRATION.mixed
    n_groups, group = connected_components(mixed, directed=False)
    return [[c for c, g in zip(columns, group, strict=True) if g == i] for i in range(n_groups)]


def _determined_rows(jacobian: FloatArray) -> FloatArray:
    """Unit directions (r, d) that are determined, the best first."""
    _, singular_values, rows = np.linalg.svd(jacobian, full_matrices=False)
    determined: FloatArray = rows[singular_values > 1.0]
    return determined


def _sums(columns: FloatArray, names: Sequence[str], slopes: FloatArray) -> list[Combination]:
    """The determined sums of a group of parameters, from its ``columns`` (m, k)."""
    sums = []
    for row in _determined_rows(columns):
        components, scale = _scaled(row / slopes)
        error = 1.0 / (scale * float(np.linalg.norm(columns @ row)))
        sums.append(Combination(dict(zip(names, components, strict=True)), error))
    return sums


def _changes(
    columns: FloatArray, names: Sequence[str], slopes: FloatArray, size: float
) -> list[Combination]:
    """Changes of a group of parameters that are not determined, as for :func:`_sums`.

    ``size`` is that of the whole Jacobian, next to which less than a millionth counts as zero.

    Each changes as few parameters as possible: one that is free, and as many as the group has
    sums, which make up for it.
    """
    rows = _determined_rows(columns)
    null = scipy.linalg.null_space(rows) if len(rows) else np.eye(columns.shape[1])
    n, negligible = null.shape[1], CALIBRATION.zero_sensitivity * size
    # Of parameters that are equally free, the first.
    preferred = null.T * (1.0 - EQUAL_SIZES * np.arange(len(null)))
    free = scipy.linalg.qr(preferred, pivoting=True, mode="r")[1][:n]
    changes = []
    for change in np.linalg.solve(null[free].T, null.T):
        unit = change / np.linalg.norm(change)
        noticed = float(np.linalg.norm(columns @ unit))
        error = math.inf if noticed <= negligible else 1.0 / noticed
        components, _ = _scaled(change * slopes)
        changes.append(Combination(dict(zip(names, components, strict=True)), error))
    return changes


def _scaled(components: FloatArray) -> tuple[list[float], float]:
    """Components over the largest, and the size of that."""
    size = float(components[place_of_largest(np.abs(components))])
    return (components / size).tolist(), abs(size)
