"""Structures made of springs and point masses, such as shear buildings, with elements on them.

Stiffness and mass are sums of fixed matrices times products of parameters, assembled for a whole
batch at once; a subclass may add stiffness of another kind.
"""

import math
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import chain, pairwise
from typing import Self

import numpy as np

from bayes_ssi.foundations.argument_types import checked, require
from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.parameters.parameters import (
    Parameter,
    Value,
    as_product,
    parameters_of,
    positive_product,
)
from bayes_ssi.structures.elements import AddedMass, Contribution, Element
from bayes_ssi.structures.geometry import (
    Candidate,
    Drawing,
    Geometry,
    Location,
    Motion,
    Motions,
    Place,
    Point,
    Sensor,
    SinglePlace,
    motion_of,
)
from bayes_ssi.structures.matrix_terms import (
    AddedTerm,
    AffineArray,
    CarriedElements,
    coefficients_of,
    own_labels,
)
from bayes_ssi.structures.modal import ModalModel, Modes, modal_model, solve_modes
from bayes_ssi.structures.structure import CarryingStructure

MOST_ENTRIES = 2**19  # entries of the matrices that are assembled at once


@dataclass(frozen=True)
class LumpedStructure(CarryingStructure):
    """A main structure of springs and point masses, the elements on it, and sensors."""

    # Non-structural elements on the main structure.
    elements: tuple[Element, ...] = field(default=(), kw_only=True)
    # Sensors that do not measure a single degree of freedom.
    sensors: tuple[Sensor, ...] = field(default=(), kw_only=True)

    @abstractmethod
    def main_degrees_of_freedom(self) -> Sequence[str]:
        """Labels of the main structure's degrees of freedom; place ``i`` is the i-th from 1."""

    @abstractmethod
    def main_springs(self) -> Sequence[Contribution]:
        """Springs of the main structure."""

    @abstractmethod
    def main_masses(self) -> Sequence[Contribution]:
        """Masses of the main structure."""

    is_cheap = True

    @property
    def n_floors(self) -> int:
        return len(getattr(self, self._storey_fields[0]))

    @checked
    def with_element(self, element: Element) -> Self:
        return replace(self, elements=(*self.elements, element))

    def place_shapes(self, places: Sequence[Place], values: FloatArray) -> FloatArray:
        motions = np.array([self._vector(motion_of(place)) for place in places])
        return motions @ self.modes(values).shapes[0]

    def place_masses(self, places: Sequence[Place]) -> FloatArray:
        motions = np.array([self._vector(motion_of(place)) for place in places])
        mass = self._mass.evaluate(self.prior_medians())[0]
        inverse = np.diag(1.0 / mass) if mass.ndim == 1 else np.linalg.inv(mass)
        return 1.0 / np.einsum("pi,ij,pj->p", motions, inverse, motions)

    def candidates(self, sensors: Sequence[str]) -> tuple[Candidate, ...]:  # noqa: ARG002
        floors = range(1, self.n_floors + 1)
        return (
            *(Candidate(str(floor), floor) for floor in floors),
            *(Candidate(f"{floor - 1}-{floor}", floor - 1, to=floor) for floor in floors),
        )

    def mean_floor_mass(self) -> float:
        """The main structure's mass that moves with the ground, over the number of floors."""
        influence, total = self.main_influence(), 0.0
        for mass, vector, _ in self._terms[1][: len(self.main_masses())]:
            total += mass.median * sum(c * influence[row] for row, c in vector.items()) ** 2
        return total / self.n_floors

    def __post_init__(self) -> None:
        require(self.elements, Iterable[Element], f"{type(self).__name__}: elements")
        require(self.sensors, Iterable[Sensor], f"{type(self).__name__}: sensors")
        object.__setattr__(self, "elements", tuple(self.elements))
        object.__setattr__(self, "sensors", tuple(self.sensors))
        _ = self._carried  # refuses elements that do not fit the structure
        self._check_sensors()

    @property
    def _storey_fields(self) -> list[str]:
        """The fields that hold one quantity for each storey or floor."""
        written = (tuple[Value, ...], "tuple[Value, ...]")  # a text if annotations are delayed
        return [field.name for field in fields(self) if field.type in written]

    def _check_storeys(self, *others: str) -> None:
        """Check that each field has one positive value per storey; make the fields tuples."""
        kind, names = type(self).__name__, self._storey_fields
        for name in names:
            object.__setattr__(self, name, tuple(getattr(self, name)))
        counts = {name: len(getattr(self, name)) for name in (*names, *others)}
        if len(set(counts.values())) != 1 or 0 in counts.values():
            listed = ", ".join(f"{count} {name}" for name, count in counts.items())
            raise ValueError(f"{kind}: needs one of each per storey, at least one, got {listed}")
        for name in names:
            for i, value in enumerate(getattr(self, name), 1):
                positive_product(value, f"{kind}: {name}, number {i} from below,")

    @cached_property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return (*self.main_degrees_of_freedom(), *own_labels(self.elements))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        return parameters_of(coefficients_of(chain(*self._terms)))

    @property
    def n_modes(self) -> int:
        return len(self.degrees_of_freedom)

    def modes(self, values: FloatArray) -> Modes:
        n = max(1, MOST_ENTRIES // self.n_modes**2)
        if len(values) > n:
            return joined([self.modes(part) for part in np.split(values, range(n, len(values), n))])
        return solve_modes(*self.matrices(values)).repeated(len(values))

    def heights(self) -> dict[str, float]:
        """See :meth:`Structure.heights`; an appendage is drawn between the places that carry it."""
        labels = self.degrees_of_freedom
        heights = {label: float(i) for i, (_, own) in enumerate(self._floors(), 1) for label in own}
        for label, spring in zip(self.appendages, self._carried.own_springs, strict=True):
            carriers = [labels[row] for row in spring.vector if labels[row] != label]
            around = [heights.get(carrier, float(self.n_floors)) for carrier in carriers]
            around += [0.0] if spring.on_ground else []
            middle = sum(around) / len(around)
            # On a single place it is drawn a little above.
            heights[label] = middle + 0.35 if middle in around else middle
        return heights

    def size_of_drawing(self) -> tuple[float, float, Sequence[float]]:
        """Half widths of the floors along x and y, and their levels, for drawings."""
        return 0.7, 0.7, [float(floor) for floor in range(1, self.n_floors + 1)]

    def _floors(self) -> Iterator[tuple[float, tuple[str, ...]]]:
        """Level of each floor and its degrees of freedom: along x, or along x, y and about z."""
        labels = tuple(self.main_degrees_of_freedom())
        each = len(labels) // self.n_floors
        for i, level in enumerate(self.size_of_drawing()[2]):
            yield level, labels[i * each : (i + 1) * each]

    def drawing(self) -> Drawing:
        """See :meth:`Structure.drawing`; floors are plates on columns, appendages points."""
        half_x, half_y, floors = self.size_of_drawing()
        levels = [0.0, *floors]
        levels.append(2.0 * levels[-1] - levels[-2])  # of what stands on the roof
        nodes: dict[str, Point] = {}
        moving: dict[str, Motions] = {}
        plates: list[tuple[str, ...]] = []
        for top, own in chain([(0.0, ())], self._floors()):
            plates.append(tuple(f"{top:g}, corner {i}" for i in range(4)))
            for name, (i, k) in zip(plates[-1], ((-1, -1), (1, -1), (1, 1), (-1, 1)), strict=True):
                x, y = i * half_x, k * half_y
                nodes[name] = (x, y, top)
                moving[name] = _point_of_floor(own, x, y)
        heights = self.heights()
        for label, spring in zip(self.appendages, self._carried.own_springs, strict=True):
            height = float(np.interp(heights[label], range(len(levels)), levels))
            nodes[label] = (0.0, 0.0, height)
            in_y = any(self.degrees_of_freedom[row].endswith(" y") for row in spring.vector)
            moving[label] = ((), ((label, 1.0),)) if in_y else (((label, 1.0),),)
        columns = (ends for pair in pairwise(plates) for ends in zip(*pair, strict=True))
        return Geometry(nodes, tuple(columns), faces=tuple(plates)), moving

    def sensor_location(self, sensor: str) -> Location | None:
        """See :meth:`Structure.sensor_location`; on its line of measurement, nearest the centre."""
        (motion,) = self.sensor_motions([sensor])
        for level, own in self._floors():
            x, y, turn = (*(motion.get(label, 0.0) for label in own), 0.0, 0.0)[:3]
            if set(motion) <= set(own) and (size := math.hypot(x, y)):
                return Location((turn * y, -turn * x, level), (x / size, y / size, 0.0))
        return super().sensor_location(sensor)

    def modal_model(self, values: FloatArray) -> ModalModel:
        """See :meth:`Structure.modal_model`; the influence of ground motion is known."""
        modes, mass = self.modes(values), self._mass.evaluate(values)
        if mass.ndim == 2:
            product = mass[:, :, None] * modes.shapes
        else:
            # As in the modal model, sums are not to depend on the layout of a batch.
            mass, shapes = map(np.ascontiguousarray, (mass, modes.shapes))
            product = np.einsum("bij,bjm->bim", mass, shapes)
        return modal_model(modes, product, self.influence())

    def main_influence(self) -> Sequence[float]:
        """Displacement of every main degree of freedom when the ground moves by 1: 1 each."""
        return [1.0] * len(self.main_degrees_of_freedom())

    def influence(self) -> FloatArray:
        """Influence as in :class:`ModalModel`, (n_dof,); springs of appendages stay at rest."""
        return self._carried.influence(np.array(self.main_influence()))

    def matrices(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stiffness (B, n, n) and mass, which is its diagonal (B, n) where all else is zero.

        An array that depends on no parameter has a first dimension of 1.
        """
        return self._stiffness.evaluate(values), self._mass.evaluate(values)

    @cached_property
    def _carried(self) -> CarriedElements:
        main = self.main_degrees_of_freedom()
        return CarriedElements.of(self.elements, self.rows_of, len(main), taken=main)

    @cached_property
    def _terms(self) -> tuple[list[AddedTerm], list[AddedTerm]]:
        """Springs and masses, of the main structure and then of the elements."""
        springs = [AddedTerm.of(term, self.rows_of, "spring") for term in self.main_springs()]
        masses = [AddedTerm.of(term, self.rows_of, "mass") for term in self.main_masses()]
        return [*springs, *self._carried.springs], [*masses, *self._carried.masses]

    @cached_property
    def _stiffness(self) -> AffineArray:
        return self._sum_of_squares(self._terms[0])

    @cached_property
    def _mass(self) -> AffineArray:
        full = self._sum_of_squares(self._terms[1])
        if (full.arrays * (1.0 - np.eye(full.arrays.shape[1]))).any():
            return full
        # Off-diagonal terms may be absent, or cancel each other.
        return AffineArray(full.table, np.array([array.diagonal() for array in full.arrays]))

    def _sum_of_squares(self, terms: Sequence[AddedTerm]) -> AffineArray:
        """The sum of c w wᵀ, (B, n, n)."""
        n = len(self.degrees_of_freedom)

        def square(term: AddedTerm) -> FloatArray:
            w = np.zeros(n)
            w[list(term.vector)] = list(term.vector.values())
            return np.outer(w, w)

        return AffineArray.of([(t.coefficient, square(t)) for t in terms], self.parameters, (n, n))

    def _rigid_motions(self) -> dict[str, dict[str, float]]:
        motions = {}
        for element in self.elements:
            if isinstance(element, AddedMass) and element.stands_for:
                shares = (motion_of(place, share) for place, share in element.shares)
                vector = self._vector(tuple(chain.from_iterable(shares)))
                named = zip(self.degrees_of_freedom, vector.tolist(), strict=True)
                motions[element.stands_for] = {name: own for name, own in named if own != 0.0}
        return motions

    def _vector(self, motion: Motion) -> FloatArray:
        """v (n,) of the displacement ``v·x = Σ share · x(place)``."""
        vector = np.zeros(len(self.degrees_of_freedom))
        for place, share in motion:
            for row, component in self.rows_of(place, "element"):
                vector[row] += share * component
        return vector

    def rows_of(self, place: SinglePlace, label: str) -> list[tuple[int, float]]:
        """Rows of a floor, degree of freedom or sensor, and their shares."""
        sensors = {sensor.label: sensor.motion for sensor in self.sensors}
        motion: Motion = sensors.get(str(place), ((place, 1.0),))
        return [(self._index(one, label), share) for one, share in motion if one != 0]

    def _index(self, place: SinglePlace, label: str) -> int:
        """The degree of freedom at a place that is not the ground."""
        if isinstance(place, int) and 1 <= place <= len(self.main_degrees_of_freedom()):
            return place - 1
        if place in self.degrees_of_freedom:
            return self.degrees_of_freedom.index(str(place))
        raise ValueError(
            f"{label}: the structure has no place {place!r}; choose a floor from 1 to "
            f"{len(self.main_degrees_of_freedom())}, or 0 for the ground"
        )


def _point_of_floor(labels: Sequence[str], x: float, y: float) -> Motions:
    """How a point of a floor moves along x and y: u, or (u - y θ, v + x θ)."""
    if len(labels) < 3:
        return tuple(((label, 1.0),) for label in labels)
    u, v, turn = labels
    return ((u, 1.0), (turn, -y)), ((v, 1.0), (turn, x))


@dataclass(frozen=True)
class ShearBuilding(LumpedStructure):
    """A planar shear building on a fixed base; floors are labelled ``"floor 1"`` upwards.

    Masses and stiffnesses are in consistent units (kg and N/m, say), each a number, a Parameter
    or a number times a Parameter.

    Attributes:
        masses: of the floors, from the lowest.
        stiffnesses: of the storeys, from the lowest; storey i stands below floor i.
        elements: non-structural elements on it; :meth:`with_element` adds one.
        sensors: not at degrees of freedom; :meth:`with_sensors` adds some.

    Raises:
        ValueError: their numbers differ, or one of them can be zero or negative.
        TypeError: one of them is neither a number nor a Parameter.

    >>> k = (2 * np.pi) ** 2
    >>> frame = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(k, k))
    >>> frame.modes(np.empty((1, 0))).frequencies_hz.round(3)
    array([[0.618, 1.618]])
    """

    masses: tuple[Value, ...]
    stiffnesses: tuple[Value, ...]

    def __post_init__(self) -> None:
        self._check_storeys()
        super().__post_init__()

    def main_degrees_of_freedom(self) -> Sequence[str]:
        return [f"floor {i}" for i in range(1, len(self.masses) + 1)]

    def main_springs(self) -> Sequence[Contribution]:
        return [
            Contribution(as_product(stiffness), ((floor - 1, -1.0), (floor, 1.0)))
            for floor, stiffness in enumerate(self.stiffnesses, 1)
        ]

    def main_masses(self) -> Sequence[Contribution]:
        masses = map(as_product, self.masses)
        return [Contribution.on(floor, mass) for floor, mass in enumerate(masses, 1)]
