"""How a ranking changes with settings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.plots.figure_style import (
    COLOURS,
    MARKERS,
    VERMILION,
    hover,
    legend_below,
    name_rows,
    rows_of,
)
from bayes_ssi.studies.ranking.comparison import probability_text
from bayes_ssi.studies.ranking.sensitivity import Sensitivity

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_sensitivity(sensitivity: Sensitivity, ax: Axes | None = None) -> Axes:
    """Log of each class's probability over that of the first class, setting by setting.

    Each row is a setting; the first row is the ranking itself. A class to the right of the line is
    more probable than the first class of that ranking. The five best classes are drawn.
    """
    rows = sensitivity.rows
    first, *others = rows[0].ranked
    ax = rows_of(ax, [row.name for row in rows], 1.4)
    ax.axvline(0.0, color="black", linewidth=0.8, label=f"{first}: first in the ranking")
    looks = list(zip(others, COLOURS[:4], MARKERS, strict=False))
    for y, row in enumerate(rows):
        if row.best != first:
            ax.axhspan(y - 0.5, y + 0.5, color=VERMILION, alpha=0.12, linewidth=0)
        for name, colour, marker in looks:
            probability, of_first = row.probabilities[name], row.probabilities[first]
            if probability <= 0.0 or of_first <= 0.0:
                continue
            (point,) = ax.plot(np.log(probability / of_first), y, marker, color=colour,
                               markersize=5, linestyle="none",
                               label=None if y else name)  # fmt: skip
            hover(point, f"{name}, {row.name}: probability {probability_text(probability)}")
    # Classes further behind than 30 nats would compress the scale for those that matter.
    if max(map(abs, ax.get_xlim())) > 30.0:
        ax.set_xscale("symlog", linthresh=1.0)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.margins(x=0.06)
    name_rows(ax, [row.name for row in rows])
    ax.set_xlabel("log of the probability over that of\nthe first class (nats)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax
