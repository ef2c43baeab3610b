"""Structural models: each answers one question, modes for a batch of parameter values."""

from bayes_ssi.structures.elements import (
    AddedMass,
    Element,
    InPlaneInfill,
    OutOfPlaneInfill,
    Pendulum,
)
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.rigid_floors import FloorBlock, FloorMass, RigidFloors, floor_sensor
from bayes_ssi.structures.shear_building import ShearBuilding
from bayes_ssi.structures.shear_building_3d import ShearBuilding3D
from bayes_ssi.structures.space_frame import SpaceFrame
from bayes_ssi.structures.structure import Structure

__all__ = [
    "AddedMass",
    "Element",
    "FloorBlock",
    "FloorMass",
    "InPlaneInfill",
    "LumpedStructure",
    "OutOfPlaneInfill",
    "Pendulum",
    "RigidFloors",
    "ShearBuilding",
    "ShearBuilding3D",
    "SpaceFrame",
    "Structure",
    "floor_sensor",
]
