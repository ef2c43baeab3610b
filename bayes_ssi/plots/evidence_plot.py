"""Log evidence of model classes, and what it is made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.plots.figure_style import (
    BLUE,
    VERMILION,
    hover,
    legend_below,
    name_rows,
    rows_of,
    title_of,
)
from bayes_ssi.studies.ranking.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_evidence(
    comparison: Comparison, ax: Axes | None = None, *, most: int | None = None
) -> Axes:
    """Log evidence of every class, split into fit and information gained.

    Each class has three marks on one axis in nats: how well it fits on average (mean
    log-likelihood), the log evidence with its error bar, and between them, as a bar, the
    information gained, by which the evidence falls short of the fit.

    Args:
        ax: axes; new ones if None.
        most: largest number of classes drawn, the best first; all if None.
    """
    rows = comparison.classes[:most]
    names = [f"{row.name}\n({row.probability_text})" for row in rows]
    ax = rows_of(ax, names, 1.3)
    y = np.arange(len(rows))
    evidence = np.array([row.log_evidence for row in rows])
    fit = np.array([row.mean_log_likelihood for row in rows])
    ax.barh(y, fit - evidence, left=evidence, height=0.35, color=BLUE, alpha=0.25,
            label="information gained")  # fmt: skip
    ax.plot(fit, y, "|", color=BLUE, markersize=11, label="fit: mean log-likelihood")
    for i, row in enumerate(rows):
        point = ax.errorbar(row.log_evidence, i, xerr=row.error, fmt="o", color=VERMILION,
                            capsize=3,
                            label=None if i else "log evidence ± 1 standard error")  # fmt: skip
        hover(point, f"{row.name}: log evidence {row.log_evidence:.3f} ± {row.error:.3f}, fit "
              f"{row.mean_log_likelihood:.2f}, probability {row.probability_text}")  # fmt: skip
    name_rows(ax, names)
    ax.use_sticky_edges = False
    ax.margins(x=0.04)
    ax.set_xlabel("nats")
    title_of(ax, "Model classes (probability)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax
