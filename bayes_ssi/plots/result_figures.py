"""The figures of a ranking, written as PNG files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

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
from bayes_ssi.studies.ranking.study import Ranking
from bayes_ssi.studies.search.search_record import FamilyRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Name of the files of modes in space, or its beginning.
MODES = "modes"
# The beginning of the names of the files of identified shapes, before a configuration's number.
IDENTIFIED_SHAPES = "identified_shapes"
# A name, and the figure that is drawn when it is asked for.
Named = tuple[str, "Axes | Figure"]


def save_result_figures(ranking: Ranking, search: FamilyRecord | None, directory: Path) -> None:
    """Write the figures of a ranking, and of the search that gave it, into a directory."""
    by_name = {posterior.name: posterior for posterior in ranking.posteriors}
    ranked = [by_name[row.name] for row in ranking.comparison.classes]
    best = next(each for each in ranking.study.model_classes if each.name == ranked[0].name)
    tests = {test.name: test.data for test in best.configurations}
    with figures_for_files():
        for name, figure in chain(
            result_figures(tests, ranked, ranking.comparison, search),
            figures_of_modes(best, ranked[0]),
            figures_of_identified_shapes(best),
        ):
            save_figure(figure, directory / f"{name}.png")


def result_figures(
    tests: Mapping[str, ModalData],
    ranked: Sequence[Posterior],
    comparison: Comparison,
    search: FamilyRecord | None = None,
) -> Iterator[Named]:
    """The figures of a result, of its best classes."""
    yield "corner", plot_corner(ranked[0])
    most = STYLE.most_classes
    for i, (configuration, modes) in enumerate(tests.items(), 1):
        name = f"frequencies_{i}" if len(tests) > 1 else "frequencies"
        yield name, plot_frequencies(modes, ranked[:most], configuration=configuration)
    yield "evidence", plot_evidence(comparison, most=most)
    if search is not None:
        yield "places", plot_places(search)


def figures_of_modes(model_class: ModelClass, posterior: Posterior) -> Iterator[Named]:
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
            yield name, plot_modes_in_space(modes, shown)


def figures_of_identified_shapes(model_class: ModelClass) -> Iterator[Named]:
    """Shapes with errors on the structure, one figure for each configuration that has both."""
    for i, test in enumerate(model_class.configurations, 1):
        if has_errors_on(test.structure, test.data):
            yield f"{IDENTIFIED_SHAPES}_{i}", plot_identified_shapes(test.data, test.structure)
