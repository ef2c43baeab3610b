"""The numerical study without knowledge of the appendage: the bare frame and four modes.

The identified modes are those of shear_building.py, made with a resonant infill between floors 1
and 2, half of which, a mass of 0.075, vibrates. The only model class here has no infill at all and
assumes no pairing; it is the baseline of

    bayes-ssi search model_classes/bare_building.py
"""

import math
from pathlib import Path

import bayes_ssi as bs

# Unit masses and a first frequency of 1 Hz, as in shear_building.py.
STIFFNESS = (math.pi / math.sin(math.pi / 14)) ** 2
DATA = Path(__file__).parent / "data" / "case_c.csv"

k1, k2, k3 = (bs.Parameter(name, bs.LogNormal(median=1.0, cov=0.3)) for name in ("k1", "k2", "k3"))
frame = bs.ShearBuilding(
    masses=(1.0, 1.0, 1.0), stiffnesses=(STIFFNESS * k1, STIFFNESS * k2, STIFFNESS * k3)
)

study = bs.Study(
    "Bare shear building",
    [
        bs.ModelClass(
            "bare frame",
            frame,
            bs.read_modal_data(DATA),
            bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05),
            pairing="any",
            description="three storeys, nothing on them",
        )
    ],
    description="Does an appendage hide in the modes of Case (c)?",
)
