"""A frame in space on rigid floors, the rotations of its joints condensed statically.

Columns and beams bend (Euler-Bernoulli) but do not change length; torsion is resisted by the
bending of columns alone. Each line of columns is then a plane frame that moves with the floors,
and its joints rotate until their moments are in equilibrium.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, chain

import numpy as np

from bayes_ssi.foundations.argument_types import require
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import (
    Parameter,
    Product,
    Value,
    as_product,
    parameters_of,
    positive_product,
)
from bayes_ssi.structures.elements import Contribution
from bayes_ssi.structures.matrix_terms import AffineArray, coefficients_of
from bayes_ssi.structures.rigid_floors import RigidFloors, rigid_masses

# Per E I over the span: rotations of the two ends, which do not move up or down.
BEAM = np.array([[4.0, 2.0], [2.0, 4.0]])


@dataclass(frozen=True)
class SpaceFrame(RigidFloors):
    """A frame with a column at every crossing of its lines, fixed at the base.

    The degrees of freedom are those of the floors' centres, the origin of x and y, as in
    :class:`~bayes_ssi.structures.rigid_floors.RigidFloors`. Beams run along every line, between
    neighbouring columns, on every floor.

    Attributes:
        storey_heights: from the lowest.
        x_lines: x of the columns, in ascending order: one bay of 4 m is (-2.0, 2.0).
        y_lines: the same in y.
        elastic_modulus: of columns and beams.
        column_inertias_x: second moment of area of one column that resists motion in x, of every
            storey from the lowest.
        column_inertias_y: the same in y.
        beam_inertias_x: second moment of area of one beam along x, of every floor.
        beam_inertias_y: the same along y.
        masses: of the floors, with what columns and beams add to them.
        rotational_inertias: of the floors about the vertical through their centres.
        elements: non-structural elements on it; :meth:`with_element` adds one.
        sensors: not at degrees of freedom; :meth:`with_sensors` adds some.
        ground_motion: the direction in which an earthquake moves the ground, "x" or "y".

    All in consistent units (m, N/m², m⁴, kg, kg m²). Lines and heights are numbers; the others are
    each a number, a Parameter or a number times a Parameter.

    Raises:
        ValueError: lengths differ, lines are not in ascending order or fewer than two, or a
            quantity can be zero or negative.
        TypeError: one of them is neither a number nor a Parameter.
    """

    storey_heights: tuple[float, ...]
    x_lines: tuple[float, ...]
    y_lines: tuple[float, ...]
    elastic_modulus: Value
    column_inertias_x: tuple[Value, ...]
    column_inertias_y: tuple[Value, ...]
    beam_inertias_x: tuple[Value, ...]
    beam_inertias_y: tuple[Value, ...]
    masses: tuple[Value, ...]
    rotational_inertias: tuple[Value, ...]

    def __post_init__(self) -> None:
        for name in ("storey_heights", "x_lines", "y_lines"):
            require(getattr(self, name), Sequence[float], f"SpaceFrame: {name}")
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        self._check_storeys("storey_heights")
        if not all(0.0 < height < math.inf for height in self.storey_heights):
            raise ValueError(
                "SpaceFrame: storey_heights must be positive and finite, got "
                f"{self.storey_heights!r}"
            )
        for name in ("x_lines", "y_lines"):
            lines = getattr(self, name)
            if len(lines) < 2 or not (np.isfinite(lines).all() and min(np.diff(lines)) > 0.0):
                raise ValueError(
                    f"SpaceFrame: {name} must be two or more finite coordinates in ascending "
                    f"order, got {lines!r}"
                )
        positive_product(self.elastic_modulus, "SpaceFrame: elastic_modulus")
        super().__post_init__()

    def size_of_drawing(self) -> tuple[float, float, Sequence[float]]:
        half_x, half_y = (max(map(abs, lines)) for lines in (self.x_lines, self.y_lines))
        return half_x, half_y, list(accumulate(self.storey_heights))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the frame, then of the elements, in the order of first appearance."""
        of_storeys = (value for name in self._storey_fields for value in getattr(self, name))
        own = map(as_product, (self.elastic_modulus, *of_storeys))
        return parameters_of((*own, *coefficients_of(chain(*self._terms))))

    def main_springs(self) -> Sequence[Contribution]:
        return ()  # the frame's stiffness, condensed, is not a sum of springs

    def main_masses(self) -> Sequence[Contribution]:
        floors = zip(self.masses, self.rotational_inertias, strict=True)
        return [
            point_mass
            for floor, inertias in enumerate(floors, 1)
            for point_mass in rigid_masses(floor, *map(as_product, inertias))
        ]

    def matrices(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        of_elements, mass = super().matrices(values)
        n = self.n_floors
        planes = [_condensed(plane.evaluate(values), n) for plane in self._planes]
        n_rows = max(map(len, (of_elements, *planes)))
        total = np.empty((n_rows, *of_elements.shape[1:]), order="F")
        total[:] = of_elements
        for lateral, moved in zip(planes, self._moved, strict=True):
            for (i, j), share in moved.items():
                total[:, i : 3 * n : 3, j : 3 * n : 3] += share * lateral
        return total, mass

    @cached_property
    def _moved(self) -> list[dict[tuple[int, int], float]]:
        """Stiffness between two motions of a floor per stiffness of plane frames along x, and y.

        The frame on the line at y moves by u - y θ, the one on the line at x by v + x θ.
        """
        along_x = np.array([(1.0, 0.0, -y) for y in self.y_lines])
        along_y = np.array([(0.0, 1.0, x) for x in self.x_lines])
        products = [np.einsum("la,lc->ac", lines, lines) for lines in (along_x, along_y)]
        return [{(i, j): float(p[i, j]) for i, j in np.argwhere(p).tolist()} for p in products]

    @cached_property
    def _planes(self) -> tuple[AffineArray, AffineArray]:
        """Stiffness of one plane frame along x, and of one along y, before condensation."""
        return (
            self._plane(self.x_lines, self.column_inertias_x, self.beam_inertias_x),
            self._plane(self.y_lines, self.column_inertias_y, self.beam_inertias_y),
        )

    def _plane(
        self, lines: Sequence[float], columns: Sequence[Value], beams: Sequence[Value]
    ) -> AffineArray:
        """Stiffness of a plane frame: displacements of the floors, then rotations of the joints.

        Where the lines are symmetric, so is the frame, and joints that mirror each other rotate
        equally when the floors move: one rotation represents both.
        """
        modulus = as_product(self.elastic_modulus)
        n, last = self.n_floors, len(lines) - 1
        mirrored = np.allclose(np.add(lines, lines[::-1]), lines[0] + lines[-1], rtol=0, atol=1e-9)
        place = [min(i, last - i) if mirrored else i for i in range(len(lines))]
        n_places = max(place) + 1
        size = n * (1 + n_places)
        terms: list[tuple[Product, FloatArray]] = []
        for floor, (height, column, beam) in enumerate(
            zip(self.storey_heights, columns, beams, strict=True)
        ):
            of_columns, of_beams = np.zeros((size, size)), np.zeros((size, size))
            joints = [n + floor * n_places + i for i in place]
            for joint in joints:
                below = [floor - 1, joint - n_places] if floor else []  # the base is fixed
                at = [*below, floor, joint]
                np.add.at(of_columns, np.ix_(at, at), _column(height)[-len(at) :, -len(at) :])
            for i, span in enumerate(np.diff(lines)):
                ends = joints[i : i + 2]
                np.add.at(of_beams, np.ix_(ends, ends), BEAM / span)
            terms.append((modulus * as_product(column), of_columns))
            terms.append((modulus * as_product(beam), of_beams))
        return AffineArray.of(terms, self.parameters, (size, size))


def _condensed(stiffness: FloatArray, n_kept: int) -> FloatArray:
    """Static condensation to the first degrees of freedom: K_dd - K_dr K_rr⁻¹ K_rd.

    The others are eliminated one by one. NaN where their stiffness is not positive definite.
    """
    rest = stiffness.transpose(1, 2, 0).copy()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for last in range(len(rest) - 1, n_kept - 1, -1):
            row = rest[last, : last + 1]
            row /= np.sqrt(row[last])
            rest[:last, :last] -= row[:last, None] * row[:last]
    return rest[:n_kept, :n_kept].transpose(2, 0, 1)


def _column(height: float) -> FloatArray:
    """Column stiffness per E I: displacement and rotation below, then above."""
    h = height
    rows = [
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h**2, -6.0 * h, 2.0 * h**2],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h**2, -6.0 * h, 4.0 * h**2],
    ]
    return np.array(rows) / h**3
