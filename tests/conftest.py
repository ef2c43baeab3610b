"""The numerical study: a uniform three-storey shear building with a resonant infill.

First frequency 1 Hz; the infill stands between floors 1 and 2, has 5 % of the building's mass and
is tuned to the second frequency of the bare building. The identified modes are typed in, not
computed, so that tests compare the package with figures that it did not produce.
"""

import math

import numpy as np
import pytest

import bayes_ssi as bs

STOREY_STIFFNESS = (2.0 * math.pi) ** 2 / (2.0 * math.sin(math.pi / 14.0)) ** 2
SECOND_FREQUENCY = math.sin(3.0 * math.pi / 14.0) / math.sin(math.pi / 14.0)

FLOORS = ("floor 1", "floor 2", "floor 3")
IDENTIFIED = {
    "1": (0.98275928, [0.3314169, 0.59327725, 0.7336109]),
    "2a": (2.6042925, [0.67446666, 0.239743, -0.69829652]),
    "2b": (3.00473295, [-0.79377247, -0.37649877, 0.47767556]),
    "3": (3.98405175, [-0.5785374, 0.73919027, -0.34480751]),
}


def multiplier(name, cov=0.3):
    return bs.Parameter(name, bs.LogNormal(median=1.0, cov=cov))


@pytest.fixture
def frame():
    """The main structure; one multiplier a storey."""
    stiffnesses = [STOREY_STIFFNESS * multiplier(f"k{i}") for i in (1, 2, 3)]
    return bs.ShearBuilding(masses=(1.0, 1.0, 1.0), stiffnesses=stiffnesses)


@pytest.fixture
def infill():
    return bs.OutOfPlaneInfill(
        between=(1, 2), mass=0.15, frequency=SECOND_FREQUENCY, stiffness_factor=multiplier("ks")
    )


@pytest.fixture
def rigid(frame, infill):
    """The incorrect model structure: the infill is mass only."""
    return frame.with_element(infill.as_mass())


@pytest.fixture
def augmented(frame, infill):
    """The correct model structure: the infill has a degree of freedom."""
    return frame.with_element(infill)


@pytest.fixture
def case_c():
    """The four identified modes, with shapes at the floors."""
    modes = [bs.IdentifiedMode(label, f, np.array(s)) for label, (f, s) in IDENTIFIED.items()]
    return bs.ModalData(tuple(modes), band_hz=(0.0, 6.0), sensors=FLOORS)


@pytest.fixture
def fixed_error():
    return bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)


@pytest.fixture
def model_classes(rigid, augmented, case_c, fixed_error):
    """The study's four model classes by name."""
    choices = {
        "1-a": (rigid, {"1": 1, "2a": 2, "3": 3}),
        "1-b": (rigid, {"1": 1, "2b": 2, "3": 3}),
        "2": (rigid, {"1": 1, "3": 3}),
        "3": (augmented, {"1": 1, "2a": 2, "2b": 3, "3": 4}),
    }
    return {
        name: bs.ModelClass(name, structure, case_c, fixed_error, pairing=pairing)
        for name, (structure, pairing) in choices.items()
    }
