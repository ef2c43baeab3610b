"""A cantilever with an elastic support somewhere along it, meshed by scikit-fem.

    pip install -e ".[fem]"
    bayes-ssi rank model_classes/finite_elements/beam_on_a_support.py

A function returns the matrices K and M for the support's stiffness and its place, which no sum of
fixed matrices could give. The beam: steel, 3 m long, 60 by 12 mm, bending about its weak axis, in
40 Hermite elements. The modes are simulated with the support at 1.9 m and a stiffness of 8 kN/m,
with errors of 0.2 % in the frequencies and 0.02 per component in the shapes.

Is there a support at all, and where?
"""

from pathlib import Path

import numpy as np
from skfem import Basis, BilinearForm, ElementLineHermite, MeshLine, asm
from skfem.helpers import d, dd

import bayes_ssi as bs

LENGTH, WIDTH, THICKNESS = 3.0, 0.06, 0.012  # m
YOUNG, DENSITY = 210e9, 7850.0  # N/m², kg/m³
PLACES = (0.75, 1.5, 2.25, 3.0)  # of the sensors, m
N_MODES = 4

mesh = MeshLine(np.linspace(0.0, LENGTH, 41))
basis = Basis(mesh, ElementLineHermite())
free = basis.complement_dofs(basis.get_dofs(lambda x: np.isclose(x[0], 0.0)).all(["u", "u_x"]))


@BilinearForm
def bending(u, v, _):
    return YOUNG * WIDTH * THICKNESS**3 / 12.0 * dd(u)[0, 0] * dd(v)[0, 0]


@BilinearForm
def inertia(u, v, _):
    area = WIDTH * THICKNESS
    return DENSITY * (area * u * v + WIDTH * THICKNESS**3 / 12.0 * d(u)[0] * d(v)[0])


STIFFNESS = asm(bending, basis).toarray()[np.ix_(free, free)]
MASS = asm(inertia, basis).toarray()[np.ix_(free, free)]
# The degree of freedom that is the deflection at a sensor.
NODE_OF = {place: int(np.abs(mesh.p[0] - place).argmin()) for place in PLACES}
SENSORS = {
    f"{place:g} m": int(np.flatnonzero(free == basis.nodal_dofs[0, node])[0])
    for place, node in NODE_OF.items()
}


def deflection(place):
    """Contribution of every degree of freedom to the deflection at a place (Hermite's cubics)."""
    size = LENGTH / mesh.nelements
    left = min(int(place / size), mesh.nelements - 1)
    s = place / size - left
    cubics = [
        (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * size,
        s**2 * (3 - 2 * s), s**2 * (s - 1) * size,
    ]  # fmt: skip
    whole = np.zeros(basis.N)
    whole[basis.nodal_dofs[:, [left, left + 1]].T.ravel()] = cubics
    return whole[free]


def beam(support, place):
    """K and M with a spring of stiffness ``support`` (N/m) at ``place`` (m)."""
    if not 0.0 < place <= LENGTH:
        raise ValueError(f"the support at {place:g} m is not on the beam")
    shape = deflection(place)
    return STIFFNESS + support * np.outer(shape, shape), MASS


def structure(support, place):
    return bs.FunctionStructure(
        beam, arguments={"support": support, "place": place}, sensors=SENSORS, n_modes=N_MODES
    )


support = bs.Parameter("support", bs.LogUniform(100.0, 100_000.0), unit="N/m")
place = bs.Parameter("place", bs.Uniform(0.0, LENGTH), unit="m")
bent = bs.Parameter("young", bs.LogNormal(median=1.0, cov=0.05))
modes = bs.read_modal_data(Path(__file__).parents[1] / "data" / "beam_on_a_support.csv")
error = bs.ErrorModel(shape_sd=0.02)
pairing = {str(i): i for i in range(1, N_MODES + 1)}

plain = bs.MatrixStructure((bent, STIFFNESS), MASS, sensors=SENSORS, n_modes=N_MODES)
study = bs.Study(
    "Cantilever on a support",
    [
        bs.ModelClass("no support", plain, modes, error, pairing=pairing),
        bs.ModelClass("at the tip", structure(support, LENGTH), modes, error, pairing=pairing),
        bs.ModelClass("anywhere", structure(support, place), modes, error, pairing=pairing),
    ],
)
