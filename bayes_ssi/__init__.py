"""Identified modes in, ranked model classes out.

Bayesian structural system identification for structures whose non-structural elements may
vibrate on their own and hide in the modal data.
"""

from bayes_ssi.calibration import calibrate, rms_distance
from bayes_ssi.comparison import compare
from bayes_ssi.configuration import Configuration
from bayes_ssi.data import IdentifiedMode, ModalData
from bayes_ssi.errors import ErrorModel, IdentificationModel
from bayes_ssi.model_class import ModelClass
from bayes_ssi.parameters import Parameter
from bayes_ssi.posterior import Posterior
from bayes_ssi.priors import HalfNormal, LogNormal, LogUniform, Normal, TruncatedNormal, Uniform
from bayes_ssi.reduction import sample
from bayes_ssi.sampling import SamplingSettings
from bayes_ssi.structures import (
    AddedMass,
    FloorMass,
    FunctionStructure,
    InPlaneInfill,
    MatrixStructure,
    OutOfPlaneInfill,
    Pendulum,
    ShearBuilding,
    ShearBuilding3D,
    read_matrix,
)
from bayes_ssi.study import Study, rank

__all__ = [
    "AddedMass",
    "Configuration",
    "ErrorModel",
    "FloorMass",
    "FunctionStructure",
    "HalfNormal",
    "IdentificationModel",
    "IdentifiedMode",
    "InPlaneInfill",
    "LogNormal",
    "LogUniform",
    "MatrixStructure",
    "ModalData",
    "ModelClass",
    "Normal",
    "OutOfPlaneInfill",
    "Parameter",
    "Pendulum",
    "Posterior",
    "SamplingSettings",
    "ShearBuilding",
    "ShearBuilding3D",
    "Study",
    "TruncatedNormal",
    "Uniform",
    "calibrate",
    "compare",
    "rank",
    "read_matrix",
    "rms_distance",
    "sample",
]
