"""Time of a search against the size of the model and the number of places.

    pip install -e ".[fem]"
    python runs/benchmarks/search_scaling.py

A hollow concrete tower of 60 m, its wall one linear hexahedron thick, is meshed by scikit-fem ever
finer over its height. Young's moduli of its four quarters are to be inferred. On one of 500 nodes
hangs a tank of 2 % of the modal mass there, in resonance with the third mode. The test has nine
sensors and identifies the modes below 10 Hz, with errors of 0.2 % of the frequencies and 0.01 of
the shapes at unit length. A pendulum is searched for at each of the nodes in each of three
directions: in models of each size, and in the middle one also at fewer nodes.

For each search: wall and CPU time; hypotheses that were sampled; full solutions of the first
basis; the peak of memory, of this process and of its largest worker; and the rank of the true
place. Writes runs/results/search_scaling.png.
"""

import argparse
import resource
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

import bayes_ssi as bs
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.plots.figure_style import BLUE, VERMILION, style

WIDTH, DEPTH, HEIGHT, WALL = 6.0, 4.5, 60.0, 0.3
YOUNG, POISSON, DENSITY = 30e9, 0.2, 2500.0
ACROSS = 5  # elements on each side of the section
LEVELS = (16, 104, 1042)  # elements over the height
N_PLACES, N_MODES = 500, 6
FEWER = (50, 150)
TRUTH = (0.95, 1.1, 1.0, 0.9)
FREQUENCY_COV, SHAPE_SD = 0.002, 0.01
DIRECTIONS = "xyz"
RESONANT, MASS_RATIO = 3, 0.02
BAND_HZ = (0.0, 10.0)


class Tower(NamedTuple):
    """The finite-element model, and the coordinates (n, 3) of its free nodes, from the ground up.

    Degrees of freedom are labelled by node and direction, as in ``"12 x"``.
    """

    structure: bs.MatrixStructure
    nodes: np.ndarray


def tower(levels: int, moduli: Sequence[Value], n_modes: int) -> Tower:
    """The tower; ``moduli`` multiply Young's modulus in each of the quarters, from the lowest."""
    from skfem import Basis, BilinearForm, ElementHex1, ElementVector, MeshHex, asm
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    x, y = (
        np.array([0.0, *np.linspace(WALL, side - WALL, ACROSS - 1), side])
        for side in (WIDTH, DEPTH)
    )
    block = MeshHex.init_tensor(x, y, np.linspace(0.0, HEIGHT, levels + 1))
    centre = block.p[:, block.t].mean(axis=1)
    hollow = (np.abs(centre[0] - WIDTH / 2) < WIDTH / 2 - WALL) & (
        np.abs(centre[1] - DEPTH / 2) < DEPTH / 2 - WALL
    )
    mesh = block.restrict(np.flatnonzero(~hollow))
    part = (mesh.p[2, mesh.t].mean(axis=0) / HEIGHT * len(moduli)).astype(int)

    @BilinearForm
    def inertia(u, v, _):
        return DENSITY * dot(u, v)

    element = ElementVector(ElementHex1())
    elastic = linear_elasticity(*lame_parameters(YOUNG, POISSON))
    whole = Basis(mesh, element, intorder=2)
    nodes = np.lexsort(mesh.p)  # from the ground up
    nodes = nodes[mesh.p[2, nodes] > 0.0]
    free = whole.nodal_dofs[:, nodes].T.ravel()
    parts = [
        asm(elastic, Basis(mesh, element, elements=np.flatnonzero(part == i), intorder=2))
        for i in range(len(moduli))
    ]
    labels = [f"{i} {axis}" for i in range(len(nodes)) for axis in DIRECTIONS]
    points = mesh.p[:, nodes].T
    structure = bs.MatrixStructure(
        [(modulus, k[free][:, free]) for modulus, k in zip(moduli, parts, strict=True)],
        asm(inertia, whole)[free][:, free],
        labels=labels,
        sensors=sensors(points),
        n_modes=n_modes,
    )
    return Tower(structure, points)


def sensors(points: np.ndarray) -> list[str]:
    """At three heights, x and y at one corner, and y at the opposite one."""
    chosen = []
    for height in (HEIGHT / 3, 2 * HEIGHT / 3, HEIGHT):
        for corner, axes in (((0.0, 0.0), "xy"), ((WIDTH, DEPTH), "y")):
            nearest = np.linalg.norm(points - (*corner, height), axis=1).argmin()
            chosen += [f"{nearest} {axis}" for axis in axes]
    return chosen


class Tank(NamedTuple):
    """A pendulum at a place, with its mass in kg."""

    place: str
    mass: float
    frequency_hz: float


def tank(full: bs.MatrixStructure, labels: list[str], rng: np.random.Generator) -> Tank:
    """One in resonance with a mode, at one of the degrees of freedom that move in it."""
    modes = full.full_modes(np.array(TRUTH))
    shape = np.abs(modes.vectors[full.system.rows, RESONANT - 1])  # at unit modal mass
    moves = {label: shape[row] for label in labels for row, _ in full.rows_of(label, "tank")}
    largest = max(moves[label] for label in labels)
    place = rng.choice([label for label in labels if moves[label] > 0.5 * largest])
    frequency = float(np.sqrt(modes.eigenvalues[RESONANT - 1]) / (2.0 * np.pi))
    return Tank(str(place), float(MASS_RATIO / moves[place] ** 2), frequency)


def simulated(
    carrying: bs.MatrixStructure, names: Sequence[str], rng: np.random.Generator
) -> bs.ModalData:
    """The identified modes of a tower with a tank."""
    modes = carrying.modes(np.array([TRUTH]))
    shapes = carrying.sensor_matrix(names).apply(modes.shapes)[0]
    identified = []
    for frequency, shape in zip(modes.frequencies_hz[0], shapes.T, strict=True):
        if frequency < BAND_HZ[1]:
            identified.append(
                bs.IdentifiedMode(
                    str(len(identified) + 1),
                    float(frequency * (1.0 + FREQUENCY_COV * rng.standard_normal())),
                    shape / np.linalg.norm(shape) + SHAPE_SD * rng.standard_normal(len(shape)),
                )
            )
    return bs.ModalData(tuple(identified), BAND_HZ, tuple(names))


class Searched(NamedTuple):
    """What one search took: degrees of freedom, number of places, and seconds of CPU time."""

    size: int
    n_places: int
    seconds: float


def searched(levels: int, n_places: int, workers: int) -> Searched:
    moduli = [bs.Parameter(f"E{i}", bs.LogNormal(1.0, 0.1)) for i in range(1, len(TRUTH) + 1)]
    full, nodes = tower(levels, moduli, N_MODES)
    rng = np.random.default_rng(0)
    at = np.linspace(0, len(nodes) - 1, n_places).round().astype(int)
    labels = [f"{node} {axis}" for node in at for axis in DIRECTIONS]
    hidden = tank(full, labels, rng)
    carrying = full.with_element(bs.Pendulum(hidden.place, hidden.mass, hidden.frequency_hz))
    data = simulated(carrying, full.degrees_of_freedom, rng)
    error = bs.ErrorModel(FREQUENCY_COV, SHAPE_SD)
    baseline = bs.ModelClass("tower", full.reduced(), data, error, pairing="any")
    candidates = [bs.Candidate(label, label) for label in labels]
    settings = bs.SearchSettings(number_weights=(1.0, 1.0))
    begun, cpu_begun = perf_counter(), cpu_seconds()
    result = bs.search(baseline, settings, run=bs.Run(workers), candidates=candidates)
    seconds, cpu = perf_counter() - begun, cpu_seconds() - cpu_begun

    record, sampled = result.record, result.ranking.posteriors
    places = record.places_by_probability
    names = [each.place.candidate.name for each in places]
    rank = names.index(hidden.place)
    memory = [gigabytes(each) for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    print(
        f"{full.size} degrees of freedom, {n_places} places in three directions, "
        f"{len(data.modes)} identified modes: {seconds:.0f} s, {cpu:.0f} s of CPU time; "
        f"{len(sampled)} of {len(record.hypotheses)} hypotheses sampled; "
        f"{baseline.structure.n_full_solutions} full solutions for the basis over the prior; "
        f"{memory[0]:.1f} GB, {memory[1]:.1f} GB in a worker\n"
        f"  an appendage {record.probability_of_any:.4f}; true place "
        f"{located(hidden.place, nodes)} ranks {rank + 1} with {places[rank].probability:.3f}; "
        f"first is {located(names[0], nodes)} with {places[0].probability:.3f}",
        flush=True,
    )
    for check in result.ranking.comparison.failed_checks:
        print(f"  (!) {check}")
    return Searched(full.size, n_places, cpu)


def located(label: str, nodes: np.ndarray) -> str:
    """A degree of freedom by the coordinates of its node and its direction."""
    node, axis = label.split()
    return f"{axis} at ({', '.join(f'{each:.1f}' for each in nodes[int(node)])}) m"


def cpu_seconds() -> float:
    """CPU time of this process, and of its workers that have ended."""
    usages = (resource.getrusage(each) for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def gigabytes(whose: int) -> float:
    """The peak of memory of this process, or of the largest of its workers that have ended."""
    return resource.getrusage(whose).ru_maxrss / 1e6


def draw(by_size: list[Searched], by_places: list[Searched], path: Path) -> None:
    import matplotlib.pyplot as plt

    with style():
        figure, axes = plt.subplots(1, 2, figsize=(7.5, 3.4), sharey=True)
        for ax, rows, x, colour, label in (
            (axes[0], by_size, "size", VERMILION, "degrees of freedom"),
            (axes[1], by_places, "n_places", BLUE, "places, in three directions each"),
        ):
            at = [getattr(row, x) for row in rows]
            ax.loglog(at, [row.seconds for row in rows], "o-", color=colour)
            for place, row in zip(at, rows, strict=True):
                ax.annotate(f"{row.seconds:.0f} s", (place, row.seconds), (4, -8),
                            textcoords="offset points", va="top")  # fmt: skip
            ax.set_xticks(at, [f"{each:,}" for each in at], minor=False)
            ax.set_xticks([], minor=True)
            ax.set_yticks([30, 100, 300], ["30", "100", "300"])
            ax.set_yticks([], minor=True)
            ax.set_xlabel(label)
            ax.margins(0.2)
        axes[0].set_ylabel("CPU time of the search (s)")
        axes[0].set_title(f"{by_size[0].n_places} places")
        axes[1].set_title(f"{by_places[0].size} degrees of freedom")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)
    print(f"drawn in {path}")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--levels", type=int, nargs="+", default=LEVELS)
    arguments.add_argument("--workers", type=int, default=2)
    given = arguments.parse_args()
    by_size = [searched(levels, N_PLACES, given.workers) for levels in given.levels]
    middle = given.levels[len(given.levels) // 2]
    fewer = [searched(middle, n, given.workers) for n in FEWER]
    of_middle = by_size[len(by_size) // 2]
    draw(by_size, [*fewer, of_middle], Path("runs") / "results" / "search_scaling.png")


if __name__ == "__main__":
    main()
