"""One look for every figure of the package: colours, sizes, names, legends."""

import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# The name of a figure's file without its suffix, and the figure.
NamedFigure = tuple[str, "Axes | Figure"]


# Colours are Okabe and Ito's: colour-blind readers can tell them apart and, by their lightness, so
# can readers in greyscale.
BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
GREY = "#7F7F7F"
# Of most figures, in inches. Two fit next to one another on the page of a report, and on a
# telephone, 360 pixels of 1/96 in wide without the margins, the smallest text still has 7 points.
FIGURE_WIDTH = 4.3
TEXT_SIZE, SMALL_TEXT = 9.0, 8.0  # points, of axes and legends, and of ticks and notes
ROW_NAMES = 1.65  # inches, most that the names of rows may take
ROW_LINE = 0.14  # inches, height of a line of such a name
PANEL_WIDTH = 1.13  # inches, of a panel of a mode shape
# Next to one another, as many as a width holds; of many modes, twice that.
PANELS_ACROSS = 3
SDS_OF_90_PERCENT = 1.645  # standard deviations to either side that hold 90 %
MOST_CLASSES = 12  # model classes that one figure can show legibly
MOST_VECTORS = 300  # lines or markers above which they are one picture within a drawing
# Where colours repeat, markers and lines differ.
COLOURS = (BLUE, ORANGE, GREEN, VERMILION, GREY)
MARKERS = "osD^v"
LINES = ("-", "--", "-.", ":")
# Prefix of the SVG id of a point with a hover text.
HOVER = "hover: "

# Fonts for names in letters that the default font lacks, those of common systems: only fonts of
# outlines, since matplotlib cannot draw the bitmaps of coloured emoji.
OTHER_FONTS = (
    "Noto Sans CJK SC", "Noto Sans CJK JP", "Noto Sans CJK KR", "Source Han Sans SC",
    "WenQuanYi Micro Hei", "Droid Sans Fallback", "IPAGothic", "Microsoft YaHei", "Yu Gothic",
    "Malgun Gothic", "Hiragino Sans", "Heiti TC", "Arial Unicode MS", "Noto Sans", "Noto Emoji",
    "Segoe UI Emoji", "Symbola",
)  # fmt: skip

RC: dict[Any, Any] = {
    "figure.constrained_layout.use": True,
    "figure.dpi": 150,
    "savefig.dpi": 150,
    "font.size": TEXT_SIZE,
    "xtick.labelsize": SMALL_TEXT,
    "ytick.labelsize": SMALL_TEXT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "svg.hashsalt": "bayes_ssi",  # the same figure gives exactly the same file
}

_for_files = ContextVar("_for_files", default=False)


@contextmanager
def style() -> Iterator[None]:
    """The package's figure style, for the figures drawn and saved within.

    A name may hold letters that no installed font has: they are drawn as boxes, without a warning.
    """
    installed = set(font_manager.get_font_names())
    own = mpl.rcParams["font.family"]
    others = [name for name in OTHER_FONTS if name in installed and name not in own]
    with mpl.rc_context({**RC, "font.family": [*own, *others]}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from", UserWarning)
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


def new_figure(size: tuple[float, float]) -> Figure:
    """A figure of ``size`` (inches)."""
    with style():
        if _for_files.get():
            return Figure(figsize=size)
        import matplotlib.pyplot as plt

        return plt.figure(figsize=size)


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """The axes given, or those of a new figure of ``size`` (inches)."""
    if ax is not None:
        return ax
    with style():
        return new_figure(size).add_subplot()


def whole_figure(drawn: Axes | Figure) -> Figure:
    """The figure of a plot, which returned the figure itself or its axes."""
    figure: Any = drawn if hasattr(drawn, "savefig") else drawn.figure
    return figure


def save_figure(drawn: Axes | Figure, path: Path) -> Path:
    """Write the figure of a plot in the format of the suffix of ``path``; return the path."""
    whole_figure(drawn).savefig(path)
    return path


def save_figures(directory: Path, figures: Iterable[NamedFigure]) -> list[Path]:
    """Write figures as PNG files, in the package's style where they are drawn when asked for."""
    with figures_for_files():
        return [save_figure(drawn, directory / f"{name}.png") for name, drawn in figures]


def hover(artist: Any, text: str) -> None:
    """Attach a hover text to a point, which its SVG drawing carries to a page."""
    # An error bar is several artists; the first of its lines is the marker.
    (artist.lines[0] if hasattr(artist, "lines") else artist).set_gid(f"{HOVER}{text}")


def without_math(*texts: Any) -> None:
    """Draw names literally: between dollar signs matplotlib would set them as mathematics."""
    for text in texts:
        text.set_parse_math(False)


def rows_of(ax: Axes | None, names: Sequence[str], extra: float) -> Axes:
    """The axes given, or those of a new figure, with named rows, the first one at the top.

    ``extra`` are the inches of a new figure that are not for rows.
    """
    shown = [wrapped(name, ROW_NAMES, SMALL_TEXT) for name in names]
    lines = max((name.count("\n") + 1 for name in shown), default=1)
    ax = axes_of(ax, (FIGURE_WIDTH, extra + ROW_LINE * (1 + lines) * len(names)))
    ax.set_yticks(range(len(names)), shown)
    without_math(*ax.get_yticklabels())
    ax.set_ylim(len(names) - 0.5, -0.5)
    return ax


def letters_across(inches: float, points: float = TEXT_SIZE) -> float:
    """Number of letters that fit a width: on average, a letter is 0.6 of its font size wide."""
    return inches * 72.0 / (0.6 * points)


def wrapped(text: str, inches: float, points: float = TEXT_SIZE) -> str:
    """A text in lines that fit a width; its own line breaks are kept."""
    letters = max(1, int(letters_across(inches, points)))
    return "\n".join(textwrap.fill(line, letters) for line in text.split("\n"))


def title_of(ax: Axes, text: str) -> None:
    """A title above axes, in lines no wider than they are."""
    width = whole_figure(ax).get_figwidth() * ax.get_position().width
    ax.set_title(wrapped(text, width, SMALL_TEXT), fontsize=TEXT_SIZE, parse_math=False)


def width_of_modes(n_modes: int) -> float:
    """Inches: the width of a figure with the modes next to one another.

    The frequency of a mode, written below the axis, takes 0.66 in.
    """
    return max(FIGURE_WIDTH, 0.7 + 0.66 * n_modes)


def panels_across(n_panels: int) -> int:
    """Number of panels of mode shapes next to one another, with rows of about the same length."""
    most = PANELS_ACROSS * (1 if n_panels <= 2 * PANELS_ACROSS else 2)
    return -(-n_panels // -(-n_panels // most))


def width_of_panels(across: int) -> float:
    """Inches: the width of a figure with so many panels next to one another."""
    return FIGURE_WIDTH + PANEL_WIDTH * max(0, across - PANELS_ACROSS)


def panels_of(
    n_panels: int, extra: float, row_height: float, **options: Any
) -> tuple[Figure, list[Any]]:
    """A figure of the height of its rows and ``extra`` inches, and its panels.

    ``options`` are those of matplotlib's ``subplots``.
    """
    across = panels_across(n_panels)
    down = -(-n_panels // across)
    figure = new_figure((width_of_panels(across), extra + down * row_height))
    axes = figure.subplots(down, across, squeeze=False, **options).ravel()
    for ax in axes[n_panels:]:
        ax.remove()
    return figure, list(axes[:n_panels])


def legend_below(ax: Axes, columns: int) -> None:
    """A legend below the figure, or, where it has other axes, within these."""
    if len(ax.figure.axes) == 1:
        legend_of_figure(ax.figure, [ax], columns)
        return
    drawn = _labelled([ax])
    legend = ax.legend([*drawn.values()], [*drawn], loc="best", fontsize="small")
    without_math(*legend.get_texts())


def legend_of_figure(figure: Any, axes: Iterable[Axes], columns: int = 3) -> None:
    """The legend of all axes below their figure, in fewer columns where names are long."""
    drawn = _labelled(axes)
    room = int(letters_across(figure.get_figwidth(), SMALL_TEXT))
    line = 6  # letters that the line of an entry and the space after it take
    columns = max(1, min(columns, room // (max(map(len, drawn), default=1) + line)))
    names = [textwrap.fill(name, room // columns - line) for name in drawn]
    outside = "outside " if figure.get_layout_engine() else ""  # else there is room below already
    legend = figure.legend(
        [*drawn.values()], names, loc=f"{outside}lower center", ncols=columns, fontsize=SMALL_TEXT
    )
    without_math(*legend.get_texts())


def _labelled(axes: Iterable[Axes]) -> dict[str, Any]:
    """What is drawn by its name; matplotlib itself leaves out names that begin with a "_"."""
    drawn: Iterable[Any] = [
        each for ax in axes for each in (*ax.containers, *ax.lines, *ax.patches, *ax.collections)
    ]
    labelled = {str(artist.get_label() or "_nolegend_"): artist for artist in drawn}
    own = ("_child", "_container", "_nolegend_")
    return {label: artist for label, artist in labelled.items() if not label.startswith(own)}
