"""Make the SIMULATED modes of model_classes/asce_benchmark.py.

    python tests/benchmarks/make_asce_benchmark.py [DIRECTORY]

The structure of the IASC-ASCE benchmark for structural health monitoring (Johnson, Lam,
Katafygiotis and Beck 2004), as its analytical model of 12 degrees of freedom: four floors that
move in x and y and turn. Every storey has nine columns and eight braces, two on each face. A brace
that is removed takes stiffness from its face, so that the floors then turn as they move in y.

    pattern 1: all braces of storey 1 are gone
    pattern 2: all braces of storeys 1 and 3
    pattern 3: one brace of storey 1, on a face in y
    pattern 4: the same, and one of storey 3, on a face in x
    pattern 6: a third of one brace of storey 1, on a face in y

A finer model has the same storeys on flexible beams, so that joints turn: columns lose stiffness
where beams give way, and its first frequencies in y, x and torsion are 8.588, 9.181 and 14.580 Hz,
those of the benchmark's model of 120 degrees of freedom.

Identified are the modes below 33 Hz, with errors of 0.3 % of frequencies and of 0.02 in every
component of a unit shape, at four sensors on each floor. Writes asce_undamaged.csv, asce_none.csv
(the undamaged structure again) and asce_pattern_1.csv to asce_pattern_6.csv to DIRECTORY; none may
exist.
"""

import sys
from functools import cache
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

import bayes_ssi as bs

MASSES = np.array([3452.4, 2652.4, 2652.4, 1809.9])  # kg
INERTIAS = np.array([3819.4, 2986.1, 2986.1, 2056.9])  # kg m²
STOREY = {"x": 106.601e6, "y": 67.904e6, "torsion": 232.022e6}  # N/m, N/m, N m
HALF_WIDTH, HEIGHT = 1.25, 0.9  # m
# All eight braces are 45.24 % of a storey's stiffness in x.
BRACE = 0.4524 * STOREY["x"] / 4.0
COLUMNS = {
    "x": STOREY["x"] - 4.0 * BRACE,
    "y": STOREY["y"] - 4.0 * BRACE,
    "torsion": STOREY["torsion"] - 8.0 * BRACE * HALF_WIDTH**2,
}
FINER_HZ = {"x": 9.181, "y": 8.588, "torsion": 14.580}
# Motion of a floor's centre (x, y, torsion) → that of its faces, with two braces each.
FACES = np.array(
    [(1.0, 0.0, HALF_WIDTH), (1.0, 0.0, -HALF_WIDTH), (0.0, 1.0, HALF_WIDTH),
     (0.0, 1.0, -HALF_WIDTH)]
)  # fmt: skip
# Of two braces and three of the nine columns.
FACE_STIFFNESSES = np.array([2.0 * BRACE + COLUMNS[way] / 3.0 for way in "xxyy"])
# Storey and face, from 0 → what is left of its two braces.
PATTERNS = {
    "none": {},
    "pattern 1": {(0, face): 0.0 for face in range(4)},
    "pattern 2": {(storey, face): 0.0 for storey in (0, 2) for face in range(4)},
    "pattern 3": {(0, 2): 0.5},
    "pattern 4": {(0, 2): 0.5, (2, 0): 0.5},
    "pattern 6": {(0, 2): 1.0 - 1.0 / 6.0},
}
SENSORS = tuple(f"{floor}{face}" for floor in range(1, 5) for face in "snew")
FREQUENCY_ERROR, SHAPE_ERROR = 0.003, 0.02
BAND_HZ = (0.0, 33.0)
SEED = 2004


def storeys(stiffnesses):
    """The matrix (4, 4) of storeys in a row, in which nothing but floors moves."""
    drifts = np.eye(4) - np.eye(4, k=-1)
    return drifts.T @ np.diag(stiffnesses) @ drifts


def on_flexible_beams(stiffness, rotational):
    """The matrix (4, 4) of columns with this sway stiffness where beams hold their joints so."""
    bending, h = stiffness * HEIGHT**3 / 12.0, HEIGHT
    element = bending / h**3 * np.array(
        [[12.0, 6.0 * h, -12.0, 6.0 * h], [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
         [-12.0, -6.0 * h, 12.0, -6.0 * h], [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2]]
    )  # fmt: skip
    whole = np.zeros((10, 10))  # sway of the ground and four floors, then rotations
    for storey in range(4):
        at = [storey, 5 + storey, storey + 1, 6 + storey]
        whole[np.ix_(at, at)] += element
    free = whole[np.ix_([*range(1, 5), *range(6, 10)], [*range(1, 5), *range(6, 10)])]
    sway, coupling, rotation = free[:4, :4], free[:4, 4:], free[4:, 4:]
    return sway - coupling @ np.linalg.solve(rotation + rotational * np.eye(4), coupling.T)


@cache
def columns(finer=False):
    """The matrices (4, 4) of the columns in x, y and torsion."""
    if not finer:
        return {way: storeys([each] * 4) for way, each in COLUMNS.items()}
    found = {}
    for way, stiffness in COLUMNS.items():
        inertia = INERTIAS if way == "torsion" else MASSES
        braces = storeys([STOREY[way] - stiffness] * 4)

        def excess(rotational, way=way, stiffness=stiffness, inertia=inertia, braces=braces):
            matrix = on_flexible_beams(stiffness, rotational) + braces
            lowest = eigh(matrix, np.diag(inertia), eigvals_only=True)[0]
            return np.sqrt(lowest) / (2.0 * np.pi) - FINER_HZ[way]

        found[way] = on_flexible_beams(stiffness, brentq(excess, 1e3, 1e10))
    return found


def modes(left=None, finer=False, whole=None):
    """Frequencies (12,) in Hz, and shapes (12, 12) in x, y and torsion of every floor.

    ``left`` (4, 4) is what is left of the braces, by storey and face; ``whole`` (4,) of all
    stiffness of the storeys, one number for all of them in the finer model.
    """
    left = np.ones((4, 4)) if left is None else left
    whole = np.ones(4) if whole is None else whole
    stiffness = np.zeros((12, 12))
    if finer and np.ptp(whole) > 0.0:
        raise ValueError("the finer model's storeys can lose stiffness together alone")
    for i, (way, each) in enumerate(columns(finer).items()):
        stiffness[i::3, i::3] = whole[0] * each if finer else storeys(COLUMNS[way] * whole)
    for face, motion in enumerate(FACES):
        stiffness += np.kron(storeys(2.0 * BRACE * left[:, face] * whole), np.outer(motion, motion))
    squares, shapes = eigh(stiffness, np.diag(np.column_stack([MASSES, MASSES, INERTIAS]).ravel()))
    return np.sqrt(squares) / (2.0 * np.pi), shapes


def braces_left(pattern):
    """What is left of the braces (4, 4), by storey and face."""
    left = np.ones((4, 4))
    for at, share in PATTERNS[pattern].items():
        left[at] = share
    return left


def of_storeys(left):
    """The shares that storeys lose in x, y and torsion: direction and storey → its loss."""
    lost = 2.0 * BRACE * (1.0 - left)
    losses = {"x": lost[:, :2].sum(1), "y": lost[:, 2:].sum(1),
              "torsion": lost.sum(1) * HALF_WIDTH**2}  # fmt: skip
    return {(way, i + 1): float(losses[way][i] / STOREY[way]) for i in range(4) for way in losses}


def of_faces(left):
    """The shares that faces lose of the stiffness of their braces and columns: face → its loss."""
    lost = 2.0 * BRACE * (1.0 - left) / FACE_STIFFNESSES
    return {f"{face}{i + 1}": float(lost[i, j]) for i in range(4) for j, face in enumerate("snew")}


def simulated(left, rng, finer=False, source="", whole=None):
    """The modes that a test would identify, and which of the structure's they are.

    They are labelled by their direction and number in it; the second is label → number of the mode.
    """
    frequencies_hz, shapes = modes(left, finer, whole)
    energies = np.column_stack([MASSES, MASSES, INERTIAS]).ravel()[:, None] * shapes**2
    ways = np.array([energies[i::3].sum(axis=0) for i in range(3)]).argmax(axis=0)
    at_sensors = np.kron(np.eye(4), FACES) @ shapes
    identified, pairing, numbers = [], {}, dict.fromkeys("xyt", 0)
    for i, (frequency_hz, way) in enumerate(zip(frequencies_hz, ways, strict=True)):
        shape = at_sensors[:, i]
        numbers["xyt"[way]] += 1
        measured_hz = frequency_hz * (1.0 + FREQUENCY_ERROR * rng.standard_normal())
        error = SHAPE_ERROR * rng.standard_normal(len(shape))
        if measured_hz < BAND_HZ[1]:
            unit = shape / np.linalg.norm(shape) * np.sign(shape[np.abs(shape).argmax()])
            label = f"{'xyt'[way]}{numbers['xyt'[way]]}"
            pairing[label] = i + 1
            identified.append(
                bs.IdentifiedMode(
                    label, round(float(measured_hz), 4), np.round(unit + error, 4),
                    frequency_cov=FREQUENCY_ERROR, shape_sd=SHAPE_ERROR,
                )
            )  # fmt: skip
    identified.sort(key=lambda mode: mode.frequency_hz)
    return bs.ModalData(tuple(identified), BAND_HZ, SENSORS, source), pairing


def main():
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else "model_classes/data")
    for i, (name, pattern) in enumerate({"undamaged": "none", **{p: p for p in PATTERNS}}.items()):
        source = (
            f"SIMULATED: IASC-ASCE benchmark, 12 degrees of freedom, {name}, scatter "
            f"{FREQUENCY_ERROR:.1%} and {SHAPE_ERROR:g}, seed {SEED} {i}"
        )
        data, _ = simulated(braces_left(pattern), np.random.default_rng([SEED, i]), source=source)
        bs.write_modal_data(data, directory / f"asce_{name.replace(' ', '_')}.csv")


if __name__ == "__main__":
    main()
