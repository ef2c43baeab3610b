"""Results as tables for a terminal."""

from bayes_ssi.report.tables.calibration_tables import (
    calibration_modes_table,
    calibration_table,
    determination_tables,
)
from bayes_ssi.report.tables.hierarchy_tables import (
    hierarchy_notes,
    population_table,
    populations_table,
)
from bayes_ssi.report.tables.mode_tables import modes_table
from bayes_ssi.report.tables.prediction_tables import frequency_table, peak_table, shape_table
from bayes_ssi.report.tables.ranking_tables import (
    averages_table,
    comparison_notes,
    evidence_table,
    pairing_notes,
    parameter_table,
    ranking_table,
    region_notes,
)
from bayes_ssi.report.tables.search_tables import (
    appendage_table,
    averaged_table,
    baseline_notes,
    baseline_table,
    mass_scales,
    place_table,
    search_notes,
    search_table,
    unsampled_notes,
    unseen_note,
)
from bayes_ssi.report.tables.setting_tables import (
    changed_parameters_table,
    sensitivity_notes,
    sensitivity_table,
    what_if_notes,
    what_if_table,
)

__all__ = [
    "appendage_table",
    "averaged_table",
    "averages_table",
    "baseline_notes",
    "baseline_table",
    "calibration_modes_table",
    "calibration_table",
    "changed_parameters_table",
    "comparison_notes",
    "determination_tables",
    "evidence_table",
    "frequency_table",
    "hierarchy_notes",
    "mass_scales",
    "modes_table",
    "pairing_notes",
    "parameter_table",
    "peak_table",
    "place_table",
    "population_table",
    "populations_table",
    "ranking_table",
    "region_notes",
    "search_notes",
    "search_table",
    "sensitivity_notes",
    "sensitivity_table",
    "shape_table",
    "unsampled_notes",
    "unseen_note",
    "what_if_notes",
    "what_if_table",
]
