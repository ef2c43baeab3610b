"""One look for every figure of the package: colours, sizes, and how text and legends are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "HOVER",
    "ORANGE",
    "VERMILION",
    "axes_of",
    "draw_as_they_are",
    "figure_of",
    "hover",
    "legend_below",
    "legend_of_figure",
    "style",
]

# Okabe and Ito's palette: told apart by colour-blind readers, and in grey by lightness.
BLUE, ORANGE, GREEN, VERMILION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#7F7F7F"

# How the text of a point begins where SVG has its identity.
HOVER = "hover: "
# What a line of a legend holds in the width of a figure.
LEGEND_LETTERS = 84

RC: dict[Any, Any] = {
    "figure.constrained_layout.use": True,
    "figure.dpi": 150,
    "savefig.dpi": 150,
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "legend.frameon": False,
}


@contextmanager
def style() -> Iterator[None]:
    """The package's figure style, for the figures drawn within."""
    import matplotlib as mpl

    with mpl.rc_context(RC):
        yield


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of ``size`` (inches)."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    with style():
        _, ax = plt.subplots(figsize=size)
    return ax


def figure_of(figure: Figure | None, size: tuple[float, float]) -> Figure:
    """The figure given, or a new one of ``size`` (inches)."""
    if figure is not None:
        return figure
    import matplotlib.pyplot as plt

    with style():
        return plt.figure(figsize=size)


def hover(artist: Any, text: str) -> None:
    """Say what a point is: an SVG drawing of it then holds the text, which a page can show."""
    # An error bar is several artists; its marker is pointed at.
    (artist.lines[0] if hasattr(artist, "lines") else artist).set_gid(f"{HOVER}{text}")


def draw_as_they_are(texts: Sequence[Any]) -> None:
    """Draw names as they are: between dollar signs matplotlib would set them as mathematics."""
    for text in texts:
        text.set_parse_math(False)


def legend_below(ax: Axes, columns: int) -> None:
    """A legend below the figure, or, where other axes stand beside, within these."""
    if len(ax.figure.axes) == 1:
        legend_of_figure(ax.figure, ax, columns)
        return
    draw_as_they_are(ax.legend(*_named(ax), loc="best", fontsize="small").get_texts())


def legend_of_figure(figure: Any, ax: Axes, columns: int = 3) -> None:
    """The legend of one axes below the figure, for all that it holds.

    In fewer columns where names are long.
    """
    named, labels = _named(ax)
    longest = max(map(len, labels), default=1)
    columns = max(1, min(columns, LEGEND_LETTERS // (longest + 6)))
    legend = figure.legend(named, labels, loc="outside lower center", ncols=columns)
    draw_as_they_are(legend.get_texts())


def _named(ax: Axes) -> tuple[list[Any], list[Any]]:
    """What is drawn under a name, and the names."""
    # matplotlib leaves out labels that begin with an underscore, its own and a class's alike.
    drawn: list[Any] = [*ax.containers, *ax.collections, *ax.lines]
    named = [
        artist
        for artist in drawn
        if artist.get_label()
        and not str(artist.get_label()).startswith(("_child", "_container", "_nolegend_"))
    ]
    return named, [artist.get_label() for artist in named]
