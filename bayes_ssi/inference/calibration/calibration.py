"""Deterministic calibration: every distinct minimum of the paper's objective.

With r_f = f/f_e - 1 and r_φ = ‖φ - φ_e‖ = √(2(1 - √MAC)) for unit shapes of matching sign,

    f_ob = √[(Σ r_f² + λ² Σ r_φ²) / (Σ 1 + λ² Σ 1)]        (paper, Eq. 1)

Updating problems often have several minima, even with the same f_ob, so one optimum is not a
sufficient answer: all minima reached from many starts are listed.

Where the parameters are more than the data determine, the errors of the data drive the others as
far as a search lets them go. The fit is then that of the determined directions alone, the others
at the prior median; or, with the prior's pull, the maximum of the posterior density.

How far calibrated classes are from a reference class, in what all of them may infer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.displayed import Displayed
from bayes_ssi.inference.calibration.determination import Determination, determination
from bayes_ssi.inference.calibration.fit import Fit, rms_distance
from bayes_ssi.inference.calibration.least_squares import (
    CALIBRATION,
    CalibrationProblem,
    checked_shape_weight,
)
from bayes_ssi.inference.model_class.model_class import ModelClass


@dataclass(frozen=True, repr=False)
class Calibration(Displayed):
    """All distinct minima of the objective.

    Attributes:
        name: name of the model class.
        parameter_names: parameters that the structure depends on.
        before: the model at the reference values.
        minima: the best first; equally good ones by their distance from the prior median. Where
            no search ended at one, the least change alone.
        least_change: the fit of what the data determine better than the prior, the rest at the
            prior median; None where there is no rest, or the best minimum is this fit.
        shape_weight: λ.
        undetermined_directions: the number of directions in parameter space that the residuals
            do not determine at the best minimum. If any, the minima form a surface, and its
            point nearest to the prior median is listed. Where no search ended at a minimum, the
            number that the data determine no better than the prior.
        n_starts: local searches made.
        n_converged: those that ended at a minimum.
        with_prior: whether the prior was fitted, too; minima are then those of
            ``Σ r²/σ² + Σ z²`` over residuals r with standard errors σ and standard-normal
            coordinates z of the parameters, which is the posterior density's exponent.
        determination: what the data determine of the parameters, at the least change where there
            is one, and otherwise at the best minimum.
        errors_are_correlated: whether the class's error model has correlations. These are not
            considered here: the determination, and a fit with the prior, take all residuals for
            independent.
    """

    name: str
    parameter_names: tuple[str, ...]
    before: Fit
    minima: tuple[Fit, ...]
    least_change: Fit | None
    shape_weight: float
    undetermined_directions: int
    n_starts: int
    n_converged: int
    with_prior: bool
    determination: Determination
    errors_are_correlated: bool

    @property
    def best(self) -> Fit:
        return self.minima[0]

    def _line(self) -> str:
        minima = f"{len(self.minima)} {'minimum' if len(self.minima) == 1 else 'minima'}"
        return f"of {self.name!r}: {minima}, best objective {100.0 * self.best.objective:.3g} %"

    def _rows(self) -> list[dict[str, Any]]:
        fits = [
            ("before", self.before),
            *((f"minimum {i}", m) for i, m in enumerate(self.minima, 1)),
        ]
        return [
            {"fit": name, "objective": fit.objective, "distance": fit.distance}
            | dict(zip(self.parameter_names, fit.values, strict=True))
            for name, fit in fits
        ]


@checked
def calibrate(
    model_class: ModelClass,
    shape_weight: float | None = None,
    reference: Mapping[str, float] | None = None,
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
        reference: parameter name → value from which the distance d is measured, also the
            model before calibration; prior medians where not given.
        n_starts: local searches, spread over the prior and beyond, at most 10,000.
        seed: seed of the starts.
        progress: called with the name of the step and the fraction of it completed.
        with_prior: fit the prior, too, which determines what the data do not: regularised least
            squares, whose minima are the maxima of the posterior density at fixed error sizes.

    Raises:
        NothingToCalibrateError: no mode is paired, a pairing is inferred, or the structures have
            no parameter.
        ValueError: a reference is given for an unknown parameter, the weight is negative, there
            is no start or there are too many, or no search converged.
    """
    shape_weight = checked_shape_weight(model_class, shape_weight, "calibrate")
    most = CALIBRATION.most_starts
    if not 1 <= n_starts <= most:
        raise ValueError(f"calibrate: n_starts must be from 1 to {most:,}, got {n_starts!r}")
    if seed < 0:
        raise ValueError(f"calibrate: seed must be zero or positive, got {seed!r}")
    model_class.check_structure()
    problem = CalibrationProblem(model_class, shape_weight, with_prior)
    reference_values = problem.reference_values(reference)
    ends = []
    if progress is not None:
        progress("local searches", 0.0)
    for done, start in enumerate(problem.starts(n_starts, seed), 1):
        end = problem.descend(start)
        ends += [end] if end is not None else []
        if progress is not None:
            progress("local searches", done / n_starts)
    minima, undetermined = distinct_minima(problem, ends) if ends else ([], 0)
    least_change = None if with_prior else _least_change(model_class, shape_weight)
    if not minima and least_change is None:
        raise ValueError(
            f"model class {model_class.name!r}: no local search for a minimum converged"
        )
    found = determination(problem, minima[0] if least_change is None else least_change)
    if least_change is not None and not minima:
        minima, undetermined = [least_change], sum(s <= 1.0 for s in found.singular_values)
    if (
        least_change is not None
        and np.abs(least_change - minima[0]).max() < CALIBRATION.same_minimum
    ):
        least_change = None

    def fit(z: FloatArray) -> Fit:
        return problem.fit(problem.values(z[None]), reference_values)

    return Calibration(
        name=model_class.name,
        parameter_names=problem.names,
        before=problem.fit(reference_values[None], reference_values),
        minima=tuple(map(fit, minima)),
        least_change=None if least_change is None else fit(least_change),
        shape_weight=shape_weight,
        undetermined_directions=undetermined,
        n_starts=n_starts,
        n_converged=len(ends),
        with_prior=with_prior,
        determination=found,
        errors_are_correlated=model_class.error.is_correlated,
    )


def _least_change(model_class: ModelClass, shape_weight: float) -> FloatArray | None:
    """The fit of the directions that the data determine; None where that is all of them."""
    with_prior = CalibrationProblem(model_class, shape_weight, with_prior=True)
    near = with_prior.descend(np.zeros(len(with_prior.names)))
    if near is None:
        return None
    return nearest_fit(CalibrationProblem(model_class, shape_weight), near, exactly=False)


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
        if all(np.abs(ends[i] - ends[j]).max() > CALIBRATION.same_minimum for j in kept):
            kept.append(i)
    best = ends[kept[0]]
    undetermined = 0
    if not problem.with_prior:
        undetermined = len(best) - _determined(problem, best, exactly=True).shape[1]
    if undetermined:
        # The equally good points form a surface; the nearest of them represents it.
        worse = misfits[kept[0]] + CALIBRATION.equally_good
        kept = [kept[0], *(i for i in kept if misfits[i] >= worse)]
        nearest = nearest_fit(problem, best, exactly=True)
        if nearest is not None and problem.misfit(nearest[None])[0] < worse:
            best = nearest
    return [best, *(ends[i] for i in kept[1:])], undetermined


def nearest_fit(problem: CalibrationProblem, start: FloatArray, exactly: bool) -> FloatArray | None:
    """The fit whose undetermined directions are at the prior median.

    None where every direction is determined, or no fit is reached.

    For residuals linear in the standard-normal coordinates this is the least-squares solution of
    smallest norm, by the truncated singular value decomposition.

    Args:
        start: (d,), near the fit.
        exactly: whether only directions count as undetermined that change nothing at all, rather
            than less than the standard errors.
    """
    z = start
    for _ in range(CALIBRATION.most_rounds):
        basis = _determined(problem, z, exactly)
        if basis.shape[1] == len(z):
            return None
        if not basis.size:
            return np.zeros(len(z))
        found = problem.descend(z, basis)
        if found is None:
            return None
        z, last = found, z
        if np.abs(z - last).max() < CALIBRATION.same_minimum**2:
            break
    return z


def _determined(problem: CalibrationProblem, z: FloatArray, exactly: bool) -> FloatArray:
    """Orthonormal basis (d, r) of the directions that are determined at one point."""
    _, sizes, rows = np.linalg.svd(problem.sensitivities(z), full_matrices=False)
    basis: FloatArray = rows[
        sizes > (CALIBRATION.zero_sensitivity * sizes.max() if exactly else 1.0)
    ].T
    return basis


def distances_from(
    reference: str, classes: Sequence[ModelClass], calibrations: Mapping[str, Calibration]
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Root mean square distances of the best fits from that of a reference class (section 4.5).

    They are over the parameters of all classes without appendages, each divided by its prior
    median; a class that does not infer one has it at the median.

    Returns:
        The names of the parameters, and name of a class → its distance.
    """
    require_known("reference: no calibrated model class", [reference], calibrations)
    known = [candidate for candidate in classes if candidate.name in calibrations]
    bare = [c for c in known if not any(test.structure.appendages for test in c.configurations)]
    medians: dict[str, float] = {}
    for candidate in bare or known:
        names = calibrations[candidate.name].parameter_names
        prior = {p.name: p.prior.quantile(0.5) for p in candidate.parameters}
        medians |= {name: prior[name] for name in names}

    def normalised(name: str) -> dict[str, float]:
        one = calibrations[name]
        values = dict(zip(one.parameter_names, one.best.values, strict=True))
        return {key: values.get(key, median) / median for key, median in medians.items()}

    at = normalised(reference)
    return tuple(medians), {name: rms_distance(normalised(name), at) for name in calibrations}
