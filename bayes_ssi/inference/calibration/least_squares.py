"""Least squares: the problem of a calibration, and descents from many starts at once.

Descents are by Levenberg's and Marquardt's method. Every row descends by itself: its steps do not
depend on the others, which are only evaluated in the same batches.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray, IntArray
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.parameters import as_product, values_at
from bayes_ssi.structures.modal import Modes, mac

FARTHEST = 8.0  # that a search goes out, in prior standard deviations


@dataclass(frozen=True)
class ModeFit:
    """One identified mode and the model mode paired with it.

    Attributes:
        configuration: the test in which it was identified; empty where there is only one.
        label: label of the identified mode.
        model_mode: number of the model mode, from 1.
        identified_hz: identified frequency.
        model_hz: model frequency.
        mac: MAC between the two shapes; NaN where none was identified.
    """

    configuration: str
    label: str
    model_mode: int
    identified_hz: float
    model_hz: float
    mac: float


@dataclass(frozen=True)
class DeterministicFit:
    """The model at one point in the space of parameters.

    Attributes:
        values: parameter values, in the order of the calibration's ``parameter_names``.
        objective: f_ob, a fraction.
        distance: RMS distance d from the prior medians, by which every parameter is divided,
            unless they are zero.
        modes: the paired modes.
    """

    values: tuple[float, ...]
    objective: float
    distance: float
    modes: tuple[ModeFit, ...]


@checked
def rms_distance(values: Mapping[str, float], reference: Mapping[str, float]) -> float:
    """RMS difference of normalised parameters, the d of the paper's Table 1 and section 4.5.

    Args:
        values: parameter name → value divided by its nominal value.
        reference: normalised values from which the distance is measured; the mean is over its
            parameters, including those that were not updated and are 1 in both.

    Raises:
        ValueError: there is no parameter in ``reference``, or one is missing in ``values``.
    """
    missing = [name for name in reference if name not in values]
    if missing:
        raise ValueError(f"rms_distance: no value of parameter {missing[0]!r}")
    if not reference:
        raise ValueError("rms_distance: the reference has no parameter")
    squares = [(values[name] - number) ** 2 for name, number in reference.items()]
    return math.sqrt(sum(squares) / len(squares))


# At the cube root of the rounding error, central differences are the most accurate.
DIFFERENCE_STEP = float(np.cbrt(np.finfo(float).eps))


class NothingToCalibrateError(ValueError):
    """A model class without structural parameters, or without paired modes."""


class CalibrationProblem:
    """Residuals of a model class as a function of its structures' standard-normal coordinates.

    With the prior's pull, residuals over their standard errors are joined by the coordinates
    themselves: the sum of squares is then -2 log of the posterior density, but for a constant.
    """

    def __init__(
        self, model_class: ModelClass, shape_weight: float, with_prior: bool = False
    ) -> None:
        self.model_class, self.shape_weight = model_class, shape_weight
        self.with_prior = with_prior
        self.parameters = model_class.structural_parameters
        self.names = tuple(parameter.name for parameter in self.parameters)
        likelihoods = model_class.likelihoods
        n_pairs = sum(len(likelihood.pairs.modes) for likelihood in likelihoods)
        for can_fit, why in (
            (
                all(likelihood.pairing_is_given for likelihood in likelihoods),
                "its pairing is 'any', but a fit needs an explicit pairing",
            ),
            (self.parameters, "its structure has no parameter to calibrate"),
            (n_pairs, "no mode is paired, nothing to fit"),
        ):
            if not can_fit:
                raise NothingToCalibrateError(f"model class {model_class.name!r}: {why}")
        n_shapes = sum(len(likelihood.pairs.with_shape) for likelihood in likelihoods)
        self.count = n_pairs + shape_weight**2 * n_shapes

    @cached_property
    def prior_medians(self) -> FloatArray:
        """Prior medians (d,) of the parameters."""
        return np.array([p.prior.quantile(0.5) for p in self.parameters])

    def starts(self, n: int, seed: int) -> FloatArray:
        """Starts (n, d): the prior median, and Sobol points of twice the prior's spread."""
        from scipy.special import ndtri
        from scipy.stats import qmc

        d = len(self.parameters)
        if n == 1:
            return np.zeros((1, d))
        points = qmc.Sobol(d, seed=seed).random_base2(max(1, math.ceil(math.log2(n))))[: n - 1]
        spread = 2.0 * ndtri(np.clip(points, 1e-6, 1 - 1e-6))
        reach = 0.9 * FARTHEST
        return np.vstack([np.zeros(d), np.clip(spread, -reach, reach)])

    def values(self, z: FloatArray) -> FloatArray:
        """Parameter values (B, d) at standard-normal coordinates (B, d)."""
        return values_at(self.parameters, z)

    def residuals(self, z: FloatArray) -> FloatArray:
        """Residuals (B, m): r_f, and λ(φ - φ_e) whose squared components add up to λ² r_φ²."""
        residuals = []
        for _, likelihood, modes in self.modes(self.values(z)):
            pairs = likelihood.pairs
            residuals.append(pairs.frequency_residuals(modes.frequencies_hz))
            if self.shape_weight > 0 and len(pairs.with_shape):
                differences = pairs.shape_differences(likelihood.shapes_at_sensors(modes))
                residuals.append(self.shape_weight * differences.reshape(len(z), -1))
        return np.concatenate(residuals, axis=1)

    def modes(self, values: FloatArray) -> Iterator[tuple[Configuration, ModalLikelihood, Modes]]:
        """Every configuration, its likelihood and its model modes at ``values`` (B, d)."""
        n_errors = len(self.model_class.parameters) - len(self.parameters)
        with_errors = np.pad(values, ((0, 0), (0, n_errors)))  # which modes do not depend on
        for configuration, likelihood, columns in self.model_class.parts(with_errors):
            yield configuration, likelihood, likelihood.modes(columns)

    @cached_property
    def standard_errors(self) -> FloatArray:
        """Standard error (m,) of each residual.

        Identification errors count, and prediction errors σ_f of frequencies and σ_f/λ of shapes,
        which is σ_φ where λ is the error model's.
        """
        prediction_var = as_product(self.model_class.error.frequency_cov).median ** 2
        variances = []
        for likelihood in self.model_class.likelihoods:
            pairs = likelihood.pairs
            variances.append(prediction_var + pairs.frequency_var)
            if self.shape_weight > 0 and len(pairs.with_shape):
                of_shapes = prediction_var + self.shape_weight**2 * pairs.shape_var
                variances.append(np.tile(of_shapes, len(pairs.unit_shapes)))
        return np.sqrt(np.concatenate(variances))

    def minimised(self, z: FloatArray, pull: float = 0.0) -> FloatArray:
        """The numbers (B, ...) whose sum of squares is minimised; ``pull`` as in descents."""
        residuals = self.residuals(z)
        if self.with_prior:
            return np.concatenate([residuals / self.standard_errors, z], axis=1)
        return np.concatenate([residuals, pull * z], axis=1) if pull else residuals

    def sensitivities(self, z: FloatArray) -> FloatArray:
        """Jacobian (m, d) of the residuals over their standard errors, at one point."""
        steps = DIFFERENCE_STEP * np.eye(len(z))
        slopes = difference_quotients(self.residuals(np.concatenate([z + steps, z - steps])))
        return slopes.T / self.standard_errors[:, None]

    def minima(self, starts: FloatArray, pull: float = 0.0) -> FloatArray:
        """The minima (m, d) reached from ``starts`` (n, d), without those outside of the region.

        Besides the residuals, the coordinates times ``pull`` count.
        """

        def minimised(z: FloatArray, _: object) -> FloatArray:
            return self.minimised(z, pull)

        ends, _ = descend(minimised, starts, MOST_STEPS, PRECISE)
        rows, at_ends = np.arange(len(ends)), minimised(ends, None)
        jacobians = _jacobians(minimised, ends, rows, at_ends)
        slopes = np.abs(np.einsum("nmi,nm->ni", jacobians, at_ends)).max(axis=1)
        sizes = np.sqrt(np.einsum("nmi,nmi->n", jacobians, jacobians))
        # A search that ran out of steps, or of answers of the model, ends on a slope.
        settled = slopes <= 1e-4 * np.maximum(sizes, 1e-8)
        return ends[settled & (np.abs(ends) < 0.999 * FARTHEST).all(axis=1)]

    def misfit(self, z: FloatArray) -> FloatArray:
        """Root of what is minimised, (B,): f_ob, or that of the sum of squares with the prior."""
        if not self.with_prior:
            return self.objective(z)
        return np.sqrt((self.minimised(z) ** 2).sum(1))

    def objective(self, z: FloatArray) -> FloatArray:
        """f_ob, (B,)."""
        return np.sqrt((self.residuals(z) ** 2).sum(1) / self.count)

    def fit(self, values: FloatArray) -> DeterministicFit:
        """The model at ``values`` (1, d), compared with the identified modes."""
        fits = []
        for test, likelihood, modes in self.modes(values):
            macs = mac(test.data.unit_shapes, likelihood.shapes_at_sensors(modes)[0])
            for label, number in likelihood.pairing.items():
                mode, model_hz = test.data.mode(label), float(modes.frequencies_hz[0, number - 1])
                alike = float(macs[test.data.labels.index(label), number - 1])
                alike = math.nan if mode.scored_shape is None else alike
                fits.append(ModeFit(test.name, label, number, mode.frequency_hz, model_hz, alike))
        z = np.array([p.prior.to_normal(values.ravel()[i]) for i, p in enumerate(self.parameters)])
        medians = self.prior_medians
        scales = np.where(medians == 0.0, 1.0, medians)
        apart = values.ravel() / scales - medians / scales
        return DeterministicFit(
            values=tuple(values.ravel().tolist()),
            objective=float(self.objective(z[None])[0]),
            distance=float(np.sqrt(np.mean(apart**2))),
            modes=tuple(fits),
        )


def difference_quotients(both: FloatArray) -> FloatArray:
    """Slopes (d, ...) from values (2 d, ...) ahead in each direction, then behind."""
    ahead, behind = np.split(both, 2)
    return (ahead - behind) / (2.0 * DIFFERENCE_STEP)


# Residuals (B, m) of points (B, d), which are those of the rows (B,) of all starts; NaN where the
# model has no answer.
Residuals = Callable[[FloatArray, IntArray], FloatArray]

MOST_STEPS, PRECISE = 200, 1e-20  # of a calibration: steps, and the fall of half the sum of squares
TOLERANCE = 1e-3  # fall of half the sum of squares that is worth no step, in nats
FORWARD_STEP = 1e-7  # where rounding of residuals and truncation balance
FIRST_DAMPING = 1e-3  # as a share of the squares' curvature (Marquardt 1963)
DAMPING_FACTOR = 10.0  # by which every step changes it
LEAST_DAMPING = 1e-12  # which tells a minimum from the points beside it, if they are as good
MOST_DAMPING = 1e8  # with which steps are too short to go on
LONGEST_STEP = 2.0  # in prior standard deviations


def descend(
    residuals: Residuals, starts: FloatArray, most_steps: int, tolerance: float = TOLERANCE
) -> tuple[FloatArray, FloatArray]:
    """Descend from every row of ``starts`` (n, d).

    Returns:
        The ends (n, d), and JᵀJ (n, d, d) of the Jacobian J there, or one step before.
    """
    z = np.array(starts, dtype=float)
    n, d = z.shape
    rows = np.arange(n)
    current = residuals(z, rows)
    halves = _halves(current)
    curvatures = np.tile(np.eye(d), (n, 1, 1))
    slopes = np.zeros((n, d))
    damping = np.full(n, FIRST_DAMPING)
    active = rows[np.isfinite(halves)]
    moved = active
    for _ in range(most_steps):
        if not len(active):
            break
        if len(moved):
            jacobians = _jacobians(residuals, z[moved], moved, current[moved])
            curvatures[moved] = np.einsum("nmi,nmj->nij", jacobians, jacobians)
            slopes[moved] = np.einsum("nmi,nm->ni", jacobians, current[moved])
        # Damped Gauss-Newton steps.
        scale = np.einsum("nii->ni", curvatures[active]) + np.finfo(float).tiny
        added = np.einsum("n,ni,ij->nij", damping[active], scale, np.eye(d))
        steps = -np.linalg.solve(curvatures[active] + added, slopes[active][..., None])[..., 0]
        lengths = np.sqrt(np.einsum("ni,ni->n", steps, steps))
        steps *= np.minimum(1.0, LONGEST_STEP / np.maximum(lengths, 1e-300))[:, None]
        tried = np.clip(z[active] + steps, -FARTHEST, FARTHEST)
        expected = -np.einsum("ni,ni->n", slopes[active], tried - z[active])
        new = residuals(tried, active)
        new_halves = _halves(new)
        down = new_halves < halves[active]
        damping[active] *= np.where(down, 1.0 / DAMPING_FACTOR, DAMPING_FACTOR)
        np.maximum(damping, LEAST_DAMPING, out=damping)
        settled = (expected < tolerance) | (damping[active] > MOST_DAMPING)
        moved = active[down]
        z[moved], current[moved], halves[moved] = tried[down], new[down], new_halves[down]
        moved, active = active[down & ~settled], active[~settled]
    return z, curvatures


def _halves(residuals: FloatArray) -> FloatArray:
    """Half the sum of squares (n,); infinite where a residual is not finite."""
    halves = 0.5 * np.einsum("nm,nm->n", residuals, residuals)
    return np.where(np.isfinite(halves), halves, np.inf)


def _jacobians(residuals: Residuals, z: FloatArray, rows: IntArray, at_z: FloatArray) -> FloatArray:
    """Jacobians (n, m, d) by forward differences, all in one batch; 0 where there are none."""
    n, d = z.shape
    ahead = z[:, None, :] + FORWARD_STEP * np.eye(d)
    values = residuals(ahead.reshape(-1, d), np.repeat(rows, d)).reshape(n, d, -1)
    differences = (values - at_z[:, None, :]) / FORWARD_STEP
    return np.where(np.isfinite(differences), differences, 0.0).transpose(0, 2, 1)
