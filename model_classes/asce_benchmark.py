"""The IASC-ASCE benchmark structure: what changed between two tests? Its modes are SIMULATED.

A steel frame of four storeys, 2.5 m by 2.5 m in plan, at a third of full scale (Johnson, Lam,
Katafygiotis and Beck 2004). The model has 12 degrees of freedom: rigid floors that move in x and y
and turn, on storeys with a stiffness in each. Their eccentricity is left out: where a brace is
removed from one face, floors turn as they move, which this model does not.

`runs/make_asce_benchmark.py` simulated the tests: of the undamaged structure, of the same again
("none"), and of it without some braces. In pattern 1 those of storey 1 are gone, in pattern 2 those
of storeys 1 and 3; in pattern 3 one brace of storey 1, in pattern 4 another one of storey 3, too;
in pattern 6 a third of one brace of storey 1.

    bayes-ssi changes model_classes/asce_benchmark.py --from undamaged --to "pattern 1" \
        --place "storey 1=x1,y1,t1" --place "storey 2=x2,y2,t2" \
        --place "storey 3=x3,y3,t3" --place "storey 4=x4,y4,t4"
"""

from pathlib import Path

import bayes_ssi as bs

DATA = Path(__file__).parent / "data"
TESTS = ("undamaged", "none", "pattern 1", "pattern 2", "pattern 3", "pattern 4", "pattern 6")
MASSES = (3452.4, 2652.4, 2652.4, 1809.9)  # kg
INERTIAS = (3819.4, 2986.1, 2986.1, 2056.9)  # kg m²
X, Y, TORSION = 106.601e6, 67.904e6, 232.022e6  # of a storey: N/m, N/m, N m
HALF_WIDTH = 1.25  # m
# Where a floor's four sensors are, and what they measure: s and n in x, e and w in y.
SENSORS = {"s": ((0, -1), "x"), "n": ((0, 1), "x"), "e": ((1, 0), "y"), "w": ((-1, 0), "y")}

prior = bs.LogNormal(median=1.0, cov=0.1)
frame = bs.ShearBuilding3D(
    masses=MASSES,
    radii_of_gyration=[(own / mass) ** 0.5 for own, mass in zip(INERTIAS, MASSES, strict=True)],
    stiffnesses_x=[X * bs.Parameter(f"x{storey}", prior) for storey in range(1, 5)],
    stiffnesses_y=[Y * bs.Parameter(f"y{storey}", prior) for storey in range(1, 5)],
    torsional_stiffnesses=[TORSION * bs.Parameter(f"t{storey}", prior) for storey in range(1, 5)],
).with_sensors(
    bs.floor_sensor(f"{floor}{name}", floor, (x * HALF_WIDTH, y * HALF_WIDTH), way)
    for floor in range(1, 5)
    for name, ((x, y), way) in SENSORS.items()
)


def test(name):
    """One test: the modes in the order of their frequencies are the model's."""
    modes = bs.read_modal_data(DATA / f"asce_{name.replace(' ', '_')}.csv")
    pairing = {label: i for i, label in enumerate(modes.labels, 1)}
    return bs.Configuration(name, frame, modes, pairing=pairing)


study = bs.Study(
    "IASC-ASCE benchmark",
    [bs.ModelClass("12 degrees of freedom", configurations=[test(name) for name in TESTS])],
    description="What changed between two tests?",
    mass_unit="kg",
)
