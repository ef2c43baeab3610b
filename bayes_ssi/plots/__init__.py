"""Figures of stored records, posteriors and predictions; nothing here samples.

Functions draw on given axes, or on those of a new figure, and return them; of several panels or in
space they return a new figure. :func:`plot_moving_shapes` makes a page. ``as`` says to type
checkers that a name is meant for others.
"""

from bayes_ssi.plots.class_plots import plot_corner as plot_corner
from bayes_ssi.plots.class_plots import plot_evidence as plot_evidence
from bayes_ssi.plots.class_plots import plot_frequencies as plot_frequencies
from bayes_ssi.plots.class_plots import plot_mac as plot_mac
from bayes_ssi.plots.class_plots import plot_population as plot_population
from bayes_ssi.plots.figure_style import style as style
from bayes_ssi.plots.moving_shapes import plot_moving_shapes as plot_moving_shapes
from bayes_ssi.plots.place_plots import plot_blind_spots as plot_blind_spots
from bayes_ssi.plots.place_plots import plot_layout as plot_layout
from bayes_ssi.plots.place_plots import plot_places as plot_places
from bayes_ssi.plots.prediction_plots import plot_time_history as plot_time_history
from bayes_ssi.plots.prediction_plots import plot_transfer_functions as plot_transfer_functions
from bayes_ssi.plots.record_plots import plot_complexity as plot_complexity
from bayes_ssi.plots.record_plots import plot_singular_values as plot_singular_values
from bayes_ssi.plots.record_plots import plot_stabilisation as plot_stabilisation
from bayes_ssi.plots.record_plots import plot_whitened_residuals as plot_whitened_residuals
from bayes_ssi.plots.shape_plots import plot_identified_modes as plot_identified_modes
from bayes_ssi.plots.shape_plots import plot_mode_shapes as plot_mode_shapes
from bayes_ssi.plots.shape_plots import plot_shape_components as plot_shape_components

__all__ = ["style", *sorted(name for name in globals() if name.startswith("plot_"))]
