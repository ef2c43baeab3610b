"""Time against size: full solutions and a reduced basis, for plates of 1e3 to 1e5 unknowns.

    pip install -e ".[fem]"
    python runs/benchmarks/scaling.py

A simply supported square plate of thin steel, in five strips whose bending stiffnesses are to be
inferred, is meshed by scikit-fem with conforming plate elements (Bogner, Fox and Schmit: four
degrees of freedom a node). The six lowest modes at 25 sensors are simulated, and the posterior of
the five factors is sampled with the reduced model. For each size: the CPU time of a full solution
(the direct path needs one for every evaluation), full solutions spent in all, the CPU time of an
evaluation of the likelihood with the reduced model, and its error at draws. Writes
runs/results/scaling.png.
"""

import argparse
import re
from pathlib import Path
from time import process_time

import numpy as np

import bayes_ssi as bs
from bayes_ssi.plots.figure_style import BLUE, VERMILION, style
from bayes_ssi.structures.structure import Requirement

SIZES = (1_000, 10_000, 100_000)
N_STRIPS, N_MODES = 5, 6
SIDE, THICKNESS, DENSITY, POISSON, YOUNG = 1.0, 0.002, 7850.0, 0.3, 210e9
TRUTH = (0.8, 1.1, 1.0, 1.25, 0.9)
BATCH = 256
ERROR = bs.ErrorModel(frequency_cov=0.002, shape_sd=0.01)


def plate(size):
    """Strips' stiffness matrices, the mass matrix, and sensors, without supported ones."""
    from skfem import Basis, BilinearForm, ElementQuadBFS, MeshQuad, asm
    from skfem.helpers import dd, ddot, eye, trace

    n = round(np.sqrt(size / 4.0))
    across = np.linspace(0.0, SIDE, n)
    mesh = MeshQuad.init_tensor(across, across)
    rigidity = YOUNG * THICKNESS**3 / (12.0 * (1.0 - POISSON**2))

    @BilinearForm
    def bending(u, v, _):
        c = (1.0 - POISSON) * dd(u) + POISSON * eye(trace(dd(u)), 2)
        return rigidity * ddot(c, dd(v))

    @BilinearForm
    def inertia(u, v, _):
        return DENSITY * THICKNESS * u * v

    element = ElementQuadBFS()
    whole = Basis(mesh, element)
    free = whole.complement_dofs(whole.get_dofs().all(["u"]))
    centres = mesh.p[0, mesh.t].mean(axis=0)
    strip = np.minimum((centres / SIDE * N_STRIPS).astype(int), N_STRIPS - 1)
    parts = [
        asm(bending, Basis(mesh, element, elements=np.flatnonzero(strip == i)))
        for i in range(N_STRIPS)
    ]
    place = np.full(whole.N, -1)
    place[free] = np.arange(len(free))
    sensors = {}
    for i in range(1, 6):
        for j in range(1, 6):
            distance = np.hypot(mesh.p[0] - i * SIDE / 6, mesh.p[1] - j * SIDE / 6)
            sensors[f"{i}{j}"] = int(place[whole.nodal_dofs[0, distance.argmin()]])
    return [k[free][:, free] for k in parts], asm(inertia, whole)[free][:, free], sensors


def model_class(size):
    parts, mass, sensors = plate(size)
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, N_STRIPS + 1)]
    terms = list(zip(factors, parts, strict=True))
    full = bs.MatrixStructure(terms, mass, sensors=sensors, n_modes=N_MODES)
    frequencies, shapes = (each[0] for each in full.modes(np.array([TRUTH])))
    rng = np.random.default_rng(0)
    modes = []
    for i in range(N_MODES):
        unit = shapes[:, i] / np.linalg.norm(shapes[:, i])
        identified = float(frequencies[i] * (1.0 + 0.002 * rng.standard_normal()))
        shape = unit + 0.01 * rng.standard_normal(len(unit))
        modes.append(bs.IdentifiedMode(str(i + 1), identified, shape))
    band = (0.0, float(1.05 * frequencies[-1]))
    data = bs.ModalData(tuple(modes), band, sensors=full.degrees_of_freedom)
    return bs.ModelClass(f"{full.size} degrees of freedom", full.reduced(), data, ERROR,
                         pairing="any")  # fmt: skip


def measured(size):
    candidate = model_class(size)
    reduced, full = candidate.structure, candidate.structure.full
    begun = process_time()
    full.full_modes(np.array(TRUTH) * 1.01)
    direct = process_time() - begun
    begun = process_time()
    candidate.check_structure()  # makes the basis
    training = process_time() - begun
    begun = process_time()
    posterior = bs.sample(candidate)
    sampling = process_time() - begun
    values = posterior.values[:: len(posterior.values) // BATCH][:BATCH]
    better = candidate.with_structures(lambda s, _: s.accurate_at(Requirement(values, 2e-4, 1e-3)))
    begun = process_time()
    better.log_likelihood(values)
    evaluation = (process_time() - begun) / BATCH
    basis = better.structure.basis.size
    spent = sum(int(count) for count in re.findall(r"(\d+) full solutions", str(posterior.remarks)))
    print(f"{full.size} degrees of freedom: a full solution {direct:.3g} s; basis of {basis} from "
          f"{reduced.n_full_solutions} full solutions in {training:.3g} s; an evaluation "
          f"{1e3 * evaluation:.2f} ms; {posterior.n_evaluations} evaluations in {sampling:.0f} s, "
          f"{spent} full solutions in all", flush=True)  # fmt: skip
    for remark in (*posterior.remarks, *(f"(!) {each}" for each in posterior.failed_checks)):
        print(f"  {remark}")
    for row, true in zip(posterior.summary, TRUTH, strict=True):
        print(f"  {row.name}: {row.mean:.3f} ± {row.sd:.3f}, true {true}")
    return full.size, direct, evaluation


def draw(rows, path):
    import matplotlib.pyplot as plt

    sizes, direct, reduced = np.array(rows).T
    with style():
        figure, ax = plt.subplots(figsize=(5.5, 3.6))
        ax.loglog(sizes, direct, "o-", color=VERMILION, label="direct: a full solution")
        ax.loglog(sizes, reduced, "s--", color=BLUE, label="reduced, certified")
        for x, y in zip((*sizes, *sizes), (*direct, *reduced), strict=True):
            text = f"{y:.2g} s" if y >= 0.1 else f"{1e3 * y:.2g} ms"
            ax.annotate(text, (x, y), (0, 6), textcoords="offset points", ha="center")
        ax.set_xlim(sizes.min() / 1.8, sizes.max() * 1.8)
        ax.set_ylim(reduced.min() / 3.0, direct.max() * 3.0)
        ax.set_xlabel("degrees of freedom")
        ax.set_ylabel("CPU time of one likelihood (s)")
        ax.set_title("Plates with five parameters: time against size")
        figure.legend(loc="outside lower center", ncols=2)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    print(f"drawn in {path}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    given = arguments.parse_args()
    rows = [measured(size) for size in given.sizes]
    draw(rows, Path("runs") / "results" / "scaling.png")


if __name__ == "__main__":
    main()
