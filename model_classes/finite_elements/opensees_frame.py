"""A steel portal frame of two storeys, computed by OpenSees: a script behind a model class.

    pip install -e ".[opensees]"
    bayes-ssi rank model_classes/finite_elements/opensees_frame.py --workers 2

The function below is an ordinary script of OpenSeesPy with its numbers as arguments; it returns
frequencies and shapes. (On Linux openseespy needs the system's libblas and liblapack.) The modes
are simulated, at factors 0.85 of the columns' and 1.2 of the beams' stiffness, with errors of
0.5 % in the frequencies and 0.02 per component in the shapes.

Is one factor enough for columns and beams, or do they differ?
"""

import math
from pathlib import Path

import openseespy.opensees as ops

import bayes_ssi as bs

SPAN, HEIGHTS = 6.0, (0.0, 4.0, 7.5)  # m
YOUNG = 210e9  # N/m²
COLUMN, BEAM = (7.8e-3, 5.7e-5), (5.4e-3, 8.4e-5)  # area in m² and moment of inertia in m⁴
FLOOR_MASS = 12_000.0  # kg
N_MODES = 3


def frame(column_factor, beam_factor):
    """Frequencies (Hz) and horizontal shapes at the two floors."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for level, height in enumerate(HEIGHTS):
        for side in (0, 1):
            ops.node(10 * level + side, side * SPAN, height)
            if level:
                ops.mass(10 * level + side, FLOOR_MASS / 2, FLOOR_MASS / 2, 1.0)
    ops.fix(0, 1, 1, 1)
    ops.fix(1, 1, 1, 1)
    ops.geomTransf("Linear", 1)
    tag = 0
    for level in (1, 2):
        for side in (0, 1):
            tag += 1
            ends = (10 * (level - 1) + side, 10 * level + side)
            ops.element("elasticBeamColumn", tag, *ends, COLUMN[0], column_factor * YOUNG,
                        COLUMN[1], 1)  # fmt: skip
        tag += 1
        ends = (10 * level, 10 * level + 1)
        ops.element("elasticBeamColumn", tag, *ends, BEAM[0], beam_factor * YOUNG, BEAM[1], 1)
    eigenvalues = ops.eigen(N_MODES)
    shapes = [[ops.nodeEigenvector(10 * level, mode, 1) for mode in range(1, N_MODES + 1)]
              for level in (1, 2)]  # fmt: skip
    return [math.sqrt(value) / (2.0 * math.pi) for value in eigenvalues], shapes


def structure(columns, beams):
    return bs.FunctionStructure(
        frame,
        arguments={"column_factor": columns, "beam_factor": beams},
        sensors=("floor 1", "floor 2"),
        n_modes=N_MODES,
    )


prior = bs.LogNormal(median=1.0, cov=0.3)
both, columns, beams = (bs.Parameter(name, prior) for name in ("both", "columns", "beams"))
modes = bs.read_modal_data(Path(__file__).parents[1] / "data" / "opensees_frame.csv")
error = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.02)

study = bs.Study(
    "Portal frame by OpenSees",
    [
        bs.ModelClass("one factor", structure(both, both), modes, error, pairing={"1": 1, "2": 2}),
        bs.ModelClass(
            "columns and beams", structure(columns, beams), modes, error, pairing={"1": 1, "2": 2}
        ),
    ],
)
