"""One look for every figure of the package: colours, sizes, names, legends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette: its colours can be distinguished by colour-blind readers and, by their
# lightness, in greyscale. Where colours repeat, markers and lines differ.
COLOURS = BLUE, ORANGE, GREEN, VERMILION, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#D55E00", "#7F7F7F"
)  # fmt: skip
MARKERS = "osD^v"
LINES = ("-", "--", "-.", ":")

# Inches: the width of a figure whose axes are as wide as the page.
WIDTH = 6.4
# Panels of mode shapes that are legible next to one another on a page.
PANELS_ACROSS = 4
# Prefix of the SVG id of a point with a hover text.
HOVER = "hover: "

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

_for_files = ContextVar("_for_files", default=False)


@contextmanager
def style() -> Iterator[None]:
    """The package's figure style, for the figures drawn within."""
    import matplotlib as mpl

    with mpl.rc_context(RC):
        yield


@contextmanager
def figures_for_files() -> Iterator[None]:
    """The package's figure style; pyplot neither shows nor keeps figures drawn within."""
    token = _for_files.set(True)
    try:
        with style():
            yield
    finally:
        _for_files.reset(token)


def figure_of(figure: Figure | None, size: tuple[float, float]) -> Figure:
    """The figure given, or a new one of ``size`` (inches)."""
    if figure is not None:
        return figure
    with style():
        if _for_files.get():
            from matplotlib.figure import Figure as PlainFigure

            return PlainFigure(figsize=size)
        import matplotlib.pyplot as plt

        return plt.figure(figsize=size)


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of ``size`` (inches)."""
    if ax is not None:
        return ax
    with style():
        return figure_of(None, size).subplots()


def whole_figure(drawn: Axes | Figure) -> Figure:
    """The figure of a plot, which returned the figure itself or its axes."""
    figure: Any = drawn if hasattr(drawn, "savefig") else drawn.figure
    return figure


def save_figure(drawn: Axes | Figure, path: Path) -> Path:
    """Write the figure of a plot in the format of the suffix of ``path``; return the path."""
    whole_figure(drawn).savefig(path)
    return path


def hover(artist: Any, text: str) -> None:
    """Attach a hover text to a point, which its SVG drawing carries to a page."""
    # An error bar is several artists; the first of its lines is the marker.
    (artist.lines[0] if hasattr(artist, "lines") else artist).set_gid(f"{HOVER}{text}")


def without_math(*texts: Any) -> None:
    """Draw names literally: between dollar signs matplotlib would set them as mathematics."""
    for text in texts:
        text.set_parse_math(False)


def name_rows(ax: Axes, names: Sequence[str]) -> None:
    """Name the rows of axes, the first one at the top."""
    ax.set_yticks(range(len(names)), names)
    without_math(*ax.get_yticklabels())
    ax.set_ylim(len(names) - 0.5, -0.5)


def letters_across(inches: float, points: float = 9.0) -> float:
    """Number of letters that fit a width: on average, a letter is 0.6 of its font size wide."""
    return inches * 72.0 / (0.6 * points)


def legend_below(ax: Axes, columns: int) -> None:
    """A legend below the figure, or, where it has other axes, within these."""
    if len(ax.figure.axes) == 1:
        legend_of_figure(ax.figure, ax, columns)
        return
    drawn = _labelled(ax)
    legend = ax.legend([*drawn.values()], [*drawn], loc="best", fontsize="small")
    without_math(*legend.get_texts())


def legend_of_figure(figure: Any, ax: Axes, columns: int = 3) -> None:
    """The legend of one axes below its figure, in fewer columns where names are long."""
    drawn = _labelled(ax)
    longest = max(map(len, drawn), default=1) + 6  # the line of an entry takes 6 letters
    columns = min(columns, int(letters_across(figure.get_figwidth()) / longest))
    legend = figure.legend(
        [*drawn.values()], [*drawn], loc="outside lower center", ncols=max(1, columns)
    )
    without_math(*legend.get_texts())


def _labelled(ax: Axes) -> dict[str, Any]:
    """What is drawn by its name; matplotlib itself leaves out names that begin with a "_"."""
    drawn: Iterable[Any] = (*ax.lines, *ax.collections, *ax.containers)
    labelled = {str(artist.get_label() or "_nolegend_"): artist for artist in drawn}
    own = ("_child", "_container", "_nolegend_")
    return {label: artist for label, artist in labelled.items() if not label.startswith(own)}
