"""A footbridge whose model has four modes in the band where the test gave five.

    bayes-ssi search model_classes/finite_elements/footbridge.py \
        --candidates model_classes/data/footbridge_candidates.csv

A half-through truss of steel, 30 m long, on a deck 2.4 m wide: 3-D beam elements with 52 nodes and
302 degrees of freedom, assembled below by numpy. What is the fifth mode, where does it hang, and
how heavy is it? Candidates are every other panel point, where lamp posts, pipes and parapets are:
sideways on the top chords, vertically on the bottom chords.

The modes are simulated (runs/make_footbridge.py), with a pipe that the study does not mention:
608 kg that move vertically on the left bottom chord, 20 m along, at 2.265 Hz; with stiffness
factors of 0.93 for the trusses and 1.1 for the deck; and with errors of 0.5 % in the frequencies
and 0.03 per component in the shapes.
"""

from pathlib import Path

import numpy as np
import scipy.sparse as sp

import bayes_ssi as bs

DATA = Path(__file__).parents[1] / "data"
PANELS, PANEL, WIDTH, HEIGHT = 12, 2.5, 2.4, 1.5  # m
YOUNG, SHEAR, DENSITY = 210e9, 81e9, 7850.0  # N/m², N/m², kg/m³
DECK = 900.0  # kg per panel and side: planks, railings, and half of the cross-beam
# Area (m²), second moments of area for bending sideways and in the truss's plane, torsion constant
# (m⁴) of square hollow sections.
CHORD = (4.0e-3, 1.0e-5, 1.0e-5, 1.6e-5)
WEB = (2.0e-3, 3.0e-6, 3.0e-6, 4.8e-6)
BRACE = (6.0e-4, 2.0e-7, 2.0e-7, 3.0e-7)

SIDES = {"left": 0.0, "right": WIDTH}
LEVELS = {"bottom": 0.0, "top": HEIGHT}
NODES = {
    f"{level} {side} {i}": (i * PANEL, y, z)
    for level, z in LEVELS.items()
    for side, y in SIDES.items()
    for i in range(PANELS + 1)
}


def members():
    """Group, section and ends of every member."""
    for side in SIDES:
        for i in range(PANELS + 1):
            yield "trusses", WEB, f"bottom {side} {i}", f"top {side} {i}"
        for i in range(PANELS):
            for level in LEVELS:
                yield "trusses", CHORD, f"{level} {side} {i}", f"{level} {side} {i + 1}"
            low, high = (i, i + 1) if i < PANELS // 2 else (i + 1, i)
            yield "trusses", WEB, f"bottom {side} {high}", f"top {side} {low}"
    for i in range(PANELS + 1):
        yield "deck", WEB, f"bottom left {i}", f"bottom right {i}"
    for i in range(PANELS):
        yield "deck", BRACE, f"bottom left {i}", f"bottom right {i + 1}"


def beam(section, ends):
    """Stiffness (12, 12) of a beam in space, after Przemieniecki (1968), and its mass."""
    area, inertia_y, inertia_z, torsion = section
    start, end = np.array(ends)
    length = np.linalg.norm(end - start)
    local = np.zeros((12, 12))
    for i, stiffness in ((0, YOUNG * area), (3, SHEAR * torsion)):
        local[np.ix_([i, i + 6], [i, i + 6])] = stiffness / length * np.array([[1, -1], [-1, 1]])
    for rows, sign, inertia in (([1, 5, 7, 11], 1, inertia_z), ([2, 4, 8, 10], -1, inertia_y)):
        a, b, c = 12 / length**3, sign * 6 / length**2, 1 / length
        bending = [[a, b, -a, b], [b, 4 * c, -b, 2 * c], [-a, -b, a, -b], [b, 2 * c, -b, 4 * c]]
        local[np.ix_(rows, rows)] = YOUNG * inertia * np.array(bending)
    along = (end - start) / length
    sideways = np.cross([0.0, 0.0, 1.0] if abs(along[2]) < 0.99 else [0.0, 1.0, 0.0], along)
    sideways /= np.linalg.norm(sideways)
    turn = np.kron(np.eye(4), [along, sideways, np.cross(along, sideways)])
    return turn.T @ local @ turn, DENSITY * area * length


number = {name: i for i, name in enumerate(NODES)}
size = 6 * len(NODES)
stiffness = {group: sp.lil_array((size, size)) for group in ("trusses", "deck")}
masses = np.zeros(size)
for group, section, *ends in members():
    element, mass = beam(section, [NODES[end] for end in ends])
    rows = np.concatenate([6 * number[end] + np.arange(6) for end in ends])
    stiffness[group][np.ix_(rows, rows)] += element
    for end in ends:
        first = 6 * number[end]
        masses[first : first + 3] += mass / 2
        masses[first + 3 : first + 6] += mass / 2 * 0.1**2  # a small inertia of rotation
for side in SIDES:
    for i in range(PANELS + 1):
        first = 6 * number[f"bottom {side} {i}"]
        masses[first : first + 3] += DECK if 0 < i < PANELS else DECK / 2

LABELS = [f"{node} {way}" for node in NODES for way in ("x", "y", "z", "rx", "ry", "rz")]
held = {f"bottom {side} {i} {way}" for side in SIDES for i in (0, PANELS) for way in "yz"}
held |= {f"bottom {side} 0 x" for side in SIDES}
free = [i for i, label in enumerate(LABELS) if label not in held]
SENSORS = [f"bottom {side} {i} {way}" for side in SIDES for i in (3, 6, 9) for way in "yz"]


def bridge(trusses, deck, **options):
    """The bridge with factors of the stiffness of its trusses and of its deck."""
    parts = {group: sp.csc_array(each)[free][:, free] for group, each in stiffness.items()}
    return bs.MatrixStructure(
        [(trusses, parts["trusses"]), (deck, parts["deck"])],
        sp.diags_array(masses[free]),
        labels=[LABELS[i] for i in free],
        sensors=SENSORS,
        geometry=bs.Geometry(NODES, [tuple(ends) for _, _, *ends in members()], "m"),
        **options,
    )


trusses = bs.Parameter("trusses", bs.LogNormal(median=1.0, cov=0.1))
deck = bs.Parameter("deck", bs.LogNormal(median=1.0, cov=0.2))
study = bs.Study(
    "Footbridge",
    [
        bs.ModelClass(
            "bridge",
            bridge(trusses, deck, n_modes=5).reduced(),
            bs.read_modal_data(DATA / "footbridge.csv"),
            bs.ErrorModel(frequency_cov=0.005, shape_sd=0.03),
            pairing="any",
            description="the truss without anything on it",
        )
    ],
    description="What is the fifth mode?",
    mass_unit="kg",
)
