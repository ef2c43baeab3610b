"""The paper's numerical study: a shear building whose infill resonates with its second mode.

Three storeys of equal mass and stiffness, first frequency 1 Hz. An infill between floors 1 and 2,
5 % of the building's mass, vibrates out of its plane at the frequency of the second mode and
splits it into modes 2a and 2b (Case (c)). The four classes are the paper's approaches:

1-a  the infill as mass only, mode 2a taken for "the" second mode
1-b  the infill as mass only, mode 2b taken for it
2    the infill as mass only, the second mode left out
3    the infill with its own degree of freedom

The data are made by runs/make_case_c.py.
"""

import math
from pathlib import Path

import bayes_ssi as bs

N_STOREYS = 3
# f_j = (1/π) √(k/m) sin((2j - 1)π / (2(2N + 1))): unit masses and f_1 = 1 Hz.
STIFFNESS = (math.pi / math.sin(math.pi / (2 * (2 * N_STOREYS + 1)))) ** 2
SECOND_FREQUENCY = math.sin(3 * math.pi / 14) / math.sin(math.pi / 14)
DATA = Path(__file__).parent / "data" / "case_c.csv"

k1, k2, k3, ks = (
    bs.Parameter(name, bs.LogNormal(median=1.0, cov=0.3)) for name in ("k1", "k2", "k3", "ks")
)
frame = bs.ShearBuilding(
    masses=(1.0, 1.0, 1.0), stiffnesses=(STIFFNESS * k1, STIFFNESS * k2, STIFFNESS * k3)
)
infill = bs.OutOfPlaneInfill(
    between=(1, 2), mass=0.05 * N_STOREYS, frequency=SECOND_FREQUENCY, stiffness_factor=ks
)
rigid = frame.with_element(infill.as_mass())
augmented = frame.with_element(infill)

modes = bs.read_modal_data(DATA)
error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)

study = bs.Study(
    "Shear building with a resonant infill",
    [
        bs.ModelClass(
            "1-a",
            rigid,
            modes,
            error,
            pairing={"1": 1, "2a": 2, "3": 3},
            description="infill as mass; 2a is the second mode, 2b spurious",
        ),
        bs.ModelClass(
            "1-b",
            rigid,
            modes,
            error,
            pairing={"1": 1, "2b": 2, "3": 3},
            description="infill as mass; 2b is the second mode, 2a spurious",
        ),
        bs.ModelClass(
            "2",
            rigid,
            modes,
            error,
            pairing={"1": 1, "3": 3},
            description="infill as mass; 2a and 2b left out",
        ),
        bs.ModelClass(
            "3",
            augmented,
            modes,
            error,
            pairing={"1": 1, "2a": 2, "2b": 3, "3": 4},
            description="infill with its own degree of freedom",
        ),
    ],
    description="Which of the paper's four approaches do the modes of Case (c) support?",
)
