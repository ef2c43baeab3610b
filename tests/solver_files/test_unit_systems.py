"""A frame in the units of other countries is the frame in N, m and kg again."""

import numpy as np
import pytest
from frames import LABELS, portal

import bayes_ssi as bs
from bayes_ssi.structures.solver_files.exported_model import Matrices, exported_model
from bayes_ssi.structures.solver_files.model_files import SYSTEMS, in_si

# Newtons and metres in the units, by their definitions.
IN_UNITS = {
    "N, mm": (1.0, 1e-3), "kN, m": (1e3, 1.0), "kgf, cm": (9.80665, 0.01),
    "kip, in": (4448.2216152605, 0.0254), "lbf, ft": (4.4482216152605, 0.3048),
}  # fmt: skip


@pytest.mark.parametrize("units", IN_UNITS)
def test_forces_moments_and_masses(units):
    """Forces per displacement, moments per radian and what couples them have other units each."""
    force, length = IN_UNITS[units]
    stiffness, mass = portal()
    turns = np.array([label.endswith("ry") for label in LABELS])
    work = np.where(turns, length * force, force)  # what a row balances: moments or forces
    moved = np.where(turns, 1.0, length)  # what a column moves by 1: radians or lengths
    kilograms = force / length
    exported = Matrices(
        [matrix * moved / work[:, None] for matrix in (stiffness, mass)],
        ("K", "M"),
        labels=LABELS,
        geometry=bs.Geometry(
            {"2": (0.0, 0.0, 3.5 / length), "7": (6.0 / length, 0.0, 3.5 / length)}
        ),
    )
    model = exported_model("test", exported)
    assert model.total_mass["x"] == pytest.approx(5e3 / kilograms)
    back = in_si(model, units)
    np.testing.assert_allclose(back.stiffness.toarray(), stiffness, rtol=1e-12)
    np.testing.assert_allclose(back.mass.toarray(), mass, rtol=1e-12)
    assert back.geometry.nodes["7"] == pytest.approx((6.0, 0.0, 3.5))
    assert back.geometry.unit == "m"


def test_without_labels_lengths_cannot_be_turned():
    model = exported_model("test", Matrices(portal(), ("K", "M")))
    assert in_si(model, "kN, m").stiffness[0, 0] == 1e3 * portal()[0][0, 0]
    with pytest.raises(ValueError, match=r"units 'N, mm': labels are needed to say which rows"):
        in_si(model, "N, mm")
    assert set(IN_UNITS) <= set(SYSTEMS)
