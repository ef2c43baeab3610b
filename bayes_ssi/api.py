"""The public names of the package, all of which ``import bayes_ssi`` offers.

``as`` says to type checkers that a name is meant for others.
"""

import bayes_ssi.results.answer as _answer  # noqa: F401 - puts results into words
import bayes_ssi.results.identification_answer as _identification_answer  # noqa: F401
import bayes_ssi.results.plan_answer as _plan_answer  # noqa: F401
from bayes_ssi.inference.calibration.calibration import calibrate as calibrate
from bayes_ssi.inference.calibration.calibration import modal_sensitivities as modal_sensitivities
from bayes_ssi.inference.calibration.least_squares import rms_distance as rms_distance
from bayes_ssi.inference.likelihood.error_model import ErrorModel as ErrorModel
from bayes_ssi.inference.likelihood.error_model import IdentificationModel as IdentificationModel
from bayes_ssi.inference.model_class.configuration import Configuration as Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass as ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior as Posterior
from bayes_ssi.inference.posterior_sampling.sample import sample as sample
from bayes_ssi.inference.sampling.settings import SamplingSettings as SamplingSettings
from bayes_ssi.inference.workers.run import Run as Run
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode as IdentifiedMode
from bayes_ssi.measurements.modes.merging import merge_modal_data as merge_modal_data
from bayes_ssi.measurements.modes.modal_data import ModalData as ModalData
from bayes_ssi.measurements.modes.modal_files import read_modal_data as read_modal_data
from bayes_ssi.measurements.modes.modal_files import write_modal_data as write_modal_data
from bayes_ssi.measurements.modes.run_tables import read_runs as read_runs
from bayes_ssi.measurements.records.modal_identification import identify as identify
from bayes_ssi.measurements.records.record import Record as Record
from bayes_ssi.measurements.records.record_files import read_ground_motion as read_ground_motion
from bayes_ssi.measurements.records.record_files import read_record as read_record
from bayes_ssi.parameters.parameters import Parameter as Parameter
from bayes_ssi.parameters.priors import HalfNormal as HalfNormal
from bayes_ssi.parameters.priors import LogNormal as LogNormal
from bayes_ssi.parameters.priors import LogUniform as LogUniform
from bayes_ssi.parameters.priors import NearOne as NearOne
from bayes_ssi.parameters.priors import Normal as Normal
from bayes_ssi.parameters.priors import TruncatedNormal as TruncatedNormal
from bayes_ssi.parameters.priors import Uniform as Uniform
from bayes_ssi.report.write import write_report as write_report
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy as Hierarchy
from bayes_ssi.results.hierarchy.hierarchy_record import load_hierarchy as load_hierarchy
from bayes_ssi.results.hierarchy.hierarchy_record import save_hierarchy as save_hierarchy
from bayes_ssi.results.hierarchy.populations import PopulationPriors as PopulationPriors
from bayes_ssi.results.hierarchy.ranked_populations import hierarchy as hierarchy
from bayes_ssi.results.predictions.posterior_draws import predict_frequencies as predict_frequencies
from bayes_ssi.results.predictions.predictions import load_predictions as load_predictions
from bayes_ssi.results.predictions.requested_predictions import ResponseRequest as ResponseRequest
from bayes_ssi.results.predictions.requested_predictions import (
    predict_responses as predict_responses,
)
from bayes_ssi.results.stored_result import load_result as load_result
from bayes_ssi.results.stored_result import save_result as save_result
from bayes_ssi.results.stored_what_if import what_if as what_if
from bayes_ssi.structures.elements import AddedMass as AddedMass
from bayes_ssi.structures.elements import InPlaneInfill as InPlaneInfill
from bayes_ssi.structures.elements import OutOfPlaneInfill as OutOfPlaneInfill
from bayes_ssi.structures.elements import Pendulum as Pendulum
from bayes_ssi.structures.emulation.emulated_runs import EmulatedRuns as EmulatedRuns
from bayes_ssi.structures.finite_elements.function_structure import (
    FunctionStructure as FunctionStructure,
)
from bayes_ssi.structures.finite_elements.matrix_structure import MatrixStructure as MatrixStructure
from bayes_ssi.structures.finite_elements.model_arguments import read_matrix as read_matrix
from bayes_ssi.structures.geometry import Candidate as Candidate
from bayes_ssi.structures.geometry import Geometry as Geometry
from bayes_ssi.structures.geometry import Sensor as Sensor
from bayes_ssi.structures.lumped import ShearBuilding as ShearBuilding
from bayes_ssi.structures.modal import Modes as Modes
from bayes_ssi.structures.response import GroundMotion as GroundMotion
from bayes_ssi.structures.response import Output as Output
from bayes_ssi.structures.rigid_floors import FloorBlock as FloorBlock
from bayes_ssi.structures.rigid_floors import ShearBuilding3D as ShearBuilding3D
from bayes_ssi.structures.rigid_floors import floor_sensor as floor_sensor
from bayes_ssi.structures.solver_files.exported_model import ExportedModel as ExportedModel
from bayes_ssi.structures.solver_files.model_files import read_model as read_model
from bayes_ssi.structures.solver_files.parameter_matrices import AlteredModel as AlteredModel
from bayes_ssi.structures.solver_files.parameter_matrices import (
    parameter_matrices as parameter_matrices,
)
from bayes_ssi.structures.space_frame import SpaceFrame as SpaceFrame
from bayes_ssi.structures.structure import Structure as Structure
from bayes_ssi.studies.appendages.candidates import SearchSettings as SearchSettings
from bayes_ssi.studies.appendages.candidates import read_candidates as read_candidates
from bayes_ssi.studies.appendages.hidden_cases import BlindSpots as BlindSpots
from bayes_ssi.studies.appendages.hidden_cases import HiddenCase as HiddenCase
from bayes_ssi.studies.appendages.hidden_cases import blind_spots as blind_spots
from bayes_ssi.studies.changes.changes_family import ChangeSettings as ChangeSettings
from bayes_ssi.studies.planning.layout_plans import plan as plan
from bayes_ssi.studies.planning.plan_record import Layout as Layout
from bayes_ssi.studies.planning.plan_record import Plan as Plan
from bayes_ssi.studies.questions import changes as changes
from bayes_ssi.studies.questions import rank as rank
from bayes_ssi.studies.questions import search as search
from bayes_ssi.studies.ranking.changed_settings import ChangedSettings as ChangedSettings
from bayes_ssi.studies.ranking.comparison import compare as compare
from bayes_ssi.studies.ranking.study import Study as Study
from bayes_ssi.studies.ranking.study import load_study as load_study

__all__ = sorted(name for name in globals() if not name.startswith("_"))
