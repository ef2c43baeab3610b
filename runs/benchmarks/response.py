"""Accuracy of transfer functions, and cost of time histories relative to filtering arrays.

    python runs/benchmarks/response.py

First the largest relative difference between transfer functions by modes and those that solve
(K + iωC - ω²M) u = -Mι at every frequency, for the cases of section 2, correct and as masses only.

Then the building of Case (c), three storeys and an infill that vibrates, for 500 draws of its
parameters under a record of 18,000 samples: the time of ``time_histories`` divided by that of one
call of ``scipy.signal.lfilter``, of second order, for each history that it returns. A draw takes
four such calls, one for each mode, for all its places.
"""

import math
import runpy
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.signal import lfilter

import bayes_ssi as bs
from bayes_ssi.structures.response import GroundMotion, Output, time_histories, transfer_functions

DRAWS, SAMPLES, REPEATS = 500, 18_000, 7
STIFFNESS = (math.pi / math.sin(math.pi / 14)) ** 2
CASES = Path(__file__).parents[2] / "model_classes" / "non_structural_elements.py"
FLOORS = ("floor 1", "floor 2", "floor 3")


def largest_difference() -> float:
    """Largest relative difference, all displacements and absolute accelerations, 0.05 to 7 Hz."""
    cases = runpy.run_path(str(CASES))
    frequencies, no_values = np.linspace(0.05, 7.0, 700), np.empty((1, 0))
    worst = 0.0
    for building in (*cases["correct"].values(), *cases["incorrect"].values()):
        stiffness, diagonal = (part[0] for part in building.matrices(no_values))
        mass = np.diag(diagonal)
        frequencies_hz, shapes = (part[0] for part in building.modes(no_values))
        modal = np.diag(2.0 * cases["DAMPING"] * 2.0 * np.pi * frequencies_hz)
        damping = mass @ shapes @ modal @ shapes.T @ mass
        omega = 2.0 * np.pi * frequencies[:, None, None]
        dynamic = stiffness + 1j * omega * damping - omega**2 * mass
        displacement = np.linalg.solve(dynamic, -diagonal[:, None])[:, :, 0].T
        acceleration = 1.0 - omega[:, 0, 0] ** 2 * displacement
        for quantity, exact in (("displacement", displacement), ("acceleration", acceleration)):
            output = Output(quantity, building.degrees_of_freedom)
            ours = transfer_functions(building, no_values, frequencies, output, cases["DAMPING"])
            worst = max(worst, float(np.abs(ours[0] / exact - 1.0).max()))
    return worst


def structure() -> bs.ShearBuilding:
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(4)]
    frame = bs.ShearBuilding((1.0, 1.0, 1.0), [STIFFNESS * k for k in factors[:3]])
    return frame.with_element(
        bs.OutOfPlaneInfill((1, 2), 0.15, 2.8019, stiffness_factor=factors[3], label="infill")
    )


def main() -> None:
    print(f"transfer functions: largest relative difference {largest_difference():.1e}")
    rng = np.random.default_rng(0)
    building = structure()
    values = np.exp(0.1 * rng.standard_normal((DRAWS, 4)))
    motion = GroundMotion(rng.standard_normal(SAMPLES), 0.005)
    numerator, denominator = [0.1, 0.2, 0.1], [1.0, -1.9, 0.95]
    for places in (("floor 3",), FLOORS, building.degrees_of_freedom):
        output = Output("acceleration", places)
        ratios = []
        for _ in range(REPEATS):
            begun = perf_counter()
            histories = time_histories(building, values, motion, output, 0.02)
            middle = perf_counter()
            for _ in range(histories.shape[0] * histories.shape[1]):
                lfilter(numerator, denominator, motion.acceleration)
            ratios.append((middle - begun) / (perf_counter() - middle))
        print(
            f"{DRAWS} draws x {len(places)} place(s) x {SAMPLES} samples: {np.median(ratios):.2f} "
            "times one lfilter call a history"
        )


if __name__ == "__main__":
    main()
