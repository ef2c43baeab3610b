"""Deterministic calibration: every distinct minimum of the paper's objective.

With r_f = f/f_e - 1 and r_φ = ‖φ - φ_e‖ = √(2(1 - √MAC)) for unit shapes of matching sign,

    f_ob = √[(Σ r_f² + λ² Σ r_φ²) / (Σ 1 + λ² Σ 1)]        (paper, Eq. 1)

Updating problems often have several minima, even with the same f_ob, so one optimum is not a
sufficient answer: all minima reached from many starts are listed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bayes_ssi.calibration.least_squares import CalibrationProblem, Fit, distinct_minima
from bayes_ssi.model_class.model_class import ModelClass


@dataclass(frozen=True)
class Calibration:
    """All distinct minima of the objective.

    Attributes:
        name: name of the model class.
        parameter_names: parameters that the structure depends on.
        before: the model at the reference values.
        minima: the best first; equally good ones by their distance from the prior median.
        shape_weight: λ.
        undetermined_directions: the number of directions in parameter space that the residuals
            do not determine at the best minimum. If any, the minima form a surface, and its
            point nearest to the prior median is listed.
        n_starts: local searches made.
    """

    name: str
    parameter_names: tuple[str, ...]
    before: Fit
    minima: tuple[Fit, ...]
    shape_weight: float
    undetermined_directions: int
    n_starts: int

    @property
    def best(self) -> Fit:
        return self.minima[0]


def calibrate(
    model_class: ModelClass,
    shape_weight: float | None = None,
    reference: Mapping[str, float] | None = None,
    n_starts: int = 64,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
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
        n_starts: local searches, spread over the prior and beyond.
        seed: seed of the starts.
        progress: called with the name of the step and the fraction of it completed.

    Raises:
        NothingToCalibrateError: no mode is paired, a pairing is inferred, or the structures have
            no parameter.
        ValueError: a reference is given for an unknown parameter, the weight is negative, there
            is no start, or no search converged.
    """
    if shape_weight is None:
        shape_weight = model_class.error.shape_weight
    if not (math.isfinite(shape_weight) and shape_weight >= 0):
        raise ValueError(f"calibrate: shape_weight must be zero or positive, got {shape_weight!r}")
    if n_starts < 1:
        raise ValueError(f"calibrate: n_starts must be at least 1, got {n_starts!r}")
    model_class.check_structure()
    problem = CalibrationProblem(model_class, shape_weight)
    reference_values = problem.reference_values(reference)
    ends = []
    for done, start in enumerate(problem.starts(n_starts, seed), 1):
        ends.append(problem.descend(start))
        if progress is not None:
            progress("descents", done / n_starts)
    minima, undetermined = distinct_minima(problem, [end for end in ends if end is not None])
    if not minima:
        raise ValueError(
            f"model class {model_class.name!r}: no local search for a minimum converged"
        )
    fits = [problem.fit(problem.values(z[None]), reference_values) for z in minima]
    return Calibration(
        name=model_class.name,
        parameter_names=problem.names,
        before=problem.fit(reference_values[None], reference_values),
        minima=tuple(fits),
        shape_weight=shape_weight,
        undetermined_directions=undetermined,
        n_starts=n_starts,
    )
