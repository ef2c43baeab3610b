"""A structure whose modes are emulated: smooth functions fitted to some of its solutions."""

from collections.abc import Mapping
from copy import copy
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.structures.emulation import mode_representations
from bayes_ssi.structures.emulation.gaussian_process import (
    GaussianProcess,
    n_quadratic_terms,
    quadratic_terms,
)
from bayes_ssi.structures.modal import Modes, NoModesError
from bayes_ssi.structures.structure import Accuracy, ApproximateStructure, Requirement, Structure

# Over the prior, for each coefficient of a polynomial of second degree: one would do without
# errors.
SOLUTIONS_PER_COEFFICIENT = 2
# At most, for each parameter; where they do not suffice, the error is accepted and reported.
SOLUTIONS_PER_PARAMETER = 70
# Solutions between two fits, for each parameter: enough to keep workers busy, few enough to be
# placed by the fit before.
BATCH_PER_PARAMETER = 2
N_NEAREST = 8  # solutions by which the claimed error at a point is judged
# The claimed error is that of a typical point, the median: exact solutions at draws correct the
# rest, and count every point by its share.
CLAIMED_AT = 0.5
# Largest share of the points at which it may be open whether the structure fails: exact
# solutions at draws correct the rest.
MOST_OPEN = 0.05
# Prior precision of the coefficients of the odds of failing: boundaries between two points
# become sharp, not infinitely.
FAILING_PRECISION = 1e-3


class FailingPoints:
    """The probability that a model fails, from the points at which it did and did not.

    The logarithm of the odds is a polynomial of second degree, whose boundary is a plane, an
    ellipsoid or a hyperboloid.
    """

    def __init__(self, failed: FloatArray, values: FloatArray, succeeded: FloatArray) -> None:
        """Fit to points (F, d), with their values, and (N, d) where the model did not fail."""
        self.x, self.values, self.succeeded = failed, values, succeeded
        self.coefficients: FloatArray | None = None  # of the polynomial, unless it never failed
        if not len(failed):
            return
        from scipy.optimize import minimize  # takes long to import

        terms = quadratic_terms(np.vstack([failed, succeeded]))
        signs = np.repeat([1.0, -1.0], [len(failed), len(succeeded)])
        precision = FAILING_PRECISION

        def cost(c: FloatArray) -> tuple[float, FloatArray]:
            margins = signs * (terms @ c)
            value = np.logaddexp(0.0, -margins).sum() + 0.5 * precision * c @ c
            return float(value), precision * c - terms.T @ (signs * expit(-margins))

        self.coefficients = minimize(cost, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B").x

    def votes(self, x: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether the model fails (B,) at ``x`` (B, d): by the odds, and at the nearest point."""
        if self.coefficients is None:
            return np.zeros(len(x), dtype=bool), np.zeros(len(x), dtype=bool)
        odds = np.einsum("bp,p->b", quadratic_terms(x), self.coefficients)
        to_failed, to_succeeded = (
            ((x[:, None] - each) ** 2).sum(axis=2).min(axis=1) for each in (self.x, self.succeeded)
        )
        return np.asarray(odds > 0.0), np.asarray(to_failed < to_succeeded)

    def expected(self, x: FloatArray) -> NDArray[np.bool_]:
        """Whether the model fails (B,) at ``x`` (B, d) by both votes."""
        by_odds, by_nearest = self.votes(x)
        return by_odds & by_nearest


class EmulatedStructure(ApproximateStructure):
    """A structure whose modes are predicted from some of its solutions by Gaussian processes.

    The first solutions fill the prior evenly; :meth:`accurate_at` adds others where the modes are
    needed more precisely. What is emulated are functions of the modes that stay smooth where modes
    cross (:mod:`bayes_ssi.structures.emulation.mode_representations`), whichever predicts solutions
    that are left out best. Errors are estimated from solutions left out: their ratio to what the
    process expects of them, times what it expects elsewhere. A model that jumps, or is noisy, shows
    in this ratio.

    Solutions of an emulated structure never change: adding some makes a new structure.
    """

    def __init__(
        self, exact: Structure, *, fit: "EmulatorFit | None" = None, seed: int = 0
    ) -> None:
        """Choose the structure, whose modes may be NaN, or raise; nothing is computed yet.

        Args:
            seed: of the first solutions: those of runs that should be independent differ.
        """
        self._exact, self._fit, self._seed = exact, fit, seed

    @property
    def most_solutions(self) -> int:
        return SOLUTIONS_PER_PARAMETER * max(len(self.parameters), 2)

    @property
    def exact(self) -> Structure:
        return self._exact

    @property
    def emulator(self) -> "EmulatorFit":
        """The solutions and what is fitted to them; the first are made when they are needed."""
        if self._fit is None:
            n = SOLUTIONS_PER_COEFFICIENT * n_quadratic_terms(len(self.parameters))
            # Extremely rare values would be extrapolated from, rather than between.
            self._fit = self._with(None, self.prior_points(n, 1e-3, self._seed))
        return self._fit

    def description(self) -> Mapping[str, Any]:
        return {**self._exact.description(), "modes emulated": "by Gaussian processes"}

    def modes(self, values: FloatArray) -> Modes:
        """See :meth:`Structure.modes`; rows where the structure is expected to fail are NaN."""
        fit = self.emulator
        x = self._coordinates(values)
        modes = fit.representation.decoded(fit.process.mean(x))
        failing = fit.failing.expected(x)
        if len(values) == 1 and failing.any():
            away = ((fit.failing.x - x) ** 2).sum(axis=1)
            self._exact.modes(fit.failing.values[[away.argmin()]])  # says why
        modes.frequencies_hz[failing], modes.shapes[failing] = np.nan, np.nan
        return modes

    def accurate_at(self, required: Requirement) -> Self:
        """This structure if it is accurate enough, or one with more solutions.

        One batch of solutions is added, where its error is largest in units of what is required,
        unless it is small enough at nearly all values or ``most_solutions`` are made.
        """
        values, *errors, n_modes = required
        fit, x = self._fit_for(n_modes), self._coordinates(values)
        allowed = float((errors / fit.errors_per_spread(x)).min())
        by_odds, by_nearest = fit.failing.votes(x)
        is_open = by_odds != by_nearest
        accurate = np.quantile(fit.spreads(x), CLAIMED_AT) <= allowed
        if accurate and is_open.mean() <= MOST_OPEN:
            return self if fit is self._fit else self._of_fit(fit)
        if len(fit.x) + len(fit.failing.x) >= self.most_solutions:
            return self
        if accurate:  # only the boundary of the region that fails is missing
            values, x, allowed = values[is_open], x[is_open], 0.0
        return self._of_fit(self._with(fit, values[self._worst(fit, x, allowed)]))

    def accuracy(self, values: FloatArray, n_modes: int | None = None) -> Accuracy:
        fit, x = self._fit_for(n_modes), self._coordinates(values)
        spread = float(np.quantile(fit.spreads(x), CLAIMED_AT))
        frequency, shape = (spread * fit.errors_per_spread(x)).tolist()
        return Accuracy(
            frequency,
            shape,
            f"modes emulated from {len(fit.x)} solutions; by solutions left out, frequencies "
            f"differ from the structure's at a typical draw by {frequency:.1g} (as a fraction)",
            f" and shapes at the sensors by {shape:.1g} (at unit length)",
        )

    def _of_fit(self, fit: "EmulatorFit") -> Self:
        better = copy(self)
        better._fit = fit
        return better

    def _fit_for(self, n_modes: int | None) -> "EmulatorFit":
        """The fit in which the lowest ``n_modes`` decide."""
        fit, n_needed = self.emulator, n_modes or self.n_modes
        if n_needed == fit.n_needed:
            return fit
        return EmulatorFit.best(fit.x, fit.modes, fit.failing, n_needed, fit)

    def _with(self, fit: "EmulatorFit | None", values: FloatArray) -> "EmulatorFit":
        """The fit to the solutions of ``fit`` and those at ``values``."""
        x, modes = self._coordinates(values), self._exact.modes_or_nan(values)
        possible = (np.isfinite(modes.frequencies_hz) & (modes.frequencies_hz > 0)).all(axis=1)
        possible &= np.isfinite(modes.shapes).all(axis=(1, 2))
        solved, failed, values_failed = x[possible], x[~possible], values[~possible]
        modes = Modes(*(array[possible] for array in modes))
        if fit is not None:
            solved, modes = np.concatenate([fit.x, solved]), joined([fit.modes, modes])
            failed = np.concatenate([fit.failing.x, failed])
            values_failed = np.concatenate([fit.failing.values, values_failed])
        if len(solved) < 2 * (len(self.parameters) + 1):
            raise NoModesError(
                f"the structure has modes at {len(solved)} of {len(solved) + len(failed)} "
                "points of the prior, too few to emulate it"
            )
        n_needed = self.n_modes if fit is None else fit.n_needed
        failing = FailingPoints(failed, values_failed, solved)
        return EmulatorFit.best(solved, modes, failing, n_needed, fit)

    def _worst(self, fit: "EmulatorFit", x: FloatArray, allowed: float) -> NDArray[np.intp]:
        """Rows of ``x`` where the spread is largest, each given that those before are known."""
        chosen: list[int] = []
        for _ in range(BATCH_PER_PARAMETER * len(self.parameters)):
            spreads = fit.spreads(x, x[chosen])
            worst = int(spreads.argmax())
            if spreads[worst] <= allowed or worst in chosen:
                break
            chosen.append(worst)
        return np.array(chosen, dtype=np.intp)

    def _coordinates(self, values: FloatArray) -> FloatArray:
        """Coordinates (B, d) in which modes are smooth, of unit spread over the prior.

        Normal ones, in which products of LogNormal factors are linear; but those of a prior with
        two bounds crowd together there, so that its values themselves are taken.
        """
        columns = []
        for column, parameter in zip(values.T, self.parameters, strict=True):
            low, high = parameter.prior.support
            if np.isfinite([low, high]).all():
                columns.append(np.sqrt(12.0) * (column - 0.5 * (low + high)) / (high - low))
            else:
                columns.append(parameter.prior.to_normal(column))
        return np.column_stack(columns)

    def __repr__(self) -> str:
        return f"EmulatedStructure({self._exact!r}, most_solutions={self.most_solutions})"


class EmulatorFit(NamedTuple):
    x: FloatArray  # (N, d), coordinates of the solutions
    modes: Modes
    failing: FailingPoints
    representation: mode_representations.Representation
    process: GaussianProcess
    # (N, 2), errors of the frequencies and shapes of each solution, predicted from all others, as
    # multiples of the process's spread there.
    ratios: FloatArray
    n_needed: int

    @classmethod
    def best(
        cls,
        x: FloatArray,
        modes: Modes,
        failing: FailingPoints,
        n_needed: int,
        before: "EmulatorFit | None",
    ) -> "EmulatorFit":
        """The fit by the representation that predicts the last half of the solutions best."""
        _, n_dof, n_modes = modes.shapes.shape
        fits, scores = [], []
        for kind in (mode_representations.ModalOperator, mode_representations.TrackedModes):
            representation = kind(n_dof, n_modes)
            vectors = representation.encoded(x, modes)
            if vectors is None:
                continue
            same = before if before and isinstance(before.representation, kind) else None
            weights = representation.weights(vectors, n_needed)
            process = GaussianProcess.fitted(x, vectors, weights, same.process if same else None)
            left_out, spreads = process.left_out
            errors = mode_errors(representation.decoded(left_out), modes, n_needed)
            of_frequencies, of_shapes = errors[len(errors) // 2 :].T
            weighted = np.maximum(of_frequencies, mode_representations.SHAPE_WEIGHT * of_shapes)
            scores.append(float(np.median(weighted)))
            ratios = errors / spreads[:, None]
            fits.append(cls(x, modes, failing, representation, process, ratios, n_needed))
        return fits[int(np.argmin(scores))]

    def spreads(self, x: FloatArray, known: FloatArray | None = None) -> FloatArray:
        """The process's spread (B,) at ``x``, zero where the structure is expected to fail.

        ``known`` are taken for solutions, as are points that failed: others close by would, too.
        """
        known = np.empty((0, x.shape[1])) if known is None else known
        spreads = self.process.spreads(x, np.concatenate([self.failing.x, known]))
        return np.where(self.failing.expected(x), 0.0, spreads)

    def errors_per_spread(self, x: FloatArray) -> FloatArray:
        """Claimed errors (2,) of frequencies and shapes a unit of spread, by nearest solutions."""
        away = (((x[:, None] - self.x) / self.process.lengths) ** 2).sum(axis=2)
        nearest = np.argsort(away, axis=1, kind="stable")[:, :N_NEAREST].ravel()
        return np.asarray(np.sqrt((self.ratios[nearest] ** 2).mean(axis=0)) + 1e-300)


def mode_errors(modes: Modes, exact: Modes, n_modes: int) -> FloatArray:
    """Largest errors (B, 2) of frequencies, as fractions, and of shapes at unit length."""
    frequency = np.abs(modes.frequencies_hz / exact.frequencies_hz - 1.0)[:, :n_modes].max(axis=1)
    ours, theirs = (
        mode_representations.unit_shapes(each.shapes[:, :, :n_modes]) for each in (modes, exact)
    )
    alike = np.abs(np.einsum("bdm,bdm->bm", ours, theirs))
    # |a - b|² = 2 - 2 a·b; zero where a shape is not measured at all.
    shape = np.sqrt(np.maximum(2.0 - 2.0 * alike, 0.0)).max(axis=1)
    return np.column_stack([frequency, shape if exact.shapes.shape[1] else 0.0 * frequency])
