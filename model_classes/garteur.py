"""The GARTEUR SM-AG19 test bed: an aluminium aeroplane that twelve laboratories tested.

Wing span 2 m, 44 kg, hung on bungees. A viscoelastic tape under an aluminium strip, the
constraining layer, lies on the wing to damp it: a non-structural element. Does the strip act with
the wing, does it act in part, or is it mass only?

Dimensions and material: PetrKryslUCSD/pystran, tutorials on the GARTEUR air frame (2025), after
Gravelle (GARTEUR TP-115, 1999). Frequencies: participant C of Balmès and Wright (15th IMAC, 1997,
pp. 1346-1352). Shapes are published as pictures only, but they say which modes are symmetric. The
air frame is symmetric about its middle plane, so that the test is one configuration of the
symmetric modes and one of the others, of half of the model. Beams after Przemieniecki (1968), with
consistent mass. Millimetres, tonnes, newtons.
"""

import math
from itertools import pairwise

import numpy as np

import bayes_ssi as bs

YOUNG, POISSON, DENSITY, STEEL = 72000.0, 0.3, 2.7e-9, 7.85e-9
UP, FORWARD = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
# Of every section: size along the direction that is named, and across it.
SECTIONS = {
    "body": (150.0, 50.0, UP),
    "wing": (10.0, 100.0, UP),
    "layer": (1.0, 76.2, UP),
    "drum": (10.0, 100.0, UP),
    "fin": (100.0, 10.0, FORWARD),
    "tailplane": (10.0, 100.0, UP),
}
# The half at y >= 0, member by member: section and the joints along it.
LAYER_X, LAYER_Z = -50.0 + 76.2 / 2.0, 102.6
MEMBERS = [
    ("body", [(600, 0, 0), (0, 0, 0), (-290, 0, 0), (-850, 0, 0), (-900, 0, 0)]),
    ("wing", [(0, y, 96) for y in (0, 300, 600, 850, 950, 1000)]),
    ("layer", [(LAYER_X, y, LAYER_Z) for y in (0, 300, 600, 850)]),
    ("drum", [(200, 950, 106), (0, 950, 106), (-200, 950, 106)]),
    ("fin", [(-850, 0, 50), (-850, 0, 350)]),
    ("tailplane", [(-850, 0, 355), (-850, 200, 355)]),
]
# Joints that are screwed together, or glued, as stiff as 1 mm of the wing.
LINKS = {
    "wing and tail": [
        ((0, 0, 0), (0, 0, 96)),
        ((-850, 0, 0), (-850, 0, 50)),
        ((-850, 0, 350), (-850, 0, 355)),
    ],
    "glue": [((0, y, 96), (LAYER_X, y, LAYER_Z)) for y in (0, 300, 600, 850)]
    + [((0, 950, 96), (0, 950, 106))],
}
LINK = YOUNG * 1000.0 * np.diag([1.0, 1.0, 1.0, 100.0 / 12.0, 100.0 / 12.0, 100.0 / 12.0])
# Weights on the drums, the plate between wing and body, and the angles between fin and tailplane.
DRUM_MASS, PLATE, ANGLES = 2e-4, 16 * 70 * 130 * STEEL, 2 * 15 * 15 * 100 * STEEL
DRUM_AT, OF_DRUM, PLATE_AT, ANGLES_AT = (180, 920, 106), (200, 950, 106), (0, 0, 96), (-850, 0, 350)
# Two bungees hold 44 kg at 2.3 Hz; they hang at these joints.
BUNGEES, BUNGEE = ((0, 0, 0), (-290, 0, 0)), (2.0 * math.pi * 2.3) ** 2 * 0.044 / 2.0
JOINTS = list(dict.fromkeys(at for _, joints in MEMBERS for at in joints))
SYMMETRIC = np.array([True, False, True, False, True, False])  # x, y, z and about them


def offset(start, end):
    """Motion (6, 6) of ``end`` when ``start`` moves and what is between them is rigid."""
    x, y, z = np.subtract(end, start)
    lever = np.eye(6)
    lever[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return lever


def beam(section, start, end):
    """Stiffness and mass (12, 12) of a beam of a rectangular section between two points."""
    height, width, up = SECTIONS[section]
    length = np.linalg.norm(np.subtract(end, start))
    long, short = max(height, width), min(height, width)
    ratio = short / long
    torsion = long * short**3 * (1.0 / 3.0 - 0.21 * ratio * (1.0 - ratio**4 / 12.0))
    area, about_y, about_z = height * width, width * height**3 / 12.0, height * width**3 / 12.0
    line = np.array([[1, -1], [-1, 1]]) / length, np.array([[2, 1], [1, 2]]) * length / 6.0
    h = length
    bent = (
        np.array(
            [
                [12, 6 * h, -12, 6 * h],
                [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                [-12, -6 * h, 12, -6 * h],
                [6 * h, 2 * h * h, -6 * h, 4 * h * h],
            ]
        )
        / h**3
    )
    moved = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h * h, 13 * h, -3 * h * h],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h * h, -22 * h, 4 * h * h],
        ]
    )
    stiffness, mass = np.zeros((2, 12, 12))
    for rows, signs, (k, m), by_k, by_m in (
        ([0, 6], (1, 1), line, YOUNG * area, DENSITY * area),
        ([3, 9], (1, 1), line, YOUNG / (2 + 2 * POISSON) * torsion, DENSITY * (about_y + about_z)),
        ([1, 5, 7, 11], (1, 1, 1, 1), (bent, moved * h / 420), YOUNG * about_z, DENSITY * area),
        ([2, 4, 8, 10], (1, -1, 1, -1), (bent, moved * h / 420), YOUNG * about_y, DENSITY * area),
    ):  # fmt: skip
        sign = np.outer(signs, signs)
        stiffness[np.ix_(rows, rows)] += by_k * sign * k
        mass[np.ix_(rows, rows)] += by_m * sign * m
    along = np.subtract(end, start) / length
    turn = np.kron(np.eye(4), [along, np.cross(up, along), up])
    return turn.T @ stiffness @ turn, turn.T @ mass @ turn


def half_model(symmetric):
    """Stiffness by part, and mass, of half of the air frame, its middle plane held accordingly.

    What lies in the middle plane counts half.
    """
    number, size = {at: i for i, at in enumerate(JOINTS)}, 6 * len(JOINTS)
    parts = {name: np.zeros((size, size)) for name in (*SECTIONS, *LINKS, "bungees")}
    mass = np.zeros((size, size))

    def add(matrix, joints, of_joints):
        rows = np.concatenate([6 * number[at] + np.arange(6) for at in joints])
        share = 0.5 if all(at[1] == 0 for at in joints) else 1.0
        matrix[np.ix_(rows, rows)] += share * of_joints

    for section, joints in MEMBERS:
        for ends in pairwise(joints):
            stiffness, of_beam = beam(section, *ends)
            add(parts[section], ends, stiffness)
            add(mass, ends, of_beam)
    for name, pairs in LINKS.items():
        for ends in pairs:
            opened = np.hstack([offset(*ends), -np.eye(6)])
            add(parts[name], ends, opened.T @ LINK @ opened)
    for value, at, where in ((DRUM_MASS, OF_DRUM, DRUM_AT), (PLATE, PLATE_AT, PLATE_AT),
                             (ANGLES, ANGLES_AT, ANGLES_AT)):  # fmt: skip
        lever = offset(at, where)[:3]
        add(mass, [at], value * lever.T @ lever)
    for at in BUNGEES:
        add(parts["bungees"], [at], np.diag([0, 0, BUNGEE, 0, 0, 0]))
    moves = SYMMETRIC if symmetric else ~SYMMETRIC
    free = np.concatenate([moves | (at[1] > 0) for at in JOINTS])
    return {name: part[np.ix_(free, free)] for name, part in parts.items()}, mass[
        np.ix_(free, free)
    ]


# Hz; of each kind, the order is that of the model's modes above those of the bungees.
FREQUENCIES = {
    "symmetric": {"S1": 6.38, "S2": 33.53, "S3": 48.38, "S4": 55.08},
    "antisymmetric": {"A1": 16.10, "A2": 33.13, "A3": 35.65, "A4": 49.43},
}
BELOW = {"symmetric": 2, "antisymmetric": 0}
SOURCE = "GARTEUR SM-AG19, participant C (Balmes and Wright, 15th IMAC, 1997)"
DATA = {
    kind: bs.ModalData(
        tuple(bs.IdentifiedMode(label, hz) for label, hz in frequencies.items()),
        band_hz=(4.0, 60.0),
        source=SOURCE,
    )
    for kind, frequencies in FREQUENCIES.items()
}
factors = {
    name: bs.Parameter(name, bs.LogNormal(median=1.0, cov=0.1))
    for name in ("body", "wing", "drum", "fin", "tailplane")
}
# The share of what the layer would add if it were bonded.
layer = bs.Parameter("layer", bs.Uniform(0.0, 1.0))


def air_frame(kind, of_parts):
    parts, mass = half_model(kind == "symmetric")
    terms = [(of_parts.get(name, 1.0), part) for name, part in parts.items()]
    return bs.MatrixStructure(
        [term for term in terms if term[0] != 0.0],
        mass,
        sensors={"middle": 0},
        n_modes=BELOW[kind] + len(FREQUENCIES[kind]) + 1,
    ).reduced()


def model_class(name, of_layer, description):
    of_parts = factors | {"layer": of_layer}
    return bs.ModelClass(
        name,
        configurations=[
            bs.Configuration(
                kind,
                air_frame(kind, of_parts),
                DATA[kind],
                pairing={label: BELOW[kind] + i for i, label in enumerate(FREQUENCIES[kind], 1)},
            )
            for kind in FREQUENCIES
        ],
        description=description,
    )


study = bs.Study(
    "Aeroplane test bed GARTEUR SM-AG19",
    [
        model_class("bonded", 1.0, "the constraining layer is bonded to the wing"),
        model_class("partly", layer, "the constraining layer acts with the wing in part"),
        model_class("mass only", 0.0, "the constraining layer is mass only"),
    ],
    description="Does the constraining layer stiffen the wing?",
)
