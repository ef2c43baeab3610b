"""What a reduced basis needs of a finite-element model."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.finite_elements.sparse_modes import DENSE_UP_TO
from bayes_ssi.modal import Eigenpairs
from bayes_ssi.structures.structure import Structure

__all__ = ["ReducibleStructure", "System"]


class System(NamedTuple):
    """The matrices of a model, with their rows in an order that keeps factors sparse.

    Attributes:
        stiffness, mass: in that order.
        sensor_rows: rows of the sensors.
        influence: (n,), how every degree of freedom follows the ground; None if not known.
    """

    stiffness: AffineMatrix
    mass: AffineMatrix
    sensor_rows: NDArray[np.intp]
    influence: FloatArray | None


class ReducibleStructure(Structure):
    """A model whose matrices are sums of fixed ones times products of parameters."""

    @property
    @abstractmethod
    def system(self) -> System:
        """The matrices."""

    @abstractmethod
    def full_modes(self, values: FloatArray, extra: int = 0) -> Eigenpairs:
        """A full solution at ``values`` (n_parameters,), rows as in :attr:`system`.

        It has ``extra`` modes more than :attr:`n_modes`, where the model has so many.

        Raises:
            NoModesError: there are fewer than :attr:`n_modes`, or they cannot be counted.
        """

    @property
    @abstractmethod
    def size(self) -> int:
        """How many degrees of freedom the matrices have."""

    def require_influence(self) -> FloatArray:
        """How degrees of freedom follow the ground (n,), rows as in :attr:`system`.

        Raises:
            TypeError: it is not known.
        """
        if self.system.influence is None:
            raise TypeError(
                f"{type(self).__name__}: how its degrees of freedom follow the ground is not "
                "known, so its response cannot be computed; give influence=, one number a degree "
                "of freedom (1 for a displacement in the direction of the ground motion, else 0)"
            )
        return self.system.influence

    @property
    def performance_hint(self) -> str:
        """How it would be sampled much faster, as a sentence; empty where it is fast enough."""
        if self.size <= DENSE_UP_TO:
            return ""
        return (
            f"{self.size} degrees of freedom, solved in full tens of thousands of times; "
            f"{type(self).__name__}.reduced() needs dozens of full solutions"
        )
