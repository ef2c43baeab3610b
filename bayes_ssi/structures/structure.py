"""The abstract structure: its modes for a batch of parameter values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.argument_types import checked
from bayes_ssi.arrays import FloatArray
from bayes_ssi.modal import ModalModel, Modes
from bayes_ssi.parameters import Parameter, checked_values
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.motion import Place, motion_of
from bayes_ssi.structures.sensors import Sensor, SensorMatrix

T = TypeVar("T")


class Structure(ABC):
    """A structure with uncertain parameters.

    Likelihood, calibration, sampling and reports use these members alone and do not know how
    modes are computed. The first four are abstract; :meth:`modal_model` is needed for responses.

    The values that a subclass's own methods take are checked before they get them.
    """

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

    def modal_model(self, values: FloatArray) -> ModalModel:  # noqa: ARG002 - raises
        """The modes at unit modal mass, and how the ground's motion drives them.

        :func:`~bayes_ssi.modal.modal_model` computes it from modes in any scale and the product
        of the mass matrix with them. Rows are as in :meth:`modes`.

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

    @property
    def sensors(self) -> Sequence[Sensor]:
        """Sensors that do not measure a single degree of freedom, with their own labels."""
        return ()

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
        combined = {
            **self._rigid_motions(),
            **{sensor.label: dict(sensor.motion) for sensor in self.sensors},
        }
        motions = [combined.get(name, {name: 1.0}) for name in sensors]
        for name, motion in zip(sensors, motions, strict=True):
            missing = next((label for label in motion if label not in known), None)
            if missing is not None:
                choices = labels if name in combined else (*combined, *labels)
                raise ValueError(
                    f"{what} {name!r}: the structure has no degree of freedom {missing!r}; "
                    f"choose from {listed(choices)}"
                )
        return SensorMatrix.of(motions, labels)

    def _rigid_motions(self) -> dict[str, dict[str, float]]:
        """Motions of sensors on appendages that are there as masses alone."""
        return {}

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

    def description(self) -> Mapping[str, Any]:
        """Description for reports if it is not a dataclass.

        Name → numbers, products, text or elements.
        """
        return {}

    def prior_medians(self) -> FloatArray:
        """Every parameter at its prior median, as one row of ``values`` (1, n_parameters)."""
        return np.array([[p.prior.quantile(0.5) for p in self.parameters]])


def _of_checked_values(method: Callable[[Any, FloatArray], T]) -> Callable[[Any, ArrayLike], T]:
    """A method of a structure, which first checks the values that it takes."""

    @wraps(method)
    def call(self: Structure, values: ArrayLike) -> T:
        where = f"{type(self).__name__}.{method.__name__}: values"
        return method(self, checked_values(values, self.parameters, where))

    return call


def listed(labels: Sequence[str], most: int = 30) -> str:
    """Labels for a message, shortened where there are many."""
    shown = ", ".join(map(repr, labels[:most]))
    return shown if len(labels) <= most else f"{shown} and {len(labels) - most} more"
