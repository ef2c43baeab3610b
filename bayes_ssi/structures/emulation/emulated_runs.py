"""A structure that is known by runs of a program alone, which cannot be asked for more."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray, steady_digest
from bayes_ssi.parameters.parameters import ProductTable, Value
from bayes_ssi.structures.emulation.emulated_structure import (
    EmulatedStructure,
    EmulatorFit,
    FailingPoints,
    mode_errors,
)
from bayes_ssi.structures.finite_elements.function_structure import FunctionStructure
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Requirement, Structure

SPREAD = 0.3  # of the logarithms of factors: coordinates have unit spread over the usual prior
RUNS_PER_PROPERTY = 2  # at first, beside two more
FARTHEST = 1.8  # spreads from nominal of the first runs


def first_runs(n_properties: int, n_runs: int | None = None) -> FloatArray:
    """Factors (n_runs, n_properties) at which to run a program first: nominal, and Sobol points."""
    from scipy.stats import qmc

    n_runs = n_runs or 2 + RUNS_PER_PROPERTY * n_properties
    points = qmc.Sobol(n_properties, rng=np.random.default_rng(0))
    uniform = points.random_base2(max(1, n_runs - 1).bit_length())[: n_runs - 1]
    coordinates = np.vstack([np.zeros(n_properties), FARTHEST * (2.0 * uniform - 1.0)])
    return np.exp(SPREAD * coordinates).round(3)


class EmulatedRuns(EmulatedStructure):
    """Modes between the runs of a program, by Gaussian processes in the factors of properties.

    The errors that it claims are those of runs left out. Where they exceed a tenth of the data's
    errors, the runs to be made next are named, as it has no exact solutions of its own.
    """

    has_exact = False

    @checked
    def __init__(
        self,
        factors: Mapping[str, Value],
        runs: Mapping[str, Sequence[float]],
        frequencies_hz: FloatArray,
        shapes: FloatArray,
        sensors: Sequence[str],
    ) -> None:
        """Fit the emulator.

        Args:
            factors: property → number, Parameter or product.
            runs: property → its factor in each of N runs.
            frequencies_hz: (N, m), ascending.
            shapes: (N, n_sensors, m).
            sensors: their names.

        Raises:
            ValueError: properties of factors and runs differ, or there are fewer than 2 (1 + number
                of properties) runs.
        """
        require_known("EmulatedRuns: no property", factors, runs)
        require_known("EmulatedRuns: no factor of", runs, factors)
        n, m = np.shape(frequencies_hz)
        function = FunctionStructure(_run, factors, n_modes=m, sensors=tuple(sensors))
        self._factors = ProductTable(tuple(function._arguments.values()), function.parameters)
        self._names = tuple(factors)
        x = np.log(np.column_stack([runs[name] for name in factors])) / SPREAD
        if n < 2 * (1 + x.shape[1]):
            raise ValueError(f"EmulatedRuns: {n} runs for {x.shape[1]} properties, too few")
        given = Modes(np.asarray(frequencies_hz, float), np.asarray(shapes, float))
        super().__init__(function, fit=_fitted(x, given, m))

    @property
    def most_solutions(self) -> int:
        """N: none can be added."""
        return len(self.emulator.x)

    @property
    def exact(self) -> Structure:
        return self

    @property
    def substituted(self) -> Structure:
        return self._exact

    def _coordinates(self, values: FloatArray) -> FloatArray:
        return np.asarray(np.log(self._factors.evaluate(values)) / SPREAD)

    def _fit_for(self, n_modes: int | None) -> EmulatorFit:
        fit, n_needed = self.emulator, n_modes or self.n_modes
        return fit if n_needed == fit.n_needed else _fitted(fit.x, fit.modes, n_needed)

    def __repr__(self) -> str:
        x, modes = self.emulator.x, self.emulator.modes
        digest = steady_digest(modes.frequencies_hz.ravel(), np.arange(modes.frequencies_hz.size))
        return f"EmulatedRuns({self._exact!r}, {len(x)} runs <{digest}>)"

    def advice(self, required: Requirement) -> str:
        fit, x = self._fit_for(required.n_modes), self._coordinates(required.values)
        factors = np.exp(SPREAD * x[self._worst(fit, x, 0.0)[:3]])
        runs = [dict(zip(self._names, row, strict=True)) for row in factors]
        texts = (", ".join(f"{name}={factor:.3g}" for name, factor in run.items()) for run in runs)
        return f"run the program next at {'; '.join(texts)}"


def _fitted(x: FloatArray, modes: Modes, n_needed: int) -> EmulatorFit:
    """The emulator; its errors are those of each run, predicted by an emulator of all others.

    Of few runs those that share the correlation lengths of all would be far too small.
    """

    def fit(rows: NDArray[np.intp]) -> EmulatorFit:
        some = Modes(modes.frequencies_hz[rows], modes.shapes[rows])
        return EmulatorFit.best(x[rows], some, FailingPoints(x[:0], x[:0], x[rows]), n_needed, None)

    whole = fit(np.arange(len(x)))
    ratios = []
    for i in range(len(x)):
        others, one = fit(np.delete(np.arange(len(x)), i)), x[[i]]
        predicted = others.representation.decoded(others.process.mean(one))
        errors = mode_errors(predicted, Modes(*(part[[i]] for part in modes)), n_needed)
        ratios.append(errors[0] / whole.process.left_out[1][i])
    # As of Student's t: few runs leave the size of the errors uncertain, too.
    left = len(x) - 1 - x.shape[1]
    return whole._replace(ratios=np.sqrt(left / max(left - 2, 1)) * np.array(ratios))


def _run(**factors: float) -> None:
    raise ValueError(f"the program was not run at {factors}")
