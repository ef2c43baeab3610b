"""The figures of a ranking, written as PNG files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.plots.corner_plot import plot_corner
from bayes_ssi.plots.evidence_plot import plot_evidence
from bayes_ssi.plots.figure_style import figures_for_files, save_figure
from bayes_ssi.plots.model_frequencies import plot_frequencies
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.comparison import Comparison

# Classes that one figure can show legibly.
MOST_CLASSES = 12


def save_figures(
    directory: Path,
    tests: Mapping[str, ModalData],
    ranked: Sequence[Posterior],
    comparison: Comparison,
) -> list[Path]:
    """Write the figures of a result as PNG files into ``directory``, which is created.

    Args:
        directory: where the figures are written.
        tests: name of a configuration → its identified modes; a single one may have the name "".
        ranked: the posteriors, the best first; the corner plot is of the best one.
        comparison: the ranking; the best ``MOST_CLASSES`` are drawn.

    Raises:
        FileExistsError: the directory exists.
    """
    directory.mkdir()
    with figures_for_files():
        figures = {"evidence": plot_evidence(comparison, most=MOST_CLASSES)}
        for i, (configuration, modes) in enumerate(tests.items(), 1):
            name = f"frequencies_{i}" if len(tests) > 1 else "frequencies"
            figures[name] = plot_frequencies(
                modes, ranked[:MOST_CLASSES], configuration=configuration
            )
        return [
            *(save_figure(ax, directory / f"{name}.png") for name, ax in figures.items()),
            save_figure(plot_corner(ranked[0]), directory / "corner.png"),
        ]
