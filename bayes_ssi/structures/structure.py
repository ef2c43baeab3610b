"""The abstract structure: its modes for a batch of parameter values."""

# ruff: noqa: ARG002 - arguments of defaults, for subclasses

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from functools import wraps
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.foundations.error_places import rows_at_fault
from bayes_ssi.parameters.parameters import Parameter, checked_values, values_at
from bayes_ssi.structures.elements import AddedMass, Element
from bayes_ssi.structures.geometry import (
    DIRECTIONS,
    Candidate,
    Drawing,
    Geometry,
    Location,
    Place,
    Sensor,
    SensorMatrix,
    SinglePlace,
    drawn_at,
    motion_of,
    stick,
)
from bayes_ssi.structures.matrix_terms import CarriedElements
from bayes_ssi.structures.modal import ModalModel, Modes

T = TypeVar("T")


class Accuracy(NamedTuple):
    """How far approximate modes may be from the exact ones, shapes at unit length."""

    frequency: float
    shape: float
    statement: str
    of_shapes: str = ""  # how it goes on where shapes are compared with identified ones


class Requirement(NamedTuple):
    """Where the modes of a structure must be accurate, and how accurate."""

    values: FloatArray  # (B, n_parameters)
    frequency: float  # largest error, as a fraction
    shape: float  # largest error at unit length
    n_modes: int = 0  # number of lowest modes that must be; all if 0


def _of_checked_values(method: Callable[[Any, FloatArray], T]) -> Callable[[Any, ArrayLike], T]:
    """A method of a structure, which first checks the values that it takes."""

    @wraps(method)
    def call(self: Structure, values: ArrayLike) -> T:
        where = f"{type(self).__name__}.{method.__name__}: values"
        return method(self, checked_values(values, self.parameters, where))

    return call


class Structure(ABC):
    """A structure with uncertain parameters.

    Likelihood, calibration, sampling, searches and reports use these members alone and do not know
    how modes are computed. The first four are abstract; :meth:`modal_model` is needed for
    responses, :meth:`with_element` and :meth:`require_place` for searches.

    The values that a subclass's own methods take are checked before they get them.
    """

    # Sensors that do not measure a single degree of freedom, with their own labels.
    sensors: Sequence[Sensor] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        for name in ("modes", "modal_model"):
            if name in cls.__dict__:
                setattr(cls, name, _of_checked_values(cls.__dict__[name]))

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The inferred parameters in order of first appearance, the columns of ``values``."""

    @property
    @abstractmethod
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """Labels of the degrees of freedom, the rows of a mode shape."""

    @property
    @abstractmethod
    def n_modes(self) -> int:
        """Number of modes that :meth:`modes` returns."""

    @abstractmethod
    def modes(self, values: FloatArray) -> Modes:
        """Frequencies (B, n_modes) in Hz and shapes (B, n_dof, n_modes) for ``values``.

        Args:
            values: (B, n_parameters), columns as in :attr:`parameters`.

        Row i of the answer must depend on row i of ``values`` alone, to the last digit, since a
        batch may be evaluated in parts. Where there are no modes, return NaN or raise: a row that
        raises counts as failed, and the others are evaluated without it.

        Raises:
            ValueError: ``values`` do not have two dimensions and these columns.
            TypeError: they are not numbers.
        """

    @property
    def shape_variances(self) -> Mapping[int, float]:
        """Mode, from 0 → squared sd of its unit shape, of modes whose shapes are not computed."""
        return {}

    def modes_or_nan(self, values: FloatArray) -> Modes:
        """:meth:`modes` at ``values`` (B, n_parameters); NaN in rows at which they raise."""

        def modes(rows: slice) -> Modes:
            own = values[rows]
            return Modes(*self.modes(own)).repeated(len(own))

        shape = (1, len(self.degrees_of_freedom), self.n_modes)
        none = Modes(np.full((1, self.n_modes), np.nan), np.full(shape, np.nan))
        solved = rows_at_fault(modes, len(values))
        parts = [none if isinstance(part, Exception) else part for _, part in solved]
        return parts[0] if len(parts) == 1 else joined(parts)

    def modal_model(self, values: FloatArray) -> ModalModel:
        """The modes at unit modal mass, and how the ground's motion drives them.

        :func:`~bayes_ssi.structures.modal.modal_model` computes it from modes in any scale and the
        product of the mass matrix with them. Rows are as in :meth:`modes`.

        Args:
            values: (B, n_parameters), columns as in :attr:`parameters`.

        Raises:
            TypeError: the structure does not know its masses.
        """
        raise TypeError(
            f"structure {type(self).__name__} gives frequencies and shapes but no masses, so its "
            "response cannot be computed; give it a method modal_model(values), as described in "
            "bayes_ssi.Structure"
        )

    @checked
    def with_sensors(self, sensors: Iterable[Sensor]) -> Self:
        """This structure with more sensors.

        Args:
            sensors: their motions are in terms of :attr:`degrees_of_freedom`, for instance 0.5 each
                of two for a point halfway, or cosines for a direction.

        Raises:
            ValueError: a label is that of another sensor or of a degree of freedom, or a sensor
                measures a degree of freedom that the structure does not have.
        """
        whole = copy(self)
        object.__setattr__(whole, "sensors", (*self.sensors, *sensors))
        whole._check_sensors()
        return whole

    @checked
    def sensor_matrix(self, sensors: Sequence[str], what: str = "sensor") -> SensorMatrix:
        """The sensor matrix of some of :attr:`sensors`, or degrees of freedom by their labels.

        Args:
            sensors: names of the sensors.
            what: what they are called in messages.

        Raises:
            ValueError: a name is unknown, or one of :attr:`sensors` is not on this structure.
        """
        labels = self.degrees_of_freedom
        known = set(labels)
        motions = self.sensor_motions(sensors)
        for name, motion in zip(sensors, motions, strict=True):
            if not known.issuperset(motion):
                combined = (*self._rigid_motions(), *(sensor.label for sensor in self.sensors))
                choices = labels if name in combined else (*combined, *labels)
                missing = f"{what} {name!r}: the structure has no degree of freedom"
                require_known(missing, motion, choices)
        return SensorMatrix(motions, labels)

    def sensor_motions(self, sensors: Iterable[str]) -> list[Mapping[str, float]]:
        """What each of these sensors measures: degree of freedom → share."""
        combined: dict[str, Mapping[str, float]] = {
            **self._rigid_motions(),
            **{sensor.label: dict(sensor.motion) for sensor in self.sensors},
        }
        return [combined.get(name, {name: 1.0}) for name in sensors]

    def _check_sensors(self) -> None:
        """Refuse sensors whose label is taken, or that measure what the structure does not have."""
        labels = Counter((*self.degrees_of_freedom, *(sensor.label for sensor in self.sensors)))
        for sensor in self.sensors:
            if labels[sensor.label] > 1:
                raise ValueError(
                    f"sensor {sensor.label!r}: another sensor or degree of freedom has that label"
                )
        self.sensor_matrix([sensor.label for sensor in self.sensors])

    def _rigid_motions(self) -> dict[str, dict[str, float]]:
        """Motions of sensors on appendages that are there as masses alone."""
        return {}

    # How fast and how exactly modes are computed.

    # Whether a batch of rows takes microseconds a row, in one process.
    is_cheap: ClassVar[bool] = False
    # Whether rows are solved one after the other, so that workers can share a batch.
    is_solved_by_rows: ClassVar[bool] = False
    # Whether modes approximate those of another structure, :attr:`exact`.
    is_approximate: ClassVar[bool] = False
    has_exact: ClassVar[bool] = True  # solutions, where it is approximate

    @property
    def performance_hint(self) -> str:
        """Advice on sampling it much faster, as a sentence; empty where it is fast enough."""
        return ""

    @property
    def n_rigid_modes(self) -> int:
        """Number of rigid-body modes, which are left out of :attr:`modes`."""
        return 0

    @property
    def exact(self) -> Structure:
        """The structure whose modes this one approximates; itself where it approximates none."""
        return self

    def confirming(self, values: FloatArray) -> Structure:
        """What shows the error of its modes at ``values`` (B, n): :attr:`exact`, or nearly so."""
        return self.exact

    @property
    def emulator(self) -> Any:
        """The fit that approximates the modes, for results to store; None where there is none."""
        return None

    def accurate_at(self, required: Requirement) -> Self:
        """This structure if it is accurate enough, otherwise a more accurate one."""
        return self

    def accuracy(self, values: FloatArray, n_modes: int | None = None) -> Accuracy:
        """The largest errors of the lowest ``n_modes`` at all of ``values`` (B, n_parameters)."""
        return Accuracy(0.0, 0.0, "its modes are exact")

    def compact(self, values: FloatArray) -> Self:
        """This structure in a smaller basis, if it has one, accurate at ``values`` (B, n)."""
        return self

    def projected(self, values: FloatArray, places: Iterable[SinglePlace]) -> Structure:
        """As :meth:`compact` at ``values``, smaller still and not certified, for many hypotheses.

        Elements can be put on ``places``, single degrees of freedom and sensors, alone.
        """
        return self

    @property
    def for_many_hypotheses(self) -> Structure:
        """This structure, or the same in a reduced basis where solving it takes longer."""
        return self

    # What elements are put on, and what a search needs for that.

    @property
    def carries_elements(self) -> bool:
        """Whether elements can be put on it."""
        return type(self).with_element is not Structure.with_element

    def with_element(self, element: Element) -> Self:
        """This structure with one more element on it.

        Raises:
            TypeError: this kind of structure carries none.
            ValueError: the element's place is not on the structure, or its label is taken.
        """
        raise TypeError(
            f"{type(self).__name__}: it carries no elements, got {element.label!r}; use a "
            "structure that knows its matrices, such as a ShearBuilding or MatrixStructure"
        )

    def require_place(self, place: Place, label: str) -> None:
        """Refuse a place that is not on the structure.

        Raises:
            ValueError: it is not; the message begins with ``label``.
        """
        raise ValueError(f"{label}: {type(self).__name__} carries no elements, got {place!r}")

    def candidates(self, sensors: Sequence[str]) -> tuple[Candidate, ...]:
        """Where a search hangs appendages unless it is given places: where the sensors are."""
        motions = {sensor.label: dict(sensor.motion) for sensor in self.sensors}
        places = [place for sensor in sensors for place in motions.get(sensor, (sensor,))]
        return tuple(Candidate(place, place) for place in dict.fromkeys(places))

    def mean_floor_mass(self) -> float | None:
        """At the prior medians, in the structure's unit; None of a structure without floors."""
        return None

    def place_shapes(self, places: Sequence[Place], values: FloatArray) -> FloatArray | None:
        """Motions of places in the modes (n_places, n_modes), at one row of ``values``.

        As in :meth:`modes`, at unit modal mass; None where they are known at the sensors alone.
        """
        return None

    def place_masses(self, places: Sequence[Place]) -> FloatArray:
        """Masses (n_places,) that can leave places for appendages there, at the prior medians.

        M - m w wᵀ is positive definite for m below 1 / (wᵀ M⁻¹ w). Zero where that is not known.
        """
        return np.zeros(len(places))

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """Labels (n), frequencies (m,) and shapes (n, m) at all that has a label, at one row."""
        frequencies, shapes = (each[0] for each in self.modes(values[None]))
        return self.degrees_of_freedom, frequencies, shapes

    @property
    def given_as_mass(self) -> tuple[AddedMass, ...]:
        """The elements on it that stand for appendages, which may vibrate."""
        elements = getattr(self, "elements", ())
        return tuple(one for one in elements if isinstance(one, AddedMass) and one.stands_for)

    @property
    def appendages(self) -> tuple[str, ...]:
        """The degrees of freedom outside the main structure, which drawings mark."""
        return ()

    def heights(self) -> dict[str, float]:
        """Degree of freedom → its height in a drawing, in storeys above the ground."""
        return {label: float(i) for i, label in enumerate(self.degrees_of_freedom, 1)}

    @property
    def geometry(self) -> Geometry | None:
        """Where its nodes are, for drawings in space; None if not known."""
        return None

    def location_of(self, place: Place) -> Location | None:
        """Where a place of an element is, and in which direction it moves; None if not known."""
        return self.geometry.location(motion_of(place)) if self.geometry else None

    def drawing(self) -> Drawing:
        """Nodes to draw in space, and how each moves by degrees of freedom."""
        if self.geometry is None:
            return stick(self.degrees_of_freedom)
        along = {
            node: tuple(((f"{node} {direction}", 1.0),) for direction in DIRECTIONS)
            for node in self.geometry.nodes
        }
        return self.geometry, along

    def sensor_location(self, sensor: str) -> Location | None:
        """Where a sensor is on :meth:`drawing`, and in which direction it measures, if known."""
        motion = tuple(self.sensor_motions([sensor])[0].items())
        return self.location_of(motion) if self.geometry else drawn_at(self.drawing(), motion)

    def description(self) -> Mapping[str, Any]:
        """Description for reports if it is not a dataclass.

        Name → numbers, products, text or elements.
        """
        return {}

    def prior_medians(self) -> FloatArray:
        """Every parameter at its prior median, as one row of ``values`` (1, n_parameters)."""
        return np.array([[p.prior.quantile(0.5) for p in self.parameters]])


class CarryingStructure(Structure):
    """A structure with elements at its own rows and those that they add."""

    @property
    @abstractmethod
    def _carried(self) -> CarriedElements: ...

    @abstractmethod
    def rows_of(self, place: SinglePlace, label: str) -> list[tuple[int, float]]:
        """Rows of a place, which move with these shares; none of the ground.

        Raises:
            ValueError: there is no such place; the message begins with ``label``.
        """

    @property
    def appendages(self) -> tuple[str, ...]:
        return self._carried.labels

    def require_place(self, place: Place, label: str) -> None:
        for single, _ in motion_of(place):
            if single not in self.appendages:
                self.rows_of(single, label)


def _as_substituted(name: str) -> Any:
    """An attribute or method of a substitute that is the other structure's."""
    return property(lambda self: getattr(self.substituted, name))


class SubstituteStructure(Structure):
    """A structure that stands for another one, and answers as that does but for its modes."""

    @property
    @abstractmethod
    def substituted(self) -> Structure:
        """The other one."""

    parameters = _as_substituted("parameters")
    degrees_of_freedom = _as_substituted("degrees_of_freedom")
    n_modes = _as_substituted("n_modes")
    n_rigid_modes = _as_substituted("n_rigid_modes")
    sensors = _as_substituted("sensors")
    appendages = _as_substituted("appendages")
    geometry = _as_substituted("geometry")
    heights = _as_substituted("heights")
    description = _as_substituted("description")
    labelled_modes = _as_substituted("labelled_modes")
    shape_variances = _as_substituted("shape_variances")
    location_of = _as_substituted("location_of")
    drawing = _as_substituted("drawing")
    sensor_location = _as_substituted("sensor_location")
    place_masses = _as_substituted("place_masses")
    given_as_mass = _as_substituted("given_as_mass")

    def modal_model(self, values: FloatArray) -> ModalModel:
        return self.substituted.modal_model(values)


class ApproximateStructure(SubstituteStructure):
    """A structure whose modes approximate those of another one, :attr:`exact`.

    Sampling refines it where the posterior lies, and corrects the evidence by exact solutions
    (:mod:`bayes_ssi.inference.posterior_sampling.refinement`).
    """

    is_cheap = True
    is_approximate = True

    @property
    def substituted(self) -> Structure:
        return self.exact

    @property
    @abstractmethod
    def exact(self) -> Structure: ...

    def advice(self, required: Requirement) -> str:
        """How it becomes as accurate as required."""
        return "allow it more full solutions"

    def prior_points(self, n_points: int, tail: float, seed: int = 0) -> FloatArray:
        """The prior medians, and Sobol points that fill the prior evenly, (1 + n, n_parameters).

        Values of each parameter with the probability ``tail`` at either end are cut off.
        """
        from scipy.special import ndtri
        from scipy.stats import qmc

        d = len(self.parameters)
        if not d:
            return self.prior_medians()
        sequence = qmc.Sobol(d, rng=np.random.default_rng(seed))
        uniform = sequence.random_base2((n_points - 1).bit_length())[:n_points]
        z = ndtri(np.clip(uniform, tail, 1.0 - tail))
        return np.vstack([self.prior_medians(), values_at(self.parameters, z)])
