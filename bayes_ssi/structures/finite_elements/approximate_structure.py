"""Structures that approximate others with known accuracy."""

from __future__ import annotations

from abc import abstractmethod

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.motion import Place
from bayes_ssi.structures.structure import Structure


class ApproximateStructure(Structure):
    """A structure whose modes approximate those of another one with the same parameters.

    Sampling refines it where the posterior lies, and corrects the evidence by exact solutions
    (:mod:`bayes_ssi.inference.posterior_sampling.refinement`).
    """

    is_cheap = True
    is_approximate = True

    @property
    @abstractmethod
    def exact(self) -> Structure: ...

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
    def n_rigid_modes(self) -> int:
        return self.exact.n_rigid_modes

    @property
    def geometry(self) -> Geometry | None:
        return self.exact.geometry

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        return self.exact.labelled_modes(values)

    def location_of(self, place: Place) -> Location | None:
        return self.exact.location_of(place)
