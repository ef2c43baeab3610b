"""One figure of a report, as part of its page."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from bayes_ssi.plots.style import HOVER, RC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Picture", "png_figure", "saved_figure", "svg_figure"]

DOTS_PER_INCH = 110
CSS_PIXELS, POINTS_PER_INCH = 96, 72
PNG_HEADER = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Picture:
    """One figure.

    Attributes:
        name: of its file.
        alt: what it shows, for those who do not see it.
        content: of the file: SVG text, or a PNG.
        width: in pixels of a page.
    """

    name: str
    alt: str
    content: str | bytes
    width: int

    @property
    def inline(self) -> str:
        """The figure as a part of a page; names and texts in it are escaped."""
        alt = escape(self.alt, quote=True)
        if isinstance(self.content, bytes):
            data = base64.b64encode(self.content).decode("ascii")
            return f'<img alt="{alt}" width="{self.width}" src="data:image/png;base64,{data}">'
        svg = self.content[self.content.index("<svg") :]
        return svg.replace("<svg", f'<svg role="img" aria-label="{alt}"', 1)


def svg_figure(
    name: str, alt: str, plot: Callable[[Figure], object], size: tuple[float, float]
) -> Picture:
    """A figure of that size, in inches, as an SVG drawing; points that tell what they are do so."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=POINTS_PER_INCH)
    FigureCanvasSVG(figure)
    plot(figure)
    # Laid out once: a figure that is saved with its layout engine is drawn twice.
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None}, transparent=True)
    drawing = re.sub(rf'<g id="{HOVER}([^"]*)"', r'<g class="point" tabindex="0" data-tip="\1"',
                     file.getvalue())  # fmt: skip
    # Identities are a drawing's own: several of them stand on one page.
    drawing = re.sub(r'\bid="([^"]*)"', rf'id="{name}.\1"', drawing)
    drawing = re.sub(r'href="#([^"]*)"', rf'href="#{name}.\1"', drawing)
    drawing = re.sub(r"url\(#([^)]*)\)", rf"url(#{name}.\1)", drawing)
    return Picture(name, alt, drawing, round(CSS_PIXELS * size[0]))


def png_figure(
    name: str, alt: str, plot: Callable[[Figure], object], size: tuple[float, float]
) -> Picture:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context({"figure.constrained_layout.use": False}):
        figure = Figure(figsize=size)  # corner plots place their axes themselves
    plot(figure)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return Picture(name, alt, file.getvalue(), round(CSS_PIXELS * size[0]))


def saved_figure(name: str, alt: str, path: Path) -> Picture:
    """A PNG file that was saved in the package's style, at the size that it was drawn for.

    Raises:
        ValueError: it is no PNG file.
    """
    content = path.read_bytes()
    if not content.startswith(PNG_HEADER) or len(content) < 24:
        raise ValueError(f"{path}: damaged: not a PNG file")
    pixels = int.from_bytes(content[16:20], "big")  # the width, first of the first chunk
    return Picture(name, alt, content, round(CSS_PIXELS * pixels / RC["savefig.dpi"]))
