"""How often does a band that ends near a mode fail a check? A bridge, a tall building and a plate.

    python runs/benchmarks/band_edges.py [--sets 10] [--only KIND]

Each set: parameters and modes are drawn from one of two classes, with errors of the sizes that the
default model expects, in a band that ends at most 5 % from the first mode that may be missed. Both
classes are ranked. No check should fail because of where the band ends unless that changes the
answer; every statement about it is printed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from time import perf_counter

import beside_tests  # noqa: F401
import numpy as np
from simulated import simulate

import bayes_ssi as bs

SETTINGS = bs.SamplingSettings(log_evidence_error=0.05, economical=True)
BAND_MOVED = 0.05


def factors(names: Sequence[str]) -> list[bs.Parameter]:
    return [bs.Parameter(name, bs.LogNormal(1.0, 0.2)) for name in names]


def building(k: Sequence[bs.Parameter]) -> bs.Structure:
    """18 storeys, one factor for as many storeys each; sensors on every third floor."""
    stiffnesses = [6000.0 * k[i * len(k) // 18] for i in range(18)]
    return bs.ShearBuilding((1.0,) * 18, stiffnesses)


def bridge(k: Sequence[bs.Parameter]) -> bs.Structure:
    """A beam over spans of 30, 40 and 30 m, 10 elements each; one factor for each span, or one."""
    lengths = np.repeat([3.0, 4.0, 3.0], 10)
    n = len(lengths) + 1
    stiffness, mass = np.zeros((3, 2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for i, length in enumerate(lengths):
        unit = np.diag([1.0, length, 1.0, length])
        bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        inertia = np.array(
            [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
        )
        own = np.ix_(range(2 * i, 2 * i + 4), range(2 * i, 2 * i + 4))
        stiffness[i // 10][own] += 4e10 * unit @ bending @ unit / length**3
        mass[own] += 12e3 * length / 420.0 * unit @ inertia @ unit
    free = np.delete(np.arange(2 * n), [0, 20, 40, 60])  # deflections at the supports
    terms = [(k[i % len(k)], part[np.ix_(free, free)]) for i, part in enumerate(stiffness)]
    places = {name: int(np.flatnonzero(free == 2 * int(name.split()[1]))[0]) for name in NODES}
    return bs.MatrixStructure(terms, mass[np.ix_(free, free)], sensors=places, n_modes=9)


def plate(k: Sequence[bs.Parameter]) -> bs.Structure:
    """A simply supported plate of 3 by 2 m, in 36 sine waves; one factor for each half, or one."""
    a, b, rigidity, density, poisson = 3.0, 2.0, 2.2e3, 78.0, 0.3
    x, y = ((np.arange(40) + 0.5) * side / 40 for side in (a, b))
    # First as many as sensors, which they describe.
    first = [(m, n) for m in range(1, 5) for n in (1, 2)]
    waves = [*first, *(w for w in product(range(1, 7), repeat=2) if w not in first)]
    grids: list[list[np.ndarray]] = [[], [], [], []]
    for m, n in waves:
        p, q = m * np.pi / a, n * np.pi / b
        w = np.outer(np.sin(p * x), np.sin(q * y))
        twist = p * q * np.outer(np.cos(p * x), np.cos(q * y))
        for grid, values in zip(grids, (w, -p * p * w, -q * q * w, twist), strict=True):
            grid.append(values)
    w, xx, yy, xy = (np.array(grid) for grid in grids)
    cell = a * b / 1600
    halves = []
    for part in (slice(0, 20), slice(20, 40)):
        c = [each[:, part].reshape(36, -1) for each in (xx, yy, xy)]
        bent = c[0] @ c[0].T + c[1] @ c[1].T + poisson * (c[0] @ c[1].T + c[1] @ c[0].T)
        halves.append(rigidity * cell * (bent + 2.0 * (1.0 - poisson) * c[2] @ c[2].T))
    flat = w.reshape(36, -1)
    # The deflections at the sensors take the place of the first waves' amplitudes.
    rows = np.eye(36)
    at = [tuple(map(int, point.split())) for point in POINTS]
    rows[: len(POINTS)] = [w[:, i, j] for i, j in at]
    waves_of = np.linalg.inv(rows)

    def moved(matrix: np.ndarray) -> np.ndarray:
        return waves_of.T @ matrix @ waves_of

    terms = [(k[i % len(k)], moved(half)) for i, half in enumerate(halves)]
    places = {point: row for row, point in enumerate(POINTS)}
    return bs.MatrixStructure(
        terms, moved(density * cell * flat @ flat.T), sensors=places, n_modes=9
    )


FLOORS = [f"floor {floor}" for floor in range(3, 19, 3)]
NODES = [f"node {i}" for i in (3, 5, 8, 13, 15, 18, 25)]
POINTS = [f"{i} {j}" for i in (7, 15, 23, 33) for j in (11, 29)]
KINDS: dict[str, tuple[Callable[[Sequence[bs.Parameter]], bs.Structure], list[str], int, int]] = {
    # Structure, its sensors, its number of factors, and the number of modes in the band.
    "bridge": (bridge, NODES, 3, 6),
    "building": (building, FLOORS, 3, 5),
    "plate": (plate, POINTS, 2, 6),
}


def ranking(kind: str, seed: int) -> bs.Ranking:
    make, sensors, n_factors, n_modes = KINDS[kind]
    rng = np.random.default_rng([6, seed])
    several = make(factors([f"k{i + 1}" for i in range(n_factors)]))
    one = make(factors(["k"]))
    next_hz = float(several.modes(several.prior_medians()).frequencies_hz[0, n_modes])
    band = (0.0, next_hz * rng.uniform(1.0 - BAND_MOVED, 1.0 + BAND_MOVED))
    some = bs.IdentifiedMode("1", 0.5 * band[1], np.ones(len(sensors)))
    nothing = bs.ModalData((some,), band, tuple(sensors))
    classes = [
        bs.ModelClass(name, structure, nothing, pairing={"1": 1})
        for name, structure in (("several factors", several), ("one factor", one))
    ]
    _, data, pairing = simulate(classes[seed % 2], rng)
    own = [
        replace(each, configurations=[
            replace(each.configurations[0], data=data, pairing=pairing)
        ])
        for each in classes
    ]  # fmt: skip
    return bs.rank(bs.Study(kind, own), seed, SETTINGS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=10)
    parser.add_argument("--only", choices=KINDS, help="one kind of structure")
    options = parser.parse_args()
    for kind in KINDS if options.only is None else [options.only]:
        begun, failed, remarks = perf_counter(), 0, 0
        for seed in range(options.sets):
            comparison = ranking(kind, seed).comparison
            failed += bool(comparison.failed_checks)
            remarks += bool(comparison.remarks)
            for label, items in (
                ("failed", comparison.failed_checks),
                ("remark", comparison.remarks),
            ):
                for item in items:
                    print(f"  {kind} {seed}, {label}: {item}", flush=True)
        seconds = (perf_counter() - begun) / options.sets
        print(
            f"{kind}: {options.sets} sets, {failed} with a failed check, {remarks} with remarks, "
            f"{seconds:.0f} s each",
            flush=True,
        )


if __name__ == "__main__":
    main()
