"""One figure of a report, as part of its page."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from bayes_ssi.plots.figure_style import HOVER, RC

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ReportLimits:
    """Most items of each kind that a report shows; the result directory holds the others.

    Attributes:
        least_probability: smallest probability of a class that is drawn, unless it is the first,
            or the second of one test, or cannot be distinguished from the first.
    """

    classes: int = 8
    hypotheses: int = 12
    places: int = 12
    sensors: int = 8
    classes_with_modes: int = 2
    classes_in_frequencies: int = 5
    parameters_in_corner: int = 6
    least_probability: float = 0.01


LIMITS = ReportLimits()


# A CSS inch.
PIXELS = 96
# Pixels: the width of one of two columns of figures on a page.
COLUMN = 448
PNG_HEADER = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class EmbeddedFigure:
    """One figure."""

    caption: str
    html: str
    width: int

    @property
    def is_wide(self) -> bool:
        """Whether it needs the width of the page."""
        return self.width > COLUMN


def embedded_drawing(figure: Figure, caption: str, prefix: str) -> EmbeddedFigure:
    """A figure as an SVG drawing whose points show their hover texts."""
    figure.set_dpi(72)  # SVG is drawn in points
    # Laid out once: a figure that is saved with its layout engine is drawn twice.
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None}, transparent=True)
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(rf'<g id="{HOVER}([^"]*)"', r'<g class="point" tabindex="0" data-tip="\1"', svg)
    svg = re.sub(r'\bid="([^"]*)"', rf'id="{prefix}.\1"', svg)
    svg = re.sub(r'href="#([^"]*)"', rf'href="#{prefix}.\1"', svg)
    svg = re.sub(r"url\(#([^)]*)\)", rf"url(#{prefix}.\1)", svg)
    label = escape(caption, quote=True)
    html = svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    return EmbeddedFigure(caption, html, round(PIXELS * figure.get_figwidth()))


def embedded_file(path: Path, caption: str) -> EmbeddedFigure:
    """A PNG file saved in the package's style, at its intended size."""
    content = path.read_bytes()
    if not content.startswith(PNG_HEADER) or len(content) < 24:
        raise ValueError(f"{path}: damaged: not a PNG file")
    pixels = int.from_bytes(content[16:20], "big")  # the width, first of the first chunk
    width = round(PIXELS * pixels / RC["savefig.dpi"])
    data = base64.b64encode(content).decode("ascii")
    alt = escape(caption, quote=True)
    html = f'<img alt="{alt}" width="{width}" src="data:image/png;base64,{data}">'
    return EmbeddedFigure(caption, html, width)
