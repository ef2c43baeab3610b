"""Units of exported matrices: stated by the engineer, checked by the mass, turned into N, m, kg.

Files of matrices state no units. Frequencies are right in every consistent system, in which the
unit of mass is that of force times s² divided by that of length; masses and stiffnesses that are
added to a model in kg and N/m are not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.choices import require_one_of
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS, direction_of


@dataclass(frozen=True)
class Units:
    """A consistent system: its units of force in N and of length in m."""

    force: float
    length: float

    @property
    def mass(self) -> float:
        """The unit of mass, in kg."""
        return self.force / self.length


# NIST Special Publication 811: 1 lbf = 4.4482216152605 N, 1 in = 0.0254 m, 1 ft = 0.3048 m,
# 1 kgf = 9.80665 N.
SYSTEMS: Mapping[str, Units] = MappingProxyType(
    {
        "N, m": Units(1.0, 1.0),
        "N, mm": Units(1.0, 1e-3),
        "kN, m": Units(1e3, 1.0),
        "kN, mm": Units(1e3, 1e-3),
        "kgf, m": Units(9.80665, 1.0),
        "kgf, cm": Units(9.80665, 1e-2),
        "lbf, in": Units(4.4482216152605, 0.0254),
        "lbf, ft": Units(4.4482216152605, 0.3048),
        "kip, in": Units(4448.2216152605, 0.0254),
        "kip, ft": Units(4448.2216152605, 0.3048),
    }
)


def in_si(model: ExportedModel, units: str) -> ExportedModel:
    """The model in N, m and kg; rotations stay in radians."""
    system = _system(units)
    if model.labels is None and system.length != 1.0:
        raise ValueError(
            f"units {units!r}: labels are needed to say which rows are rotations, whose units "
            "are not those of displacements"
        )
    scale = np.ones(model.size)
    if model.labels is not None:
        scale = np.array([1.0 / _unit(name, system) for name in model.labels])
    # Energies are in units of force times length, of displacements in m and rotations in radians.
    energy = system.force * system.length
    by_row = sp.diags_array(scale)
    stiffness, mass = (
        sp.csc_array(energy * (by_row @ each @ by_row)) for each in (model.stiffness, model.mass)
    )
    geometry = model.geometry
    if geometry is not None:
        nodes = {
            name: (system.length * x, system.length * y, system.length * z)
            for name, (x, y, z) in geometry.nodes.items()
        }
        geometry = replace(geometry, nodes=nodes, unit="m")
    dependent = {
        name: {
            other: factor * _unit(name, system) / _unit(other, system)
            for other, factor in of.items()
        }
        for name, of in model.dependent.items()
    }
    return replace(
        model,
        stiffness=stiffness,
        mass=mass,
        geometry=geometry,
        dependent=MappingProxyType(dependent),
        units="N, m, kg",
        notes=(*model.notes, f"turned from {units} into N, m, kg; rotations stay in radians"),
    )


def require_mass(model: ExportedModel, mass_kg: float, units: str | None) -> None:
    """Refuse units in which the model's mass is not what the engineer knows it to be.

    Args:
        model: in the units of the program.
        mass_kg: the structure's mass in kg, known to within a factor of 2.
        units: the units that were stated, if any.
    """
    if not 0.0 < mass_kg < np.inf:
        raise ValueError(f"mass_kg must be positive, got {mass_kg!r}")
    totals = model.total_mass
    if not totals:
        raise ValueError("mass_kg: labels are needed to tell the mass in each direction")
    largest = max(totals.values())
    # Engineers know the mass of a structure to well within a factor of 2; a mistaken unit of force
    # or length is off by one of 4.4 or more.
    fitting = [
        name for name, system in SYSTEMS.items() if 0.5 < largest * system.mass / mass_kg < 2.0
    ]
    if units in fitting:
        return
    which = "" if units is None else f", in {units} {largest * _system(units).mass:.4g} kg"
    fit = " or ".join(map(repr, fitting)) or "none: is the density in other units than the rest?"
    raise ValueError(
        f"mass_kg {mass_kg:g}: the model's mass is {largest:.4g} in its own units{which}; units "
        f"that fit: {fit}"
    )


def mass_note(model: ExportedModel) -> str | None:
    """The total mass in words, and what it would be in kg if the units were not stated."""
    totals = model.total_mass
    if not totals:
        return None
    shown = ", ".join(f"{value:.4g} in {direction}" for direction, value in totals.items())
    if model.units == "N, m, kg":
        return f"mass that moves, in kg: {shown}"
    largest = max(totals.values())
    kg = ", ".join(
        f"{largest * SYSTEMS[name].mass:.4g} kg in {name}" for name in ("N, m", "N, mm", "kN, m")
    )
    return f"mass that moves: {shown} (that is {kg}; state units= to have N, m, kg)"


def _unit(label: str, system: Units) -> float:
    """The unit of a degree of freedom in m, or in radians."""
    return system.length if direction_of(label) in TRANSLATIONS else 1.0


def _system(units: str) -> Units:
    require_one_of("units", units, SYSTEMS)
    return SYSTEMS[units]
