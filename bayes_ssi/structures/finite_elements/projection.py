"""A finite-element model in a few combinations of its reduced basis.

A reduced basis is accurate over the prior. Where a posterior lies, far fewer vectors describe the
modes: those combinations of the basis that the modes at some draws consist of. What they lack of
the static answers to forces is known place by place without solving an equation: the sketch S of
the reduced model's error has S Sᵀ ≈ K_r⁻¹, to about a tenth, and K_r⁻¹ E is known for the sensors.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Product
from bayes_ssi.structures.finite_elements.reduced_basis import SKETCH_SIZE, ReducedBasis, Reference
from bayes_ssi.structures.finite_elements.reducible_structure import ReducibleStructure
from bayes_ssi.structures.modal import FreeBody
from bayes_ssi.structures.motion import SinglePlace
from bayes_ssi.structures.sensors import Sensor


@dataclass(frozen=True, eq=False)
class BasisRow:
    """How one degree of freedom moves, and answers to forces: linear in the degree of freedom.

    Attributes:
        motion: (N,), row of V.
        flexibility: (k,), row of what the basis lacks of S, whose square is ρ.
        at_sensors: (d,), displacements of the sensors under a unit force, as far as V lacks them.
    """

    motion: FloatArray
    flexibility: FloatArray
    at_sensors: FloatArray

    def times(self, share: float) -> BasisRow:
        return BasisRow(share * self.motion, share * self.flexibility, share * self.at_sensors)

    def plus(self, other: BasisRow) -> BasisRow:
        return BasisRow(
            self.motion + other.motion,
            self.flexibility + other.flexibility,
            self.at_sensors + other.at_sensors,
        )


@dataclass(frozen=True, eq=False)
class Projection:
    """The model without elements in the basis.

    Attributes:
        stiffness, mass: coefficients and matrices (N, N), term by term; of the mass only the
            diagonals (N,) where all terms are diagonal.
        at_sensors: (d, N), motions of the sensors.
        rows: degrees of freedom on which elements may be put.
        free_body: by whose shift the stiffness is raised.
    """

    stiffness: tuple[tuple[Product, FloatArray], ...]
    mass: tuple[tuple[Product, FloatArray], ...]
    at_sensors: FloatArray
    sensors: tuple[str, ...]
    rows: Mapping[SinglePlace, BasisRow]
    n_modes: int
    free_body: FreeBody
    combined: tuple[Sensor, ...] = ()

    @classmethod
    def of(
        cls,
        basis: ReducedBasis,
        full: ReducibleStructure,
        places: Iterable[SinglePlace],
        reference: Reference,
    ) -> Self:
        """The model in a basis, in coordinates of unit mass where the mass is known.

        Args:
            places: degrees of freedom and sensors on which elements may be put.
        """
        vectors = basis.vectors
        # What the basis lacks of K_r⁻¹ times forces; the vectors are orthonormal in K_r.
        lacking = vectors.T @ (reference.matrix @ reference.sketch)
        rows = {place: full.system_row_of(place, "place") for place in places}
        known = {place: row for place, row in rows.items() if row is not None}
        at = np.array(list(known.values()), dtype=np.intp)
        motions = vectors[at]
        residual = reference.sketch[at] - motions @ lacking
        return cls(
            tuple(zip(full.system.stiffness.products, basis.stiffness, strict=True)),
            tuple(zip(full.system.mass.products, basis.mass, strict=True)),
            basis.at_sensors,
            full.degrees_of_freedom,
            {
                place: BasisRow(motion, each[:SKETCH_SIZE], each[SKETCH_SIZE:])
                for place, motion, each in zip(known, motions, residual, strict=True)
            },
            full.n_modes,
            full.free_body,
            full.sensors,
        ).at_unit_mass()

    @property
    def size(self) -> int:
        return int(self.at_sensors.shape[1])

    def at_unit_mass(self) -> Self:
        """The same in coordinates of unit mass, where the mass depends on no parameter.

        Then only the elements' masses change it, and their modes take a third less time.
        """
        if any(coefficient.powers for coefficient, _ in self.mass):
            return self
        squares, axes = np.linalg.eigh(sum(c.scale * matrix for c, matrix in self.mass))
        change = axes / np.sqrt(squares)
        return replace(
            self,
            stiffness=tuple((c, change.T @ matrix @ change) for c, matrix in self.stiffness),
            mass=((Product(1.0, ()), np.ones(self.size)),),
            at_sensors=self.at_sensors @ change,
            rows={
                place: replace(row, motion=row.motion @ change) for place, row in self.rows.items()
            },
        )
