"""The figures of a ranking, written as PNG files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.appendage_places import plot_places
from bayes_ssi.plots.figure_style import STYLE, figures_for_files, save_figure
from bayes_ssi.plots.identified_modes import has_errors_on, plot_identified_shapes
from bayes_ssi.plots.parameter_plots import plot_corner
from bayes_ssi.plots.ranking_plots import plot_evidence, plot_frequencies
from bayes_ssi.plots.space import DrawnMode, can_be_drawn, plot_modes_in_space
from bayes_ssi.results.predictions.nodal_modes import nodal_modes
from bayes_ssi.studies.ranking.comparison import Comparison
from bayes_ssi.studies.search.search_record import FamilyRecord

# Name of the files of modes in space, or its beginning.
MODES = "modes"
# The beginning of the names of the files of identified shapes, before a configuration's number.
IDENTIFIED_SHAPES = "identified_shapes"


@dataclass(frozen=True)
class ResultFigure:
    """A figure that is drawn when it is called with the directory to write it in."""

    name: str
    draw: Callable[[], Any]

    def __call__(self, directory: Path) -> Path:
        with figures_for_files():
            return save_figure(self.draw(), directory / f"{self.name}.png")


def result_figures(
    tests: Mapping[str, ModalData],
    ranked: Sequence[Posterior],
    comparison: Comparison,
    search: FamilyRecord | None = None,
) -> list[ResultFigure]:
    """The figures of a result, of its best classes."""
    figures = [ResultFigure("corner", partial(plot_corner, ranked[0]))]
    most = STYLE.most_classes
    for i, (configuration, modes) in enumerate(tests.items(), 1):
        name = f"frequencies_{i}" if len(tests) > 1 else "frequencies"
        draw = partial(plot_frequencies, modes, ranked[:most], configuration=configuration)
        figures.append(ResultFigure(name, draw))
    figures.append(ResultFigure("evidence", partial(plot_evidence, comparison, most=most)))
    if search is not None:
        figures.append(ResultFigure("places", partial(plot_places, search)))
    return figures


def figures_of_modes(model_class: ModelClass, posterior: Posterior) -> Iterator[ResultFigure]:
    """The paired modes in space, where coordinates are known, one figure for each configuration.

    They are those of the exact structure at the most probable parameters.
    """
    for i, test in enumerate(model_class.configurations, 1):
        structure = test.structure
        pairing = posterior.configurations[i - 1].pairing
        if structure.geometry is None or not pairing:
            continue
        likeliest = dict(zip(posterior.parameter_names, posterior.maxima[0], strict=True))
        try:
            modes = nodal_modes(
                structure, np.array([likeliest[p.name] for p in structure.parameters])
            )
        except ValueError:  # labels name no nodes
            continue
        if can_be_drawn(modes):
            shown = [
                DrawnMode(f"mode {label}\n{modes.frequencies_hz[number - 1]:.4g} Hz", number - 1)
                for label, number in pairing.items()
            ]
            name = f"{MODES}_{i}" if len(model_class.configurations) > 1 else MODES
            yield ResultFigure(name, partial(plot_modes_in_space, modes, shown))


def figures_of_identified_shapes(model_class: ModelClass) -> Iterator[ResultFigure]:
    """Shapes with errors on the structure, one figure for each configuration that has both."""
    for i, test in enumerate(model_class.configurations, 1):
        if has_errors_on(test.structure, test.data):
            draw = partial(plot_identified_shapes, test.data, test.structure)
            yield ResultFigure(f"{IDENTIFIED_SHAPES}_{i}", draw)
