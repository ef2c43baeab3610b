"""Figures of stored records, posteriors and predictions; nothing here samples.

Every function draws on given axes, or on those of a new figure, and returns them.
"""

from bayes_ssi.plots.appendage_places import plot_places
from bayes_ssi.plots.figure_style import style
from bayes_ssi.plots.identified_modes import plot_identified_modes, plot_identified_shapes
from bayes_ssi.plots.layout_plots import plot_gains, plot_layout
from bayes_ssi.plots.mode_plots import (
    plot_frequency_change,
    plot_mac,
    plot_mac_change,
    plot_modal_sensitivities,
    plot_pairing,
)
from bayes_ssi.plots.parameter_plots import plot_corner, plot_parameters, plot_population
from bayes_ssi.plots.prediction_plots import plot_time_history, plot_transfer_functions
from bayes_ssi.plots.ranking_plots import plot_evidence, plot_frequencies, plot_sensitivity
from bayes_ssi.plots.record_plots import (
    plot_complexity,
    plot_singular_values,
    plot_stabilisation,
    plot_whitened_residuals,
)
from bayes_ssi.plots.shape_plots import plot_building_shape, plot_mode_shapes, plot_shape_components

__all__ = [
    "plot_building_shape",
    "plot_complexity",
    "plot_corner",
    "plot_evidence",
    "plot_frequencies",
    "plot_frequency_change",
    "plot_gains",
    "plot_identified_modes",
    "plot_identified_shapes",
    "plot_layout",
    "plot_mac",
    "plot_mac_change",
    "plot_modal_sensitivities",
    "plot_mode_shapes",
    "plot_pairing",
    "plot_parameters",
    "plot_places",
    "plot_population",
    "plot_sensitivity",
    "plot_shape_components",
    "plot_singular_values",
    "plot_stabilisation",
    "plot_time_history",
    "plot_transfer_functions",
    "plot_whitened_residuals",
    "style",
]
