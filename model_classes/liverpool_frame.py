"""A real three-storey laboratory frame, tested bare and with a blade that vibrates on its roof.

Floors of about 0.25 m by 0.3 m on thin columns of nearly the same stiffness in x and y; the blade,
0.2 m high, is called a tuned mass damper by those who tested it (University of Liverpool, BAYOMA
database). Only frequencies are known, and the kind of motion of each mode.

The two tests are configurations of one model class: the frame is the same in both. As bending and
torsion do not couple in it, each test is one configuration of the modes of bending and one of those
of torsion: which kind a mode is, is known, and bending modes are paired with such alone. The blade
test has a clamp and an additional accelerometer on the roof, an unknown small mass in every class.
The classes differ in the blade: does it vibrate by itself, in its weak direction x near the first
bending modes, in y near the third, in both, or is it mass only?

Floor masses are equal and unknown, so stiffnesses are per floor mass and masses are shares of it.
The storeys' stiffnesses have one profile in x, y and torsion, as results from equal columns.
"""

import math
from dataclasses import replace
from pathlib import Path

import bayes_ssi as bs

DATA = Path(__file__).parent / "data"
bare_modes = bs.read_modal_data(DATA / "liverpool_bare.csv")
blade_modes = bs.read_modal_data(DATA / "liverpool_with_blade.csv")


BENDING = "AB"  # of the floors, or most of all of the blade


def of_kind(letters, data):
    """The modes whose labels begin with one of these letters, which state their kind."""
    return replace(data, modes=tuple(mode for mode in data.modes if mode.label[0] in letters))


# Nominal frequencies (Hz) of the bare frame: the means of the pairs of bending modes, as the
# scale of the priors. A uniform frame has f_1 = (1/π) √(k/m) sin(π/14).
BENDING_1, BENDING_3, TORSION_1 = 3.9, 17.3, 7.0


def uniform_stiffness(first_frequency_hz):
    return (math.pi * first_frequency_hz / math.sin(math.pi / 14)) ** 2


# Torsion is locked where bending is looked at: its frequencies are far above the band.
LOCKED = uniform_stiffness(100.0 * TORSION_1)


def factor(name):
    return bs.Parameter(name, bs.LogNormal(median=1.0, cov=0.3))


def share_of_a_floor(name):
    return bs.Parameter(name, bs.LogNormal(median=0.02, cov=1.0))


def tuned_to(name, frequency_hz):
    return bs.Parameter(name, bs.LogNormal(median=frequency_hz, cov=0.2), unit="Hz")


profile = (factor("storey 1 / 2"), 1.0, factor("storey 3 / 2"))
kx, ky, kt = factor("k x"), factor("k y"), factor("k torsion")
# Lengths are in radii of gyration: a floor's moment of inertia is its mass.
bare = bs.ShearBuilding3D(
    masses=(1.0, 1.0, 1.0),
    radii_of_gyration=(1.0, 1.0, 1.0),
    stiffnesses_x=[uniform_stiffness(BENDING_1) * kx * share for share in profile],
    stiffnesses_y=[uniform_stiffness(BENDING_1) * ky * share for share in profile],
    torsional_stiffnesses=[LOCKED] * 3,
)
twisting = bs.ShearBuilding(
    masses=(1.0, 1.0, 1.0),
    stiffnesses=[uniform_stiffness(TORSION_1) * kt * share for share in profile],
)
roof_mass = share_of_a_floor("roof mass")
loaded = bare.with_element(bs.FloorBlock(on=3, mass=roof_mass, radius=1.0, label="roof mass"))
loaded_twisting = twisting.with_element(bs.AddedMass(roof_mass, [(3, 1.0)], label="roof mass"))
blade_x = bs.Pendulum(
    on="floor 3 x",
    mass=share_of_a_floor("blade mass x"),
    frequency=tuned_to("blade frequency x", BENDING_1),
    label="blade x",
)
blade_y = bs.Pendulum(
    on="floor 3 y",
    mass=share_of_a_floor("blade mass y"),
    frequency=tuned_to("blade frequency y", BENDING_3),
    label="blade y",
)


def model_class(name, with_blade, not_explained, description):
    """Modes are paired in their order, kind by kind; those not explained are left out."""

    def in_order(test, structure, modes):
        explained = [label for label in modes.labels if label not in not_explained]
        pairing = {label: i for i, label in enumerate(explained, 1)}
        return bs.Configuration(test, structure, modes, pairing=pairing)

    return bs.ModelClass(
        name,
        configurations=[
            in_order("bare", bare, of_kind(BENDING, bare_modes)),
            in_order("bare, torsion", twisting, of_kind("T", bare_modes)),
            in_order("with blade", with_blade, of_kind(BENDING, blade_modes)),
            in_order("with blade, torsion", loaded_twisting, of_kind("T", blade_modes)),
        ],
        description=description,
    )


study = bs.Study(
    "Three-storey frame with a blade on its roof",
    [
        model_class("mass only", loaded, ("Ax", "Ay"), "the blade is mass on the roof"),
        model_class("x", loaded.with_element(blade_x), ("Ay",), "the blade vibrates in x"),
        model_class("y", loaded.with_element(blade_y), ("Ax",), "the blade vibrates in y"),
        model_class(
            "x and y",
            loaded.with_element(blade_x).with_element(blade_y),
            (),
            "the blade vibrates in x and in y",
        ),
    ],
    description="In which directions does the blade vibrate by itself?",
)
