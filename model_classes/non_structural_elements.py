"""Non-structural elements on a shear building: the paper's configurations and cases, section 2.

C0 is the bare frame: three storeys of equal mass and stiffness, first frequency 1 Hz, damping 2 %
in every mode. The elements of the other configurations are

C1  infills in their plane, in parallel with the frame (P-NSE)
C2  pendulous masses, in series with it (S-NSE)
C3  infills out of their plane, in series with it (S-NSE)

and Cases (a) to (f) have one or three of them. ``correct`` holds every case with its vibrating
elements, ``incorrect`` with their masses only, on the floors; runs/figure_3.py, figure_4.py and
figure_5.py draw the difference. The study asks for Case (e), three pendulums about the first mode,
whether its modes, measured at the floors alone, distinguish the two forms.
"""

import math

import numpy as np

import bayes_ssi as bs

N_STOREYS = 3
DAMPING = 0.02
# f_j = (1/π) √(k/m) sin((2j - 1)π / (2(2N + 1))): unit masses and f_1 = 1 Hz.
STIFFNESS = (math.pi / math.sin(math.pi / (2 * (2 * N_STOREYS + 1)))) ** 2
FIRST_FREQUENCY = 1.0
SECOND_FREQUENCY = math.sin(3 * math.pi / 14) / math.sin(math.pi / 14)
TOTAL_MASS = float(N_STOREYS)

FLOORS = tuple(f"floor {i}" for i in range(1, N_STOREYS + 1))
STOREYS = tuple((i - 1, i) for i in range(1, N_STOREYS + 1))
TUNING = (0.95, 1.00, 1.05)

bare = bs.ShearBuilding(masses=(1.0,) * N_STOREYS, stiffnesses=(STIFFNESS,) * N_STOREYS)

elements = {
    "a": [bs.InPlaneInfill(between=(1, 2), mass=0.05 * TOTAL_MASS, stiffness=3 * STIFFNESS)],
    "b": [bs.Pendulum(on=2, mass=0.025 * TOTAL_MASS, frequency=SECOND_FREQUENCY)],
    "c": [bs.OutOfPlaneInfill(between=(1, 2), mass=0.05 * TOTAL_MASS, frequency=SECOND_FREQUENCY)],
    "d": [bs.InPlaneInfill(between=storey, mass=0.05, stiffness=STIFFNESS) for storey in STOREYS],
    "e": [
        bs.Pendulum(on=floor, mass=0.025, frequency=ratio * FIRST_FREQUENCY)
        for floor, ratio in enumerate(TUNING, 1)
    ],
    "f": [
        bs.OutOfPlaneInfill(between=storey, mass=0.05, frequency=ratio * FIRST_FREQUENCY)
        for storey, ratio in zip(STOREYS, TUNING, strict=True)
    ],
}
configurations = {"a": "C1", "b": "C2", "c": "C3", "d": "C1", "e": "C2", "f": "C3"}
titles = {
    "a": "infill in plane, storey 2",
    "b": "pendulum, floor 2, at f2",
    "c": "infill out of plane, at f2",
    "d": "infills in plane",
    "e": "pendulums about f1",
    "f": "infills out of plane about f1",
}

correct, incorrect = {}, {}
for case, each in elements.items():
    correct[case], incorrect[case] = bare, bare
    for element in each:
        correct[case] = correct[case].with_element(element)
        incorrect[case] = incorrect[case].with_element(element.as_mass())

factors = [bs.Parameter(f"k{i}", bs.LogNormal(median=1.0, cov=0.3)) for i in (1, 2, 3)]
uncertain = bs.ShearBuilding(bare.masses, [STIFFNESS * factor for factor in factors])
vibrating, rigid = uncertain, uncertain
for pendulum in elements["e"]:
    vibrating = vibrating.with_element(pendulum)
    rigid = rigid.with_element(pendulum.as_mass())

# Without noise, as if a test had identified every mode.
frequencies_hz, shapes = correct["e"].modes(np.empty((1, 0)))
modes = bs.ModalData(
    tuple(
        bs.IdentifiedMode(label, float(frequencies_hz[0, i]), shapes[0, :N_STOREYS, i])
        for i, label in enumerate(("1a", "1b", "1c", "1d", "2", "3"))
    ),
    band_hz=(0.0, 6.0),
    sensors=FLOORS,
    source="simulated: Case (e), three pendulums about the first mode, no noise",
)
error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)

study = bs.Study(
    "Pendulums about the first mode",
    [
        bs.ModelClass(
            "vibrating",
            vibrating,
            modes,
            error,
            pairing={label: i for i, label in enumerate(modes.labels, 1)},
            description="every pendulum with its own degree of freedom",
        ),
        bs.ModelClass(
            "as masses",
            rigid,
            modes,
            error,
            pairing="any",
            description="the pendulums' masses on the floors; which mode is the first is inferred",
        ),
    ],
    description="Do the modes of Case (e) show that the pendulums vibrate?",
)
