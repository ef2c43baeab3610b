"""Deterministic calibration: every distinct minimum of the paper's objective.

With r_f = f/f_e - 1 and r_φ = ‖φ - φ_e‖ = √(2(1 - √MAC)) for unit shapes of matching sign,

    f_ob = √[(Σ r_f² + λ² Σ r_φ²) / (Σ 1 + λ² Σ 1)]        (paper, Eq. 1)

All minima reached from many starts are listed: several may have the same f_ob. With the prior's
pull the fit is the maximum of the posterior density.

Near a fit the residuals over their standard errors are linear in the standard-normal coordinates
of the parameters, with Jacobian J. A singular value s of J is a direction's signal over its noise:
along it the data have the standard error 1/s, in prior standard deviations. They determine it
where they know more of it than the prior did, s > 1.

The paper's section 4.5 chooses updating parameters by sensitivities (its Figure 7). A proposal here
follows from J: one by one the parameter is taken whose column is the longest once those already
taken are projected out (QR with pivoting; Golub, Klema and Stewart 1976). Its length is the signal
over the noise that is left of it; below 1 the prior knows more.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.inference.calibration.least_squares import (
    DIFFERENCE_STEP,
    CalibrationProblem,
    DeterministicFit,
    difference_quotients,
)
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass

MOST_STARTS = 10_000  # a minimum of a thousandth of them is missed with probability e^-10
AT_ONCE = 16  # searches, between two reports of progress
SAME_MINIMUM = 1e-2  # largest distance between the ends of searches at one minimum
EQUALLY_GOOD = 1e-7  # to about this misfits are computed: exact fits differ by less
SLIGHT_PULL = 1e-5  # to the prior medians; the prior's own is 1
ZERO_SENSITIVITY = 1e-6  # over the largest: far below real ones, far above rounding


@dataclass(frozen=True, repr=False)
class Calibration(Displayed):
    """All distinct minima of the objective.

    Attributes:
        name: name of the model class.
        parameter_names: parameters that the structure depends on.
        before: the model at the prior medians.
        minima: the best first; equally good ones by their distance from the prior median.
        shape_weight: λ.
        undetermined_directions: the number of directions in parameter space that the residuals
            do not determine at the best minimum. If any, the minima form a surface, and its
            point nearest to the prior median is listed.
        n_starts: local searches made.
        n_converged: those that ended at a minimum.
        with_prior: whether the prior was fitted, too; minima are then those of
            ``Σ r²/σ² + Σ z²`` over residuals r with standard errors σ and standard-normal
            coordinates z of the parameters, which is the posterior density's exponent.
        standard_errors: of every parameter at the best minimum, in its own unit; from the data, and
            from the prior where it was fitted. Infinite where the data know less than the prior.
        errors_are_correlated: whether the class's error model has correlations, which are not
            considered here: standard errors and fits with the prior take residuals as independent.
    """

    name: str
    parameter_names: tuple[str, ...]
    before: DeterministicFit
    minima: tuple[DeterministicFit, ...]
    shape_weight: float
    undetermined_directions: int
    n_starts: int
    n_converged: int
    with_prior: bool
    standard_errors: tuple[float, ...]
    errors_are_correlated: bool

    @property
    def has_shapes(self) -> bool:
        return any(not math.isnan(mode.mac) for mode in self.before.modes)

    @property
    def determines_all(self) -> bool:
        """Whether the data determine every parameter by itself."""
        return all(map(math.isfinite, self.standard_errors))

    @property
    def best(self) -> DeterministicFit:
        return self.minima[0]

    def _line(self) -> str:
        minima = f"{len(self.minima)} {'minimum' if len(self.minima) == 1 else 'minima'}"
        return f"of {self.name!r}: {minima}, best objective {100.0 * self.best.objective:.3g} %"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"fit": f"minimum {i}" if i else "before"}
            | {"objective": fit.objective, "distance": fit.distance}
            | dict(zip(self.parameter_names, fit.values, strict=True))
            for i, fit in enumerate((self.before, *self.minima))
        ]


@checked
def calibrate(
    model_class: ModelClass,
    shape_weight: float | None = None,
    n_starts: int = 64,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
    with_prior: bool = False,
) -> Calibration:
    """Minimise the paper's objective from many starts and list every distinct minimum.

    Args:
        model_class: its pairing gives the fitted modes, of all its configurations together; its
            priors give the region to search.
        shape_weight: λ, the weight of shapes relative to frequencies; 0 leaves shapes out. By
            default that of the likelihood: λ = σ_f/σ_φ of the class's error model, at the prior
            medians where these are inferred.
        n_starts: local searches, spread over the prior and beyond, at most 10,000.
        seed: seed of the starts.
        progress: called with the name of the step and the fraction of it completed.
        with_prior: fit the prior, too, which determines what the data do not: regularised least
            squares, whose minima are the maxima of the posterior density at fixed error sizes.

    Raises:
        NothingToCalibrateError: no mode is paired, a pairing is inferred, or there is no parameter.
        ValueError: the weight is negative, starts are none or too many, or no search converged.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> found = bs.calibrate(bs.ModelClass("frame", frame, modes, pairing={"1": 1}))
    >>> round(found.best.values[0], 2)
    39.99
    """
    if shape_weight is None:
        shape_weight = model_class.error.shape_weight
    if not 0.0 <= shape_weight < math.inf:
        raise ValueError(f"calibrate: shape_weight must be zero or positive, got {shape_weight!r}")
    if not 1 <= n_starts <= MOST_STARTS:
        raise ValueError(f"calibrate: n_starts must be from 1 to {MOST_STARTS:,}, got {n_starts!r}")
    if seed < 0:
        raise ValueError(f"calibrate: seed must be zero or positive, got {seed!r}")
    model_class.check_structure()
    problem = CalibrationProblem(model_class, shape_weight, with_prior)
    report, starts = progress or (lambda *_: None), problem.starts(n_starts, seed)
    report("local searches", 0.0)
    ends: list[FloatArray] = []
    for first in range(0, n_starts, AT_ONCE):
        ends += [*problem.minima(starts[first : first + AT_ONCE])]
        report("local searches", min(first + AT_ONCE, n_starts) / n_starts)
    if not ends:
        raise ValueError(
            f"model class {model_class.name!r}: no local search for a minimum converged, as where "
            "the data leave parameters open; fit the prior, too (with_prior=True, --with-prior)"
        )
    minima, undetermined = distinct_minima(problem, ends)
    return Calibration(
        name=model_class.name,
        parameter_names=problem.names,
        before=problem.fit(problem.prior_medians[None]),
        minima=tuple(problem.fit(problem.values(z[None])) for z in minima),
        shape_weight=shape_weight,
        undetermined_directions=undetermined,
        n_starts=n_starts,
        n_converged=len(ends),
        with_prior=with_prior,
        standard_errors=standard_errors(problem, minima[0]),
        errors_are_correlated=model_class.error.is_correlated,
    )


def distinct_minima(
    problem: CalibrationProblem, ends: list[FloatArray]
) -> tuple[list[FloatArray], int]:
    """Distinct minima, the best first, and the directions undetermined at the best one."""
    misfits = problem.misfit(np.array(ends)).tolist()
    # Exact fits differ only by rounding: they are equally good, and the nearest one comes first; of
    # two that mirror one another, the one of smaller coordinates.
    near = [round(float(np.linalg.norm(end)), 6) for end in ends]
    places = [np.round(end, 6).tolist() for end in ends]
    order = sorted(range(len(ends)), key=lambda i: (round(misfits[i], 7), near[i], places[i]))
    kept: list[int] = []
    for i in order:
        if all(np.abs(ends[i] - ends[j]).max() > SAME_MINIMUM for j in kept):
            kept.append(i)
    best = ends[kept[0]]
    undetermined = 0
    if not problem.with_prior:
        sizes = np.linalg.svd(problem.sensitivities(best), compute_uv=False)
        undetermined = len(best) - int((sizes > ZERO_SENSITIVITY * sizes.max()).sum())
    if undetermined:
        # The equally good points form a surface; the nearest of them represents it. A slight pull
        # leads there: of residuals linear in the coordinates, to the solution of smallest norm.
        worse = misfits[kept[0]] + EQUALLY_GOOD
        kept = [kept[0], *(i for i in kept if misfits[i] >= worse)]
        nearest = problem.minima(best[None], SLIGHT_PULL)
        if len(nearest) and problem.misfit(nearest)[0] < worse:
            (best,) = nearest
    return [best, *(ends[i] for i in kept[1:])], undetermined


def standard_errors(problem: CalibrationProblem, z: FloatArray) -> tuple[float, ...]:
    """Standard errors of :class:`Calibration` around ``z`` (d,), to first order."""
    jacobian = problem.sensitivities(z)
    if problem.with_prior:
        in_prior_sds = np.sqrt(np.linalg.inv(jacobian.T @ jacobian + np.eye(len(z))).diagonal())
    else:
        sizes = [_signal(jacobian[:, i], np.delete(jacobian, i, axis=1)) for i in range(len(z))]
        in_prior_sds = np.array([1.0 / size if size > 1.0 else math.inf for size in sizes])
    low, high = problem.values(z[None] + DIFFERENCE_STEP * np.array([[-1.0], [1.0]]))
    return tuple((in_prior_sds * (high - low) / (2.0 * DIFFERENCE_STEP)).tolist())


def _signal(column: FloatArray, rest: FloatArray) -> float:
    """Length of a column (m,) without what changes of the other parameters can make up for."""
    made_up = rest @ (np.linalg.pinv(rest, rcond=ZERO_SENSITIVITY) @ column)
    return float(np.linalg.norm(column - made_up))


@dataclass(frozen=True, eq=False, repr=False)
class ModalSensitivities(Displayed):
    """How much the paired modes of a class change with its parameters, at one point.

    Attributes:
        name: of the model class.
        modes: (m,) labels of the paired modes, with their configurations.
        parameters: (p,) names.
        of_frequencies: (m, p) percent by which a frequency rises where a parameter does by one.
        of_shapes: (m, p) length in percent of the change of a unit shape at the sensors, likewise.
        signals: (p,) over the noise, each beside those taken before it, the largest first.
        order: (p,) the parameters in that order.
    """

    name: str
    modes: tuple[str, ...]
    parameters: tuple[str, ...]
    of_frequencies: FloatArray
    of_shapes: FloatArray
    signals: tuple[float, ...]
    order: tuple[str, ...]

    @property
    def proposed(self) -> tuple[str, ...]:
        """The parameters that the data know better than the prior, beside one another."""
        return self.order[: sum(signal > 1.0 for signal in self.signals)]

    def _line(self) -> str:
        modes = counted(len(self.modes), "mode")
        return f"of {self.name!r}: {modes}, {counted(len(self.parameters), 'parameter')}"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"mode": mode} | dict(zip(self.parameters, row.tolist(), strict=True))
            for mode, row in zip(self.modes, self.of_frequencies, strict=True)
        ]


@checked
def modal_sensitivities(model_class: ModelClass) -> ModalSensitivities:
    """Sensitivities of the paired modes to the structures' parameters, at the prior medians.

    Args:
        model_class: its pairing must be given; those of all configurations count. Its error model
            gives the weight of shapes in the proposal, and other ``priors`` another point.

    Raises:
        NothingToCalibrateError: no mode is paired, a pairing is inferred, or there is no parameter.
        ValueError: a prior median is zero.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> found = bs.modal_sensitivities(bs.ModelClass("frame", frame, modes, pairing={"1": 1}))
    >>> found.of_frequencies.round(3)
    array([[0.5]])
    """
    problem = CalibrationProblem(model_class, model_class.error.shape_weight)
    values = problem.prior_medians
    zero = [name for name, value in zip(problem.names, values, strict=True) if value == 0.0]
    if zero:
        raise ValueError(
            f"modal_sensitivities: the prior median of {zero[0]!r} is zero, and relative changes "
            "of it are not defined"
        )
    labels: list[str] = []
    frequencies, changes = [], []
    steps = DIFFERENCE_STEP * np.eye(len(values))  # of ln θ
    beside = values * np.exp(np.concatenate([steps, -steps]))
    for configuration, likelihood, modes in problem.modes(beside):
        pairs = likelihood.pairs
        labels += [label_in(configuration.name, mode.label) for mode in pairs.modes]
        slopes = difference_quotients(np.log(modes.frequencies_hz[:, pairs.model_modes]))
        frequencies.append(slopes.T)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, pairs.model_modes]
        lengths = np.linalg.norm(shapes, axis=1, keepdims=True)
        # A shape's sign is nobody's; that of the first row goes for all.
        signs = np.where((shapes * shapes[:1]).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
        shapes = shapes * signs / np.maximum(lengths, np.finfo(float).tiny)
        changes.append(np.linalg.norm(difference_quotients(shapes), axis=1).T)
    # In prior standard deviations, at the prior medians, too.
    jacobian = problem.sensitivities(np.zeros(len(values)))
    triangle, order = scipy.linalg.qr(jacobian, mode="r", pivoting=True)
    signals = np.zeros(len(values))
    signals[: min(triangle.shape)] = np.abs(triangle.diagonal())
    return ModalSensitivities(
        model_class.name,
        tuple(labels),
        problem.names,
        np.concatenate(frequencies),
        np.concatenate(changes),
        tuple(signals.tolist()),
        tuple(problem.names[i] for i in order),
    )
