"""Sensors at points and in directions between the degrees of freedom of a structure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from copy import copy
from typing import Self

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.structures.sensors import Sensor
from bayes_ssi.structures.structure import Structure


class CombinedSensors(Structure):
    """A structure that takes sensors which combine its degrees of freedom."""

    _combined: tuple[Sensor, ...] = ()

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """Sensors that do not measure a single degree of freedom, with their own labels."""
        return self._combined

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
        whole._combined = (*self._combined, *sensors)
        labels = Counter((*self.degrees_of_freedom, *(each.label for each in whole._combined)))
        for each in whole._combined:
            if labels[each.label] > 1:
                raise ValueError(
                    f"sensor {each.label!r}: another sensor or degree of freedom has that label"
                )
        whole.sensor_matrix([each.label for each in whole._combined])
        return whole

    def _described_sensors(self) -> dict[str, str]:
        """A line of a description; none where there are no such sensors."""
        if not self._combined:
            return {}
        texts = (
            f"{each.label} = " + " + ".join(f"{share:g} {place}" for place, share in each.motion)
            for each in self._combined
        )
        return {"combined sensors": "; ".join(texts)}
