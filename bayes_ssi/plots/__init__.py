"""Figures, by functions that draw on given axes or on new ones and return them.

None of them samples: they draw stored records, posteriors and predictions.
"""

from bayes_ssi.plots.changes import (
    plot_frequency_change,
    plot_mac_change,
    plot_modes_before_and_after,
)
from bayes_ssi.plots.corner_plot import plot_corner
from bayes_ssi.plots.identified_modes import plot_identified_modes, plot_pairing
from bayes_ssi.plots.mode_shapes import plot_mode_shapes
from bayes_ssi.plots.place_map import plot_places
from bayes_ssi.plots.ranking_plots import plot_evidence, plot_frequencies
from bayes_ssi.plots.responses import plot_mac, plot_time_history, plot_transfer_functions
from bayes_ssi.plots.shapes import plot_components, plot_shape
from bayes_ssi.plots.style import style
from bayes_ssi.plots.summaries import plot_parameters, plot_sensitivity

__all__ = [
    "plot_components",
    "plot_corner",
    "plot_evidence",
    "plot_frequencies",
    "plot_frequency_change",
    "plot_identified_modes",
    "plot_mac",
    "plot_mac_change",
    "plot_mode_shapes",
    "plot_modes_before_and_after",
    "plot_pairing",
    "plot_parameters",
    "plot_places",
    "plot_sensitivity",
    "plot_shape",
    "plot_time_history",
    "plot_transfer_functions",
    "style",
]
