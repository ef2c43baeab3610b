"""Make model_classes/data/case_c.csv: the modes of Case (c), without noise.

    python runs/make_case_c.py [FILE]

The correct model's four modes at the true parameters, at the three floors (no sensor on the
infill), in the band from 0 to 6 Hz. Writes FILE, which must not exist.
"""

import math
import sys
from pathlib import Path

import numpy as np

import bayes_ssi as bs

N_STOREYS = 3
STIFFNESS = (math.pi / math.sin(math.pi / (2 * (2 * N_STOREYS + 1)))) ** 2
SECOND_FREQUENCY = math.sin(3 * math.pi / 14) / math.sin(math.pi / 14)


def main() -> None:
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("model_classes/data/case_c.csv")
    infill = bs.OutOfPlaneInfill(between=(1, 2), mass=0.05 * N_STOREYS, frequency=SECOND_FREQUENCY)
    frame = bs.ShearBuilding(masses=(1.0,) * N_STOREYS, stiffnesses=(STIFFNESS,) * N_STOREYS)
    frequencies_hz, shapes = frame.with_element(infill).modes(np.empty((1, 0)))
    floors = [f"floor {i}" for i in range(1, N_STOREYS + 1)]
    at_floors = shapes[0, :N_STOREYS] / np.linalg.norm(shapes[0, :N_STOREYS], axis=0)
    at_floors *= np.sign(at_floors[-1])
    modes = [
        bs.IdentifiedMode(label, float(frequencies_hz[0, i]), at_floors[:, i])
        for i, label in enumerate(["1", "2a", "2b", "3"])
    ]
    source = "simulated: shear building with a resonant infill, Case (c), no noise"
    bs.write_modal_data(bs.ModalData(tuple(modes), (0.0, 6.0), tuple(floors), source), path)
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
