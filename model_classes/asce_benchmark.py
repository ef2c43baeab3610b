"""The IASC-ASCE benchmark structure: what changed between two tests? Its modes are SIMULATED.

A steel frame of four storeys, 2.5 m by 2.5 m in plan, at a third of full scale (Johnson, Lam,
Katafygiotis and Beck 2004). Rigid floors move in x and y and turn. Each storey has four faces, s
and n in x, e and w in y, with two braces and three columns each, and middle columns, which are
known and hardly resist torsion. The stiffnesses of the 16 faces are inferred: where one loses a
brace, floors turn as they move. All together they are the published 106.601 and 67.904 MN/m and
232.022 MN m of a storey in x, y and torsion.

`tests/benchmarks/make_asce_benchmark.py` simulated the tests: of the undamaged structure, of the
same again ("none"), and of it without some braces. In pattern 1 those of storey 1 are gone (55 % of
its faces in x, 79 % in y), in pattern 2 those of storeys 1 and 3; in pattern 3 one brace of storey
1 (39 % of face e1), in pattern 4 another one of storey 3, too (28 % of s3); in pattern 6 a third of
one brace of storey 1 (13 % of e1).

    bayes-ssi changes model_classes/asce_benchmark.py --from undamaged --to "pattern 4"
    bayes-ssi changes model_classes/asce_benchmark.py --from undamaged --to "pattern 1" \
        --place "storey 1=s1,n1,e1,w1" --place "storey 2=s2,n2,e2,w2" \
        --place "storey 3=s3,n3,e3,w3" --place "storey 4=s4,n4,e4,w4"
"""

from pathlib import Path

import bayes_ssi as bs

DATA = Path(__file__).parent / "data"
TESTS = ("undamaged", "none", "pattern 1", "pattern 2", "pattern 3", "pattern 4", "pattern 6")
MASSES = (3452.4, 2652.4, 2652.4, 1809.9)  # kg
INERTIAS = (3819.4, 2986.1, 2986.1, 2056.9)  # kg m²
# Stiffnesses of a storey's two faces in x, of those in y, and of its middle columns, N/m.
FACE_X, FACE_Y, MIDDLE_X, MIDDLE_Y = 43.571e6, 30.672e6, 19.458e6, 6.559e6
MIDDLE_TORSION = 0.010e6  # N m
HALF_WIDTH = 1.25  # m
# Faces and their sensors: where they are, and the direction in which they stand and measure.
FACES = {"s": ((0, -1), "x"), "n": ((0, 1), "x"), "e": ((1, 0), "y"), "w": ((-1, 0), "y")}

prior = bs.LogNormal(median=1.0, cov=0.1)
# The middle columns; in torsion, what faces leave of the published stiffness.
frame = bs.ShearBuilding3D(
    masses=MASSES,
    radii_of_gyration=[(own / mass) ** 0.5 for own, mass in zip(INERTIAS, MASSES, strict=True)],
    stiffnesses_x=[MIDDLE_X] * 4,
    stiffnesses_y=[MIDDLE_Y] * 4,
    torsional_stiffnesses=[MIDDLE_TORSION] * 4,
).with_sensors(
    bs.floor_sensor(f"{floor}{face}", floor, (x * HALF_WIDTH, y * HALF_WIDTH), way)
    for floor in range(1, 5)
    for face, ((x, y), way) in FACES.items()
)
for storey in range(1, 5):
    for face, (_, way) in FACES.items():
        name = f"{face}{storey}"
        frame = frame.with_element(
            bs.InPlaneInfill(
                between=(f"{storey - 1}{face}" if storey > 1 else 0, f"{storey}{face}"),
                mass=1e-3,  # kg: a face needs some, and floors have all
                stiffness=(FACE_X if way == "x" else FACE_Y) * bs.Parameter(name, prior),
                label=f"face {name}",
            )
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
