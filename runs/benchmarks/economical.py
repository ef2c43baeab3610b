"""The economical path on slow models: solutions that it takes, and its errors, over many seeds.

    python runs/benchmarks/economical.py

Every model counts its solutions. The reference of each is the evidence of the same model sampled
in full, to a tenth of the error.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

import bayes_ssi as bs
from bayes_ssi.structures.structure import Structure


class BlackBox(Structure):
    """A structure that counts its solutions, and shows no more than its modes at some sensors."""

    def __init__(self, hidden, sensors=None, fails=lambda _: False):
        self.hidden, self.fails = hidden, fails
        labels = hidden.degrees_of_freedom
        self.rows = [labels.index(each) for each in sensors or labels]
        self.n_asked = 0

    @property
    def parameters(self):
        return self.hidden.parameters

    @property
    def degrees_of_freedom(self):
        return tuple(self.hidden.degrees_of_freedom[row] for row in self.rows)

    @property
    def n_modes(self):
        return self.hidden.n_modes

    def modes(self, values):
        self.n_asked += len(values)
        frequencies, shapes = self.hidden.modes(values)
        failed = np.array([self.fails(row) for row in values], dtype=bool)
        frequencies = np.where(failed[:, None], np.nan, frequencies)
        return bs.Modes(frequencies, shapes[:, self.rows])


class Stiffening(Structure):
    """A shear building whose springs become stiffer at a threshold: a model that jumps."""

    def __init__(self, building, threshold, factor):
        self.building, self.threshold, self.factor = building, threshold, factor

    @property
    def parameters(self):
        return self.building.parameters

    @property
    def degrees_of_freedom(self):
        return self.building.degrees_of_freedom

    @property
    def n_modes(self):
        return self.building.n_modes

    def modes(self, values):
        values = np.array(values)
        values[values[:, 0] > self.threshold, 1] *= self.factor
        return self.building.modes(values)


@dataclass(frozen=True)
class Problem:
    """A model class, the wanted error of its log evidence, and the most solutions for it."""

    name: str
    model_class: bs.ModelClass
    error: float
    most: int


def factors(n, prior=None):
    return [bs.Parameter(f"k{i}", prior or bs.LogNormal(1.0, 0.3)) for i in range(1, n + 1)]


def identified(structure, truth, n_modes, sensors, pairing="given", **errors):
    """Data without errors from a structure, and the class that explains them."""
    frequencies, shapes = (each[0] for each in structure.modes(np.array([truth])))
    rows = [structure.degrees_of_freedom.index(each) for each in sensors]
    modes = tuple(
        bs.IdentifiedMode(str(j + 1), float(frequencies[j]), shapes[rows, j])
        for j in range(n_modes)
    )
    top = frequencies[n_modes - 1 :][:2]
    band = (0.0, float(top.mean()) if len(top) == 2 else 1.05 * float(top[0]))
    data = bs.ModalData(modes, band, tuple(sensors))
    given = {str(j): j for j in range(1, n_modes + 1)} if pairing == "given" else "any"
    return data, bs.ErrorModel(**{"frequency_cov": 0.01, "shape_sd": 0.05, **errors}), given


def of_structure(name, structure, truth, n_modes, sensors, error=0.05, most=500, **options):
    data, errors, pairing = identified(structure, truth, n_modes, sensors, **options)
    return Problem(name, bs.ModelClass(name, structure, data, errors, pairing=pairing), error, most)


def building(n):
    return bs.ShearBuilding((1.0,) * n, [4000.0 * k for k in factors(n)])


SIX = (1.1, 0.9, 1.2, 0.8, 1.0, 1.15)
TEN = (1.1, 0.9, 1.2, 0.8, 1.0, 1.15, 0.95, 1.05, 0.85, 1.1)
THREE = ("floor 1", "floor 3", "floor 6")


def six_storeys():
    return of_structure("six storeys, all floors", BlackBox(building(6)), SIX, 4, THREE)


def six_storeys_at_sensors():
    return of_structure("six storeys, three sensors", BlackBox(building(6), THREE), SIX, 4, THREE)


def any_pairing():
    box = BlackBox(building(6), THREE)
    return of_structure(
        "six storeys, any pairing, 0.1 %", box, SIX, 4, THREE, pairing="any",
        frequency_cov=0.001, shape_sd=0.02,
    )  # fmt: skip


def ten_storeys():
    sensors = ("floor 1", "floor 3", "floor 5", "floor 8", "floor 10")
    box = BlackBox(building(10), sensors)
    return of_structure("ten storeys, five sensors", box, TEN, 5, sensors, 0.1, 1500)


def crossing():
    """Sway in two directions and torsion, whose frequencies cross within prior and posterior."""
    x1, x2, y1, y2, t1, t2 = (
        bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("x1", "x2", "y1", "y2", "t1", "t2")
    )
    tower = bs.ShearBuilding3D(
        masses=(1.0, 1.0, 1.0),
        radii_of_gyration=(1.0, 1.0, 1.0),
        stiffnesses_x=(4000.0 * x1, 4000.0 * x2, 4000.0 * x2),
        stiffnesses_y=(4050.0 * y1, 4050.0 * y2, 4050.0 * y2),
        torsional_stiffnesses=(4300.0 * t1, 4300.0 * t2, 4300.0 * t2),
        eccentricities=((0.05, 0.1),) * 3,
    )
    sensors = tuple(f"{d}{floor}" for floor in (2, 3) for d in ("x", "y", "torsion"))
    sensors = tuple(each for each in tower.degrees_of_freedom if each in sensors) or tuple(
        tower.degrees_of_freedom[3:]
    )
    box = BlackBox(tower, sensors)
    truth = (1.0, 1.1, 1.0, 0.95, 1.05, 1.0)
    return of_structure("tower, close modes", box, truth, 6, sensors, pairing="any")


def failing():
    """The program diverges where two storeys are soft, at a tenth of the posterior."""
    box = BlackBox(building(6), THREE, lambda row: row[3] * row[1] < 0.66)
    return of_structure("six storeys, failing points", box, SIX, 4, THREE)


def jumping():
    box = BlackBox(Stiffening(building(6), 1.1, 1.2), THREE)
    return of_structure("six storeys, with a jump", box, SIX, 4, THREE)


ELEMENTS = 16
PLACES = np.arange(ELEMENTS)[:, None] * 2 + np.arange(4)
ROWS, COLUMNS = (np.broadcast_to(each, (ELEMENTS, 4, 4)).ravel() for each in
                 (PLACES[:, :, None], PLACES[:, None, :]))  # fmt: skip

BENDING = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
INERTIA = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])


def strip(thickness_1, thickness_2, modulus, spring):
    """A strip, 1 m long and wide, of two thicknesses on springs: sparse K and M of a beam."""
    length = 1.0 / ELEMENTS
    h = np.where(np.arange(ELEMENTS) < ELEMENTS // 2, thickness_1, thickness_2)[:, None, None]
    scale = np.outer([1.0, length, 1.0, length], [1.0, length, 1.0, length])
    bending = modulus * h**3 / 12.0 / length**3 * scale * BENDING
    inertia = 2.5e3 * h * length / 420.0 * scale * INERTIA
    n = 2 * ELEMENTS + 2
    k, m = (sp.csc_array((each.ravel(), (ROWS, COLUMNS)), shape=(n, n))
            for each in (bending, inertia))  # fmt: skip
    springs = sp.csc_array(([spring, spring], ([0, n - 2], [0, n - 2])), shape=(n, n))
    return sp.csc_array(k + springs), m


def nonlinear():
    arguments = {
        "thickness_1": 0.02 * bs.Parameter("t1", bs.LogNormal(1.0, 0.2)),
        "thickness_2": 0.02 * bs.Parameter("t2", bs.LogNormal(1.0, 0.2)),
        "modulus": 3e10 * bs.Parameter("E", bs.LogNormal(1.0, 0.2)),
        "spring": 1e6 * bs.Parameter("s", bs.LogUniform(0.1, 10.0)),
    }
    rows = {f"w{i}": 2 * i for i in (0, 4, 8, 12, 16)}
    made = bs.FunctionStructure(strip, arguments, n_modes=4, sensors=rows)
    return of_structure("strip, sparse K and M", made, (1.05, 0.9, 1.1, 0.8), 3, tuple(rows))


PROBLEMS: dict[str, Callable[[], Problem]] = {
    each.__name__: each
    for each in (
        six_storeys, six_storeys_at_sensors, any_pairing, ten_storeys, crossing, nonlinear,
        failing, jumping,
    )
}  # fmt: skip


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seeds", type=int, default=10)
    arguments.add_argument("--only", choices=tuple(PROBLEMS), nargs="*", default=tuple(PROBLEMS))
    chosen = arguments.parse_args()
    print(f"{'model':<34} {'solutions':>11} {'at most':>7} {'rms error':>9} {'claimed':>7} "
          f"{'worst':>6} {'means':>6} flags")  # fmt: skip
    for name in chosen.only:
        problem = PROBLEMS[name]()
        candidate = problem.model_class
        careful = bs.SamplingSettings(log_evidence_error=0.1 * problem.error)
        reference = bs.sample(candidate, settings=careful)
        settings = bs.SamplingSettings(log_evidence_error=problem.error, economical=True)
        posteriors = [bs.sample(candidate, seed=s, settings=settings) for s in range(chosen.seeds)]
        off = np.array([p.evidence.log_evidence for p in posteriors])
        off -= reference.evidence.log_evidence
        sd = np.array([row.sd for row in reference.summary])
        means = np.array([[row.mean for row in p.summary] for p in (reference, *posteriors)])
        solutions = [p.n_evaluations for p in posteriors]
        flags = sum(bool(p.failed_checks) for p in posteriors)
        claimed = np.mean([p.evidence.error for p in posteriors])
        print(f"{problem.name:<34} {min(solutions):>5}-{max(solutions):<5} {problem.most:>7} "
              f"{np.sqrt((off**2).mean()):>9.3f} {claimed:>7.3f} {np.abs(off).max():>6.3f} "
              f"{np.sqrt((((means[1:] - means[0]) / sd) ** 2).mean()):>6.3f} {flags} of {len(off)}",
              flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
