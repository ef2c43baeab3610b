"""A real four-storey laboratory shear frame, measured at every floor.

Floors of 12.060 lb, nominal storey stiffness 10 lb/in; identified modes as distributed with the
SMU structural-model-updating package (Dong and Wang). The question: does one stiffness factor
for all storeys explain the test, or does each storey need its own, and how large are the errors?
"""

from pathlib import Path

import bayes_ssi as bs

N_STOREYS = 4
FLOOR_MASS = 12.060 / 386.088  # lb weight / (in/s²) = lb s²/in
NOMINAL_STIFFNESS = 10.0  # lb/in
DATA = Path(__file__).parent / "data" / "four_storey_frame.csv"

prior = bs.LogNormal(median=1.0, cov=0.4)
k_all = bs.Parameter("k", prior)
k_each = [bs.Parameter(f"k{i}", prior) for i in range(1, N_STOREYS + 1)]

one_factor = bs.ShearBuilding(
    masses=[FLOOR_MASS] * N_STOREYS, stiffnesses=[NOMINAL_STIFFNESS * k_all] * N_STOREYS
)
factor_each = bs.ShearBuilding(
    masses=[FLOOR_MASS] * N_STOREYS, stiffnesses=[NOMINAL_STIFFNESS * k for k in k_each]
)

modes = bs.read_modal_data(DATA)
fixed = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
inferred = bs.ErrorModel()
pairing = {"1": 1, "2": 2, "3": 3, "4": 4}


def model_class(name, structure, error, description):
    return bs.ModelClass(name, structure, modes, error, pairing=pairing, description=description)


study = bs.Study(
    "Four-storey laboratory frame",
    [
        model_class("one factor", one_factor, fixed, "one stiffness factor for all storeys"),
        model_class(
            "one factor, free errors",
            one_factor,
            inferred,
            "one stiffness factor for all storeys, errors inferred",
        ),
        model_class("each storey", factor_each, fixed, "a stiffness factor for each storey"),
        model_class(
            "each storey, free errors",
            factor_each,
            inferred,
            "a stiffness factor for each storey, errors inferred",
        ),
    ],
    description="One stiffness factor for all storeys, or one each; errors given or inferred?",
)
