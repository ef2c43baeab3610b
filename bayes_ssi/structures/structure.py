"""The question that every structure answers: modes for a batch of parameter values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.modal import ModalModel, Modes
from bayes_ssi.parameters import Parameter
from bayes_ssi.structures.sensors import Sensor, SensorMatrix

__all__ = ["Structure"]


# Valid choices that a message lists.
LABELS_SHOWN = 30


class Structure(ABC):
    """A structure with uncertain parameters.

    Everything above this class (likelihood, calibration, sampling, reports) asks only these
    questions and does not know how modes are computed. The first four must be answered;
    :meth:`modal_model` by those whose response is asked for.
    """

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The inferred parameters, in order of first appearance: the columns of ``values``."""

    @property
    @abstractmethod
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """Labels of the degrees of freedom: the rows of a mode shape."""

    @property
    @abstractmethod
    def n_modes(self) -> int:
        """How many modes :meth:`modes` returns."""

    @abstractmethod
    def modes(self, values: FloatArray) -> Modes:
        """Frequencies (B, n_modes) in Hz and shapes (B, n_dof, n_modes) for ``values``.

        Args:
            values: (B, n_parameters), columns as in :attr:`parameters`.

        Row i of the answer must depend on row i of ``values`` alone, to the last digit, since a
        batch may be evaluated in parts. Where there are no modes, give NaN, or raise: a row that
        raises counts as failed, and the others are evaluated without it.
        """

    def modal_model(self, values: FloatArray) -> ModalModel:  # noqa: ARG002 - no answer here
        """The modes at unit modal mass, and how the ground's motion drives them.

        All that a response needs; K and M stay inside. :func:`~bayes_ssi.modal.modal_model` makes
        the answer from modes in any scale and the product of the mass matrix with them. Rows as
        in :meth:`modes`.

        Args:
            values: (B, n_parameters), columns as in :attr:`parameters`.

        Raises:
            TypeError: the structure does not know its masses.
        """
        raise TypeError(
            f"structure {type(self).__name__} gives frequencies and shapes but no masses, so its "
            "response cannot be computed; give it a method modal_model(values), as described in "
            "bayes_ssi.structures.Structure"
        )

    @property
    def sensors(self) -> Sequence[Sensor]:
        """Sensors that are not simply on a degree of freedom; their labels are no label of one."""
        return ()

    def sensor_matrix(self, sensors: Sequence[str], what: str = "sensor") -> SensorMatrix:
        """What each sensor sees: one of :attr:`sensors`, or a degree of freedom by its label.

        Args:
            sensors: their names.
            what: they are called in messages.

        Raises:
            ValueError: a name is neither, or one of :attr:`sensors` is not on this structure.
        """
        labels = self.degrees_of_freedom
        known = set(labels)
        combined = {sensor.label: dict(sensor.motion) for sensor in self.sensors}
        motions = []
        for name in sensors:
            motion = combined.get(name, {name: 1.0})
            missing = [label for label in motion if label not in known]
            if missing and name not in combined:
                raise ValueError(
                    f"{what} {name!r}: the structure has no such degree of freedom"
                    f"{' or sensor' if combined else ''}; "
                    f"choose from {_listed((*combined, *labels))}"
                )
            if missing:
                raise ValueError(
                    f"{what} {name!r}: the structure has no degree of freedom {missing[0]!r}; "
                    f"choose from {_listed(labels)}"
                )
            motions.append(motion)
        return SensorMatrix.of(motions, labels)

    @property
    def appendages(self) -> tuple[str, ...]:
        """The degrees of freedom that are no part of the main structure; drawings mark them."""
        return ()

    def heights(self) -> dict[str, float]:
        """Degree of freedom → where a drawing puts it, in storeys above the ground."""
        return {label: float(i) for i, label in enumerate(self.degrees_of_freedom, 1)}

    def description(self) -> Mapping[str, Any]:
        """What reports tell of it, where it is no dataclass: a name → numbers, products or text."""
        return {}

    def prior_medians(self) -> FloatArray:
        """Every parameter at its prior median, as one row of ``values`` (1, n_parameters)."""
        return np.array([[p.prior.quantile(0.5) for p in self.parameters]])


def _listed(labels: Sequence[str]) -> str:
    """Labels for a message; the first ones where there are many."""
    shown = ", ".join(map(repr, labels[:LABELS_SHOWN]))
    more = len(labels) - LABELS_SHOWN
    return shown if more <= 0 else f"{shown} and {more} more"
