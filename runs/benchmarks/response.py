"""Cost of time histories relative to filtering arrays of the same size.

    python runs/benchmarks/response.py

The building of Case (c), three storeys and an infill that vibrates, for 500 draws of its
parameters under a record of 18,000 samples: the time of ``time_histories`` divided by that of one
call of ``scipy.signal.lfilter``, of second order, for each history that it returns. Modal
superposition by filters takes four such calls a history, one for each mode.
"""

import math
from time import perf_counter

import numpy as np
from scipy.signal import lfilter

import bayes_ssi as bs
from bayes_ssi.ground_motion import GroundMotion
from bayes_ssi.response import Output, time_histories

DRAWS, SAMPLES, REPEATS = 500, 18_000, 7
STIFFNESS = (math.pi / math.sin(math.pi / 14)) ** 2
FLOORS = ("floor 1", "floor 2", "floor 3")


def structure() -> bs.ShearBuilding:
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(4)]
    frame = bs.ShearBuilding((1.0, 1.0, 1.0), [STIFFNESS * k for k in factors[:3]])
    return frame.with_element(
        bs.OutOfPlaneInfill((1, 2), 0.15, 2.8019, stiffness_factor=factors[3], label="infill")
    )


def main() -> None:
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
            found = time_histories(building, values, motion, output, 0.02)
            middle = perf_counter()
            for _ in range(found.shape[0] * found.shape[1]):
                lfilter(numerator, denominator, motion.acceleration)
            ratios.append((middle - begun) / (perf_counter() - middle))
        print(
            f"{DRAWS} draws x {len(places)} place(s) x {SAMPLES} samples: {np.median(ratios):.2f} "
            "times one lfilter call a history"
        )


if __name__ == "__main__":
    main()
