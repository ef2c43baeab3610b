"""Probabilities in colour: one scale for all drawings of places."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bayes_ssi.plots.figure_style import SMALL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ColorBrewer's map from pale yellow to dark red: its lightness falls evenly, so that colour-blind
# readers, and greyscale, keep the order.
MAP = "YlOrRd"


def colour_scale(highest: float) -> Any:
    """Colours of probabilities from zero to the highest that is drawn, a ``ScalarMappable``."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, highest or 1.0), MAP)


def colour_bar(ax: Axes, scale: Any, cax: Axes | None = None) -> None:
    """A colour bar, below ``ax`` or in axes of its own."""
    from matplotlib.ticker import MaxNLocator

    room: Any = {"cax": cax, "orientation": "horizontal"}
    if cax is None:
        room = {"ax": ax, "location": "bottom", "shrink": 0.7, "aspect": 30, "pad": 0.02}
    bar = ax.figure.colorbar(scale, ticks=MaxNLocator(4), **room)
    bar.set_label("probability of an appendage", fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)
