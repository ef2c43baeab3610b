"""Marginal and joint posterior densities of parameters."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.packages import importing_without
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.plots.figure_style import BLUE, SMALL, figure_of, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_corner(
    posterior: Posterior, figure: Figure | None = None, parameters: Sequence[str] | None = None
) -> Figure:
    """Marginal and joint posterior densities of all or some of the parameters.

    Dashed lines are the 5 %, 50 % and 95 % quantiles; contours hold 39 % and 86 % of the draws, as
    one and two standard deviations of a normal density do. Panels leave out the outermost 0.3 % of
    the draws.

    Args:
        figure: to draw on; a new one if None.
        parameters: names of the parameters; all if None.
    """
    names = posterior.parameter_names if parameters is None else tuple(parameters)
    require_known("plot_corner: no parameter", names, posterior.parameter_names)
    values = posterior.values[:, [posterior.parameter_names.index(name) for name in names]]
    n = len(names)
    # Of the draws: those within three standard deviations of a normal density, so that a single
    # draw far away does not shrink all others to a point; and within one and two of a density of
    # two variables.
    shown, contours = 0.9973, 1.0 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)
    figure = figure_of(figure, (0.8 + 1.5 * n, 1.4 + 1.5 * n))
    corner = import_corner()
    from matplotlib.ticker import MaxNLocator

    with warnings.catch_warnings():
        # Constrained layout replaces corner's own.
        warnings.filterwarnings("ignore", "This figure was using a layout engine", UserWarning)
        corner.corner(
            values, bins=30, range=[shown] * n, fig=figure, color=BLUE, quantiles=LEVELS,
            smooth=1.0, levels=contours, plot_datapoints=False, plot_density=False,
            fill_contours=True, no_fill_contours=True, max_n_ticks=3,
        )  # fmt: skip
    panels = np.array(figure.axes, dtype=object).reshape(n, n)
    # Panels above the diagonal are empty; the layout need not look for what they hold.
    for empty in panels[np.triu_indices(n, 1)]:
        empty.set(visible=False, in_layout=False)
    for i, (name, draws) in enumerate(zip(names, values.T, strict=True)):
        low, median, high = np.quantile(draws, LEVELS)
        # In a panel of 1.5 in, a name may take 1.3 in.
        label = wrapped(name, 1.3, SMALL)
        title = f"{label}\n{median:.4g}\n({low:.4g} to {high:.4g})"
        panels[i, i].set_title(title, fontsize=SMALL, loc="center", parse_math=False)
        panels[-1, i].set_xlabel(label, fontsize=SMALL, parse_math=False)
        if i:
            panels[i, 0].set_ylabel(label, fontsize=SMALL, parse_math=False)
    for ax in panels.flat:
        # Three numbers at most, none of them at a corner, where those of two panels would meet.
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_locator(), MaxNLocator):
                axis.set_major_locator(MaxNLocator(3, prune="both", min_n_ticks=1))
        ax.tick_params(labelsize=SMALL, labelrotation=0)
    note = "median, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
    figure.suptitle(f"{posterior.name}\n{note}", fontsize=10, parse_math=False)
    return figure


@cache
def import_corner() -> Any:
    """The module corner, which takes arrays without arviz."""
    with importing_without("arviz", package="corner"):
        import corner
    return corner
