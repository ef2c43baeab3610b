"""The least-squares problem of a calibration: residuals, local searches, distinct minima."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.identification.any_pairing import AnyPairing
from bayes_ssi.identification.likelihood import ModalLikelihood
from bayes_ssi.modal import Modes, mac
from bayes_ssi.model_class.configuration import Configuration
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.parameters import values_at

# The search stays within this many prior standard deviations in standard-normal coordinates.
FARTHEST = 8.0
# At the cube root of the rounding error, central differences are the most accurate.
DIFFERENCE_STEP = float(np.cbrt(np.finfo(float).eps))


class NothingToCalibrateError(ValueError):
    """A model class without structural parameters, or without paired modes."""


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
class Fit:
    """The model at one point in the space of parameters.

    Attributes:
        values: parameter values, in the order of the calibration's ``parameter_names``.
        objective: f_ob, a fraction.
        distance: RMS distance d from the reference values, every parameter divided by its prior
            median.
        modes: the paired modes.
    """

    values: tuple[float, ...]
    objective: float
    distance: float
    modes: tuple[ModeFit, ...]


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


class CalibrationProblem:
    """Residuals of a model class as a function of its structures' standard-normal coordinates."""

    def __init__(self, model_class: ModelClass, shape_weight: float) -> None:
        self.model_class = model_class
        if any(isinstance(each, AnyPairing) for each in model_class.likelihoods):
            raise NothingToCalibrateError(
                f"model class {model_class.name!r}: its pairing is 'any', but a fit needs "
                "an explicit pairing"
            )
        self.parameters = model_class.structural_parameters
        self.names = tuple(parameter.name for parameter in self.parameters)
        self.shape_weight = shape_weight
        if not self.parameters:
            raise NothingToCalibrateError(
                f"model class {model_class.name!r}: its structure has no parameter to calibrate"
            )
        pairs = [likelihood.pairs for likelihood in model_class.likelihoods]
        n_pairs = sum(len(each.modes) for each in pairs)
        if not n_pairs:
            raise NothingToCalibrateError(
                f"model class {model_class.name!r}: no mode is paired, nothing to fit"
            )
        n_shapes = sum(len(each.with_shape) for each in pairs) if shape_weight > 0 else 0
        self.count = n_pairs + shape_weight**2 * n_shapes

    def reference_values(self, reference: Mapping[str, float] | None) -> FloatArray:
        """Reference values (n,): those given, and prior medians for the others."""
        given = dict(reference or {})
        unknown = [name for name in given if name not in self.names]
        if unknown:
            raise ValueError(
                f"model class {self.model_class.name!r}: reference for unknown parameter "
                f"{unknown[0]!r}; choose from {', '.join(map(repr, self.names))}"
            )
        return np.array([given.get(p.name, p.prior.quantile(0.5)) for p in self.parameters])

    def normalised(self, values: Sequence[float]) -> dict[str, float]:
        """Parameter name → value over prior median (over 1 where the median is zero)."""
        medians = [p.prior.quantile(0.5) or 1.0 for p in self.parameters]
        each = zip(self.names, values, medians, strict=True)
        return {name: value / median for name, value, median in each}

    def starts(self, n: int, seed: int) -> FloatArray:
        """Starts (n, d): the prior median, and Sobol points of twice the prior's spread."""
        from scipy.special import ndtri
        from scipy.stats import qmc

        d = len(self.parameters)
        if n == 1:
            return np.zeros((1, d))
        points = qmc.Sobol(d, seed=seed).random_base2(max(1, math.ceil(math.log2(n))))[: n - 1]
        spread = 2.0 * ndtri(np.clip(points, 1e-6, 1 - 1e-6))
        return np.vstack([np.zeros(d), np.clip(spread, -0.9 * FARTHEST, 0.9 * FARTHEST)])

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
        column = {name: i for i, name in enumerate(self.names)}
        for configuration, likelihood in zip(
            self.model_class.configurations, self.model_class.likelihoods, strict=True
        ):
            structure = configuration.structure
            own = values[:, [column[p.name] for p in structure.parameters]]
            yield configuration, likelihood, Modes(*structure.modes(own))

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Jacobian (m, d) at one point, by central differences in one batch."""
        steps = DIFFERENCE_STEP * np.eye(len(z))
        both = self.residuals(np.concatenate([z + steps, z - steps]))
        return (both[: len(z)] - both[len(z) :]).T / (2.0 * DIFFERENCE_STEP)

    def descend(self, start: FloatArray) -> FloatArray | None:
        """The minimum reached from ``start``; None where the search leaves the model's domain."""
        from scipy.optimize import least_squares

        def residuals(z: FloatArray) -> FloatArray:
            return self.residuals(z[None])[0]

        if not np.isfinite(residuals(start)).all():
            return None
        try:
            result = least_squares(
                residuals,
                start,
                jac=self.jacobian,
                bounds=(-FARTHEST, FARTHEST),
                xtol=1e-12,
                ftol=1e-14,
                gtol=1e-12,
                max_nfev=200,
            )
        except ValueError:  # residuals that are not finite: the structure broke down on the way
            return None
        at_bound = np.any(np.abs(result.x) > 0.999 * FARTHEST)
        slope = np.abs(result.grad).max() / max(1e-8, np.linalg.norm(np.asarray(result.jac)))
        # A search that ran out of evaluations ends on a slope.
        return None if at_bound or slope > 1e-4 else result.x

    def objective(self, z: FloatArray) -> FloatArray:
        """f_ob, (B,)."""
        return np.sqrt((self.residuals(z) ** 2).sum(1) / self.count)

    def fit(self, values: FloatArray, reference: FloatArray) -> Fit:
        """The model at ``values`` (1, d), compared with the identified modes."""
        fits = []
        for configuration, likelihood, modes in self.modes(values):
            fits += _mode_fits(configuration, likelihood, modes)
        z = np.array([p.prior.to_normal(values.ravel()[i]) for i, p in enumerate(self.parameters)])
        numbers = [float(value) for value in values.ravel()]
        return Fit(
            values=tuple(numbers),
            objective=float(self.objective(z[None])[0]),
            distance=rms_distance(self.normalised(numbers), self.normalised(reference.tolist())),
            modes=tuple(fits),
        )


def _mode_fits(
    configuration: Configuration, likelihood: ModalLikelihood, modes: Modes
) -> list[ModeFit]:
    """The paired modes of one configuration, identified and of the model at one point."""
    data = configuration.data
    criteria = mac(data.unit_shapes, likelihood.shapes_at_sensors(modes)[0])
    return [
        ModeFit(
            configuration=configuration.name,
            label=label,
            model_mode=number,
            identified_hz=data.mode(label).frequency_hz,
            model_hz=float(modes.frequencies_hz[0, number - 1]),
            mac=float(criteria[data.labels.index(label), number - 1])
            if data.mode(label).scored_shape is not None
            else math.nan,
        )
        for label, number in likelihood.pairing.items()
    ]


def distinct_minima(
    problem: CalibrationProblem, ends: list[FloatArray]
) -> tuple[list[FloatArray], int]:
    """Distinct minima, the best first, and the directions undetermined at the best one."""
    if not ends:
        return [], 0
    objectives = problem.objective(np.array(ends)).tolist()
    # Exact fits differ only by rounding: they are equally good, and the nearest one comes first.
    order = sorted(
        range(len(ends)), key=lambda i: (round(objectives[i], 7), float(np.linalg.norm(ends[i])))
    )
    kept: list[int] = []
    for i in order:
        # Minima within a hundredth of a prior standard deviation are the same one.
        if all(np.abs(ends[i] - ends[j]).max() > 1e-2 for j in kept):
            kept.append(i)
    best = ends[kept[0]]
    sensitivities = np.linalg.svd(problem.jacobian(best), compute_uv=False)
    # A millionth of the largest sensitivity is far below any real one and far above rounding.
    determined = int((sensitivities > 1e-6 * sensitivities.max()).sum())
    undetermined = len(best) - determined
    if undetermined:
        # The equally good points form a surface; the nearest of them represents it.
        kept = [kept[0], *(i for i in kept if objectives[i] >= objectives[kept[0]] + 1e-7)]
    return [ends[i] for i in kept], undetermined
