"""The public names of the package, all of which ``import bayes_ssi`` offers."""

from bayes_ssi.inference.calibration.calibration import calibrate
from bayes_ssi.inference.calibration.fit import rms_distance
from bayes_ssi.inference.calibration.modal_sensitivities import modal_sensitivities
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.sample import sample
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.merging import merge_modal_data
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.modal_files import read_modal_data, write_modal_data
from bayes_ssi.measurements.modes.modal_tools import modal_data_from_pyoma2
from bayes_ssi.measurements.records.ground_motion_files import read_ground_motion
from bayes_ssi.measurements.records.modal_identification import identify
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.record_files import read_record
from bayes_ssi.parameters.families import (
    HalfNormal,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.report.write import write_report
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy, load_hierarchy, save_hierarchy
from bayes_ssi.results.hierarchy.populations import PopulationPriors
from bayes_ssi.results.hierarchy.ranked_populations import hierarchy
from bayes_ssi.results.predictions.predicted_frequencies import predict_frequencies
from bayes_ssi.results.predictions.stored_predictions import load_predictions
from bayes_ssi.results.stored_result import load_result, save_result
from bayes_ssi.results.stored_what_if import what_if
from bayes_ssi.structures.elements import AddedMass, InPlaneInfill, OutOfPlaneInfill, Pendulum
from bayes_ssi.structures.finite_elements.function_structure import FunctionStructure
from bayes_ssi.structures.finite_elements.matrix_files import read_matrix
from bayes_ssi.structures.finite_elements.matrix_structure import MatrixStructure
from bayes_ssi.structures.geometry import Candidate, Geometry
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.response.ground_motion import GroundMotion
from bayes_ssi.structures.response.output import Output
from bayes_ssi.structures.rigid_floors import FloorBlock, FloorMass, floor_sensor
from bayes_ssi.structures.sensors import Sensor
from bayes_ssi.structures.shear_buildings import ShearBuilding, ShearBuilding3D
from bayes_ssi.structures.solver_files.exported_model import ExportedModel
from bayes_ssi.structures.solver_files.model_files import read_model
from bayes_ssi.structures.solver_files.parameter_matrices import (
    AlteredModel,
    parameter_matrices,
)
from bayes_ssi.structures.space_frame import SpaceFrame
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.appendage_search import search
from bayes_ssi.studies.appendages.candidates import read_candidates
from bayes_ssi.studies.appendages.ranked_study import rank
from bayes_ssi.studies.appendages.search_settings import SearchSettings
from bayes_ssi.studies.ranking.changed_settings import ChangedSettings
from bayes_ssi.studies.ranking.comparison import compare
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.ranking.study_file import load_study

__all__ = [
    "AddedMass",
    "AlteredModel",
    "Candidate",
    "ChangedSettings",
    "Configuration",
    "ErrorModel",
    "ExportedModel",
    "FloorBlock",
    "FloorMass",
    "FunctionStructure",
    "Geometry",
    "GroundMotion",
    "HalfNormal",
    "Hierarchy",
    "IdentificationModel",
    "IdentifiedMode",
    "InPlaneInfill",
    "LogNormal",
    "LogUniform",
    "MatrixStructure",
    "ModalData",
    "ModelClass",
    "Modes",
    "Normal",
    "OutOfPlaneInfill",
    "Output",
    "Parameter",
    "Pendulum",
    "PopulationPriors",
    "Posterior",
    "Record",
    "Run",
    "SamplingSettings",
    "SearchSettings",
    "Sensor",
    "ShearBuilding",
    "ShearBuilding3D",
    "SpaceFrame",
    "Structure",
    "Study",
    "TruncatedNormal",
    "Uniform",
    "calibrate",
    "compare",
    "floor_sensor",
    "hierarchy",
    "identify",
    "load_hierarchy",
    "load_predictions",
    "load_result",
    "load_study",
    "merge_modal_data",
    "modal_data_from_pyoma2",
    "modal_sensitivities",
    "parameter_matrices",
    "predict_frequencies",
    "rank",
    "read_candidates",
    "read_ground_motion",
    "read_matrix",
    "read_modal_data",
    "read_model",
    "read_record",
    "rms_distance",
    "sample",
    "save_hierarchy",
    "save_result",
    "search",
    "what_if",
    "write_modal_data",
    "write_report",
]
