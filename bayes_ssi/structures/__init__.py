"""Structural models: each answers one question, modes for a batch of parameter values."""

from bayes_ssi.structures.base import Structure
from bayes_ssi.structures.elements import (
    AddedMass,
    Element,
    InPlaneInfill,
    OutOfPlaneInfill,
    Pendulum,
)
from bayes_ssi.structures.function import FunctionStructure
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.matrices import MatrixStructure
from bayes_ssi.structures.matrix_files import read_matrix
from bayes_ssi.structures.reduced import ReducedStructure
from bayes_ssi.structures.rigid_floors import FloorBlock, FloorMass, RigidFloors, floor_sensor
from bayes_ssi.structures.shear_building import ShearBuilding
from bayes_ssi.structures.shear_building_3d import ShearBuilding3D
from bayes_ssi.structures.space_frame import SpaceFrame

__all__ = [
    "AddedMass",
    "Element",
    "FloorBlock",
    "FloorMass",
    "FunctionStructure",
    "InPlaneInfill",
    "LumpedStructure",
    "MatrixStructure",
    "OutOfPlaneInfill",
    "Pendulum",
    "ReducedStructure",
    "RigidFloors",
    "ShearBuilding",
    "ShearBuilding3D",
    "SpaceFrame",
    "Structure",
    "floor_sensor",
    "read_matrix",
]
