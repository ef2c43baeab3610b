"""Structures that approximate others with known accuracy."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple, Self

from bayes_ssi.arrays import FloatArray
from bayes_ssi.parameters import Parameter
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.motion import Place
from bayes_ssi.structures.structure import Structure


class Accuracy(NamedTuple):
    """How far the modes of an approximate structure may be from the exact ones.

    Attributes:
        shape: error of shapes at unit length.
    """

    frequency: float
    shape: float
    statement: str


class ApproximateStructure(Structure):
    """A structure whose modes approximate those of another one with the same parameters.

    Sampling refines it where the posterior lies, and corrects the evidence by exact solutions
    (:mod:`bayes_ssi.posterior.refinement`).
    """

    @property
    @abstractmethod
    def exact(self) -> Structure:
        """The structure that this one approximates."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.exact.parameters

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return self.exact.degrees_of_freedom

    @property
    def n_modes(self) -> int:
        return self.exact.n_modes

    @property
    def geometry(self) -> Geometry | None:
        return self.exact.geometry

    def location_of(self, place: Place) -> Location | None:
        return self.exact.location_of(place)

    @abstractmethod
    def accurate_at(
        self,
        values: FloatArray,
        frequency_error: float,
        shape_error: float,
        n_modes: int | None = None,
    ) -> Self:
        """This structure if it is accurate enough, otherwise a more accurate one.

        Args:
            values: (B, n_parameters), where it must be accurate.
            shape_error: largest error of shapes at unit length.
            n_modes: number of lowest modes that must be; all if None.
        """

    def with_solutions_at(self, values: FloatArray) -> Self:  # noqa: ARG002 - for subclasses
        """This structure with the exact solutions at ``values`` (B, n_parameters) made use of.

        They are known already. Where the error is certified, they are not needed.
        """
        return self

    @abstractmethod
    def accuracy(self, values: FloatArray, n_modes: int | None = None) -> Accuracy:
        """The largest errors of the lowest ``n_modes`` at all of ``values`` (B, n_parameters)."""
