"""Any pairing with precise modes: evidences against references, and what searches find.

    python runs/benchmarks/narrow_regions.py [--seeds 3] [--only NAME] [--draws 400000]

Errors of 1e-2, 1e-3 and 1e-4 of frequencies and of shapes at unit length, fixed, or of the
identification with one prediction error that is inferred: the shear building with its infill and
with the infill as mass, and the four-storey benchmark building of 12 degrees of freedom (Johnson,
Lam, Katafygiotis and Beck 2004), six modes simulated with stiffnesses that the class can have, and
with others, off by 3 %, of which it fits some modes at a time only.

The reference is independent of the package's searches: least squares for every plausible pairing,
and importance sampling around all maxima together (``modal_references.py``); where an error size is
inferred, the trapezoidal rule over its coordinate. The last columns are what four searches find,
by Laplace's approximation, and their evaluations, without and with starts in narrow regions.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from modal_references import reference
from problems import STUDY
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.sampling.multistart import search_maxima
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.studies.ranking.study import load_study

ERRORS = (1e-2, 1e-3, 1e-4)
INFERRED = bs.LogNormal(median=0.01, cov=1.0)
# Least-squares ascents of one reference: a few of each of the 73 or 209 pairings of the shear
# building, of which its residuals, all but linear in the logarithms of the factors, need one.
ASCENTS = 400
# The trapezoidal rule over the error size: the integrand is as smooth as the prior.
NODES, STEP = np.linspace(-6.0, 4.0, 21, retstep=True)

MASSES = np.array([3452.4, 2652.4, 2652.4, 1809.9])
INERTIAS = np.array([3819.4, 2986.1, 2986.1, 2056.9])
STIFFNESSES = {"x": 106.60e6, "y": 67.90e6, "torsion": 232.02e6}
SENSORS = tuple(f"floor {i} {direction}" for i in (2, 4) for direction in STIFFNESSES)


def building(factor: Callable[[str, int], Value]) -> bs.ShearBuilding3D:
    """With a factor of the stiffness in each direction of every storey, counted from 0."""
    x, y, torsion = (
        tuple(nominal * factor(direction, storey) for storey in range(4))
        for direction, nominal in STIFFNESSES.items()
    )
    return bs.ShearBuilding3D(tuple(MASSES), tuple(np.sqrt(INERTIAS / MASSES)), x, y, torsion)


def benchmark_building(error: float, off: float) -> bs.ModelClass:
    """One factor a direction for the lower and for the upper two storeys, true but for ``off``."""
    rng = np.random.default_rng(1)
    halves = {
        (d, half): math.exp(0.2 * rng.standard_normal()) for d in STIFFNESSES for half in "lu"
    }
    others = {
        (d, storey): math.exp(off * rng.standard_normal())
        for d in STIFFNESSES
        for storey in range(4)
    }
    true = building(lambda d, storey: halves[d, "lluu"[storey]] * others[d, storey])
    frequencies, shapes = true.modes(np.empty((1, 0)))
    rows = [true.degrees_of_freedom.index(sensor) for sensor in SENSORS]
    modes = []
    for j, shape in enumerate(shapes[0, rows, :6].T):
        noise = error * rng.standard_normal(1 + len(rows))
        # The sign of an eigenvector, and so that of its noise, would be the machine's choice.
        largest = shape[np.abs(shape).argmax()]
        measured = np.sign(largest) * shape / np.linalg.norm(shape) + noise[1:]
        frequency = float(frequencies[0, j] * (1.0 + noise[0]))
        modes.append(bs.IdentifiedMode(str(j + 1), frequency, measured))
    unknown = {key: bs.Parameter("".join(key), bs.LogNormal(1.0, 0.3)) for key in halves}
    data = bs.ModalData(tuple(modes), (0.0, float(frequencies[0, 5:7].mean())), SENSORS)
    structure = building(lambda d, storey: unknown[d, "lluu"[storey]])
    name = f"12 degrees of freedom, stiffnesses off by {off:.0%}"
    return bs.ModelClass(name, structure, data, bs.ErrorModel(error, error), pairing="any")


def shear_building(name: str, error: float) -> bs.ModelClass:
    (candidate,) = load_study(STUDY).only([name]).model_classes
    label = {"2": "shear building, infill as mass", "3": "shear building, infill"}[name]
    return replace(candidate, error=bs.ErrorModel(error, error)).with_any_pairing(label)


def with_inferred_error(candidate: bs.ModelClass, error: float) -> bs.ModelClass:
    """The error is the identification's, and one prediction error of all residuals is inferred."""
    test = candidate.configuration()
    modes = tuple(replace(m, frequency_cov=error, shape_sd=error) for m in test.data.modes)
    size = bs.Parameter("prediction error", INFERRED)
    return replace(
        candidate,
        name=f"{candidate.name}, prediction error inferred",
        configurations=(replace(test, data=replace(test.data, modes=modes)),),
        error=bs.ErrorModel(size, size),
    )


def cases(draws: int) -> Iterator[tuple[str, bs.ModelClass, Callable[[], tuple[float, float]]]]:
    """Name, class, and reference log evidence with its error."""
    for error in ERRORS:
        for make in (
            lambda e: shear_building("2", e),
            lambda e: shear_building("3", e),
            lambda e: benchmark_building(e, 0.0),
            lambda e: benchmark_building(e, 0.03),
        ):
            fixed = make(error)
            yield (
                f"{fixed.name}, {error:.0e}",
                fixed,
                lambda c=fixed: reference(c, draws, 0, ASCENTS)[:2],
            )
        for name in "23":
            fixed = shear_building(name, error)
            inferred = with_inferred_error(fixed, error)
            yield (
                f"{inferred.name}, {error:.0e}",
                inferred,
                lambda c=fixed, e=error: over_error_sizes(c, e, draws // 10),
            )


def over_error_sizes(fixed: bs.ModelClass, error: float, draws: int) -> tuple[float, float]:
    """The log evidence with an inferred error, of classes with that and ``error`` together."""
    log_evidences, errors = [], []
    for z, size in zip(NODES, INFERRED.from_normal(NODES), strict=True):
        both = float(math.hypot(size, error))
        candidate = replace(fixed, error=bs.ErrorModel(both, both))
        value, its_error, _ = reference(candidate, draws, 0, ASCENTS)
        log_evidences.append(value - 0.5 * z * z)
        errors.append(its_error)
    total = float(logsumexp(log_evidences))
    shares = np.exp(np.array(log_evidences) - total)
    scale = math.log(STEP / math.sqrt(2.0 * math.pi))
    return total + scale, float(np.sqrt(((shares * errors) ** 2).sum()))


def searched(candidate: bs.ModelClass, from_residuals: bool) -> tuple[float, int, bool]:
    target = class_target(candidate)
    if not from_residuals:
        target.suggest_starts = None
    result = search_maxima(target, 4, np.random.SeedSequence(0))
    found = result.maxima.laplace_estimate.log_evidence
    return found, target.n_evaluations, result.converged


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", default="", help="part of the names of cases")
    parser.add_argument(
        "--draws", type=int, default=400_000, help="importance draws of a reference"
    )
    options = parser.parse_args()
    for name, candidate, exact in cases(options.draws):
        if options.only not in name:
            continue
        known, known_to = exact()
        posteriors = [bs.sample(candidate, seed) for seed in range(options.seeds)]
        off = [abs(p.evidence.log_evidence - known) for p in posteriors]
        print(
            f"{name}: log evidence {known:.3f} ± {known_to:.3f}, largest error {max(off):.3f}, "
            f"claimed {np.mean([p.evidence.error for p in posteriors]):.3f}, failed checks in "
            f"{sum(bool(p.failed_checks) for p in posteriors)} of {len(posteriors)}, evaluations "
            f"{np.mean([p.n_evaluations for p in posteriors]):.0f}"
        )
        for label, from_residuals in (("without", False), ("with", True)):
            found, evaluations, agree = searched(candidate, from_residuals)
            print(
                f"    searches {label} suggested starts: {found:.2f}, {evaluations} evaluations"
                f"{'' if agree else ', they disagree'}",
                flush=True,
            )


if __name__ == "__main__":
    main()
